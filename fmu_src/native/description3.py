"""What an FMI 3.0 FMU says in its own way (FMI 3.0.1, sections 2.4 and 4.4): description, build of
the sources, terminals."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from fmu_src.description import Form, Version, attributes_of, direct, type_attributes
from fmu_src.variables import Variable, variables
from servo_models.core.plant import TIME_AXIS
from servo_models.core.simulate import Model

CAPABILITIES = {
    "needsExecutionTool": "false",
    "canBeInstantiatedOnlyOncePerProcess": "false",
    "canGetAndSetFMUState": "true",
    "canSerializeFMUState": "true",
    "providesPerElementDependencies": "false",
    "canHandleVariableCommunicationStepSize": "true",
    "maxOutputDerivativeOrder": "0",
    "providesIntermediateUpdate": "false",
    "mightReturnEarlyFromDoStep": "false",
    "canReturnEarlyAfterIntermediateUpdate": "false",
    "hasEventMode": "false",
}


def time_name(names: Sequence[str]) -> str:
    """Return the name of the independent variable beside others: no author's ends with ``_``."""
    return f"{TIME_AXIS}_" if TIME_AXIS in names else TIME_AXIS


def build_description(model: Model, form: Form) -> bytes:
    """Return ``sources/buildDescription.xml``."""
    root = ET.Element("fmiBuildDescription", fmiVersion=form.version.name)
    build = ET.SubElement(root, "BuildConfiguration", modelIdentifier=model.actuator.name)
    files = ET.SubElement(build, "SourceFileSet", language="C99")
    for name in form.sources:
        ET.SubElement(files, "SourceFile", name=name)
    return _text(root)


def terminals_and_icons(model: Model, form: Form) -> bytes:
    """Return ``terminalsAndIcons/terminalsAndIcons.xml``: which variables hosts connect as one.

    A member is called like its variable, and partners are matched by these names.
    """
    terminals = {"command": (model.step[0],), **model.plant.terminals}
    root = ET.Element("fmiTerminalsAndIcons", fmiVersion=form.version.name)
    picture = ET.SubElement(root, "GraphicalRepresentation")
    ET.SubElement(picture, "Icon", x1="-100", y1="-100", x2="100", y2="100")
    parent = ET.SubElement(root, "Terminals")
    for name, members in terminals.items():
        terminal = ET.SubElement(parent, "Terminal", name=name, matchingRule="plug")
        for member in members:
            ET.SubElement(
                terminal,
                "TerminalMemberVariable",
                variableName=member,
                memberName=member,
                variableKind="signal",
            )
    return _text(root)


def _text(root: ET.Element) -> bytes:
    ET.indent(root)
    text: bytes = ET.tostring(root, "UTF-8", xml_declaration=True)
    return text + b"\n"


def _add_interface(root: ET.Element, model: Model, form: Form) -> None:
    names = ("providesDirectionalDerivatives", "providesAdjointDerivatives")
    derivatives = dict.fromkeys(names, str(form.directional_derivatives).lower())
    attributes = {"modelIdentifier": model.actuator.name, **CAPABILITIES, **derivatives}
    ET.SubElement(root, "CoSimulation", attributes)


def _add_variables(root: ET.Element, every: list[Variable]) -> None:
    """The variables of FMI 2.0 with the same value references, and time behind them."""
    parent = ET.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(every):
        attributes = {**attributes_of(variable, reference), **type_attributes(variable)}
        ET.SubElement(parent, "Boolean" if variable.flag else "Float64", attributes)
    ET.SubElement(
        parent,
        "Float64",
        name=time_name([variable.name for variable in every]),
        valueReference=str(len(every)),
        description="time that the last step has reached",
        causality="independent",
        variability="continuous",
        unit="s",
    )


def _add_structure(root: ET.Element, model: Model) -> None:
    """Declare what depends on what: FMI 3.0 counts parameters that may change among the known."""
    structure = ET.SubElement(root, "ModelStructure")
    flat, every = model.flat, variables(model)
    first = len(flat.inputs) + len(flat.outputs)
    known = {name: reference for reference, name in enumerate(flat.inputs)}
    for reference, (name, variable) in enumerate(zip(flat.params, every[first:]), start=first):
        known |= {} if variable.fixed else {name: reference}
    for reference, depends in enumerate(direct(flat, known), start=len(flat.inputs)):
        listed = " ".join(map(str, depends))
        ET.SubElement(structure, "Output", valueReference=str(reference), dependencies=listed)
    for reference in range(len(flat.inputs), first):
        ET.SubElement(structure, "InitialUnknown", valueReference=str(reference))


FMI3 = Version("3.0", "instantiationToken", _add_interface, _add_variables, _add_structure)
