"""Log descriptions with faults: each is told in one line, with its place and its cure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from servo_models.data.description import read_description
from servo_models.errors import UserError, did_you_mean
from tests.support.descriptions import HEAD, LOG, TABLE, complaint, describe, text_of
from tests.support.own_actuators import SOURCE

CHANGED: list[tuple[str, str, list[str]]] = [
    ('"torque_motor"', '"torque_moto"', ["actuator", "did you mean 'torque_motor'"]),
    ('"measured"', '"measurd"', ["variant", "did you mean 'measured'"]),
    ("variant", "varaint", ["unknown key 'varaint'; did you mean 'variant'"]),
    (HEAD, "", ["actuator: missing"]),
    ('"measured"\n', '"measured"\nfree = ["mass"]\n', ["free", "'mass'"]),
    ('"measured"\n', '"measured\n', ["no TOML", "line 2"]),
    (LOG, "", ["logs: missing", "[[logs]]"]),
    (LOG, "logs = []\n", ["logs: has no table; add [[logs]], or remove the key"]),
    (HEAD, HEAD + "sweeps = 1\n", ["sweeps: no list; write for example [[sweeps]]"]),
    (HEAD, HEAD + "sweeps = [1]\n", ["sweeps: no list; write for example [[sweeps]]"]),
    (HEAD, HEAD + "elements = 1\n", ["elements: no table"]),
    (HEAD, HEAD + "elements = []\n", ["elements: no table"]),
    (
        HEAD,
        HEAD + 'method = "x"\n',
        ["method: 'x' is unknown; known: simulation, transfer_function"],
    ),
    (HEAD, 'params = ""\n', ["params: cannot read"]),
    (HEAD, 'params = "no.toml"\n', ["params: cannot read"]),
    (HEAD, 'params = "a\\u0000b"\n', ["params: cannot read"]),
    (HEAD, HEAD + "sweeps = []\n", ["sweeps: has no table; add [[sweeps]], or remove the key"]),
    (LOG, LOG + LOG, ["logs[2].name", "a second log 'log'"]),
    ("[[logs]]", "[logs]", ["logs: no list; write for example [[logs]]"]),
    ('file = "log.csv"', "", ["logs[1].file: missing"]),
    ('"log.csv"', '""', ["logs[1].file: no file"]),
    ('"log.csv"', "3", ["logs[1].file: no text"]),
    ('"log.csv"', '"runs/*.csv"', ["logs[1].file", "no file matches 'runs/*.csv'", "description"]),
    ('"log.csv"', '"absent.csv"', ["no file", "absent.csv"]),
    ('file = "log.csv"', 'file = "log.csv"\nnmae = "a"', ["logs[1].nmae", "'name'"]),
    ('file = "log.csv"', 'file = "log.csv"\nheader = 1', ["header", "true nor false"]),
    ('file = "log.csv"', 'file = "log.csv"\ntable = "a"', ["no table 'a'"]),
    ('time = { column = "time_ms", unit = "ms" }', "", ["logs[1].time: missing"]),
    ('column = "time_ms", ', "", ["logs[1].time.column: missing"]),
    ('"ms"', '"deg"', ["logs[1].time.unit", "'deg' does not convert to 's'"]),
    (
        'unit = "ms"',
        'unit = "ms", repeats = "x"',
        ["logs[1].time.repeats", "'x' is unknown", "drop"],
    ),
    ('"time_ms"', '"time"', ["log.csv' has no column 'time'; did you mean 'time_ms'"]),
    ("inputs.voltage", "inputs.volage", ["logs[1].inputs.volage", "'voltage'"]),
    ("outputs.angle", "outputs.angel", ["logs[1].outputs.angel", "did you mean 'angle'"]),
    ("outputs.angle", "outputs.anlge", ["outputs.anlge", "did you mean 'angle'"]),
    ("outputs.angle", "outputs.humidity", ["outputs.humidity", "known: angle, rate, current"]),
    ("outputs.angle", "outputs.rate", ["rate.unit", "'deg' does not convert to 'rad/s'"]),
    ('outputs.angle = { column = "angle_deg", unit = "deg" }', "", ["outputs: missing"]),
    ('unit = "deg"', 'unit = "V"', ["outputs.angle.unit", "'V' does not convert to 'rad'"]),
    ('unit = "deg"', 'unit = "dge"', ["outputs.angle.unit", "unknown unit 'dge'"]),
    ('unit = "deg"', 'unti = "deg"', ["outputs.angle.unti", "did you mean 'unit'"]),
    ('unit = "deg"', "scale = 0", ["outputs.angle.scale"]),
    ('unit = "deg"', "sign = 2", ["outputs.angle.sign", "1 or -1"]),
    ('unit = "deg"', 'offset = "1 V"', ["outputs.angle.offset", "'V' does not convert"]),
    ('unit = "deg"', "offset = true", ["outputs.angle.offset", "no number"]),
    ('unit = "V"', "scale = 1e3", ["log.csv', row 3, column 'u'", "outside", "scale"]),
    ('"u"', "9", ["log.csv' has no column 9"]),
]
"""A part of the description, what stands in its place, and the words that tell the fault."""
ADDED: list[tuple[str, list[str]]] = [
    ('start = "moving"', ["logs[1].start", "'moving' is unknown"]),
    ("start = 3", ["logs[1].start", "write for example"]),
    ("start = {}", ["logs[1].start", "empty", "angle"]),
    ("start = { angel = 1 }", ["logs[1].start.angel", "did you mean 'angle'"]),
    ('start = { angle = "1 V" }', ["logs[1].start.angle", "does not convert"]),
    ("held_out = {}", ["logs[1].held_out: empty; write true for all", '{ from = "12 s"']),
    ("start = { rate = true }", ["logs[1].start.rate", "no number"]),
    ('start = "rest"\nsettle = 1', ["logs[1].settle", "begins at rest", "drop one"]),
    ('start = "settled"\nsettle = 0', ["logs[1].settle", "nothing settles"]),
    ("constants = { voltage = 1 }", ["constants.voltage", "keep one"]),
    ("constants = { stifness = 1 }", ["constants.stifness", "did you mean 'stiffness'"]),
    ('constants = { stiffness = "1 V" }', ["constants.stiffness", "does not convert"]),
    ("constants = { load_torque = 1e9 }", ["constants.load_torque", "outside"]),
    ("constants = { stiffness = -1 }", ["constants.stiffness", "outside"]),
    ('window = "1 s"', ["logs[1].window", "no pair"]),
    ("window = [1, 2]", ["logs[1].window: no row inside; the file lasts 0.095 s"]),
    ("window = [2, 1]", ["logs[1].window:", "not after"]),
    ('window = [0, "1 V"]', ["logs[1].window:", "does not convert"]),
    ("window = [0, 0.05]", ["11 samples", "at least 16"]),
    ("held_out = 3", ["logs[1].held_out"]),
    ('held_out = { from = "1 s" }', ["held_out: no row inside", "from 0 to 0.095 s"]),
    ("held_out = { form = 1 }", ["logs[1].held_out.form", "did you mean 'from'"]),
    ('held_out = { input = "u", levels = "odd" }', ["held_out.input", "'u'"]),
    (
        'held_out = { input = "voltage", levels = "all" }',
        ["held_out.levels", "'all' is unknown", "even"],
    ),
    ("settle = -1", ["logs[1].settle", "below 0"]),
    ('judged = { input = "voltag", after_change = 1 }', ["judged.input", "'voltage'"]),
    ('judged = { input = "voltage" }', ["judged.after_change: missing"]),
    ('judged = { input = "voltage", after = 1 }', ["judged.after", "'after_change'"]),
    (
        "[parameters]\nnull_shift.angel = 1",
        ["parameters.null_shift.angel", "'null_shift.angle'"],
    ),
    ("[parameters]\nstiffness = [1]", ["parameters.stiffness: no number"]),
    ("[parameters]\nstiffness = -1", ["parameters.stiffness", "outside"]),
    ('[parameters]\n"null_shift.angle" = 0\nnull_shift.angle = 0', ["given twice"]),
    ("[bounds]\nmass = [1, 2]", ["bounds.mass", "unknown parameter"]),
    ("[bounds]\nstiffness = 1", ["bounds.stiffness: no pair"]),
    ('[bounds]\nstiffness = ["1 V", 2]', ["bounds.stiffness", "does not convert"]),
    ("[bounds]\nstiffness = [-1, 2]", ["bounds.stiffness", "outside"]),
    ("[bounds]\nstiffness = [2, 0.5]", ["bounds.stiffness", "the lower one first"]),
    (
        "[bounds]\nstiffness = [2, 3]",
        ["bounds.stiffness", "the nominal value, 1.1 N.m/rad, lies outside"],
    ),
    ("[uncertainty]\nmass = 1", ["uncertainty.mass", "unknown parameter"]),
    ("[uncertainty]\nstiffness = 0", ["uncertainty.stiffness", "above 0"]),
    ('[uncertainty]\nstiffness = "-5 %"', ["uncertainty.stiffness", "give a share above 0"]),
    ('[uncertainty]\nback = "5 %"', ["did you mean 'back_emf_constant'"]),
    ('[uncertainty]\nnull_shift.angle = "5 %"', ["uncertainty.null_shift.angle", "share"]),
    ('[uncertainty]\nstiffness = "x %"', ["uncertainty.stiffness", "'x %' is not a number"]),
    ("repaet = [{}]", ["logs[1].repaet", "did you mean 'repeat'"]),
    ("repeat = 3", ["logs[1].repeat: no list; write for example repeat = [{"]),
    ("repeat = [3]", ["logs[1].repeat", "no list"]),
    ("repeat = []", ["logs[1].repeat: empty"]),
    ("repeat = [{ nmae = 1 }]", ["logs[1].repeat[1].nmae", "did you mean 'name'"]),
    ("repeat = [{}, { name = 1 }]", ["logs[1].repeat[2].name: no text"]),
    ("repeat = [{ window = 1 }]", ["logs[1].repeat[1].window: no pair"]),
    ("repeat = [{ repeat = [{}] }]", ["logs[1].repeat[1].repeat", "inside"]),
    ('repeat = [{ file = "c*.csv" }]', ["repeat[1].file", "no file matches 'c*.csv'"]),
]
"""What stands behind the log."""
ROWS: list[tuple[int, tuple[object, ...], list[str]]] = [
    (4, (120, "", 0), ["log.csv', row 6, column 'u' is empty"]),
    (4, (120, "nan", 0), ["log.csv', row 6, column 'u': 'nan' is not finite"]),
    (4, (120, 1, "up"), ["log.csv', row 6, column 'angle_deg': 'up' is not a number"]),
    (4, ("late", 1, 1), ["log.csv', row 6, column 'time_ms': 'late' is not a number"]),
    (
        4,
        (90, 1, 1),
        ["log.csv', row 6, column 'time_ms': time runs backward from 0.115 s to 0.09 s"],
    ),
    (4, (115, 1, 1), ["log.csv', row 6, column 'time_ms': time 0.115 s repeats"]),
    (4, (120, 1), ["log.csv', row 6 has 2 cells"]),
    (4, (120, -900, 1), ["log.csv', row 6, column 'u': input 'voltage' = -900 V is outside"]),
]
"""A row of the log, counted from 0, and its cells."""


def with_row(row: int, cells: Sequence[object]) -> str:
    return text_of([*TABLE[:row], cells, *TABLE[row + 1 :]])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        *(
            ({"log": (HEAD + LOG).replace(old, new, 1), "head": ""}, said)
            for old, new, said in CHANGED
        ),
        *(({"log": f"{LOG}{more}\n"}, said) for more, said in ADDED),
        *(({"data": with_row(row, cells)}, said) for row, cells, said in ROWS),
    ],
)
def test_a_fault_is_named_with_its_place(
    tmp_path: Path, given: dict[str, str], said: list[str]
) -> None:
    message = complaint(tmp_path, **given)
    assert "description.toml'" in message or "log.csv'" in message
    for words in said:
        assert words in message


def test_a_reading_that_never_changes_and_a_log_too_short(tmp_path: Path) -> None:
    still = [(row[0], row[1], 1.25) for row in TABLE]
    assert "column 'angle_deg' is constant" in complaint(tmp_path, data=text_of(still))
    assert "15 samples" in complaint(tmp_path, data=text_of(TABLE[:15]))
    assert len(describe(tmp_path, data=text_of(TABLE[:16])).logs[0].times) == 16


@pytest.mark.parametrize("units", ["ms,V,deg", "[ms],[V],[deg]", "ms,,deg", "'ms', 'V', '°'"])
def test_a_row_of_units_is_told(tmp_path: Path, units: str) -> None:
    head, *rows = text_of(TABLE).splitlines()
    message = complaint(tmp_path, data="\n".join([head, units, *rows]))
    assert "row 2, column 'time_ms': '" in message
    assert "is not a number; the row looks like units: remove it" in message
    message = complaint(tmp_path, data="\n".join([head, rows[0], units, *rows[1:]]))
    assert message.endswith("correct it or remove the row")
    message = complaint(tmp_path, data="\n".join([head, "late,1,2", *rows]))
    assert message.endswith("correct it or remove the row")


@pytest.mark.parametrize(
    "start",
    ["{}", "{ angel = 1 }", '{ angle = "3 V" }', '{ angle = "3 deg" }', '"fit"'],
)
def test_a_start_of_a_plant_without_a_shaft_gets_no_advice_that_does_not_help(
    tmp_path: Path, start: str
) -> None:
    (tmp_path / "joint.py").write_text(SOURCE)
    times = np.arange(40) / 100
    rows = np.column_stack([times, times > 0.1, times])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="t,u,y", comments="")
    (tmp_path / "joint.toml").write_text(
        'actuator = "joint.py"\n[[logs]]\nfile = "log.csv"\ntime = "t"\ninputs.goal = "u"\n'
        f'outputs.angle = "y"\nstart = {start}\n'
    )
    with pytest.raises(UserError) as error:
        read_description(tmp_path / "joint.toml")
    assert "logs[1].start: actuator 'joint' has no shaft" in str(error.value)
    assert 'write "rest" or "settled", or leave it out' in str(error.value)
    assert "did you mean" not in str(error.value)


def test_a_name_that_is_like_no_other_gets_all_there_are() -> None:
    assert did_you_mean("anlge", ["reading", "voltage"]) == "known: reading, voltage"
    assert did_you_mean("raeding", ["reading", "voltage"]) == "did you mean 'reading'?"
