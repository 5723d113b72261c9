"""The files of the cases, and their answers apart from them.

::

    cases/0007/description.toml, log.csv       what a diagnosis may see
    truth/0007/log.csv                         the same log without noise
    answers.json                               what is true, and the SHA-256 of every file

The seal is the SHA-256 of ``answers.json``.
"""

from __future__ import annotations

import hashlib
import json
import math
import tempfile
from collections.abc import Callable, Container, Iterator, Sequence
from itertools import count, islice
from pathlib import Path
from typing import Any

import numpy as np

from servo_models.withheld.generator.cases import CLEAN, KINDS, Acting, Case, draw_case, is_asked
from servo_models.withheld.generator.rigs import LOAD, Rig, Signal
from servo_models.withheld.rig.laws import Array
from servo_models.withheld.rig.recording import TIME, column, csv, description

VERSION = 1
DIGITS = 4  # digits of a printed reading below its noise


def generate(
    folder: Path,
    cases: int,
    seed: int,
    tiers: Sequence[str] = CLEAN,
    progress: Callable[[int, int], None] | None = None,
    kinds: Container[str] = KINDS,
    causes: Container[str] = (),
) -> str:
    """Write cases into a new folder, whole or not at all, and return the seal of their answers.

    Case i is of tier i modulo their number, and the same for any number of cases.  Those that are
    none of ``kinds`` are left out, and do not count; so are rigs without any of the ``causes``, of
    which the first one is drawn, where some are named.

    Raises:
        FileExistsError: the folder is there already.
    """
    if folder.exists():
        raise FileExistsError(f"'{folder}' exists already; name a new folder")
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as beside:
        part = Path(beside) / folder.name
        part.mkdir()
        answers = []
        numbers = (number for number in count() if is_asked(seed, number, kinds, causes))
        for number in islice(numbers, cases):
            case = draw_case(seed, number, tiers[number % len(tiers)], causes)
            answers.append(write_case(part, f"{number:04d}", case))
            if progress:
                progress(len(answers), cases)
        content = {"version": VERSION, "seed": seed, "cases": answers}
        text = json.dumps(content, indent=1).encode()
        (part / "answers.json").write_bytes(text)
        part.rename(folder)
    return hashlib.sha256(text).hexdigest()


def write_case(folder: Path, name: str, case: Case) -> dict[str, Any]:
    """Write one case; returns its answer."""
    played = [(one, i) for one in (case, *case.further) for i in range(len(one.logs))]
    logs = [f"log_{k}.csv" for k in range(1, len(played) + 1)] if len(played) > 1 else ["log.csv"]
    written = {f"cases/{name}/description.toml": _description(played, logs)}
    for (one, i), log in zip(played, logs):
        written[f"cases/{name}/{log}"] = _csv(one, i, one.logs[i], DIGITS)
        written[f"truth/{name}/{log}"] = _csv(one, i, one.noise_free[i], 2 * DIGITS)
    for path, content in written.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(content)
    e = case.experiment
    return {
        "case": name,
        "tier": case.tier,
        "actuator": e.rig.actuator,
        "kind": case.kind,
        "effects": [_effect(acting, e.rig) for acting in case.acting],
        "hidden": [_effect(acting, e.rig) for acting in case.hidden],
        "parameters": dict(e.true),
        "load_torque": e.load,
        "judged": e.rig.readings[0][0].name,
        "floor": case.floor,
        "noise": case.noise,
        "quantum": case.quantum,
        **({"faults": list(case.faults)} if case.faults else {}),
        "noise_free": [f"truth/{name}/{log}" for log in logs],
        "files": {path: hashlib.sha256(c).hexdigest() for path, c in written.items()},
    }


def _effect(acting: Acting, rig: Rig) -> dict[str, Any]:
    """A cause by the product's names, and its gap alone [SI]."""
    return {"name": acting.name, "gap": acting.gap, "parameters": acting.parameters(rig)}


def _signals(case: Case) -> list[Signal]:
    """What is logged, the judged reading first."""
    rig = case.experiment.rig
    known = {place: signal for signal, place in (*rig.readings, *rig.further)}
    return [known[place] for place in case.experiment.readings]


def _description(played: Sequence[tuple[Case, int]], names: Sequence[str]) -> bytes:
    rig = played[0][0].experiment.rig
    logs = ([f'file = "{name}"', *_lines(case)] for (case, _), name in zip(played, names))
    return f"# {rig.about}\n{description(rig.actuator, rig.variant, rig.spread, logs)}".encode()


def _lines(case: Case) -> Iterator[str]:
    """What the description says of a log, but for its file."""
    e = case.experiment
    yield TIME
    yield _column("inputs", e.rig.command)
    if e.varied:
        yield _column("inputs", LOAD)
    for signal in _signals(case):
        yield _column("outputs", signal)
    yield f'settle = "{e.rig.settle:g} s"'
    held = dict(case.constants)
    if e.load and not e.varied:
        held[LOAD.name] = e.load
    if held:
        values = (f"{json.dumps(it) if '.' in it else it} = {held[it]!r}" for it in held)
        yield f"constants = {{ {', '.join(values)} }}"


def _column(kind: str, signal: Signal) -> str:
    return column(f"{kind}.{signal.name}", signal.column, signal.unit)


def _csv(case: Case, number: int, log: Array, digits: int) -> bytes:
    """A log with its time and command; readings have ``digits`` below their noise."""
    e = case.experiment
    plan = e.plans[number]
    command = plan.command[plan.logged]
    if case.command_step:
        codes = np.round((command - e.rig.rest) / case.command_step)
        command = e.rig.rest + case.command_step * codes
    columns = {
        "time_ms": 1e3 * e.rig.step * plan.stride * case.stamps[number],
        e.rig.command.column: command / e.rig.command.unit_size,
    }
    formats = ["%.7g", f"%.{e.rig.command.digits}f"]
    if e.varied:
        columns[LOAD.column] = e.load * plan.shares[plan.logged]
        formats.append(f"%.{LOAD.digits}f")
    for i, signal in enumerate(_signals(case)):
        noise = case.noise * e.ranges[i] / e.ranges[0] / signal.unit_size
        columns[signal.column] = log[:, i] / signal.unit_size
        formats.append(f"%.{max(0, digits - math.floor(math.log10(noise)))}f")
    return csv(columns, formats).encode()
