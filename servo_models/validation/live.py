"""The panel of a validation's page: each examined actuator beside a reference."""

from __future__ import annotations

import math

import numpy as np

from servo_models.analysis.live import live_model
from servo_models.catalogue import actuators, model
from servo_models.core.plant import Plant
from servo_models.report.live import Live, LiveModel, LiveRun, encoded
from servo_models.validation.cases import Case, all_cases
from servo_models.validation.responses import input_columns
from servo_models.validation.rows import Validation

FINEST = 1e-9  # rounding of a reference over its largest value, which halves its text
TITLE = "What the actuators do"
TEXT = (
    "Simulated in this page, beside a reference that shares no code with the model: choose an"
    " actuator, move a parameter, or switch an effect."
)


def panel(validation: Validation) -> Live | None:
    """Return the panel: for each plant of each actuator one variant beside a reference.

    It is the first examined variant with a run; the others differ from it in values only.
    """
    cases: dict[tuple[str, str], Case] = {}
    for case in sorted(all_cases(), key=lambda case: not case.is_step):
        cases.setdefault((case.actuator, case.variant), case)
    first: dict[Plant, Case] = {}
    for key in dict.fromkeys((row.actuator, row.variant) for row in validation.rows):
        if key in cases:
            first.setdefault(model(*key).plant, cases[key])
    known = actuators()  # it opens on the one that is described best, by the most variants
    shown = sorted(first.values(), key=lambda case: -len(known[case.actuator].variants))
    models = tuple(map(_model, shown))
    return Live(TITLE, TEXT, models, "your values", "reference") if models else None


def _model(case: Case) -> LiveModel:
    chosen = model(case.actuator, case.variant, dict(case.parameters))
    columns = input_columns(case, chosen)
    inputs = {wire.name: columns[:, k] for k, wire in enumerate(chosen.plant.inputs)}
    expected = case.reference(case.times, inputs)[case.main]
    step = 2.0 ** math.floor(math.log2(FINEST * np.max(np.abs(expected), initial=FINEST)))
    run = LiveRun(
        name=case.name,
        times=encoded(case.times),
        inputs=encoded(columns.ravel()),
        measured={case.main: encoded(step * np.round(expected / step))},
        counted=encoded(0.0 * case.times + 1.0),
    )
    return live_model(chosen, runs=(run,))
