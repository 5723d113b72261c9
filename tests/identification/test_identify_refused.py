"""servo-models identify: bad input is one line with its place and cure, and leaves no file."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import Run
from tests.support.bench_log import changed, laid_out, rows_of, write_log


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    return laid_out(tmp_path)


def cell(row: int, column: int, text: str) -> Callable[[Path], None]:
    """Spoil one cell, the row counted as in the file."""

    def spoil(folder: Path) -> None:
        rows = rows_of()
        rows[row - 2][column] = text
        write_log(folder, rows)

    return spoil


def constant(folder: Path) -> None:
    write_log(folder, [[t, u, "0.5"] for t, u, _ in rows_of()])


def of_another(folder: Path) -> None:
    (folder / "other.toml").write_text(
        'actuator = "sg90"\n[parameters.gear_ratio]\nvalue = 24.0\nunit = "1"\n'
    )
    changed('variant = "measured"', 'params = "other.toml"')(folder)


def nothing(folder: Path) -> None:
    """Leave all as it is."""


@pytest.mark.parametrize(
    ("spoil", "options", "said"),
    [
        (cell(8, 2, "nan"), "", ["log.csv", "row 8", "column 'angle_deg'", "not finite", "remove"]),
        (constant, "", ["log.csv", "'angle_deg'", "constant", "leave it out"]),
        (changed('"log.csv"', '"lag.csv"'), "", ["logs[1].file", "no file", "lag.csv"]),
        (changed('"inductance"', '"inductanse"'), "", ["free", "did you mean 'inductance'"]),
        (
            changed("free =", 'method = "simulacion"\nfree ='),
            "",
            ["mine.toml", "method", "simulation"],
        ),
        (of_another, "", ["params", "other.toml", "'sg90'", "leave out actuator"]),
        (nothing, "--free torque_constnt", ["did you mean 'torque_constant'"]),
        (nothing, "--search globl", ["did you mean 'global'"]),
        (nothing, "--out PARAMS.txt", ["PARAMS.txt", "end in .toml"]),
        (nothing, "--report report.pdf", ["report.pdf", "end in .html"]),
        (nothing, "--out log.csv/PARAMS.toml", ["cannot write", "choose a folder"]),
        (nothing, "--out folder.toml", ["cannot write", "it is a folder"]),
    ],
)
def test_bad_input_is_one_line_with_place_and_cure(
    bench: Path,
    run: Run,
    monkeypatch: pytest.MonkeyPatch,
    spoil: Callable[[Path], None],
    options: str,
    said: list[str],
) -> None:
    (bench / "folder.toml").mkdir()
    monkeypatch.chdir(bench)
    spoil(bench)
    before = sorted(bench.rglob("*"))
    code, out, complaint = run("identify", "mine.toml", *options.split())
    assert code == 2
    assert out == ""
    assert complaint.count("\n") == 1
    for words in said:
        assert words in complaint
    assert sorted(bench.rglob("*")) == before


def test_a_missing_description_is_one_line(tmp_path: Path, run: Run) -> None:
    code, _, complaint = run("identify", tmp_path / "mine.toml")
    assert code == 2
    assert complaint == (
        f"servo-models: cannot read '{tmp_path / 'mine.toml'}': {os.strerror(2)}; name a file that"
        " you may read\n"
    )


def test_outputs_are_tried_before_the_fit(
    bench: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError

    monkeypatch.setattr(sys.modules["servo_models.identification.identify"], "identify", never)
    assert run("identify", bench / "mine.toml", "--out", bench / "log.csv" / "P.toml")[0] == 2
