"""Nominal values from a simulator's own files, as a parameter file."""

from __future__ import annotations

from pathlib import Path

from servo_models.catalogue import actuators
from servo_models.core.plant import Actuator, check_bounds
from servo_models.data.parameters import Estimate, ParameterSet
from servo_models.errors import UserError, printable, told_at
from servo_models.files import read_regular
from servo_models.simulators import readers
from servo_models.simulators.simulator import Nominal
from servo_models.units import parse

LONGEST = 100  # characters of a value's origin at most: it may hold names of a foreign file


def import_nominal(file: str, inertia: float | str = 0.0) -> ParameterSet:
    """Return the values of an actuator in a simulator's file, as parameters of ours.

    Args:
        file: ``FILE`` or ``FILE#JOINT``; joint, actuator or group is needed where it has several.
        inertia: inertia that the joint carries beside that of the file, in kg m^2 or with a unit.

    Raises:
        UserError: a file of no known kind, without that joint, or with what our model cannot have.

    Example:
        >>> from pathlib import Path
        >>> import servo_models as sm
        >>> _ = Path("plane.parm").write_text("SIM_SERVO_SPEED 0.1")
        >>> sm.import_nominal("plane.parm").settings()["command_lag.time_constant"]
        0.1
    """
    name, _, joint = file.partition("#")
    path = Path(name)
    content = read_regular(path)
    kind = _kind(path, content)
    carried = parse(inertia, "kg.m2")
    if carried < 0.0:
        raise UserError(f"inertia = {carried:g} kg.m2: give one of 0 or more")
    with told_at(f"'{path}'"):
        reading = readers()[kind].read(content, joint, carried)
        actuator, variant = _target(reading)
        plant = actuator.plant_of(variant)
        for parameter, (value, _) in reading.values.items():
            check_bounds(plant.parameters[parameter], value)
    estimates = tuple(
        Estimate(parameter, value, None, printable(origin, LONGEST))
        for parameter, (value, origin) in reading.values.items()
    )
    warnings = reading.warnings
    if reading.variant not in ("", variant):
        which = printable(reading.variant, LONGEST)
        warnings += (
            f"of '{which}' we have no variant: what the file does not say is of '{variant}'; give"
            " such parameters an uncertainty, or values, in the description",
        )
    method = f"read from '{path.name}', a file of {readers()[kind].title}"
    return ParameterSet(actuator.key, variant, estimates, method=method, warnings=warnings)


def _kind(path: Path, content: bytes) -> str:
    """The reader for this file: by the suffix, and by a mark where several have that suffix."""
    by_suffix = [name for name, it in readers().items() if path.suffix.lower() in it.suffixes]
    marked = [name for name in by_suffix if readers()[name].mark in content]
    if not by_suffix:
        known = sorted({end for it in readers().values() for end in it.suffixes})
        raise UserError(f"'{path}' is of no known kind: its name may end in {', '.join(known)}")
    return (marked or by_suffix)[0]


def _target(reading: Nominal) -> tuple[Actuator, str]:
    """The actuator that has all parameters that were read, and the variant with its command.

    Variants differ in size: of those whose bounds hold the values the one that is named is taken,
    else the first; where none does, the last.
    """
    fitting = []
    for actuator in actuators().values():
        for variant in actuator.variants:
            plant = actuator.plant_of(variant.name)
            command = plant.wire[actuator.step_of(variant.name)[0]]
            if command.unit == reading.command and reading.values.keys() <= plant.parameters.keys():
                holds = all(
                    plant.parameters[name].param.low <= value <= plant.parameters[name].param.high
                    for name, (value, _) in reading.values.items()
                )
                fitting.append((holds, actuator, variant.name))
    if not fitting:
        raise UserError("no actuator of the catalogue has all of its parameters")
    within = [it for it in fitting if it[0]] or fitting[-1:]
    return next((it for it in within if it[2] == reading.variant), within[0])[1:]
