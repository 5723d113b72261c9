"""Bounds of effects follow the full scales of a plant; those of the catalogue stay as they were."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servo_models.catalogue import actuator, all_actuators
from servo_models.core.block import Param, block, effect
from servo_models.core.plant import Parameter, Plant, Wire, place
from servo_models.effects import effects, effects_on
from servo_models.effects.backlash import backlash
from servo_models.effects.dead_zone import dead_zone
from servo_models.effects.gear_compliance import compliant_output
from servo_models.effects.rate_limit import rate_limit
from servo_models.effects.torque_saturation import torque_saturation
from servo_models.units import exponents

CATALOGUE = {
    # effect and parameter: unit, low, high, typical or default [SI], in every plant
    ("transport_delay", "time"): ("s", 0.0, 2.0, 0.005),
    ("lag", "time_constant"): ("s", 0.0, 1.0, 0.01),
    ("sample_hold", "period"): ("s", 0.0, 0.1, 0.02),
    ("gear_compliance", "compliance"): ("rad/(N.m)", 0.0, 1.0, 0.2),
    ("gear_compliance", "inertia"): ("kg.m2", 1e-9, 1.0, 1e-3),
    ("stiffness_hardening", "coefficient"): ("1/rad2", -200.0, 1000.0, 100.0),
    ("flux_saturation", "inverse_current"): ("1/A", 0.0, 500.0, 50.0),
    ("flux_saturation", "curvature"): ("1/rad2", -100.0, 100.0, 30.0),
    ("coasting_backlash", "half_width"): ("rad", 0.0, 0.2, 0.01),
}
"""What the effects' files held in SI before their bounds were fractions of full scales."""
BEFORE = ("sg90", "torque_motor", "linear_drive", "smart_servo")
"""Actuators that there were then; later ones follow their own scales."""
RESIZED = ("sts3215", "sts3215_12v")  # variants whose loads are sized by their own torque since
PRODUCTS = {
    ("torque_motor", "transport_delay.time"): ("s", 0.0, 0.02, 0.0011),
    ("torque_motor", "sample_hold.period"): ("s", 0.0, 0.02, 0.001),
    ("torque_motor", "gear_compliance.compliance"): ("rad/(N.m)", 0.0, 5.0, 1.0),
    ("torque_motor", "gear_compliance.inertia"): ("kg.m2", 1e-8, 1e-4, 1e-6),
    ("torque_motor", "supply_sag.resistance"): ("Ohm", 0.0, 1e3, 100.0),
    ("sg90", "supply_sag.resistance"): ("Ohm", 0.0, 50.0, 1.0),
    ("smart_servo", "supply_sag.resistance"): ("Ohm", 0.0, 20.0, 0.5),
    ("linear_drive", "transport_delay.time"): ("s", 0.0, 0.02, 0.001),
}
"""What a plant had instead."""


def bounds(parameter: Parameter) -> tuple[str, float, float, float]:
    """Unit, bounds, and the typical value or else the default [SI]."""
    param = parameter.param
    return param.unit, param.low, param.high, param.typical or param.default


def test_the_bounds_of_the_catalogue_are_those_before() -> None:
    """To the last bit, so all results are."""
    compared = set()
    for product in all_actuators().values():
        name = product.name.removesuffix("_torque")
        if name not in BEFORE:
            continue
        for variant in product.variants:
            if variant.name in RESIZED:
                continue
            plant = product.plant_of(variant.name)
            for effect_name, placements in plant.placements.items():
                for key in (key for link in placements for key in link.effect.params):
                    kind = placements[0].effect
                    file = next(f for f, functions in effects().items() if kind in functions)
                    full = f"{effect_name}.{key}"
                    own = PRODUCTS.get((name, full)) or CATALOGUE.get((file, key))
                    if own:
                        assert bounds(plant.parameters[full]) == own, (product.name, full)
                        compared.add((name, full))
    assert set(PRODUCTS) <= compared
    assert len(compared) >= len(PRODUCTS) + len(CATALOGUE)


def test_rate_limits_of_the_catalogue_are_those_before() -> None:
    for name, typical in (("sg90", 20.0), ("linear_drive", 20.0), ("torque_motor", 20.0)):
        plant = actuator(name).plant
        scale = plant.wire[plant.main_wire("rate_limit")].scale
        param = plant.parameters["rate_limit.rate"].param
        assert (param.high, param.typical) == (1e4 * scale, typical * scale)


@effect("signal", source="a test")
def spring(
    signal: float,
    shaft_angle: float,
    load: float,
    twist: Annotated[
        float, Param("{shaft_angle}/{load}", "", low=0.1, high=3.0, switch=True, typical=0.5)
    ],
    bend: Annotated[float, Param("1/{shaft_angle}2", "", high=2.0)],
    rate: Annotated[float, Param("signal/{time}", "", high=4.0)],
    delay: Annotated[float, Param("{time}", "", high=5.0, typical=0.5)],
) -> float:
    """A parameter of each kind."""
    return signal + twist * load * (1.0 + bend * shaft_angle) + rate * delay


