"""Commands that are killed while they write, and caches that are damaged.

    python tests/fuzz/kills.py [--kills 20] [--caches 500] [--seed 0] [--only COMMAND ...]

A forked process runs a command and is killed at one of the moments at which it opens, moves or
removes a file of its outputs, its cache or its temporary folder: at once, or up to 3 ms later.
Outputs then are missing, as they were before, or whole; the command run again ends as it does
undisturbed, with the same outputs; and no leftover, temporary folder or process stays.  A survey
goes on where it was, so it is killed again and again until it is done: what was kept stays as it
was, and at the end each job is there once.  ``tests/test_cache.py`` runs a share.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import json
import math
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import islice, repeat
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # its threads would not outlive a fork

import numpy as np

from servo_models.cli import main as servo_models

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.support.own_actuators import SOURCE

EARLIEST_SECONDS, LATEST_SECONDS = 1e-5, 3e-3
"""Delay of a kill after its moment."""
PATIENCE_SECONDS = 300
PEACE_SECONDS = 10.0  # in which processes that a killed one has begun end
CRASHED, REFUSED = 70, 2
MOMENTS = ("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.chmod", "shutil.rmtree")
"""Events of Python's audit table that change folders; ``open`` counts where it writes."""
PR_SET_CHILD_SUBREAPER = 36
OLD = b"what stood here before"
PARAMETERS = """
actuator = "joint.py"
variant = "plain"
[parameters.time_constant]
value = 0.3
unit = "s"
"""
DESCRIPTION = """
actuator = "torque_motor"
variant = "identified"
parameters.transport_delay.time = 0
[uncertainty]
torque_constant = "5 %"
[[logs]]
file = "log.csv"
time = { column = "t", unit = "s" }
inputs.voltage = { column = "u", unit = "V" }
outputs.angle = { column = "angle", unit = "deg" }
"""


UNITS = 12  # of a survey


class Command(NamedTuple):
    """A command line and what it writes; ``cold`` ones begin with an empty cache."""

    words: tuple[str, ...]
    outputs: tuple[str, ...] = ()
    cold: bool = False
    replaces: bool = True
    """Whether it writes over what is there; the others refuse."""
    keeps: str = ""
    """Pattern of the files with which it goes on where it was."""


COMMANDS = {
    "simulate": Command(
        ("simulate", "torque_motor", "--out", "a.csv", "--plot", "a.svg"), ("a.csv", "a.svg")
    ),
    "simulate, cold": Command(
        ("simulate", "--params", "joint.toml", "--out", "a.parquet"), ("a.parquet",), True
    ),
    "build": Command(("build", "torque_motor", "--out", "."), ("torque_motor.fmu",)),
    "figures": Command(("figures", "linear_drive", "--out", "f.json"), ("f.json",)),
    "explain": Command(("explain", "torque_motor", "--picture", "e.svg"), ("e.svg",)),
    "validate": Command(
        ("validate", "valid.fmu", "--report", "v.html", "--junit", "v.xml"), ("v.html", "v.xml")
    ),
    "check": Command(
        ("check", "log.csv", "--init", "--actuator", "torque_motor", "--out", "new.toml"),
        ("new.toml",),
        replaces=False,
    ),
    "identify": Command(
        ("identify", "rig.toml", "--out", "p.toml", "--report", "i.html"), ("p.toml", "i.html")
    ),
    "diagnose": Command(
        ("diagnose", "rig.toml", "--out", "p.toml", "--json", "d.json", "--report", "d.html"),
        ("p.toml", "d.json", "d.html"),
    ),
    "blind": Command(
        ("blind", "--cases", "2", "--seed", "3", "--folder", "runs", "--json", "b.json"),
        ("b.json",),
    ),
    "survey": Command(
        ("survey", "fleet", "--no-reports", "--jobs", "1", "--out", "found"),
        ("found/survey.json", "found/index.html"),
        keeps="found/jobs/*.json",
    ),
}


