"""Who obeys comes nearer to the truth: every piece of advice that changes a description, on a rig
with a flaw."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from servo_models.catalogue import model
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.identification.check import check
from servo_models.identification.identify import identify
from tests.support.logs import changed

ROWS, STEP, NOISE = 1200, 5e-3, 2e-3
Columns = dict[str, Array]
Keys = dict[str, dict[str, str]]


@dataclass(frozen=True)
class Subject:
    """An actuator with its columns, the first output a position, and how far its rigs are off."""

    nominal: Model
    columns: Mapping[str, str]
    reach: float
    off: Mapping[str, float]

    @property
    def true(self) -> Model:
        values = self.nominal.values
        return changed(self.nominal, {name: by * values[name] for name, by in self.off.items()})


MOTOR = Subject(
    model("dc_motor_speed", "direct"),
    {"time": "s", "speed_command": "rad/s", "encoder_angle": "rad", "current": "A"},
    300.0,
    {"rotor_inertia": 1.12, "speed_gain": 0.93, "integral_time": 1.08},
)
SERVO = Subject(
    model("second_order_servo", "bus"),
    {"time": "s", "goal": "rad", "angle_reading": "rad"},
    0.6,
    {"natural_frequency": 1.12, "damping_ratio": 0.93},
)


LOOP = Subject(  # which knows the product of its gains, and one of them
    model("sg90", "linear"),
    {"time": "s", "pulse_width": "s", "angle_reading": "rad"},
    3e-4,
    {"motor_gain": 1.15, "amplifier_gain": 1.0},
)
NOTHING_KNOWN = dict.fromkeys(LOOP.off, "")


def times(**factors: float) -> Callable[[Columns], Columns]:
    return lambda file: file | {name: size * file[name] for name, size in factors.items()}


def plus(size: float) -> Callable[[Columns], Columns]:
    return lambda file: file | {"angle_reading": file["angle_reading"] + size}


def without_readings(file: Columns) -> Columns:
    angle = file["angle_reading"].copy()
    for row in range(300, 1000, 70):
        angle[row : row + 3] = -999.0
    return file | {"angle_reading": angle}


def dead(file: Columns) -> Columns:
    angle = file["angle_reading"].copy()
    angle[800:] = angle[800]
    return file | {"angle_reading": angle}


def in_motion(file: Columns) -> Columns:
    return {name: values[634:] for name, values in file.items()}


@dataclass(frozen=True)
class Rig:
    """A rig with a flaw.

    Attributes:
        said: the key that the advice changes.
        spoilt: what became of the columns of the file, which were in SI.
        told: keys of the description by column, and of ``log``, ``free`` and ``uncertainty``.
        after, late: when the last output was read [s].
    """

    said: str
    spoilt: Callable[[Columns], Columns] = dict
    told: Mapping[str, dict[str, str]] = field(default_factory=dict)
    subject: Subject = SERVO
    after: float | None = None
    late: float = 0.0


def motor(said: str, told: dict[str, str] | None = None, **when: float) -> Rig:
    return Rig(said, told={"current": told or {}}, subject=MOTOR, **when)


RIGS = {
    "goal in degrees": Rig("unit", times(goal=180.0 / math.pi)),
    "angle in degrees": Rig("unit", times(angle_reading=180.0 / math.pi)),
    "both in degrees": Rig("unit", times(goal=180.0 / math.pi, angle_reading=180.0 / math.pi)),
    "time in ms": Rig("unit", times(time=1e3)),
    "angle in counts": Rig("scale", times(angle_reading=3e4)),
    "angle turned": Rig("sign", times(angle_reading=-1.0)),
    "said to be turned": Rig("sign", told={"angle_reading": {"sign": "-1"}}),
    "another zero": Rig("offset", plus(0.9)),
    "another zero beside one": Rig("offset", plus(0.8), {"angle_reading": {"offset": "0.1"}}),
    "-999 for no reading": Rig("missing", without_readings),
    "-999 in counts": Rig(
        "missing",
        lambda file: without_readings(times(angle_reading=100.0)(file)),
        {"angle_reading": {"scale": "0.01"}},
    ),
    "a sensor that died": Rig("window", dead),
    "begins elsewhere": Rig("start", in_motion, {"log": {"start": '"rest"'}}),
    "a prior of 20 times": Rig(
        "uncertainty", told={"uncertainty": {"rotor_inertia": '"20 kg.m2"'}}, subject=MOTOR
    ),
    "after its command": motor("after_command", after=0.0),
    "later in its row": motor("after_command", after=2e-3),
    "said to be after": motor("after_command", {"after_command": "0"}),
    "late": motor("shift", late=15e-3),
    "late by a part of a row": motor("shift", late=13e-3),
    "late, and half of it said": motor("shift", {"shift": '"-10 ms"'}, late=20e-3),
    "said to be late": motor("shift", {"shift": '"-20 ms"'}),
    "two that are one": Rig(
        "free", told={"uncertainty": dict.fromkeys(LOOP.off, "")}, subject=LOOP
    ),
}


def record(rig: Rig) -> Columns:
    """Columns in SI; rows are doubled, so that the second one has its command."""
    random, true = np.random.default_rng(7), rig.subject.true
    rows = np.round(STEP * np.arange(ROWS), 9)
    command = np.repeat(rig.subject.reach * random.uniform(-1.0, 1.0, ROWS // 30), 30)
    command[:30] = 0.0
    command += float(true.plant.wire[list(rig.subject.columns)[1]].rest)
    instants = np.round(np.maximum(rows - rig.late, 0.0) + (rig.after or 0.0), 9)
    grid = np.union1d(rows, instants)
    _, main, *outputs = rig.subject.columns
    inputs = np.tile([float(wire.rest) for wire in true.plant.inputs], (2 * len(grid), 1))
    held = command[np.searchsorted(rows, grid, side="right") - 1]
    inputs[:, [wire.name for wire in true.plant.inputs].index(main)] = np.repeat(held, 2)
    ran = dict(zip(true.plant.outputs, true.run(np.repeat(grid, 2), inputs).T))
    read = {name: ran[name][::2][np.searchsorted(grid, rows)] for name in outputs}
    last = ran[outputs[-1]][int(rig.after is not None) :: 2]
    read[outputs[-1]] = last[np.searchsorted(grid, instants)]
    noisy = [it + NOISE * np.std(it) * random.standard_normal(ROWS) for it in read.values()]
    return dict(zip(rig.subject.columns, (rows, command, *noisy)))


def written(folder: Path, rig: Rig, keys: Keys) -> Path:
    """The description, with a file of the spoilt columns beside it."""
    file = rig.spoilt(record(rig))
    table = np.column_stack(list(file.values()))
    np.savetxt(folder / "log.csv", table, "%.9g", ",", header=",".join(file), comments="")
    columns = {
        name: ", ".join([f'column = "{name}"', *(f"{k} = {v}" for k, v in keys[name].items())])
        for name in file
    }
    time, main, *outputs = file
    lines = [
        f'actuator = "{rig.subject.nominal.actuator.name}"',
        f'variant = "{rig.subject.nominal.variant}"',
        f"free = [{', '.join(repr(it) for it in keys['free'])}]",
        "[uncertainty]",
        *(f"{name} = {size}" for name, size in keys["uncertainty"].items() if size),
        *("[[logs]]", 'file = "log.csv"', f"time = {{ {columns[time]} }}"),
        f"inputs.{main} = {{ {columns[main]} }}",
        *(f"outputs.{it} = {{ {columns[it]} }}" for it in outputs),
        *(f"{key} = {value}" for key, value in keys["log"].items()),
    ]
    path = folder / "rig.toml"
    path.write_text("\n".join(lines))
    return path


def keys_of(rig: Rig) -> Keys:
    keys: Keys = {name: {"unit": f'"{unit}"'} for name, unit in rig.subject.columns.items()}
    off = rig.subject.off
    keys |= {"log": {}, "free": dict.fromkeys(off, ""), "uncertainty": dict.fromkeys(off, '"20 %"')}
    for table, told in rig.told.items():
        keys[table] |= told
    return keys


def said(path: Path) -> tuple[str, ...]:
    """What ``check`` and ``identify`` say."""
    told: list[str] = []
    for ask in (lambda: check(path, jobs=1).warnings, lambda: identify(path, jobs=1).doubts):
        try:
            told += ask()
        except UserError as error:
            told.append(str(error))
    return tuple(told)


def obeyed(texts: tuple[str, ...], keys: Keys, rows: Array) -> tuple[str, Keys]:
    """The first key that a sentence with a cure changes, and all keys as it says."""
    keys = deepcopy(keys)
    for text in texts:
        given = re.split(r"(?:give (?:it|them)|write) ", text, maxsplit=1)
        columns = re.findall(r"column '(\w+)'|'(\w+)' reads", given[0])
        if "or else" in (cures := given[-1]):
            cures = cures.partition("or else")[0]
        pairs = re.findall(r"(?:^| and )(?:time\.)?(\w+) = (\"[^\"]+\"|[-\d.e+]*\d)", cures)
        if len(given) > 1 and columns and pairs:
            for column in (one or other for one, other in columns):
                keys[column] |= dict(pairs)
            return pairs[0][0], keys
        if found := re.search(r"column '(\w+)' .*leave out its (\w+)", text):
            del keys[found[1]][found[2]]
            return found[2], keys
        if found := re.search(r"from row (\d+) on.*end the log before", text):
            keys["log"]["window"] = f'["0 s", "{rows[int(found[1]) - 2]} s"]'
            return "window", keys
        if "correct 'start', or leave it out" in text:
            del keys["log"]["start"]
            return "start", keys
        if found := re.search(r"\[uncertainty\] (\w+) .*write a share such as (\"[^\"]+\")", text):
            keys["uncertainty"][found[1]] = found[2]
            return "uncertainty", keys
        if "fix one that you know" in text:
            del keys["free"][next(it for it in re.findall(r"'(\w+)'", text) if known(it))]
            return "free", keys
    return "", keys


def known(name: str) -> bool:
    return all(it.off.get(name, 1.0) == 1.0 for it in (MOTOR, SERVO, LOOP))


def distance(path: Path, rig: Rig) -> float:
    """How far identified values are from the true ones, mean of |ln|; infinite for none."""
    true = rig.subject.true.values
    try:
        estimates = identify(path, jobs=1).parameters.estimates
    except UserError:
        return math.inf
    found = true | {it.name: max(it.value, 1e-30) for it in estimates}
    free = keys_of(rig)["free"]
    return float(np.mean([abs(math.log(found[it] / true[it])) for it in free]))


@pytest.mark.long
@pytest.mark.parametrize("name", RIGS)
def test_who_obeys_comes_nearer_to_the_truth(name: str, tmp_path: Path) -> None:
    rig = RIGS[name]
    keys = keys_of(rig)
    path = written(tmp_path, rig, keys)
    before, texts = distance(path, rig), said(path)
    key, cured = obeyed(texts, keys, record(rig)["time"])
    assert key == rig.said, texts
    after = distance(written(tmp_path, rig, cured), rig)
    assert after < min(0.5 * before, 0.01), (before, after, cured)


@pytest.mark.long
@pytest.mark.parametrize("subject", [MOTOR, SERVO])
def test_a_rig_without_a_flaw_is_given_no_advice(subject: Subject, tmp_path: Path) -> None:
    rig = Rig("", subject=subject)
    path = written(tmp_path, rig, keys_of(rig))
    assert obeyed(said(path), keys_of(rig), record(rig)["time"])[0] == ""
    assert distance(path, rig) < 0.01
