"""What the FMI 3.0 FMUs have of their own; the other tests of this folder run them too."""

from __future__ import annotations

import ctypes
import subprocess
import sys
import zipfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from lxml import etree

from fmu_src.native import archive
from fmu_src.native.archive import NATIVE3, headers, native_entries
from fmu_src.variables import variables
from servo_models.build import FMI3, build
from servo_models.catalogue import actuator, actuators, model
from servo_models.core.compilers import TARGETS, Compiler
from servo_models.core.plant import Plant, Wire
from servo_models.core.simulate import Model
from servo_models.validation.fmu_subject import Subject
from servo_models.validation.implementation import implementation_rows
from tests.conftest import Run
from tests.support.archives import with_description
from tests.support.fmu_host import Host
from tests.support.kinds import fmi3_only
from tests.support.own_actuators import write

pytestmark = [fmi3_only, pytest.mark.usefixtures("kind")]
Files = Callable[[str], Path]
SCHEMAS = Path(str(fmpy.__file__)).parent / "schema" / "fmi3"
FILES = {
    "modelDescription.xml": "fmi3ModelDescription.xsd",
    "sources/buildDescription.xml": "fmi3BuildDescription.xsd",
    "terminalsAndIcons/terminalsAndIcons.xml": "fmi3TerminalsAndIcons.xsd",
}
TERMINALS = {
    "sg90": {
        "command": ["pulse_width"],
        "shaft": ["load_torque", "angle", "rate"],
        "supply": ["supply_voltage"],
    },
    "torque_motor": {"command": ["voltage"], "shaft": ["load_torque", "angle", "rate"]},
    "linear_drive": {"command": ["reference"], "shaft": ["load_force", "position", "speed"]},
    "smart_servo": {
        "command": ["goal", "enabled"],
        "shaft": ["load_torque", "angle", "rate"],
        "supply": ["supply"],
    },
    "second_order_servo": {
        "command": ["pulse_width", "goal"],
        "shaft": ["load_torque", "angle", "rate"],
    },
    "dc_motor": {"command": ["voltage"], "shaft": ["load_torque", "angle", "rate"]},
    "dc_motor_current": {
        "command": ["current_command"],
        "shaft": ["load_torque", "angle", "rate"],
    },
    "dc_motor_speed": {
        "command": ["speed_command", "position_command"],
        "shaft": ["load_torque", "angle", "rate"],
    },
}


def refused(host: Host, call: Callable[[], object], *parts: str) -> None:
    with pytest.raises(FMICallException):
        call()
    for part in parts:
        assert part in host.messages[-1][1]


# ---- the files


@pytest.mark.thorough
@pytest.mark.parametrize("name", actuators())
def test_every_file_follows_the_schema_of_the_standard(name: str, fmu_file: Files) -> None:
    with zipfile.ZipFile(fmu_file(name)) as fmu:
        for file, schema in FILES.items():
            etree.XMLSchema(file=str(SCHEMAS / schema)).assertValid(
                etree.fromstring(fmu.read(file))
            )


@pytest.mark.parametrize("name", actuators())
def test_names_and_value_references_are_those_of_fmi_2(name: str, fmu_file: Files) -> None:
    found = fmpy.read_model_description(str(fmu_file(name))).modelVariables
    *ours, time = sorted(found, key=lambda v: v.valueReference)
    assert [v.name for v in ours] == [v.name for v in variables(model(name))]
    assert [v.valueReference for v in found] == [*range(len(found))]
    assert (time.name, time.causality, time.unit) == ("time", "independent", "s")


@pytest.mark.parametrize("name", actuators())
def test_terminals_are_command_shaft_and_supply(name: str, fmu_file: Files) -> None:
    with zipfile.ZipFile(fmu_file(name)) as fmu:
        root = ET.fromstring(fmu.read("terminalsAndIcons/terminalsAndIcons.xml"))
        assert fmu.read("terminalsAndIcons/icon.png")[:4] == b"\x89PNG"
    found = {
        terminal.attrib["name"]: [member.attrib["variableName"] for member in terminal]
        for terminal in root.iter("Terminal")
    }
    assert found == TERMINALS[name]


def test_a_terminal_of_what_is_no_signal_is_refused() -> None:
    goal = Wire("goal", "rad", "goal")
    with pytest.raises(ValueError, match="unknown input or output 'gaol' in terminal 'shaft'"):
        Plant((goal,), (), (), (), (), terminals={"shaft": ("gaol",)})


def test_time_gives_way_to_a_parameter_of_that_name(tmp_path: Path) -> None:
    own = actuator(str(write(tmp_path, changes={"time_constant": "time"})))
    path = build(model(own), tmp_path / "joint.fmu", FMI3)
    found = {v.name: v for v in fmpy.read_model_description(str(path)).modelVariables}
    assert found["time"].causality == "parameter"
    assert found["time_"].causality == "independent"
    assert fmpy.simulate_fmu(str(path), stop_time=0.1)["angle"][-1] > 0.0


