"""The page that comes with an FMU (FMI 2.0.4, section 2.3), from the actuator's declaration."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

from fmu_src.description import Form, described
from fmu_src.variables import start_of
from servo_models.analysis.explain import actuator_sheet
from servo_models.analysis.live import DRIVE, live_model, with_panel
from servo_models.core.simulate import Model
from servo_models.errors import UserError
from servo_models.report.html import page
from servo_models.report.live import Live


def index_html(model: Model, form: Form) -> str:
    """Return the page: what the FMU is, how it is run, the model to drive, its equations."""
    sheet = actuator_sheet(model.actuator, model.variant, model.values)
    main = model.plant.wire[model.step[0]]
    texts = (
        described(model),
        "An input that the host does not set keeps its start value. That is rest, but for"
        f" '{main.name}', which steps to {start_of(main, model):g} {main.unit}.",
        f"The default experiment lasts {model.stop_time:g} s, in steps of {model.step_size:g} s."
        " The model's own step is a parameter, internal_step.",
        form.needs,
        *sheet.remarks,
    )
    told = replace(sheet, remarks=texts)
    with suppress(UserError):  # a block has no form in JavaScript; FMUs in Python have it
        told = with_panel(told, Live("Drive it", DRIVE, (live_model(model),)))
    return page(told)
