"""A parameter that is far from what is believed is told as itself, and as no effect beside it."""

from __future__ import annotations

from pathlib import Path

import pytest

from servo_models.core.simulate import model
from servo_models.data.description import Description
from servo_models.data.schema import Section
from servo_models.diagnosis import summary
from servo_models.diagnosis.diagnose import diagnose
from servo_models.diagnosis.verdict import EFFECT, PARAMETERS
from servo_models.identification.identify import identify
from studies.far_parameters import BELIEVED, NOISE, TIMES, goals
from tests.support.logs import changed, measured


def told(true: dict[str, float]) -> Description:
    """A description of the nominal servo, with a log of one that has other values [SI]."""
    nominal, path = model("second_order_servo", "bus"), Path("rig.toml")
    log = measured(changed(nominal, true), TIMES, {"goal": goals()}, {"angle": NOISE})
    return Description(path, Section(path, "", {}), nominal, {}, BELIEVED, (log,))


@pytest.mark.thorough
@pytest.mark.parametrize("delay", [0.030, 0.045])
def test_a_late_servo_is_late_and_has_no_soft_gear(delay: float) -> None:
    found = diagnose(told({"transport_delay.time": delay}), jobs=1)
    assert found.verdict.kind == PARAMETERS
    assert found.selection.taken is found.selection.retuned  # so that what it masks is sought
    values = {one.name: one for one in found.found}
    late = values["transport_delay.time"]
    assert abs(late.value - delay) < 4.0 * late.standard_error
    assert f"'transport_delay.time' is {1e3 * late.value:.3g} ms, not 5 ms" in summary.sentence(
        found
    )
    assert summary.moves(found)["transport_delay.time"] == pytest.approx(
        (late.value - 5e-3) / BELIEVED["transport_delay.time"]
    )


@pytest.mark.thorough
@pytest.mark.parametrize(
    "effect",
    [
        {"backlash.half_width": 0.02},
        {"command_gain.error": 0.03},
        {"constant_load.torque": 0.06},
        {"sensor_lag.time_constant": 0.01},
        {"direction_asymmetry.ratio": 0.03},
    ],
    ids=lambda effect: next(iter(effect)),
)
def test_an_effect_beside_a_far_parameter_is_named(effect: dict[str, float]) -> None:
    """Soft gear and a rate limit together would imitate the delay beside most of them."""
    rig = {"transport_delay.time": 0.030, **effect}
    found = diagnose(told(rig), jobs=1)
    assert found.verdict.kind == EFFECT
    assert found.selection.taken.effects == (next(iter(effect)).partition(".")[0],)
    values = {one.name: one for one in found.found}
    for name, true in rig.items():
        assert abs(values[name].value - true) < 4.0 * values[name].standard_error, name
    assert "'transport_delay.time' is 30" in summary.sentence(found)


def test_an_identified_value_leaves_a_prior_that_was_wrong() -> None:
    """With its prior it would be pulled to 25.7 ms, and believed to 0.55 ms."""
    found = identify(told({"transport_delay.time": 0.030})).result
    place = [free.name for free in found.free].index("transport_delay.time")
    assert abs(found.values[place] - 0.030) < 4.0 * found.standard_errors[place]
    assert found.believable
    assert found.report().sentence.startswith("'transport_delay.time' is 30 ms, not 5 ms; ")


def test_an_identified_value_beyond_any_prior_is_not_believed() -> None:
    found = identify(told({"transport_delay.time": 0.100})).result
    assert not found.believable
    assert "'transport_delay.time'" in found.report().sentence


def test_a_value_that_is_believed_is_no_surprise() -> None:
    found = identify(told({"transport_delay.time": 0.008})).result
    assert all(free.widened == 1.0 for free in found.free)
    assert not found.report().sentence.startswith("'")
