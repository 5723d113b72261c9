"""What a native FMU costs beside one written by hand in C; all ratios within one run.

The yardstick is ``hand_written.c``: the equations of an actuator without effects and nothing else,
compiled here with the compiler and flags of the native FMU, whose effects are all off.

Run: ``python benchmarks/bench_native.py`` (Linux with a C compiler, extra ``benchmark``; about a
minute).
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple

import fmpy
from bench_fmu import Instance

import servo_models as sm

HERE = Path(__file__).parent
FLAGS = ("-O2", "-ffp-contract=off", "-std=c99", "-fPIC", "-shared")
ROUNDS = 9
STEPS = 20_000
AGREEMENT = 1e-9  # of the summed outputs; with more it is another model, and no yardstick


class Cost(NamedTuple):
    """What ``step_time`` prints, by the units it prints in."""

    ns: float
    kb_each: float
    kb_growth: float
    summed: float


@dataclass(frozen=True)
class Subject:
    """An FMU that has been extracted, and the two values of its main input."""

    folder: str
    low: float
    high: float

    @cached_property
    def about(self) -> Any:
        return fmpy.read_model_description(self.folder)

    @property
    def library(self) -> Path:
        return next(Path(self.folder).glob("binaries/linux64/*.so"))

    def reals(self, causality: str) -> list[Any]:
        every = self.about.modelVariables
        return [v for v in every if v.causality == causality and v.type == "Real"]

    def in_c(
        self, host: Path, size: float, steps: int = STEPS, instances: int = 1, repeats: int = 5
    ) -> Cost:
        """Step it from the C host, the main input between rest and its standard step."""
        inputs, outputs = self.reals("input"), self.reals("output")
        listed = [",".join(str(v.valueReference) for v in of) for of in (inputs, outputs)]
        run = [self.about.guid, instances, steps, repeats, size, self.low, self.high, *listed]
        command = list(map(str, [host, self.library, *run]))
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        return Cost(*map(float, done.stdout.split()))


def compiled(source: Path, target: Path, *flags: str) -> Path:
    """Compile one C file against fmpy's copy of the FMI headers and return ``target``."""
    headers = Path(fmpy.__file__).parent / "c-code"
    files = ["-I", headers, source, "-o", target, "-lm", "-ldl"]
    subprocess.run(["cc", *flags, *map(str, files)], check=True)
    return target


def effects_off(name: str) -> sm.Model:
    """The default variant of an actuator with every switch at 0."""
    parameters = sm.model(name).plant.parameters.items()
    return sm.model(name, parameters={name: 0.0 for name, p in parameters if p.param.switch})


def hand_written(other: Subject, name: str, work: Path) -> Subject:
    """A copy of an FMU with the yardstick for its binary: the same description and references."""
    made = replace(other, folder=shutil.copytree(other.folder, work / f"{name}_by_hand"))
    equations = f'-DMODEL="hand_written_{name}.h"'
    compiled(HERE / "hand_written.c", made.library, *FLAGS, equations)
    return made


def fmpy_step(instance: Instance, values: list[float], size: float) -> float:
    """Seconds for a set + step + get through fmpy, mean of STEPS / 10."""
    fmu, now = instance.fmu, instance.time
    begin = time.perf_counter()
    for _ in range(STEPS // 10):
        fmu.setReal(instance.inputs, values)
        fmu.doStep(now, size)
        fmu.getReal(instance.reals)
        now += size
    instance.time = now
    return (time.perf_counter() - begin) * 10 / STEPS


def best(calls: dict[str, Callable[[], float]]) -> dict[str, float]:
    """Least of each call, taken in turn so that a slow moment hits all of them."""
    found = dict.fromkeys(calls, float("inf"))
    for _ in range(ROUNDS):
        for name, call in calls.items():
            found[name] = min(found[name], call())
    return found


def rows(head: str, seconds: dict[str, float]) -> None:
    """Print times beside the first of them."""
    print(f"\n{head:40}{'us':>9}{'ratio':>8}")
    yardstick = next(iter(seconds.values()))
    for name, spent in seconds.items():
        print(f"{name:40}{spent * 1e6:9.3f}{spent / yardstick:8.2f}")


def steps_in_c(host: Path, name: str, subjects: dict[str, Subject], size: float) -> None:
    """Print the cost of a step in a C host."""
    summed = {how: subject.in_c(host, size).summed for how, subject in subjects.items()}
    least, most = min(summed.values()), max(summed.values())
    assert most - least <= AGREEMENT * abs(most), summed
    calls = {how: partial(seconds_in_c, subject, host, size) for how, subject in subjects.items()}
    rows(f"C host: {name}, step of {size * 1e3:g} ms", best(calls))


def seconds_in_c(subject: Subject, host: Path, size: float) -> float:
    return 1e-9 * subject.in_c(host, size).ns


def steps_in_fmpy(name: str, subjects: dict[str, Subject], size: float) -> None:
    """Print the cost of a step through fmpy."""
    made = {how: Instance(subject.folder) for how, subject in subjects.items()}
    values = [float(v.start) for v in next(iter(subjects.values())).reals("input")]
    calls = {how: partial(fmpy_step, instance, values, size) for how, instance in made.items()}
    rows(f"fmpy: {name}, step of {size * 1e3:g} ms", best(calls))
    for instance in made.values():
        instance.free()


def many(host: Path, subjects: dict[str, Subject]) -> None:
    """Print what a thousand instances cost, each stepped 10 000 times."""
    print(f"\n{'1000 instances, 10 000 steps each':40}{'us':>9}{'kB each':>9}{'growth kB':>11}")
    for how, subject in subjects.items():
        cost = subject.in_c(host, 1e-3, steps=1000, instances=1000, repeats=10)
        print(f"{how:40}{cost.ns / 1e3:9.3f}{cost.kb_each:9.1f}{cost.kb_growth:11.0f}")


def main() -> None:
    work = Path(tempfile.mkdtemp())
    host = compiled(HERE / "step_time.c", work / "step_time", "-O2", "-std=c99")
    for name, sizes in (("torque_motor", (1e-3, 1e-4)), ("sg90", (1e-3,))):
        chosen = effects_off(name)
        swing = chosen.plant.inputs[0].rest, chosen.actuator.step[1]
        python = Subject(fmpy.extract(str(sm.build(chosen, work / f"{name}.fmu"))), *swing)
        in_c = {"by hand": hand_written(python, name, work)}
        for size in sizes:
            steps_in_c(host, name, in_c, size)
        steps_in_fmpy(name, {**in_c, "Python FMU": python}, 1e-3)
        many(host, in_c)
    shutil.rmtree(work)


if __name__ == "__main__":
    main()
