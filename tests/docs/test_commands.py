"""Every command of every page and notebook is understood, and run where that takes seconds."""

from __future__ import annotations

import importlib.util
import json
import re
import shlex
import shutil
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import typer

from servo_models.catalogue import all_actuators
from servo_models.cli import USAGE_ERROR, app
from servo_models.effects import effects
from studies.__main__ import GENERATOR
from tests.conftest import Run
from tests.support.document import ROOT, SAVED, STEP

CLI: Any = typer.main.get_command(app)
MADE = {ROOT / "docs" / name for name in ("actuators", "effects", "living", "reference")}
PAGES = sorted(
    path
    for pattern in ("*.md", "docs/**/*.md", "docs/**/*.ipynb", "examples/**/*")
    for path in ROOT.glob(pattern)
    if path.suffix in (".md", ".ipynb", ".py", ".toml") and path.parent not in MADE
    if path.name != "CHANGELOG.md"  # which names what commands once were
)
LINE = re.compile(r"^\s*(?:\$ |!|- run: |run: )?(servo-models [a-z-].*|python .*)$", re.MULTILINE)
PROSE = re.compile(r"(?<!`)`(servo-models [a-z-][^`]*|python [^`]*)`(?!`)")
FENCED = re.compile(r"^```.*\n((?:.*\n)*?)```", re.MULTILINE)
WRITES = re.compile(r"[Ww]rit|[Ss]ave|Append|[Ff]older|to which")
"""In the help of an option whose file a command makes."""
LOG = re.compile(r'^file = "([^"*]+)"', re.MULTILINE)  # in a description
JUDGES = ("check", "identify", "validate")  # which end with 1 where a log or an FMU is not well


GIMBAL = r"(log|mine|rig|gimbal)\.toml"
STAND_INS = {
    r"(PARAMS|GAP|MAP)\.toml": "docs/zoo/sg90_steps/parameters.toml",
    GIMBAL: "examples/gimbal/gimbal.toml",
    r"\w+\.py": "examples/gimbal/gimbal.py",
    r"log\.csv": "examples/gimbal/log.csv",
}
"""What stands for a file that the reader has or a long command makes."""
ANY_FILE = ("check", "identify", "explore", "explain", "build", "figures", "sample", "simulate")


class Command(NamedTuple):
    """Words after ``servo-models`` or ``python``; in prose a command may lack some of its words."""

    program: str
    words: list[str]
    whole: bool


def text_of(page: Path) -> str:
    text = page.read_text(encoding="utf-8")
    if page.suffix != ".ipynb":
        return text
    cells = json.loads(text)["cells"]
    return "\n\n".join("".join(cell["source"]) for cell in cells)


def commands(page: Path) -> list[Command]:
    """In their order, of blocks and of prose; where a line goes on after a backslash, too."""
    text = text_of(page).replace("\\\n", " ")
    prose = {m.start(): (m[1], False) for m in PROSE.finditer(FENCED.sub(blank, text))}
    blocks = text if page.suffix != ".md" else PROSE.sub(blank, blank_outside(text))
    found = prose | {m.start(): (m[1], True) for m in LINE.finditer(blocks)}
    made = []
    for _, (line, whole) in sorted(found.items()):
        bare = re.split(r"\s{3,}|\s#| && | \| ", line)[0]  # what it does stands behind
        program, *words = shlex.split(" ".join(bare.split()))
        made.append(Command(program, words, whole))
    return made


def blank(match: re.Match[str]) -> str:
    return " " * len(match[0])


def blank_outside(text: str) -> str:
    """The text with blanks for all but fenced blocks."""
    out = re.sub(r"[^\n]", " ", text)
    for match in FENCED.finditer(text):
        out = out[: match.start(1)] + match[1] + out[match.end(1) :]
    return out


class Parsed(NamedTuple):
    """A command line as the CLI understands it: its parameters, and the files that it reads."""

    name: str
    values: dict[str, Any]
    reads: list[Path]
    lacks: bool


def parsed(command: Command) -> Parsed:
    """Read a command line; names, options and values that are none raise what the CLI raises."""
    top = CLI.make_context("servo-models", [], resilient_parsing=True)
    name, *words = command.words
    if name.startswith("-"):
        known = {option for one in CLI.get_params(top) for option in one.opts}
        assert name in known, name
        return Parsed(name, {}, [], lacks=True)
    sub = CLI.commands.get(name)
    assert sub is not None, f"no command '{name}'"
    try:
        values = sub.make_context(name, words, parent=top).params
    except typer.Exit:  # --help
        return Parsed(name, {}, [], lacks=True)
    except USAGE_ERROR as error:
        told = error.format_message()
        assert not command.whole, told
        assert re.search("Missing|requires an argument", told), told
        return Parsed(name, {}, [], lacks=True)
    reads = [
        Path(re.split(r"#|\.py:", str(value))[0])
        for one in sub.params
        if one.name in values and not WRITES.search(getattr(one, "help", "") or "")
        for value in (values[one.name] if one.multiple or one.nargs != 1 else [values[one.name]])
        or ()
        if isinstance(value, Path)
        or (isinstance(value, str) and re.fullmatch(r"[^=]*\w\.[a-z]+(#.*)?", value))
        if name != "new"
    ]
    return Parsed(name, values, reads, lacks=False)


def stand_ins(one: Parsed, folder: Path) -> list[Path]:
    """Put files of the gimbal, and parameters, where a command reads the reader's own."""
    wanted = [folder / path for path in one.reads if one.name in ANY_FILE]
    if any(re.fullmatch(GIMBAL, path.name) for path in wanted):
        wanted += [folder / "gimbal.py", folder / "log.csv"]
    put = [
        (path, ROOT / stand_in)
        for path in wanted
        for pattern, stand_in in STAND_INS.items()
        if re.fullmatch(pattern, path.name) and not path.exists()
    ]
    return [Path(shutil.copy(stand_in, path)) for path, stand_in in put]


