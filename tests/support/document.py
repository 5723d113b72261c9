"""Follow a document as its reader does: run its commands, compare what it shows of their output."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from servo_models.diagnosis.search.selection import FIRST_ANSWER

ROOT = Path(__file__).parents[2]
COMMAND = re.compile(r"^```\n\$ servo-models (.*)\n((?:.*\n)*?)```", re.MULTILINE)


PROGRESS = re.compile(rf"{FIRST_ANSWER}|looking for joints|\d+ (?:of \d|joints|descriptions)")
STEP = re.compile(r"((?:^(?!```).*\n)*)^```(\w*)\n((?:.*\n)*?)```", re.MULTILINE)
NOT_WELL = ("explain", "comes nearest", "on its low bound", "Warning:", "lack something")
"""Of what commands tell with exit code 1."""
SAVED = re.compile(r"[Ss]aved?\s+(?:this\s+|it\s+)?as\s+`([\w.]+)`")


def code_blocks(text: str, language: str) -> list[str]:
    """Return the fenced blocks of one language."""
    return re.findall(rf"^```{language}\n((?:.*\n)*?)```", text, re.MULTILINE)


def follow(
    text: str, run: Callable[..., tuple[int, str, str]], doubted: str | tuple[str, ...] = "-"
) -> list[str]:
    """Run the commands of a text and return them; the lines that it shows must be printed.

    Commands that begin with ``doubted`` end with exit code 1: they ran and something is not well.
    """
    commands: list[tuple[str, str]] = COMMAND.findall(text)
    assert commands
    for command, shown in commands:
        code, out, err = run(*command.split())
        assert (code, complaints(err)) == (int(command.startswith(doubted)), []), command
        for line in shown.splitlines():
            assert line == "..." or any(alike(line, other) for other in out.splitlines()), line
    return [command for command, _ in commands]


def complaints(err: str) -> list[str]:
    """Lines on standard error, without the first answer of a diagnosis and what a survey does."""
    return [line for line in err.splitlines() if not PROGRESS.match(line)]


def alike(shown: str, printed: str) -> bool:
    """Whether a line begins as the one shown, numbers but for a few percent."""
    pairs = list(zip(shown.split(), printed.split()))
    return len(pairs) == len(shown.split()) and all(
        one == two or near(one, two) for one, two in pairs
    )


def near(one: str, two: str) -> bool:
    try:
        return float(one) == pytest.approx(float(two), rel=0.05, abs=1e-9)
    except ValueError:
        return False


def work_through(text: str, folder: Path, run: Callable[..., tuple[int, str, str]]) -> None:
    """Do in a folder what a tutorial says, in its order: save files, run scripts and commands."""
    for told, language, block in STEP.findall(text):
        doubted = "" if any(it in block for it in NOT_WELL) else "-"
        if saved := SAVED.findall(told):
            (folder / saved[-1]).write_text(block, encoding="utf-8")
        elif block.startswith("$ python "):
            command, *shown = block.splitlines()
            words = [sys.executable, *command.split()[2:]]
            done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=True)
            assert done.stdout.splitlines() == shown
        elif block.startswith("$"):
            follow(f"```{language}\n{block}```", run, doubted)
