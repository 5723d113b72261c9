"""What programs read: a validation as text, JSON, GitHub annotations, JUnit XML, exit codes."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

import servo_models.validation.runner  # noqa: F401  (its function is replaced below)
from servo_models.core.stop import Tell
from servo_models.report.interchange import command, finite_json
from servo_models.validation.rows import IMPLEMENTATION, MODEL, PAPER, Row, Validation
from tests.conftest import Run

GOOD = Row(IMPLEMENTATION, "sg90", "linear", "1 ms", "angle", 0.0, 1e-12, "1", True)
BAD = Row(MODEL, "sg90", "printed", "step, 50 %", "angle", 2e-3, 1e-4, "1", False, "why: so")
NAMED = Row(PAPER, "sg90", "linear", "K_f", "T", 9.8, None, "s", None, "misprint", printed=7.5)


@pytest.fixture
def verdict(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Let ``validate`` give these rows."""

    def give(*rows: Row) -> None:
        def stand_in(
            fmus: object,
            on_progress: Tell,
            own: object,
            limits: object,
            against: object,
        ) -> Validation:
            on_progress("half way", 1, 2)
            return Validation(rows)

        module = sys.modules["servo_models.validation.runner"]
        monkeypatch.setattr(module, "validate", stand_in)

    return give


def test_validate_exits_by_the_verdict(run: Run, verdict: Callable[..., None]) -> None:
    verdict(GOOD, NAMED)
    assert run("validate")[0] == 0
    verdict(GOOD, BAD)
    code, out, err = run("validate")
    assert code == 1
    assert "FAIL" in out
    assert err == ""


def test_brief_is_the_verdict_then_counts_then_what_failed(
    run: Run, verdict: Callable[..., None]
) -> None:
    long = Row(MODEL, "sg90", "printed", "a " * 30 + "long case", "angle", 1.0, 0.5, "1", False)
    verdict(GOOD, GOOD, BAD, NAMED, long)
    code, out, err = run("validate", "--brief")
    assert code == 1
    lines = out.splitlines()
    assert lines[0] == "FAILED: 2 of 4 figures are outside their limits."
    assert "2 of 2 0 of 2 1 not reproducible" in " ".join(out.split())
    assert "why: so" in " ".join(out.split())
    assert max(map(len, lines)) <= 80
    assert err == "2 of 2: half way\n"


def test_json_is_all_there_is_on_stdout(run: Run, verdict: Callable[..., None]) -> None:
    endless = Row(MODEL, "sg90", "printed", "step", "rate", float("inf"), 1.0, "1", False)
    verdict(GOOD, BAD, NAMED, endless)
    code, out, _ = run("validate", "--format", "json")
    result = json.loads(out, parse_constant=pytest.fail)
    assert code == 1
    assert result["passed"] is False
    assert [row["value"] for row in result["rows"]] == [0.0, 2e-3, 9.8, None]


def test_github_gets_one_escaped_line_a_finding(run: Run, verdict: Callable[..., None]) -> None:
    verdict(GOOD, BAD, NAMED)
    code, out, _ = run("validate", "--format", "github")
    lines = out.splitlines()
    assert code == 1
    assert [line.split(" ")[0] for line in lines] == ["::error", "::notice", "::notice"]
    title = lines[0].split("::")[1]
    assert "%25" in title
    assert "," not in title
    assert "why: so" in lines[0]


def test_junit_counts_and_explains(run: Run, verdict: Callable[..., None], tmp_path: Path) -> None:
    verdict(GOOD, BAD, NAMED)
    path = tmp_path / "junit.xml"
    run("validate", "--junit", path)
    suites = list(ElementTree.parse(path).getroot())
    assert [suite.get("failures") for suite in suites] == ["0", "1", "0"]
    assert [suite.get("skipped") for suite in suites] == ["0", "0", "1"]
    failure = suites[1].find("testcase/failure")
    assert failure is not None
    assert "why: so" in str(failure.get("message"))


def test_junit_carries_times(run: Run, verdict: Callable[..., None], tmp_path: Path) -> None:
    verdict(replace(GOOD, seconds=1.25), replace(BAD, seconds=0.5), replace(BAD, seconds=0.25))
    path = tmp_path / "junit.xml"
    run("validate", "--junit", path)
    root = ElementTree.parse(path).getroot()
    assert root.get("time") == "2.000"
    assert [suite.get("time") for suite in root] == ["1.250", "0.750", "0.000"]
    assert [case.get("time") for case in root.iter("testcase")] == ["1.250", "0.500", "0.250"]


def test_a_paper_figure_stands_beside_what_was_printed(
    run: Run, verdict: Callable[..., None]
) -> None:
    near = Row(PAPER, "sg90", "linear", "K_f", "T", 4.602, 0.05, "s", True, "", 4.6, 4.6017)
    verdict(near, NAMED)
    lines = run("validate")[1].splitlines()
    heading, first = (
        i for i, line in enumerate(lines) if "recomputed [s]" in line or "4.602" in line
    )
    assert heading < first
    assert "4.6 4.6017 4.602 0.05" in " ".join(lines[first].split())
    named = next(line for line in lines if line.startswith("not reproducible"))
    assert "7.5 9.8 misprint" in " ".join(named.split())
    assert lines[-1] == "PASSED: all 1 figures are within their limits."


def test_a_missing_fmu_could_not_run(run: Run) -> None:
    code, out, err = run("validate", "absent.fmu")
    assert (code, out) == (2, "")
    assert "absent.fmu" in err
    assert err.count("\n") == 1


documents = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=20,
)


@pytest.mark.thorough
@given(documents)
def test_json_has_no_infinity_and_keeps_everything_else(document: object) -> None:
    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    back = json.loads(finite_json(document), parse_constant=refuse)

    def same(one: object, other: object) -> bool:
        if isinstance(one, float) and not math.isfinite(one):
            return other is None
        if isinstance(one, list) and isinstance(other, list):
            return len(one) == len(other) and all(map(same, one, other))
        if isinstance(one, dict) and isinstance(other, dict):
            return one.keys() == other.keys() and all(same(one[k], other[k]) for k in one)
        return one == other

    assert same(document, back)


@given(st.text(), st.text())
def test_a_workflow_command_is_one_line_that_reads_back(title: str, message: str) -> None:
    def back(text: str) -> str:
        for code, plain in (("%3A", ":"), ("%2C", ","), ("%0D", "\r"), ("%0A", "\n")):
            text = text.replace(code, plain)
        return text.replace("%25", "%")

    text = command("error", title, message)
    assert "\n" not in text
    assert "\r" not in text
    head, _, rest = text.removeprefix("::error title=").partition("::")
    assert (back(head), back(rest)) == (title, message)
