"""The withheld check: a small one from end to end, and what its oracle could have said."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servo_models.cli import main
from servo_models.data.description import read_description
from servo_models.errors import UserError
from servo_models.withheld.oracle import Diagnosed, Question, _logs, diagnose_case, rivals, seen
from servo_models.withheld.run import Asked, check_tiers, own_code, run_blind
from servo_models.withheld.sections import CheckDocument
from tests.support.made_once import made_once
from tests.support.schemas import check_schema

CASES, SEED = 3, 3


def command(folder: Path, json_: Path, seed: int = SEED) -> list[str]:
    numbers = ["--cases", str(CASES), "--seed", str(seed), "--jobs", "2"]
    return ["blind", *numbers, "--folder", str(folder), "--json", str(json_)]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a small check, with its JSON beside the cases."""

    def make(new: Path) -> None:
        assert main(command(new / "check", new / "result.json")) == 0
        shutil.move(new / "result.json", new / "check" / "result.json")

    return made_once(tmp_path_factory, "withheld check", make) / "check"


@pytest.fixture
def copy(finished: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "check"))


def result(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    return found


def untimed(value: Any) -> Any:
    """A result without what a clock has measured."""
    if isinstance(value, dict):
        clock = ("seconds", "seconds_per_case")
        return {k: untimed(v) for k, v in value.items() if k not in clock and k != "bars"}
    return [untimed(v) for v in value] if isinstance(value, list) else value


@pytest.mark.thorough
def test_the_json_of_a_small_check_keeps_to_its_schema(finished: Path) -> None:
    found = result(finished)
    check_schema(found, CheckDocument)
    assert found["n"] == CASES
    tiers = ("easy", "hard", "poor")  # those of a check that names none
    assert {tier: it["n"] for tier, it in found["tiers"].items()} == dict.fromkeys(
        tiers, CASES // len(tiers)
    )
    assert [it["said"]["why"] for it in found["cases"]] == [""] * CASES


@pytest.mark.thorough
def test_the_oracle_explains_the_noise_free_logs(finished: Path) -> None:
    """The true effects at their true sizes leave less than what the product knows without them,
    though the laws of the generator are its own."""
    known = [it["oracle"] for it in result(finished)["cases"] if it["kind"] in ("one", "two")]
    assert known
    for it in known:
        assert it["truth"] <= it["parameters"] * (1.0 + 1e-6)
        assert it["truth"] < 1.0


@pytest.mark.thorough
def test_the_oracle_reads_noise_free_logs_that_stand_still(copy: Path) -> None:
    """A coarse quantiser's reading may not move at all: what a user's log may not do."""
    said = Diagnosed(**json.loads((copy / "results.jsonl").read_text().splitlines()[0]))
    answers = json.loads((copy / "answers.json").read_text())["cases"]
    answer = next(it for it in answers if it["case"] == said.case)
    noisy, clean = _logs(Question(copy, answer, said))
    for path, old, new in zip(answer["noise_free"], noisy.logs, clean.logs):
        shutil.copy(copy / path, old.path)
        header, *rows = (copy / path).read_text().splitlines()
        flat = [row.rpartition(",")[0] + ",0.5" for row in rows]
        (copy / path).write_text("\n".join([header, *flat]) + "\n")
        assert new.inputs is old.inputs
    read = read_description(noisy.path)
    for one, other in zip(read.logs, clean.logs):
        for name, values in one.outputs.items():
            assert np.array_equal(other.outputs[name], values)
    _, still = _logs(Question(copy, answer, said))
    assert all(np.ptp([*log.outputs.values()][-1]) == 0.0 for log in still.logs)


@pytest.mark.thorough
def test_a_diagnosis_needs_nothing_but_its_case(finished: Path, tmp_path: Path) -> None:
    case = result(finished)["cases"][-1]["said"]
    alone = shutil.copytree(finished / "cases" / case["case"], tmp_path / case["case"])
    assert untimed(diagnose_case(alone)) == untimed(case)


@pytest.mark.long
def test_a_check_goes_on_where_it_was_stopped(copy: Path) -> None:
    before = result(copy)
    # by case, else the last is the one that takes longest
    lines = sorted((copy / "results.jsonl").read_bytes().splitlines(keepends=True))
    (copy / "results.jsonl").write_bytes(b"".join(lines[:-1]) + lines[-1][:40])
    kept = sorted((copy / "oracle.jsonl").read_bytes().splitlines(keepends=True))
    (copy / "oracle.jsonl").write_bytes(b"".join(kept[:-1]))
    assert main(command(copy, copy / "result.json")) == 0
    assert untimed(result(copy)) == untimed(before)
    assert (copy / "results.jsonl").read_bytes().startswith(b"".join(lines[:-1]))


@pytest.mark.thorough
def test_the_seal_is_printed_and_is_of_the_answers(
    copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(command(copy, copy / "result.json")) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert first == f"seal of the answers, SHA-256: {result(copy)['seal']}"


def test_the_seal_is_announced_before_anything_is_diagnosed(tmp_path: Path) -> None:
    """The only case cannot be read, which is a line of the results too."""
    results = tmp_path / "results.jsonl"
    (tmp_path / "cases" / "1").mkdir(parents=True)
    known = {"cases": 1, "seed": SEED, "tiers": ["easy"], "seal": "of the answers"}
    (tmp_path / "run.json").write_text(json.dumps({**known, "code": own_code()}))
    (tmp_path / "answers.json").write_text("{}")
    told: list[tuple[str, bool]] = []

    def announce(seal: str) -> None:
        told.append((seal, results.exists()))

    def tell(doing: str, done: int = 0, every: int | None = None) -> None:
        told.append((f"{doing} {done}", results.exists()))

    with pytest.raises(UserError, match="not what was sealed"):
        run_blind(tmp_path, Asked(1, SEED, ("easy",)), 1, announce, tell)
    assert told == [("of the answers", False), ("diagnosing 0", False), ("diagnosing 1", True)]


@pytest.mark.thorough
def test_changed_answers_are_refused(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = copy / "answers.json"
    path.write_bytes(path.read_bytes().replace(b'"kind": "one"', b'"kind": "two"', 1))
    assert main(command(copy, copy / "new.json")) == 2
    assert "not what was sealed" in capsys.readouterr().err
    assert not (copy / "new.json").exists()


@pytest.mark.thorough
def test_another_check_in_the_same_folder_is_refused(
    copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(command(copy, copy / "new.json", seed=SEED + 1)) == 2
    said = capsys.readouterr().err
    assert f"holds {CASES} cases of seed {SEED}, tiers easy,hard,poor" in said
    assert len(said.splitlines()) == 1


@pytest.mark.thorough
def test_what_other_code_began_is_not_gone_on_with(
    copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = copy / "run.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "code": "0" * 64}))
    assert main(command(copy, copy / "new.json")) == 2
    said = capsys.readouterr().err
    assert "begun by another version of servo-models" in said
    assert not (copy / "new.json").exists()


@pytest.mark.thorough
def test_a_case_whose_diagnosis_failed_shows_in_the_exit_code(
    copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = copy / "results.jsonl"
    first, *others = path.read_text().splitlines()
    failed = {**json.loads(first), "verdict": "failed", "why": "no memory"}
    path.write_text("\n".join([json.dumps(failed), *others]) + "\n")
    assert main(command(copy, copy / "new.json")) == 1
    assert f"Case {failed['case']} failed: no memory" in capsys.readouterr().out


@pytest.mark.parametrize("text", ["[]", '{"seal": "x"}', '"seal"', "7", '{"seal": "x", "code": 1}'])
def test_a_damaged_journal_is_refused(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run.json").write_text(text)
    assert main(command(tmp_path, tmp_path / "new.json")) == 2
    said = capsys.readouterr().err
    assert "run.json' is damaged: name a new folder" in said
    assert "Traceback" not in said


def test_a_folder_with_something_else_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(command(tmp_path, tmp_path / "new.json")) == 2
    assert "holds no withheld check" in capsys.readouterr().err


def test_tiers_are_named_once_and_rightly() -> None:
    assert check_tiers("poor, easy") == ("poor", "easy")
    with pytest.raises(UserError, match="did you mean 'easy'"):
        check_tiers("esay")
    with pytest.raises(UserError, match="once"):
        check_tiers("easy,easy")


def test_a_case_that_cannot_be_read_is_a_wrong_answer(tmp_path: Path) -> None:
    said = Diagnosed(**diagnose_case(tmp_path))
    assert said.verdict == "failed"
    assert "description.toml" in said.why


@pytest.mark.parametrize(
    ("truth", "rival", "samples", "found"),
    [
        (0.0, 0.1, 2500, True),  # d = 0.1 sqrt(2500) = 5
        (0.0, 0.1, 2499, False),
        (3.0, 5.0, 100, True),
        (5.0, 3.0, 10**9, False),
    ],
)
def test_an_ideal_observer_sees_five_deviations(
    truth: float, rival: float, samples: int, found: bool
) -> None:
    assert seen(truth, rival, samples, 1.0) is found
    assert seen(truth, rival, 4 * samples, 4.0) is found


def test_rivals_are_the_nearest_that_are_not_the_truth() -> None:
    tried = [["a"], ["b"], ["a", "b"], ["c"], ["d"], ["e"], ["f"]]
    said = Diagnosed("0", "effect", 1.0, tried=tried)
    assert rivals(said, ["a"], []) == [["b"], ["c"], ["d"], ["e"]]
    assert rivals(said, ["a"], ["b"]) == [["c"], ["d"], ["e"], ["f"]]
    assert rivals(said, ["b", "a"], []) == [["a"], ["b"], ["c"], ["d"]]
    assert rivals(said, [], []) == tried[:4]
