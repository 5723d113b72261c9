"""An FMU judged by its files: description, archive, binaries, sources; nothing is loaded or run.

Each check is a row with the number of faults.  What breaks no rule but is worth knowing is a row
that is not judged.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from servo_models.errors import UserError, printable
from servo_models.fmu.archive import check_xml
from servo_models.fmu.fmu import LIMITS, Fmu, Limits
from servo_models.report.interchange import conditions
from servo_models.validation.rows import FILES, Row, Validation, judged

Found = tuple[str, str, list[str], bool]  # group, check, findings, and whether these are faults

MOST_TOLD = 3  # faults of a check that are named at most
FOLDERS = ("binaries", "sources", "resources", "documentation", "extra", "terminalsAndIcons")
AT_TOP = ("modelDescription.xml", "model.png", "buildDescription.xml")
SYSTEMS = {"linux": "ELF", "windows": "PE", "darwin": "Mach-O"}
PLATFORMS = {
    "linux64": ("ELF", "x86_64"),
    "win64": ("PE", "x86_64"),
    "darwin64": ("Mach-O", "x86_64"),
    **{f"{it}-{name}": (SYSTEMS[name], it) for name in SYSTEMS for it in ("x86_64", "aarch64")},
}
"""Format and processor by the folder of FMI 2.0 and 3.0."""
SUFFIXES = {"ELF": ".so", "PE": ".dll", "Mach-O": ".dylib"}
PROCESSORS = {62: "x86_64", 0x8664: "x86_64", 0x1000007: "x86_64"}
PROCESSORS |= {183: "aarch64", 0xAA64: "aarch64", 0x100000C: "aarch64"}
"""By the numbers in headers of ELF, PE and Mach-O."""
ALWAYS = (
    *("GetVersion", "SetDebugLogging", "FreeInstance", "Terminate", "Reset"),
    *("EnterInitializationMode", "ExitInitializationMode", "DoStep"),
)
ONLY = {
    False: ("GetTypesPlatform", "Instantiate", "SetupExperiment"),
    True: ("InstantiateCoSimulation",),
}
"""Functions that a host needs of a library of FMI 2.0, and of 3.0, beside getters and setters."""
STATES = {False: "FMUstate", True: "FMUState"}
CODE = (b"\x7fELF", b"MZ", b"\xcf\xfa\xed\xfe", b"\xca\xfe\xba\xbe", b"#!")
SCRIPTS = {".py", ".pyc", ".sh", ".bat", ".cmd", ".ps1", ".js", ".jar", ".exe", ".dll", ".so"}


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
    if (fmu.folder / "sources").is_dir():
        yield from _sources(fmu)


def _description(fmu: Fmu) -> Iterator[Found]:
    from fmpy.validation import validate_fmu

    about, group = fmu.description, "description"
    broken = [" ".join(str(problem).split()) for problem in validate_fmu(str(fmu.folder))]
    yield group, "rules of FMI, by fmpy", broken, True
    if not fmu.is_fmi3:
        yield group, "value references that clash", _references(fmu), True
    yield group, "start values and bounds", _starts(about), True
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


def _references(fmu: Fmu) -> list[str]:
    """In FMI 2.0 aliases share a reference, but only one of them is set."""
    keys: dict[Any, list[str]] = {}
    for variable in fmu.variables.values():
        if variable.causality in ("input", "parameter"):
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


def _binaries(fmu: Fmu) -> Iterator[Found]:
    folder = fmu.folder / "binaries"
    platforms = sorted(path.name for path in folder.glob("*") if path.is_dir())
    sources = (fmu.folder / "sources").is_dir()
    none = [] if platforms or sources else ["it has neither a binary nor sources: nothing runs"]
    yield "binaries", "something to run", none, True
    yield "binaries", "platforms", [", ".join(platforms)] if platforms else [], False
    for name in platforms if fmu.description.coSimulation else ():
        if name not in PLATFORMS:
            yield "binaries", "platforms that are not looked at", [name], False
            continue
        suffix = SUFFIXES[PLATFORMS[name][0]]
        path = folder / name / f"{fmu.description.coSimulation.modelIdentifier}{suffix}"
        if path.is_file():
            yield from _library(fmu, name, path)
        else:
            yield name, "library", [f"it has no {path.relative_to(fmu.folder).as_posix()}"], True


def _library(fmu: Fmu, platform: str, path: Path) -> Iterator[Found]:
    content = path.read_bytes()
    kind, machine = PLATFORMS[platform]
    found, machines = _headers(content)
    fits = found == kind and (machine in machines or platform == "darwin64")  # also for ARM
    told = f"{found} for {', '.join(machines)}" if machines else "no shared library"
    wrong = [] if fits else [f"{path.name} is {told}, not {kind} for {machine}"]
    yield platform, "library", wrong, True
    if fits:
        missing = [name for name in _needed(fmu) if name.encode() + b"\0" not in content]
        yield platform, "functions that are not exported", missing, True
        token = str(fmu.description.guid or "").encode()
        unheard = [] if token in content else ["it is not in the library, which may not check it"]
        yield platform, "token", unheard, False


def _headers(content: bytes) -> tuple[str, list[str]]:
    """Format of a library and its processors, several in one of macOS, by its first bytes."""
    places: Iterable[int] = ()
    kind, size, order = "", 2, "little"
    if content[:4] == b"\x7fELF":
        kind, places = "ELF", [18]
    elif content[:2] == b"MZ":
        kind, places = "PE", [int.from_bytes(content[60:64], "little") + 4]
    elif content[:4] == b"\xcf\xfa\xed\xfe":
        kind, size, places = "Mach-O", 4, [4]
    elif content[:4] == b"\xca\xfe\xba\xbe":
        kind, size, order, places = "Mach-O", 4, "big", range(8, 8 + 20 * content[7], 20)
    numbers = [int.from_bytes(content[at : at + size], order) for at in places]  # type: ignore[arg-type]
    return kind, [PROCESSORS.get(number, f"processor {number}") for number in numbers]


def _needed(fmu: Fmu) -> list[str]:
    """Functions that a host calls, by what the description says."""
    three, prefix = fmu.is_fmi3, "fmi3" if fmu.is_fmi3 else "fmi2"
    names = [*ALWAYS, *ONLY[three]]
    if fmu.description.coSimulation.canGetAndSetFMUstate:
        names += [f"{verb}{STATES[three]}" for verb in ("Get", "Set", "Free")]
    for variable in fmu.variables.values():
        if variable.causality in ("input", "parameter"):
            names.append(f"Set{variable.kind}")
        elif variable.causality == "output":
            names.append(f"Get{variable.kind}")
    return [prefix + name for name in dict.fromkeys(names)]


def _sources(fmu: Fmu) -> Iterator[Found]:
    folder = fmu.folder / "sources"
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
