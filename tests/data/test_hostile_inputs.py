"""Files that are no files, too large, or hold what a terminal would obey."""

from __future__ import annotations

import json
import os
import random
import struct
import subprocess
import sys
import unicodedata
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st

from servo_models.catalogue import model
from servo_models.data.description import read_description
from servo_models.data.parameters import read_parameters
from servo_models.data.readers import read_columns
from servo_models.data.schema import Section, read_toml
from servo_models.errors import LONGEST, UserError, printable
from servo_models.files import largest_input, read_regular
from servo_models.identification.transfer.sweeps import read_sweeps
from servo_models.report.result import data_sheet
from servo_models.report.sections import Table
from servo_models.report.terminal import text
from tests.conftest import Run
from tests.support.own_actuators import write

h5py = pytest.importorskip("h5py")


@pytest.fixture
def small() -> Iterator[int]:
    """Allow a megabyte only."""
    token = largest_input.set(1 << 20)
    yield 1 << 20
    largest_input.reset(token)


CHECK_EACH = """
import sys
from servo_models.cli import main
for path in sys.argv[1:]:
    assert main(["check", path, *([] if path.endswith("toml") else ["--init"])]) == 2
"""


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with a name here")
def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    """In a process of its own: one that waits cannot be ended otherwise."""
    suffixes = ("csv", "json", "parquet", "mat", "ulg", "mcap", "bin", "mf4", "toml")
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").touch()
    paths = [*(tmp_path / f"pipe.{suffix}" for suffix in suffixes), tmp_path / "bag" / "log.mcap"]
    for path in paths:
        os.mkfifo(path)
    command = [sys.executable, "-c", CHECK_EACH, *map(str, (*paths[:-1], tmp_path / "bag"))]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("no regular file") == len(paths)


@pytest.mark.parametrize(
    "path", [Path("/dev/zero"), Path(os.sep), Path("a\0b.csv"), Path("x" * 5000)]
)
def test_what_is_no_file_is_refused(path: Path) -> None:
    named = path.with_suffix(".csv") if path.suffix else path
    for read in (read_columns, read_toml):
        with pytest.raises(UserError):
            read(named)


def test_a_sparse_file_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "sparse.csv"
    with path.open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(UserError, match="--largest"):
        read_columns(path)


def parquet(path: Path, rows: int) -> None:
    pl.DataFrame({"t": np.zeros(rows)}).write_parquet(path, compression="zstd")


def mat5(path: Path, rows: int) -> None:
    scipy.io.savemat(path, {"t": np.zeros(rows)}, do_compression=True)


@pytest.mark.parametrize(("write", "suffix"), [(parquet, ".parquet"), (mat5, ".mat")])
def test_a_small_file_that_unpacks_to_a_large_one_is_refused(
    tmp_path: Path, small: int, write: Callable[[Path, int], None], suffix: str
) -> None:
    path = tmp_path / f"bomb{suffix}"
    write(path, 1_000_000)
    assert path.stat().st_size < small // 10
    with pytest.raises(UserError, match=r"would take 7\.6"):
        read_columns(path)
    write(path, 1000)
    assert len(read_columns(path).numbers("t")) == 1000


def test_lists_in_parquet_are_not_unpacked(tmp_path: Path, small: int) -> None:
    """The size of a file by its rows and columns knows nothing of lists in its cells."""
    path = tmp_path / "lists.parquet"
    lists = np.zeros((1, 4 * small))
    pl.DataFrame({"t": [1.0], "scan": lists}).write_parquet(path, compression="zstd")
    columns = read_columns(path)
    assert list(columns.numbers("t")) == [1.0]
    with pytest.raises(UserError, match=r"'scan' holds List.*: give numbers"):
        columns.numbers("scan")
    assert sum(cells.estimated_size() for cells in columns.cells) < small


