"""FMUs of every kind = simulation, to the last bit: every effect, and random sets of them.

    python tests/fuzz/equality.py [--sets 500] [--seed 0] [ACTUATOR ...]

For every actuator, and every variant with other equations: each effect alone, and random sets of
effects and parameters (``parameters.vector``).  Inputs jump at random over their range, and
communication steps vary from a tenth to twelve internal steps.  In mid-run each FMU is saved as
bytes, and another instance goes on from them.  Some of the native runs are repeated in four threads
at once.  What one of them refuses, all have to refuse.  Exit code 1: something differs.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from threading import Lock

sys.path.insert(0, str(Path(__file__).parents[2]))

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException

from servo_models.build import FMI3, NATIVE, PYTHON, build
from servo_models.core.catalogue import actuators
from servo_models.core.simulate import Model, model
from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.validation.runner import every_model
from tests.fuzz.parameters import drawn, vector
from tests.support.fmu_host import Host

STEPS = 60  # communication steps of a run
THREADS = 4
LOADING = Lock()  # fmpy changes the working directory while it loads a library


@dataclass(frozen=True)
class Run:
    """One experiment: a model at its parameters, times [s], inputs [SI], the row of the restore."""

    chosen: Model
    times: Array
    inputs: Array
    cut: int

    def simulated(self) -> Array | None:
        try:
            return self.chosen.run(self.times, self.inputs)
        except UserError:
            return None

    def by(self, folder: Path) -> Array | None:
        """Outputs of an FMU; None where it refuses."""
        with LOADING:
            hosts = Host(folder), Host(folder)
        with hosts[0] as one, hosts[1] as other:
            try:
                first = one.simulate(
                    self.times[: self.cut + 1], self.inputs[: self.cut + 1], self.chosen.values
                )
                state = one.fmu.getFMUstate()
                content = one.fmu.serializeFMUstate(state)
                one.fmu.freeFMUstate(state)
                again = other.fmu.deSerializeFMUstate(content)
                other.fmu.setFMUstate(again)
                other.fmu.freeFMUstate(again)
                rest = other.run(self.times[self.cut :], self.inputs[self.cut :])
            except FMICallException:
                return None
        return np.vstack([first, rest[1:]])


def random_run(chosen: Model, rng: np.random.Generator) -> Run:
    internal_step = min(chosen.values["internal_step"], chosen.step_size)
    times = np.cumsum([0.0, *(internal_step * rng.uniform(0.1, 12.0, STEPS))])
    columns = []
    for wire in chosen.plant.inputs:
        low = float(wire.rest) - wire.scale if wire.low is None else wire.low
        high = float(wire.rest) + wire.scale if wire.high is None else wire.high
        levels = rng.uniform(low, high, len(times) // 5 + 1)
        columns.append(np.repeat(levels, 5)[: len(times)])
    return Run(chosen, times, np.column_stack(columns), int(rng.integers(1, STEPS)))


def models(base: Model, sets: int, rng: np.random.Generator) -> Iterator[tuple[str, Model]]:
    """Each effect alone, then random sets of effects and parameters."""
    parameters = base.plant.parameters
    text_names = {name.replace(".", "__"): name for name in parameters}
    for effect, switches in base.flat.switches.items():
        on = {text_names[name]: drawn(parameters[text_names[name]].param, rng) for name in switches}
        yield f"{effect} alone", model(base.actuator, base.variant, on)
    for _ in range(sets):
        changes = vector(base, rng)
        yield f"{changes}", model(base.actuator, base.variant, changes)
        # the native FMU has a second text for the effects that it was built with
        kept = {name: v for name, v in changes.items() if not parameters[name].param.switch}
        yield f"{kept}, effects as built", model(base.actuator, base.variant, kept)


def same(one: Array | None, other: Array | None) -> bool:
    if one is None or other is None:
        return one is other
    return np.array_equal(one, other)


def examined(
    base: Model, folders: dict[str, Path], sets: int, seed: int
) -> tuple[Counter[str], list[str]]:
    """Outcomes of all runs of one model, and what differs."""
    rng = np.random.default_rng(seed)
    counts: Counter[str] = Counter()
    wrong: list[str] = []
    runs: list[tuple[Run, Array | None]] = []
    for name, chosen in models(base, sets, rng):
        run = random_run(chosen, rng)
        expected = run.simulated()
        got = {kind: run.by(folder) for kind, folder in folders.items()}
        runs.append((run, got[NATIVE]))
        counts["refused" if got[NATIVE] is None else "run"] += 1
        wrong += [
            f"{base.actuator.name}, {name}: {kind} differs from the simulation"
            for kind, rows in got.items()
            if not same(expected, rows)
        ]
    with ThreadPoolExecutor(THREADS) as pool:
        again = pool.map(lambda it: it[0].by(folders[NATIVE]), runs[:: len(runs) // 40 or 1])
        for (run, alone), beside in zip(runs[:: len(runs) // 40 or 1], again):
            counts["in threads"] += 1
            if not same(alone, beside):
                wrong.append(f"{base.actuator.name}, {run.chosen.values}: differs in threads")
    return counts, wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--sets", type=int, default=500, help="random sets for each model")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("actuators", nargs="*", default=list(actuators()))
    given = parser.parse_args()
    wrong: list[str] = []
    for base in every_model():
        if base.actuator.name not in given.actuators:
            continue
        with tempfile.TemporaryDirectory() as scratch:
            folders = {kind: Path(scratch) / kind for kind in (PYTHON, NATIVE, FMI3)}
            for kind, folder in folders.items():
                fmpy.extract(str(build(base, Path(scratch) / f"{kind}.fmu", kind)), str(folder))
            counts, found = examined(base, folders, given.sets, given.seed)
        name = f"{base.actuator.name} {base.variant}"
        print(
            f"{name:24} {len(base.flat.switches)} effects alone, {given.sets} random sets:"
            f" {counts['run']} run, {counts['refused']} refused by all,"
            f" {counts['in threads']} again in threads, {len(found)} different",
            flush=True,
        )
        wrong += found
    print(*wrong[:20], sep="\n", end="\n" if wrong else "")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
