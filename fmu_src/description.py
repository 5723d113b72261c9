"""Write modelDescription.xml: what all versions share, and FMI 2.0.4, sections 2.2 and 4.3."""

from __future__ import annotations

import copy
import re
import uuid
from collections.abc import Callable, Mapping
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
class Version:
    """What one version of FMI writes in its own way.

    Attributes:
        name: of the version.
        token: attribute that tells which library a description belongs to.
        add_interface: writes the element of co-simulation, with what the FMU can do.
        add_variables: writes the variables.
        add_structure: writes which of them depend on which.
    """

    name: str
    token: str
    add_interface: Callable[[ET.Element, Model, Form], None]
    add_variables: Callable[[ET.Element, list[Variable]], None]
    add_structure: Callable[[ET.Element, Model], None]


@dataclass(frozen=True)
class Form:
    """What tells a Python FMU from a native one, for its description.

    Attributes:
        version: of FMI.
        directional_derivatives: whether it has them.
        log_categories: with what each is for.
        sources: C files to compile.
        needs: what the host has to bring, in a sentence.
    """

    version: Version
    directional_derivatives: bool
    log_categories: Mapping[str, str]
    sources: tuple[str, ...]
    needs: str


def model_description(model: Model, form: Form, identity: str, tool: str) -> bytes:
    """Return the file's bytes.

    Args:
        model: what the FMU simulates.
        form: Python or native, and the version of FMI.
        identity: of its code: a text with the hash of it.
        tool: name and version of what built it.

    The token is a hash of everything else in the file, and of the identity.
    """
    actuator = model.actuator
    every = variables(model)
    version = form.version
    root = ET.Element("fmiModelDescription", fmiVersion=version.name, modelName=actuator.name)
    root.set(version.token, identity)
    root.set("description", described(model))
    root.set("generationTool", tool)
    root.set("generationDateAndTime", "{:04}-{:02}-{:02}T{:02}:{:02}:{:02}Z".format(*BUILT))
    root.set("variableNamingConvention", "structured")
    version.add_interface(root, model, form)
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
    version.add_variables(root, every)
    version.add_structure(root, model)
    root.set(version.token, token_of(root, identity, version))
    ET.indent(root)
    text: bytes = ET.tostring(root, "UTF-8", xml_declaration=True)
    return text + b"\n"


def token_of(description: ET.Element, identity: str, version: Version) -> str:
    """Return the token of a description, indented or not: a hash of everything else in it."""
    root = copy.deepcopy(description)
    root.set(version.token, identity)
    for element in root.iter():
        element.text = element.tail = None  # our descriptions have attributes only
    return "{" + str(uuid.uuid5(uuid.NAMESPACE_URL, ET.tostring(root, "unicode"))) + "}"


def direct(flat: Flat, known: Mapping[str, int]) -> list[list[int]]:
    """Return for every output the numbers of the known that it depends on within zero time.

    An input or a parameter, ``known`` by its name in the text, reaches whatever a chain of blocks
    computes from it; integrators break the chain.  Memory does not: an effect with memory is the
    identity while it is neutral, and a sample taken now is passed on now.
    """
    reach = {name: {number} for name, number in known.items()}
    for chunk in (*flat.setup, *flat.held, *flat.stage):
        words = {*re.findall(r"\w+", " ".join(chunk.lines)), *flat.switches.get(chunk.owner, ())}
        read = words.intersection(flat.params).union(chunk.reads)
        found = {i for name in read for i in reach.get(name, ())}
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


def attributes_of(variable: Variable, reference: int) -> dict[str, str]:
    """Return what every version of FMI says about a variable, but for its type."""
    found = {
        "name": variable.name,
        "valueReference": str(reference),
        "description": variable.about,
        "causality": variable.causality,
        "variability": _variability(variable),
    }
    if variable.causality != "input":  # which must not have it
        found["initial"] = "calculated" if variable.causality == "output" else "exact"
    return found


def type_attributes(variable: Variable) -> dict[str, str]:
    """Return what belongs to the type; ``repr`` keeps all 17 digits."""
    if variable.flag:
        return {}
    numbers = {"min": variable.low, "max": variable.high, "nominal": variable.nominal}
    numbers["start"] = variable.start
    found = {name: repr(float(value)) for name, value in numbers.items() if value is not None}
    shown = {"displayUnit": variable.display} if variable.display else {}
    return {"unit": variable.unit, **shown, **found}


def _add_interface(root: ET.Element, model: Model, form: Form) -> None:
    derivatives = {"providesDirectionalDerivative": str(form.directional_derivatives).lower()}
    attributes = {"modelIdentifier": model.actuator.name, **CAPABILITIES, **derivatives}
    interface = ET.SubElement(root, "CoSimulation", attributes)
    if form.sources:
        files = ET.SubElement(interface, "SourceFiles")
        for name in form.sources:
            ET.SubElement(files, "File", name=name)


def _add_variables(root: ET.Element, every: list[Variable]) -> None:
    parent = ET.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(every):
        scalar = ET.SubElement(parent, "ScalarVariable", attributes_of(variable, reference))
        ET.SubElement(scalar, "Boolean" if variable.flag else "Real", type_attributes(variable))


def _variability(variable: Variable) -> str:
    if variable.causality == "parameter":
        return "fixed" if variable.fixed else "tunable"
    return "discrete" if variable.flag else "continuous"


def _add_structure(root: ET.Element, model: Model) -> None:
    """Declare what depends on what; initial unknowns may depend on anything known."""
    structure = ET.SubElement(root, "ModelStructure")
    outputs = ET.SubElement(structure, "Outputs")
    unknowns = ET.SubElement(structure, "InitialUnknowns")
    flat = model.flat
    inputs = {name: index for index, name in enumerate(flat.inputs, start=1)}
    for index, indices in enumerate(direct(flat, inputs), start=len(flat.inputs) + 1):
        depends = " ".join(map(str, indices))
        ET.SubElement(outputs, "Unknown", index=str(index), dependencies=depends)
        ET.SubElement(unknowns, "Unknown", index=str(index))


FMI2 = Version("2.0", "guid", _add_interface, _add_variables, _add_structure)
