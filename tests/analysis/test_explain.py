"""Data sheets and pictures: complete, and true to the declarations."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import servo_models
from servo_models.actuators.torque_motor.variants import TABLE_1
from servo_models.analysis.demonstration import VISIBLE, demonstrate, portrait
from servo_models.analysis.explain import actuator_sheet, effect_name, explain, overview, places
from servo_models.analysis.pictures import save
from servo_models.catalogue import actuator, actuators, model
from servo_models.core.plant import Actuator
from servo_models.effects import effects
from servo_models.errors import UserError
from tests.conftest import Run
from tests.support.own_actuators import WITH_EFFECTS, write


def words(sheet: object) -> str:
    """A sheet as one line, so that line breaks do not matter."""
    return " ".join(str(sheet).split())


@pytest.mark.thorough
@pytest.mark.parametrize("name", actuators())
def test_an_actuator_sheet_has_all_parameters_signals_and_sources(name: str) -> None:
    sheet, actuator = explain(name), actuators()[name]
    cells = {row[0].rstrip("*") for table in sheet.tables for row in table.rows}
    parameters = actuator.plant.parameters.items()
    assert {name for name, it in parameters if it.owner != "residual_map"} <= cells
    assert {wire.name for wire in actuator.plant.inputs} | {*actuator.plant.outputs} <= cells
    (signals,) = (table for table in sheet.tables if table.title.startswith("Signals"))
    units = {row[0]: row[2] for row in signals.rows}
    wires = {name.rstrip("*"): actuator.plant.wire[name.rstrip("*")] for name in units}
    assert list(units.values()) == [it.display or it.unit for it in wires.values()]
    assert all(units.values())
    assert actuator.source in words(sheet)
    for variant in actuator.variants:
        assert variant.source in words(sheet)
        assert variant.warning in words(sheet)


@pytest.mark.parametrize("name", effects())
def test_an_effect_sheet_says_what_where_and_by_whom(name: str) -> None:
    text = words(explain(name))
    for block in effects()[name]:
        assert block.source in text
        assert all(f"{parameter}" in text for parameter in block.params)
    assert places(name)
    for place in places(name):
        for link in place.placements:
            assert f"{place.actuator.name} {place.name} {', '.join(link.on)}" in text


def test_values_stand_in_the_unit_a_person_reads() -> None:
    """The torque motor's stops are at 3 deg, its delay is 1.1 ms (valve paper)."""
    rows = {row[0]: row for table in explain("torque_motor").tables for row in table.rows}
    assert rows["end_stops.half_range*"][1] == "3"
    assert rows["end_stops.half_range*"][4] == "deg"
    assert rows["transport_delay.time*"][1] == "1.1"
    assert rows["transport_delay.time*"][4] == "ms"


def test_the_chain_shows_the_equations_that_run() -> None:
    rows = {row[0]: row for table in explain("sg90").tables for row in table.rows}
    asked = "potentiometer_gain * (command_angle + rest_angle)"
    assert rows["error"][1] == f"feedback_coefficient * ({asked} - feedback_voltage)"
    assert "Fig. 5" in rows["error"][2]
    assert rows["angle, rate"][1] == "shaft_angle, shaft_rate"


def test_a_variant_is_explained_with_its_own_values(run: Run, tmp_path: Path) -> None:
    """Table 1 of the valve paper."""
    (table,) = (
        it
        for it in explain("torque_motor", "measured").tables
        if it.title.startswith("Parameters, ")
    )
    rows = {row[0]: row for row in table.rows}
    for name in ("resistance", "torque_constant"):
        assert float(rows[name][1]) == pytest.approx(TABLE_1[name], rel=1e-5)
    drawn = tmp_path / "step.svg"
    code, out, _ = run("explain", "sg90", "--variant", "printed", "--picture", drawn)
    assert code == 0
    assert "Parameters, values of variant 'printed'" in out
    assert "variant printed" in drawn.read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["sg90", "--variant", "printd"], "did you mean 'printed'"),
        (["backlash", "--variant", "printed"], "'backlash' is an effect and has no variants"),
        (["delay"], "did you mean 'transport_delay' or"),
        (["friction"], "'coulomb_friction' or 'load_friction' or"),
        (["Dead Zone"], "did you mean 'dead_zone' or"),
        (["compliance"], "did you mean 'gear_compliance'?"),
    ],
)
def test_what_explain_does_not_know(words: list[str], said: str, run: Run) -> None:
    code, out, err = run("explain", *words)
    assert (code, out) == (2, "")
    assert said in err


def test_bounds_are_round_and_allowed() -> None:
    """0.2 rad are 11.459 deg; 11.46 deg would be refused."""
    rows = {row[0]: row for table in explain("smart_servo").tables for row in table.rows}
    assert rows["backlash.half_width*"][2:5] == ("0", "11", "deg")
    assert rows["sensor_nonlinearity.full_scale"][2:5] == ("5.8", "570", "deg")
    assert rows["sensor_offset.value*"][2:5] == ("-28", "28", "deg")
    model("smart_servo", None, {"backlash.half_width": "11 deg"})
    with pytest.raises(UserError, match=r"outside \[0, 11\] deg"):
        model("smart_servo", None, {"backlash.half_width": "12 deg"})


VARIANTS = [(found, it.name) for found in actuators().values() for it in found.variants]


