"""BAM: parameter files of Better Actuator Models, which are those of a smart servo.

Source: Duclusaud et al., Extended friction models for the physics simulation of servo actuators,
2025; Rhoban/bam, bam/model.py, bam/actuator.py; isaaclab.actuators bam_model.py (firmware constants
in the same file).
"""

from __future__ import annotations

import json

from servo_models.errors import UserError
from servo_models.simulators.reading import TRANSPORT_DELAY, Values, numbers
from servo_models.simulators.simulator import Nominal, Reader

FULL_SPEED = 10.0  # rad/s, full speed in the friction parameters of our smart servo
STRIBECK = ("m2", "m4", "m5", "m6")
LOAD_DEPENDENT = ("m3", "m4", "m5", "m6")
KEYS = {
    "kt": ("torque_constant", 1.0),
    "R": ("resistance", 1.0),
    "armature": ("inertia", 1.0),
    "kp": ("gain", 1.0),
    "error_gain": ("loop_factor", 1.0),
    "max_pwm": ("duty_limit", 1.0),
    "max_current": ("current_limit.limit", 1.0),
    "friction_base": ("coulomb_friction.level", 1.0),
    "friction_viscous": ("viscous_friction.torque", FULL_SPEED),
    "command_delay": (TRANSPORT_DELAY, 1.0),
}
OF_STRIBECK = {
    "friction_stribeck": ("stribeck_friction.excess", 1.0),
    "dtheta_stribeck": ("stribeck_friction.speed", 1.0 / FULL_SPEED),
}
NEEDED = ("kt", "R", "armature")


def read(content: bytes, joint: str, inertia: float) -> Nominal:
    """The motor of a file; its load friction is that at balance of motor and load."""
    try:
        told = json.loads(content)
        missing = [key for key in ("model", *NEEDED) if key not in told]
    except (ValueError, TypeError, RecursionError) as error:
        raise UserError(f"no JSON of BAM: {error}") from error
    if missing or not isinstance(told, dict):
        raise UserError(f"it has no {', '.join(missing) or 'keys'}: give what bam.fit wrote")
    model = str(told["model"])

    def value(key: str) -> float:
        return numbers(str(told.get(key, 0.0)), 1, key)[0]

    keys = {**KEYS, **(OF_STRIBECK if model in STRIBECK else {})}
    values: Values = {
        parameter: (factor * value(key), f"{key} of BAM")
        for key, (parameter, factor) in keys.items()
        if told.get(key) is not None
    }
    values["inertia"] = (value("armature") + inertia, "armature of BAM, and --inertia")
    if model in LOAD_DEPENDENT:
        share = 2.0 * value("load_friction_base")
        share += value("load_friction_motor") + value("load_friction_external")
        values["load_friction.coefficient"] = (share, "load_friction of BAM, motor and load alike")
    supply = f"vin = {value('vin'):g} V" if "vin" in told else "vin"
    warnings = [f"{supply} of BAM is an input of ours: state it as a constant of the logs"]
    if model in STRIBECK and "alpha" in told:
        warnings.append(f"alpha = {value('alpha'):g} of BAM is 2 in ours")
    return Nominal(values, warnings=tuple(warnings), variant=str(told.get("actuator", "")))


READER = Reader("BAM", (".json",), b"kt", read)