def cannot_run(command: Command, one: Parsed, folder: Path) -> str:
    """Why a command is not run here, "" where it is."""
    if one.lacks or (len(command.words) == 1 and not command.whole):
        return "it is named, without all of its words"
    if any(re.fullmatch(r"[A-Z]{3,}", word) for word in command.words):
        return "a word stands for the reader's own"
    if one.name == "new" and (folder / command.words[-1]).exists():
        return "it made what lies there"
    named = {*all_actuators(), *effects()}  # which are no files, whatever a command asks for
    needed = [folder / path for path in one.reads if str(path) not in named]
    for path in (path for path in needed if path.suffix == ".toml" and path.exists()):
        needed += [folder / log for log in LOG.findall(path.read_text("utf-8"))]
    if missing := [path.name for path in needed if not path.exists()]:
        return f"it needs {missing[0]}, which the reader has or a long command makes"
    options = {option for it in CLI.commands[one.name].params for option in it.opts}
    if options & {"--time-limit", "--cases"}:
        return "it takes minutes"
    if "--serve" in command.words or "--scheduler" in command.words:
        return "it serves, or needs a server"
    if one.name in ("build", "validate") and not one.reads and len(command.words) == 1:
        return "it is of all actuators: build_fmu.py does that"
    return ""


def page_id(page: Path) -> str:
    return str(page.relative_to(ROOT))


def fits(page: Path) -> bool:
    """Whether a command of an example fits a model to its logs, which takes up to two minutes."""
    return "examples" in page.parts and any("identify" in it.words[:1] for it in commands(page))


WITH_COMMANDS = [page for page in PAGES if commands(page)]
every_page = pytest.mark.parametrize("page", WITH_COMMANDS, ids=page_id)


def test_commands_are_found_in_pages_and_notebooks() -> None:
    assert sum(len(commands(page)) for page in WITH_COMMANDS) > 250
    names = {it.words[0] for page in WITH_COMMANDS for it in commands(page) if it.words}
    assert set(CLI.commands) <= names
    assert {page.suffix for page in WITH_COMMANDS} == {".md", ".ipynb", ".py"}


@every_page
def test_every_command_is_understood(page: Path) -> None:
    """What is read in folders of the repository is there, but for what a command has written."""
    written = (ROOT / ".gitignore").read_text("utf-8").split()
    for command in commands(page):
        if command.program == "servo-models":
            for path in parsed(command).reads:
                kept = f"{path.parts[0]}/" not in written and (ROOT / path.parts[0]).is_dir()
                if len(path.parts) > 1 and kept:
                    assert (ROOT / path).exists(), path


@every_page
def test_python_is_given_what_is_there(page: Path) -> None:
    """Files and modules, and options that stand in their sources."""
    text = text_of(page)
    for _, given, _ in (it for it in commands(page) if it.program == "python"):
        words = [word for word in given if word != "-P"]
        if words[0] == "-c":
            continue
        name = words[1] if words[0] == "-m" else words[0]
        if words[0] == "-m":
            if name in ("pytest", "pip", "venv"):
                sources = [ROOT / word.split("::")[0] for word in words[2:] if ".py" in word]
                assert all(source.exists() for source in sources), words
                continue
            if name == "studies" and words[2:]:
                name = f"{'servo_models' if words[2] == GENERATOR else name}.{words[2]}"
            found = importlib.util.find_spec(name)
            assert found is not None, words
            sources = [Path(str(found.origin))]
            if sources[0].name == "__init__.py":
                sources.append(sources[0].with_name("__main__.py"))
        else:
            sources = [place / name for place in (ROOT, page.parent) if (place / name).exists()]
            assert sources or text.count(name) > 1, words  # which the page tells of
        told = "".join(path.read_text("utf-8") for path in sources)
        told += (ROOT / "tests" / "__main__.py").read_text("utf-8") if name == "tests" else ""
        for option in (word for word in words[2:] if word.startswith("--")):
            assert not sources or option.partition("=")[0] in told, (words, option)


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=pytest.mark.long if fits(page) else pytest.mark.thorough)
        for page in WITH_COMMANDS
        if any(it.program == "servo-models" for it in commands(page))
    ],
    ids=page_id,
)
def test_commands_of_seconds_run(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Run
) -> None:
    """In the folder of an example, else in an empty one with what the page says to save."""
    folder = tmp_path / "here"
    if page.is_relative_to(ROOT / "examples") or page.is_relative_to(ROOT / "docs" / "zoo"):
        shutil.copytree(page.parent, folder)
    else:
        folder.mkdir()
    for told, _, block in STEP.findall(text_of(page)):
        if saved := SAVED.findall(told):
            (folder / saved[-1]).write_text(block, encoding="utf-8")
    monkeypatch.chdir(folder)
    monkeypatch.setattr("webbrowser.open", lambda *_: True)
    for command in (it for it in commands(page) if it.program == "servo-models"):
        one = parsed(command)
        stood = stand_ins(one, folder)
        if reason := cannot_run(command, one, folder):
            print(f"not run: {' '.join(command.words)}: {reason}")
            continue
        if "--init" in command.words:  # writes what the page says to save over it afterwards
            (folder / one.reads[0]).with_suffix(".toml").unlink(missing_ok=True)
        code, out, err = run(*command.words)
        for path in stood:  # what an earlier command makes comes later under its name
            path.unlink()
        assert code in ((0, 1) if one.name in JUDGES else (0,)), (command.words, out, err)
