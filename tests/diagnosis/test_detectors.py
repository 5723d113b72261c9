"""Codes and ticks: what speaks for a quantiser or a hold apart from any error."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from servo_models.diagnosis.clock import Answers
from servo_models.diagnosis.detectors import DOUBTFUL_PROBABILITY, Codes, detection, sentence
from servo_models.diagnosis.fitting.fitted_model import FittedModel
from servo_models.diagnosis.sections import pictures
from servo_models.report.style import figure
from tests.support.diagnoses import made, with_hold

STEP, NOISE = 4e-3, 5e-4
QUANTISER = "sensor_quantisation"


def with_codes(truth: dict[str, float], step: float) -> FittedModel:
    fitter, every = made(truth, NOISE)
    values = {free.name: free.nominal for free in fitter.nominal} | {f"{QUANTISER}.step": step}
    return fitter.unfit((QUANTISER,), every[QUANTISER].free, values)


def test_codes_are_as_bunched_as_the_noise_after_them_allows() -> None:
    """The characteristic function of normal noise (Widrow, Kollar 2008)."""
    seen = detection(with_codes({f"{QUANTISER}.step": STEP}, STEP), QUANTISER)
    assert isinstance(seen, Codes)
    expected = math.exp(-2.0 * (math.pi * NOISE / STEP) ** 2)
    assert seen.bunched == pytest.approx(expected, abs=0.03)
    assert seen.chance < 1e-3
    assert np.max(np.abs(seen.phases)) <= 0.5
    assert "angle bunches at codes 0.229 deg apart" in sentence(seen)
    assert "by chance below 0.001" in sentence(seen)


def test_another_step_than_the_true_one_is_not_confirmed() -> None:
    seen = detection(with_codes({f"{QUANTISER}.step": STEP}, 0.618 * STEP), QUANTISER)
    assert seen is not None
    assert seen.chance > DOUBTFUL_PROBABILITY
    assert sentence(seen).endswith("which confirms nothing")


def test_a_hold_is_asked_by_its_clock_and_other_effects_not_at_all() -> None:
    found = with_hold({"sample_hold.period": 2.43e-3}, 2.43e-3)
    seen = detection(found, "sample_hold")
    assert isinstance(seen, Answers)
    assert "5 steps of the command are answered" in sentence(seen)
    assert "bunched at ticks every 2.43 ms" in sentence(seen)
    assert detection(found, "command_quantisation") is None  # no output of that name
    assert detection(found, "transport_delay") is None


def test_the_page_draws_what_each_detector_sees() -> None:
    codes = detection(with_codes({f"{QUANTISER}.step": STEP}, STEP), QUANTISER)
    ticks = detection(with_hold({"sample_hold.period": 2.43e-3}, 2.43e-3), "sample_hold")
    found: Any = SimpleNamespace(
        ranking=[SimpleNamespace(detected=it) for it in (codes, ticks, None)]
    )
    shown = pictures.detectors(found)
    assert [it.title for it in shown] == [
        "angle, folded at the step",
        "When steps of the command are answered, period 2.43 ms",
    ]
    for drawn, seen in zip(shown, (codes, ticks)):
        assert seen is not None
        assert sentence(seen) in drawn.text
        assert figure(drawn).axes[0].has_data()
    found.ranking = [SimpleNamespace(detected=None)]
    assert pictures.detectors(found) == ()


@pytest.mark.parametrize("seed", range(5))
def test_where_a_reading_rests_is_no_code(seed: int) -> None:
    """Eight levels anywhere, each for 150 samples, with noise: some step bunches most."""
    random = np.random.default_rng(seed)
    levels = np.repeat(random.uniform(-0.02, 0.02, 8), 150) + 4e-5 * random.standard_normal(1200)
    fitter, every = made({})
    (log,) = fitter.logs
    still = replace(log, outputs={"angle": levels})
    fitter = replace(fitter, logs=[still])
    steps = np.geomspace(8e-4, 1e-2, 60)
    nominal = {free.name: free.nominal for free in fitter.nominal}
    seen = [
        detection(fitter.unfit((QUANTISER,), every[QUANTISER].free, {**nominal, **size}), QUANTISER)
        for size in ({f"{QUANTISER}.step": step} for step in steps)
    ]
    assert max(it.bunched for it in seen if it) > 0.5
    assert min(it.chance for it in seen if it) > DOUBTFUL_PROBABILITY
