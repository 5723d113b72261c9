"""The characteristic of an effect, as textbooks draw it: output over input, or force over speed.

The block of the effect runs alone, on a slow sweep there and back.  An effect that counts time, or
that rewrites what is constant in a run, has none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from servo_models.core.block import RESERVED, Block
from servo_models.core.plant import Plant, Wire
from servo_models.core.types import Array

FRICTION = "friction"  # wire of ``actuators/shaft.py``: level of the friction
SPEED = "shaft_speed"  # wire of ``actuators/shaft.py``: speed that the friction acts against
SWEEP = np.interp(np.linspace(0.0, 5.0, 2001), [0.0, 1.0, 3.0, 5.0], [0.0, 1.0, -1.0, 1.0])
BEGIN = 400  # samples of the sweep that are left out: the way to its first end
REACHES = (1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 2.0)
"""Amplitudes of the sweep in full scales of the wire; the first that shows the shape is taken."""
VISIBLE = 0.15  # change of a signal over the sweep that shows the shape of an effect
SMALL = 1e-9  # change of a signal over the sweep below which it is rounding


@dataclass(frozen=True)
class Characteristic:
    """What an effect makes of a signal.

    Attributes:
        over: the signal that is swept.
        wire: on which the effect acts; the same one where its output depends on its input.
        given, found: values [SI] of shape (n,): of the signal, and of the wire as the effect leaves
            it.  Over another signal it is what the effect adds; friction has the sign of the speed.
    """

    over: Wire
    wire: Wire
    given: Array
    found: Array


def characteristic(plant: Plant, values: Mapping[str, float], name: str) -> Characteristic | None:
    """Return the characteristic of an effect as placed in a plant with all these ``values`` [SI],
    None for an effect that has none.

    Example:
        >>> import servo_models as sm
        >>> servo = sm.model("sg90", None, {"drive_dead_zone.half_width": "0.5 V"})
        >>> law = characteristic(servo.plant, servo.values, "drive_dead_zone")
        >>> bool(law.found[abs(law.given) < 0.49].any())
        False
    """
    link, constant = plant.main(name), _constants(plant, values)
    effect, wire, rubs = link.effect, plant.wire.get(link.on[0]), link.on[0] == FRICTION
    beside = {it: link.wire_of(it) for it in effect.wires if it not in effect.acts_on}
    moving = [it for it in beside.values() if it in plant.wire and it not in constant]
    known = {*moving, *constant}
    if effect.parts or {*effect.wires} & {*RESERVED} or not known >= {*beside.values()}:
        return None
    if wire is None or (wire.name in constant and not rubs):
        return None

    def rest(name: str) -> float:
        """Value of a wire at rest; for friction the full scale, as it may depend on the load."""
        if name in constant or name not in plant.wire:
            return constant[name]
        value = plant.wire[name].scale if rubs else plant.wire[name].rest
        return float(constant[value] if isinstance(value, str) else value)

    fixed = {**dict.fromkeys(effect.acts_on, 0.0), **{it: rest(on) for it, on in beside.items()}}
    fixed |= {key: values[f"{name}.{key}"] for key in effect.params}
    middle = 0.0 if rubs else rest(wire.name)
    rests = {"rest": middle, **constant}
    start = {
        key: rests[memory.start] if isinstance(memory.start, str) else memory.start
        for key, memory in effect.memory.items()
    }

    def swept(over: Wire, signal: Array) -> Characteristic:
        """The effect while one signal is swept: the one it acts on, or another that it reads."""
        arguments = [it for it in effect.wires if link.wire_of(it) == over.name]
        memory, changed = start, []
        for value in signal.tolist():
            at = {**fixed, effect.acts_on[0]: middle, **dict.fromkeys(arguments, value)}
            given = effect(**at, **memory)
            parts = given if isinstance(given, tuple) else (given,)
            memory = dict(zip(effect.memory, parts[len(effect.acts_on) :]))
            changed.append(parts[0] - (middle if over is not wire else 0.0))
        return Characteristic(over, wire, signal[BEGIN:], np.array(changed[BEGIN:]))

    if rubs:
        law = swept(plant.wire[SPEED], SWEEP * plant.wire[SPEED].scale)
        return replace(law, found=np.sign(law.given) * law.found)
    tried = [swept(wire, middle + SWEEP * reach * wire.scale) for reach in REACHES]
    shown = [float(np.ptp(it.found - it.given) / np.ptp(it.given)) for it in tried]
    if max(shown) > SMALL:
        visible = (it for it, part in zip(tried, shown) if part > VISIBLE)
        return next(visible, tried[np.argmax(shown)])
    if not moving:  # it adds a constant
        return tried[0]
    over = plant.wire[moving[0]]
    law = swept(over, rest(over.name) + SWEEP * over.scale)
    return law if np.ptp(law.found) else None


def _constants(plant: Plant, values: Mapping[str, float]) -> dict[str, float]:
    """Parameters of the plant [SI], and wires that depend on them alone, without effects."""
    known = {name: values[name] for name, it in plant.parameters.items() if not it.owner}
    for link in plant.chain:
        if isinstance(link, Block) and known.keys() >= {*link.wires}:
            given = link(**{it: known[it] for it in (*link.wires, *link.params)})
            known |= zip(link.gives, given if isinstance(given, tuple) else (given,))
    return known
