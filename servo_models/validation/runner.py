"""Validate FMUs and actuators: claims and figures, as rows.

*Implementation*: the FMU equals the simulation in this process.  *Model*: the responses of the FMU
equal independent references.  *Paper*: the model gives the printed figures, and figures that cannot
be reproduced are named.  *Reference*: any FMU, ours or not, gives the outputs that a reference has.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter

from servo_models.build import build
from servo_models.catalogue import actuators, model
from servo_models.core.plant import Actuator
from servo_models.core.simulate import Model
from servo_models.core.stop import Tell, silent
from servo_models.errors import UserError
from servo_models.files import scratch
from servo_models.fmu.fmu import LIMITS, Fmu, Limits
from servo_models.report.interchange import conditions
from servo_models.validation.any_fmu.comparison import Compared
from servo_models.validation.any_fmu.experiment import Against, has_its_own
from servo_models.validation.any_fmu.reference_check import ReferenceCheck, check_against
from servo_models.validation.cases import Case, all_cases, offered
from servo_models.validation.fmu_subject import Subject
from servo_models.validation.implementation import implementation_rows
from servo_models.validation.responses import cost_curve, named_cases, plain_row, response_rows
from servo_models.validation.rows import MODEL, CostCurve, Row, Validation, failure

Job = tuple[str, Callable[[], list[Row] | CostCurve | ReferenceCheck]]
"""Name and function of an examination; no rows after the FMU stopped: its first row says why."""


def validate(
    subjects: Iterable[Model | str | Path] | None = None,
    on_progress: Tell = silent,
    own: Actuator | None = None,
    limits: Limits = LIMITS,
    against: Against | None = None,
) -> Validation:
    """Validate FMUs against the simulation, references and the papers.

    Every FMU is compared with the simulation of the same parameters.  Then it runs all
    cases of its actuator, with the parameters of each case set before initialisation and
    its own internal step, against the references.  Figures of the papers and the cost of
    accuracy belong to the actuator and are measured in this process.

    The code of an FMU runs in a process of its own, which finds the standard library and the
    files of the FMU only.  A crash or a hang there is a row that failed.

    Args:
        subjects: FMU files, or models that are built first; None for every actuator and
            every plant of it.
        own: an actuator of your own, which its FMU files need; there are no references for it.
        on_progress: is told of the jobs; the last call is ("", n, n).
        limits: of time, memory and size for each FMU.
        against: a reference for every FMU, which then may be anybody's; None for the one that
            an FMU of another maker carries.

    Returns:
        one row a figure, with its value and its limit; ``passed`` where all are within.

    Raises:
        UserError: an FMU that cannot be read, or one of an unknown actuator.

    Example:
        >>> import servo_models as sm
        >>> result = sm.validate([sm.model("gimbal.py")])
        >>> result.passed
        True
    """
    with ExitStack() as stack:
        folder = stack.enter_context(scratch())
        chosen = every_model() if subjects is None else subjects
        opened: list[Subject] = []
        compared: list[Path] = []
        for k, subject in enumerate(chosen):
            if isinstance(subject, Model):
                maker: Actuator | None = subject.actuator
                path = build(subject, folder / str(k) / f"{subject.actuator.name}.fmu")
            else:
                maker, path = own, Path(subject)
            ours = _ours(path, maker, limits, against)
            if ours:
                opened.append(ours)
                stack.callback(ours.close)
            if against or not ours:
                compared.append(path)
        rows: list[Row] = []
        curves: list[CostCurve] = []
        outputs: list[Compared] = []
        jobs: list[Job] = [
            *(job for subject in opened for job in _fmu_jobs(subject)),
            *_actuator_jobs(opened),
            *(
                (
                    f"{path.name}: against the reference",
                    partial(check_against, path, against or Against(), limits),
                )
                for path in compared
            ),
        ]
        for done, (label, work) in enumerate(jobs):
            on_progress(label, done, len(jobs))
            began = perf_counter()
            result = work()
            spent = perf_counter() - began
            if isinstance(result, CostCurve):
                curves.append(result)
                continue
            if isinstance(result, ReferenceCheck):
                outputs += result.compared
                result = list(result.rows)
            rows += [replace(row, seconds=spent / len(result)) for row in result]
        on_progress("", len(jobs), len(jobs))
    return Validation(tuple(rows), tuple(curves), conditions(), tuple(outputs))


def every_model() -> list[Model]:
    """Return the default model of every actuator, and one for each of its other plants."""
    return [
        model(actuator, variant.name)
        for actuator in actuators().values()
        for variant in actuator.variants
        if variant.name == actuator.default_variant
        or not actuator.plant_of(variant.name).has_equations_of(actuator.plant_of())
    ]


def _ours(
    path: Path, own: Actuator | None, limits: Limits, against: Against | None
) -> Subject | None:
    """The FMU as one of ours; None for another maker's, which has to have a reference."""
    try:
        subject = Subject(path, own, limits)
    except UserError:
        if against is None and not _carries_reference(path, limits):
            raise
        return None
    if against and subject.over:
        subject.close()
        return None
    return subject


def _carries_reference(path: Path, limits: Limits) -> bool:
    try:
        with closing(Fmu(path, limits)) as fmu:
            return has_its_own(fmu)
    except UserError:  # the first complaint is the one to tell
        return False


def _fmu_jobs(subject: Subject) -> list[Job]:
    model = subject.model
    name = model.actuator.name
    in_turn = actuators().get(name) is not model.actuator  # those of the catalogue have references
    return [
        (f"{name}: FMU against simulation", partial(implementation_rows, subject)),
        *(
            (f"{name}: blocks, {case_name}", partial(_plain_rows, subject, chosen, case_name))
            for case_name, chosen in named_cases(model, in_turn).items()
        ),
        *(
            (f"{name} {case.variant}: {case.name}", partial(_case_rows, case, subject))
            for case in all_cases()
            if case.actuator == name
            and model.actuator.plant_of(case.variant).has_equations_of(model.plant)
        ),
    ]


def _plain_rows(subject: Subject, chosen: Model, name: str) -> list[Row]:
    return [] if subject.over else [plain_row(subject, chosen, name)]


def _case_rows(case: Case, subject: Subject) -> list[Row]:
    if subject.over:
        return []
    step = {"internal_step": subject.model.values["internal_step"]}
    try:
        chosen = model(case.actuator, case.variant, {**case.parameters, **step})
        return response_rows(case, chosen, subject.run, subject.name)
    except UserError as error:
        where = (case.actuator, case.variant, case.name)
        return [failure(MODEL, where, str(error), subject.name)]


def _actuator_jobs(opened: list[Subject]) -> list[Job]:
    names = list(dict.fromkeys(subject.model.actuator.name for subject in opened))
    papers = offered("paper")
    return [
        *((f"{name}: figures of the paper", papers[name].rows) for name in names if name in papers),
        *(
            (f"{case.actuator}: error against step size", partial(cost_curve, case))
            for case in all_cases()
            if case.cost and case.actuator in names
        ),
    ]
