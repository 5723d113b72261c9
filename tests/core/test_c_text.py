"""The C form of a flat text, against the Python form: the same bits, the same refusals."""

from __future__ import annotations

from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from servo_models.build import NATIVE, build
from servo_models.catalogue import model
from servo_models.core.c_text import c_text
from servo_models.core.compilers import compiler
from servo_models.core.simulate import Model
from tests.support.fmu_host import Host
from tests.support.own_actuators import write

needs_a_compiler = pytest.mark.skipif(
    compiler() is None, reason='no C compiler: install one, or pip install ".[native]"'
)


def joint(folder: Path, body: str, changes: dict[str, str] | None = None) -> Model:
    """The joint with ``body`` in place of the lines of its one block, which begin with an import
    of ``math`` at the top of the file."""
    lines = "".join(f"    {line}\n" for line in body.strip().split("\n"))
    replaced = {
        "    return (goal - angle) / time_constant\n": lines,
        "from typing import Annotated\n": "import math\nfrom typing import Annotated\n",
        **(changes or {}),
    }
    return model(str(write(folder, changes=replaced)))


def in_python(chosen: Model, times: np.ndarray, goals: np.ndarray) -> np.ndarray | None:
    """The angle by the plain Python text, None where Python raises or the text refuses."""
    try:
        start, step = chosen.stepper()
        x = start()
        t, goal = times.tolist(), goals.tolist()
        _, outputs = step(list(x), goal[:1], t[0], 0.0)
        rows = [outputs[0]]
        for k in range(len(t) - 1):
            code, outputs = step(x, [goal[k]], t[k], t[k + 1] - t[k])
            if code:
                return None
            rows.append(outputs[0])
    except (ArithmeticError, ValueError):
        return None
    return np.array(rows)


def in_c(chosen: Model, folder: Path, times: np.ndarray, goals: np.ndarray) -> np.ndarray | None:
    """The same by the native FMU."""
    path = build(chosen, folder / "joint.fmu", NATIVE)
    unpacked = Path(fmpy.extract(str(path), str(folder / "unpacked")))
    with Host(unpacked) as host:
        try:
            return host.simulate(times, goals[:, None])[:, 0]
        except FMICallException:
            assert host.messages
            return None


TIMES = np.linspace(0.0, 0.5, 51)
GOALS = 2.0 * np.sin(20.0 * TIMES)

BODIES = {
    "a swap": """
low, high = goal, angle
if low > high:
    low, high = high, low
return (low + 2.0 * high - 3.0 * angle) / time_constant
""",
    "a loop that counts": """
sum = 0.0
count = 0
while count < 4 and sum < 100.0:
    sum += goal / (1 + count)
    count += 1
return (sum - angle * count) / time_constant
""",
    "whole numbers": """
slot = int(10.0 * goal) % 7
half = int(goal * 10.0) % 3 / 2
return (slot + half - 3 - angle) / time_constant
""",
    "chains and conditions": """
inside = -1.0 <= goal <= 1.0
either = goal > 1.5 or not angle < 0.5 and goal != 0.0
rate = (goal if inside else 1.0 if goal > 0.0 else -1.0) - angle
return rate / time_constant if either else 0.5 * rate / time_constant
""",
    "every function": """
a = abs(goal) + 0.1
total = math.sqrt(a) + math.exp(-a) + math.log(a) + math.log10(a) + math.log1p(a)
total += math.expm1(-a) + math.sin(goal) + math.cos(goal) + math.tan(0.3 * goal)
total += math.asin(0.4 * goal) + math.acos(0.4 * goal) + math.atan(goal) + math.atan2(goal, a)
total += math.sinh(goal) + math.cosh(goal) + math.tanh(goal) + math.floor(3.0 * goal)
total += math.ceil(3.0 * goal) + math.trunc(3.0 * goal) + math.copysign(a, goal) + math.fabs(goal)
return (0.01 * total * math.pi / math.e - angle) / time_constant
""",
    "whole numbers that are divided or grow": """
n = 3
n /= 2
count = 1
product = 1
while count < 14:
    product *= count
    count += 1
large = 100000
square = large * large + 100000 * 100000
return (n * goal + 1e-9 * product + 1e-10 * square - angle) / time_constant
""",
    "a chain that reads what it sets": """
low = goal
high = low = low + 1.0
return (high + 2.0 * low - angle) / time_constant
""",
    "what follows a loop": """
count = 0
gain = 0.0
while count < 3:
    count += 1
else:
    gain = 2.0
return (gain * goal - angle) / time_constant
""",
    "a whole zero has no sign": """
up = math.atan2(math.ceil(0.01 * goal - 0.03), -1.0)
rest = math.atan2(int(-4.0) % 2, -1.0)
return (goal + up + rest + math.atan2(int(-0.1), -1.0) - angle) / time_constant
""",
    "names that mean something in C": """
double = goal
register = double - angle
volatile = int = register / time_constant
errno = float(volatile)
return errno
""",
}


@needs_a_compiler
@pytest.mark.parametrize("name", BODIES)
def test_c_and_python_give_the_same_bits(name: str, tmp_path: Path) -> None:
    chosen = joint(tmp_path, BODIES[name])
    expected = in_python(chosen, TIMES, GOALS)
    assert expected is not None
    assert np.ptp(expected) > 0.01
    found = in_c(chosen, tmp_path, TIMES, GOALS)
    assert found is not None
    assert np.array_equal(found, expected)


FAILS = {
    "division by zero": "return (goal - angle) / (goal - 1.0)",
    "a remainder of zero": "return (goal - angle) * (int(goal) % (int(goal) - 1))",
    "a root of less than zero": "return math.sqrt(0.5 - goal)",
    "a logarithm of zero": "return math.log(1.0 - goal)",
    "an exponential that overflows": "return math.exp(1000.0 * goal)",
    "a whole number of an infinite one": "return math.floor(goal * 1e308 * 1e308)",
    "a division by zero in a loop that then would not end": (
        "left = goal\nwhile left > 0.5:\n    left = left / (goal - 1.0)\nreturn left - angle"
    ),
    "an angle that is infinite": "return math.sin(goal * 1e308 * 1e308)",
}


@pytest.mark.thorough
@needs_a_compiler
@pytest.mark.parametrize("name", FAILS)
def test_c_refuses_where_python_raises(name: str, tmp_path: Path) -> None:
    """At the step to 1.0, and not before."""
    chosen = joint(tmp_path, FAILS[name])
    goals = np.where(TIMES < 0.2, 0.0, 1.0)
    early = TIMES < 0.2
    assert in_python(chosen, TIMES[early], goals[early]) is not None
    assert in_python(chosen, TIMES, goals) is None
    assert in_c(chosen, tmp_path / "early", TIMES[early], goals[early]) is not None
    assert in_c(chosen, tmp_path / "late", TIMES, goals) is None


NO_FORM = {
    "math.log(goal + 2.0, 2.0) - angle": r"math\.log has one argument in C",
    "goal // 0.3 - angle": r"'goal // 0.3' has no form in C",
    "(goal in (0.0, 1.0)) - angle": r"'goal in \(0.0, 1.0\)' has no form in C",
    "math.gamma(goal) / time_constant - angle": r"math\.gamma has no form in C: use one of acos",
    "(goal or angle) / time_constant": r"beside 'and' or 'or': write a comparison",
}


@pytest.mark.parametrize("expression", NO_FORM)
def test_what_has_no_form_in_c_is_named(expression: str, tmp_path: Path) -> None:
    chosen = joint(tmp_path, f"return {expression}")
    with pytest.raises(ValueError, match=NO_FORM[expression]):
        c_text(chosen.flat)
