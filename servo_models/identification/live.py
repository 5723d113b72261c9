"""Logs beside their model in panels that simulate in the reader's browser, and pages of them."""

from __future__ import annotations

import os.path
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from servo_models.analysis.explain import is_actuator
from servo_models.analysis.live import DRIVE, explained, live_model
from servo_models.catalogue import actuators, model
from servo_models.core.simulate import Model
from servo_models.data.description import Description, read_description
from servo_models.data.log import Log
from servo_models.data.readers import suffixes
from servo_models.data.scaffold import draft
from servo_models.data.sensor import runs
from servo_models.errors import UserError
from servo_models.files import scratch
from servo_models.identification.result import HELD_OUT
from servo_models.identification.simulation import Run, prepared
from servo_models.identification.starts import with_starts
from servo_models.report.live import Live, LiveModel, LiveRun, encoded
from servo_models.report.result import Report
from servo_models.report.sections import Section

MOST_NUMBERS = 120_000  # numbers of all logs on a page, which then has 1 MB at most
TITLE = "Explore"
MOVE = (
    "Simulated in this page: move a parameter or switch an effect, and see the measured curve met"
    " or missed. Drag across the curves to zoom."
)


def live_logs(
    model: Model,
    logs: Sequence[Log],
    sets: Mapping[str, Mapping[str, float]],
    errors: Mapping[str, float],
    shown: Collection[str],
    floors: Mapping[str, float],
) -> tuple[LiveModel, ...]:
    """Return a model with its logs for a panel; none where a block has no form in JavaScript.

    Args:
        model, sets, errors, shown, floors: see ``analysis.live.live_model``.
        logs: as measured.
    """
    runs = live_runs(model, logs, [model.values, *sets.values()])
    try:
        return (live_model(model, sets, errors, shown, runs, floors),) if runs else ()
    except UserError:
        return ()


def live_runs(
    model: Model, logs: Sequence[Log], sets: Iterable[Mapping[str, float]]
) -> tuple[LiveRun, ...]:
    """Return logs for a panel, as many rows as a page holds; ``sets`` are values [SI] in their
    order, the nominal ones first."""
    shown: list[LiveRun] = []
    left = MOST_NUMBERS
    values = [dict(it) for it in sets]
    for log in logs:
        each = 2 + len(model.plant.inputs) + len(log.outputs)
        rows = min(len(log.times), left // each)
        if rows < min(len(log.times), 2):
            break
        shown.append(_run(prepared(model, log), rows, values))
        left -= rows * each
    missing = len(logs) - len(shown)
    if missing and shown:
        note = f"{missing} more logs are not on this page."
        shown = [replace(run, note=f"{run.note} {note}".strip()) for run in shown]
    return tuple(shown)


def _run(run: Run, rows: int, sets: Sequence[Mapping[str, float]]) -> LiveRun:
    log, inputs = run.log, run.inputs[-len(run.log.times) :]
    cut = rows < len(log.times)
    held, placed = _beginnings(run, sets)
    return LiveRun(
        name=log.name,
        times=encoded(log.times[:rows]),
        inputs=encoded(inputs[:rows].ravel()),
        measured={name: encoded(values[:rows]) for name, values in log.outputs.items()},
        counted=encoded(log.counted[:rows].astype(float)),
        begin=log.begin,
        settle=log.settle,
        held=held,
        placed=placed,
        constants={n: v for n, v in log.constants.items() if n in run.model.values},
        stretches=tuple(_stretches(log, rows)),
        after={n: t for n, it in log.channels.items() if (t := it.after_command) is not None},
        note=f"The first {log.times[rows - 1]:.4g} s of {log.duration:.4g} s." if cut else "",
    )


def _beginnings(
    run: Run, sets: Sequence[Mapping[str, float]]
) -> tuple[tuple[tuple[float, ...], ...], tuple[tuple[tuple[int, float], ...], ...]]:
    """Inputs held before the log, and where the state is put, for each set of values."""
    if not run.beginning:
        return ((tuple(run.inputs[0].tolist()),) if run.log.settle > 0.0 else ()), ()
    begun = [run.begun(values) for values in sets]
    return tuple(tuple(held.tolist()) for held, _ in begun), tuple(it for _, it in begun)


def _stretches(log: Log, rows: int) -> Iterator[tuple[str, float, float]]:
    """Parts of a log that a reader may want to see, with the times of the file."""
    firsts, afters = runs(log.held_out[:rows])
    for k, (first, after) in enumerate(zip(firsts, afters)):
        name = f"{HELD_OUT} {k + 1}" if len(firsts) > 1 else HELD_OUT
        yield name, float(log.stamps[first]), float(log.stamps[after - 1])


# Pages


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