def bounds_of(found: Actuator, variant: str | None) -> dict[str, Sequence[str]]:
    """Bounds and unit by parameter, as a sheet shows them."""
    tables = explain(found.name, variant).tables
    rows = [row for it in tables if it.title.startswith("Parameters") for row in it.rows]
    rows = [row for row in rows if row[2]]  # without those that are folded
    return {str(row[0]).rstrip("*"): [str(cell) for cell in row[2:5]] for row in rows}


@pytest.mark.parametrize(("found", "variant"), VARIANTS, ids=lambda it: getattr(it, "name", it))
def test_bounds_are_those_up_to_which_the_variant_takes_a_value(
    found: Actuator, variant: str
) -> None:
    """A share of 1 / 9 beyond, more than what rounding to two digits inside takes, is refused."""
    for name, (*bounds, unit) in bounds_of(found, variant).items():
        for bound, sign in zip(map(float, bounds), (-1.0, 1.0)):
            model(found, variant, {name: f"{bound:.6g} {unit}"})
            with pytest.raises(UserError, match="is outside"):
                model(found, variant, {name: f"{bound + sign * (abs(bound) / 9 + 1e-9)} {unit}"})


@pytest.mark.parametrize("found", actuators().values(), ids=actuators())
def test_a_shape_that_is_off_is_one_row_and_one_that_is_on_is_whole(found: Actuator) -> None:
    placed = [it for it in found.plant.parameters.values() if it.owner == "residual_map"]
    first = found.variants[0]
    learnt = replace(first, values={**first.values, placed[0].name: 1.0})
    sheets = (actuator_sheet(found), actuator_sheet(replace(found, variants=(learnt,))))
    rows = ([row for it in sheet.tables for row in it.rows] for sheet in sheets)
    off, on = ([row for row in each if str(row[0]).startswith("residual_map")] for each in rows)
    assert [row[0] for row in off] == ["residual_map*"]
    assert f"{len(placed)} parameters" in str(off[0][-1])
    assert [str(row[0]).rstrip("*") for row in on] == [it.name for it in placed]


def test_an_effect_sheet_says_of_which_variants_its_bounds_are() -> None:
    sheet = explain("backlash")
    (title,) = (it.title for it in sheet.tables if it.title.startswith("Parameters"))
    assert "first variant" in title
    shown = {row[0]: row[3:6] for row in sheet.tables[-1].rows}
    for found in actuators().values():
        assert [*map(str, shown[found.name])] == bounds_of(found, None)["backlash.half_width"]


def test_an_effect_is_drawn_on_an_actuator_without_a_load(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A plant of the catalogue may have its command as its only input."""
    alone = replace(actuator(str(write(tmp_path, changes=WITH_EFFECTS))), file=None)
    monkeypatch.setattr(
        sys.modules["servo_models.analysis.explain"], "actuators", lambda: {"joint": alone}
    )
    assert demonstrate("transport_delay").place.actuator is alone
    drawn = tmp_path / "delay.svg"
    save(portrait("transport_delay"), drawn)
    assert "transport_delay on joint" in drawn.read_text()


def test_a_placed_name_leads_to_its_effect() -> None:
    assert effect_name("drive_dead_zone") == "dead_zone"
    assert str(explain("drive_dead_zone")) == str(explain("dead_zone"))


def test_an_unknown_name_meets_the_nearest_one() -> None:
    with pytest.raises(UserError, match="did you mean 'hysteresis'"):
        explain("hysteresys")


def test_the_overview_counts_what_is_in_the_folders() -> None:
    folder = Path(servo_models.__file__).parent / "effects"
    files = {path.stem for path in folder.glob("*.py")} - {"__init__"}
    (table,) = (table for table in overview().tables if table.title == "Effects")
    assert {row[0] for row in table.rows} == files


def test_every_effect_can_be_seen() -> None:
    """In its demonstration; a winding warms up slowly, so its drift shows in the difference."""
    seen = {name: demonstrate(name).visibility for name in effects()}
    assert seen.pop("thermal_drift") > 1e-3
    assert min(seen.values()) > VISIBLE


def test_play_is_shown_where_no_loop_hunts() -> None:
    shown = demonstrate("backlash")
    angle = shown.changed[shown.signals[1]]
    assert np.ptp(angle[700:900]) < 0.01 * np.ptp(angle)  # the command rests


def test_a_demonstrated_delay_is_a_shift_in_time() -> None:
    shown = demonstrate("transport_delay")
    delay = float(shown.values.split()[2]) * {"ms": 1e-3, "s": 1.0}[shown.values.split()[3]]
    name = shown.signals[1]
    before, after = shown.without, shown.changed
    late = np.interp(before.times - delay, before.times, before[name])
    scale = np.ptp(before[name])
    assert math.isclose(float(np.max(np.abs(after[name] - late))) / scale, 0.0, abs_tol=0.01)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["torque_motor", "backlash"])
@pytest.mark.parametrize("suffix", [".svg", ".png", ".pdf"])
def test_pictures_are_written_alike_each_time(name: str, suffix: str, tmp_path: Path) -> None:
    first, second = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
    for path in (first, second):
        save(portrait(name), path)
    assert first.read_bytes() == second.read_bytes()


def test_every_curve_of_a_picture_has_its_unit() -> None:
    titles = [axes.get_title(loc="left") for axes in portrait("torque_motor").axes]
    assert titles == [
        "voltage [V]",
        "angle [deg]",
        "rate [deg/s]",
        "current [mA]",
        "motor torque [N.m]",
    ]
