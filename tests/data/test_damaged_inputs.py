"""A share of the damaged inputs of ``fuzz/inputs.py``, and what its full runs have found."""

from __future__ import annotations

import json
import random
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import polars as pl
import pytest

from servo_models.data.description import read_description
from servo_models.data.parameters import read_parameters
from servo_models.data.readers import read_columns
from servo_models.data.schema import Section, read_toml
from servo_models.errors import UserError
from servo_models.files import read_regular
from servo_models.identification.transfer.sweeps import raw_records, read_sweeps
from tests.conftest import Run
from tests.support.own_actuators import write

FUZZ = Path(__file__).parents[1] / "fuzz" / "inputs.py"
NO_END_SECONDS = 550


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="its limits are of Linux")
def test_a_share_of_the_damaged_inputs() -> None:
    words = [sys.executable, str(FUZZ), "--count", "30", "--seed", "17"]
    done = subprocess.run(
        words, check=False, capture_output=True, text=True, timeout=NO_END_SECONDS
    )
    assert done.returncode == 0, done.stdout
    assert "30 cases" in done.stdout
    assert "refused" in done.stdout


def test_a_quote_that_does_not_end(tmp_path: Path) -> None:
    """A line longer than Python's reader of CSV takes."""
    path = tmp_path / "log.csv"
    path.write_text('t,u\n0,"' + "1" * 200_000 + "\n1,2\n")
    with pytest.raises(UserError, match=r"row 2, column 'u'"):
        read_columns(path).numbers("u")


def test_a_name_and_a_cell_that_are_no_unicode(tmp_path: Path) -> None:
    """JSON may spell half of a pair of UTF-16."""
    path = tmp_path / "log.json"
    path.write_text('[{"\\udcff": 1, "t": "\\ud800"}, {"\\udcff": 2, "t": 1}]')
    columns = read_columns(path)
    assert list(columns.numbers(1)) == [1.0, 2.0]
    with pytest.raises(UserError, match=r"row 1, column 't': '\?' is not a number"):
        columns.numbers("t")


