"""Arguments that several commands share, with their shell completion."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

import typer

from servo_models.errors import UserError


def assignments(option: str, texts: Iterable[str]) -> dict[str, str]:
    """Return ``NAME=VALUE`` texts as a dictionary.

    Raises:
        UserError: a text without a name, ``=`` or value, or a name given twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise UserError(f"{option} '{text}': write NAME=VALUE, such as {option} {EXAMPLE}")
        if name in found:
            raise UserError(f"{option} '{name}' is given twice: keep one")
        found[name] = value
    return found


EXAMPLE = "load_torque='20 mN.m'"


def complete_actuator(incomplete: str) -> list[str]:
    from servo_models.catalogue import actuators

    return [name for name in actuators() if name.startswith(incomplete)]


def complete_name(incomplete: str) -> list[str]:
    from servo_models.catalogue import actuators, effects

    return [name for name in [*actuators(), *effects()] if name.startswith(incomplete)]


def complete_variant(ctx: typer.Context, incomplete: str) -> list[str]:
    names = [variant.name for found in _typed(ctx) for variant in found.variants]
    return [name for name in names if name.startswith(incomplete)]


def complete_setting(ctx: typer.Context, incomplete: str) -> list[str]:
    names = [name for found in _typed(ctx) for name in found.plant.parameters]
    return [f"{name}=" for name in names if name.startswith(incomplete)]


def complete_input(ctx: typer.Context, incomplete: str) -> list[str]:
    names = [wire.name for found in _typed(ctx) for wire in found.plant.inputs]
    return [f"{name}=" for name in names if name.startswith(incomplete)]


def _typed(ctx: typer.Context) -> list[Any]:
    """The actuator on an unfinished command line: not yet an argument where an option is open."""
    from servo_models.catalogue import actuators

    words = [ctx.params.get("actuator"), *ctx.args]
    return [actuators()[word] for word in words if word in actuators()]


Actuator = Annotated[
    str, typer.Argument(help="Name of an actuator, see 'list'.", autocompletion=complete_actuator)
]
Variant = Annotated[
    str | None,
    typer.Option(help="Parameter set, see 'list'.", autocompletion=complete_variant),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Change a parameter, in SI or with a unit; may be repeated.",
        autocompletion=complete_setting,
    ),
]