class Watch:
    """Counts moments of writing, and kills the process at one of them."""

    def __init__(self, places: tuple[Path, ...], at: int, delay: float) -> None:
        self.places, self.at, self.delay = tuple(map(str, places)), at, delay
        self.seen = 0
        if delay:  # an alarm ends the process, whatever it is doing
            signal.signal(signal.SIGALRM, signal.SIG_DFL)

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event != "open" and event not in MOMENTS:
            return
        path, *rest = arguments
        if event == "open" and not (
            isinstance(rest[1], int) and rest[1] & (os.O_WRONLY | os.O_RDWR)
        ):
            return
        if not isinstance(path, (str, bytes, os.PathLike)):
            return
        if not os.path.abspath(os.fsdecode(path)).startswith(self.places):
            return
        self.seen += 1
        if self.seen == self.at:
            if self.delay:
                signal.setitimer(signal.ITIMER_REAL, self.delay)
            else:
                os.kill(os.getpid(), signal.SIGKILL)


class Place(NamedTuple):
    """Folders of a case: its own, which is where outputs go, its cache, temporary files."""

    work: Path
    cache: Path
    temporary: Path


class Ended(NamedTuple):
    """How a run ended: its exit code, or minus the signal; what it printed; moments of writing."""

    code: int
    said: str
    moments: int


def run(words: tuple[str, ...], place: Place, at: int = 0, delay: float = 0.0) -> Ended:
    """Run a command in a forked process, killed at moment ``at`` where that is not 0."""
    sink, count = place.work.parent / "said", place.work.parent / "count"
    count.unlink(missing_ok=True)
    child = os.fork()
    if not child:
        _child(words, place, Watch(tuple(place), at, delay), sink, count)
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    moments = int(count.read_text()) if count.exists() else 0
    return Ended(code, sink.read_text("utf-8", "replace"), moments)


def _child(words: tuple[str, ...], place: Place, watch: Watch, sink: Path, count: Path) -> None:
    code = CRASHED
    try:
        handle = os.open(sink, os.O_CREAT | os.O_WRONLY | os.O_TRUNC)
        os.dup2(handle, 1)
        os.dup2(handle, 2)
        os.chdir(place.work)
        os.environ["SERVO_MODELS_CACHE"] = str(place.cache)
        tempfile.tempdir = os.environ["TMPDIR"] = str(place.temporary)
        if not watch.delay:
            signal.alarm(PATIENCE_SECONDS)
        sys.addaudithook(watch)
        code = servo_models(list(words))
    except BaseException:
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    count.write_text(str(watch.seen))
    os._exit(code)


def content(path: Path) -> object:
    """What stands in an output, without what a clock has measured; None where it is missing."""
    if not path.exists():
        return None
    found = path.read_bytes()
    if path.suffix == ".json" and found != OLD:
        return _untimed(json.loads(found))
    if path.suffix in (".xml", ".html"):
        return re.sub(rb"[\d.]+", b"", found)
    return found


def _untimed(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _untimed(v) for k, v in value.items() if "seconds" not in k and k != "bars"}
    return [_untimed(one) for one in value] if isinstance(value, list) else value


def write_log(path: Path) -> None:
    """Steps of a torque motor with a delay, and noise."""
    from servo_models.validation.torque_motor.reference import IDENTIFIED, Linear

    times = np.arange(0.0, 0.2, 2.5e-4)
    voltage = 8.0 * np.sign(np.sin(2.0 * np.pi * 12.0 * times))
    inputs = {"voltage": voltage, "load_torque": np.zeros_like(times)}
    angle = np.degrees(Linear(IDENTIFIED)(times, inputs)["angle"])
    noisy = angle + 3e-3 * np.random.default_rng(5).standard_normal(len(times))
    rows = np.column_stack([times, voltage, noisy])
    np.savetxt(path, rows, "%.9g", delimiter=",", header="t,u,angle", comments="")


