"""Parameter files: what is written is read back to the last bit; every fault has its key."""

from __future__ import annotations

import datetime
import math
from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servo_models.build import build
from servo_models.catalogue import actuator
from servo_models.cli import main
from servo_models.data.log import Log, hashes
from servo_models.data.parameters import (
    Estimate,
    FitFigure,
    ParameterSet,
    read_parameters,
    write_parameters,
)
from servo_models.errors import UserError

PLANT = actuator("torque_motor").plant
FULL = ParameterSet(
    actuator="torque_motor",
    variant="measured",
    estimates=(
        Estimate("torque_constant", 5.2277, 0.012, "estimated"),
        Estimate("transport_delay.time", 0.0011, math.inf, "estimated"),
        Estimate("stiffness", 1.1),
    ),
    method="simulation error, least squares",
    logs={"step.csv": "sha256:0a", "a folder/sweep 2.csv": "sha256:0b"},
    date=datetime.date(2026, 1, 31),
    version="0.2.0",
    figures={"rms": FitFigure(0.011, "deg"), "fit": FitFigure(0.97)},
    warnings=("stiffness: not excited by 'step.csv'",),
)


def bounded(name: str) -> st.SearchStrategy[float]:
    param = PLANT.parameters[name].param
    return st.floats(param.low, param.high)


