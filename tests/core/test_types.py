"""A wrong entry of a declaration is told by its name, whatever it is."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import pytest

from servo_models.catalogue import actuator
from servo_models.core.block import Param
from servo_models.core.plant import Actuator, Placement
from servo_models.core.types import check_kind

ONE = actuator("torque_motor")
PLACED = next(link for link in ONE.plant.chain if isinstance(link, Placement))
DECLARED: tuple[Any, ...] = (
    *(ONE, ONE.plant, ONE.variants[0], ONE.plant.states[0], ONE.plant.wires[0], PLACED),
    Param("1", "a share"),
)
EVERY = [
    (declared, field.name)
    for declared in DECLARED
    for field in fields(declared)
    if (type(declared), field.name) != (Actuator, "file")  # which nobody writes
]


@pytest.mark.parametrize(
    ("declared", "name"), EVERY, ids=[f"{type(one).__name__}.{name}" for one, name in EVERY]
)
def test_a_field_of_another_kind_is_told(declared: Any, name: str) -> None:
    right = getattr(declared, name)
    assert replace(declared, **{name: right}) is not None
    for wrong in (object(), [object()], {"x": object()}):
        with pytest.raises(ValueError, match=f"'{name}' of"):
            replace(declared, **{name: wrong})


@pytest.mark.parametrize(
    ("value", "kind", "told"),
    [
        (1, float, ""),
        ([1.0, 2], tuple[float, ...], ""),
        ((1.0, "a"), tuple[float, ...], "entry 2 of it is 'a': give a number"),
        (("a", None), tuple[str, float], "entry 2 of it is None: give a number"),
        ("a", float | None, "it is 'a': give a number or None"),
        (((1,),), tuple[float, ...], "entry 1 of it is a tuple: give a number, or put * before it"),
        (max, str, "it is a builtin_function_or_method: give a text"),
    ],
)
def test_what_is_wrong_is_said_with_its_cure(value: Any, kind: Any, told: str) -> None:
    if not told:
        check_kind("it", value, kind)
        return
    with pytest.raises(ValueError, match="give") as caught:
        check_kind("it", value, kind)
    assert str(caught.value) == told
