"""What a native FMU is made of: libraries for one or several platforms, sources, description."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

from fmu_src.archive import ICON, PYTHON, tool_name
from fmu_src.description import FMI2, Form, model_description
from fmu_src.documentation import index_html
from fmu_src.native.description3 import FMI3, build_description, terminals_and_icons
from fmu_src.native.source import IDENTITY_HEADER, identity_header, identity_of, native_sources
from servo_models.core.compilers import Compiler, Target, compile_library, universal
from servo_models.core.simulate import Model


def headers() -> Path:
    """Return the folder of the standard's own headers, which an FMU does not bring (FMI 2.0.4,
    section 2.3)."""
    fmpy = find_spec("fmpy")
    assert fmpy is not None
    assert fmpy.origin is not None
    return Path(fmpy.origin).parent / "c-code"


NATIVE = Form(
    version=FMI2,
    directional_derivatives=True,
    log_categories={
        "logStatusError": "What was refused, why, and what to do.",
        "logStatusWarning": "What to be careful with in a run that goes on.",
        "logAll": "Both.",
    },
    sources=("fmi2.c",),
    needs="The host needs nothing else: no Python, no library but the C runtime of the system.",
)


NATIVE3 = replace(NATIVE, version=FMI3, sources=("fmi3.c",))


def native_entries(
    model: Model, form: Form, compiler: Compiler, targets: Sequence[Target]
) -> dict[str, bytes]:
    """Return the files of a native FMU, of the form ``NATIVE`` or ``NATIVE3``.

    Raises:
        UserError: the compiler is not for one of the targets, or fails.
    """
    name = model.actuator.name
    (main,) = form.sources
    is_fmi3 = form.version == FMI3
    build = {"buildDescription.xml": build_description(model, form)} if is_fmi3 else {}
    identity, sources = native_sources(model, main, build)
    description = model_description(model, form, identity, tool_name())
    token = ElementTree.fromstring(description).attrib[form.version.token]
    sources[IDENTITY_HEADER] = identity_header(identity, token)
    entries = {
        "modelDescription.xml": description,
        "documentation/index.html": index_html(model, form).encode(),
        "terminalsAndIcons/icon.png" if is_fmi3 else "model.png": ICON.read_bytes(),
        **{f"sources/{file}": content for file, content in sources.items()},
    }
    if is_fmi3:
        entries["terminalsAndIcons/terminalsAndIcons.xml"] = terminals_and_icons(model, form)
    libraries: dict[str, list[bytes]] = {}
    for target in targets:
        library = compile_library(compiler, target, sources, main, [headers()])
        for folder in (target.fmi3_folder,) if is_fmi3 else target.fmi2_folders:
            libraries.setdefault(f"{folder}/{name}{target.suffix}", []).append(library)
    for place, slices in libraries.items():
        entries[f"binaries/{place}"] = slices[0] if len(slices) == 1 else universal(slices)
    return entries


def form_of(folder: Path) -> tuple[Form, str]:
    """Return the form of an unpacked FMU and the identity of its code, "" where it has none."""
    files = [file for file in (folder / "sources").glob("*") if file.is_file()]
    if files:
        sources = {file.name: file.read_bytes() for file in files}
        is_fmi3 = NATIVE3.sources[0] in sources
        return NATIVE3 if is_fmi3 else NATIVE, identity_of(sources)
    named = folder / "resources" / "slavemodule.txt"
    text = named.read_text(encoding="utf-8", errors="replace")[:200] if named.is_file() else ""
    return PYTHON, text