def prepare(folder: Path) -> None:
    """Write the inputs of every command."""
    from servo_models.build import build
    from servo_models.catalogue import model

    write_log(folder / "log.csv")
    (folder / "rig.toml").write_text(DESCRIPTION)
    for unit in range(UNITS):  # which fail at once, and are kept like any other
        (folder / "fleet" / str(unit)).mkdir(parents=True)
        (folder / "fleet" / str(unit) / "joint.toml").write_text(DESCRIPTION)
    (folder / "joint.py").write_text(SOURCE)
    (folder / "joint.toml").write_text(PARAMETERS)
    build(model("torque_motor"), folder / "valid.fmu")


class Bench:
    """Runs one command undisturbed, then killed, then again."""

    def __init__(self, name: str, given: Path, cache: Path, scratch: Path) -> None:
        self.command, self.given, self.scratch = COMMANDS[name], given, scratch
        self.cache = cache
        self.killed = 0
        self.expected = run(self.command.words, place := self.place())
        self.outputs, self.kept = self._contents(place), self._kept(place)
        if self.expected.code not in (0, 1) or None in self.outputs.values():
            raise RuntimeError(f"{name}: exit code {self.expected.code}: {self.expected.said}")

    def place(self) -> Place:
        """New folders with the command's inputs and, unless it begins cold, a filled cache."""
        shutil.rmtree(self.scratch, ignore_errors=True)
        place = Place(*(self.scratch / name for name in ("work", "cache", "temporary")))
        shutil.copytree(self.given, place.work)
        place.temporary.mkdir()
        if self.command.cold:
            place.cache.mkdir()
        else:
            shutil.copytree(self.cache, place.cache)
        return place

    def _contents(self, place: Place) -> dict[str, object]:
        return {name: content(place.work / name) for name in self.command.outputs}

    def _kept(self, place: Place) -> dict[str, bytes]:
        files = place.work.glob(self.command.keeps) if self.command.keeps else ()
        return {file.name: file.read_bytes() for file in files}

    def kill_until_done(self, most: int, draws: Iterator[tuple[int, float]]) -> str:
        """Kill the command where it goes on, until it is done or was killed ``most`` times; return
        what is wrong, or nothing."""
        place, before = self.place(), dict[str, bytes]()
        for at, delay in islice(draws, most):
            ended = run(self.command.words, place, at, delay)
            kept = self._kept(place)
            if not before.items() <= kept.items():
                return "what was kept is lost or done again"
            if not all(_same(kept[it], self.kept.get(it)) for it in kept):
                return "what is kept is half, or of no job"
            if alive := _orphans():
                return f"processes go on: {alive}"
            if ended.code >= 0:
                break
            self.killed += 1
            before = kept
        return self._again(place) or (
            "" if self._kept(place).keys() == self.kept.keys() else "lost"
        )

    def kill(self, at: int, delay: float, over: bool) -> str:
        """Return what is wrong after a kill, or nothing."""
        place = self.place()
        over = over and self.command.replaces
        for name in self.command.outputs if over else ():
            (place.work / name).parent.mkdir(exist_ok=True)
            (place.work / name).write_bytes(OLD)
        killed = run(self.command.words, place, at, delay)
        if killed.code >= 0:  # it was done before its time had come
            return (
                ""
                if killed.code == self.expected.code
                else f"ended with {killed.code}: {killed.said[-300:]}"
            )
        self.killed += 1
        before: tuple[object, ...] = (OLD,) if over else (None,)
        try:
            for name, found in self._contents(place).items():
                if found not in (*before, self.outputs[name]):
                    return f"{name} is half"
        except ValueError as error:
            return f"half: {error}"
        if alive := _orphans():
            return f"processes go on: {alive}"
        return self._again(place)

    def _again(self, place: Place) -> str:
        journal = place.work / "runs" / "results.jsonl"
        kept = _whole_lines(journal)
        if not self.command.replaces and (place.work / self.command.outputs[0]).exists():
            return _leftovers(place, but_first=True)
        ended = run(self.command.words, place)
        if ended.code != self.expected.code:
            return f"the next run ends with {ended.code}: {ended.said[-300:]}"
        if self._contents(place) != self.outputs:
            return "the next run writes something else"
        if not journal.exists() or journal.read_bytes().startswith(kept):
            return _leftovers(place)
        return "cases that were done are done again"


