"""servo-models build"""

from __future__ import annotations

from pathlib import Path

from servo_models.cli.options import chosen_model
from servo_models.errors import UserError


def build(
    actuator: str | None = None,
    variant: str | None = None,
    set_: list[str] | None = None,
    params: Path | None = None,
    trust: bool = False,
    out: Path = Path("fmus"),
    native: bool = False,
    fmi: int = 2,
) -> None:
    """Build FMUs for co-simulation.

    sg90.fmu is Python; sg90.native.fmu beside it is compiled, for hosts without Python.

    A native one needs a C compiler: the machine's own, or the extra "native" for all platforms.

    sg90 is the default variant, sg90_printed another one; sg90_torque is for physics engines.

    Examples:

    servo-models build

    servo-models build sg90 --variant linear --set feedback_coefficient=0.15 --out mine

    servo-models build --params identified.toml

    servo-models build sg90 --native --out sg90.fmu

    servo-models build --fmi 3

    servo-models build sg90_torque --native
    """
    from servo_models.build import build as write
    from servo_models.build import kinds_for, path_of
    from servo_models.catalogue import actuators, model
    from servo_models.cli.console import progress

    if actuator or params:
        models = [chosen_model(actuator, variant, set_, params, trust)]
    elif variant or set_:
        raise UserError("--variant and --set belong to one actuator: name it")
    elif out.suffix == ".fmu":
        raise UserError(f"'{out}' is the file of one actuator: name it, or give a folder")
    else:
        models = [model(name) for name in actuators()]
    jobs = [(chosen, kind) for chosen in models for kind in kinds_for(out, native, fmi)]
    with progress("building") as report:
        for done, (chosen, kind) in enumerate(jobs):
            report(f"building {chosen.actuator.name}", done, len(jobs))
            print(write(chosen, path_of(chosen, out, kind), kind), flush=True)
