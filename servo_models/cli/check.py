"""servo-models check"""

from __future__ import annotations

import os.path
from pathlib import Path

from servo_models.errors import UserError


def check(
    file: Path,
    init: bool = False,
    out: Path | None = None,
    actuator: str | None = None,
    trust: bool = False,
    largest: int | None = None,
) -> int:
    """Check logs: sampling, readings, noise floor, and what they can and cannot determine.

    Exit code 0: usable, 1: usable with the warnings printed, 2: could not run.
    With --init also 1 where the description has to be completed, or a column
    of measurements or a joint cannot be used.  A LeRobot data set, a
    ROS 2 bag with joints or a log with a table for each of several servos
    gives a description for each.

    Examples:

    servo-models check log.csv --init --actuator torque_motor

    servo-models check log.toml

    servo-models check my_data_set --init
    """
    from servo_models.data.description import check_is_description, read_description
    from servo_models.data.joints.drafts import recording, write_joints
    from servo_models.data.readers import is_bag

    found_joints = recording(file, actuator) if init else None
    if found_joints:
        faults = False
        for text, is_fault in write_joints(found_joints, out, actuator, trust):
            print(f"Warning: {text}" if is_fault else text)
            faults |= is_fault
        return 1 if faults else 0
    if init and os.path.isdir(file) and not is_bag(file):  # False for a name that is too long
        check_is_description(file)
    if init:
        return _init(file, out, actuator, trust)
    if out or actuator:
        raise UserError("--out and --actuator say how a description is begun: add --init")
    check_is_description(file)
    from servo_models.cli.console import progress, show
    from servo_models.identification.check import check as run

    with progress("checking"):
        result = run(read_description(file, trust))
    show(result.report())
    return 1 if result.warnings else 0


def _init(file: Path, out: Path | None, actuator: str | None, trust: bool) -> int:
    from servo_models.data.description import read_description
    from servo_models.data.joints.drafts import files_of
    from servo_models.data.scaffold import drafts, write_draft

    path = out or file.with_suffix(".toml")
    if path.is_dir():
        path /= f"{file.stem}.toml"
    made = files_of(drafts(file, actuator), path)
    for path, one in made.items():
        write_draft(one, path)
        print(
            f"wrote '{path}': look at the lines marked 'guessed', then 'servo-models check {path}'"
        )
    for text in dict.fromkeys(text for one in made.values() for text in one.not_used):
        print(text)
    warnings = dict.fromkeys(text for one in made.values() for text in one.warnings)
    for text in warnings:
        print(f"Warning: {text}")
    code = 1 if warnings else 0
    for path in made:
        try:
            read_description(path, trust)
        except UserError as error:
            print(f"It has to be completed first: {error}")
            code = 1
    return code
