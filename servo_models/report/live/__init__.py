"""A panel that simulates in the reader's browser: the data that a page needs for it.

A page holds the model as JavaScript, printed from its declaration, and the data as JSON; the
panel in ``panel.js`` draws them, with uPlot.  Only a page of ``explore --serve`` asks a server.
Texts become text of the page, never markup.  Numbers are SI; ``scale`` turns them into the unit
that people read.

    Live("Move the parameters", (LiveModel(name="sg90", program=js_model(flat), ...),))
"""

from __future__ import annotations

import base64
import hashlib
import math
import re
import zlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib.resources import files
from typing import TYPE_CHECKING

from servo_models.report.interchange import finite_json

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


VARIABLE = re.compile(r"\bv_\w+")  # variable of a model, as ``core.js_text`` writes it
FIGURE = re.compile(r"(?<![\w$.])(\d[\w.]*(?:(?<=e)[-+]\d+)?)")  # number in a script
LET = re.compile(r"(?<=0);\nlet (?=\S+=0;)")  # declaration of a variable after another
SPACE = re.compile(r" ?([=*/<>?:,;(){}|&]) ?| ([+-]) (?![+-])")
"""Operators whose blanks can go: not those of ``a - -b``, where they keep the signs apart."""
SERVED = "; connect-src 'self'"  # what the policy of a served page adds


@dataclass(frozen=True)
class LiveSignal:
    """An input or output of the model.

    Attributes:
        name, about: of the wire.
        unit: unit that people read; a value in SI times ``scale`` is in it.
        floor: standard deviation of its noise [SI], None where it is not measured.
        rest: value [SI] of an input that nobody drives.
        low, high: bounds of an input [SI].
        reach: its full scale [SI].
        units: units in which people write it, with their size in SI.
    """

    name: str
    about: str
    unit: str
    scale: float = 1.0
    floor: float | None = None
    rest: float = 0.0
    low: float = -math.inf
    high: float = math.inf
    reach: float = 1.0
    units: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class LiveParameter:
    """A parameter of the model.

    Attributes:
        name, about: as declared.
        unit: unit that people read; a value in SI times ``scale`` is in it; ``si`` is the SI unit.
        low, high: bounds [SI].
        slider: ends of its slider [SI].
        effect: that it belongs to, "" for the plant.
        switch: the value [SI] that switches its effect on, None where it is no switch.
        error: standard error [SI], None where nobody has estimated it.
        shown: whether it is listed first, as it was fitted or belongs to an effect that was found.
    """

    name: str
    about: str
    unit: str
    scale: float
    low: float
    high: float
    slider: tuple[float, float]
    si: str = "1"
    effect: str = ""
    switch: float | None = None
    error: float | None = None
    shown: bool = False


@dataclass(frozen=True)
class LiveRun:
    """A log: what drives the model, and what was measured.

    Attributes:
        name: of the log.
        times, inputs: ``encoded``, [s] and SI, the inputs of a row after those of the row before.
        measured: by output, ``encoded`` [SI].
        counted: ``encoded``, 1 for samples that count in an error.
        begin: time of the first sample in the file [s].
        settle: time [s] for which ``held`` is held before the first sample.
        held: inputs meanwhile, one row for each of ``LiveModel.sets``; values that are none of
            these sets take the last row.
        placed: places in the state and their values, where the log begins in motion; as ``held``.
        constants: parameters that are stated for this log, by name.
        stretches: names with the times of the file [s] between which they lie.
        after: times [s] from the command of a row until outputs were read, by name.
        note: the part of the log that is left out, in words; "" for none.
    """

    name: str
    times: str
    inputs: str
    measured: dict[str, str]
    counted: str
    begin: float = 0.0
    settle: float = 0.0
    held: tuple[tuple[float, ...], ...] = ()
    placed: tuple[tuple[tuple[int, float], ...], ...] = ()
    constants: dict[str, float] = field(default_factory=dict)
    stretches: tuple[tuple[str, float, float], ...] = ()
    after: dict[str, float] = field(default_factory=dict)
    note: str = ""


@dataclass(frozen=True)
class LiveModel:
    """A model with its logs.

    Attributes:
        name: of the actuator and its variant.
        program: JavaScript expression, see ``core.js_text.js_model``.
        actuator, variant: by which it is found.
        parameters: in the order of the parameter vector.
        effects: names of the effects with what they are.
        inputs, outputs: in the order of the program's columns.
        faults: sentence for a fault that ends a run, by the program's code.
        sets: values [SI] of all parameters by the name of the set, the nominal one first and the
            one that the panel begins with last.
        runs: logs; without any the panel drives the model itself.
        driven: input that the panel drives then, and its amplitude [SI].
        step, duration: of such a run [s].
    """

    name: str
    program: str
    actuator: str
    variant: str
    parameters: tuple[LiveParameter, ...]
    effects: dict[str, str]
    inputs: tuple[LiveSignal, ...]
    outputs: tuple[LiveSignal, ...]
    faults: dict[str, str]
    sets: dict[str, tuple[float, ...]]
    runs: tuple[LiveRun, ...] = ()
    driven: tuple[str, float] = ("", 0.0)
    step: float = 0.0
    duration: float = 0.0


