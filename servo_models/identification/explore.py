"""A page on which somebody moves a model by hand: beside a log, driven, or beside a CSV dropped."""

from __future__ import annotations

import os.path
from dataclasses import replace
from pathlib import Path

from servo_models.analysis.explain import is_actuator
from servo_models.analysis.live import DRIVE, explained, live_model
from servo_models.core.catalogue import actuators
from servo_models.core.simulate import model
from servo_models.data.description import Description, read_description
from servo_models.data.readers import suffixes
from servo_models.data.scaffold import draft
from servo_models.errors import UserError
from servo_models.files import scratch
from servo_models.identification.live import MOVE, live_runs
from servo_models.identification.starts import with_starts
from servo_models.report.live import Live
from servo_models.report.result import Report
from servo_models.report.sections import Section

TITLE = "Explore"


def explored(what: str | None, actuator: str | None = None, trust: bool = False) -> Report:
    """Return a report with a panel that a CSV can be dropped on.

    Args:
        what: an actuator, an effect, a description, a log, or None for all actuators.
        actuator: what made a log; None guesses.
        trust: a description may name a Python file anywhere.

    Raises:
        UserError: nobody knows that name; or the file cannot be read, or its columns are not
            understood.

    Example:
        >>> explored("sg90").panels[0].dropped
        True
    """
    if what is None:
        models = tuple(live_model(model(it)) for it in actuators().values())
        return _page("All actuators", Live(TITLE, DRIVE, models, dropped=True))
    if what.lower().endswith(".toml"):
        path = Path(what)
        return _beside(read_description(path, trust), path.read_text("utf-8"), path.name)
    if not is_actuator(what) and what.lower().endswith(tuple(suffixes())) and os.path.exists(what):
        return _of_log(Path(what), actuator, trust)
    (panel,) = explained(what).panels
    return _page(what, replace(panel, dropped=True))


def _of_log(path: Path, actuator: str | None, trust: bool) -> Report:
    """A log by the description that ``check --init`` would write."""
    made = draft(path, actuator)
    name = f"{path.stem}.toml"
    with scratch() as folder:
        written = Path(folder) / name
        written.write_text(made.text(Path(folder)), encoding="utf-8")
        try:
            described = read_description(written, trust)
        except UserError as error:
            raise UserError(
                f"the columns of '{path}' are not all understood: {error}; write a description"
                f" with 'servo-models check {path} --init', complete it, and explore that"
            ) from error
    guessed = tuple(f"{text}." for text in (*made.not_used, *made.warnings))
    report = _beside(described, made.text(path.parent), name)
    return replace(report, remarks=(*guessed, "Check the lines marked 'guessed' in it."))


def _beside(described: Description, text: str, name: str) -> Report:
    chosen = described.model
    logs = with_starts(chosen, described.logs)
    runs = live_runs(chosen, logs, [chosen.values])
    shown = {*described.free, *described.uncertainty}
    panel = Live(
        TITLE,
        MOVE,
        (live_model(chosen, shown=shown, runs=runs),),
        description=(name, text),
        dropped=True,
    )
    return _page(name, panel)


def _page(title: str, panel: Live) -> Report:
    return Report(f"{TITLE}: {title}", "", sections=(Section("", live=panel),))
