"""What is asked of a log is tried: it leads where the log, read otherwise, is explained."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servo_models.core.types import Array
from servo_models.data.audit import Audit, audits
from servo_models.data.description import Description
from servo_models.data.log import Log
from servo_models.data.mistakes import Mistake
from servo_models.diagnosis import summary
from servo_models.diagnosis.diagnose import diagnose
from servo_models.errors import UserError
from servo_models.identification.plausibility import implausible_clocks, likely, mended
from tests.conftest import Run
from tests.support.plausible_logs import described, sane


def averaged(angle: Array) -> Array:
    return np.convolve(np.pad(angle, 15, "edge"), np.full(31, 1.0 / 31.0), "valid")


GIMBAL = Path(__file__).parents[2] / "examples" / "gimbal"


def diagnosed(run: Run, folder: Path, spoil: Callable[[Array], Array]) -> dict[str, Any]:
    """A diagnosis of the gimbal whose angle was spoilt."""
    shutil.copytree(GIMBAL, folder)
    header, *rows = (folder / "log.csv").read_text("utf-8").splitlines()
    table = np.array([row.split(",") for row in rows], dtype=float)
    column = header.split(",").index("angle_deg")
    table[:, column] = spoil(table[:, column])
    np.savetxt(folder / "log.csv", table, "%.6g", ",", header=header, comments="")
    code, out, _ = run("diagnose", folder / "gimbal.toml", "--format", "json")
    assert code == 1
    return dict(json.loads(out))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (np.negative, "column 'angle_deg' ('reading') goes against the command"),
        (np.radians, "column 'angle_deg' ('reading') is read in deg, but rad would make sense"),
        (lambda angle: np.clip(angle, *np.quantile(angle, [0.2, 0.8])), "'reading' is clipped"),
        (averaged, "'reading' was averaged over 31 rows"),
    ],
    ids=["sign", "unit", "clipped", "averaged"],
)
def test_a_mistake_leads_where_the_log_read_otherwise_is_explained_far_better(
    run: Run, tmp_path: Path, spoil: Callable[[Array], Array], words: str
) -> None:
    """Or where the log alone shows what no other reading mends."""
    found = diagnosed(run, tmp_path / "gimbal", spoil)
    assert found["sentence"].startswith(f"Correct log 'log': {words}")
    assert all(effect["probability"] is None for effect in found["effects"])


@pytest.mark.thorough
def test_a_false_question_neither_leads_nor_bans_nor_takes_a_probability(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = question(["reading"], turned)

    def questions(told: Description) -> list[Audit]:
        return [replace(it, mistakes=(asked,)) for it in audits(told.logs, told.model.plant)]

    usual = diagnose(GIMBAL / "gimbal.toml", seed=1)
    monkeypatch.setattr("servo_models.diagnosis.diagnose.questions", questions)
    found = diagnose(GIMBAL / "gimbal.toml", seed=1)
    assert found.mistake == ""
    assert not any("a question" in text for text in summary.warnings(found))
    assert [(it.name, it.probability) for it in found.ranking] == [
        (it.name, it.probability) for it in usual.ranking
    ]


def question(columns: Sequence[str], mended: Callable[[Log], Log]) -> Mistake:
    return Mistake("a question", columns, mended, everywhere=True)


def turned(log: Log) -> Log:
    return replace(log, outputs={name: -values for name, values in log.outputs.items()})


def in_degrees(log: Log) -> Log:
    return replace(log, inputs={name: np.radians(it) for name, it in log.inputs.items()})


@pytest.mark.parametrize("mended", [turned, in_degrees])
def test_a_question_is_dropped_where_the_log_is_no_better_read_otherwise(
    mended: Callable[[Log], Log],
) -> None:
    """Of a right log it is; of the log that was read so, which is mended by reading it back."""
    chosen, log = sane("smart_servo", "xl330", 105)
    asked = question([*log.outputs, *log.inputs], mended)
    back = {turned: turned, in_degrees: as_radians}[mended]
    for logs, stays in (([log], False), ([back(log)], True)):
        told = replace(described(chosen, log), logs=tuple(logs))
        audited = [replace(it, mistakes=(asked,)) for it in audits(told.logs, chosen.plant)]
        assert [bool(it.mistakes) for it in likely(told, audited)] == [stays]


def as_radians(log: Log) -> Log:
    return replace(log, inputs={name: np.degrees(it) for name, it in log.inputs.items()})


def test_logs_of_one_recorder_are_judged_together() -> None:
    """One log of three says nothing against its unit, so that it is not the one that is wrong."""
    chosen, log = sane("smart_servo", "xl330", 105)
    quiet = replace(log, name="quiet", outputs={n: 0.02 * it for n, it in log.outputs.items()})
    twin = replace(log, name="twin")
    asked = question([*log.outputs], lambda it: replace(it, outputs=scaled(it.outputs)))
    for logs, stays in (((quiet,), True), ((log, twin, quiet), False)):
        told = replace(described(chosen, log), logs=tuple(logs))
        audited = audits(told.logs, chosen.plant)
        accused = [
            replace(it, mistakes=(asked,)) if it.log.name == "quiet" else it for it in audited
        ]
        assert any(it.mistakes for it in likely(told, accused)) is stays


def test_each_log_is_mended_by_what_is_asked_of_its_own_rows() -> None:
    """Another column is left as it stands."""
    chosen, log = sane("smart_servo", "xl330", 105)
    logs = [replace(log, name=str(k)) for k in range(3)]

    def marked(by: float, column: str = "angle") -> Mistake:
        return Mistake(f"rows {by}", [column], lambda it: replace(it, constants={"by": by}))

    told = [[marked(1.0)], [Mistake("sure", ["angle"]), marked(2.0)], [marked(3.0, "current")]]
    asked = [replace(a, mistakes=tuple(it)) for a, it in zip(audits(logs, chosen.plant), told)]
    right = mended(logs, asked, told[0][0])
    assert [it.constants.get("by") for it in right] == [1.0, 2.0, log.constants.get("by")]


@pytest.mark.parametrize("slower", [1e3, 1e-3])
def test_a_time_that_cannot_be_is_asked_for_before_hours_of_search(slower: float) -> None:
    """Once it has been checked it is asked no more."""
    chosen, log = sane("smart_servo", "xl330", 105)
    log = replace(log, times=slower * log.times)
    with pytest.raises(UserError, match=r"answers a step in|slowest time constant"):
        diagnose(described(chosen, log))
    time = replace(log.channels["time"], checked=True)
    settled = replace(log, channels={**log.channels, "time": time})
    assert implausible_clocks(described(chosen, settled)) == ()


def scaled(signals: Mapping[str, Array], factor: float = 50.0) -> dict[str, Array]:
    return {name: factor * values for name, values in signals.items()}


def test_a_reading_that_cannot_be_simulated_explains_nothing() -> None:
    """A pulse of less than 0 s is no input, and a start that it shows is none."""

    def refused(log: Log) -> Log:
        raise UserError("out of bounds")

    chosen, log = sane("smart_servo", "xl330", 105)
    for read in (refused, lambda it: replace(it, inputs=scaled(it.inputs, 1e6))):
        asked = question([*log.inputs], read)
        audited = [replace(it, mistakes=(asked,)) for it in audits([log], chosen.plant)]
        assert not any(it.mistakes for it in likely(described(chosen, log), audited))
