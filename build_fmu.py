"""Build the FMUs, check, simulate and validate them, print the tables and write the report.

Works on a machine with nothing but Python: it sets itself up in ``.venv`` first.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import bootstrap

EXAMPLES = """examples:
  python build_fmu.py
  python build_fmu.py --actuator sg90 --variant linear --set feedback_coefficient=0.18
  python build_fmu.py --params identified.toml

exit codes: 0 built and within tolerance, 1 not within tolerance, 2 could not run
"""


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, epilog=EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", metavar="DIR", default="fmus", help="folder of FMUs and report")
    parser.add_argument("--actuator", metavar="NAME", help="build this one only")
    parser.add_argument("--variant", metavar="NAME", help="parameter set of that actuator")
    parser.add_argument(
        "--params", metavar="FILE", help="parameter file in place of an actuator and a variant"
    )
    parser.add_argument(
        "--trust",
        action="store_true",
        help="run the Python file that the parameter file names, wherever it lies",
    )
    parser.add_argument(
        "--set",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="change a parameter of that actuator, in SI or with a unit; may be repeated",
    )
    return parser.parse_args()


def main() -> int:
    """Build, then validate what was built; return the exit code."""
    chosen = options()
    bootstrap.ensure("", needs="pythonfmu")
    from servo_models.catalogue import actuator, actuators
    from servo_models.cli import main as command
    from servo_models.parameter_set import read_parameters

    build = ["build", "--out", chosen.out]
    build += [chosen.actuator] if chosen.actuator else []
    build += ["--variant", chosen.variant] if chosen.variant else []
    build += ["--params", chosen.params] if chosen.params else []
    build += ["--trust"] if chosen.trust else []
    for setting in chosen.set:
        build += ["--set", setting]
    if code := command(build):
        return code
    params = read_parameters(chosen.params, chosen.trust) if chosen.params else None
    named = params.actuator if params else chosen.actuator
    chosen_one = actuator(named) if named else None
    names = [chosen_one.name] if chosen_one else list(actuators())
    own = ["--actuator", str(chosen_one.file)] if chosen_one and chosen_one.file else []
    folder = Path(chosen.out)
    report = folder / "report.html"
    fmus = [str(folder / f"{name}.fmu") for name in names]
    code = command(["validate", *fmus, *own, "--report", str(report)])
    if code != bootstrap.COULD_NOT_RUN:
        print(f"report: {report}")
    return code


if __name__ == "__main__":
    sys.exit(main())