def plant_of(angle: float, load: float, speed: float, time: float) -> Plant:
    return Plant(
        inputs=(Wire("shaft_angle", "rad", "", angle), Wire("force", "N.m", "", load)),
        wires=(Wire("speed", "rad/s", "", speed, display="deg/s"),),
        chain=(given_speed, place("spring", spring, "speed", load="force")),
        states=(),
        outputs=("speed",),
        constants={"internal_step": Param("s", "", default=1e-3)},
        time_scale=time,
    )


@block("speed")
def given_speed(shaft_angle: float) -> float:
    """Some signal."""
    return shaft_angle


scale = st.floats(1e-9, 1e9)


@given(scale, scale, scale, scale)
def test_bounds_follow_the_full_scales(
    angle: float, load: float, speed: float, time: float
) -> None:
    found = plant_of(angle, load, speed, time).parameters
    sizes = {
        "spring.twist": (angle / load, "rad/N.m-1"),
        "spring.bend": (1.0 / angle**2, "1/rad2"),
        "spring.rate": (speed / time, "rad/s2"),
        "spring.delay": (time, "s"),
    }
    for name, (size, unit) in sizes.items():
        param, own = found[name].param, spring.params[name.removeprefix("spring.")]
        for value, fraction in (
            (param.low, own.low),
            (param.high, own.high),
            (param.typical, own.typical),
        ):
            assert value == pytest.approx(fraction * size, rel=1e-12), name
        if name != "spring.twist":
            assert exponents(param.unit)[1] == exponents(unit)[1]
    assert found["spring.twist"].param.unit == "rad/(N.m)"
    assert found["spring.rate"].param.display == "deg/s/s"


def test_no_effect_of_motion_counts_in_absolute_units() -> None:
    """But numbers of turns, angles of a turn, and heat, which is not the plant's motion."""
    absolute = {
        (name, key, param.unit)
        for name, functions in effects().items()
        for function in functions
        for key, param in function.params.items()
        if not param.is_scaled and param.unit != "1"
    }
    assert absolute == {
        *(("cogging", f"phase{further}", "rad") for further in ("", "_2", "_3", "_4")),
        ("gravity_load", "phase", "rad"),
        ("thermal_drift", "time_constant", "s"),
        ("coasting_backlash", "contact", "Hz"),
    }


def test_what_is_counted_in_needs_a_wire() -> None:
    plant = replace(plant_of(1.0, 1.0, 1.0, 1.0), inputs=(Wire("shaft_angle", "rad", ""),))
    with pytest.raises(
        ValueError, match=r"'spring\.twist' are fractions of the full scale of 'force'.*declare it"
    ):
        _ = plant.parameters


@pytest.mark.parametrize("time", [0.0, -1.0, float("nan"), float("inf")])
def test_a_scale_of_time_that_is_none_is_refused(time: float) -> None:
    with pytest.raises(ValueError, match=r"time_scale = .*more than 0"):
        plant_of(1.0, 1.0, 1.0, time)


@pytest.mark.parametrize("unit", ["{a}{b}", "/{a}", "{a", "s/{a}", "{a}/{b}/{c}", "1/{a}22"])
def test_a_unit_whose_scales_are_unclear_is_refused(unit: str) -> None:
    with pytest.raises(ValueError, match="other full scales in braces"):
        Param(unit, "size")


def test_single_fields_of_a_parameter_are_changed_in_place() -> None:
    """As whole parameters, also of an effect of several functions."""
    own = compliant_output.params["compliance"]
    wires = ("angle", "rate", "load_rate")
    fields = {"unit": "rad/(N.m)", "high": 5.0}
    assert place("it", compliant_output, *wires, params={"compliance": fields}) == place(
        "it", compliant_output, *wires, params={"compliance": replace(own, **fields)}
    )
    with pytest.raises(ValueError, match="unknown parameter 'inertia' in effect 'it'"):
        place("it", compliant_output, *wires, params={"inertia": {"high": 1.0}})


def test_blocks_have_no_scales() -> None:
    def drag(speed: float, size: Annotated[float, Param("{speed}", "size")]) -> float:
        """A block."""
        return size * speed

    with pytest.raises(ValueError, match="only an effect acts on a signal"):
        block("drag")(drag)


@pytest.mark.parametrize("name", all_actuators())
def test_every_variant_lies_in_the_bounds_of_the_fmu(name: str) -> None:
    """An FMU has the bounds of the first variant, and is set to the values of any."""
    chosen = actuator(name)
    known = chosen.plant_of().parameters
    for variant in chosen.variants:
        outside = {
            key: value
            for key, value in chosen.values(variant.name).items()
            if key in known and not known[key].param.low <= value <= known[key].param.high
        }
        assert outside == {}


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
