"""What is in the file: checked by fmpy, by the schema's laws and by the catalogue."""

from __future__ import annotations

import ast
import hashlib
import math
import re
import shutil
import struct
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree as ET

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from servo_models.analysis.experiment import step
from servo_models.build import NATIVE, build
from servo_models.catalogue import actuators, model
from servo_models.core.simulate import Model
from servo_models.errors import UserError
from tests.conftest import MODELS
from tests.support.fmu_host import Host
from tests.support.html_page import Page
from tests.support.kinds import fmi2_only, python_only
from tests.support.own_actuators import write

Files = Callable[[str], Path]


def description(path: Path) -> ET.Element:
    with zipfile.ZipFile(path) as archive:
        return ET.fromstring(archive.read("modelDescription.xml"))


def slave_text(path: Path) -> str:
    with zipfile.ZipFile(path) as archive:
        name = archive.read("resources/slavemodule.txt").decode()
        return archive.read(f"resources/{name}.py").decode()


@pytest.mark.thorough
@pytest.mark.parametrize("name", MODELS)
def test_fmpy_finds_no_problem(name: str, fmu_file: Files) -> None:
    assert validate_fmu(str(fmu_file(name))) == []


@pytest.mark.thorough
@pytest.mark.parametrize("name", actuators())
def test_fmutool_finds_no_problem(name: str, fmu_file: Files) -> None:
    """A second checker, by other people."""
    if shutil.which("fmutool") is None:
        pytest.skip("fmutool is not installed: pip install fmu-manipulation-toolbox")
    command = ["fmutool", "-input", str(fmu_file(name)), "-check"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    told = done.stdout + done.stderr
    assert re.search(r"seems to be compliant with FMI-[23]\.0", told), told
    assert "No semantic error" in told


@pytest.mark.thorough
@pytest.mark.parametrize("name", MODELS)
def test_every_variable_of_the_model_is_declared_with_its_unit_and_value(
    name: str, fmu_file: Files
) -> None:
    chosen = model(*MODELS[name])
    plant = chosen.plant
    declared = {v.name: v for v in fmpy.read_model_description(str(fmu_file(name))).modelVariables}
    time = declared.pop("time", None)  # which FMI 3.0 has to have
    assert time is None or time.causality == "independent"
    assert set(declared) == {w.name for w in plant.inputs} | set(plant.outputs) | set(chosen.values)
    for key, value in chosen.values.items():
        param, found = plant.parameters[key].param, declared[key]
        assert float(found.start) == value  # all 17 digits
        assert (float(found.min), float(found.max)) == (param.low, param.high)
        assert (found.unit, found.displayUnit) == (param.unit, param.display)
        assert found.variability == ("fixed" if param.fixed else "tunable")
    for variable in declared.values():
        assert variable.description
        assert variable.type == "Boolean" or float(variable.nominal) > 0.0


UNITS = {  # by hand, from the definitions of the SI
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "N.m": {"kg": 1, "m": 2, "s": -2},
    "Ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "H": {"kg": 1, "m": 2, "s": -2, "A": -2},
    "N.m.s/rad": {"kg": 1, "m": 2, "s": -1, "rad": -1},
    "kg.m2": {"kg": 1, "m": 2},
    "rad/s": {"rad": 1, "s": -1},
    "1": {},
}
DISPLAYS = {
    ("rad", "deg"): 180.0 / math.pi,
    ("s", "us"): 1e6,
    ("s", "ms"): 1e3,
    ("A", "mA"): 1e3,
    ("rad/s", "deg/s"): 180.0 / math.pi,
}


def test_units_have_the_exponents_and_factors_of_the_si(fmu_file: Files) -> None:
    seen, shown = set(), set()
    for name in ("sg90", "torque_motor"):
        for unit in description(fmu_file(name)).iter("Unit"):
            base = unit.find("BaseUnit")
            assert base is not None
            if unit.get("name") in UNITS:
                seen.add(unit.get("name"))
                assert {k: int(v) for k, v in base.items()} == UNITS[str(unit.get("name"))]
            for display in unit.iter("DisplayUnit"):
                key = (str(unit.get("name")), str(display.get("name")))
                if key in DISPLAYS:
                    shown.add(key)
                    assert float(str(display.get("factor"))) == pytest.approx(DISPLAYS[key])
    assert {"V", "N.m", "H", "rad/s", "1"} <= seen
    assert {("rad", "deg"), ("s", "us"), ("A", "mA")} <= shown


def test_description_names_variant_source_and_warning(fmu_file: Files) -> None:
    text = str(description(fmu_file("sg90")).get("description"))
    variant = model("sg90").actuator.variant()
    for part in (variant.name, variant.source, variant.warning):
        assert part in text


def test_default_experiment_is_the_actuators(fmu_file: Files) -> None:
    experiment = description(fmu_file("torque_motor")).find("DefaultExperiment")
    actuator = model("torque_motor").actuator
    assert experiment is not None
    assert float(experiment.attrib["stopTime"]) == actuator.stop_time
    assert float(experiment.attrib["stepSize"]) == actuator.step_size


@pytest.mark.parametrize("name", MODELS)
def test_something_moves_in_the_default_experiment(name: str, fmu_file: Files) -> None:
    """A host that sets nothing sees the standard step, as ``servo-models simulate`` does."""
    chosen = model(*MODELS[name])
    main = chosen.plant.outputs[0]
    result = fmpy.simulate_fmu(str(fmu_file(name)), output=[main])
    told = step(chosen)
    assert np.ptp(told[main]) > 1e-2 * chosen.plant.wire[main].scale
    assert result[main][-1] == pytest.approx(told[main][-1], rel=1e-6)


def test_documentation_is_made_from_the_declaration(tmp_path: Path) -> None:
    chosen = model("torque_motor", "measured", {"backlash.half_width": "0.25 deg"})
    with zipfile.ZipFile(build(chosen, tmp_path / "valve.fmu")) as archive:
        page = archive.read("documentation/index.html").decode()
    read = Page(page)
    read.assert_stands_alone()
    words, rows = " ".join(" ".join(read.text).split()), {row[0]: row for row in read.rows if row}
    variant = chosen.actuator.variant("measured")
    for told in (chosen.actuator.title, "variant measured", variant.source):
        assert told in words
    for name in (*(wire.name for wire in chosen.plant.inputs), *chosen.plant.outputs):
        assert name in rows
    assert {name.rstrip("*") for name in rows} >= set(chosen.values)
    assert rows["backlash.half_width*"][1] == "0.25"
    assert rows["backlash.half_width*"][4] == "deg"


@fmi2_only
def test_the_icon_is_where_fmi_wants_it(fmu_file: Files) -> None:
    """FMI 2.0.4, section 2.3: ``model.png`` at the top; a PNG begins with its size."""
    with zipfile.ZipFile(fmu_file("sg90")) as archive:
        icon = archive.read("model.png")
    assert icon[:8] == b"\x89PNG\r\n\x1a\n"
    assert struct.unpack(">II", icon[16:24]) == (100, 100)


def random_parameters(chosen: Model, rng: np.random.Generator) -> dict[str, float]:
    """Some effects switched on at moderate values."""
    return {
        key: p.param.typical
        for key, p in chosen.plant.parameters.items()
        if p.param.switch and rng.random() < 0.2
    }


@pytest.mark.thorough
@fmi2_only
@pytest.mark.parametrize("name", [*actuators(), "oscillatory"])
def test_outputs_depend_directly_on_what_is_declared_and_on_nothing_else(
    name: str, fmu_file: Files, fmu_folder: Files
) -> None:
    """Move one input while initialising: only outputs that declare it may move."""
    root = description(fmu_file(name))
    names = [v.attrib["name"] for v in root.iter("ScalarVariable")]
    declared = {
        names[int(u.attrib["index"]) - 1]: {
            names[int(i) - 1] for i in u.attrib["dependencies"].split()
        }
        for u in root.iterfind("ModelStructure/Outputs/Unknown")
    }
    rng = np.random.default_rng(7)
    chosen = model(*MODELS[name])
    moved: dict[str, set[str]] = {output: set() for output in declared}
    with Host(fmu_folder(name)) as host:
        for _ in range(30):
            host.fmu.reset()
            host.fmu.setupExperiment()
            host.fmu.enterInitializationMode()
            prompt = {n: 0.0 for n in chosen.values if n == "transport_delay.time"}
            host.set(prompt | random_parameters(chosen, rng))
            for wire in chosen.plant.inputs:
                assert wire.low is not None
                assert wire.high is not None
                before = host.get()
                host.set({wire.name: float(rng.uniform(wire.low, wire.high))})
                for output, old, new in zip(host.outputs, before, host.get()):
                    if old != new:
                        moved[output].add(wire.name)
    for output, inputs in moved.items():
        assert inputs <= declared[output]
    if name == "sg90":  # an amplifier within its supply has no memory
        assert {"pulse_width", "supply_voltage"} <= moved["motor_voltage"]


@fmi2_only
def test_integrated_outputs_have_no_direct_dependency(fmu_file: Files) -> None:
    """The speed of a rotor cannot follow a voltage within zero time."""
    root = description(fmu_file("sg90"))
    names = [v.attrib["name"] for v in root.iter("ScalarVariable")]
    unknown = next(
        u
        for u in root.iterfind("ModelStructure/Outputs/Unknown")
        if names[int(u.attrib["index"]) - 1] == "motor_speed"
    )
    assert unknown.attrib["dependencies"] == ""


@pytest.mark.thorough
@python_only
def test_slave_needs_the_standard_library_and_pythonfmu_only(fmu_file: Files) -> None:
    for name in MODELS:
        roots = {
            (alias.name if isinstance(node, ast.Import) else str(node.module)).split(".")[0]
            for node in ast.walk(ast.parse(slave_text(fmu_file(name))))
            if isinstance(node, (ast.Import, ast.ImportFrom))
            for alias in node.names
        }
        assert roots <= sys.stdlib_module_names | {"pythonfmu"}


@python_only
def test_different_models_have_different_slaves_and_guids(fmu_file: Files) -> None:
    names, guids = set(), set()
    for name in MODELS:
        with zipfile.ZipFile(fmu_file(name)) as archive:
            names.add(archive.read("resources/slavemodule.txt"))
        guids.add(description(fmu_file(name)).get("guid"))
    assert len(names) == len(guids) == len(MODELS)


def test_same_model_gives_the_same_bytes_in_any_folder(tmp_path: Path) -> None:
    digests = set()
    for folder in ("here", "somewhere else"):
        path = build(model("torque_motor"), tmp_path / folder / "torque_motor.fmu")
        digests.add(hashlib.sha256(path.read_bytes()).hexdigest())
    assert len(digests) == 1


def test_archive_holds_no_cache_and_no_path_of_the_machine(fmu_file: Files) -> None:
    path = fmu_file("sg90")
    with zipfile.ZipFile(path) as archive:
        assert not [n for n in archive.namelist() if "__pycache__" in n or n.endswith(".pyc")]
        texts = [
            archive.read(n).decode() for n in archive.namelist() if n.endswith((".py", ".xml"))
        ]
    for text in texts:
        assert str(Path(__file__).parents[2]) not in text
        assert not re.search(r"/tmp/|/home/|[A-Z]:\\\\", text)


def test_a_name_without_fmu_is_refused_with_the_cure(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"let it end in \.fmu"):
        build(model("sg90"), tmp_path / "sg90.zip")
    assert list(tmp_path.iterdir()) == []


def test_a_block_without_a_form_in_c_is_told_with_the_cure(tmp_path: Path) -> None:
    last = "    return (goal - angle) / time_constant\n"
    own = write(tmp_path, changes={last: "    return goal // 0.3 - angle\n"})
    with pytest.raises(UserError, match=r"'joint' as C: 'goal // 0.3' has no form in C; .*Python"):
        build(model(str(own)), tmp_path / "joint.fmu", NATIVE)


def test_without_a_compiler_the_cure_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("servo_models.core.compilers.compiler", lambda: None)
    with pytest.raises(UserError, match=r"no C compiler.*pip install"):
        build(model("sg90"), tmp_path / "sg90.fmu", NATIVE)
    assert list(tmp_path.iterdir()) == []
