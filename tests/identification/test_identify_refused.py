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


def cut(count: int) -> Callable[[Path], None]:
    return lambda folder: write_log(folder, rows_of()[:count])


def still(folder: Path) -> None:
    """The command is 5 V all along, and the reading is noise: the motor has settled."""
    write_log(folder, [[t, "5", f"0.{5 + i * i % 3}"] for i, (t, *_) in enumerate(rows_of())])


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
        (cell(8, 1, "inf"), "", ["log.csv", "row 8", "column 'u'", "not finite"]),
        (cell(8, 2, "off"), "", ["log.csv", "row 8", "'angle_deg'", "'off' is not a number"]),
        (cell(8, 2, ""), "", ["log.csv", "row 8", "'angle_deg'", "is empty", "fill"]),
        (cell(8, 0, "2.4"), "", ["log.csv", "row 8", "'time_ms'", "runs backward", "sort"]),
        (cell(8, 0, "2.5"), "", ["log.csv", "row 8", "'time_ms'", "repeats", "remove"]),
        (still, "", ["no input ever changes", "record a command that moves"]),
        (constant, "", ["log.csv", "'angle_deg'", "constant", "leave it out"]),
        (cut(9), "", ["log.csv", "9 samples", "at least", "record longer"]),
        (changed('"0.5 s", to', '"1 ms", to'), "", ["2 samples to fit for 3", "hold out less"]),
        (changed('unit = "deg"', 'unit = "V"'), "", ["outputs.angle.unit", "'V'", "unit like rad"]),
        (changed('unit = "deg"', 'unit = "dge"'), "", ["outputs.angle.unit", "'dge'"]),
        (changed('unit = "V"', 'unit = "kV"'), "", ["row 2", "'u'", "outside", "unit and scale"]),
        (changed('"angle_deg"', '"angle"'), "", ["log.csv", "'angle'", "did you mean 'angle_deg'"]),
        (changed('"log.csv"', '"lag.csv"'), "", ["logs[1].file", "no file", "lag.csv"]),
        (changed("[[logs]]", "[[log]]"), "", ["mine.toml", "'log'", "did you mean 'logs'"]),
        (changed("[parameters]", "[parameters"), "", ["mine.toml", "line 5", "correct"]),
        (changed('"inductance"', '"inductanse"'), "", ["free", "did you mean 'inductance'"]),
        (changed("end_stops.half", "end_stop.half"), "", ["mine.toml", "end_stop"]),
        (changed('"measured"', '"mesured"'), "", ["mine.toml", "did you mean 'measured'"]),
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
