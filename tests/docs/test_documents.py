"""What the documents point to is there, and what they show is true."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import binomtest

from servo_models.catalogue import actuators
from servo_models.diagnosis.schema import DiagnosisDocument
from servo_models.effects import effects
from servo_models.report.document import schema_of
from servo_models.report.live import asset
from tests.conftest import Run
from tests.support.document import ROOT, code_blocks, follow

FmuFile = Callable[[str], Path]
README = (ROOT / "README.md").read_text(encoding="utf-8")
MADE = tuple(ROOT / "docs" / folder for folder in ("actuators", "effects", "living", "reference"))
"""What the build of the site writes, which checks the links to it."""
PAGES = sorted(
    [
        *ROOT.glob("*.md"),
        *(page for page in ROOT.glob("docs/**/*.md") if page.parent not in MADE),
        *ROOT.glob("examples/**/*.md"),
    ],
    key=str,
)
SHARES = {
    "the cause is named first": "first_place",
    "of two causes both are named, and no other": "both_named",
    "a cause that no effect of ours describes is told as such": "foreign_recall",
    "the list of possible causes holds the true one": "set_holds",
    "nothing is wrong, and something is suspected": "false_causes",
    "what is told with 90 to 99 % is there": "sure_ones_right",
}
"""What the README says, by the figure's name in ``docs/studies/blind.md``."""
_NUMBER = r"(1\.0+|1|0?\.\d+)"
SHARE_OF = re.compile(
    rf"{_NUMBER} \({_NUMBER} to {_NUMBER}\) of (\d+)\b(?! \d)"
    rf"|\| {_NUMBER} \| {_NUMBER} to {_NUMBER} \| (\d+) \|"
)
"""A share, its interval of 95 % and the number of cases."""
MEANS = ("closed_vs_oracle", "calibration_error", "log_loss")
"""Figures of the studies that are no shares."""
every_page = pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))