def _same(kept: bytes, expected: bytes | None) -> bool:
    """Whether two JSON documents are equal but for the time that they took."""
    try:
        return expected is not None and _untimed(json.loads(kept)) == _untimed(json.loads(expected))
    except ValueError:
        return False


def _whole_lines(path: Path) -> bytes:
    return path.read_bytes().rpartition(b"\n")[0] if path.exists() else b""


def _leftovers(place: Place, but_first: bool = False) -> str:
    """Name what lies about; ``but_first``: no run has had the occasion to remove it."""
    parts = [path for folder in place for path in folder.rglob(".servo-models-*.part")]
    left = [] if but_first else [str(path) for path in [*parts, *place.temporary.iterdir()]]
    return f"left over: {left}" if left else ""


def _orphans() -> list[int]:
    """Processes that a killed one had begun and that do not end."""
    end = time.monotonic() + PEACE_SECONDS
    while time.monotonic() < end:
        try:
            if not os.waitpid(-1, os.WNOHANG)[0]:
                time.sleep(0.05)
        except ChildProcessError:
            return []
    children = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
    for one in children:
        with contextlib.suppress(ProcessLookupError):
            os.kill(int(one), signal.SIGKILL)
    return [int(one) for one in children]


def kills(name: str, count: int, rng: random.Random, bench: Bench) -> list[str]:
    """Kill a command ``count`` times, spread over its moments; return what was wrong."""
    faults = []

    def delay() -> float:
        late = EARLIEST_SECONDS * (LATEST_SECONDS / EARLIEST_SECONDS) ** rng.random()
        return rng.choice([0.0, late, late])

    # most are within the next jobs, and some at the end
    draws = ((round(bench.expected.moments ** rng.random()), delay()) for _ in repeat(None))
    while bench.command.keeps and bench.killed < count and not faults:
        if fault := bench.kill_until_done(count - bench.killed, draws):
            faults.append(f"{name}, after {bench.killed} kills: {fault}")
    for k in range(0 if bench.command.keeps else count):
        at = 1 + math.floor((k + rng.random()) / count * bench.expected.moments)
        late = delay()
        if fault := bench.kill(at, late, over=bool(k % 2)):
            faults.append(f"{name}, moment {at}, {1e3 * late:.2f} ms later: {fault}")
    return faults


def damage(cache: Path, rng: random.Random) -> str:
    """Damage a cache somewhere, and tell how."""
    files = sorted(path for path in cache.rglob("*") if path.is_file())
    file, other = rng.choice(files), rng.choice(files)
    found = file.read_bytes()
    kind = rng.choice([*KINDS])
    KINDS[kind](file, found, other, rng)
    return f"{kind}: {file.relative_to(cache)}"


def _flip(file: Path, found: bytes, _: Path, rng: random.Random) -> None:
    changed = bytearray(found or b"x")
    changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    file.write_bytes(changed)


def _folder(file: Path, *_: object) -> None:
    file.unlink()
    file.mkdir()


def _entry_over_another(file: Path, _: bytes, other: Path, rng: random.Random) -> None:
    cache = next(path for path in file.parents if path.name == "cache")
    first, second = (cache / path.relative_to(cache).parts[0] for path in (file, other))
    if first == second:
        _flip(file, file.read_bytes(), other, rng)
    else:
        shutil.rmtree(first)
        shutil.copytree(second, first)


