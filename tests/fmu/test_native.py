"""What the native FMU alone has: calls that no Python slave ever sees, derivatives, sources."""

from __future__ import annotations

import ctypes
import math
import shutil
import struct
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from fmu_src.native.archive import headers
from servo_models.build import NATIVE, build
from servo_models.catalogue import model
from tests.conftest import MODELS
from tests.support.fmu_host import CALLBACKS, Host, place_in_x
from tests.support.kinds import native_only
from tests.support.own_actuators import write

Files = Callable[[str], Path]
pytestmark = native_only
DISCARD, ERROR = 2, 3
HEADER = struct.Struct("=8s64sQdQ")
"""Of a saved state: magic, identity, bytes, 1.0, digest; the times begins, last and time follow."""
TIMES = 3


def library(folder: Path) -> Any:
    (path,) = (folder / "binaries").glob("*/*.*")
    loaded = ctypes.CDLL(str(path))
    loaded.fmi2Instantiate.restype = ctypes.c_void_p
    return loaded


# Calls that pythonfmu's binary does not hand on


def test_another_guid_gives_no_instance(host: Host, fmu_folder: Files) -> None:
    """A library beside the description of another build would take its values for others."""
    guid = host.description.guid.encode()
    instantiate = library(fmu_folder("torque_motor")).fmi2Instantiate
    for given, type_of_fmu, is_made in (
        (guid, 1, True),
        (b"{" + guid[2:], 1, False),
        (b"", 1, False),
        (None, 1, False),
        (guid, 0, False),  # model exchange
    ):
        made = instantiate(b"it", type_of_fmu, given, None, ctypes.byref(CALLBACKS), 0, 0)
        assert bool(made) is is_made
    assert not instantiate(b"it", 1, guid, None, None, 0, 0)  # without callback functions
    assert not instantiate(b"", 1, guid, None, ctypes.byref(CALLBACKS), 0, 0)
    assert not instantiate(None, 1, guid, None, ctypes.byref(CALLBACKS), 0, 0)


@pytest.mark.parametrize(
    ("call", "arguments"),
    [
        ("fmi2GetReal", [None, ctypes.c_size_t(1), None]),
        ("fmi2SetReal", [None, ctypes.c_size_t(1), None]),
        ("fmi2GetBoolean", [None, ctypes.c_size_t(1), None]),
        ("fmi2GetFMUstate", [None]),
        ("fmi2SetFMUstate", [None]),
        ("fmi2SerializedFMUstateSize", [None, None]),
        ("fmi2SerializeFMUstate", [None, None, ctypes.c_size_t(0)]),
        ("fmi2DeSerializeFMUstate", [None, ctypes.c_size_t(0), None]),
    ],
)
def test_null_is_refused(host: Host, call: str, arguments: list[Any]) -> None:
    function = getattr(host.fmu.dll, call)
    assert function(host.fmu.component, *arguments) == ERROR
    assert "NULL" in host.messages[-1][1]
    assert function(None, *arguments) == ERROR


@pytest.mark.parametrize("reference", [2**31, 2**32 - 1, 2**32 - 3])
def test_no_value_reference_counts_from_the_end(host: Host, reference: int) -> None:
    with pytest.raises(FMICallException):
        host.fmu.getReal([reference])
    assert f"value reference {reference}: this FMU has 0 to" in host.messages[0][1]


def test_an_unknown_log_category_is_refused_and_harms_nothing(host: Host) -> None:
    with pytest.raises(FMICallException):
        host.fmu.setDebugLogging(True, ["logStatusError", "logEverything"])
    assert "no log category 'logEverything'" in host.messages[0][1]
    host.fmu.setDebugLogging(True, ["logStatusError"])
    host.fmu.doStep(1e-3, 1e-3)


def test_a_percent_sign_is_no_format(host: Host) -> None:
    """Messages are printf formats: %n in a name would write into the host's memory."""
    with pytest.raises(FMICallException):
        host.fmu.setDebugLogging(True, ["100 %n %s"])
    assert "no log category '100 %n %s'" in host.messages[0][1]


# Saved states


def saved(host: Host) -> bytes:
    state = host.fmu.getFMUstate()
    content = bytes(host.fmu.serializeFMUstate(state))
    host.fmu.freeFMUstate(state)
    return content


def values(host: Host, content: bytes) -> tuple[float, ...]:
    count = len(host.description.modelVariables)
    return struct.unpack_from(f"={count}d", content, HEADER.size + 8 * TIMES)


