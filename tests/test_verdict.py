"""From what was tried to what is said."""

from __future__ import annotations

import numpy as np

from servo_models.diagnosis.belief import probabilities
from servo_models.diagnosis.causes import find_causes
from servo_models.diagnosis.verdict import EFFECTS, decide
from tests.test_search_of_causes import made


def test_of_two_causes_that_are_both_sure_the_larger_one_is_told_first() -> None:
    bench, _ = made({"transport_delay.time": 1.1e-3, "drive_saturation.limit": 15.0})
    causes = find_causes(bench)
    verdict = decide(causes)
    assert verdict.kind == EFFECTS
    assert set(causes.taken.effects) == {"transport_delay", "drive_saturation"}
    assert verdict.chances["transport_delay"] > 0.995
    assert causes.singles[0].effects == ("drive_saturation",)
    assert list(verdict.chances)[:2] == ["drive_saturation", "transport_delay"]


def test_what_is_surely_missing_makes_near_equals_equal_and_no_more() -> None:
    bench, _ = made({"coulomb_friction.level": 1.5e-3})
    rivals = find_causes(bench).singles[:3]
    plain = probabilities(rivals)
    doubtful = [probabilities(rivals, 50.0 * rival.loss) for rival in rivals]
    assert np.array_equal(probabilities(rivals, 0.0), plain)
    for chances in doubtful:
        assert abs(chances.sum() - 1.0) < 1e-12
        assert np.all(np.argsort(-chances) == np.argsort([rival.loss for rival in rivals]))
        assert chances.max() <= plain.max()
