"""A parameter that is far from what is believed is told as itself, and as no effect beside it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from servo_models.catalogue import model
from servo_models.data.description import Description
from servo_models.data.schema import Section
from servo_models.identification.identify import identify
from studies.far_parameters import BELIEVED, NOISE, TIMES, goals
from tests.support.logs import changed, measured


def told(true: dict[str, float]) -> Description:
    """A description of the nominal servo, with a log of one that has other values [SI]."""
    nominal, path = model("second_order_servo", "bus"), Path("rig.toml")
    log = measured(changed(nominal, true), TIMES, {"goal": goals()}, {"angle": NOISE})
    return Description(path, Section(path, "", {}), nominal, {}, BELIEVED, (log,))


def test_an_identified_value_leaves_a_prior_that_was_wrong() -> None:
    """With its prior it would be pulled to 25.7 ms, and believed to 0.55 ms."""
    found = identify(told({"transport_delay.time": 0.030})).result
    place = [free.name for free in found.free].index("transport_delay.time")
    assert abs(found.values[place] - 0.030) < 4.0 * found.standard_errors[place]
    assert found.believable
    assert found.report().sentence.startswith("'transport_delay.time' is 30 ms, not 5 ms; ")
    moved = abs(found.values[place] - found.free[place].nominal)
    for errors, now in ((2.9, ""), (3.1, "30 ms,"), (math.nan, "30 ms (on its low bound),")):
        wide = found.standard_errors.copy()
        wide[place] = moved / errors
        said = replace(found, standard_errors=wide).report().sentence
        assert (f"'transport_delay.time' is {now}" in said) is bool(now)


def test_an_identified_value_beyond_any_prior_is_not_believed() -> None:
    found = identify(told({"transport_delay.time": 0.100})).result
    assert not found.believable
    assert "'transport_delay.time'" in found.report().sentence


def test_a_value_that_is_believed_is_no_surprise() -> None:
    found = identify(told({"transport_delay.time": 0.008})).result
    assert all(free.widened == 1.0 for free in found.free)
    assert not found.report().sentence.startswith("'")
