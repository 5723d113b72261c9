"""Readers of measured texts: every dialect comes back, and faults have a place."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from servo_models.data.readers import read_columns
from tests.support.files import ROWS, complaint, file


@pytest.mark.parametrize("mark", [".", ","])
@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("header", [None, "time,s", "# made by hand"])
@settings(deadline=None, max_examples=30)
@given(rows=ROWS)
def test_every_dialect_gives_the_numbers_back(
    tmp_path_factory: pytest.TempPathFactory,
    mark: str,
    separator: str,
    header: str | None,
    rows: list[tuple[float, float]],
) -> None:
    if mark == separator:
        return
    lines = [separator.join(repr(cell).replace(".", mark) for cell in row) for row in rows]
    if header:
        lines.insert(0, header.replace(",", separator))
    columns = read_columns(file(tmp_path_factory.getbasetemp(), "\r\n".join(lines)))
    assert np.array_equal(np.column_stack([columns.numbers(1), columns.numbers(2)]), rows)
    assert columns.names == (("time", "s") if header == "time,s" else ("1", "2"))
    assert columns.first_row == (2 if header else 1)


@pytest.mark.parametrize(
    ("content", "names", "first_row"),
    [
        ("\ufefft,u\n0,1\n", ("t", "u"), 2),
        ('"t [s]";"u, raw"\n"0";"1"\n', ("t [s]", "u, raw"), 2),
        ('t,note,u\n0,"stuck, again",1\n', ("t", "note", "u"), 2),
        ("# rig 3\n\n# 2 supplies\nt,u\n0,1\n", ("t", "u"), 5),
        ("t\n0\n1\n", ("t",), 2),
        ("0;ok;1\n1;ok;2\n", ("1", "2", "3"), 1),
        ("t;ok;7\n1;ok;2\n", ("t", "ok", "7"), 2),
        ("t\tu\n", None, None),
    ],
)
def test_headers_are_found(
    tmp_path: Path, content: str, names: Sequence[str] | None, first_row: int | None
) -> None:
    path = file(tmp_path, content)
    if names is None:
        assert "no rows" in complaint(path)
    else:
        columns = read_columns(path)
        assert (columns.names, columns.first_row) == (names, first_row)


def test_the_header_that_numpy_writes_in_a_comment_is_one(tmp_path: Path) -> None:
    path, values = tmp_path / "log.txt", np.array([[0.0, 1.5], [0.1, 1 / 3]])
    np.savetxt(path, values, delimiter=",", header="t,u", fmt="%.17g")
    columns = read_columns(path)
    assert columns.names == ("t", "u")
    assert np.array_equal(columns.numbers("u"), values[:, 1])


def test_a_header_of_numbers_can_be_told(tmp_path: Path) -> None:
    path = file(tmp_path, "1,2\n5,6\n")
    assert list(read_columns(path).numbers(2)) == [2.0, 6.0]
    assert list(read_columns(path, header=True).numbers("2")) == [6.0]
    assert "row 1, column '1': 't' is not a number" in complaint(
        file(tmp_path, "t,u\n0,1\n"), header=False
    )


def test_only_the_columns_asked_for_need_be_clean(tmp_path: Path) -> None:
    columns = read_columns(file(tmp_path, "t,note,u,gap\n0,start,1,\n1,nan,2,3\n"))
    assert list(columns.numbers("u")) == [1.0, 2.0]
    assert list(columns.numbers("gap", slice(1, None))) == [3.0]


@pytest.mark.parametrize(
    ("content", "column", "said"),
    [
        ("", 1, ["is empty"]),
        ("# only words\n", 1, ["is empty"]),
        ("t,u\n0,1\n\n1,2\n", 1, ["row 3 is empty"]),
        ("t,u\n0,1\n1\n", 1, ["row 3 has 1 cells, the header 2"]),
        ("0;1\n1;2;3\n", 1, ["row 2 has 3 cells, the first row 2"]),
        ("t,u\n0,\n", "u", ["row 2, column 'u' is empty"]),
        ("#a\nt;u\n0;1\n0;1,2,3\n", "u", ["row 4, column 'u'", "'1,2,3' is not a number"]),
        ("t,u\n0,inf\n", "u", ["row 2, column 'u'", "'inf' is not finite"]),
        ("0,1\n1,NaN\n", 2, ["row 2, column '2'", "not finite"]),
        ("time,volt\n0,1\n", "volts", ["no column 'volts'", "did you mean 'volt'"]),
        ("t,u\n0,1\n", 3, ["no column 3", "1 to 2"]),
        ("t,u\n0,1\n", 0, ["no column 0"]),
        ("t,u,u\n0,1,2\n", "u", ["two columns 'u'", "number"]),
        (b"t,u\n0,1\n1,\xb0\n", 1, ["row 3", "0xb0", "UTF-8"]),
    ],
)
def test_a_fault_of_a_text_is_named(
    tmp_path: Path, content: str | bytes, column: str | int, said: list[str]
) -> None:
    message = complaint(file(tmp_path, content), column)
    for words in said:
        assert words in message


@settings(deadline=None, max_examples=40)
@given(data=st.data(), count=st.integers(2, 20), comments=st.integers(0, 3))
def test_a_bad_cell_is_found_in_the_row_that_an_editor_shows(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, count: int, comments: int
) -> None:
    row = data.draw(st.integers(0, count - 1))
    bad = data.draw(st.sampled_from(["", "volt", "NaN", "1e", "--1", "1_000", "1,2"]))
    lines = ["# a comment"] * comments + ["t;u"] + [f"{i};1,5" for i in range(count)]
    lines[comments + 1 + row] = f"{row};{bad}" if bad != "1,2" else f"{row};1,2,3"
    shown = next(i for i, line in enumerate(lines, start=1) if line.startswith(f"{row};"))
    message = complaint(file(tmp_path_factory.getbasetemp(), "\n".join(lines)), "u")
    assert f"row {shown}, column 'u'" in message