def anchors(page: Path) -> set[str]:
    """The headings of a page as links name them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", one.lower()).replace(" ", "-") for one in headings}


@every_page
def test_links_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if "://" in link:
            continue
        path, _, heading = link.partition("#")
        target = page.parent / path if path else page
        if target.parent in MADE:
            continue
        assert target.exists(), link
        assert not heading or heading in anchors(target), link


@every_page
def test_named_files_of_the_package_exist(page: Path) -> None:
    for name in re.findall(
        r"`((?:servo_models|tests|benchmarks|studies|fmu_src)/[\w/.]*)`",
        page.read_text(encoding="utf-8"),
    ):
        assert (ROOT / name).exists(), name


def test_the_counts_of_actuators_and_effects() -> None:
    words = dict(enumerate(["Six", "Seven", "Eight", "Nine", "Ten", "Eleven", "Twelve"], 6))
    every = [main for main, *_ in effects().values() if not main.hints.learnt]
    told = " ".join((ROOT / "docs" / "fmu.md").read_text(encoding="utf-8").split())
    assert f"There are {len(every)} effects" in told
    assert f"\n{len(every)} effects that simulations usually lack are inside" in README
    front = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    for text in (README, front):
        assert f"{words[len(actuators())]} actuators".lower() in text.lower()


def test_the_two_commands_of_the_readme_stand_first_and_ci_calls_its_tests() -> None:
    """``.ci/run`` calls the test command with one word more."""
    first, second = (
        line.partition("#")[0].split() for line in code_blocks(README, "")[0].splitlines()
    )
    assert first == ["python", "build_fmu.py"]
    lines = (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    assert [line.split()[:-1] for line in lines if "-m tests" in line] == [second]
    assert README.index("build_fmu.py") < README.index("pip install")


def test_the_shares_of_the_readme_are_those_of_the_study() -> None:
    study = (ROOT / "docs" / "studies" / "blind.md").read_text(encoding="utf-8")
    tiers = [study.split(f"## {tier}, 300 cases")[1].split("\n## ")[0] for tier in ("Easy", "Hard")]

    def now(figure: str) -> list[float]:
        rows = [re.findall(rf"^\| {figure} \| \S+ \| (\S+) ", tier, re.MULTILINE) for tier in tiers]
        return [float(value) for (value,) in rows]

    rows = dict(re.findall(r"^\| ([^|]+) \| ([\d.]+ \| [\d.]+) \|$", README, re.MULTILINE))
    for told, figure in SHARES.items():
        assert rows.pop(told) == " | ".join(f"{value:.2f}" for value in now(figure)), told
    assert not rows
    assert "That is {:.0%} of the clean logs and {:.0%} of the hard".format(
        *now("separated")
    ).replace("%", " %") in " ".join(README.split())


def test_the_real_logs_of_the_readme_are_those_of_the_study() -> None:
    study = (ROOT / "docs" / "studies" / "real_logs.md").read_text(encoding="utf-8")
    measured = study.split("\n## The valve paper")[0].split("\n## ")[1:]
    usual = [it for it in measured if "With the usual tolerance it claims `no-gap`" not in it]
    outside = [it for it in usual if "**Claimed** (`outside-catalogue`" in it]
    closed = [float(it.split(" which closes ")[1].split(" %")[0]) for it in outside]
    count = ("five", "six", "seven", "eight")[len(outside) - 5]
    told = f"of {count} it closes {min(closed):.0f} to {max(closed):.0f} % of the gap"
    assert told in " ".join(README.split())


def with_interval(count: int, cases: int) -> np.ndarray:
    """A share and its interval of 95 %, after Wilson, shape (3,)."""
    return np.array([count / cases, *binomtest(count, cases).proportion_ci(0.95, "wilson")])


@every_page
def test_shares_are_of_whole_cases_and_have_the_intervals_of_wilson(page: Path) -> None:
    lines = page.read_text(encoding="utf-8").replace("*", "").splitlines()
    for line in (it for it in lines if not any(name in it for name in MEANS)):
        for found in SHARE_OF.findall(line):
            *told, count = (it for it in found if it)
            cases, rounding = int(count), [0.51 * 10.0 ** -len(it.partition(".")[2]) for it in told]
            near = round(float(told[0]) * cases)
            counts = range(max(near - 2, 0), min(near + 2, cases) + 1)
            off = np.abs([with_interval(it, cases) - np.array(told, float) for it in counts])
            assert np.any(np.all(off <= rounding, axis=1)), line


def test_the_keys_of_a_diagnosis_in_json_are_those_of_its_schema() -> None:
    def names_in(part: Any) -> set[str]:
        inner = part.values() if isinstance(part, dict) else part if isinstance(part, list) else ()
        found = set(part.get("properties", ())) if isinstance(part, dict) else set()
        return found.union(*map(names_in, inner))

    schema = schema_of(DiagnosisDocument)
    text = (ROOT / "docs" / "diagnosis.md").read_text(encoding="utf-8")
    table = text.split("| key | what it holds |")[1].split("\n\n")[0]
    told = set(re.findall(r"`([a-z_]+)`", table))
    assert told - names_in(schema) <= {"null", "window"}  # of JSON, and of a description


def test_the_architecture_names_folders_and_modules_that_exist() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    package = ROOT / "servo_models"
    folders = {path.name for path in package.iterdir() if (path / "__init__.py").exists()}
    assert {name for name in folders if f"`{name}/" in text} == folders
    whole, steps = text.split("## How a diagnosis works")
    for name in re.findall(r"`([\w/]+(?:\.py|/))`", whole):
        assert (package / name).exists() or (ROOT / name).exists(), name
    for name in re.findall(r"`([\w/]+(?:\.py|/))`", steps.split("## Validation")[0]):
        assert (package / "diagnosis" / name).exists() or (package / name).exists(), name


def test_the_diagnosis_of_the_readme(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Run
) -> None:
    """Which is that of the example, whose page shows it as well."""
    for name in ("gimbal.py", "log.csv"):
        (tmp_path / name).write_bytes((ROOT / "examples" / "gimbal" / name).read_bytes())
    (tmp_path / "gimbal.toml").write_text(code_blocks(README, "toml")[0])
    monkeypatch.chdir(tmp_path)
    commands = follow(README, run, doubted="diagnose")  # which finds a gap
    page = (ROOT / "examples" / "gimbal" / "README.md").read_text(encoding="utf-8")
    (shown,) = code_blocks(page, "")
    assert commands[0] in shown
    assert set(shown.splitlines()[1:]) <= set(README.splitlines())


def test_the_python_of_the_readme(
    tmp_path: Path, fmu_file: FmuFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    of_log, of_fmu, of_model = code_blocks(README, "python")
    times = np.arange(0.0, 1.0, 0.01)
    log = {"times": 1e3 * times, "command": np.full(100, 1600.0), "angle": 10.0 * times}
    names: dict[str, Any] = dict(log)
    exec(of_log.split("result =")[0], names)
    assert names["description"].logs[0].outputs["angle"] == pytest.approx(np.radians(log["angle"]))
    exec(of_model, names)
    assert names["response"]["angle"].shape == (1000,)
    (tmp_path / "fmus").mkdir()
    shutil.copy(fmu_file("torque_motor"), tmp_path / "fmus" / "torque_motor.native.fmu")
    monkeypatch.chdir(tmp_path)
    exec(of_fmu, names)
    assert set(names["result"].dtype.names) == {"time", "angle", "current"}


def test_the_report_in_the_documentation_has_the_panel_of_today() -> None:
    page = (ROOT / "docs" / "gap.html").read_text("utf-8")
    assert asset("panel.js") in page
    assert "drive_dead_zone" in page
