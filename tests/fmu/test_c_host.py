"""The C host of ``examples/c_host``: no Python in its process, the numbers of the simulation."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fmpy.build import build_platform_binary

from fmu_src.native.archive import headers
from servo_models.analysis.simulate import simulate
from servo_models.build import NATIVE, build
from servo_models.catalogue import actuators, model
from tests.conftest import built_once
from tests.support.document import alike

EXAMPLE = Path(__file__).parents[2] / "examples" / "c_host"
ROWS = 3000  # of a run: more text than fits into a pipe, so the host waits until it is read

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or shutil.which("cc") is None, reason="needs Linux and a C compiler"
)
Unpacked = Callable[[str], Path]


@pytest.fixture(scope="module")
def host(tmp_path_factory: pytest.TempPathFactory) -> Path:
    program = tmp_path_factory.mktemp("host") / "host"
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", f"-I{headers()}"]
    subprocess.run(["cc", *flags, EXAMPLE / "host.c", "-o", program, "-ldl"], check=True)
    return program


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Unpacked:
    parent = tmp_path_factory.mktemp("unpacked FMUs")

    def folder(name: str) -> Path:
        if not (parent / name).exists():
            with zipfile.ZipFile(built_once(tmp_path_factory, name, NATIVE)) as archive:
                archive.extractall(parent / name)
        return parent / name

    return folder


def words(host: Path, fmu: Path, *rest: str) -> list[str]:
    library = fmu / "binaries" / "linux64" / f"{fmu.name}.so"
    return [str(word) for word in (host, fmu / "modelDescription.xml", library, *rest)]


@pytest.mark.thorough
@pytest.mark.parametrize("name", actuators())
def test_it_steps_every_fmu_without_python_to_the_bits_of_the_simulation(
    name: str, host: Path, unpacked: Unpacked
) -> None:
    chosen = model(name)
    switches = [p for p in chosen.plant.parameters.values() if p.param.switch]
    changed = {switches[0].name: switches[0].param.typical}
    size = 0.7 * chosen.step_size
    inputs = dict([chosen.actuator.step])
    given = [f"{key}={value!r}" for key, value in {**inputs, **changed}.items()]
    command = words(host, unpacked(name), repr((ROWS - 0.5) * size), repr(size), *given)
    with subprocess.Popen(command, env={}, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        header = process.stdout.readline().strip().split(",")
        maps = Path(f"/proc/{process.pid}/maps").read_text().splitlines()
        rows = np.loadtxt(process.stdout, delimiter=",")
    assert process.returncode == 0
    loaded = {Path(line.split(maxsplit=5)[-1]).name for line in maps}
    assert f"{name}.so" in loaded
    assert not [file for file in loaded if "python" in file]
    times = np.arange(ROWS) * size
    expected = simulate(model(name, None, changed), times, inputs)
    assert header == ["time", *expected.outputs]
    assert np.array_equal(rows, np.column_stack([times, *expected.outputs.values()]))
    assert np.ptp(rows[:, 1]) > 0.0


@pytest.mark.parametrize(
    ("rest", "told"),
    [
        (["0.1", "0.001", "voltage=1e9"], "'voltage' = 1e+09 is outside"),
        (["0.1", "0.001", "angle=0.5"], "'angle' is an output"),
        (["0.1", "0.001", "volts=1"], "names no variable"),
        (["0.1", "0"], "no STEP"),
        (["0.1"], "give it modelDescription.xml"),
        (["1e9", "1e8"], "communication step of 1e+08 s"),
    ],
)
def test_what_it_refuses(rest: list[str], told: str, host: Path, unpacked: Unpacked) -> None:
    done = subprocess.run(
        words(host, unpacked("torque_motor"), *rest), capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert told in done.stderr


def test_a_python_fmu_needs_a_python_library_in_the_process(host: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(build(model("torque_motor"), tmp_path / "motor.fmu")) as archive:
        archive.extractall(tmp_path / "torque_motor")
    command = words(host, tmp_path / "torque_motor", "0.1", "0.001")
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "host: cannot load LIBRARY\n")
    unbound = subprocess.run(["ldd", "-r", command[2]], capture_output=True, text=True, check=False)
    assert "undefined symbol: _Py_NoneStruct" in unbound.stdout + unbound.stderr


@pytest.mark.thorough
def test_a_library_of_fmpy_compile_needs_a_libm_in_the_process(
    host: Path, unpacked: Unpacked, tmp_path: Path
) -> None:
    if shutil.which("cmake") is None:
        pytest.skip("fmpy compiles with CMake: pip install cmake")
    rest = ("0.1", "0.001", "voltage=20")
    expected = words(host, unpacked("torque_motor"), *rest)
    ours = subprocess.run(expected, capture_output=True, check=True)
    folder = tmp_path / "torque_motor"
    shutil.copytree(unpacked("torque_motor"), folder)
    shutil.rmtree(folder / "binaries")
    build_platform_binary(folder)
    command = words(host, folder, *rest)
    done = subprocess.run(command, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (1, b"host: cannot load LIBRARY\n")
    with_libm = {"LD_PRELOAD": "libm.so.6"}
    done = subprocess.run(command, capture_output=True, env=with_libm, check=False)
    assert (done.returncode, done.stdout) == (0, ours.stdout)


def test_a_description_of_another_build_is_refused(
    host: Path, unpacked: Unpacked, tmp_path: Path
) -> None:
    fmu = unpacked("torque_motor")
    xml = (fmu / "modelDescription.xml").read_text()
    other = tmp_path / "modelDescription.xml"
    other.write_text(re.sub(' guid="{.', ' guid="{x', xml))
    command = words(host, fmu, "0.1", "0.001")
    command[1] = str(other)
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "the GUID is not that of this library" in done.stderr


def test_the_page_shows_what_is_printed(
    host: Path, unpacked: Unpacked, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (EXAMPLE / "README.md").read_text(encoding="utf-8")
    ((command, shown),) = re.findall(r"^\$ (./host .*)\n((?:.+\n)*?)```", page, re.MULTILINE)
    os.symlink(host, tmp_path / "host")
    os.symlink(unpacked("sg90"), tmp_path / "sg90")
    monkeypatch.chdir(tmp_path)
    printed = subprocess.run(command.split(), env={}, capture_output=True, text=True, check=True)
    for line in shown.splitlines():
        rows = printed.stdout.replace(",", " ").splitlines()
        assert line == "..." or any(alike(line.replace(",", " "), row) for row in rows), line
