"""An FMU judged by its files: description, archive, binaries, sources; nothing is loaded or run.

Each check is a row with the number of faults.  What breaks no rule but is worth knowing is a row
that is not judged.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from servo_models.errors import UserError, printable
from servo_models.fmu.archive import check_xml
from servo_models.fmu.fmu import LIMITS, Fmu, Limits
from servo_models.report.interchange import conditions
from servo_models.validation.any_fmu.binaries import is_universal, read_binary, slices
from servo_models.validation.rows import FILES, Row, Validation, judged

Found = tuple[str, str, list[str], bool]  # group, check, findings, and whether these are faults

MOST_TOLD = 3  # faults of a check that are named at most
FOLDERS = ("binaries", "sources", "resources", "documentation", "extra", "terminalsAndIcons")
AT_TOP = ("modelDescription.xml", "model.png", "buildDescription.xml")
PLATFORMS = {
    "linux64": ("ELF", "x86_64"),
    "win64": ("PE", "x86_64"),
    "darwin64": ("Mach-O", "x86_64"),
    "x86_64-linux": ("ELF", "x86_64"),
    "x86_64-windows": ("PE", "x86_64"),
    "x86_64-darwin": ("Mach-O", "x86_64"),
    "aarch64-linux": ("ELF", "aarch64"),
    "aarch64-windows": ("PE", "aarch64"),
    "aarch64-darwin": ("Mach-O", "aarch64"),
}
"""Format and processor by the folder of FMI 2.0 and 3.0."""
SUFFIXES = {"ELF": ".so", "PE": ".dll", "Mach-O": ".dylib"}
ALWAYS = (
    "GetVersion",
    "SetDebugLogging",
    "FreeInstance",
    "EnterInitializationMode",
    "ExitInitializationMode",
    "Terminate",
    "Reset",
    "DoStep",
)
ONLY = {
    False: ("GetTypesPlatform", "Instantiate", "SetupExperiment"),
    True: ("InstantiateCoSimulation",),
}
"""Functions that a host needs of a library of FMI 2.0, and of 3.0, beside getters and setters."""
STATES = {
    False: ("GetFMUstate", "SetFMUstate", "FreeFMUstate"),
    True: ("GetFMUState", "SetFMUState", "FreeFMUState"),
}
CODE = (b"\x7fELF", b"MZ", b"\xcf\xfa\xed\xfe", b"\xca\xfe\xba\xbe", b"#!")
SCRIPTS = {".py", ".pyc", ".sh", ".bat", ".cmd", ".ps1", ".js", ".jar", ".exe", ".dll", ".so"}
SYSTEM = re.compile(
    r"(lib(c|m|dl|pthread|rt|stdc\+\+|gcc_s)\.so.*|ld-linux.*|linux-vdso.*"
    r"|(kernel32|ntdll|user32|advapi32|msvcrt|ucrtbase|shell32|ws2_32|ole32)\.dll"
    r"|api-ms-win-.*|/usr/lib/.*|/System/Library/.*)",
    re.I,
)
"""Libraries that come with an operating system."""


def inspect(fmus: Iterable[str | Path], limits: Limits = LIMITS) -> Validation:
    """Judge FMUs by their files, without loading or running anything of them.

    Raises:
        UserError: no such file, or an archive that is refused: one that is no zip, that is too
            large, or that would write outside its folder.

    Example:
        >>> import servo_models as sm
        >>> from servo_models.validation.any_fmu.static import inspect
        >>> inspect([sm.build(sm.model("sg90"), "sg90.fmu")]).passed
        True
    """
    rows: list[Row] = []
    for path in fmus:
        with closing(Fmu(path, limits)) as fmu:
            for group, check, findings, faults in _findings(fmu):
                where = (fmu.title, f"FMI {fmu.description.fmiVersion}", group)
                count = float(len(findings))
                limit = 0.0 if faults else None
                if faults or findings:
                    note = _told(fmu, findings)
                    rows.append(judged(FILES, where, check, count, limit, "1", note, fmu.name))
    return Validation(tuple(rows), (), conditions())


def _told(fmu: Fmu, findings: Sequence[str]) -> str:
    shown = [fmu.clean(printable(text, 200)) for text in findings[:MOST_TOLD]]
    more = len(findings) - len(shown)
    return "; ".join(shown) + (f"; and {more} more" if more else "")


def _findings(fmu: Fmu) -> Iterator[Found]:
    yield from _description(fmu)
    yield from _archive(fmu)
    yield from _binaries(fmu)
    yield from _sources(fmu)


# The description


def _description(fmu: Fmu) -> Iterator[Found]:
    from fmpy.validation import validate_fmu

    about, group = fmu.description, "description"
    broken = [" ".join(str(problem).split()) for problem in validate_fmu(str(fmu.folder))]
    yield group, "rules of FMI, by fmpy", broken, True
    yield group, "units without a definition", _units(about), True
    yield group, "value references that clash", _references(fmu), True
    yield group, "start values and bounds", _starts(about), True
    yield group, "dependencies", _dependencies(about), True
    yield group, "token", [] if about.guid else ["it has no GUID or instantiation token"], True
    yield group, "default experiment", _experiment(about.defaultExperiment), True
    interface = about.coSimulation
    none = [] if interface else ["it is for model exchange alone, so validate cannot run it"]
    yield group, "no co-simulation", none, False
    if interface:
        tool = ["it needs a tool of its maker to run"] if interface.needsExecutionTool else []
        yield group, "execution tool", tool, False
        identifier = str(interface.modelIdentifier or "")
        legal = re.fullmatch(r"[A-Za-z_]\w*", identifier)
        wrong = [] if legal else [f"'{identifier}' is no name of C"]
        yield group, "model identifier", wrong, True


def _units(about: Any) -> list[str]:
    defined = {unit.name for unit in about.unitDefinitions}
    used: dict[str, str] = {}
    for variable in about.modelVariables:
        unit = variable.unit or (variable.declaredType.unit if variable.declaredType else None)
        if unit:
            used.setdefault(unit, variable.name)
    return [f"'{unit}' of '{name}'" for unit, name in used.items() if unit not in defined]


def _references(fmu: Fmu) -> list[str]:
    """A reference occurs once in FMI 3.0; in 2.0 aliases share one, but only one of them is set."""
    keys: dict[Any, list[str]] = {}
    for variable in fmu.variables.values():
        if fmu.is_fmi3:
            keys.setdefault(variable.reference, []).append(variable.name)
        elif variable.causality in ("input", "parameter"):
            keys.setdefault((variable.kind, variable.reference), []).append(variable.name)
    return [f"{names} share one" for names in keys.values() if len(names) > 1]


def _starts(about: Any) -> list[str]:
    wrong = []
    for variable in about.modelVariables:
        low, high = _number(variable.min), _number(variable.max)
        if low is not None and high is not None and low > high:
            wrong.append(f"'{variable.name}' has min {low:g} above max {high:g}")
        if variable.dimensions or variable.type in ("String", "Boolean", "Binary", "Clock"):
            continue
        start = _number(variable.start)
        if variable.start is None:
            continue
        if start is None or not math.isfinite(start):
            wrong.append(f"'{variable.name}' starts at {variable.start}, which is no number")
        elif (low is not None and start < low) or (high is not None and start > high):
            wrong.append(f"'{variable.name}' starts at {start:g}, outside its bounds")
    return wrong


def _number(text: Any) -> float | None:
    try:
        return None if text is None else float(text)
    except (TypeError, ValueError):
        return None


def _dependencies(about: Any) -> list[str]:
    listed = [unknown.variable.name for unknown in about.outputs if unknown.variable]
    outputs = [v.name for v in about.modelVariables if v.causality == "output"]
    wrong = [f"output '{name}' is not in the structure" for name in outputs if name not in listed]
    wrong += [f"'{name}' is in it twice" for name, count in Counter(listed).items() if count > 1]
    for unknown in (*about.outputs, *about.derivatives, *about.initialUnknowns):
        if unknown.variable is None:
            wrong.append("an entry of the structure names no variable")
            continue
        kinds, known = unknown.dependenciesKind, unknown.dependencies
        if kinds and len(kinds) != len(known or ()):
            wrong.append(f"'{unknown.variable.name}' has other counts of dependencies and kinds")
    return wrong


def _experiment(experiment: Any) -> list[str]:
    if experiment is None:
        return []
    start, stop = _number(experiment.startTime) or 0.0, _number(experiment.stopTime)
    wrong = [] if stop is None or stop > start else [f"it stops at {stop:g} s, not after its start"]
    for name, text in (("step", experiment.stepSize), ("tolerance", experiment.tolerance)):
        value = _number(text)
        if value is not None and not value > 0.0:
            wrong.append(f"its {name} is {value:g}")
    return wrong


# The archive


def _archive(fmu: Fmu) -> Iterator[Found]:
    paths = [path for path in sorted(fmu.folder.rglob("*")) if path.is_file()]
    files = {path.relative_to(fmu.folder).as_posix(): path for path in paths}
    strays = [name for name in files if name not in AT_TOP and name.split("/")[0] not in FOLDERS]
    yield "files", "outside the folders of FMI", strays, False
    beside = [name for name in files if not name.startswith(("binaries/", "sources/"))]
    code = [name for name in beside if _is_code(files[name])]
    yield "files", "code beside the binaries", code, False
    sizes = {name: path.stat().st_size for name, path in files.items()}
    yield "files", "empty files", [name for name, size in sizes.items() if not size], False
    total, largest = sum(sizes.values()) / 2**20, max(sizes, key=sizes.__getitem__)
    told = f"{len(files)} files, {total:.2f} MB; the largest is {largest}"
    yield "files", "size", [told], False


def _is_code(path: Path) -> bool:
    with path.open("rb") as file:
        return path.suffix.lower() in SCRIPTS or file.read(4).startswith(CODE)


# The binaries


def _binaries(fmu: Fmu) -> Iterator[Found]:
    folder = fmu.folder / "binaries"
    platforms = sorted(path.name for path in folder.glob("*") if path.is_dir())
    sources = (fmu.folder / "sources").is_dir()
    none = [] if platforms or sources else ["it has neither a binary nor sources: nothing runs"]
    yield "binaries", "something to run", none, True
    yield "binaries", "platforms", [", ".join(platforms)] if platforms else [], False
    if fmu.description.coSimulation is None:
        return
    identifier = fmu.description.coSimulation.modelIdentifier
    for name in platforms:
        if name not in PLATFORMS:
            yield "binaries", "platforms that are not looked at", [name], False
            continue
        suffix = SUFFIXES[PLATFORMS[name][0]]
        path = folder / name / f"{identifier}{suffix}"
        if not path.is_file():
            yield name, "library", [f"it has no {path.relative_to(fmu.folder).as_posix()}"], True
            continue
        yield from _library(fmu, name, path)


def _library(fmu: Fmu, platform: str, path: Path) -> Iterator[Found]:
    content = path.read_bytes()
    try:
        parts = slices(content) if is_universal(content) else [content]
        binaries = [read_binary(part) for part in parts]
    except ValueError as error:
        yield platform, "library", [f"{path.name}: {error}"], True
        return
    kind, machine = PLATFORMS[platform]
    suitable = [binary for binary in binaries if (binary.kind, binary.machine) == (kind, machine)]
    told = ", ".join(f"{binary.kind} for {binary.machine}" for binary in binaries)
    wrong = [] if suitable else [f"{path.name} is {told}, not {kind} for {machine}"]
    if wrong and platform == "darwin64" and binaries[0].kind == kind:
        wrong, suitable = [], binaries  # FMI 2.0 has no folder for a Mac with ARM
    yield platform, "library", wrong, True
    for binary in suitable[:1]:
        missing = [name for name in _needed(fmu) if name not in binary.exports]
        yield platform, "functions that are not exported", missing, True
        beside = {file.name for file in path.parent.iterdir()}
        foreign = sorted(
            name for name in binary.needs if not SYSTEM.fullmatch(name) and name not in beside
        )
        yield platform, "libraries that a host has to have", foreign, False
        yield platform, "search paths", sorted(binary.search_paths), False
        asked = {"glibc": binary.newest_glibc, "macOS": binary.oldest_macos}
        least = [f"{name} {'.'.join(map(str, it))} or newer" for name, it in asked.items() if it]
        yield platform, "asks for", least, False
        token = str(fmu.description.guid or "").encode()
        unheard = [] if token in content else ["it is not in the library, which may not check it"]
        yield platform, "token", unheard, False


def _needed(fmu: Fmu) -> list[str]:
    """Functions that a host calls, by what the description says."""
    three, prefix = fmu.is_fmi3, "fmi3" if fmu.is_fmi3 else "fmi2"
    names = [*ALWAYS, *ONLY[three]]
    interface = fmu.description.coSimulation
    if interface.canGetAndSetFMUstate:
        names += STATES[three]
    for variable in fmu.variables.values():
        if variable.causality in ("input", "parameter"):
            names.append(f"Set{variable.kind}")
        elif variable.causality == "output":
            names.append(f"Get{variable.kind}")
    return [prefix + name for name in dict.fromkeys(names)]


# The sources


def _sources(fmu: Fmu) -> Iterator[Found]:
    folder = fmu.folder / "sources"
    if not folder.is_dir():
        return
    try:
        listed = _listed(fmu, folder)
    except (UserError, ElementTree.ParseError) as error:
        yield "sources", "files that are listed", [str(error)], True
        return
    files = {path.resolve() for path in folder.rglob("*") if path.is_file()}
    absent = [name for name in listed if (folder / name).resolve() not in files]
    yield "sources", "files that are listed and not there", absent, True
    none = [] if listed else ["it has a folder of sources and lists none: nobody can build them"]
    yield "sources", "files that are listed", none, True


def _listed(fmu: Fmu, folder: Path) -> list[str]:
    """Names of source files, by the description or, in FMI 3.0, by that of the build."""
    path = folder / "buildDescription.xml" if fmu.is_fmi3 else fmu.folder / "modelDescription.xml"
    check_xml(path)
    root = ElementTree.parse(path).getroot()
    tag = "SourceFile" if fmu.is_fmi3 else "File"
    return [element.get("name", "") for element in root.iter(tag)]
