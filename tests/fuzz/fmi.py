"""Random sequences of legal and illegal FMI calls against a model of the FMI state machine.

    python tests/fuzz/fmi.py [--sequences 100000] [--states 5000] [--seed 0]
                             [--kind python|native|fmi3] [ACTUATOR ...]

Every call has an expected outcome: it succeeds with the numbers of the printed text, to the last
bit, or it is refused.  Batches run in processes of their own, so a crash or a hang is counted
and the sequence named.  ``tests/fmu/test_fuzz_fmi.py`` runs a share.  Handles that are freed
already, NULL states and wrong GUIDs never reach the slave and are left out.
"""

from __future__ import annotations

import argparse
import copy
import math
import multiprocessing
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException

from fmu_src.variables import variables
from servo_models.build import FMI3, NATIVE, PYTHON, build
from servo_models.catalogue import actuators, model
from servo_models.core.compiled import plain_make
from servo_models.core.simulate import Model
from servo_models.core.stepper import step_text
from tests.support.fmu_host import Host

BATCH = 200  # sequences in a process
PATIENCE = 120.0  # seconds for a batch, which takes one or two
CALLS = 30  # calls of a sequence at most
FRESH = 20  # sequences after which the instance is new; before that it is reset
CHANGED = 4
"""Parameters that a sequence may change: no switches, since an effect that wakes begins at rest."""
SLACK = 1e-9  # of a master's clock, relative
MOST_SUB_STEPS = 1_000_000


class Refused(Exception):  # noqa: N818
    """The call is to fail, and everything after it but a reset or a restored state."""


class Expected:
    """What an instance is to answer: the state machine of FMI 2.0, on the printed text.

    All effects are in this text; the one in the FMU has dropped those that are off.
    """

    def __init__(self, chosen: Model) -> None:
        self.variables = variables(chosen)
        self.inputs = len(chosen.plant.inputs)
        self.first = self.inputs + len(chosen.plant.outputs)
        self.make = plain_make(step_text(chosen.flat, set()))
        self.step_at = self.first + list(chosen.values).index("internal_step")
        self.reset()

    def reset(self) -> None:
        self.now: dict[str, Any] = {
            "values": [v.start or 0.0 for v in self.variables],
            "phase": "instantiated",
            "failed": False,
            "begins": 0.0,
            "last": math.inf,
            "time": math.nan,
            "x": None,
        }

    def fail(self) -> None:
        self.now["failed"] = True
        raise Refused

    def only(self, phase: str) -> None:
        if self.now["failed"]:
            raise Refused
        if self.now["phase"] != phase:
            self.fail()

    def setup(self, start: float, stop: float | None) -> None:
        self.only("instantiated")
        if not math.isfinite(start) or (stop is not None and not stop >= start):
            self.fail()
        self.now["begins"] = start
        self.now["last"] = math.inf if stop is None else stop + SLACK * (1.0 + abs(stop))

    def enter(self) -> None:
        self.only("instantiated")
        self.now["phase"] = "initialising"

    def look(self) -> None:
        """Outputs at the start."""
        values = self.now["values"]
        start, step = self.make(values[self.first :])
        self.now["x"] = start()
        code, outputs = step(start(), values[: self.inputs], self.now["begins"], 0.0)
        assert code == 0
        values[self.inputs : self.first] = outputs

    def leave(self) -> None:
        self.only("initialising")
        self.look()
        self.now["phase"], self.now["time"] = "running", self.now["begins"]

    def step(self, time: float, size: float) -> None:
        self.only("running")
        now, values = self.now, self.now["values"]
        follows = abs(time - now["time"]) <= SLACK * (1.0 + abs(time))
        longest = MOST_SUB_STEPS * values[self.step_at]
        if not (follows and 0.0 < size <= longest and time + size <= now["last"]):
            self.fail()
        _, step = self.make(values[self.first :])
        code, outputs = step(now["x"], values[: self.inputs], time, size)
        assert code == 0
        values[self.inputs : self.first] = outputs
        now["time"] = time + size

    def set(self, references: list[int], numbers: list[float]) -> None:
        if self.now["failed"]:
            raise Refused
        if self.now["phase"] == "terminated":
            self.fail()
        for reference, number in zip(references, numbers):
            if reference >= len(self.variables) or self.inputs <= reference < self.first:
                self.fail()
            about = self.variables[reference]
            low = -math.inf if about.low is None else about.low
            high = math.inf if about.high is None else about.high
            if not (math.isfinite(number) and low <= number <= high):
                self.fail()
            if about.fixed and self.now["phase"] == "running":
                self.fail()
        for reference, number in zip(references, numbers):
            self.now["values"][reference] = number

    def get(self, references: list[int], flags: bool) -> list[float]:
        if self.now["failed"]:
            raise Refused
        for reference in references:
            known = reference < len(self.variables)
            if not known or self.variables[reference].flag is not flags:
                self.fail()
        if self.now["phase"] in ("instantiated", "initialising"):
            self.look()
        return [self.now["values"][reference] for reference in references]

    def no_such_type(self) -> None:
        self.fail()

    def terminate(self) -> None:
        if not self.now["failed"]:
            self.only("running")
            self.now["phase"] = "terminated"


