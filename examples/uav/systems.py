"""Which FMUs a system is made of, how they are connected, and the packages that say so.

A package is an SSP archive (``.ssp``: FMUs, and ``SystemStructure.ssd`` as its table of contents)
or a folder with ``OspSystemStructure.xml``.  Both are a few elements of XML.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

SSP = "http://ssp-standard.org/SSP1"
PREFIXES = {"ssd": "SystemStructureDescription", "ssv": "SystemStructureParameterValues",
            "ssc": "SystemStructureCommon"}  # fmt: skip
OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
OSP_SSP = "http://opensimulationplatform.com/SSP/OSPAnnotations"
OSP = "http://opensimulationplatform.com/MSMI/OSPSystemStructure"
EPOCH = (1980, 1, 1, 0, 0, 0)
"""Date in the archive: the same system gives the same bytes."""
SURFACES = ("left_aileron", "right_aileron", "elevator", "rudder")
SPLIT = {
    "left_flap": "left_aileron",
    "right_flap": "right_aileron",
    "left_tip": "left_aileron",
    "right_tip": "right_aileron",
    "second_elevator": "elevator",
    "second_rudder": "rudder",
}
"""Further surfaces of a UAV with ten, and with which of the four they move."""
READINGS = ("roll", "pitch", "roll_rate", "pitch_rate", "yaw_rate")


@dataclass(frozen=True)
class System:
    """FMUs and connections; every signal is a real number.

    Attributes:
        name: of the system.
        components: file of the FMU by the name of the instance.
        connections: pairs of an output and an input, each ``(instance, variable)``.
        starts: start values [SI] by ``(instance, variable)``.
        step: communication step [s].
    """

    name: str
    components: Mapping[str, Path]
    connections: tuple[tuple[tuple[str, str], tuple[str, str]], ...]
    starts: Mapping[tuple[str, str], float] = field(default_factory=dict)
    step: float = 1e-3

    def starts_of(self, instance: str) -> dict[str, float]:
        """Return the start values of one instance."""
        return {name: value for (owner, name), value in self.starts.items() if owner == instance}


def uav(
    name: str,
    servo: Path,
    fmus: Path,
    parameters: Mapping[str, Mapping[str, float]],
    commands: Mapping[str, float],
) -> System:
    """Return the UAV with several instances of one servo.

    Args:
        name: of the system.
        servo: FMU with an input ``pulse_width`` and an output ``angle``.
        fmus: folder of the other FMUs.
        parameters: of each servo [SI], where they are not those of the FMU; one for each surface,
            others move with the surface that ``SPLIT`` says.
        commands: start values [SI] of inputs of the autopilot.
    """
    pilot, airframe = (fmus / f"{part}.native.fmu" for part in ("autopilot", "airframe"))
    return System(
        name,
        {"autopilot": pilot, **dict.fromkeys(parameters, servo), "airframe": airframe},
        (
            *((("autopilot", f"{SPLIT.get(s, s)}_pulse"), (s, "pulse_width")) for s in parameters),
            *(((s, "angle"), ("airframe", s)) for s in SURFACES),
            *((("airframe", reading), ("autopilot", reading)) for reading in READINGS),
        ),
        {
            **{("autopilot", name): value for name, value in commands.items()},
            **{(s, name): x for s, values in parameters.items() for name, x in values.items()},
        },
    )


def write_ssp(system: System, path: Path) -> Path:
    """Write an SSP archive that fmpy, libcosim, ecos and OMSimulator read alike."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(_entry("SystemStructure.ssd"), _text(_ssd(system)))
        for fmu in dict.fromkeys(system.components.values()):
            archive.writestr(_entry(f"resources/{fmu.name}"), fmu.read_bytes())
    return path


def read_ssp(path: Path, folder: Path) -> System:
    """Unpack an SSP archive of this kind into a folder, and return its system."""
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    root = ElementTree.parse(folder / "SystemStructure.ssd").getroot()
    components = {c.attrib["name"]: c for c in root.iter(_ssp("ssd", "Component"))}
    ends = [
        (
            (c.attrib["startElement"], c.attrib["startConnector"]),
            (c.attrib["endElement"], c.attrib["endConnector"]),
        )
        for c in root.iter(_ssp("ssd", "Connection"))
    ]
    starts = {
        (name, parameter.attrib["name"]): float(parameter[0].attrib["value"])
        for name, component in components.items()
        for parameter in component.iter(_ssp("ssv", "Parameter"))
    }
    (master,) = (e for e in root.iter() if e.tag.endswith("FixedStepMaster"))
    return System(
        root.attrib["name"],
        {name: folder / c.attrib["source"] for name, c in components.items()},
        tuple(ends),
        starts,
        float(master.attrib["stepSize"]),
    )


def write_osp(system: System, folder: Path) -> Path:
    """Write the FMUs and ``OspSystemStructure.xml`` into a folder, and return the latter."""
    folder.mkdir(parents=True, exist_ok=True)
    for fmu in dict.fromkeys(system.components.values()):
        (folder / fmu.name).write_bytes(fmu.read_bytes())
    path = folder / "OspSystemStructure.xml"
    path.write_bytes(_text(_osp(system)))
    return path


