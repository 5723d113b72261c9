"""Zip an FMU, the same bytes always; and what a Python FMU is made of."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path

import pythonfmu

from fmu_src.description import BUILT, FMI2, Form, model_description
from fmu_src.documentation import index_html
from fmu_src.slave import Servo
from fmu_src.source import slave_source
from servo_models.core.simulate import Model

ICON = Path(__file__).with_name("model.png")

PYTHON = Form(
    version=FMI2,
    directional_derivatives=False,
    log_categories=Servo.log_categories,
    sources=(),
    needs="The host's process needs a Python library, 3.10 or newer, and no packages.",
)


def write_archive(entries: Mapping[str, bytes], path: Path) -> None:
    """Write an FMU of these files to ``path``.

    Entries are sorted, dated alike and compressed alike, so the same contents give the same
    bytes in any folder.
    """
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name in sorted(entries):
            info = zipfile.ZipInfo(name, BUILT)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.create_system = 3  # Unix, wherever it is built
            info.external_attr = 0o644 << 16
            archive.writestr(info, entries[name])


def python_entries(model: Model) -> dict[str, bytes]:
    """Return the files of a Python FMU: slave, pythonfmu's binaries and runtime, description."""
    name, source = slave_source(model)
    tool = f"{tool_name()}, pythonfmu {pythonfmu.__version__}"
    package = Path(pythonfmu.__file__).parent
    entries = {
        "modelDescription.xml": model_description(model, PYTHON, name, tool),
        "resources/slavemodule.txt": name.encode(),
        f"resources/{name}.py": source.encode(),
        "documentation/index.html": index_html(model, PYTHON).encode(),
        "model.png": ICON.read_bytes(),
    }
    for file in package.glob("*.py"):
        entries[f"resources/pythonfmu/{file.name}"] = file.read_bytes()
    binaries = package / "resources" / "binaries"
    for file in binaries.glob("*/*"):
        entry = f"binaries/{file.parent.name}/{model.actuator.name}{file.suffix}"
        entries[entry] = file.read_bytes()
    for installed in metadata.files("pythonfmu") or ():
        if installed.name == "LICENSE":
            entries["documentation/licenses/pythonfmu.txt"] = installed.read_binary()
    return entries


def tool_name() -> str:
    """Name and version of what builds FMUs."""
    return f"servo-models {metadata.version('servo-models')}"