class Expected3(Expected):
    """FMI 3.0: start and stop come with the call that enters initialisation; time is a variable.

    Until then the host keeps them; see ``fmu_host.Calls3``.
    """

    def reset(self) -> None:
        super().reset()
        self.setup(0.0, None)

    def setup(self, start: float, stop: float | None) -> None:
        self.experiment = start, stop

    def enter(self) -> None:
        super().setup(*self.experiment)
        super().enter()

    def get(self, references: list[int], flags: bool) -> list[float]:
        time = len(self.variables)
        found = iter(super().get([i for i in references if i != time or flags], flags))
        begun = self.now["phase"] in ("running", "terminated")
        reached = self.now["time" if begun else "begins"]
        return [reached if i == time else next(found) for i in references]


class Sequence:
    """One random sequence on an instance: ``play`` raises AssertionError where it differs."""

    def __init__(self, chosen: Model, expected: Expected, host: Host, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.host, self.fmu = host, host.fmu
        self.expected = expected
        expected.reset()
        self.saved: list[tuple[Any, dict[str, Any]]] = []
        self.internal_step = chosen.values["internal_step"]
        params = [i for i, v in enumerate(self.expected.variables) if v.causality == "parameter"]
        switches = {p.name for p in chosen.plant.parameters.values() if p.param.switch}
        usual = [
            i
            for i in params
            if "." not in self.expected.variables[i].name
            and self.expected.variables[i].name not in switches
            and not self.expected.variables[i].fixed
        ]
        self.usual = list(self.rng.permutation(usual)[:CHANGED]) if usual else []

    def both(self, call: Callable[[], Any], expected: Callable[[], Any]) -> None:
        """Make a call, and compare its outcome with the expected one."""
        try:
            wanted, refused = expected(), False
        except Refused:
            wanted, refused = None, True
        try:
            got, failed = call(), False
        except FMICallException:
            got, failed = None, True
        assert failed is refused, f"refused: {failed}, expected: {refused}"
        if wanted is not None:
            assert got == wanted, f"{got} instead of {wanted}"

    def play(self) -> None:
        names = [name for name in dir(self) if name.startswith("do_")]
        weights = np.array([10.0 if name.endswith("step") else 1.0 for name in names])
        if self.rng.random() < 0.8:  # most sequences begin well
            self.do_setup(sane=True)
            self.do_enter()
            if self.rng.random() < 0.5:
                self.do_set()
            self.do_leave()
        for _ in range(int(self.rng.integers(1, CALLS))):
            getattr(self, str(self.rng.choice(names, p=weights / weights.sum())))()
        for state, _ in self.saved:
            self.fmu.freeFMUstate(state)

    def do_setup(self, sane: bool = False) -> None:
        start = 0.0 if sane else float(self.rng.choice([0.0, 1.5, -2.0, math.nan, math.inf]))
        stops = [None, start + 100.0 * self.internal_step, start - 1.0, math.nan]
        stop = stops[0 if sane else int(self.rng.integers(4))]
        self.both(
            lambda: self.fmu.setupExperiment(startTime=start, stopTime=stop),
            lambda: self.expected.setup(start, stop),
        )

    def do_enter(self) -> None:
        self.both(self.fmu.enterInitializationMode, self.expected.enter)

    def do_leave(self) -> None:
        self.both(self.fmu.exitInitializationMode, self.expected.leave)

    def do_step(self) -> None:
        now = self.expected.now["time"]
        time = 0.0 if math.isnan(now) else now
        size = float(self.internal_step * self.rng.uniform(0.1, 12.0))
        if self.rng.random() < 0.03:
            time += float(self.rng.choice([1.0, -1e-3, math.nan]))
        if self.rng.random() < 0.03:
            size = float(self.rng.choice([0.0, -1e-3, math.nan, math.inf, 1e9, 1e300]))
        self.both(lambda: self.fmu.doStep(time, size), lambda: self.expected.step(time, size))

    def do_set(self) -> None:
        known = self.expected.variables
        references = [int(i) for i in [*range(self.expected.inputs), *self.usual]]
        references = [i for i in references if self.rng.random() < 0.6]
        numbers = []
        for reference in references:
            about = known[reference]
            low = -1e3 if about.low is None else about.low
            high = 1e3 if about.high is None else about.high
            middle = about.start or 0.0
            width = 0.1 * (abs(middle) if about.causality == "parameter" else about.nominal)
            number = middle + width * self.rng.uniform(-1.0, 1.0)
            numbers.append(float(min(max(number, low), high)))
        if references and self.rng.random() < 0.1:
            k = int(self.rng.integers(len(references)))
            if self.rng.random() < 0.5:
                numbers[k] = float(self.rng.choice([math.nan, math.inf, -math.inf, 1e300, -1e300]))
            else:
                outputs = range(self.expected.inputs, self.expected.first)
                others = [*outputs, len(known), 2**31, 2**32 - 1, self.expected.step_at]
                references[k] = int(self.rng.choice(others))
        self.both(
            lambda: self.fmu.setReal(references, numbers),
            lambda: self.expected.set(references, numbers),
        )

    def do_get(self) -> None:
        size = len(self.expected.variables)
        references = [int(i) for i in self.rng.integers(size, size=int(self.rng.integers(1, 8)))]
        flags = bool(self.rng.random() < 0.1)
        if self.rng.random() < 0.9:
            references = [i for i in references if self.expected.variables[i].flag is flags]
        if self.rng.random() < 0.05:
            references.append(int(self.rng.choice([size, 2**31, 2**32 - 1])))
        call = self.fmu.getBoolean if flags else self.fmu.getReal
        self.both(
            lambda: [float(value) for value in call(references)],
            lambda: self.expected.get(references, flags),
        )

    def do_get_nothing_there(self) -> None:
        if self.rng.random() < 0.2:
            call = self.rng.choice([self.fmu.getInteger, self.fmu.getString])
            self.both(lambda: call([0]), self.expected.no_such_type)

    def do_terminate(self) -> None:
        if self.rng.random() < 0.2:
            self.both(self.fmu.terminate, self.expected.terminate)

    def do_reset(self) -> None:
        self.fmu.reset()
        self.expected.reset()

    def do_save(self) -> None:
        state = self.fmu.getFMUstate()
        if self.rng.random() < 0.5:
            content = self.fmu.serializeFMUstate(state)
            self.fmu.freeFMUstate(state)
            state = self.fmu.deSerializeFMUstate(content)
        self.saved.append((state, copy.deepcopy(self.expected.now)))

    def do_restore(self) -> None:
        if self.saved:
            state, now = self.saved[int(self.rng.integers(len(self.saved)))]
            self.fmu.setFMUstate(state)
            self.expected.now = copy.deepcopy(now)

    def do_restore_damaged(self) -> None:
        if self.rng.random() < 0.3:
            self.restore_damaged()

    def restore_damaged(self) -> None:
        state = self.fmu.getFMUstate()
        content = bytearray(self.fmu.serializeFMUstate(state))
        self.fmu.freeFMUstate(state)
        kind, at = self.rng.integers(4), int(self.rng.integers(len(content)))
        if kind == 0:
            content[at] ^= 1 << int(self.rng.integers(8))
        elif kind == 1:
            del content[at:]
        elif kind == 2:
            digits = [i for i, sign in enumerate(content) if chr(sign).isdigit()]
            at = int(self.rng.choice(digits))
            content[at] = ord("0") + (content[at] - ord("0") + int(self.rng.integers(1, 10))) % 10
        else:
            end = min(at + int(self.rng.integers(1, 50)), len(content))
            del content[at:end]
        self.both(lambda: self.restore(bytes(content)), self.expected.fail)

    def restore(self, content: bytes) -> None:
        """A Python FMU refuses damaged bytes as a state, a native one at once."""
        state = self.fmu.deSerializeFMUstate(content)
        try:
            self.fmu.setFMUstate(state)
        finally:
            self.fmu.freeFMUstate(state)


def batch(
    chosen: Model,
    folder: Path,
    seeds: range,
    damaged: bool,
    kind: str = PYTHON,
    told: Connection | None = None,
) -> list[str]:
    """Play sequences; of each that differs, what differs.  The seed at hand goes to ``told``."""
    wrong: list[str] = []
    host: Host | None = None
    expected = Expected3(chosen) if kind == FMI3 else Expected(chosen)
    for count, seed in enumerate(seeds):
        if told:
            told.send(seed)
        if host is None or count % FRESH == 0:
            if host:
                host.__exit__(None, None, None)
            host = Host(folder)
        else:
            host.fmu.reset()
        sequence = Sequence(chosen, expected, host, seed)
        try:
            if damaged:
                sequence.do_setup(sane=True)
                sequence.do_enter()
                sequence.do_leave()
                sequence.do_step()
                sequence.restore_damaged()
            else:
                sequence.play()
        except AssertionError as error:
            wrong.append(f"sequence {seed}: {error}")
            host.fmu.reset()
    if host:
        host.__exit__(None, None, None)
    return wrong


def _in_a_process(
    chosen: Model, folder: Path, seeds: range, damaged: bool, kind: str, told: Connection
) -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # the reasons of thousands of refusals
    told.send(batch(chosen, folder, seeds, damaged, kind, told))


def run(
    chosen: Model, folder: Path, sequences: range, damaged: bool, kind: str = PYTHON
) -> tuple[Counter[str], list[str]]:
    """Play sequences on an unpacked FMU in batches: counts by outcome, and what went wrong."""
    counts: Counter[str] = Counter()
    wrong: list[str] = []
    context = multiprocessing.get_context("fork")
    for first in range(sequences.start, sequences.stop, BATCH):
        seeds = range(first, min(first + BATCH, sequences.stop))
        here, there = context.Pipe(duplex=False)
        process = context.Process(
            target=_in_a_process, args=(chosen, folder, seeds, damaged, kind, there)
        )
        process.start()
        there.close()
        found: Any = first
        try:
            while not isinstance(found, list) and here.poll(PATIENCE):
                found = here.recv()
        except EOFError:
            counts["crashes"] += 1
            wrong.append(f"sequence {found}: the process ended")
        else:
            if isinstance(found, list):
                counts["differences"] += len(found)
                wrong += found
            else:
                counts["hangs"] += 1
                wrong.append(f"sequence {found}: no answer")
        process.kill()
        process.join()
        counts["played"] += len(seeds)
    return counts, wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sequences", type=int, default=100_000)
    parser.add_argument("--states", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", choices=(PYTHON, NATIVE, FMI3), default=PYTHON)
    parser.add_argument("actuators", nargs="*", default=list(actuators()))
    chosen = parser.parse_args()
    failed = False
    for actuator in chosen.actuators:
        with tempfile.TemporaryDirectory() as scratch:
            path = build(model(actuator), Path(scratch) / "it.fmu", chosen.kind)
            folder = Path(fmpy.extract(str(path), str(Path(scratch) / "fmu")))
            for what, count in (("sequences", chosen.sequences), ("damaged states", chosen.states)):
                seeds = range(chosen.seed, chosen.seed + count)
                damaged = what != "sequences"
                counts, wrong = run(model(actuator), folder, seeds, damaged, chosen.kind)
                told = ", ".join(f"{counts[k]} {k}" for k in ("crashes", "hangs", "differences"))
                print(f"{actuator}: {counts['played']} {what}: {told}", flush=True)
                print(*wrong[:10], sep="\n", end="\n" if wrong else "")
                failed = failed or bool(wrong)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
