"""Outcomes of jobs that nobody ran, with a known answer."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence

import msgspec
import numpy as np

from servo_models.survey.job import VERSION, Cause, Episode, Estimate, Explanation, Outcome

Size = tuple[float, float]
"""Value and standard error."""
WEIGHTS: Mapping[tuple[str, ...], float] = {}


def estimate(
    name: str, value: float, error: float | None, nominal: float = 0.0, prior: float | None = None
) -> Estimate:
    unit = "s" if name.endswith("time") else "rad" if name.endswith("half_width") else "kg.m2"
    return Estimate(name, unit, nominal, prior, float(value), error)


def outcome(
    unit: str,
    joint: str,
    effects: Mapping[str, Size] | None = None,
    weights: Mapping[tuple[str, ...], float] = WEIGHTS,
    parameters: Sequence[Estimate] = (),
    episodes: Sequence[Sequence[Estimate]] = (),
    gap: float = 10.0,
    failure: str = "",
    **conditions: str,
) -> Outcome:
    """A job with these effects taken, each with the size of its first parameter, ``NAME.time`` of
    a delay and ``NAME.half_width`` of others."""
    taken = effects or {}
    explanations = weights or ({tuple(taken): 1.0} if taken else {})
    names = dict.fromkeys([*taken, *(name for effects in explanations for name in effects)])
    suffix = {name: "time" if "delay" in name else "half_width" for name in names}
    sizes = {
        name: [estimate(f"{name}.{suffix[name]}", *taken.get(name, (0.01, 0.001)))]
        for name in names
    }
    verdict = "" if failure else ("effect" if len(taken) == 1 else "effects") if taken else "no-gap"
    before = None if failure else gap if taken else 0.9
    return Outcome(
        schema_version=VERSION,
        key=hashlib.sha256(f"{unit} {joint} {conditions}".encode()).hexdigest(),
        unit=unit,
        joint=joint,
        conditions=conditions,
        description=f"{unit}_{joint}.toml",
        actuator="sg90",
        variant="measured",
        failure=failure,
        seconds=5.0,
        warnings=[],
        verdict=verdict,
        sentence="",
        gap_before=before,
        gap_before_interval=before and (0.9 * before, 1.1 * before),
        gap_after=before and 1.0,
        held_out=before and 1.1,
        causes=[Cause(name, name in taken, True, 0.9, sizes[name]) for name in names],
        explanations=[Explanation(effects, weight) for effects, weight in explanations.items()],
        parameters=list(parameters),
        episodes=[
            Episode(f"log_{k}.csv", k == 0, 1.0, list(values)) for k, values in enumerate(episodes)
        ],
        diagnosis=msgspec.Raw(b"null"),
    )


def fleet(units: int, joints: int, episodes: int = 3, parameters: int = 8) -> Iterator[Outcome]:
    """Yield jobs with a delay on all, a dead zone on the units of one firmware, play on every 17th
    unit; each parameter with 10 % between units and 5 % between episodes."""
    random = np.random.default_rng(0)
    names = [f"parameter_{k}" for k in range(parameters)]
    for u in range(units):
        new, worn = u % 3 == 1, u % 17 == 2
        for j in range(joints):
            effects = {"transport_delay": (0.03 + 0.001 * random.normal(), 0.0005)}
            if new:
                effects["dead_zone"] = (0.02 + 0.001 * random.normal(), 0.001)
            if worn:
                effects["backlash"] = (0.036 + 0.002 * random.normal(), 0.001)
            own = 1.0 + 0.1 * random.normal(size=parameters)
            each = own + 0.05 * random.normal(size=(episodes, parameters))
            yield outcome(
                f"unit {u + 1:04}",
                f"joint_{j + 1}",
                effects,
                parameters=[
                    estimate(name, value, 0.02, 1.0, 0.3) for name, value in zip(names, own)
                ],
                episodes=[
                    [estimate(name, value, 0.03, 1.0, 0.3) for name, value in zip(names, values)]
                    for values in each
                ],
                gap=10.0 + 5.0 * worn + random.exponential(),
                firmware="2.1" if new else "2.0",
            )