@dataclass(frozen=True)
class Live:
    """A panel.

    Attributes:
        title: its heading.
        text: what to do with it, in a sentence or two.
        models: to choose from.
        other: name of values that are none of a model's sets.
        beside: what the model is compared with.
        description: name and text of the file that describes the logs, to be saved.
        dropped: whether a CSV may be dropped on it.
        served: whether it has buttons that ask its server to run commands.
    """

    title: str
    text: str
    models: tuple[LiveModel, ...]
    other: str = "what if"
    beside: str = "measured"
    description: tuple[str, str] = ("", "")
    dropped: bool = False
    served: bool = False


def encoded(values: NDArray[np.float64]) -> str:
    """Return numbers as text, bit by bit: the bytes of all by their place, deflated, in base64."""
    bytes_of = values.astype("<f8").reshape(-1, 1).view("u1")
    return _deflated(bytes_of.T.tobytes())


def _deflated(content: bytes) -> str:
    return base64.b64encode(zlib.compress(content, 9)).decode()


def asset(name: str) -> str:
    """Return a file of this folder: the panel's script and style, and those of uPlot."""
    return files(__package__).joinpath(name).read_text("utf-8")


def scripts(panels: tuple[Live, ...]) -> list[str]:
    """Return what a page executes: uPlot with its licence, the models, the panel."""
    if not panels:
        return []
    library = f"/*\n{asset('uPlot.LICENSE')}*/\n{asset('uPlot.iife.min.js')}"
    models = _shared([_short(it) for it in _programs(panels)])
    explorer = [asset("explore.js")] if any(panel.dropped for panel in panels) else []
    server = [asset("serve.js")] if any(panel.served for panel in panels) else []
    texts = [library, *models, *explorer, *server, asset("panel.js")]
    if any("</script" in text.lower() or "<!--" in text for text in texts):
        raise ValueError("a script would end its element")
    return texts


def _programs(panels: tuple[Live, ...]) -> list[str]:
    """The programs of panels without repetition: models with the same equations share one."""
    return [*dict.fromkeys(model.program for panel in panels for model in panel.models)]


def _shared(programs: Sequence[str]) -> list[str]:
    """Scripts that define programs in their order; those that differ in figures share a function.

    Variants of an actuator have the same equations, and other full scales.
    """
    alike: dict[str, list[int]] = {}
    for k, program in enumerate(programs):
        alike.setdefault(FIGURE.sub("0", program), []).append(k)
    scripts = []
    for places in alike.values():
        parts = [FIGURE.split(programs[k]) for k in places]
        varying = [j for j, them in enumerate(zip(*parts)) if len({*them}) > 1]
        shared = parts[0].copy()
        for n, j in enumerate(varying):
            shared[j] = f"figures[{n}]"
        calls = ", ".join(
            f"[{k}, [{', '.join(part[j] for j in varying)}]]" for k, part in zip(places, parts)
        )
        scripts.append(
            f"for (const [place, figures] of [{calls}])"
            f" (globalThis.servoModels ??= [])[place] = {''.join(shared)};"
        )
    return scripts


def _short(program: str) -> str:
    """A program without its indentation and with short names: a fourth of its length."""
    names = {name: f"${k}" for k, name in enumerate(dict.fromkeys(VARIABLE.findall(program)))}
    text = VARIABLE.sub(lambda found: names[found[0]], program)
    text = "\n".join(SPACE.sub(r"\1\2", line.strip()) for line in text.split("\n"))
    return LET.sub(",", text)


def styles(panels: tuple[Live, ...]) -> str:
    """Return the style of panels."""
    return f"{asset('uPlot.min.css')}\n{asset('panel.css')}" if panels else ""


def data(panels: tuple[Live, ...]) -> str:
    """Return panels as deflated JSON for a page; programs by their places among the scripts."""
    places = {program: str(place) for place, program in enumerate(_programs(panels))}
    numbered = [
        replace(
            panel,
            models=tuple(replace(model, program=places[model.program]) for model in panel.models),
        )
        for panel in panels
    ]
    return _deflated(finite_json([asdict(panel) for panel in numbered]).encode())


def policy(texts: list[str], served: bool = False) -> str:
    """Return a Content-Security-Policy: these scripts run, and nothing is loaded from anywhere.

    They may ask the server of a page that is ``served``.
    """
    hashes = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in texts]
    allowed = " ".join(f"'sha256-{it}'" for it in hashes) or "'none'"
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data:;"
        f" base-uri 'none'; form-action 'none'{SERVED if served else ''}"
    )