def test_one_fmu_has_a_folder_for_every_platform(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "compile_library", lambda *_: b"library")
    compiler = Compiler(("none",), "", TARGETS, is_zig=False)
    entries = native_entries(model("sg90"), NATIVE3, compiler, TARGETS)
    assert {name for name in entries if name.startswith("binaries/")} == {
        "binaries/x86_64-linux/sg90.so",
        "binaries/aarch64-linux/sg90.so",
        "binaries/x86_64-windows/sg90.dll",
        "binaries/x86_64-darwin/sg90.dylib",
        "binaries/aarch64-darwin/sg90.dylib",
    }


def test_build_names_it_and_needs_a_compiler(
    tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    build_it = ("build", "torque_motor", "--fmi", "3", "--out", tmp_path)
    code, out, _ = run(*build_it)
    assert (code, out.strip()) == (0, str(tmp_path / "torque_motor.fmi3.fmu"))
    assert [it.name for it in tmp_path.iterdir()] == ["torque_motor.fmi3.fmu"]
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    code, out, err = run(*build_it)
    assert (code, out) == (2, "")
    assert 'no C compiler was found: pip install ".[native]"' in err


@pytest.mark.parametrize("name", actuators())
def test_outputs_depend_directly_on_no_more_than_is_declared(
    name: str, fmu_file: Files, fmu_folder: Files
) -> None:
    """With all effects on, no other input or parameter has a derivative unlike 0."""
    chosen = model(name)
    on = {n: p.param.typical for n, p in chosen.plant.parameters.items() if p.param.switch}
    with zipfile.ZipFile(fmu_file(name)) as fmu:
        root = ET.fromstring(fmu.read("modelDescription.xml"))
    known = {
        int(v.attrib["valueReference"])
        for v in root.iterfind("ModelVariables/*")
        if v.get("causality") == "input" or v.get("variability") == "tunable"
    }
    zero = 0
    with Host(fmu_folder(name)) as host:
        host.start({**on, chosen.actuator.step[0]: chosen.actuator.step[1]})
        host.fmu.doStep(0.0, 0.013)
        flags = {host.reference[name] for name in host.flags}
        for output in root.iterfind("ModelStructure/Output"):
            reference = int(output.attrib["valueReference"])
            declared = {int(word) for word in output.attrib["dependencies"].split()}
            assert declared <= known
            for other in sorted(known - declared) if reference not in flags else ():
                try:
                    slope = host.fmu.getDirectionalDerivative([reference], [other], [1.0])
                except FMICallException:  # a bound or a kink
                    continue
                assert slope == [0.0], (reference, other)
                zero += 1
    assert zero > 50


# ---- the calls


def test_time_is_read_as_a_variable_and_never_set(host: Host, fmu_folder: Files) -> None:
    time = host.reference["time"]
    assert host.fmu.getReal([time, host.reference["voltage"], time]) == [1e-3, 10.0, 1e-3]
    host.fmu.terminate()
    assert host.fmu.getReal([time]) == [1e-3]
    host.fmu.reset()
    host.fmu.setupExperiment(startTime=2.5)
    host.fmu.enterInitializationMode()
    assert host.fmu.getReal([time]) == [2.5]
    refused(host, lambda: host.fmu.setReal([time], [3.0]), "is time, which can only be read")
    host.fmu.reset()
    refused(host, lambda: host.fmu.getBoolean([time]), "is time, which can only be read")


def test_a_message_is_no_printf_format(host: Host) -> None:
    refused(host, lambda: host.fmu.setDebugLogging(True, ["100 %s"]), "no log category '100 %s'")


def test_what_a_step_tells(host: Host) -> None:
    assert host.fmu.doStep(1e-3, 2e-3) == (False, False, False, 3e-3)


@pytest.mark.parametrize("missing", range(4))
def test_a_step_without_a_place_for_its_results_is_refused(host: Host, missing: int) -> None:
    places: list[Any] = [ctypes.byref(ctypes.c_bool()) for _ in range(3)]
    places.append(ctypes.byref(ctypes.c_double()))
    places[missing] = None
    slave = host.fmu.slave
    refused(
        host,
        lambda: slave.fmi3DoStep(slave.component, 1e-3, 1e-3, True, *places),
        "fmi3DoStep: an argument is missing (NULL)",
    )


def test_as_many_values_as_variables(host: Host) -> None:
    slave, two = host.fmu.slave, (ctypes.c_double * 2)(1.0, 2.0)
    one = (ctypes.c_uint * 1)(0)
    refused(
        host,
        lambda: slave.fmi3SetFloat64(slave.component, one, 1, two, 2),
        "fmi3SetFloat64: 2 values for 1 variables",
    )


TYPES = (
    "Float32",
    *(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)),
    "String",
)


