"""Write modelDescription.xml (FMI 2.0.4, sections 2.2 and 4.3)."""

from __future__ import annotations

import copy
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from fmu_src.variables import Variable, variables
from servo_models.core.flat import Flat
from servo_models.core.simulate import Model
from servo_models.units import exponents, factor

BUILT = (1980, 1, 1, 0, 0, 0)
"""Date of every build: the same source gives the same bytes."""

CAPABILITIES = {
    # The host's own process runs the FMU, in Python or not; no other tool is started or needed.
    "needsExecutionTool": "false",
    "canHandleVariableCommunicationStepSize": "true",
    "canInterpolateInputs": "false",
    "maxOutputDerivativeOrder": "0",
    "canRunAsynchronuously": "false",
    "canBeInstantiatedOnlyOncePerProcess": "false",
    "canNotUseMemoryManagementFunctions": "true",
    "canGetAndSetFMUstate": "true",
    "canSerializeFMUstate": "true",
}


@dataclass(frozen=True)
class Form:
    """What tells a Python FMU from a native one, for its description.

    Attributes:
        directional_derivatives: whether it has them.
        log_categories: with what each is for.
        sources: C files to compile.
        needs: what the host has to bring, in a sentence.
    """

    directional_derivatives: bool
    log_categories: Mapping[str, str]
    sources: tuple[str, ...]
    needs: str


def model_description(model: Model, form: Form, identity: str, tool: str) -> bytes:
    """Return the file's bytes.

    Args:
        model: what the FMU simulates.
        form: Python or native.
        identity: of its code: a text with the hash of it.
        tool: name and version of what built it.

    The GUID is a hash of everything else in the file, and of the identity.
    """
    actuator = model.actuator
    every = variables(model)
    root = ET.Element("fmiModelDescription", fmiVersion="2.0", modelName=actuator.name)
    root.set("guid", identity)
    root.set("description", described(model))
    root.set("generationTool", tool)
    root.set("generationDateAndTime", "{:04}-{:02}-{:02}T{:02}:{:02}:{:02}Z".format(*BUILT))
    root.set("variableNamingConvention", "structured")
    derivatives = {"providesDirectionalDerivative": str(form.directional_derivatives).lower()}
    attributes = {"modelIdentifier": actuator.name, **CAPABILITIES, **derivatives}
    interface = ET.SubElement(root, "CoSimulation", attributes)
    if form.sources:
        files = ET.SubElement(interface, "SourceFiles")
        for name in form.sources:
            ET.SubElement(files, "File", name=name)
    _add_units(root, every)
    categories = ET.SubElement(root, "LogCategories")
    for name, about in form.log_categories.items():
        ET.SubElement(categories, "Category", name=name, description=about)
    ET.SubElement(
        root,
        "DefaultExperiment",
        startTime="0.0",
        stopTime=repr(model.stop_time),
        stepSize=repr(model.step_size),
    )
    _add_variables(root, every)
    _add_structure(root, model)
    root.set("guid", guid_of(root, identity))
    ET.indent(root)
    text: bytes = ET.tostring(root, "UTF-8", xml_declaration=True)
    return text + b"\n"


def guid_of(description: ET.Element, identity: str) -> str:
    """Return the GUID of a description, indented or not: a hash of everything else in it."""
    root = copy.deepcopy(description)
    root.set("guid", identity)
    for element in root.iter():
        element.text = element.tail = None  # FMI 2.0 descriptions have attributes only
    return "{" + str(uuid.uuid5(uuid.NAMESPACE_URL, ET.tostring(root, "unicode"))) + "}"


def direct_inputs(flat: Flat) -> list[list[int]]:
    """Return for every output the indices of the inputs that it depends on within zero time.

    An input reaches whatever a chain of blocks computes from it; integrators break the
    chain.  Memory does not: an effect with memory is the identity while it is neutral, and
    a sample taken now is passed on now.
    """
    reach = {name: {i} for i, name in enumerate(flat.inputs)}
    for chunk in (*flat.setup, *flat.held, *flat.stage):
        found = {i for name in chunk.reads for i in reach.get(name, ())}
        for name in chunk.writes:
            # an effect that is switched off leaves its wire as it was
            reach[name] = found | (reach.get(name, set()) if chunk.owner else set())
    return [sorted(reach.get(name, ())) for name in flat.outputs]


def described(model: Model) -> str:
    """Return in a few sentences what the FMU of ``model`` is and where its values come from."""
    variant = model.actuator.variant(model.variant)
    text = f"{model.actuator.title}, variant {variant.name}: {variant.about}."
    text += f" Source: {variant.source}."
    text += f" Parameters changed by: {model.provenance}." if model.provenance else ""
    return text + (f" Warning: {model.warning}." if model.warning else "")


def _add_units(root: ET.Element, every: list[Variable]) -> None:
    displays: dict[str, set[str]] = {}
    for variable in every:
        if not variable.flag:
            shown = displays.setdefault(variable.unit, set())
            shown.update([variable.display] if variable.display else [])
    definitions = ET.SubElement(root, "UnitDefinitions")
    for name in sorted(displays):
        unit = ET.SubElement(definitions, "Unit", name=name)
        scale, powers = exponents(name)
        base = {symbol: str(power) for symbol, power in powers.items()}
        ET.SubElement(unit, "BaseUnit", base if scale == 1.0 else {**base, "factor": repr(scale)})
        for display in sorted(displays[name]):
            ET.SubElement(unit, "DisplayUnit", name=display, factor=repr(factor(name, display)))


def _add_variables(root: ET.Element, every: list[Variable]) -> None:
    parent = ET.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(every):
        scalar = ET.SubElement(
            parent,
            "ScalarVariable",
            name=variable.name,
            valueReference=str(reference),
            description=variable.about,
            causality=variable.causality,
            variability=_variability(variable),
            initial="calculated" if variable.causality == "output" else "exact",
        )
        if variable.causality == "input":
            del scalar.attrib["initial"]  # FMI: an input must not have it
        ET.SubElement(scalar, "Boolean" if variable.flag else "Real", _attributes(variable))


def _variability(variable: Variable) -> str:
    if variable.causality == "parameter":
        return "fixed" if variable.fixed else "tunable"
    return "discrete" if variable.flag else "continuous"


def _attributes(variable: Variable) -> dict[str, str]:
    """Attributes of the type element; ``repr`` keeps all 17 digits."""
    if variable.flag:
        return {}
    numbers = {"min": variable.low, "max": variable.high, "nominal": variable.nominal}
    numbers["start"] = variable.start
    found = {name: repr(float(value)) for name, value in numbers.items() if value is not None}
    shown = {"displayUnit": variable.display} if variable.display else {}
    return {"unit": variable.unit, **shown, **found}


def _add_structure(root: ET.Element, model: Model) -> None:
    """Declare what depends on what; initial unknowns may depend on anything known."""
    structure = ET.SubElement(root, "ModelStructure")
    outputs = ET.SubElement(structure, "Outputs")
    unknowns = ET.SubElement(structure, "InitialUnknowns")
    first = len(model.plant.inputs) + 1
    for index, inputs in enumerate(direct_inputs(model.flat), start=first):
        depends = " ".join(str(i + 1) for i in inputs)
        ET.SubElement(outputs, "Unknown", index=str(index), dependencies=depends)
        ET.SubElement(unknowns, "Unknown", index=str(index))