def sealed(content: bytes) -> bytes:
    """The same with a digest that fits: FNV-1a of 64 bits, the digest itself as 0."""
    magic, identity, size, one, _ = HEADER.unpack_from(content)
    state = content[HEADER.size :]
    digest = 14695981039346656037
    for byte in HEADER.pack(magic, identity, size, one, 0) + state:
        digest = (digest ^ byte) * 1099511628211 % 2**64
    return HEADER.pack(magic, identity, size, one, digest) + state


def test_of_one_call_all_values_count_or_none(host: Host) -> None:
    before = values(host, saved(host))
    with pytest.raises(FMICallException):
        host.set({"voltage": 20.0, "load_torque": 0.01, "gain_error.error": math.nan})
    assert values(host, saved(host)) == before


def test_a_state_that_is_no_state_is_refused_whatever_its_digest(host: Host) -> None:
    content = saved(host)
    assert sealed(content) == content
    first = HEADER.size + 8 * TIMES
    size = model("torque_motor").flat.size
    x = first + 8 * len(host.description.modelVariables)
    phase, has_x = x + 8 * size, x + 8 * size + 4
    damages = {
        "a start that is not finite": (HEADER.size, struct.pack("=d", math.inf)),
        "an input out of bounds": (first, struct.pack("=d", 1e6)),
        "an input that is no number": (first, struct.pack("=d", math.nan)),
        "a state that is no number": (x, struct.pack("=d", math.nan)),
        "an infinite state": (x, struct.pack("=d", math.inf)),
        "no such phase": (phase, struct.pack("=i", 4)),
        "a negative phase": (phase, struct.pack("=i", -1)),
        "a running instance without a state": (has_x, struct.pack("=i", 0)),
        "an effect that is neither on nor off": (has_x + 4, struct.pack("=i", 2)),
        "a text without an end": (len(content) - 520, b"x" * 520),
    }
    for name, (at, wrong) in damages.items():
        damaged = sealed(content[:at] + wrong + content[at + len(wrong) :])
        with pytest.raises(FMICallException):
            host.fmu.setFMUstate(host.fmu.deSerializeFMUstate(damaged))
        assert "the state to restore is damaged" in host.messages[-1][1], name
        host.fmu.setFMUstate(host.fmu.deSerializeFMUstate(content))
    host.fmu.doStep(1e-3, 1e-3)


@pytest.mark.parametrize("read", [-600.0, -1e18])
def test_a_delay_line_that_no_run_has_ends_the_run(host: Host, read: float) -> None:
    """Its loop over the edges that wait came to no end where 1 more is no other number."""
    content = saved(host)
    x = HEADER.size + 8 * TIMES + 8 * len(host.description.modelVariables)
    at = x + 8 * place_in_x("transport_delay__read")
    forged = sealed(content[:at] + struct.pack("=d", read) + content[at + 8 :])
    host.fmu.setFMUstate(host.fmu.deSerializeFMUstate(forged))
    with pytest.raises(FMICallException):
        host.fmu.doStep(1e-3, 1e-3)
    assert "the delay line is full" in host.messages[-1][1]


# Derivatives, against the equations


def test_a_derivative_in_initialisation_is_that_of_the_equation(fmu_folder: Files) -> None:
    """u = K_AP (U_in - K_f k_FS theta) and U_in = 5 V tau / 20 ms."""
    with Host(fmu_folder("sg90_linear")) as host:
        host.fmu.setupExperiment()
        host.fmu.enterInitializationMode()
        host.set({"pulse_width": 1.6e-3})
        (slope,) = derivative(host, ["motor_voltage"], "pulse_width")
        assert slope == pytest.approx(7.47 * 5.0 / 20e-3, rel=1e-8)
        (slope,) = derivative(host, ["motor_voltage"], "amplifier_gain")
        assert slope == pytest.approx(0.1e-3 * 5.0 / 20e-3, rel=1e-8)


def test_a_derivative_between_steps_is_that_of_the_equation(host: Host) -> None:
    """The torque is K i at the present current, and no output follows the voltage at once."""
    host.fmu.doStep(1e-3, 1e-3)  # past the delay of 1.1 ms
    current = host.get()[host.outputs.index("current")]
    assert current != 0.0
    slopes = derivative(host, ["motor_torque", "current"], "torque_constant")
    assert slopes == pytest.approx([current, 0.0], rel=1e-8)
    assert derivative(host, ["angle", "rate", "current", "motor_torque"], "voltage") == [0.0] * 4
    before = saved(host)
    derivative(host, ["motor_torque"], "torque_constant")
    assert saved(host) == before