@pytest.mark.parametrize("call", [f"get{kind}" for kind in TYPES])
def test_no_variable_has_another_type(host: Host, call: str) -> None:
    assert getattr(host.fmu, call)([]) == []
    refused(host, lambda: getattr(host.fmu, call)([0]), f"this FMU has no {call[3:]}")


ABSENT = {
    "event mode": (
        *("EnterEventMode", "EnterStepMode", "EvaluateDiscreteStates", "UpdateDiscreteStates"),
    ),
    "structural parameters": ("EnterConfigurationMode", "ExitConfigurationMode"),
    "dependencies": ("GetNumberOfVariableDependencies", "GetVariableDependencies"),
    "clocks": (
        *("GetClock", "SetClock", "ActivateModelPartition"),
        *(f"Get{kind}{form}" for kind in ("Interval", "Shift") for form in ("Decimal", "Fraction")),
        *(f"Set{kind}{form}" for kind in ("Interval", "Shift") for form in ("Decimal", "Fraction")),
    ),
    "not for model exchange": (
        *("EnterContinuousTimeMode", "CompletedIntegratorStep", "SetTime"),
        *("SetContinuousStates", "GetContinuousStates", "GetContinuousStateDerivatives"),
        *("GetNominalsOfContinuousStates", "GetEventIndicators"),
        *("GetNumberOfEventIndicators", "GetNumberOfContinuousStates"),
    ),
}


def test_what_is_absent_is_refused_and_changes_nothing(host: Host) -> None:
    library = host.fmu.slave.dll
    for reason, names in ABSENT.items():
        for name in names:
            function = getattr(library, f"fmi3{name}")
            others = [kind() for kind in (function.argtypes or [None])[1:]]
            component = ctypes.c_void_p(host.fmu.component)
            assert function(component, *others) == 3
            assert host.messages[-1][1].startswith(f"fmi3{name}: ")
            assert reason in host.messages[-1][1]
    host.fmu.doStep(1e-3, 1e-3)


INSTANTIATE: dict[str, tuple[dict[str, Any], str]] = {
    "token": ({"guid": "{0}"}, "the instantiation token is not that of this library"),
    "name": ({"instanceName": ""}, "without an instance name"),
    "events": ({"eventModeUsed": True}, "no event mode"),
    "intermediate": ({"requiredIntermediateVariables": [0]}, "no intermediate update"),
}


@pytest.mark.parametrize("name", INSTANTIATE)
def test_an_instance_is_refused_with_the_reason(host: Host, name: str) -> None:
    """On the slave of the fixture, whose own instance is kept for its end."""
    changes, reason = INSTANTIATE[name]
    slave, component = host.fmu.slave, host.fmu.component
    arguments = {key: value for key, value in changes.items() if not hasattr(slave, key)}
    for key in changes.keys() - arguments.keys():
        setattr(slave, key, changes[key])
    with pytest.raises(Exception, match="Failed to instantiate"):
        slave.instantiate(logMessage=host._hear, loggingOn=True, **arguments)
    slave.component = component
    assert reason in host.messages[-1][1]


@pytest.mark.parametrize(
    ("function", "form"),
    [
        ("fmi3InstantiateModelExchange", "model exchange"),
        ("fmi3InstantiateScheduledExecution", "scheduled execution"),
    ],
)
def test_it_is_for_co_simulation_only(
    fmu_folder: Files, capfd: pytest.CaptureFixture[str], function: str, form: str
) -> None:
    with Host(fmu_folder("torque_motor")) as host:
        instantiate = getattr(host.fmu.slave.dll, function)
        instantiate.restype, instantiate.argtypes = ctypes.c_void_p, None
        nothing = [None] * 8
        assert instantiate(b"motor", b"", None, False, False, *nothing) is None
    assert f"motor: this FMU is for co-simulation only, not for {form}" in capfd.readouterr().err


# ---- derivatives


def test_directional_derivatives_are_the_slopes_of_the_equations(fmu_folder: Files) -> None:
    """u = K_AP (U_in - K_f k_FS theta), with 5 V over a frame of 20 ms: at rest, in volts."""
    with Host(fmu_folder("sg90_linear")) as host:
        host.fmu.setupExperiment()
        host.fmu.enterInitializationMode()
        host.set({"pulse_width": 1.6e-3})
        u, pulse, gain = (
            host.reference[n] for n in ("motor_voltage", "pulse_width", "amplifier_gain")
        )
        by_pulse = host.fmu.getDirectionalDerivative([u], [pulse], [2.0])
        by_both = host.fmu.getDirectionalDerivative([u], [pulse, gain], [1e-4, 1.0])
    assert by_pulse[0] == pytest.approx(2.0 * 7.47 * 250.0, rel=1e-6)
    assert by_both[0] == pytest.approx(7.47 * 250.0 * 1e-4 + 250.0 * 0.1e-3, rel=1e-6)


