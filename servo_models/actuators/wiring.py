"""What plants with a shaft declare alike: states of a turning mass, a sensor outside the loop.

The blocks of a shaft are in ``shaft.py``.
"""

from __future__ import annotations

from dataclasses import replace

from servo_models.actuators.shaft import no_residual
from servo_models.core.block import UNLOADED, Bench, Block
from servo_models.core.plant import Placement, State, Wire, place
from servo_models.effects import effects_on
from servo_models.effects.gain_error import gain_error
from servo_models.effects.residual_map import CURVES, time_since_reversal

RESIDUAL_MAP = "residual_map"
UNKNOWN_SCALE = {"error": {"low": -2.0, "high": 9.0}}  # bounds: from the other sign to ten times
WEIGHT = "hang a known weight on the shaft that pulls"
LOADS = (
    UNLOADED,
    Bench(f"{WEIGHT} against positive motion", 180.0, 0.25),
    Bench(f"{WEIGHT} with positive motion", 180.0, -0.25),
)
"""Loads of a shaft that a person can set."""
CALIBRATED = Bench("calibrate the sensor of the output in a jig", 600.0)
BENCH_DRIVE = Bench("drive it from a laboratory amplifier whose output you have measured", 900.0)
WEAK_SUPPLY = (Bench("lower the supply", 60.0, 0.7),)
TRACKED = (Bench("track the angle of the output from outside", 900.0, 0.002),)
GYRO = (Bench("glue a gyro to the output", 600.0, 0.01),)
AMMETER = (Bench("measure the current of the motor by a shunt or its driver", 300.0, 0.01),)
REPORTED = (Bench("record what the servo reports of itself", 60.0, 0.005),)
"""How a person measures what most logs have not."""
LEARNT = (
    Wire("residual", "1", "curves of the residual map, over its sizes"),
    Wire("since_reversal", "s", "time since the motion turned, negative while it is"),
)
"""Wires of the residual map."""


def turning(
    which: str,
    rate: str,
    acceleration: str,
    scales: tuple[float, float],
    owner: str = "",
    mass: str = "",
) -> tuple[State, State]:
    """Return angle and speed of one mass as states, with full scales [rad] and [rad/s].

    Their names begin with ``which``; ``mass`` names the body in words.
    """
    of = mass or which
    angle = Wire(f"{which}_angle", "rad", f"angle of the {of}", scales[0], display="deg")
    speed = Wire(f"{which}_speed", "rad/s", f"speed of the {of}", scales[1])
    return State(angle, rate, owner=owner), State(speed, acceleration, owner=owner)


def input_scale(name: str, wire: str) -> Placement:
    """Return the place of a scale error of an input's column."""
    return place(name, gain_error, wire, params=UNKNOWN_SCALE)


def outside_sensor(name: str, wire: str) -> tuple[Placement, ...]:
    """Return the effects of a sensor outside the loop on its reading of the shaft."""
    lag, offset, codes = effects_on(
        wire, *(f"{name}_{it}" for it in ("lag", "offset", "quantisation"))
    )
    gain = place(f"{name}_gain", gain_error, wire)
    return (lag, *without(CALIBRATED, gain, offset), codes)


def without(bench: Bench, *placed: Placement) -> tuple[Placement, ...]:
    """Return effects of which a person makes sure on the bench that they are not there."""
    return tuple(replace(one, bench=(*one.bench, bench)) for one in placed)


def residual_curves(command: str, load: str = "load_torque") -> tuple[Block | Placement, ...]:
    """Return the curves of a residual map over the shaft's motion, the command and the load.

    They stand before the first wire on which the map acts.
    """
    wires = {
        "rate": "shaft_speed",
        "position": "shaft_angle",
        "command": command,
        "load": load,
        "reversal": "since_reversal",
    }
    return (
        no_residual,
        place(RESIDUAL_MAP, time_since_reversal, "since_reversal"),
        *(
            place(RESIDUAL_MAP, CURVES[key], "residual", regressor=wire)
            for key, wire in wires.items()
        ),
    )
