"""Begin a description for each joint of a robot's recording: a command beside its reading."""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from servo_models.catalogue import actuators, of_one_variant
from servo_models.core.own_actuator import key_from
from servo_models.core.plant import Actuator, Variant, Wire
from servo_models.data.description import read_description
from servo_models.data.joints.bags import OF_TOPICS, bag
from servo_models.data.joints.data_sets import data_set
from servo_models.data.joints.recording import Joint, Recording
from servo_models.data.lag import lags
from servo_models.data.readers import is_bag
from servo_models.data.readers.lerobot import episodes, is_data_set
from servo_models.data.scaffold import CHECK, LONGEST_SENTENCE, READING, Draft, is_servo
from servo_models.data.schema import quoted
from servo_models.errors import UserError, printable
from servo_models.files import write_whole
from servo_models.units import exponents

STILL = "its command never moves"
NO_GOAL = ": if its command is no angle to go to, such as a step or a rate, name another column"


def recording(path: Path, actuator: str | None) -> Recording | None:
    """Return the joints of a robot's recording, None for a log of something else.

    A bag without joints is one if somebody says which ``actuator`` made it.
    """
    if is_data_set(path) or episodes(path):
        recorded = data_set(path)
    elif is_bag(path) or path.suffix.lower() in OF_TOPICS:
        recorded = bag(path)
        if not recorded.joints and (actuator or not recorded.left_out):
            return None
    else:
        return None
    if not recorded.joints:
        raise UserError(
            f"'{path}' has no joint with a command and a reading: {'; '.join(recorded.left_out)}"
        )
    return recorded


def write_joints(
    recorded: Recording, folder: Path | None, actuator: str | None, trust: bool, keep: bool = False
) -> Iterator[tuple[str, bool]]:
    """Write a description for each joint, and yield what is to be told, and whether it is a fault.

    Args:
        found: the recording.
        folder: folder to write into; None for that of the recording, with its name in front.
        actuator: what all joints are, as of ``of_one_variant``; None for a general one.
        keep: descriptions that are there stay as they are.

    Raises:
        UserError: a file that is there already, without ``keep``, an actuator without a goal, or
            no joint whose description can be read.
    """
    path = recorded.path
    chosen, variant = _chosen(actuator)
    whole = path.resolve()
    stem = "" if folder else f"{whole.stem if whole.is_file() else whole.name}_"
    place = folder or path.parent if path.name else whole.parent
    files: dict[Path, Joint] = {}
    for joint in recorded.joints:
        files[_free(place, stem + as_file(joint.name), files)] = joint
    kept = [file for file in files if os.path.exists(file)]
    if kept and not keep:
        raise UserError(f"'{kept[0]}' exists: edit it, remove it, or name a folder with --out")
    written = len(kept)
    for file, joint in files.items():
        if file in kept:
            continue
        write_whole(
            file, _text(recorded, joint, chosen, variant, bool(actuator), file.parent).encode()
        )
        try:
            description = read_description(file, trust)
        except UserError as error:
            file.unlink()
            yield f"{_told(joint.name)}: no description, since {error}", True
            continue
        written += 1
        plant = description.model.plant
        found_lags = list(lags(description.logs, plant))
        said = "; ".join(lag.sentence(plant.wire[lag.output]) for lag in found_lags)
        follows = bool(found_lags) and all(lag.follows for lag in found_lags)
        yield f"wrote '{file}': {said or STILL}{'' if follows else NO_GOAL}", not follows
    if not written:
        raise UserError(f"'{path}' has no joint that can be described: correct what is said above")
    doubts = dict.fromkeys(f"guessed, {it.guessed}: {it.doubt}" for it in files.values())
    for text in (*recorded.notes, *doubts):
        yield printable(text, LONGEST_SENTENCE), False
    for text in recorded.left_out:
        yield printable(text, LONGEST_SENTENCE), True


def _told(name: str) -> str:
    return printable(name, 60)


def as_file(name: str) -> str:
    """Return a name as one of a file on every system: some count its bytes."""
    whole = re.sub(r"[^\w.-]+", "_", unicodedata.normalize("NFC", name))
    return whole.encode()[:60].decode(errors="ignore").strip("._") or "joint"


def files_of(made: Sequence[Draft], path: Path) -> dict[Path, Draft]:
    """Return the drafts of a log by their files: ``path``, for several with the table of each."""
    files: dict[Path, Draft] = {}
    for one in made:
        several = _free(path.parent, as_file(f"{path.stem}_{one.table}"), files)
        files[path if len(made) == 1 else several] = one
    return files


def _free(folder: Path, stem: str, taken: Iterable[Path]) -> Path:
    """A file that is none of those ``taken``, on systems too that tell no capitals apart."""
    used = {file.name.casefold() for file in taken}
    more = ("", *(f"_{n}" for n in range(2, len(used) + 3)))
    return next(folder / name for it in more if (name := f"{stem}{it}.toml").casefold() not in used)


def _chosen(name: str | None) -> tuple[Actuator, Variant]:
    """An actuator, by default a general one, and its first variant that takes an angle as goal."""
    takers = _servos()
    chosen = of_one_variant(name) if name else next(it for it in takers if it.general)
    variants = _with_a_goal(chosen)
    if not variants:
        names = " or ".join(it.name for it in takers)
        raise UserError(f"{chosen.name} takes no angle as its goal: give --actuator {names}")
    return chosen, variants[0]


def _servos() -> list[Actuator]:
    """Servos of the catalogue that take an angle as goal."""
    return [it for it in actuators().values() if is_servo(it) and _with_a_goal(it)]


def _with_a_goal(actuator: Actuator) -> list[Variant]:
    """The variants of an actuator that take an angle as goal."""

    def goal(it: Variant) -> Wire:
        return actuator.plant_of(it.name).wire[actuator.step_of(it.name)[0]]

    return [it for it in actuator.variants if exponents(goal(it).unit) == exponents("rad")]


def _doubt(others: Iterable[str]) -> str:
    """What else an actuator or a variant may be, as a comment."""
    named = ", ".join(others)
    return f"  {CHECK}; there is also {named}" if named else ""


def _text(
    recorded: Recording, joint: Joint, chosen: Actuator, variant: Variant, given: bool, folder: Path
) -> str:
    """A description of a joint, to stand in ``folder``; its actuator is ``given`` or guessed."""
    plant = chosen.plant_of(variant.name)
    output = READING if READING in plant.outputs else plant.outputs[0]
    goal, _ = chosen.step_of(variant.name)
    file = quoted(Path(os.path.relpath(recorded.path.resolve(), folder.resolve())).as_posix())
    takers = (it.name for it in _servos() if it is not chosen)
    others = (it.name for it in _with_a_goal(chosen) if it is not variant)
    guessed = f"  {CHECK}: {joint.guessed}"
    lines = [
        f"# Joint {_told(joint.name)}. Lines marked 'guessed' are to be checked.",
        f"actuator = {quoted(key_from(chosen, folder))}{'' if given else _doubt(takers)}",
        f"variant = {quoted(variant.name)}{_doubt(others)}",
        "",
        "[[logs]]",
        f"file = {file}",
        *joint.log,
        *(f"# {printable(text, LONGEST_SENTENCE)}" for text in recorded.notes),
        f"# guessed, {joint.guessed}: {printable(joint.doubt, LONGEST_SENTENCE)}",
        f"inputs.{goal} = {{ {joint.command}, {joint.unit} }}{guessed}",
        f"outputs.{output} = {{ {joint.reading}, {joint.unit} }}{guessed}",
        *joint.runs,
    ]
    return "\n".join(lines) + "\n"
