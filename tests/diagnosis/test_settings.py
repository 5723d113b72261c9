"""What decides a verdict is passed in, told, and refused where it makes no sense."""

from __future__ import annotations

import json
import math
from dataclasses import fields, replace
from pathlib import Path

import pytest

import servo_models
from servo_models.diagnosis.search.selection import select_effects
from servo_models.diagnosis.settings import Settings
from servo_models.errors import UserError
from tests.support.diagnoses import made
from tests.support.schemas import check_schema

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.mark.thorough
def test_no_more_effects_are_taken_than_are_allowed() -> None:
    fitter, _ = made({"coulomb_friction.level": 1.5e-3, "drive_saturation.limit": 15.0})
    assert len(select_effects(fitter).taken.effects) == 2
    one = replace(fitter, settings=Settings(most_effects=1))
    assert len(select_effects(one).taken.effects) == 1


@pytest.mark.thorough
def test_settings_are_told_and_hold_the_schema(tmp_path: Path) -> None:
    settings = Settings(entry_advantage=30.0, fits_alone=4)
    found = servo_models.diagnose(EXAMPLES / "own_plants" / "servo.toml", settings=settings)
    told = json.loads(found.to_json())
    check_schema(told)
    assert Settings(**told["settings"]) == settings
    found.write_report(tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text("utf-8")
    assert "fits_alone 4, entry_advantage 30" in page


@pytest.mark.parametrize("name", [field.name for field in fields(Settings)])
@pytest.mark.parametrize("value", [-1, math.nan, math.inf, "1"])
def test_a_setting_without_meaning_is_refused_by_its_name(name: str, value: object) -> None:
    with pytest.raises(UserError, match=rf"'{name}'.*give a"):
        Settings(**{name: value})  # type: ignore[arg-type]


def test_a_count_is_a_whole_number_from_one() -> None:
    for value in (0, 2.5):
        with pytest.raises(UserError, match="whole number from 1"):
            Settings(most_effects=value)  # type: ignore[arg-type]