def test_there_is_no_derivative_at_a_kink_or_a_bound(fmu_folder: Files) -> None:
    """The slope behind an asymmetric drive is another one on each side of 0 V."""
    with Host(fmu_folder("sg90_linear")) as host:
        host.start({"pulse_width": 1.5e-3, "direction_asymmetry.ratio": 0.5})
        with pytest.raises(FMICallException) as caught:
            derivative(host, ["motor_voltage"], "pulse_width")
        assert caught.value.status == DISCARD
        assert "no derivative with respect to 'pulse_width'" in host.messages[-1][1]
        host.fmu.doStep(0.0, 1e-3)  # nothing has failed
        host.set({"pulse_width": 0.0})
        with pytest.raises(FMICallException):
            derivative(host, ["motor_voltage"], "pulse_width")


def test_a_fixed_parameter_is_no_kink(host: Host) -> None:
    with pytest.raises(FMICallException) as caught:
        derivative(host, ["angle"], "internal_step")
    assert caught.value.status == DISCARD
    assert "'internal_step' is a fixed parameter" in host.messages[-1][1]


def derivative(host: Host, outputs: list[str], by: str) -> list[float]:
    unknowns = [host.reference[name] for name in outputs]
    found: list[float] = host.fmu.getDirectionalDerivative(unknowns, [host.reference[by]], [1.0])
    return list(found)


# Sources


WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsyntax-only")


@pytest.mark.thorough
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_the_sources_compile_without_warnings(
    compiler: str, fmu_folder: Files, tmp_path: Path
) -> None:
    """One's own actuator too, without effects."""
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler} on the PATH")
    own = build(model(str(write(tmp_path))), tmp_path / "joint.fmu", NATIVE)
    folders = [fmu_folder(name) for name in MODELS] + [tmp_path / "joint"]
    fmpy.extract(str(own), str(folders[-1]))
    for folder in folders:
        source = folder / "sources" / "fmi2.c"
        command = [compiler, *WARNINGS, f"-I{headers()}", str(source)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("flag", ["-ffast-math", "-ffinite-math-only"])
def test_a_compiler_that_would_not_see_nan_is_refused(flag: str, fmu_folder: Files) -> None:
    if shutil.which("gcc") is None:
        pytest.skip("no gcc on the PATH")
    source = fmu_folder("torque_motor") / "sources" / "fmi2.c"
    command = ["gcc", flag, "-fsyntax-only", f"-I{headers()}", str(source)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "NaN would not be seen" in done.stderr


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["sg90", "torque_motor"])
def test_what_fmpy_compiles_gives_the_same_bits(
    name: str, fmu_folder: Files, tmp_path: Path
) -> None:
    if shutil.which("cmake") is None:
        pytest.skip("fmpy compiles with CMake: pip install cmake")
    from fmpy.build import build_platform_binary

    parameters = {
        key: p.param.typical for key, p in model(name).plant.parameters.items() if p.param.switch
    }
    chosen = model(name, None, parameters)
    folder = tmp_path / "fmu"
    shutil.copytree(fmu_folder(name), folder)
    shutil.rmtree(folder / "binaries")
    build_platform_binary(folder)
    times = chosen.step_size * np.arange(400)
    rests = [float(wire.rest) for wire in chosen.plant.inputs]
    inputs = np.tile(rests, (len(times), 1))
    inputs[:, 0] += 0.3 * chosen.plant.inputs[0].scale * np.sin(50.0 * times)
    with Host(folder) as host:
        found = host.simulate(times, inputs, parameters)
    assert np.ptp(found[:, 0]) > 0.0
    assert np.array_equal(found, chosen.run(times, inputs))


def test_the_fmu_holds_its_sources_and_no_python(fmu_file: Files) -> None:
    description = fmpy.read_model_description(str(fmu_file("sg90")))
    (files,) = description.buildConfigurations[0].sourceFileSets
    with zipfile.ZipFile(fmu_file("sg90")) as archive:
        names = set(archive.namelist())
    assert {f"sources/{name}" for name in files.sourceFiles} <= names
    assert not [name for name in names if name.endswith(".py")]
    assert not [name for name in names if "fmi2Functions" in name]  # the importer brings it
