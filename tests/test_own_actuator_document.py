"""``docs/own_actuator.md`` does what it says: its files, its commands, its refusals."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest
from conftest import Run

from servo_models.core.catalogue import actuator
from servo_models.errors import UserError

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "own_actuator.md").read_text(encoding="utf-8")
LISTING, LOG = (
    text for text in re.findall(r"```python\n(.*?)```", PAGE, re.S) if '"""' in text[:3]
)
(DESCRIPTION,) = re.findall(r"```toml\n(.*?)```", PAGE, re.S)
COMMANDS = re.findall(r"^```\n\$ servo-models (.*)\n((?:.*\n)*?)```", PAGE, re.M)
REFUSED = re.findall(r"^\| `(.*?)` \| `(.*?)` \| `(.*?)` \|$", PAGE, re.M)
GAP = 1
"""Exit code of a diagnosis that finds one."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder with the files that the page says to save there."""
    for name, text in (
        ("gimbal.py", LISTING),
        ("make_log.py", LOG),
        ("gimbal.toml", DESCRIPTION),
    ):
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_example_is_what_the_page_shows() -> None:
    for name, text in (
        ("gimbal.py", LISTING),
        ("make_log.py", LOG),
        ("gimbal.toml", DESCRIPTION),
    ):
        assert (ROOT / "examples" / "gimbal" / name).read_text(encoding="utf-8") == text


def test_commands_print_what_the_page_shows(folder: Path, run: Run) -> None:
    runpy.run_path("make_log.py")
    assert {command.split()[0] for command, _ in COMMANDS} == {
        *("explain", "simulate", "build", "validate", "figures", "check", "identify", "diagnose")
    }
    for command, shown in COMMANDS:
        code, out, err = run(*command.split())
        assert (code, err) == (GAP if command.startswith("diagnose") else 0, ""), command
        printed = out.splitlines()
        for line in shown.splitlines():
            assert line == "..." or any(alike(line, other) for other in printed), (command, line)


def alike(shown: str, printed: str) -> bool:
    """Whether a line is the one shown, numbers but for a few percent."""
    pairs = list(zip(shown.split(), printed.split()))
    return len(pairs) == len(shown.split()) and all(
        one == two or near(one, two) for one, two in pairs
    )


def near(one: str, two: str) -> bool:
    try:
        return float(one) == pytest.approx(float(two), rel=0.05, abs=0.02)
    except ValueError:
        return False


@pytest.mark.parametrize(("written", "instead", "message"), REFUSED)
def test_what_is_refused(folder: Path, written: str, instead: str, message: str) -> None:
    assert LISTING.count(written) >= 1
    path = folder / "gimbal.py"
    path.write_text(LISTING.replace(written, instead, 1), encoding="utf-8")
    with pytest.raises(UserError) as caught:
        actuator(str(path)).plant_of()
    assert "gimbal.py'" in str(caught.value)
    assert message in str(caught.value)
