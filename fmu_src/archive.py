"""Zip an FMU: slave, pythonfmu's binaries and runtime, model description; same bytes always."""

from __future__ import annotations

import zipfile
from importlib import metadata
from pathlib import Path

import pythonfmu

from fmu_src.description import BUILT, model_description
from fmu_src.documentation import index_html
from fmu_src.source import slave_source
from servo_models.core.simulate import Model

ICON = Path(__file__).with_name("model.png")


def write_fmu(model: Model, path: Path) -> None:
    """Write the FMU of ``model`` to ``path``.

    Entries are sorted, dated alike, compressed alike and made from contents only, so the
    same source gives the same bytes in any folder.
    """
    entries = _entries(model)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name in sorted(entries):
            info = zipfile.ZipInfo(name, BUILT)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.create_system = 3  # Unix, wherever it is built
            info.external_attr = 0o644 << 16
            archive.writestr(info, entries[name])


def _entries(model: Model) -> dict[str, bytes]:
    name, source = slave_source(model)
    tool = f"servo-models {metadata.version('servo-models')}, pythonfmu {pythonfmu.__version__}"
    package = Path(pythonfmu.__file__).parent
    entries = {
        "modelDescription.xml": model_description(model, name, tool),
        "resources/slavemodule.txt": name.encode(),
        f"resources/{name}.py": source.encode(),
        "documentation/index.html": index_html(model).encode(),
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
