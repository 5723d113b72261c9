"""FMUs of another maker, compiled from ``foreign_fmu.c``, with references from other solutions.

Every reference is exact, or scipy's at 1e-11, and shares nothing with the C source.
"""

from __future__ import annotations

import functools
import subprocess
import tempfile
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from fmu_src.native.archive import headers

Array = NDArray[np.float64]
Curves = dict[str, Array]
SOURCE = Path(__file__).with_name("foreign_fmu.c")
FLAGS = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC")
PLACES = {"Boolean": 200, "String": 300, "Integer": 100, "Enumeration": 100}
PLACES |= {"Int32": 100, "Int64": 100, "UInt16": 100}
FIRST = {"input": 0, "output": 8, "parameter": 16}
REAL = ("Real", "Float64", "Float32")


@dataclass(frozen=True)
class Var:
    """A variable: its place among those of its causality counts from 0."""

    name: str
    causality: str
    kind: str
    place: int = 0
    unit: str = ""
    variability: str = ""
    start: str = "0"

    @property
    def reference(self) -> int:
        return PLACES.get(self.kind, 0) + FIRST[self.causality] + self.place


@dataclass(frozen=True)
class Foreign:
    """An FMU and how it is run.

    Attributes:
        model: in the C source.
        fmi: version.
        variables: without time.
        stop, step: of the run [s].
        reference: outputs by name, from times and inputs, each held until the next point.
        inputs: by name, functions of time.
        start: start values in the tolerance file.
        any_step: communication steps may differ.
    """

    model: str
    fmi: str
    variables: tuple[Var, ...]
    stop: float
    step: float
    reference: Callable[[Array, Curves], Curves]
    inputs: Mapping[str, Callable[[Array], Array]] = field(default_factory=dict)
    start: str = ""
    any_step: bool = True

    @property
    def times(self) -> Array:
        return np.asarray(self.step * np.arange(round(self.stop / self.step) + 1), dtype=np.float64)

    def write(self, folder: Path, fault: str = "") -> Path:
        """Write the FMU, with a fault planted in it."""
        name = f"{self.model}_{fault}" if fault else self.model
        path = folder / f"{name}.fmu"
        guid = f"{{{self.model}/{fault}}}" if fault else f"{{{self.model}}}"
        three = self.fmi == "3.0"
        binaries = "x86_64-linux" if three else "linux64"
        with zipfile.ZipFile(path, "w") as archive:
            describe = _description3 if three else _description2
            archive.writestr("modelDescription.xml", describe(self, guid))
            archive.writestr(f"binaries/{binaries}/{self.model}.so", library(three))
        return path

    def files(self, folder: Path) -> tuple[Path | None, Path, Path | None]:
        """Write inputs, reference and tolerances, where there are any."""
        fed = {name: curve(self.times) for name, curve in self.inputs.items()}
        right = self.reference(self.times, fed)
        reference = table(folder / "ref.csv", self.times, right)
        inputs = table(folder / "in.csv", self.times, fed) if fed else None
        tolerance = None
        if self.start:
            tolerance = folder / "tol.toml"
            tolerance.write_text(f"start = {self.start}\n")
        return inputs, reference, tolerance


@functools.cache
def library(three: bool) -> bytes:
    """Compile all models, for FMI 3.0 or 2.0."""
    version = ["-DFMI3"] if three else []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "foreign.so"
        subprocess.run(
            ["cc", *FLAGS, *version, f"-I{headers()}", SOURCE, "-o", path, "-lm"], check=True
        )
        return path.read_bytes()


def table(path: Path, times: Array, columns: Curves) -> Path:
    """Write a CSV file with 12 digits."""
    header = ",".join(["time", *columns])
    rows = np.column_stack([times, *columns.values()])
    np.savetxt(path, rows, fmt="%.12g", delimiter=",", header=header, comments="")
    return path


def _description2(one: Foreign, guid: str) -> str:
    outputs = [k for k, v in enumerate(one.variables, 1) if v.causality == "output"]
    unknown = "".join(f'<Unknown index="{k}"/>' for k in outputs)
    units = "".join(f"<Unit name={quoteattr(u)}/>" for u in _units(one))
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="2.0"'
        f' modelName="{one.model}" guid="{guid}">'
        f'<CoSimulation modelIdentifier="{one.model}"'
        f' canHandleVariableCommunicationStepSize="{str(one.any_step).lower()}"/>'
        f"{f'<UnitDefinitions>{units}</UnitDefinitions>' if units else ''}"
        f'<DefaultExperiment stepSize="{one.step:g}"/>'
        f"<ModelVariables>{''.join(map(_variable2, one.variables))}</ModelVariables>"
        f"<ModelStructure><Outputs>{unknown}</Outputs>"
        f"<InitialUnknowns>{unknown}</InitialUnknowns></ModelStructure></fmiModelDescription>"
    )


