"""A share of the random FMI calls of ``tests/fuzz/native.py``, and faults that it has to find."""

from __future__ import annotations

import functools
import shutil
from pathlib import Path

import pytest

from servo_models.build import FMI3, NATIVE
from servo_models.catalogue import actuators, model
from tests.fuzz.native import compiled_driver, has, run, subject_of, unpacked

SEQUENCES = {"plain": 160, "sanitize": 50, "valgrind": 10, "threads": 30}
THREADS = 3
has_mode = functools.cache(has)

pytestmark = pytest.mark.skipif(not has("plain"), reason="needs Linux and a C compiler")


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzzed")


@pytest.fixture(scope="module")
def small(scratch: Path) -> Path:
    """The unpacked FMU with the shortest sources."""
    folder = scratch / "small"
    folder.mkdir()
    return unpacked(model("torque_motor"), folder)


def driver(mode: str, scratch: Path) -> Path:
    if not has_mode(mode):
        pytest.skip(f"nothing here to run '{mode}' with")
    found = scratch / f"fmi_calls_{mode}"
    return found if found.exists() else compiled_driver(mode, scratch)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("actuator", "kind"), [*((name, NATIVE) for name in actuators()), ("torque_motor", FMI3)]
)
def test_calls_succeed_or_are_refused_with_a_message_and_a_replay_has_the_same_bits(
    actuator: str, kind: str, scratch: Path, tmp_path: Path
) -> None:
    fmu = unpacked(model(actuator), tmp_path, kind)
    subject = subject_of(fmu, "plain", driver("plain", scratch), tmp_path / "compiled")
    found = run(subject, range(SEQUENCES["plain"]))
    assert found.faults == []
    assert found.counts["played"] == SEQUENCES["plain"]
    assert 0.02 < found.counts["refused"] / found.counts["calls"] < 0.2
    assert found.counts["steps"] > 10 * SEQUENCES["plain"]


@pytest.mark.thorough
@pytest.mark.parametrize("mode", ["sanitize", "valgrind", "threads"])
def test_under_what_watches_memory_and_threads(
    mode: str, small: Path, scratch: Path, tmp_path: Path
) -> None:
    subject = subject_of(small, mode, driver(mode, scratch), tmp_path / "compiled")
    found = run(subject, range(SEQUENCES[mode]), THREADS if mode == "threads" else 0)
    assert found.faults == []
    assert found.counts["played"] == SEQUENCES[mode]


FAULTS = {
    "a damaged state is taken": (
        "plain",
        "|| header->digest != digest_of_saved(saved)",
        "",
    ),
    "a state lacks a part": (
        "plain",
        "memcpy(&saved->state, &I->now, sizeof saved->state);",
        "memcpy(&saved->state, &I->now, sizeof saved->state); saved->state.x[0] = 0.0;",
    ),
    "instances share a counter": (
        "plain",
        "    if (!advance(I, I->now.x, time, size))",
        "    static int steps; if (++steps % 7 == 0) size *= 1.01;\n"
        "    if (!advance(I, I->now.x, time, size))",
    ),
    "a refusal says nothing": ("plain", "if (I->tell)", "if (0)"),
    "a failed instance goes on": (
        "plain",
        "if (I->now.trouble[0])\n        return refuse",
        "if (0)\n        return refuse",
    ),
    "a reference from 2^31 on is negative": (
        "plain",
        "reference >= VARIABLES",
        "(int32_t)reference >= VARIABLES",
    ),
    "NaN is within bounds": (
        "plain",
        "!(v->low <= value && value <= v->high)",
        "(v->low > value || value > v->high)",
    ),
    "a state begins with bytes of the stack": (
        "valgrind",
        "at_rest(&I->setup, rest);",
        "if (I->now.has_x) at_rest(&I->setup, rest);",
    ),
    "a table is read beyond its end": (
        "sanitize",
        "reference >= VARIABLES",
        "reference > VARIABLES",
    ),
    "threads share a counter": (
        "threads",
        "    if (!advance(I, I->now.x, time, size))",
        "    static int steps; steps++;\n    if (!advance(I, I->now.x, time, size))",
    ),
}


FIRST = {mode: name for name, (mode, *_) in reversed(FAULTS.items())}
"""A fault for each way of running, which is enough for a change."""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(it, marks=pytest.mark.thorough if it in FIRST.values() else pytest.mark.long)
        for it in FAULTS
    ],
)
def test_it_finds_a_planted_fault(name: str, small: Path, scratch: Path, tmp_path: Path) -> None:
    mode, right, wrong = FAULTS[name]
    fmu = tmp_path / "fmu"
    shutil.copytree(small, fmu)
    source = fmu / "sources" / "instance.c"
    text = source.read_text()
    assert right in text
    source.write_text(text.replace(right, wrong))
    subject = subject_of(fmu, mode, driver(mode, scratch), tmp_path / "compiled")
    assert run(subject, range(SEQUENCES[mode]), THREADS if mode == "threads" else 0).faults
