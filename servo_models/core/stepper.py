"""The stepper: print a flattened plant as one self-contained text, for simulations or for one step.

Both are Python, which numba compiles and ``c_text.py`` writes in C.

This file, ``flat.py`` and ``printer.py`` use the standard library only and are part of every
FMU, so that an FMU can drop its neutral effects when initialisation ends and print itself again.

**Contract of a step.**  A communication step of size H starting at t is cut into
n = ceil(H / internal_step) equal sub-steps, and further at the instants at which a clock
is due (frame tick, delayed edge), because a jump inside a Runge-Kutta step costs four
digits.  In a sub-step

1. *held* lines run if the sub-step begins with news (new inputs or a due clock): whatever
   depends on inputs and clocks only is constant until the next cut;
2. *stage* lines are evaluated at five points: 0 at the start (skipped without news, since
   point 4 of the sub-step before was the same point), 1 to 3 for the classical
   Runge-Kutta method, 4 at the end, after the projection (standstill, end stops);
3. a sub-step in which a mode changes is thrown away and halved, down to 1/128 of the
   internal step, so that a jump of the right-hand side costs no accuracy either; every
   throw takes a credit that four kept sub-steps earn, or sliding along a jump would
   never end;
4. the four slopes tell the error of the sub-step: with z = 2 |k3 - k2| / |k2 - k1|, which for the
   fastest motion is its rate times the sub-step, it is dt |k3 - k2| z^2 / 30, that is z^5 / 120
   of the motion; norms are over the states in full scales.  A sub-step with an error above
   1e-5 dt / internal_step is thrown away and halved, down to 1/128 of the internal step as
   well but not below 0.5 us, and doubled again when its error has fallen so far that this is
   safe.  So the sub-steps follow the fastest motion, in its transient as at rest, and where
   the internal step is short enough nothing changes.  If the shortest sub-step is useless, the
   run ends with a code, and so it does where an effect shortens the internal step below 0.5 us;
5. memories are committed at points 0 and 4 only.

Events within ``1e-6 internal_step`` of a communication point belong to the step that
starts there, so rounding in a master's clock cannot delay a sample by a frame.
Sources: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.1 (method)
and II.6 (discontinuities); II, IV.2 (the rate from differences of slopes).
"""

from __future__ import annotations

from collections.abc import Iterable

from servo_models.core.flat import Flat, kept
from servo_models.core.printer import Printer, indent

HEAD = (
    "import math as _math",
    "_abs, _int, _float, _len, _range = abs, int, float, len, range",
    "",
    "",
)
"""First lines of every text: what it takes from Python, under names that no author can give."""


def run_text(flat: Flat) -> str:
    """Print ``run(p, x, times, inputs, out, most) -> (code, row)``, all effects compiled in.

    ``p`` are the parameters, ``x`` the state (updated), ``times`` the communication
    points, ``inputs[row]`` is held from ``times[row]`` on, ``out[row]`` receives the
    outputs at ``times[row]``; ``most`` sub-steps may be made.  Code 0 is success, with the number
    of sub-steps in place of a row; 1 + i says that x[i] is not finite, past the states an output;
    ``flat.too_fast`` that the shortest sub-step is too long, and x[0] which internal step would do,
    0 for none; ``flat.too_long`` that ``most`` are not enough; -1 - k that fault k was raised, at
    ``row``; ``x`` is of no use then.
    """
    text = Printer(flat, dropped=set(), guarded=True)
    rows = [
        "_before = _row - 1 if _row > 0 else 0",
        "_t = _times[_before]",
        "_size = _times[_row] - _t",
        *(f"{kept('in', name)} = _inputs[_before, {i}]" for i, name in enumerate(flat.inputs)),
        *text.communication_step(unrolled=False, row="_row"),
        *(f"_out[_row, {i}] = {name}" for i, name in enumerate(flat.outputs)),
        *text.checks("_row"),
    ]
    body = [
        f"_ahead = _np.zeros({len(flat.memory)})",
        *text.unpack(),
        *text.load(),
        "_spent = 0.0",
        "for _row in _range(0, _len(_times)):",
        *indent(text.placed(rows)),
        *text.store(),
        "return 0, _int(_spent)",
    ]
    head = [
        "import numpy as _np",
        *HEAD,
        "def run(_p, _x, _times, _inputs, _out, _most=_math.inf):",
    ]
    return "\n".join([*head, *indent(body), ""])


def step_text(flat: Flat, dropped: Iterable[str] = (), guarded: bool = False) -> str:
    """Print ``make(p) -> (start, step)`` in plain Python, without the ``dropped`` effects.

    ``start()`` returns the state at rest; ``step(x, u, t, size)`` advances ``x`` in place
    and returns ``(code, outputs)``, with the codes of ``run_text``.  A size of 0 only
    evaluates the outputs.  ``step.internal_step`` is what effects make of it.  ``guarded``
    text asks at run time which effects are on; it is what ``c_text`` writes in C.
    """
    text = Printer(flat, dropped=set(dropped), guarded=guarded)
    step = [
        *([f"_ahead = [0.0] * {len(flat.memory)}"] if guarded else []),
        *text.load(),
        *(f"{kept('in', name)} = _u[{i}]" for i, name in enumerate(flat.inputs)),
        *text.communication_step(unrolled=not guarded, row="None"),
        *text.store(),
        *text.checks("None"),
        f"return 0, [{', '.join(flat.outputs)}]",
    ]
    start = f"return [{', '.join(text.start_values())}] + [0.0] * {text.queue_length()}"
    body = [
        *text.unpack(),
        "def _start():",
        *indent([start]),
        "def _step(_x, _u, _t, _size):",
        *indent(text.placed(step)),
        "_step.internal_step = internal_step",
        "return _start, _step",
    ]
    return "\n".join([*HEAD, "def make(_p):", *indent(body), ""])


def start_text(flat: Flat) -> str:
    """Print ``make(p) -> x``: the state at rest without its queues, in plain Python."""
    text = Printer(flat, dropped=set(), guarded=False)
    body = [*text.unpack(), f"return [{', '.join(text.start_values())}]"]
    return "\n".join([*HEAD, "def make(_p):", *indent(body), ""])
