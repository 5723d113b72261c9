"""The run in C against the run through numba, and which of them is taken."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from servo_models.catalogue import model
from servo_models.core import compiled
from servo_models.core.c_text import c_run_text
from servo_models.core.compiled import Run, compiled_run, run_by_numba, run_in_c
from servo_models.core.compilers import (
    TARGETS,
    Compiler,
    cached_library,
    for_this_processor,
    here,
    host,
)
from servo_models.core.simulate import Model
from servo_models.core.stepper import run_text
from servo_models.core.types import Array
from servo_models.errors import UserError
from tests.support.compilers import in_c_only
from tests.support.own_actuators import write

TIMES = np.linspace(0.0, 0.5, 51)
STEP = np.where(TIMES < 0.2, 0.0, 1.0)[:, None]

KINDS = {
    1: "(goal - angle) / (goal - 1.0)",
    2: "goal - angle + int(goal) % (int(goal) - 1)",
    3: "math.sqrt(0.5 - goal)",
    4: "math.log(1.0 - goal)",
    5: "math.exp(1000.0 * goal)",
    6: "1e-18 * math.floor(goal * 1e308 * 1e308) - angle",
    7: "math.sin(goal * 1e308 * 1e308)",
    8: "(5 * goal - int(-7.0 * goal) % 3 + int(7.0 * goal) % -4) / (1 + int(goal)) - 1e3 * angle",
}
"""What Python refuses at the step to 1, numba computes in numbers that are not finite or whole."""


def joint(folder: Path, lines: list[str]) -> Model:
    """A joint whose block has these lines."""
    changes = {
        "    return (goal - angle) / time_constant\n": "".join(f"    {line}\n" for line in lines),
        "from typing import Annotated\n": "import math\nfrom typing import Annotated\n",
    }
    return model(str(write(folder, changes=changes)))


def ran(run: Run, chosen: Model, vector: Array) -> tuple[int, int, Array, Array]:
    """Code and row, the outputs before that row, and the state that is left."""
    x, out = chosen.start(), np.empty((len(TIMES), 1))
    code, row = run(vector, x, TIMES, STEP, out)
    return code, row, out if code == 0 else out[:row], x


@in_c_only
def test_a_run_that_fails_fails_alike_in_c_and_through_numba(tmp_path: Path) -> None:
    lines = [f"if int(time_constant) == {k}:\n        return {text}" for k, text in KINDS.items()]
    chosen = joint(tmp_path, [*lines, "return goal - angle"])
    text = run_text(chosen.flat)
    runs = [run_in_c(text), run_by_numba(text)]
    codes = set()
    for kind, expression in KINDS.items():
        vector = np.array(list({**chosen.values, "time_constant": float(kind)}.values()))
        one, other = (ran(run, chosen, vector) for run in runs)
        assert one[:2] == other[:2], expression
        assert np.array_equal(one[2], other[2]), expression
        assert np.array_equal(one[3], other[3], equal_nan=True), expression
        codes.add(one[:2])
    assert any(code == 0 for code, _ in codes)
    assert len(codes) > 1


@in_c_only
def test_where_it_runs_in_c_numba_is_not_imported(tmp_path: Path) -> None:
    path = write(tmp_path)
    text = (
        "import sys, servo_models as sm\n"
        f"print(sm.simulate(sm.model({str(path)!r}), [0.0, 1.0], {{'goal': 1.0}})['angle'][-1])\n"
        "assert 'numba' not in sys.modules\n"
    )
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert float(done.stdout) == pytest.approx(1.0 - np.exp(-1.0 / 0.2), abs=1e-6)


FAILING = Compiler((sys.executable, "-c", "raise SystemExit(1)"), "failing", TARGETS, is_zig=False)
ABSENT = Compiler(("no-such-compiler",), "absent", TARGETS, is_zig=False)
FOREIGN = Compiler(
    ("no-such-compiler",), "foreign", tuple(it for it in TARGETS if it != here()), is_zig=False
)


@pytest.mark.parametrize("found", [None, FAILING, ABSENT, FOREIGN])
def test_without_a_compiler_that_works_numba_runs(
    found: Compiler | None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    given = []
    monkeypatch.setattr(compiled, "host", lambda: found)
    monkeypatch.setattr(compiled, "run_by_numba", given.append)
    text = run_text(joint(tmp_path, ["return (goal - angle) / time_constant"]).flat) + "\n"
    text += f"# {found}\n"  # not what another test has compiled
    compiled_run(text)
    assert given == [text]
    assert capfd.readouterr() == ("", "")


def test_what_has_no_form_in_c_runs_through_numba(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = run_text(joint(tmp_path, ["return math.gamma(1.5 + time_constant) - angle"]).flat)
    given = []
    monkeypatch.setattr(compiled, "run_by_numba", given.append)
    compiled_run(text)
    assert given == [text]


def test_whole_numbers_beside_and_or_have_no_form(tmp_path: Path) -> None:
    """C would give 1 where Python gives the number."""
    text = run_text(joint(tmp_path, ["return (int(goal) or 3) - angle"]).flat)
    with pytest.raises(ValueError, match="write a comparison"):
        c_run_text(text)


@in_c_only
def test_another_processor_has_a_library_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = []
    monkeypatch.setattr(
        compiled, "cached_library", lambda *given: paths.append(cached_library(*given)) or paths[-1]
    )
    text = run_text(joint(tmp_path, ["return goal - angle"]).flat)
    run_in_c(text)
    run_in_c(text)
    monkeypatch.setattr(compiled, "for_this_processor", lambda _: ((), "another one"))
    run_in_c(text)
    assert paths[0] == paths[1] != paths[2]


@in_c_only
def test_a_compiler_without_flags_for_this_processor_is_asked_for_none() -> None:
    compiler = host()
    assert compiler is not None
    flags, processor = for_this_processor(compiler)
    assert not flags or "__" in processor
    assert for_this_processor(replace(compiler, command=(sys.executable,))) == ((), "")


@in_c_only
def test_two_threads_run_at_once(tmp_path: Path) -> None:
    chosen = joint(tmp_path, ["return (goal - angle) / time_constant"])
    run = run_in_c(run_text(chosen.flat))
    times = np.linspace(0.0, 20.0, 20001)

    def angle(goal: float) -> Array:
        out = np.empty((len(times), 1))
        goals = np.full((len(times), 1), goal)
        assert run(chosen.vector, chosen.start(), times, goals, out)[0] == 0
        return out[:, 0]

    goals = [0.1 * k for k in range(20)]
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(angle, goals))
    for goal, found in zip(goals, together):
        expected = goal * (1.0 - np.exp(-times / 0.2))
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-6)
        assert np.array_equal(found, angle(goal))


@in_c_only
@pytest.mark.parametrize("spoil", ["single", "transposed", "flat", "read only"])
def test_arrays_that_are_read_otherwise_are_refused(spoil: str, tmp_path: Path) -> None:
    chosen = joint(tmp_path, ["return (goal - angle) / time_constant"])
    run = run_in_c(run_text(chosen.flat))
    out = np.empty((len(TIMES), 1))
    run(chosen.vector, chosen.start(), TIMES, STEP, out)
    inputs = STEP
    if spoil == "single":
        inputs = STEP.astype(np.float32)
    elif spoil == "transposed":
        inputs = np.asfortranarray(np.hstack([STEP, STEP]))
    elif spoil == "flat":
        inputs = STEP[:, 0]
    else:
        out.flags.writeable = False
    with pytest.raises(TypeError, match="float64 in C order"):
        run(chosen.vector, chosen.start(), TIMES, inputs, out)


@in_c_only
@pytest.mark.parametrize("by", [run_in_c, run_by_numba])
def test_a_run_ends_after_the_sub_steps_that_it_may_make(
    by: Callable[[str], Run], tmp_path: Path
) -> None:
    """Where the internal step is as long as a row, a row takes one sub-step."""
    chosen = joint(tmp_path, ["return (goal - angle) / time_constant"])
    vector = chosen.vector
    vector[list(chosen.values).index("internal_step")] = TIMES[1]
    run, out = by(run_text(chosen.flat)), np.empty((len(TIMES), 1))
    enough, short = 51.0, 30.0
    assert run(vector, chosen.start(), TIMES, STEP, out, enough) == (0, 51)
    code, row = run(vector, chosen.start(), TIMES, STEP, out, short)
    assert (code, row) == (chosen.flat.too_long, 30)
    with pytest.raises(UserError, match="too many sub-steps"):
        chosen.ran(vector, chosen.start(), TIMES, STEP, short)