@given(
    value=st.sampled_from(list(PLANT.parameters)).flatmap(
        lambda name: st.tuples(st.just(name), bounded(name))
    ),
    error=st.none() | st.floats(0.0, allow_nan=False),
)
def test_values_come_back_to_the_last_bit(
    value: tuple[str, float], error: float | None, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "one.toml"
    chosen = ParameterSet("torque_motor", "measured", (Estimate(*value, error),))
    write_parameters(chosen, path)
    assert read_parameters(path) == chosen


def test_everything_comes_back(tmp_path: Path) -> None:
    write_parameters(FULL, tmp_path / "new" / "full.toml")
    assert read_parameters(tmp_path / "new" / "full.toml") == FULL


def test_numbers_of_numpy_are_numbers(tmp_path: Path) -> None:
    found = Estimate("torque_constant", np.float64(5.1), np.float64(0.1), "estimated")
    write_parameters(ParameterSet("torque_motor", "measured", (found,)), tmp_path / "a.toml")
    assert read_parameters(tmp_path / "a.toml").settings() == {"torque_constant": 5.1}


def test_the_file_reads_like_a_data_sheet(tmp_path: Path) -> None:
    """3 deg are written as 3 deg, where that is the same number."""
    stops = Estimate("end_stops.half_range", math.radians(3.0))
    write_parameters(ParameterSet("torque_motor", "measured", (stops,)), tmp_path / "a.toml")
    text = (tmp_path / "a.toml").read_text()
    assert '[parameters.end_stops.half_range]\nvalue = 3.0\nunit = "deg"\n' in text


@pytest.mark.parametrize(
    "text",
    [
        '[parameters.transport_delay.time]\nvalue = 1.1\nunit = "ms"',
        '["parameters"."transport_delay.time"]\nvalue = 1.1\nunit = "ms"',
        'parameters.transport_delay.time = { value = 1100, unit = "us" }',
        '[parameters]\n"transport_delay.time" = { value = 0.0011, unit = "s" }',
    ],
)
def test_a_person_may_write_a_name_in_every_way_of_toml(tmp_path: Path, text: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'actuator = "torque_motor"\n{text}\n')
    found = read_parameters(path)
    assert found.settings()["transport_delay.time"] == pytest.approx(1.1e-3, rel=1e-15)
    assert found.variant == actuator("torque_motor").default_variant


HEAD = 'actuator = "torque_motor"\n'
TORQUE = HEAD + "[parameters.torque_constant]\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "actuator: missing"),
        ("actuator = 3", "actuator: no text"),
        ('actuator = "sg9"', "did you mean 'sg90'?"),
        (HEAD + 'variant = "measurd"', "variant: unknown variant 'measurd'"),
        (HEAD + "methode = 3", "did you mean 'method'?"),
        (HEAD + 'date = "2026-01-31"', "date: no day"),
        (HEAD + "date = 2026-01-31T10:00:00", "date: no day"),
        (HEAD + 'warnings = "none"', "warnings: no list"),
        (HEAD + "logs = 3", "logs: no table"),
        (HEAD + "[logs]\na = 3", "logs.a: no text"),
        (HEAD + "value = \nb = 1", "line 2"),
        (HEAD + "[parameters]\ntorque_constant = 5", "parameters.torque_constant: no table"),
        (HEAD + "[parameters.torque_constnt]\nvalue = 5", "did you mean 'torque_constant'?"),
        (HEAD + "[parameters.backlash.half]\nvalue = 5", "unknown parameter 'backlash.half'"),
        (TORQUE + "value = 5", 'add unit = "N.m/A"'),
        (TORQUE + 'value = 5\nunit = "N.m"', "unit 'N.m' does not convert to 'N.m/A'"),
        (TORQUE + 'value = 5\nunit = "parsec per"', "unknown unit"),
        (
            TORQUE + 'value = "5"\nunit = "N.m/A"',
            "torque_constant.value: no number; write for example value",
        ),
        (TORQUE + 'value = true\nunit = "N.m/A"', "value: no number"),
        (TORQUE + 'value = nan\nunit = "N.m/A"', "value: nan is not finite"),
        (TORQUE + 'value = -1\nunit = "N.m/A"', "is outside ["),
        (TORQUE + f'value = 1{400 * "0"}\nunit = "N.m/A"', "value: an integer beyond 64 bits"),
        (TORQUE + 'unit = "N.m/A"', "value: missing"),
        (
            TORQUE + 'value = 5\nunit = "N.m/A"\nstandard_error = -1',
            "standard_error: -1 is out of range",
        ),
        (TORQUE + 'value = 5\nunit = "N.m/A"\nstandart_error = 1', "did you mean 'standard_error'"),
        (HEAD + '[figures.rms]\nvalue = "1"', "figures.rms.value: no number"),
        (
            HEAD + 'parameters.backlash.half_width = { value = 0, unit = "deg" }\n'
            'parameters."backlash.half_width" = { value = 0, unit = "deg" }',
            "given twice",
        ),
    ],
)
def test_a_fault_is_told_in_one_line_with_file_and_key(
    tmp_path: Path, text: str, said: str
) -> None:
    path = tmp_path / "broken.toml"
    path.write_text(text)
    with pytest.raises(UserError) as caught:
        read_parameters(path)
    message = str(caught.value)
    assert message.startswith(f"'{path}'")
    assert said in message
    assert "\n" not in message


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="cannot read"):
        read_parameters(tmp_path / "absent.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UserError, match="UTF-8"):
        read_parameters(tmp_path / "binary.toml")
    with pytest.raises(UserError, match=r"end in \.toml"):
        write_parameters(FULL, tmp_path / "full.json")


def test_what_could_not_be_read_is_not_written(tmp_path: Path) -> None:
    for name, value in (("torque_constnt", 1.0), ("torque_constant", -1.0)):
        wrong = ParameterSet("torque_motor", "measured", (Estimate(name, value),))
        with pytest.raises(UserError):
            write_parameters(wrong, tmp_path / "wrong.toml")
    assert list(tmp_path.iterdir()) == []


def test_a_parameter_set_is_a_model() -> None:
    chosen = FULL.model({"resistance": "4 kOhm"})
    nominal = actuator("torque_motor").values("measured")
    changed = {"torque_constant": 5.2277, "transport_delay.time": 0.0011, "resistance": 4000.0}
    assert chosen.values == {**nominal, **changed}
    assert "simulation error, least squares; 2026-01-31; then set: resistance" in chosen.provenance


def test_an_fmu_starts_from_the_file_and_says_so(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    write_parameters(FULL, file)
    words = ["build", "--params", str(file), "--set", "stiffness=1.2", "--out", str(tmp_path)]
    assert main(words) == 0
    found = fmpy.read_model_description(str(tmp_path / "torque_motor_measured.fmu"))
    start = {v.name: float(v.start) for v in found.modelVariables if v.causality == "parameter"}
    assert start == read_parameters(file).model({"stiffness": 1.2}).values
    assert "mine.toml; simulation error, least squares; 2026-01-31" in found.description
    assert "then set: stiffness" in found.description


def test_a_file_builds_the_same_bytes_again(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    write_parameters(FULL, file)
    made = [build(read_parameters(file).model(), tmp_path / name) for name in ("a.fmu", "b.fmu")]
    assert made[0].read_bytes() == made[1].read_bytes()


def test_commands_take_the_file_in_place_of_a_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The static gain K_t / (R K_s) is that of the file."""
    file = tmp_path / "mine.toml"
    write_parameters(FULL, file)
    assert main(["simulate", "--params", str(file), "--step", "voltage=10", "--stop", "1"]) == 0
    out = capsys.readouterr().out
    final = next(line for line in out.splitlines() if line.startswith("final value"))
    gain = 5.2277 / (3630.0 * 1.1)
    assert float(final.split()[-2]) == pytest.approx(math.degrees(10.0 * gain), rel=1e-3)
    assert "mine.toml" in out
    assert main(["explain", "--params", str(file)]) == 0
    out = capsys.readouterr().out
    for said in ("5.228 +- ", "6.432", "sha256:0a", "not excited", "0.011 deg"):
        assert said in out


def test_logs_of_one_name_keep_both_hashes() -> None:
    rows = np.arange(2)
    empty = Log("log", Path(), "", 1.0 * rows, {}, {}, {}, rows, rows < 0)
    paths = ("a/log.csv", "b/log.csv", "b/log.csv", "b/other.csv")
    logs = [replace(empty, path=Path(path), sha256=path) for path in paths]
    names = ("a/log.csv", "b/log.csv", "other.csv")
    assert hashes(logs) == dict(zip(names, ("a/log.csv", "b/log.csv", "b/other.csv")))
