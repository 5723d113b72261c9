"""Arguments that several commands share, with their shell completion."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from servo_models.errors import UserError

if TYPE_CHECKING:
    from servo_models.core.simulate import Model
    from servo_models.report.result import Result


class Format(str, Enum):
    """How a result is printed."""

    TEXT = "text"
    JSON = "json"
    GITHUB = "github"


def check_outputs(*outputs: tuple[Path | None, str], description: Path | None = None) -> None:
    """Check the names and suffixes of files to write before long work."""
    from servo_models.data.schema import named_files
    from servo_models.files import check_writable

    read = named_files(description) if description else []
    for path, suffix in outputs:
        if path and path.suffix.lower() != suffix:
            raise UserError(f"'{path}': let the name end in {suffix}")
        if path and os.path.exists(path) and any(path.samefile(other) for other in read):
            raise UserError(f"'{path}' is read, not written: choose another name")
        if path:
            check_writable(path)


def chosen_model(
    actuator: str | None,
    variant: str | None,
    settings: list[str] | None,
    params: Path | None,
    trust: bool,
) -> Model:
    """Return the model of ``ACTUATOR --variant`` or ``--params``, with ``--set`` on top."""
    from servo_models.catalogue import model
    from servo_models.data.parameters import read_parameters

    overrides = assignments("--set", settings or ())
    if params:
        if actuator or variant:
            raise UserError("--params names actuator and variant itself: leave them out")
        return read_parameters(params, trust).model(overrides)
    if not actuator:
        raise UserError("no actuator: name one, see 'servo-models list', or give --params FILE")
    return model(actuator, variant, overrides)


def assignments(option: str, texts: Iterable[str]) -> dict[str, str]:
    """Return ``NAME=VALUE`` texts as a dictionary."""
    values: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise UserError(f"{option} '{text}': write NAME=VALUE, such as {option} {EXAMPLE}")
        if name in values:
            raise UserError(f"{option} '{name}' is given twice: keep one")
        values[name] = value
    return values


EXAMPLE = "load_torque='20 mN.m'"


def completing(names: Callable[[typer.Context], Iterable[str]]) -> Callable[..., list[str]]:
    """Return a shell completion from the names that fit a command line."""

    def complete(ctx: typer.Context, incomplete: str) -> list[str]:
        return [name for name in names(ctx) if name.startswith(incomplete)]

    return complete


def _actuators(_: Any = None) -> Mapping[str, Any]:
    from servo_models.catalogue import all_actuators

    return all_actuators()


def _names(_: Any) -> list[str]:
    from servo_models.effects import effects

    return [*_actuators(), *effects()]


def _typed(ctx: typer.Context) -> list[Any]:
    """The actuator on an unfinished command line, where it may not yet be parsed as an argument."""
    words: list[Any] = [ctx.params.get("actuator"), ctx.params.get("name"), *ctx.args]
    return [_actuators()[word] for word in words if word in _actuators()]


complete_actuator, complete_name = completing(_actuators), completing(_names)
complete_variant = completing(lambda ctx: (it.name for one in _typed(ctx) for it in one.variants))
complete_setting = completing(
    lambda ctx: (f"{name}=" for one in _typed(ctx) for name in one.plant.parameters)
)
complete_input = completing(
    lambda ctx: (f"{wire.name}=" for one in _typed(ctx) for wire in one.plant.settable)
)


def write_result(result: Result, *, json: Path | None = None, report: Path | None = None) -> None:
    """Write the files that ``--json`` and ``--report`` name."""
    from datetime import date

    from servo_models.files import write_whole

    if json:
        write_whole(json, f"{result.to_json()}\n".encode())
    if report:
        result.write_report(report, date.today().isoformat())


def file_option(about: str) -> Any:
    """Return an option that names a file."""
    return typer.Option(metavar="FILE", help=about)


def time_option(about: str) -> Any:
    """Return an option that is a time [s], above 0."""
    return typer.Option(metavar="TIME", help=about, parser=_seconds)


def _seconds(text: str) -> float:
    from servo_models.units import parse

    seconds = parse(text, "s")
    if not seconds > 0.0:
        raise UserError(f"'{text}' is no time above 0 s: give one such as 60s")
    return seconds


Actuator = Annotated[
    str | None,
    typer.Argument(
        help="An actuator, see 'list', or your own .py file.", autocompletion=complete_actuator
    ),
]
Described = Annotated[
    Path, typer.Argument(help="Description of model and logs, see 'check LOG --init'.")
]
MadeBy = Annotated[
    str | None,
    typer.Option(
        help="What made a log, see 'list': smart_servo, or with a variant smart_servo:sts3215.",
        autocompletion=complete_actuator,
    ),
]
Params = Annotated[
    Path | None, file_option("Parameter file, .toml, in place of a name and variant.")
]
Fitted = Annotated[Path | None, file_option("Write the model as a parameter file (.toml).")]
Json = Annotated[Path | None, file_option("Write every figure, in SI (.json).")]
Report = Annotated[Path | None, file_option("Write a report with pictures (.html).")]
Printed = Annotated[Format, typer.Option("--format", help="How the result is printed.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of all that is random.")]
Jobs = Annotated[
    int | None, typer.Option(min=1, help="Simulations or cases at once; default: one a processor.")
]


def _allow(megabytes: int | None) -> int | None:
    from servo_models.files import largest_input

    if megabytes is not None:
        largest_input.set(megabytes << 20)
    return megabytes


Largest = Annotated[
    int | None,
    typer.Option(
        "--largest",
        min=1,
        metavar="MB",
        callback=_allow,
        help="Largest file of measurements, also of what is unpacked from it; default 256.",
    ),
]
Trust = Annotated[
    bool,
    typer.Option(
        "--trust",
        help="Run the Python file of the actuator even if it does not lie beside the file that"
        " names it, or if a survey found that file by itself.",
    ),
]
Variant = Annotated[
    str | None,
    typer.Option(help="Parameter set, see 'list'.", autocompletion=complete_variant),
]
Values = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Change a parameter, in SI or with a unit; may be repeated.",
        autocompletion=complete_setting,
    ),
]
