"""servo-models simulate"""

from __future__ import annotations

from pathlib import Path

from servo_models.cli.options import assignments, chosen_model
from servo_models.errors import UserError, told_at


def simulate(
    actuator: str | None = None,
    variant: str | None = None,
    set_: list[str] | None = None,
    params: Path | None = None,
    trust: bool = False,
    largest: int | None = None,
    step: list[str] | None = None,
    inputs: Path | None = None,
    stop: str | None = None,
    dt: str | None = None,
    out: Path | None = None,
    plot: Path | None = None,
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
