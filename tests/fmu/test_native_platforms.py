"""A native FMU holds, for every platform, a library with the functions of the standard alone."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

import pytest

from fmu_src.native.archive import headers
from servo_models.build import NATIVE, NATIVE_ARM, build
from servo_models.catalogue import actuators, model
from servo_models.core.compilers import zig
from tests.support.binaries import read_binary, slices

pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(zig() is None, reason="ziglang is not installed"),
]

SYSTEM = re.compile(r"lib[cm]\.so\.6|api-ms-win-crt-.*|KERNEL32\.dll|/usr/lib/libSystem\.B\.dylib")
OF_THE_LINKER = {"_mh_dylib_header", "__dso_handle"}


def of_the_standard() -> set[str]:
    """Functions for co-simulation that the standard's own header declares."""
    text = (headers() / "fmi2Functions.h").read_text()
    declared = set(re.findall(r"FMI2_Export +\w+TYPE +(\w+);", text))
    (exchange,) = re.findall(r"Model Exchange\n\*+/\s+/\*(.*?)/\*{9}", text, re.DOTALL)
    return declared - set(re.findall(r"FMI2_Export +\w+TYPE +(\w+);", exchange))


@pytest.mark.parametrize("name", actuators())
def test_the_libraries_are_those_of_the_platforms(name: str, tmp_path: Path) -> None:
    wanted = of_the_standard()
    assert {"fmi2DoStep", "fmi2Instantiate", "fmi2SerializeFMUstate"} < wanted
    assert "fmi2GetDerivatives" not in wanted
    machines: dict[str, list[str]] = {}
    for kind in (NATIVE, NATIVE_ARM):
        with zipfile.ZipFile(build(model(name), tmp_path / f"{kind}.fmu", kind)) as archive:
            for entry in archive.namelist():
                if not entry.startswith("binaries/"):
                    continue
                content = archive.read(entry)
                parts = slices(content) if entry.endswith(".dylib") else [content]
                found = [read_binary(part) for part in parts]
                machines[f"{kind} {entry}"] = sorted(one.machine for one in found)
                for one in found:
                    assert one.exports - OF_THE_LINKER == wanted
                    assert all(SYSTEM.fullmatch(library) for library in one.needs)
                    assert one.newest_glibc <= (2, 17)
                    assert not one.has_local_symbols
                    assert not one.search_paths
                    assert not one.dated
                    assert one.kind != "Mach-O" or one.oldest_macos == (11, 0)
    assert machines == {
        f"native binaries/darwin64/{name}.dylib": ["aarch64", "x86_64"],
        f"native binaries/linux64/{name}.so": ["x86_64"],
        f"native binaries/win64/{name}.dll": ["x86_64"],
        f"native-arm binaries/linux64/{name}.so": ["aarch64"],
        f"native-arm binaries/aarch64-linux/{name}.so": ["aarch64"],
    }