def _variable2(v: Var) -> str:
    initial = ' initial="calculated"' if v.causality == "output" else ""
    unit = f" unit={quoteattr(v.unit)}" if v.unit else ""
    start = "" if v.causality == "output" else f' start="{v.start}"'
    return (
        f'<ScalarVariable name={quoteattr(v.name)} valueReference="{v.reference}"'
        f' causality="{v.causality}" variability="{_variability(v)}"{initial}>'
        f"<{v.kind}{start}{unit}/></ScalarVariable>"
    )


def _description3(one: Foreign, guid: str) -> str:
    outputs = [v.reference for v in one.variables if v.causality == "output"]
    structure = "".join(f'<Output valueReference="{k}"/>' for k in outputs)
    structure += "".join(f'<InitialUnknown valueReference="{k}"/>' for k in outputs)
    units = "".join(f"<Unit name={quoteattr(u)}/>" for u in _units(one))
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="3.0"'
        f' modelName="{one.model}" instantiationToken="{guid}">'
        f'<CoSimulation modelIdentifier="{one.model}"'
        f' canHandleVariableCommunicationStepSize="{str(one.any_step).lower()}"/>'
        f"{f'<UnitDefinitions>{units}</UnitDefinitions>' if units else ''}"
        f'<DefaultExperiment stepSize="{one.step:g}"/>'
        '<ModelVariables><Float64 name="time" valueReference="999" causality="independent"/>'
        f"{''.join(map(_variable3, one.variables))}</ModelVariables>"
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )


def _variable3(v: Var) -> str:
    unit = f" unit={quoteattr(v.unit)}" if v.unit else ""
    inner, start = "", "" if v.causality == "output" else f' start="{v.start}"'
    if v.kind == "String":
        inner, start = f'<Start value="{v.start}"/>', ""
    return (
        f'<{v.kind} name={quoteattr(v.name)} valueReference="{v.reference}"'
        f' causality="{v.causality}" variability="{_variability(v)}"{start}{unit}>'
        f"{inner}</{v.kind}>"
    )


def _variability(v: Var) -> str:
    if v.causality == "parameter":
        return "fixed"
    return v.variability or ("continuous" if v.kind in REAL else "discrete")


def _units(one: Foreign) -> list[str]:
    return sorted({v.unit for v in one.variables if v.unit})


# References


def linear(a: Sequence[Sequence[float]], b: Sequence[float], names: Sequence[str]) -> Any:
    """States of x' = a x + b u with u held, exact; the first ones are the outputs."""

    def solved(times: Array, inputs: Curves) -> Curves:
        size = len(b)
        whole = np.zeros((size + 1, size + 1))
        whole[:size, :size], whole[:size, size] = a, b
        step = expm(whole * (times[1] - times[0]))
        x, rows = np.zeros(size), []
        for u in inputs["u"]:
            rows.append(x)
            x = step[:size, :size] @ x + step[:size, size] * u
        return dict(zip(names, np.array(rows).T))

    return solved


def lag(gain: float, tau: float) -> Any:
    return linear([[-1.0 / tau]], [gain / tau], ["y"])


OSCILLATOR = linear([[0.0, 1.0], [-400.0, -8.0]], [0.0, 400.0], ["position", "speed"])
MOTOR = linear(
    [[0.0, 1.0, 0.0], [0.0, -0.5, 50.0], [0.0, -5.0, -200.0]],
    [0.0, 0.0, 100.0],
    ["angle", "speed", "current"],
)


def pid(times: Array, inputs: Curves) -> Curves:
    right = float(inputs["u"][0])

    def rates(t: float, x: Array) -> list[float]:
        wish = 4.0 * (right - x[0]) + x[1]
        u = min(max(wish, -1.5), 1.5)
        return [(u - x[0]) / 0.2, 10.0 * (right - x[0]) + 5.0 * (u - wish)]

    x = solve_ivp(
        rates, (0.0, times[-1]), [0.0, 0.0], "DOP853", times, rtol=1e-10, atol=1e-12, max_step=0.01
    ).y
    return {"y": x[0], "control": np.clip(4.0 * (right - x[0]) + x[1], -1.5, 1.5)}


def counter(times: Array, inputs: Curves) -> Curves:
    return {"count": np.floor(times / 0.1 + 1e-7)}


def relay(times: Array, inputs: Curves) -> Curves:
    on, rows = 0.0, [0.0]
    for u in inputs["u"][:-1]:
        on = 1.0 if u > 0.5 else 0.0 if u < -0.5 else on
        rows.append(on)
    return {"on": np.array(rows)}


