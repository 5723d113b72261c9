"""python -m studies withheld.generator FOLDER --cases N --seed S [--tiers easy,rough] [--kinds one]
    [--causes backlash]

Writes the cases and prints the seal of their answers; progress goes to the standard error, one
line "done/all" a case.  The tiers are easy, hard and poor, or those that are named, rough among
them; the kinds are nothing, one, two and foreign, or those that are named; the first cause of the
catalogue is any, or one of those that are named.  Exit 0 done, 2 could not run.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from servo_models.withheld.generator.cases import CLEAN, KINDS, TIERS
from servo_models.withheld.generator.causes import CATALOGUE
from servo_models.withheld.generator.files import generate


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m studies withheld.generator")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, required=True)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--tiers", default=",".join(CLEAN))
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--causes", default="")
    given = parser.parse_args()
    tiers, kinds = given.tiers.split(","), given.kinds.split(",")
    causes = given.causes.split(",") if given.causes else []
    known = {cause.name for some in CATALOGUE.values() for cause in some}
    unknown = {*tiers} - {*TIERS} or {*kinds} - {*KINDS} or {*causes} - known
    if unknown or given.cases < 1 or given.seed < 0:
        parser.error(
            f"give 1 case or more, a seed of 0 or more, tiers of {', '.join(TIERS)}, "
            f"kinds of {', '.join(KINDS)}, causes by their names"
        )

    def progress(done: int, every: int) -> None:
        print(f"{done}/{every}", file=sys.stderr, flush=True)

    try:
        print(generate(given.folder, given.cases, given.seed, tiers, progress, kinds, causes))
    except OSError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