def test_a_scan_stays_in_its_cell(tmp_path: Path, small: int) -> None:
    """A list of another length in each row does not tell its size in the schema."""
    path = tmp_path / "scan.parquet"
    scans = [[0.0] * (small // 2), [0.0]]
    pl.DataFrame({"t": [0.0, 1.0], "scan": scans}).write_parquet(path, compression="zstd")
    columns = read_columns(path)
    assert columns.names == ("t", "scan")
    assert sum(cells.estimated_size() for cells in columns.cells) < small


def test_records_of_a_name_each_are_not_unpacked(tmp_path: Path, small: int) -> None:
    """A table of them has as many cells as rows times names."""
    path = tmp_path / "log.json"
    path.write_text(json.dumps([{f"a{i}": 1} for i in range(400)]))
    with pytest.raises(UserError, match=r"log\.json' would take 1\.2"):
        read_columns(path)


def test_a_structure_does_not_hide_its_size(tmp_path: Path, small: int) -> None:
    path = tmp_path / "log.mat"
    scipy.io.savemat(path, {"s": {"t": np.zeros(small // 4)}}, do_compression=True)
    with pytest.raises(UserError, match="would take 2 MB"):
        read_columns(path)
    scipy.io.savemat(path, {"s": {"t": np.arange(100.0)}}, do_compression=True)
    assert len(read_columns(path).numbers("s.t")) == 100


def test_a_variable_longer_than_it_says_is_damaged(tmp_path: Path, small: int) -> None:
    """Source: MAT-File Format, version 5: a compressed element holds one with a tag of its own."""
    path = tmp_path / "log.mat"
    scipy.io.savemat(path, {"s": {"t": np.zeros(small // 4)}}, do_compression=True)
    content = path.read_bytes()
    whole = bytearray(zlib.decompress(content[136:]))
    whole[4:8] = struct.pack("<I", 100)
    packed = zlib.compress(whole)
    path.write_bytes(content[:128] + struct.pack("<II", 15, len(packed)) + packed)
    with pytest.raises(UserError, match="is damaged or no MAT file"):
        read_columns(path)


def hdf5(path: Path) -> h5py.File:
    """A MAT file of version 7.3: an HDF5 file behind a block of 512 bytes that names it."""
    return h5py.File(path, "w", userblock_size=512)


def name_it(path: Path) -> Path:
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(128))
    return path


def test_a_mat_file_with_its_values_elsewhere_is_refused(tmp_path: Path, small: int) -> None:
    (tmp_path / "secret.bin").write_bytes(np.zeros(100).tobytes())
    path = tmp_path / "outside.mat"
    with hdf5(path) as file:
        place = [(str(tmp_path / "secret.bin"), 0, 800)]
        file.create_dataset("t", shape=(100,), dtype="f8", external=place)
    with pytest.raises(UserError, match="'/t' stands in another file"):
        read_columns(name_it(path))
    with hdf5(path) as file:
        file["t"] = h5py.ExternalLink("other.h5", "/x")
    with pytest.raises(UserError, match="'t' stands in another file"):
        read_columns(name_it(path))
    with hdf5(path) as file:
        file.create_dataset("t", data=np.zeros(1_000_000), compression="gzip")
    with pytest.raises(UserError, match="would take"):
        read_columns(name_it(path))
    with hdf5(path) as file:
        for name in "abc":
            file.create_dataset(name, data=np.zeros(small // 16), compression="gzip")
    with pytest.raises(UserError, match=r"would take 1\.5"):
        read_columns(name_it(path))
    with hdf5(path) as file:
        file["t"] = np.arange(100.0)
    assert len(read_columns(name_it(path)).numbers("t")) == 100


def test_the_limit_can_be_raised(tmp_path: Path, run: Run) -> None:
    path = tmp_path / "long.csv"
    path.write_text("t,voltage,angle\n" + "".join(f"{i},0,{i}\n" for i in range(150_000)))
    token = largest_input.set(1 << 20)
    try:
        code, _, err = run("check", path, "--init", "--actuator", "torque_motor")
        assert code == 2
        assert "allow it by --largest" in err
        code, _, err = run("check", path, "--init", "--actuator", "torque_motor", "--largest", "9")
        assert "--largest" not in err
    finally:
        largest_input.reset(token)


@pytest.mark.parametrize("text", ["", "[" * 100_000, "{" * 100_000, '{"a":' * 50_000, "9" * 10_000])
def test_json_that_holds_nothing(tmp_path: Path, text: str) -> None:
    path = tmp_path / "log.json"
    path.write_text(text)
    with pytest.raises(UserError, match=r"log\.json"):
        read_columns(path)


@pytest.mark.parametrize("text", ["a = " + "9" * 10_000, "a = " + "[" * 100_000, "a.b" * 5000])
def test_toml_that_python_does_not_take(tmp_path: Path, text: str) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(text)
    with pytest.raises(UserError, match=r"rig\.toml"):
        read_toml(path)


# What is printed


@given(st.text(max_size=300))
def test_a_printed_text_is_one_line_without_escapes(text: str) -> None:
    shown = printable(text, 100)
    assert len(shown) <= 105
    assert not any(unicodedata.category(sign) in ("Cc", "Cf", "Cs") for sign in shown)
    assert str(UserError(text)) == printable(text, LONGEST)


def test_escapes_of_a_column_do_not_reach_the_terminal(tmp_path: Path, run: Run) -> None:
    """Neither by an error nor by a sheet: a title, a colour, text from right to left."""
    name = "\x1b]0;owned\x07\x1b[31m\u202eelgna"
    rows = "".join(f"{0.01 * i},{i % 7},{i % 5}\n" for i in range(100))
    path = tmp_path / "log.csv"
    path.write_text(f"t,voltage,{name}\n{rows}")
    for words in (["check", path, "--init"], ["simulate", "sg90", "--inputs", path]):
        _, out, err = run(*words)
        for sign in ("\x1b", "\x07", "\u202e"):
            assert sign not in out + err
    sheet = data_sheet(name, (name,), (Table(name, ("a", "b"), ((name, "x" * 10_000),)),))
    assert "\x1b" not in text(sheet, 100)
    assert len(text(sheet, 100)) < 2000


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


@pytest.mark.parametrize("sweeps", ["1", '"a"', "[1]", "[[1]]", "[{ file = 1 }]", "{ a = 1 }"])
def test_sweeps_of_a_wrong_type(tmp_path: Path, sweeps: str) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(f'actuator = "sg90"\nsweeps = {sweeps}\n')
    with pytest.raises(UserError, match=r"rig.toml', sweeps.*write for example "):
        read_sweeps(read_toml(path), tmp_path, model("sg90").plant)


def test_a_limit_that_no_flag_raises_names_none(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_bytes(b"#" * 300)
    with pytest.raises(UserError, match=r"cut it$"):
        read_regular(path, 200)


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


def test_a_cure_can_be_written(tmp_path: Path) -> None:
    """TOML does not know [logs[1].held_out]."""
    path = tmp_path / "rig.toml"
    path.write_text('actuator = "sg90"\n[[logs]]\nfile = "rig.toml"\nconstants = 1\n')
    with pytest.raises(UserError, match=r"write for example constants = \{ "):
        Section(path, "logs[1]", read_toml(path).content["logs"][0]).section("constants")


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