def ball(times: Array, inputs: Curves) -> Curves:
    height, speed = np.empty_like(times), np.empty_like(times)
    begin, h, v = 0.0, 1.0, 0.0
    for k, t in enumerate(times):
        while True:
            flight = (v + np.sqrt(v * v + 2.0 * 9.81 * h)) / 9.81
            if begin + flight > t:
                break
            begin, h, v = begin + flight, 0.0, 0.8 * (9.81 * flight - v)
        d = t - begin
        height[k], speed[k] = h + v * d - 4.905 * d * d, v - 9.81 * d
    return {"height": height, "speed": speed}


def vanderpol(times: Array, inputs: Curves) -> Curves:
    def rates(t: float, x: Array) -> list[float]:
        return [x[1], (1.0 - x[0] ** 2) * x[1] - x[0]]

    x = solve_ivp(rates, (0.0, times[-1]), [2.0, 0.0], "DOP853", times, rtol=1e-11, atol=1e-12).y
    return {"x": x[0], "v": x[1]}


def sampled(times: Array, inputs: Curves) -> Curves:
    every = round(0.02 / (times[1] - times[0]))
    decay = np.exp(-2.0 * (times[1] - times[0]))
    x = total = u = 0.0
    rows = []
    for k, right in enumerate(inputs["u"]):
        if k % every == 0:  # at t = 0 the input is the first one
            error = float(inputs["u"][max(k - 1, 0)]) - x
            total += 0.2 * error
            u = 6.0 * error + total
        rows.append((x, u))
        x = u / 2.0 + (x - u / 2.0) * decay
        del right
    return dict(zip(("y", "control"), np.array(rows).T))


def line(times: Array, inputs: Curves) -> Curves:
    count = round(0.05 / (times[1] - times[0]))
    return {"y": np.concatenate([np.zeros(count), inputs["u"][:-count]])}


def gears(times: Array, inputs: Curves) -> Curves:
    x = np.concatenate([[0.0], np.cumsum(np.diff(times) * 0.5 * inputs["gear"][:-1])])
    return {"x": x, "state": 1.0 + (x >= 0.2) + (x >= 0.6)}


def rate(times: Array, inputs: Curves) -> Curves:
    y, rows = 0.0, []
    for u in inputs["u"]:
        rows.append(y)
        most = 2.0 * (times[1] - times[0])
        y += min(max(u - y, -most), most)
    return {"y": np.array(rows)}


def heat(times: Array, inputs: Curves) -> Curves:
    warmer = linear([[-0.05]], [0.1], ["y"])(times, inputs)["y"]
    return {"temperature": 300.0 + warmer}


def play(times: Array, inputs: Curves) -> Curves:
    y, rows = 0.0, []
    for u in inputs["u"]:
        rows.append(y)
        y = min(max(y, u - 0.1), u + 0.1)
    rows[0] = min(max(0.0, inputs["u"][0] - 0.1), inputs["u"][0] + 0.1)
    return {"y": np.array(rows)}


def stairs(times: Array, inputs: Curves) -> Curves:
    u = np.concatenate([inputs["u"][:1], inputs["u"][:-1]])
    return {"y": np.round(u * 4.0) / 4.0}


def pulses(times: Array, inputs: Curves) -> Curves:
    return {"on": (np.mod(times + 1e-9, 0.05) < 0.015 - 1e-9).astype(float)}


def friction(times: Array, inputs: Curves) -> Curves:
    v, rows = 0.0, []
    for force in inputs["u"]:
        rows.append(v)
        left = times[1] - times[0]
        if v != 0.0:
            pull = force - 0.5 * np.sign(v)
            stops = -v / pull if v * pull < 0.0 else np.inf
            spent = min(left, stops)
            v, left = (0.0 if stops <= left else v + spent * pull), left - spent
        if v == 0.0 and abs(force) > 0.5 and left > 0.0:
            v = left * (force - 0.5 * np.sign(force))
    return {"speed": np.array(rows), "slips": (np.array(rows) != 0.0).astype(float)}


def constant(times: Array, inputs: Curves) -> Curves:
    return {"y": np.full_like(times, 4.2)}


def one(times: Array) -> Array:
    return np.ones_like(times)


def square(times: Array) -> Array:
    return np.where(np.mod(times, 0.8) < 0.4 - 1e-9, 1.0, -0.5)


def sine(times: Array) -> Array:
    return np.sin(2.0 * np.pi * 1.3 * times)


def gear(times: Array) -> Array:
    return np.where(times < 0.5, 1.0, 2.0)


U2, U3 = Var("u", "input", "Real"), Var("u", "input", "Float64")


def out(kind: str, *names: str, units: Sequence[str] = ("", "", "")) -> tuple[Var, ...]:
    return tuple(Var(name, "output", kind, k, units[k]) for k, name in enumerate(names))


