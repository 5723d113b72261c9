"""servo-models figures"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from servo_models.cli.options import (
    Actuator,
    Params,
    Trust,
    Values,
    Variant,
    assignments,
    chosen_model,
    complete_input,
    file_option,
)
from servo_models.errors import UserError


def figures(
    actuator: Actuator = None,
    variant: Variant = None,
    set_: Values = None,
    params: Params = None,
    trust: Trust = False,
    at: Annotated[
        list[str] | None,
        typer.Option(
            metavar="INPUT=VALUE",
            help="Input at the working point; may be repeated. Default: at rest.",
            autocompletion=complete_input,
        ),
    ] = None,
    amplitude: Annotated[
        str | None,
        typer.Option(
            metavar="VALUE",
            help="Size of the command, as input or as output; default a tenth of the standard"
            " step.",
        ),
    ] = None,
    frequency: Annotated[
        list[str] | None,
        typer.Option(
            metavar="VALUE", help="Frequency at which gain and phase lag are told; may be repeated."
        ),
    ] = None,
    out: Annotated[
        Path | None, file_option("Write figures and A, B, C, D: .json, .mat or .npz.")
    ] = None,
    plot: Annotated[
        Path | None, file_option("Draw step, gain, phase, poles and zeros to .svg, .png or .pdf.")
    ] = None,
    beside: Annotated[
        list[Path] | None, file_option("Draw a parameter file beside it (.toml); may be repeated.")
    ] = None,
) -> None:
    """Measure slew rate, bandwidth, delay, phase lag; linear state space A, B, C, D.

    Examples:

    servo-models figures torque_motor --amplitude "1 deg" --frequency "10 Hz"

    servo-models figures sg90 --at "pulse_width=1.6 ms" --amplitude "20 deg" --out sg90.mat

    servo-models figures --params identified.toml

    servo-models figures sg90 --plot sg90.svg --beside identified.toml
    """
    from servo_models.analysis import pictures
    from servo_models.analysis.figures import check_suffix
    from servo_models.analysis.figures import figures as measure
    from servo_models.cli.console import progress, show
    from servo_models.data.parameters import read_parameters

    if out:
        check_suffix(out)
    if plot:
        pictures.check_suffix(plot)
    chosen = chosen_model(actuator, variant, set_, params, trust)
    with progress(f"measuring {chosen.actuator.name}"):
        measured = measure(chosen, assignments("--at", at or ()), amplitude, frequency or ())
    show(measured.report())
    if out:
        measured.write(out)
    if plot:
        sets = {chosen.variant: chosen}
        sets |= {it.stem: read_parameters(it, trust).model() for it in beside or ()}
        if {it.plant.wire.keys() != chosen.plant.wire.keys() for it in sets.values()} != {False}:
            raise UserError("--beside: give parameter files of the same actuator")
        with progress(f"drawing {plot}"):
            pictures.save(pictures.small_signals(sets, measured.at), plot)
    elif beside:
        raise UserError("--beside is drawn: add --plot FILE")