KINDS: dict[str, Callable[[Path, bytes, Path, random.Random], object]] = {
    "a bit": _flip,
    "cut": lambda file, found, other, rng: file.write_bytes(found[: rng.randrange(len(found) + 1)]),
    "empty": lambda file, found, other, rng: file.write_bytes(b""),
    "zeros": lambda file, found, other, rng: file.write_bytes(bytes(len(found))),
    "longer": lambda file, found, other, rng: file.write_bytes(found + rng.randbytes(30)),
    "removed": lambda file, found, other, rng: file.unlink(),
    "a folder": _folder,
    "another file": lambda file, found, other, rng: file.write_bytes(other.read_bytes()),
    "a new file": lambda file, found, other, rng: file.with_name("new.py").write_text("1 / 0"),
    "entry gone": lambda file, found, other, rng: shutil.rmtree(file.parent),
    "entry over another": _entry_over_another,
}


def caches(
    count: int, rng: random.Random, bench: Bench, cache: Path
) -> tuple[Counter[str], list[str]]:
    """Run a command with damaged caches; return what was done and what was wrong."""
    told: Counter[str] = Counter()
    faults = []
    for _ in range(count):
        place = bench.place()
        shutil.rmtree(place.cache)
        shutil.copytree(cache, place.cache)
        how = damage(place.cache, rng)
        ended = run(bench.command.words, place)
        found = {name: content(place.work / name) for name in bench.command.outputs}
        again = run(bench.command.words, place)
        told[how.partition(":")[0]] += 1
        if ended.code != bench.expected.code or found != bench.outputs:
            faults.append(f"{how}: exit code {ended.code}: {ended.said[-300:]}")
        elif "made again" in again.said or again.code != bench.expected.code:
            faults.append(f"{how}: is not healed")
        elif left := _leftovers(place):
            faults.append(f"{how}: {left}")
    return told, faults


def trial(names: list[str], count: int, damaged: int, seed: int) -> int:
    """Run it all and print a table; return the number of faults."""
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    if "survey" in names:
        import servo_models.survey.survey  # noqa: F401  every fork would do so anew
    faults: list[str] = []
    with tempfile.TemporaryDirectory(prefix="kills ") as scratch:
        folder = Path(scratch)
        given, cache = folder / "given", folder / "warm" / "cache"
        given.mkdir()
        if not (child := os.fork()):  # nothing of what fills the cache may be in this process
            os.environ["SERVO_MODELS_CACHE"] = str(cache)
            prepare(given)
            os._exit(0)
        os.waitpid(child, 0)
        for name in names:
            rng = random.Random(f"{seed} {name}")
            if not COMMANDS[name].cold:
                _warm(name, given, cache, folder / "warm")
            bench = Bench(name, given, cache, folder / "case")
            found = kills(name, count, rng, bench)
            moments = bench.expected.moments
            print(
                f"{name}: {bench.killed} of {count} killed, {moments} moments, {len(found)} faults",
                *found,
                sep="\n",
                flush=True,
            )
            faults += found
        if damaged:
            own = folder / "own" / "cache"
            bench = Bench("simulate, cold", given, cache, folder / "case")
            shutil.copytree(folder / "case" / "cache", own)
            told, found = caches(damaged, random.Random(f"{seed} caches"), bench, own)
            print(f"{damaged} damaged caches, {len(found)} faults: {dict(sorted(told.items()))}")
            print(*found, sep="\n")
            faults += found
    return len(faults)


def _warm(name: str, given: Path, cache: Path, folder: Path) -> None:
    """Let a command fill the cache that its cases begin with."""
    place = Place(folder / "work", cache, folder / "temporary")
    shutil.rmtree(place.work, ignore_errors=True)
    shutil.copytree(given, place.work)
    place.temporary.mkdir(exist_ok=True)
    run(COMMANDS[name].words, place)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=20, help="of each command")
    parser.add_argument("--caches", type=int, default=500, help="that are damaged")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", choices=[*COMMANDS], default=[*COMMANDS])
    given = parser.parse_args()
    return 1 if trial(given.only, given.kills, given.caches, given.seed) else 0


if __name__ == "__main__":
    raise SystemExit(main())