def _ssd(system: System) -> Element:
    """The table of contents of an SSP archive."""
    for prefix, name in PREFIXES.items():
        ElementTree.register_namespace(prefix, f"{SSP}/{name}")
    # libcosim takes a name space that is declared further down for an algorithm
    spaces = {"xmlns:oms": OMS, "xmlns:osp": OSP_SSP}
    root = Element(
        _ssp("ssd", "SystemStructureDescription"), {"version": "1.0", "name": system.name} | spaces
    )
    whole = SubElement(root, _ssp("ssd", "System"), name=system.name)
    elements = SubElement(whole, _ssp("ssd", "Elements"))
    for instance, fmu in system.components.items():
        component = SubElement(
            elements,
            _ssp("ssd", "Component"),
            name=instance,
            type="application/x-fmu-sharedlibrary",
            source=f"resources/{fmu.name}",
        )
        connectors = SubElement(component, _ssp("ssd", "Connectors"))
        for name, kind in _connectors(system, instance):
            connector = SubElement(connectors, _ssp("ssd", "Connector"), name=name, kind=kind)
            SubElement(connector, _ssp("ssc", "Real"))
        if starts := system.starts_of(instance):  # libcosim looks for them below the connectors
            component.append(_parameters(starts))
    connections = SubElement(whole, _ssp("ssd", "Connections"))
    for (source, output), (sink, given) in system.connections:
        SubElement(
            connections,
            _ssp("ssd", "Connection"),
            startElement=source,
            startConnector=output,
            endElement=sink,
            endConnector=given,
        )
    step = f"{system.step!r}"
    master = _annotation(whole, "org.openmodelica", "oms:Annotations")
    SubElement(
        SubElement(master, "oms:SimulationInformation"),
        "oms:FixedStepMaster",
        description="oms-ma",
        stepSize=step,
        absoluteTolerance="0.0001",
        relativeTolerance="0.0001",
    )
    experiment = SubElement(root, _ssp("ssd", "DefaultExperiment"), startTime="0.0")
    algorithm = _annotation(experiment, "com.opensimulationplatform", "osp:Algorithm")
    SubElement(algorithm, "osp:FixedStepAlgorithm", baseStepSize=step)
    return root


def _annotation(parent: Element, owner: str, tag: str) -> Element:
    """What only one tool reads: here, the communication step."""
    annotation = SubElement(
        SubElement(parent, _ssp("ssd", "Annotations")), _ssp("ssc", "Annotation"), type=owner
    )
    return SubElement(annotation, tag)


def _connectors(system: System, instance: str) -> list[tuple[str, str]]:
    """Connected variables only: fmpy sets every connector, also one that nothing drives."""
    found = [
        (name, kind)
        for ends in system.connections
        for (owner, name), kind in zip(ends, ("output", "input"))
        if owner == instance
    ]
    return list(dict.fromkeys(found))  # an output may drive several inputs


def _parameters(starts: Mapping[str, float]) -> Element:
    """Start values; libcosim takes the set of this name where nobody chooses one."""
    bindings = Element(_ssp("ssd", "ParameterBindings"))
    values = SubElement(SubElement(bindings, _ssp("ssd", "ParameterBinding")),
                        _ssp("ssd", "ParameterValues"))  # fmt: skip
    chosen = SubElement(values, _ssp("ssv", "ParameterSet"), version="1.0", name="initial_values")
    parameters = SubElement(chosen, _ssp("ssv", "Parameters"))
    for name, value in starts.items():
        parameter = SubElement(parameters, _ssp("ssv", "Parameter"), name=name)
        SubElement(parameter, _ssp("ssv", "Real"), value=f"{value!r}")
    return bindings


def _osp(system: System) -> Element:
    """The structure of the Open Simulation Platform."""
    root = Element("OspSystemStructure", xmlns=OSP, version="0.1")
    SubElement(root, "StartTime").text = "0.0"
    SubElement(root, "BaseStepSize").text = f"{system.step!r}"
    SubElement(root, "Algorithm").text = "fixedStep"
    simulators = SubElement(root, "Simulators")
    for instance, fmu in system.components.items():
        simulator = SubElement(simulators, "Simulator", name=instance, source=fmu.name)
        if starts := system.starts_of(instance):
            values = SubElement(simulator, "InitialValues")
            for name, value in starts.items():
                initial = SubElement(values, "InitialValue", variable=name)
                SubElement(initial, "Real", value=f"{value!r}")
    connections = SubElement(root, "Connections")
    for ends in system.connections:
        connection = SubElement(connections, "VariableConnection")
        for owner, name in ends:
            SubElement(connection, "Variable", simulator=owner, name=name)
    return root


def _ssp(prefix: str, tag: str) -> str:
    return f"{{{SSP}/{PREFIXES[prefix]}}}{tag}"


def _text(root: Element) -> bytes:
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, "utf-8", xml_declaration=True)
    return text


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name, EPOCH)
    entry.compress_type = zipfile.ZIP_DEFLATED
    return entry
