"""servo-models figures"""

from __future__ import annotations

from pathlib import Path

from servo_models.cli.options import assignments, chosen_model
from servo_models.errors import UserError


def figures(
    actuator: str | None = None,
    variant: str | None = None,
    set_: list[str] | None = None,
    params: Path | None = None,
    trust: bool = False,
    at: list[str] | None = None,
    amplitude: str | None = None,
    frequency: list[str] | None = None,
    out: Path | None = None,
    plot: Path | None = None,
    beside: list[Path] | None = None,
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
