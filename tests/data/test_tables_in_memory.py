"""Logs without a file: what is measured in memory is what a file of it says."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import servo_models as sm
from servo_models.errors import UserError
from tests.support.document import ROOT

EXAMPLE = ROOT / "examples" / "two_csv_files"
COLUMNS = {
    "time": ("time_ms", "ms"),
    "pulse_width": ("pulse_us", "us"),
    "angle": {"column": "angle_deg", "unit": "deg"},
}
FREE = (
    "motor_time_constant",
    "motor_gain",
    "amplifier_gain",
    "potentiometer_gain",
    "transport_delay.time",
)


def frame(name: str) -> pl.DataFrame:
    return pl.read_csv(EXAMPLE / f"{name}.csv")


def described(
    table: Callable[[pl.DataFrame], Any] = lambda frame: frame, **options: Any
) -> sm.Description:
    options = {"free": FREE, "each": {"flight": {"held_out": True}}} | options
    logs = {name: table(frame(name)) for name in ("steps", "flight")}
    return sm.describe(sm.model("sg90", "measured"), logs, COLUMNS, **options)


def arrays(table: pl.DataFrame) -> dict[str, np.ndarray[Any, Any]]:
    return {name: table[name].to_numpy() for name in table.columns}


def pandas(table: pl.DataFrame) -> Any:
    return pytest.importorskip("pandas").DataFrame(arrays(table))


@pytest.mark.parametrize("table", [lambda frame: frame, arrays, pandas])
def test_a_table_is_read_as_its_file(table: Callable[[pl.DataFrame], Any]) -> None:
    own, other = described(table), sm.read_description(EXAMPLE / "description.toml")
    assert own.free == other.free
    assert own.uncertainty == other.uncertainty
    assert own.model.values == other.model.values
    for log, same in zip(own.logs, other.logs, strict=True):
        assert log.name == same.name
        np.testing.assert_array_equal(log.times, same.times)
        np.testing.assert_array_equal(log.inputs["pulse_width"], same.inputs["pulse_width"])
        np.testing.assert_array_equal(log.outputs["angle"], same.outputs["angle"])
        np.testing.assert_array_equal(log.held_out, same.held_out)
        assert (log.settle, log.begin) == (same.settle, same.begin)
    assert own.logs[0].sha256 != own.logs[1].sha256


def test_an_identification_is_that_of_the_file() -> None:
    found = sm.identify(described(free=["motor_gain"])).result
    other = sm.identify(EXAMPLE / "description.toml", free=["motor_gain"]).result
    assert found.values == other.values
    assert found.standard_errors == other.standard_errors


def test_a_check_is_that_of_the_file() -> None:
    found, other = sm.check(described()), sm.check(EXAMPLE / "description.toml")
    assert found.floors == other.floors
    assert repr(found.identifiability) == repr(other.identifiability)
    assert found.warnings == other.warnings


def test_a_diagnosis_is_that_of_the_file(tmp_path: Path) -> None:
    """No effect is left to try, so that it ends soon."""
    chosen = sm.model("torque_motor", "measured")
    times = np.arange(0.0, 0.4, 1e-3)
    command = np.where(times < 0.05, 0.0, np.where(times < 0.2, 10.0, -10.0))
    angle = 1.05 * sm.simulate(chosen, times, {"voltage": command})["angle"]
    noise = 1e-5 * np.random.default_rng(3).standard_normal(len(times))
    log = {"t": times, "u": command, "angle": angle + noise}
    pl.DataFrame(log).write_csv(tmp_path / "log.csv")
    (tmp_path / "log.toml").write_text(
        'actuator = "torque_motor"\nvariant = "measured"\n'
        'uncertainty = { torque_constant = "10 %" }\n'
        '[[logs]]\nfile = "log.csv"\ntime = "t"\n'
        'inputs.voltage = "u"\noutputs.angle = "angle"\n'
    )
    own = sm.describe(
        chosen,
        {"log": log},
        {"time": "t", "voltage": "u", "angle": "angle"},
        uncertainty={"torque_constant": "10 %"},
    )
    none = tuple(chosen.plant.placements)
    found, other = (sm.diagnose(it, left_out=none) for it in (own, tmp_path / "log.toml"))
    assert found.verdict.kind == other.verdict.kind
    assert found.gap == other.gap
    assert found.moved == other.moved


def test_one_log_may_state_more_than_the_others() -> None:
    chosen = sm.model("torque_motor", "measured")
    times = np.arange(0.0, 1.0, 1e-2)
    log = {"t": times, "u": np.sin(times), "angle": times}
    found = sm.describe(
        chosen,
        {"bare": log, "loaded": log},
        {"time": "t", "voltage": {"column": "u", "sign": -1}, "angle": ("angle", "deg")},
        each={"loaded": {"constants": {"load_torque": "5 mN.m"}, "window": (0.2, np.float64(0.8))}},
        bounds={"inductance": (25.0, "40 H")},
    )
    bare, loaded = found.logs
    np.testing.assert_array_equal(bare.inputs["voltage"], -np.sin(times))
    assert bare.constants == {}
    assert loaded.constants == {"load_torque": 5e-3}
    assert loaded.begin == pytest.approx(0.2)
    assert loaded.duration == pytest.approx(0.6)
    assert found.bounds == {"inductance": (25.0, 40.0)}


def complaint(table: Any = None, columns: Any = None, **options: Any) -> str:
    times = np.arange(0.0, 1.0, 1e-2)
    log = {"t": times, "u": np.sin(times), "angle": times} | (table or {})
    chosen = {"time": "t", "voltage": "u", "angle": "angle"} | (columns or {})
    with pytest.raises(UserError) as caught:
        sm.describe("torque_motor", {"bare": log}, chosen, **options)
    return str(caught.value)


def test_faults_name_log_row_and_column() -> None:
    rows = np.arange(0.0, 1.0, 1e-2)
    gap = np.where(rows == rows[7], np.nan, rows)
    assert "'bare', row 7, column 'angle'" in complaint({"angle": gap})
    assert "'bare' has no column 'angel'; did you mean 'angle'" in complaint(
        columns={"angle": "angel"}
    )
    assert "unknown signal 'angel' in columns; did you mean 'angle'" in complaint(
        columns={"angel": "angle"}
    )
    assert "columns, 'angle': give a header and a unit" in complaint(columns={"angle": ("a",)})
    assert "column 'angle' has shape (100, 1)" in complaint({"angle": rows[:, None]})
    assert "'bare', column 'u' has 99 rows, the time 100" in complaint({"u": rows[:99]})
    assert "'torque_motor', logs[1].outputs.angle.unit" in complaint(
        columns={"angle": ("angle", "V")}
    )
    assert "unknown log 'bear' in each; did you mean 'bare'" in complaint(each={"bear": {}})
    assert "'torque_motor', logs[1].held: unknown key 'held'" in complaint(
        each={"bare": {"held": True}}
    )
    assert "'torque_motor', uncertainty.inertai: unknown parameter" in complaint(
        uncertainty={"inertai": 1.0}
    )
