"""servo-models sample"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from servo_models.cli.options import Seed, Trust, file_option


def sample(
    params: Annotated[
        Path, typer.Argument(help="Parameter file of identify or diagnose.", metavar="PARAMS.toml")
    ],
    count: Annotated[int, typer.Option(min=1, help="Number of sets.")] = 1000,
    seed: Seed = 0,
    out: Annotated[
        Path | None,
        file_option("Write the sets in SI: .csv, .json (FMU start values), .ssv (SSP, one a set)."),
    ] = None,
    trust: Trust = False,
) -> None:
    """Draw parameter sets from an identified model; print ranges for domain randomisation.

    Values that were found only together are drawn together, and bounds are kept.

    Examples:

    servo-models sample fitted.toml

    servo-models sample fitted.toml --count 200 --out sets.csv
    """
    from servo_models.cli.console import show
    from servo_models.data.parameters import read_parameters
    from servo_models.data.samples import check_suffix
    from servo_models.data.samples import sample as draw

    if out:
        check_suffix(out)
    samples = draw(read_parameters(params, trust), count, seed)
    if out:
        samples.write(out)
    show(samples.report())
