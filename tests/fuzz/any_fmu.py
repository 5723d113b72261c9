"""FMUs of another maker against references: right ones and planted faults, a table of both.

    python tests/fuzz/any_fmu.py

Right FMUs run at their step and points, with references of finer, of coarser and of shorter
numbers, and then as nobody looked at them while the defaults were chosen: other steps, another
input.  ``tests/validation/test_any_fmu.py`` runs a share.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from servo_models.errors import UserError
from servo_models.fmu.fmu import LIMITS
from servo_models.validation.any_fmu.experiment import Against
from servo_models.validation.any_fmu.reference_check import ReferenceCheck, check_against
from tests.support.foreign_faults import FAULTS
from tests.support.foreign_fmus import FOREIGN, Array, Foreign, table

OWN_STEP = ("sampled", "gears", "line", "pulses")  # models whose references hold at their own step
MOST_OUTLIERS = 0.1  # share of points outside that passes in fmpy's Cross-Check


def checked(
    one: Foreign, fault: str = "", finer: int = 1, every: int = 1, digits: int = 12
) -> ReferenceCheck:
    folder = Path(tempfile.mkdtemp())
    try:
        times = one.step / finer * np.arange(round(one.stop / one.step) * finer + 1)
        fed = {
            name: np.repeat(curve(one.times), finer)[: len(times)]
            for name, curve in one.inputs.items()
        }
        right = one.reference(times, fed)
        chosen = np.unique([*range(0, len(times), every), len(times) - 1])
        inputs, reference, tolerance = one.files(folder)
        shown = {name: _rounded(values[chosen], digits) for name, values in right.items()}
        table(reference, times[chosen], shown)
        against = Against(inputs, reference, tolerance, step=one.step)
        return check_against(one.write(folder, fault), against, LIMITS)
    finally:
        shutil.rmtree(folder)


def _rounded(values: Array, digits: int) -> Array:
    return np.array([float(f"{value:.{digits}g}") for value in values])


def chirp(times: Array) -> Array:
    return 0.9 * np.sin(2.0 * np.pi * (0.4 + 0.7 * times) * times + 0.3)


def variants(one: Foreign) -> Iterator[tuple[str, Foreign, dict[str, int]]]:
    yield "as it is", one, {}
    yield "reference 5 times finer", one, {"finer": 5}
    yield "every 4th point", one, {"every": 4}
    yield "6 digits", one, {"digits": 6}
    yield "unseen: step x 2", replace(one, step=2.0 * one.step), {}
    yield "unseen: step x 0.4", replace(one, step=0.4 * one.step), {}
    if set(one.inputs) == {"u"} and one.model not in ("pid", "sampled"):
        yield "unseen: chirp", replace(one, inputs={"u": chirp}), {}


def right_ones() -> None:
    runs: Counter[str] = Counter()
    alarms: list[str] = []
    for name, one in FOREIGN.items():
        for label, other, how in variants(one):
            if "step x" in label and one.model in OWN_STEP:
                continue
            runs[label] += 1
            wrong = [row for row in checked(other, **how).rows if row.passed is False]
            alarms += [f"{name}, {label}: {row.case} {row.quantity} {row.note}" for row in wrong]
    print("\n| right FMUs | runs | false alarms |\n| --- | ---: | ---: |")
    for label, count in runs.items():
        print(f"| {label} | {count} | {sum(f', {label}:' in one for one in alarms)} |")
    print(*alarms, sep="\n")


def passes_in_fmpy(result: ReferenceCheck) -> bool:
    """Whether the comparison of fmpy's Cross-Check, with its defaults, lets it pass."""
    from fmpy.util import validate_result

    if not result.compared:
        return False
    names = ["time", *(one.name for one in result.compared)]
    response, reference = (
        np.rec.fromarrays([curves[0].times, *(curve.values for curve in curves)], names=names)
        for curves in (
            [one.response for one in result.compared],
            [one.reference for one in result.compared],
        )
    )
    return bool(validate_result(response, reference) <= MOST_OUTLIERS)


def planted() -> None:
    by_kind: dict[str, Counter[str]] = {}
    figures: Counter[str] = Counter()
    print("\n| FMU | fault | kind | told |\n| --- | --- | --- | --- |")
    for fmu, fault, kind, told in FAULTS:
        result = checked(FOREIGN[fmu], fault)
        failed = [row for row in result.rows if row.passed is False]
        notes = [row.note for row in failed if row.note]
        named = any(told in note for note in notes)
        by_kind.setdefault(kind, Counter()).update(
            planted=1, caught=int(bool(failed)), named=int(named), lax=int(passes_in_fmpy(result))
        )
        figures.update({row.quantity for row in failed})
        print(f"| {fmu} | `{fault}` | {kind} | {'; '.join(notes) or 'PASSED'} |")
    print("\n| kind | planted | caught | told as expected | passes in fmpy |")
    print("| --- | ---: | ---: | ---: | ---: |")
    for kind, count in by_kind.items():
        figures_of_kind = (count[key] for key in ("planted", "caught", "named", "lax"))
        print(f"| {kind} | {' | '.join(map(str, figures_of_kind))} |")
    print("\n| figure | faults that it caught |\n| --- | ---: |")
    for quantity, count in figures.most_common():
        print(f"| {quantity} | {count} |")


def unseen_faults() -> None:
    """Planted faults at twice the step, on a chirp where there is an input."""
    caught = []
    for fmu, fault, *_ in FAULTS:
        one = FOREIGN[fmu]
        if one.model in OWN_STEP:
            continue
        inputs = {"u": chirp} if set(one.inputs) == {"u"} and one.model != "pid" else one.inputs
        other = replace(one, step=2.0 * one.step, inputs=inputs)
        caught.append(any(row.passed is False for row in checked(other, fault).rows))
    print(f"\nat twice the step, on a chirp: {sum(caught)} of {len(caught)} faults caught")


def main() -> int:
    began = perf_counter()
    try:
        right_ones()
        planted()
        unseen_faults()
    except UserError as error:
        print(error)
        return 2
    print(f"\n{perf_counter() - began:.0f} s")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
