"""servo-models simulate"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from servo_models.cli.options import (
    Actuator,
    Largest,
    Params,
    Trust,
    Values,
    Variant,
    assignments,
    chosen_model,
    complete_input,
    file_option,
)
from servo_models.errors import UserError, told_at


def simulate(
    actuator: Actuator = None,
    variant: Variant = None,
    set_: Values = None,
    params: Params = None,
    trust: Trust = False,
    largest: Largest = None,
    step: Annotated[
        list[str] | None,
        typer.Option(
            metavar="INPUT=VALUE",
            help="Step of an input at time 0; may be repeated. Default: the standard step.",
            autocompletion=complete_input,
        ),
    ] = None,
    inputs: Annotated[
        Path | None,
        file_option(
            "Inputs over time instead: any file that 'check' reads, with a column 'time' and"
            " columns such as 'voltage' or 'pulse_width \\[us]'; its rows are the communication"
            " points."
        ),
    ] = None,
    stop: Annotated[str | None, typer.Option(metavar="TIME", help="End of a step's run.")] = None,
    dt: Annotated[str | None, typer.Option(metavar="TIME", help="Communication step.")] = None,
    out: Annotated[Path | None, file_option("Write all signals to .csv or .parquet.")] = None,
    plot: Annotated[Path | None, file_option("Draw all signals to .svg, .png or .pdf.")] = None,
) -> int:
    """Simulate a step, or a file of inputs.

    Exit code 0: done, 1: done with the warnings printed, 2: could not run.

    Examples:

    servo-models simulate torque_motor --step "voltage=50 V" --plot step.svg

    servo-models simulate sg90 --variant linear_kf018 --set "backlash.half_width=1 deg"

    servo-models simulate sg90 --inputs pulses.csv --out angles.parquet
    """
    from servo_models.analysis import experiment
    from servo_models.analysis.simulate import simulate as run
    from servo_models.cli.console import progress, show
    from servo_models.data import tables

    if inputs and (step or stop or dt):
        raise UserError("--inputs brings its own times and values: leave out --step, --stop, --dt")
    if out:
        tables.check_suffix(out)
    if plot:
        from servo_models.analysis import pictures

        pictures.check_suffix(plot)
    chosen = chosen_model(actuator, variant, set_, params, trust)
    with progress(f"simulating {chosen.actuator.name}"):
        if inputs:
            given = tables.read_inputs(inputs, chosen.plant)
            with told_at(f"'{inputs}', rows counted from 0"):
                result = run(chosen, *given)
        else:
            result = experiment.step(chosen, assignments("--step", step or ()), stop, dt)
    if out:
        signals = {**result.inputs, **result.outputs}
        tables.write_signals(out, result.times, signals, chosen.plant.wire)
    if plot:
        pictures.save(pictures.response(result), plot)
    show(result.report())
    return 1 if result.warnings else 0
