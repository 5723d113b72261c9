"""Reference pages, written from the declarations: ``commands.md`` and ``python.md``."""

from __future__ import annotations

import importlib
import inspect
import re
from itertools import groupby
from pathlib import Path
from typing import Any

import generated
import typer
from sphinx.application import Sphinx
from typer.cli import get_docs_for_click

import servo_models as sm
from servo_models.cli import app as commands

EXAMPLES = re.compile(r"((?:^servo-models .*\n\n)+)", re.MULTILINE)
TOGETHER = re.compile(r"^:(?:ivar|param) (?:\w+, )+\w+(?=:)")
OVERVIEW = re.compile(r"\*\*Commands\*\*:\n\n(?:\* .*\n)+")  # whose lines are cut short


def commands_page() -> str:
    """Every command with its options, as ``--help`` tells them."""
    command = typer.main.get_command(commands)
    text = get_docs_for_click(
        obj=command, ctx=typer.Context(command, info_name="servo-models"), name="servo-models"
    )
    text = OVERVIEW.sub("", text.replace("# `servo-models`", "# Commands, option by option", 1))
    text = text.replace("```console\n$ ", "```\n").replace("\\[", "[")
    return EXAMPLES.sub(lambda found: f"```\n{_joined(found[1])}```\n\n", text)


def _joined(paragraphs: str) -> str:
    return paragraphs.replace("\n\n", "\n")


def python_pages() -> dict[str, str]:
    """Every public name, a page for each folder that they come from."""

    def home(name: str) -> str:
        module = inspect.getmodule(getattr(sm, name))
        assert module
        return ".".join(module.__name__.split(".")[:2])

    pages, rows = {}, []
    for folder, group in groupby(sorted(sm.__all__, key=home), home):
        names, file = list(group), f"python_{folder.rpartition('.')[2]}"
        about = (importlib.import_module(folder).__doc__ or "").splitlines()[0]
        title = folder.rpartition(".")[2].capitalize()
        parts = [f"# {title}", about]
        parts += [f"```{{eval-rst}}\n{_directive(name)}\n```" for name in names]
        pages[f"{file}.md"] = "\n\n".join(parts) + "\n"
        links = ", ".join(f"[{name}](#servo_models.{name})" for name in names)
        rows.append(f"| [{title}]({file}.md) | {about} | {links} |")
    files = "\n".join(it.removesuffix(".md") for it in pages)
    listed = "\n".join(rows)
    pages["python.md"] = (
        "# Python, name by name\n\n"
        "`import servo_models as sm`. Everything inside is SI. The tests run every example.\n\n"
        f"| folder | | names |\n|---|---|---|\n{listed}\n\n"
        f"```{{toctree}}\n:hidden:\n\n{files}\n```\n"
    )
    return pages


def _directive(name: str) -> str:
    thing = getattr(sm, name)
    if inspect.isclass(thing):
        kind = "autoexception" if issubclass(thing, Exception) else "autoclass"
        return f".. {kind}:: servo_models.{name}\n   :members:"
    return f".. autofunction:: servo_models.{name}"


def names_at_once(*event: Any) -> None:
    """Names that a docstring describes together stay together: Sphinx takes a comma for a type."""
    lines: list[str] = event[-1]
    lines[:] = [TOGETHER.sub(lambda found: found[0].replace(", ", "/"), line) for line in lines]


def pages(app: Sphinx) -> None:
    made = {"commands.md": commands_page(), **python_pages()}
    generated.write(Path(app.srcdir) / "docs" / "reference", made)


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", pages)
    app.connect("autodoc-process-docstring", names_at_once, priority=900)  # after napoleon
    return {"parallel_read_safe": True, "parallel_write_safe": True}
