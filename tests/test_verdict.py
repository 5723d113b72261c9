"""From what was tried to what is said."""

from __future__ import annotations

from servo_models.diagnosis.causes import find_causes
from servo_models.diagnosis.verdict import EFFECTS, decide
from tests.test_search_of_causes import made


def test_of_two_causes_that_are_both_sure_the_larger_one_is_told_first() -> None:
    bench, _ = made({"coulomb_friction.level": 1.5e-3, "drive_saturation.limit": 15.0})
    causes = find_causes(bench)
    verdict = decide(causes)
    assert verdict.kind == EFFECTS
    assert set(causes.taken.effects) == {"coulomb_friction", "drive_saturation"}
    assert verdict.chances["coulomb_friction"] > 0.995
    assert causes.singles[0].effects == ("drive_saturation",)
    assert list(verdict.chances)[:2] == ["drive_saturation", "coulomb_friction"]
