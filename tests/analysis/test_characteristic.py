"""Characteristics of effects, beside the formulas of textbooks."""

from __future__ import annotations

import numpy as np
import pytest

from servo_models.analysis.characteristic import Characteristic, characteristic
from servo_models.analysis.demonstration import portrait
from servo_models.analysis.live import explained
from servo_models.catalogue import model


def law_of(actuator: str, effect: str, **values: float) -> Characteristic | None:
    chosen = model(actuator, None, {f"{effect}.{key}": value for key, value in values.items()})
    return characteristic(chosen.plant, chosen.values, effect)


def law(actuator: str, effect: str, **values: float) -> Characteristic:
    found = law_of(actuator, effect, **values)
    assert found
    return found


def test_a_dead_zone_and_a_saturation() -> None:
    dead = law("dc_motor", "drive_dead_zone", half_width=2.0)
    excess = np.maximum(np.abs(dead.given) - 2.0, 0.0)
    np.testing.assert_allclose(dead.found, np.sign(dead.given) * excess, atol=1e-12)
    assert np.abs(dead.given).max() > 2.0
    limited = law("dc_motor", "drive_saturation", limit=6.0)
    np.testing.assert_allclose(limited.found, np.clip(limited.given, -6.0, 6.0), atol=1e-12)
    assert np.abs(limited.given).max() > 6.0


def test_a_limit_by_what_the_effect_reads() -> None:
    """An SG90 on 5 V."""
    limited = law("sg90", "supply_limit", share=1.0)
    np.testing.assert_allclose(limited.found, np.clip(limited.given, -5.0, 5.0), atol=1e-12)
    assert np.abs(limited.given).max() > 5.0


def test_backlash_is_a_loop_as_wide_as_the_play() -> None:
    loop = law("sg90", "backlash", half_width=0.02)
    down, up = np.array_split(np.column_stack([loop.given, loop.found]), 2)
    for level in (-0.02, 0.0, 0.02):
        there, back = (
            np.interp(-level, -down[:, 1], down[:, 0]),
            np.interp(level, up[:, 1], up[:, 0]),
        )
        assert back - there == pytest.approx(0.04, abs=1e-3)


def test_hysteresis_is_a_loop_that_ends_where_it_began() -> None:
    """Far from a reversal the branches are two half widths apart."""
    loop = law("sg90", "hysteresis", half_width=0.5, turn=0.05)
    down, up = loop.found[:801], loop.found[800:]
    assert (up[::-1] - down)[400] == pytest.approx(-1.0, rel=0.01)
    assert loop.found[-1] == pytest.approx(loop.found[0], rel=1e-3)


def test_friction_is_a_force_over_speed() -> None:
    coulomb = law("sg90", "coulomb_friction", level=0.02)
    np.testing.assert_allclose(coulomb.found, 0.02 * np.sign(coulomb.given), atol=1e-12)
    assert coulomb.over.name == "shaft_speed"
    stribeck = law("dc_motor", "stribeck_friction", excess=0.01, speed=0.1)
    ratio = stribeck.given / (0.1 * model("dc_motor").values["rated_speed"])
    expected = 0.01 * np.sign(ratio) * np.exp(-(ratio**2))
    np.testing.assert_allclose(stribeck.found, expected, atol=1e-12)
    loaded = law("sg90", "load_friction", coefficient=0.1)
    assert loaded.found.max() == pytest.approx(0.1 * 0.18)  # of the full scale of the load


def test_what_an_effect_adds_over_an_angle() -> None:
    added = law("sg90", "gravity_load", torque=0.05)
    np.testing.assert_allclose(added.found, 0.05 * np.sin(added.given), atol=1e-12)
    assert (added.over.name, added.wire.name) == ("angle", "load")


@pytest.mark.parametrize(
    "name", ["transport_delay", "rate_limit", "sample_hold", "end_stops", "gear_compliance"]
)
def test_no_characteristic_where_time_counts_or_nothing_moves(name: str) -> None:
    assert law_of("dc_motor", name) is None


def test_an_effect_is_drawn_as_in_textbooks_first() -> None:
    assert explained("backlash").sections[0].title == "Characteristic"
    assert explained("transport_delay").sections[0].title == "Drive it"
    first, *others = portrait("backlash").axes
    assert first.get_xlabel() == "angle [deg]"
    assert others[-1].get_xlabel() == "time [s]"
    assert len(portrait("transport_delay").axes) == len(others)
