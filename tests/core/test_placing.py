"""How an actuator lists its effects: by name on a wire, as if each were placed by hand."""

from __future__ import annotations

from dataclasses import replace

import pytest

from servo_models.core.catalogue import effects_on
from servo_models.core.plant import place
from servo_models.effects.backlash import backlash
from servo_models.effects.dead_zone import dead_zone
from servo_models.effects.rate_limit import rate_limit
from servo_models.effects.torque_saturation import torque_saturation


def test_a_name_ends_with_its_effect_and_the_longest_one_counts() -> None:
    assert effects_on("drive", "drive_dead_zone", "torque_saturation") == (
        place("drive_dead_zone", dead_zone, "drive"),
        place("torque_saturation", torque_saturation, "drive"),
    )


def test_an_effect_on_two_wires_gets_both() -> None:
    assert effects_on(("angle", "rate"), "backlash") == (
        place("backlash", backlash, "angle", "rate"),
    )


def test_only_the_parameter_that_is_changed_is_another() -> None:
    changed = replace(rate_limit.params["rate"], typical=2.0)
    assert effects_on("drive", "dead_zone", "rate_limit", rate={"typical": 2.0}) == (
        place("dead_zone", dead_zone, "drive"),
        place("rate_limit", rate_limit, "drive", params={"rate": changed}),
    )


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("wobble",), "'wobble' ends with the name of no effect"),
        (("xdead_zone",), "'xdead_zone' ends with the name of no effect"),
        (("gear_compliance",), "'gear_compliance' has several functions"),
        (("dead_zone",), "no effect among dead_zone has a parameter 'rate'"),
    ],
)
def test_what_no_name_tells_is_refused(names: tuple[str, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        effects_on("drive", *names, rate={"typical": 2.0})