def test_a_damaged_parquet_file_is_told_in_one_sentence(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Its library prints a stack where it does not expect what it finds."""
    path = tmp_path / "log.parquet"
    pl.DataFrame({"t": [0.02 * i for i in range(60)], "u": [1.0] * 60}).write_parquet(path)
    whole, rng = path.read_bytes(), random.Random(1)
    refused = 0
    for _ in range(400):
        damaged = bytearray(whole)
        for _ in range(3):
            damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        try:
            read_columns(path)
        except UserError:
            refused += 1
    assert refused > 100
    assert capfd.readouterr().err == ""


def test_a_column_without_rows_is_left_out_of_a_draft(tmp_path: Path, run: Run) -> None:
    path = tmp_path / "log.json"
    lists = {"t": [0.02 * i for i in range(30)], "angle": [0.1 * i for i in range(30)], "rate": []}
    path.write_text(json.dumps(lists))
    code, _, err = run("check", path, "--init", "--actuator", "sg90")
    assert "Traceback" not in err
    assert code in (0, 1)
    assert "rate" not in path.with_suffix(".toml").read_text().split("[[logs]]")[1].split("#")[0]


HUGE = "0x1" + "0" * 4000  # of more decimal digits than Python prints


@pytest.mark.parametrize(
    "line",
    [
        f"logs = [{{ file = {HUGE} }}]",
        f"bounds.motor_gain = [{HUGE}, 1]",
        f"parameters.motor_gain = {HUGE}",
        f"parameters.motor_gain = {2**63}",
        "parameters" + ".a" * 3000 + " = 1",
        "parameters = " + "{ a = " * 60 + "1" + " }" * 60,
        "bounds.motor_gain = " + "[" * 60 + "]" * 60,
    ],
    ids=range(7),
)
@pytest.mark.parametrize("reader", [read_description, read_parameters])
def test_what_toml_does_not_hold(
    tmp_path: Path, line: str, reader: Callable[[Path], object]
) -> None:
    """Source: TOML v1.0.0, integers have 64 bits."""
    path = tmp_path / "rig.toml"
    path.write_text(f'actuator = "sg90"\n{line}\n')
    with pytest.raises(UserError, match=r"rig.toml', .*(with a point|leave tables out)") as caught:
        reader(path)
    assert len(str(caught.value)) < 500 + len(str(path))


@pytest.mark.parametrize("sweeps", ["1", '"a"', "[1]", "[[1]]", '[{ logs = "a" }]', "{ a = 1 }"])
def test_sweeps_of_a_wrong_type(tmp_path: Path, sweeps: str) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(f'actuator = "sg90"\nsweeps = {sweeps}\n')
    with pytest.raises(UserError, match=r"rig.toml', sweeps.*write for example "):
        raw_records(read_toml(path))


def test_a_limit_that_no_flag_raises_names_none(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_bytes(b"#" * 300)
    with pytest.raises(UserError, match=r"cut it$"):
        read_regular(path, 200)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("a\\u0000b.csv", "logs"),
        ("x" * 5000 + ".csv", "logs"),
        ("nowhere.csv", "nowhere.csv"),
    ],
)
def test_names_that_are_none(tmp_path: Path, name: str, words: str) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(
        f'actuator = "sg90"\n[[logs]]\nfile = "{name}"\ntime = "t"\noutputs.angle = "a"\n'
    )
    with pytest.raises(UserError, match=words):
        read_description(path)


def _read_whole(path: Path, trust: bool) -> None:
    found = read_description(path, trust)
    read_sweeps(found.document, path.parent, found.actuator.plant)


@pytest.mark.parametrize("name", ["a\\u0000b", "x" * 5000, "../" * 2000 + "x", "\\u202e"])
@pytest.mark.parametrize("key", ["actuator", "params", "logs.file", "sweeps.file"])
@pytest.mark.parametrize("trust", [False, True])
def test_texts_that_are_no_names_of_files(tmp_path: Path, name: str, key: str, trust: bool) -> None:
    path = tmp_path / "rig.toml"
    suffix = {"actuator": ".py", "params": ".toml"}.get(key, ".csv")
    head = "" if key in ("actuator", "params") else 'actuator = "torque_motor"\n'
    table, _, own = key.rpartition(".")
    rest = "[[logs]]\n" if not table else f"[[{table}]]\n"
    signals = {
        "logs": 'time = "t"\noutputs.angle = "a"\n',
        "sweeps": 'input = "voltage"\noutput = "angle"\nfrequency = { column = "f" }\n'
        'gain = { column = "g" }\nphase = { column = "p" }\n',
    }.get(table, "")
    given = f'{own} = "{name}{suffix}"\n'
    path.write_text(f"{head}{rest}{given}{signals}" if table else f"{given}{rest}")
    with pytest.raises(UserError, match=r"name|correct|such file"):
        _read_whole(path, trust)


@pytest.mark.parametrize("command", [["validate"], ["build"], ["check"], ["identify"]])
def test_a_very_long_name_on_the_command_line(run: Run, command: list[str]) -> None:
    for suffix in (".fmu", ".py", ".toml", ".csv"):
        code, _, err = run(*command, "x" * 3000 + suffix)
        assert code == 2
        assert "Traceback" not in err


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("sweeps = 1", "sweeps: no list; write for example [[sweeps]]"),
        ("sweeps = [1]", "sweeps: no list; write for example [[sweeps]]"),
        ("elements = 1", "elements: no table"),
        ("elements = []", "elements: no table"),
        ('method = "x"', "method: 'x' is unknown; known: simulation, transfer_function, elements"),
    ],
)
def test_what_a_command_does_not_use_is_refused_too(tmp_path: Path, line: str, words: str) -> None:
    """A check or a diagnosis reads neither sweeps nor elements, and asks for no method."""
    path = tmp_path / "rig.toml"
    path.write_text(f'actuator = "sg90"\n{line}\n')
    with pytest.raises(UserError, match=re.escape(words)):
        read_description(path)


def test_a_cure_can_be_written(tmp_path: Path) -> None:
    """TOML does not know [logs[1].held_out]."""
    path = tmp_path / "rig.toml"
    path.write_text('actuator = "sg90"\n[[logs]]\nfile = "rig.toml"\nconstants = 1\n')
    with pytest.raises(UserError, match=r"write for example constants = \{ "):
        Section(path, "logs[1]", read_toml(path).content["logs"][0]).section("constants")


@pytest.mark.parametrize("line", ['params = ""', 'params = "no.toml"', 'params = "a\\u0000b"'])
def test_a_parameter_file_is_told_with_where_it_is_named(tmp_path: Path, line: str) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(f"{line}\n")
    with pytest.raises(UserError, match=r"rig\.toml', params: cannot read"):
        read_description(path)


def test_a_log_without_a_name_is_told_with_where_it_is_named(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text('actuator = "sg90"\n[[logs]]\nfile = ""\ntime = "t"\noutputs.angle = "a"\n')
    with pytest.raises(UserError, match=r"rig\.toml', logs\[1\]\.file: no file"):
        read_description(path)


@pytest.mark.parametrize(
    ("signal", "size", "words"),
    [
        ("outputs.angle", 1e308, r"log\.csv', row 3, column 'y': 1e\+308 rad is more than any"),
        ("outputs.angle", 1e-310, r"log\.csv', column 'y' is constant over the log"),
        ("inputs.voltage", 1e200, r"log\.csv', row 3, column 'y': input 'voltage' = "),
        ("inputs.goal", 1e200, r"log\.csv', row 3, column 'y': 1e\+200 rad is more than any"),
    ],
)
def test_sizes_whose_squares_no_number_holds(
    tmp_path: Path, recwarn: pytest.WarningsRecorder, signal: str, size: float, words: str
) -> None:
    rows = "".join(f"{0.01 * i},{i % 3},{size * (i % 2)}\n" for i in range(30))
    (tmp_path / "log.csv").write_text(f"t,u,y\n{rows}")
    path, own = tmp_path / "rig.toml", signal == "inputs.goal"
    write(tmp_path)
    path.write_text(
        f'actuator = "{"joint.py" if own else "torque_motor"}"\n[[logs]]\nfile = "log.csv"\n'
        f'time = "t"\n{signal} = "y"\n' + ('outputs.angle = "u"\n' if "inputs" in signal else "")
    )
    with pytest.raises(UserError, match=words):
        read_description(path)
    assert not recwarn.list
