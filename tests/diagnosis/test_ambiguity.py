"""A confidence set told as choices, on sets made by hand."""

from __future__ import annotations

from itertools import combinations, product

from hypothesis import given
from hypothesis import strategies as st

from servo_models.diagnosis.ambiguity import Effects, Slot, alternatives

FAMILIES = {
    "gravity": "load",
    "constant": "load",
    "coulomb": "friction",
    "stribeck": "friction",
    "by_load": "friction",
    "shift": "offset",
    "sensor": "offset",
}


def slots(*models: Effects) -> list[list[Slot]]:
    return [list(one) for one in alternatives(models, lambda name: FAMILIES.get(name, ""))]


def test_every_load_with_every_friction_is_a_load_and_a_friction() -> None:
    every = product(("gravity", "constant"), ("coulomb", "stribeck", "by_load"))
    (one,) = slots(*every)
    assert " and ".join(map(str, one)) == (
        "a load (gravity or constant) and a friction (coulomb, stribeck or by_load)"
    )
    assert [slot.count for slot in one] == [1, 1]


def test_the_order_of_effects_in_a_model_does_not_matter() -> None:
    (one,) = slots(("gravity", "coulomb"), ("stribeck", "gravity"), ("constant", "stribeck"))
    assert {slot.family: set(slot.effects) for slot in one} == {
        "load": {"gravity", "constant"},
        "friction": {"coulomb", "stribeck"},
    }


def test_what_every_model_has_is_no_choice() -> None:
    (one,) = slots(("backlash", "coulomb"), ("backlash", "stribeck"))
    assert [str(slot) for slot in one] == ["backlash", "a friction (coulomb or stribeck)"]
    assert [slot.open for slot in one] == [False, True]


def test_effects_of_several_families_are_one_of_them() -> None:
    (one,) = slots(("shift",), ("gravity",))
    assert [(str(slot), slot.family) for slot in one] == [("one of shift or gravity", "")]
    (one,) = slots(("shift",), ("sensor",))
    assert [str(slot) for slot in one] == ["an offset (shift or sensor)"]


def test_models_that_no_exchange_links_are_alternatives() -> None:
    found = slots(("a", "b"), ("c", "d"), ("a", "e"))
    assert [[str(slot) for slot in one] for one in found] == [["a", "one of b or e"], ["c", "d"]]


def test_any_two_of_three() -> None:
    (one,) = slots(*combinations("abc", 2))
    assert [(str(slot), slot.count) for slot in one] == [("2 of a, b and c", 2)]


def test_one_model_leaves_nothing_open_and_none_has_no_alternative() -> None:
    (one,) = slots(("a", "b"))
    assert not any(slot.open for slot in one)
    assert slots() == []


MODELS = st.lists(
    st.frozensets(st.sampled_from("abcdef"), min_size=1, max_size=3), min_size=1, unique=True
)


@given(MODELS)
def test_each_model_makes_the_choices_of_one_alternative_and_all_effects_are_told(
    models: list[frozenset[str]],
) -> None:
    found = slots(*(tuple(sorted(one)) for one in models))
    for model in models:
        fits = [
            all(len(model & {*slot.effects}) == slot.count for slot in one)
            and sum(slot.count for slot in one) == len(model)
            for one in found
        ]
        assert any(fits)
    told = {name for one in found for slot in one for name in slot.effects}
    assert told == set().union(*models)
