"""Files that are no files, too large, or hold what a terminal would obey."""

from __future__ import annotations

import json
import os
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

from servo_models.data.readers import read_columns
from servo_models.data.schema import read_toml
from servo_models.errors import LONGEST, UserError, printable
from servo_models.files import largest_input
from servo_models.report.result import data_sheet
from servo_models.report.sections import Table
from servo_models.report.terminal import text
from tests.conftest import Run

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
    suffixes = ("csv", "json", "parquet", "mat", "ulg", "mcap", "toml")
    paths = [tmp_path / f"pipe.{suffix}" for suffix in suffixes]
    for path in paths:
        os.mkfifo(path)
    command = [sys.executable, "-c", CHECK_EACH, *map(str, paths)]
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


def test_a_cell_of_a_megabyte_is_not_printed(tmp_path: Path, run: Run) -> None:
    path = tmp_path / "inputs.csv"
    path.write_text("time,pulse_width\n0," + "x" * 1_000_000 + "\n")
    code, _, err = run("simulate", "sg90", "--inputs", path)
    assert code == 2
    assert "row 2" in err
    assert len(err) < 1200
