"""Does the residual map find the shape of a static cause that the catalogue lacks?

The true rig is an actuator of the package with one law more, written here: a torque that is added
to its load, or a command that is bent before it arrives.  Its constants are off by up to one
standard deviation of the stated uncertainties.  Two logs, steps of several sizes and a sum of
sines; white noise on every reading, so that the cause alone makes 5 to 20 noise floors.

*quadratic*: drag with the square of the rate.  *asymmetric*: drag of one direction.  *kink*: gain
of the command that changes at one value.  *load*: torque with the square of a load that is logged.
*position*: a tight spot, a bell over the angle.  *none*: nothing is missing.

The diagnosis begins with the nominal actuator.  *Closed* is the share of what named effects leave
above the noise, both squared, on blocks that no fit has seen; without a map it is 0.  *Distance* is
the RMS difference of curve and truth at the knots, weighted by samples, over the range of the truth
where the logs went; infinite where the map is of something else.  *With named* adds to the curve
what named effects do to the same wire as functions of the same thing.  *Beside a line* is this
after a straight line is taken from both, since damping or gain of the model may hold it.  Where the
map acts on another wire than the law, the truth is what moves the output there as far, at rest.

Run: ``python -m studies residual_map [--cases 120] [--seed 0] [--out rows.jsonl]``.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np

import servo_models as sm
from servo_models.core.block import Block, Param
from servo_models.core.plant import Placement, Plant
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.diagnosis.residual_map import Curve, ResidualMap
from servo_models.diagnosis.result import Diagnosis
from servo_models.effects.residual_map import KNOTS
from servo_models.withheld.score import share

CAUSES = ("quadratic", "asymmetric", "kink", "load", "position", "none")
OF = {
    "quadratic": "rate",
    "asymmetric": "rate",
    "kink": "command",
    "load": "load",
    "position": "position",
}
"""What each is of."""
WIRES = {
    "rate": ("shaft_speed",),
    "position": ("shaft_angle", "angle"),
    "command": (),
    "load": ("load_torque",),
}
"""On which a named effect is a function of the same thing, beside the wire of the curve."""
GAP_OVER_FLOOR = (5.0, 20.0)
SAMPLES = 600  # of a log
CLOSED_BAR, DISTANCE_BAR = 0.8, 0.2

Size = Annotated[float, Param("signal", "size", low=-100.0, high=100.0, switch=True)]
Scale = Annotated[float, Param("{shaft_speed}", "speed", 1.0, 1e-6, 1e3)]
Middle = Annotated[float, Param("{shaft_angle}", "angle", 0.0, -1e3, 1e3)]
Width = Annotated[float, Param("{shaft_angle}", "width", 1.0, 1e-6, 1e3)]


@sm.effect("load", source="a body in a flow")
def quadratic(load: float, shaft_speed: float, size: Size, scale: Scale) -> float:
    """Drag with the square of the rate."""
    ratio = shaft_speed / scale
    return load + size * ratio * abs(ratio)


@sm.effect("load", source="a lip seal")
def asymmetric(load: float, shaft_speed: float, size: Size, scale: Scale) -> float:
    """Drag in positive direction only."""
    ratio = shaft_speed / scale
    return load + size * 0.5 * (ratio + abs(ratio))


@sm.effect("load", source="a tight spot")
def position(load: float, shaft_angle: float, size: Size, middle: Middle, width: Width) -> float:
    """A bell over the angle."""
    ratio = (shaft_angle - middle) / width
    return load + size * math.exp(-ratio * ratio)


LAWS: Mapping[str, Block] = {
    "quadratic": quadratic,
    "asymmetric": asymmetric,
    "position": position,
}


@dataclass(frozen=True)
class Rig:
    """An actuator on the bench.

    Attributes:
        actuator, variant: of the package.
        command: main input; ``rest`` and ``amplitude`` [SI].
        outputs: measured.
        step: between samples [s].
        slowest: frequency [Hz] of the sines, the lowest.
        speed, torque: full ones, of which causes are shares [SI].
    """

    actuator: str
    variant: str
    command: str
    rest: float
    amplitude: float
    outputs: tuple[str, ...]
    step: float
    slowest: float
    speed: float
    torque: float

    @property
    def nominal(self) -> Model:
        return sm.model(self.actuator, self.variant)

    @property
    def uncertainty(self) -> Mapping[str, float]:
        return self.nominal.actuator.variant(self.variant).uncertainty


RIGS = (
    Rig("sg90", "measured", "pulse_width", 1.5e-3, 4e-4, ("angle_reading",), 5e-3, 0.4, 5.0, 0.06),
    Rig(
        "second_order_servo",
        "pulse",
        "pulse_width",
        1.5e-3,
        4e-4,
        ("angle_reading",),
        5e-3,
        0.4,
        5.0,
        0.1,
    ),
    Rig(
        "torque_motor", "measured", "voltage", 0.0, 20.0, ("angle", "current"), 2e-4, 8.0, 3.0, 0.02
    ),
)


@dataclass(frozen=True)
class Case:
    """What is wrong on which rig, and what was measured."""

    cause: str
    rig: Rig
    size: float
    middle: float
    width: float
    logs: Mapping[str, Mapping[str, Array]]
    noise: Mapping[str, float]

    def truth(self, x: Array) -> Array:
        """The cause at some points [SI], in the unit of the wire on which it acts."""
        if self.cause == "quadratic":
            return self.size * x * np.abs(x) / self.rig.speed**2
        if self.cause == "asymmetric":
            return self.size * np.maximum(x, 0.0) / self.rig.speed
        if self.cause == "load":
            return self.size * x * np.abs(x) / self.rig.torque**2
        if self.cause == "position":
            return self.size * np.exp(-(((x - self.middle) / self.width) ** 2))
        return self.size * np.maximum(x - self.middle, 0.0)


def with_law(plant: Plant, law: Block) -> Plant:
    """The plant with one law more on its load, where a residual map would act."""
    at = next(
        i
        for i, link in enumerate(plant.chain)
        if isinstance(link, Placement)
        and "torque" in link.effect.params
        and link.name == "residual_map"
    )
    return replace(
        plant, chain=(*plant.chain[:at], sm.place("law", law, "load"), *plant.chain[at:])
    )


def commands(rig: Rig, random: np.random.Generator) -> dict[str, Array]:
    """Commands [SI] by log, from rest on."""
    levels = np.concatenate(
        [[0.0], *[[s, 0.0] for s in random.permutation([-1.0, -0.5, 0.3, 0.7, 1.0])]]
    )
    steps = np.repeat(levels, math.ceil(SAMPLES / len(levels)))[:SAMPLES]
    times = rig.step * np.arange(SAMPLES)
    sines = sum(
        0.5 / k * (np.sin(2.0 * math.pi * rig.slowest * k * times + phase) - math.sin(phase))
        for k, phase in enumerate(random.uniform(-math.pi, math.pi, 4), 1)
    )
    parts = {"steps": steps, "sines": np.asarray(sines)}
    return {name: rig.rest + rig.amplitude * part for name, part in parts.items()}


def load_of(rig: Rig, random: np.random.Generator) -> Array:
    """A load [N m] that is logged."""
    times = rig.step * np.arange(SAMPLES)
    phases = random.uniform(-math.pi, math.pi, 3)
    waves = [
        np.sin(2.0 * math.pi * rig.slowest * f * times + p) - math.sin(p)
        for f, p in zip((0.7, 1.3, 2.1), phases)
    ]
    return np.asarray(0.4 * rig.torque * np.sum(waves, axis=0))


def measured(rig: Rig, true: Model, inputs: Mapping[str, Array]) -> dict[str, Array]:
    times = rig.step * np.arange(SAMPLES)
    found = sm.simulate(true, times, inputs)
    return {name: np.asarray(found[name]) for name in rig.outputs}


def drawn(number: int, seed: int) -> Case:
    """Case ``number`` of ``seed``: causes and rigs take turns, everything else is drawn."""
    random = np.random.default_rng([seed, number])
    cause, rig = CAUSES[number % len(CAUSES)], RIGS[number // len(CAUSES) % len(RIGS)]
    nominal = rig.nominal
    off = {
        name: nominal.values[name] * (1.0 + share * random.uniform(-1.0, 1.0))
        for name, share in rig.uncertainty.items()
    }
    true = sm.model(rig.actuator, rig.variant, off)
    plain = commands(rig, random)
    load = load_of(rig, random) if cause == "load" else np.zeros(SAMPLES)
    size = rig.torque * random.uniform(0.2, 0.6) * random.choice([-1.0, 1.0])
    width = middle = 0.0
    free = {
        name: measured(rig, true, {rig.command: c, "load_torque": load})
        for name, c in plain.items()
    }
    acting, bent, pushed = true, plain, load
    if cause in ("quadratic", "asymmetric"):
        size = abs(size)  # a drag takes energy
        acting = _lawful(true, cause, {"law.size": size, "law.scale": rig.speed})
    elif cause == "position":
        low, high = (float(f(free["sines"][rig.outputs[0]])) for f in (np.min, np.max))
        middle, width = random.uniform(low, high), random.uniform(0.15, 0.3) * (high - low)
        acting = _lawful(true, cause, {"law.size": size, "law.middle": middle, "law.width": width})
    elif cause == "load":
        pushed = load + size * load * np.abs(load) / rig.torque**2
    elif cause == "kink":
        size = random.uniform(0.1, 0.4) * random.choice([-1.0, 1.0])
        middle = rig.rest + rig.amplitude * random.uniform(-0.3, 0.3)
        bent = {n: c + size * np.maximum(c - middle, 0.0) for n, c in plain.items()}
        start = size * max(rig.rest - middle, 0.0)
        bent = {n: c - start for n, c in bent.items()}  # a log begins at rest
    logs, noise = dict[str, dict[str, Array]](), dict[str, float]()
    whole = {n: measured(rig, acting, {rig.command: bent[n], "load_torque": pushed}) for n in plain}
    ratio = math.exp(random.uniform(*np.log(GAP_OVER_FLOOR)))
    for output in rig.outputs:
        gap = np.concatenate([whole[n][output] - free[n][output] for n in plain])
        span = np.ptp(np.concatenate([free[n][output] for n in plain]))
        noise[output] = float(np.sqrt(np.mean(gap**2))) / ratio if cause != "none" else 2e-3 * span
    times: Array = rig.step * np.arange(float(SAMPLES))
    for name, command in plain.items():
        scattered = {
            o: v + noise[o] * random.standard_normal(SAMPLES) for o, v in whole[name].items()
        }
        logs[name] = {"t": times, rig.command: command, "load_torque": load, **scattered}
    return Case(cause, rig, size, middle, width, logs, noise)


def _lawful(true: Model, cause: str, values: Mapping[str, float]) -> Model:
    """The true actuator with a law more."""
    plant = with_law(true.plant, LAWS[cause])
    variant = replace(true.actuator.variant(true.variant), plant=plant)
    actuator = replace(true.actuator, name=f"true_{cause}", variants=(variant,), plant=plant)
    return sm.model(actuator, true.variant, {**true.values, **values})


def diagnosed(case: Case) -> Diagnosis:
    rig = case.rig
    columns = {"time": "t", **{n: n for n in (rig.command, "load_torque", *rig.outputs)}}
    uncertainty = {name: f"{100.0 * share:g} %" for name, share in rig.uncertainty.items()}
    return sm.diagnose(
        sm.describe(rig.nominal, case.logs, columns, uncertainty=uncertainty), jobs=1
    )


def row_of(number: int, seed: int) -> dict[str, object]:
    case = drawn(number, seed)
    found = diagnosed(case)
    learnt, before = found.residual_map, found.selection.taken.evidence.rms
    floor = math.sqrt(np.mean([(case.noise[o] / found.floors[o]) ** 2 for o in case.rig.outputs]))
    row: dict[str, object] = {
        "number": number,
        "cause": case.cause,
        "rig": case.rig.actuator,
        "verdict": found.verdict.kind,
        "named": list(found.selection.taken.effects),
        "before": before,
        "noise": floor,
        "after": learnt.after if learnt else None,
        "map": [learnt.size, *(c.regressor for c in learnt.curves)] if learnt else None,
        "text": learnt.sentence if learnt else "",
        "closed": (before**2 - learnt.after**2) / (before**2 - floor**2) if learnt else 0.0,
    }
    if case.cause != "none":
        row |= distances(case, learnt)
    return row


def distances(case: Case, learnt: ResidualMap | None) -> dict[str, float]:
    """RMS distance of the curve from the truth over its range: alone, with named, beside a line."""
    of = OF[case.cause]
    curve = next((c for c in learnt.curves if c.regressor == of), None) if learnt else None
    if learnt is None or curve is None:
        return dict.fromkeys(("distance", "with_named", "beside_line"), math.inf)
    acts_on, points = "load_torque", curve.knots
    if case.cause == "kink":  # the curve may be of what the command asks for, in another unit
        acts_on, points = case.rig.command, np.linspace(*reach_of(case, case.rig.command), KNOTS)
    truth = case.truth(points) * same_at_rest(case.rig, acts_on, learnt)
    weights = np.sqrt(curve.samples)
    whole = float(np.ptp(truth[curve.samples > 0]))

    def rms(values: Array) -> float:
        values = values - np.average(values, weights=weights**2)
        return float(np.sqrt(np.average(values**2, weights=weights**2))) / whole

    def beside(values: Array) -> Array:
        line = np.column_stack([np.ones(len(values)), curve.knots])
        found = np.linalg.lstsq(line * weights[:, None], values * weights, rcond=None)[0]
        return np.asarray(values - line @ found)

    alone = curve.values - truth
    together = alone + named(case.rig, learnt, curve)
    return {
        "distance": rms(alone),
        "with_named": rms(together),
        "beside_line": rms(beside(together)),
    }


def reach_of(case: Case, signal: str) -> tuple[float, float]:
    """Least and largest value [SI] of a signal in the logs."""
    values = np.concatenate([log[signal] for log in case.logs.values()])
    return float(values.min()), float(values.max())


def named(rig: Rig, learnt: ResidualMap, curve: Curve) -> Array:
    """What named effects add to the wire of the map, as functions of what its curve is of [SI]."""
    plant, values = rig.nominal.plant, {**rig.nominal.values, **learnt.values}
    of = {curve.wire, *WIRES[curve.regressor]}
    given_to = {learnt.wire, *of & {wire.name for wire in plant.inputs}}
    total = np.zeros(len(curve.knots))
    for link in plant.chain:
        if not isinstance(link, Placement) or link.name not in learnt.fitted.effects:
            continue
        effect, (first, *others) = link.effect, map(link.wire_of, link.effect.wires)
        if effect.memory or not of.issuperset(others) or first not in given_to:
            continue
        given = {name: values[f"{link.name}.{name}"] for name in effect.params}
        base = curve.knots if first in of else np.zeros(len(curve.knots))
        added = [effect(u, *[x] * len(others), **given) - u for u, x in zip(base, curve.knots)]
        total += np.array(added) * (
            1.0 if first == learnt.wire else same_at_rest(rig, first, learnt)
        )
    return total


def same_at_rest(rig: Rig, input_: str, learnt: ResidualMap) -> float:
    """What the map has to add to its wire to move the output as far as 1 of an input does [SI]."""

    def reached(values: Mapping[str, float], added: float) -> float:
        held = {rig.command: rig.rest, "load_torque": 0.0}
        held[input_] += added
        inputs = {name: np.full(SAMPLES, value) for name, value in held.items()}
        return float(
            measured(rig, sm.model(rig.actuator, rig.variant, values), inputs)[rig.outputs[0]][-1]
        )

    def pushed(level: float) -> dict[str, float]:
        knots = {f"{learnt.name}.command_knot_{k + 1}": level for k in range(KNOTS)}
        return {size: unit, f"{learnt.name}.command": 1.0, **knots}

    size = f"{learnt.name}.{learnt.size}"
    unit = 0.01 * rig.nominal.plant.parameters[size].param.high
    small = 0.1 * (rig.amplitude if input_ == rig.command else rig.torque)
    by_input = (reached({}, small) - reached({}, -small)) / (2.0 * small)
    return by_input * 2.0 * unit / (reached(pushed(1.0), 0.0) - reached(pushed(-1.0), 0.0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=120)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--every", type=int, default=1, help="cases that are left out between two")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="a row for each case (.jsonl)")
    options = parser.parse_args()
    rows = []
    for number in range(options.first, options.cases, options.every):
        rows.append(row_of(number, options.seed))
        print(rows[-1], flush=True)
        if options.out:
            with options.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(rows[-1]) + "\n")
    print(table([row for row in rows if row["verdict"] == "outside-catalogue"]))
    print(table(rows))


def table(rows: list[dict[str, object]]) -> str:
    """The shares by cause, with 95 % intervals."""
    tests: dict[str, Callable[[dict[str, object]], bool]] = {
        "outside": lambda r: r["verdict"] == "outside-catalogue",
        "map": lambda r: r["map"] is not None,
        "closed": lambda r: float(r["closed"]) >= CLOSED_BAR,  # type: ignore[arg-type]
        "distance": lambda r: float(r.get("distance", math.inf)) <= DISTANCE_BAR,  # type: ignore[arg-type]
        "with named": lambda r: float(r.get("with_named", math.inf)) <= DISTANCE_BAR,  # type: ignore[arg-type]
        "line": lambda r: float(r.get("beside_line", math.inf)) <= DISTANCE_BAR,  # type: ignore[arg-type]
    }
    lines = ["| cause | cases | " + " | ".join(tests) + " |", "|---|---|" + "---|" * len(tests)]
    for cause in (*CAUSES, ""):
        own = [r for r in rows if r["cause"] == cause or (not cause and r["cause"] != "none")]
        if own:
            cells = []
            for test in tests.values():
                found = share(map(test, own))
                cells.append(f"{found.value:.2f} ({found.low:.2f} to {found.high:.2f})")
            lines.append(
                f"| {cause or 'all that miss something'} | {len(own)} | " + " | ".join(cells) + " |"
            )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