def test_adjoint_derivatives_are_the_transpose_of_directional_ones(fmu_folder: Files) -> None:
    rng = np.random.default_rng(1)
    with Host(fmu_folder("sg90_linear")) as host:
        host.fmu.setupExperiment()
        host.fmu.enterInitializationMode()
        host.set({"pulse_width": 1.6e-3})
        outputs = [host.reference[n] for n in ("motor_voltage", "feedback_voltage", "angle")]
        knowns = [host.reference[n] for n in ("pulse_width", "amplifier_gain")]
        seed, weights = rng.normal(size=2), rng.normal(size=3)
        forward = host.fmu.getDirectionalDerivative(outputs, knowns, list(seed))
        back = host.fmu.getAdjointDerivative(outputs, knowns, list(weights), len(knowns))
    assert forward[0] != 0.0
    assert np.dot(weights, forward) == pytest.approx(np.dot(back, seed), rel=1e-9)


def test_at_a_bound_there_is_no_derivative_and_the_run_goes_on(host: Host) -> None:
    torque = host.reference["motor_torque"]
    switch = host.reference["drive_dead_zone.half_width"]  # 0, its lowest value
    for call in (host.fmu.getDirectionalDerivative, host.fmu.getAdjointDerivative):
        with pytest.raises(FMICallException) as caught:
            call([torque], [switch], [1.0])
        assert caught.value.status == 2
        assert "a jump, a kink or a bound" in host.messages[-1][1]
    host.fmu.doStep(1e-3, 1e-3)


# ---- the numbers


def jumping(chosen: Model, times: np.ndarray[Any, Any], seed: int) -> np.ndarray[Any, Any]:
    rng = np.random.default_rng(seed)
    columns = [
        np.clip(float(w.rest) + 0.4 * w.scale * rng.uniform(-1.0, 1.0, 8), w.low, w.high)
        for w in chosen.plant.inputs
    ]
    return np.column_stack(columns)[8 * np.arange(len(times)) // len(times)]


@pytest.mark.parametrize("name", actuators())
def test_instances_in_threads_equal_the_simulation(name: str, fmu_folder: Files) -> None:
    chosen = model(name)
    times = np.cumsum(np.random.default_rng(3).uniform(2e-4, 3e-3, 120))
    inputs = [jumping(chosen, times, seed) for seed in range(4)]
    hosts = [Host(fmu_folder(name)) for _ in inputs]
    with ThreadPoolExecutor(len(hosts)) as pool:
        found = [*pool.map(lambda it: it[0].simulate(times, it[1]), zip(hosts, inputs))]
    for host, rows, values in zip(hosts, found, inputs):
        host.fmu.freeInstance()
        assert np.array_equal(rows, chosen.run(times, values))


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="cc as on Linux")
def test_its_sources_compile_to_the_same_numbers(fmu_file: Files, tmp_path: Path) -> None:
    """As an importer does it: language and files of buildDescription.xml, no flag of ours."""
    folder = Path(fmpy.extract(str(fmu_file("torque_motor")), str(tmp_path / "fmu")))
    (build_configuration,) = ET.parse(folder / "sources" / "buildDescription.xml").getroot()
    (files,) = build_configuration
    (library,) = (folder / "binaries").glob("*/torque_motor.so")
    library.unlink()
    warnings = ("-Wall", "-Wextra", "-Wpedantic", "-Werror")
    command = ["cc", f"-std={files.attrib['language'].lower()}", *warnings, "-O2", "-fPIC"]
    command += ["-shared", f"-I{headers()}", *(file.attrib["name"] for file in files)]
    subprocess.run([*command, "-o", library, "-lm"], cwd=folder / "sources", check=True)
    chosen, times = model("torque_motor"), np.arange(0.0, 0.1, 0.7e-3)
    inputs = jumping(chosen, times, 1)
    with Host(folder) as host:
        assert np.array_equal(host.simulate(times, inputs), chosen.run(times, inputs))


@pytest.mark.thorough
def test_validate_compares_it_and_its_description(fmu_file: Files, tmp_path: Path) -> None:
    good = Subject(fmu_file("torque_motor"))
    rows = implementation_rows(good)
    good.close()
    assert all(row.passed for row in rows)
    assert {row.value for row in rows} == {0.0}
    changed = with_description(
        fmu_file("torque_motor"),
        tmp_path / "changed.fmu",
        lambda text: text.replace(b'unit="V"', b'unit="V/s"', 1),
    )
    bad = Subject(changed)
    description = implementation_rows(bad)[0]
    bad.close()
    assert not description.passed
    assert "ModelVariables is not that of the actuator" in description.note
    assert "'instantiationToken' is not that of this description" in description.note
