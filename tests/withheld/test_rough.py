"""The tier rough: each fault of a recording is in the files of its cases, and in no others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.data.description import read_description
from servo_models.withheld.generator.cases import Case, draw_case
from servo_models.withheld.generator.faults import FAULTS
from servo_models.withheld.generator.files import write_case
from studies.second_plant.long_logs import current_motor, loaded_servo, sts3215_joint

pytestmark = pytest.mark.thorough

CASES, SEED = 16, 41


@dataclass(frozen=True)
class Rough:
    case: Case
    answer: dict[str, Any]
    files: list[Path]

    def has(self, fault: str) -> bool:
        return fault in self.answer["faults"]

    def column(self, number: int, name: str, beside: str = "cases") -> Array:
        path = self.files[number]
        path = path.parents[2] / beside / path.parent.name / path.name
        return pl.read_csv(path, infer_schema_length=None)[name].cast(pl.Float64).to_numpy()


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> list[Rough]:
    folder = tmp_path_factory.mktemp("rough") / "cases"
    made = []
    for number in range(CASES):
        case = draw_case(SEED, number, "rough")
        answer = write_case(folder, f"{number:04d}", case)
        made.append(Rough(case, answer, sorted((folder / "cases" / f"{number:04d}").glob("*.csv"))))
    return made


def test_every_case_has_one_fault_or_two(cases: list[Rough]) -> None:
    assert {len(rough.answer["faults"]) for rough in cases} == {1, 2}
    assert {fault for rough in cases for fault in rough.answer["faults"]} == set(FAULTS)


def test_rows_are_uneven_missing_or_stamped_late_where_the_answer_says_so(
    cases: list[Rough],
) -> None:
    for rough in cases:
        e = rough.case.experiment
        for number, plan in enumerate(e.plans):
            period = 1e3 * e.rig.step * plan.stride
            steps = np.diff(rough.column(number, "time_ms")) / period
            assert steps.min() > 0.0
            whole = bool(np.abs(steps - np.round(steps)).max() < 0.01)
            assert whole == (not rough.has("arrival"))
            if whole:
                longer = float(np.mean(steps > 1.5))
                assert (longer > 0.5) == (rough.has("uneven"))
                if not rough.has("uneven"):
                    assert (longer > 0.0) == (rough.has("dropped"))
            lost = 1.0 - len(steps) / (len(plan.command) - 1)
            expected = 0.5 * (rough.has("uneven"))
            assert lost == pytest.approx(expected, abs=0.1)
            assert (lost > 0.0) == (rough.has("uneven") or rough.has("dropped"))


def test_readings_are_coarse_or_wild_where_the_answer_says_so(cases: list[Rough]) -> None:
    for rough in cases:
        e = rough.case.experiment
        signal = e.rig.readings[0][0]
        wide = float(e.ranges[0]) / signal.unit_size
        command = e.rig.command
        for number, plan in enumerate(e.plans):
            clean = rough.column(number, signal.column, "truth")
            errors = np.abs(rough.column(number, signal.column) - clean)
            wild = errors > 0.25 * wide
            assert wild.any() == (rough.has("glitches"))
            assert wild.mean() < 0.01
            logged = rough.column(number, command.column) * command.unit_size
            off = np.abs(logged - plan.command[plan.logged]).max()
            assert (off > 1e-6 * np.ptp(plan.command)) == (rough.has("coarse"))
            assert off < 0.0025 * np.ptp(e.plans[0].command)
        assert (rough.answer["quantum"] > 0.0) == (rough.has("coarse"))


def test_a_constant_is_far_from_its_nominal_value_where_the_answer_says_so(
    cases: list[Rough],
) -> None:
    for rough in cases:
        e = rough.case.experiment
        off = {
            key: abs(e.true[key] / e.rig.nominal[key] - 1.0) / e.rig.spread[key] for key in e.true
        }
        if rough.has("prior"):
            assert 1.99 < max(off.values()) < 4.01


@pytest.mark.thorough
def test_held_between_its_rows_an_uneven_log_is_what_the_rig_was_given(cases: list[Rough]) -> None:
    """The product's simulation of the rows that are logged is the rig without its cause."""
    uneven = [
        rough.case.experiment for rough in cases if rough.has("uneven") and not rough.has("dropped")
    ]
    assert len(uneven) > 3
    for e in uneven:
        chosen = model(e.rig.actuator, e.rig.variant, dict(e.true))
        signal = e.rig.readings[0][0]
        for plan, plain in zip(e.plans, e.plain, strict=True):
            rows = plan.logged
            times = np.append(0.0, e.rig.settle + rows * plan.stride * e.rig.step)
            command, shares = (np.append(v[0], v[rows]) for v in (plan.command, plan.shares))
            inputs = {e.rig.command.name: command, "load_torque": e.load * shares}
            response = simulate(chosen, times, inputs)[signal.name][1:]
            assert np.abs(response - plain[:, 0]).max() < 2e-3 * np.ptp(plain[:, 0])


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("write", "logs", "rows", "period"),
    [
        (sts3215_joint, 10, 10 * 24 * 50, 1.0 / 50.0),
        (current_motor, 9, 9 * 440, 1.0 / 440.0),
        (loaded_servo, 5, 1400, 1.0 / 100.0),
    ],
)
def test_a_long_recording_is_read_and_has_its_rows(
    write: Callable[[Path], Path], logs: int, rows: int, period: float, tmp_path: Path
) -> None:
    read = read_description(write(tmp_path / "recording")).logs
    assert (len(read), sum(len(log.times) for log in read)) == (logs, rows)
    assert all(np.allclose(np.diff(log.times), period, rtol=1e-5) for log in read)