GAINS = (
    Var("gain", "parameter", "Real", 0, start="2"),
    Var("tau", "parameter", "Real", 1, "s", start="0.1"),
)
FOREIGN: dict[str, Foreign] = {
    "lag": Foreign(
        "lag",
        "2.0",
        (U2, *out("Real", "y", units=("rad",)), *GAINS),
        1.0,
        1e-3,
        lag(2.0, 0.1),
        {"u": one},
    ),
    "lag in 32 bits": Foreign(
        "lag",
        "3.0",
        (Var("u", "input", "Float32"), *out("Float32", "y")),
        2.0,
        5e-3,
        lag(2.0, 0.1),
        {"u": square},
    ),
    "lag by Euler": Foreign(
        "lag_euler", "2.0", (U2, *out("Real", "y")), 2.0, 2e-3, lag(2.0, 0.1), {"u": sine}
    ),
    "lag of fixed steps": Foreign(
        "lag",
        "2.0",
        (U2, *out("Real", "y")),
        1.5,
        1e-2,
        lag(2.0, 0.1),
        {"u": square},
        any_step=False,
    ),
    "oscillator": Foreign(
        "oscillator",
        "3.0",
        (U3, *out("Float64", "position", "speed", units=("m", "m/s"))),
        2.0,
        2e-3,
        OSCILLATOR,
        {"u": one},
    ),
    "oscillator, symplectic": Foreign(
        "symplectic",
        "2.0",
        (U2, *out("Real", "position", "speed")),
        2.0,
        1e-2,
        OSCILLATOR,
        {"u": square},
    ),
    "PID with anti-windup": Foreign(
        "pid", "3.0", (U3, *out("Float64", "y", "control")), 3.0, 5e-3, pid, {"u": one}
    ),
    "counter": Foreign("counter", "2.0", out("Integer", "count"), 1.0, 1e-2, counter),
    "counter of 16 bits": Foreign("counter", "3.0", out("UInt16", "count"), 2.0, 4e-3, counter),
    "relay": Foreign("relay", "2.0", (U2, *out("Boolean", "on")), 2.0, 1e-3, relay, {"u": sine}),
    "bouncing ball": Foreign(
        "ball", "2.0", out("Real", "height", "speed", units=("m", "m/s")), 1.5, 5e-3, ball
    ),
    "Van der Pol": Foreign("vanderpol", "3.0", out("Float64", "x", "v"), 10.0, 1e-2, vanderpol),
    "sampled controller": Foreign(
        "sampled",
        "2.0",
        (U2, *out("Real", "y"), Var("control", "output", "Real", 1, variability="discrete")),
        1.0,
        5e-3,
        sampled,
        {"u": one},
    ),
    "delay line": Foreign("line", "3.0", (U3, *out("Float64", "y")), 1.0, 1e-3, line, {"u": sine}),
    "string parameter": Foreign(
        "texts",
        "3.0",
        (U3, *out("Float64", "y"), Var("mode", "parameter", "String", start="slow")),
        1.0,
        2e-3,
        lag(1.0, 0.05),
        {"u": one},
        '{ mode = "fast" }',
    ),
    "gears": Foreign(
        "gears",
        "2.0",
        (Var("gear", "input", "Integer"), *out("Real", "x"), *out("Integer", "state")),
        1.05,
        7e-3,
        gears,
        {"gear": gear},
    ),
    "rate limiter": Foreign("rate", "2.0", (U2, *out("Real", "y")), 2.0, 2e-3, rate, {"u": square}),
    "motor": Foreign(
        "motor",
        "3.0",
        (U3, *out("Float64", "angle", "speed", "current", units=("rad", "rad/s", "A"))),
        1.0,
        2e-3,
        MOTOR,
        {"u": one},
    ),
    "heat": Foreign(
        "heat", "2.0", (U2, *out("Real", "temperature", units=("K",))), 20.0, 0.1, heat, {"u": one}
    ),
    "play": Foreign("play", "3.0", (U3, *out("Float64", "y")), 2.0, 2e-3, play, {"u": sine}),
    "stairs": Foreign("stairs", "2.0", (U2, *out("Real", "y")), 2.0, 2e-3, stairs, {"u": sine}),
    "pulses": Foreign("pulses", "3.0", out("Boolean", "on"), 1.0, 1e-3, pulses),
    "friction": Foreign(
        "friction",
        "3.0",
        (U3, *out("Float64", "speed"), *out("Boolean", "slips")),
        2.0,
        1e-3,
        friction,
        {"u": sine},
    ),
    "constant": Foreign("constant", "2.0", out("Real", "y"), 1.0, 1e-2, constant),
}
