"""Build the FMUs, check, simulate and validate them, print the verdict and write the report.

Works on a machine with nothing but Python: it sets itself up in ``.venv`` first.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import bootstrap

EXAMPLES = """examples:
  python build_fmu.py
  python build_fmu.py --native
  python build_fmu.py --fmi 3
  python build_fmu.py --actuator sg90 --variant linear --set feedback_coefficient=0.18
  python build_fmu.py --params identified.toml

exit codes: 0 built and within tolerance, 1 not within tolerance, 2 could not run
"""


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, epilog=EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--out",
        metavar="PATH",
        default="fmus",
        help="folder of FMUs and report, or the file .fmu of one actuator, with its report beside",
    )
    parser.add_argument(
        "--native", action="store_true", help="native FMUs alone; refused without a C compiler"
    )
    parser.add_argument(
        "--fmi", type=int, choices=(2, 3), default=2, help="version of FMI; what is of 3 is native"
    )
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
    from servo_models.build import NATIVE_ARM, kinds_for, path_of
    from servo_models.catalogue import actuators, model
    from servo_models.cli import main as command
    from servo_models.cli.options import chosen_model

    build = ["build", "--out", chosen.out]
    build += [chosen.actuator] if chosen.actuator else []
    build += ["--variant", chosen.variant] if chosen.variant else []
    build += ["--params", chosen.params] if chosen.params else []
    build += ["--trust"] if chosen.trust else []
    build += ["--native"] if chosen.native else []
    build += ["--fmi", str(chosen.fmi)]
    for setting in chosen.set:
        build += ["--set", setting]
    if code := command(build):
        return code
    if chosen.actuator or chosen.params:
        params = Path(chosen.params) if chosen.params else None
        one = chosen_model(chosen.actuator, chosen.variant, chosen.set, params, chosen.trust)
        models = [one]
        own = ["--actuator", str(one.actuator.file)] if one.actuator.file else []
        report = path_of(one, chosen.out).with_suffix(".html")
    else:
        models = [model(name) for name in actuators()]
        own = []
        report = Path(chosen.out) / "report.html"
    kinds = [k for k in kinds_for(chosen.out, chosen.native, chosen.fmi) if k != NATIVE_ARM]
    fmus = [path_of(one, chosen.out, kind) for one in models for kind in kinds]
    code = command(["validate", *map(str, fmus), *own, "--brief", "--report", str(report)])
    if code != bootstrap.COULD_NOT_RUN:
        print(f"report: {report}")
    return code


if __name__ == "__main__":
    sys.exit(main())
