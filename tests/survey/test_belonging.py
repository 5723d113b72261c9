"""Whom causes belong to, on fleets with a known answer."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servo_models.diagnosis.verdict import OUTSIDE
from servo_models.survey.belonging import BATCH, MODEL, SINGLE, UNIT, Belonging, belongings
from servo_models.survey.job import Outcome
from servo_models.survey.sections import words
from tests.support.made_outcomes import estimate, fleet, outcome

DELAY = {"transport_delay": (0.03, 0.001)}
PLAY = {"backlash": (0.02, 0.001)}
ZONE = {"dead_zone": (0.02, 0.001)}


def told(found: Iterable[Belonging]) -> set[tuple[str, str, str, tuple[str, ...]]]:
    return {(it.name, it.owner, it.whose, tuple(it.joints)) for it in found}


def units(count: int, having: Iterable[int] = ()) -> list[Outcome]:
    """One joint of each, some with a delay."""
    return [outcome(f"{k}", "elbow", DELAY if k in {*having} else {}) for k in range(count)]


def test_a_fleet_with_a_known_answer() -> None:
    expected = {("transport_delay", MODEL, "", ()), ("dead_zone", BATCH, "firmware = 2.1", ())}
    expected |= {("backlash", UNIT, f"unit {k:04}", ()) for k in (3, 20)}
    assert told(belongings(fleet(30, 6))) == expected


@given(st.permutations(range(36)))
def test_the_order_of_jobs_says_nothing(order: list[int]) -> None:
    jobs = tuple(fleet(6, 6, episodes=0, parameters=0))
    assert told(belongings([jobs[k] for k in order])) == told(belongings(jobs))


@pytest.mark.parametrize(("having", "owner"), [(11, MODEL), (7, MODEL), (6, SINGLE), (1, SINGLE)])
def test_what_most_units_have_belongs_to_the_model(having: int, owner: str) -> None:
    assert {it.owner for it in belongings(units(12, range(having)))} == {owner}


def test_it_is_said_in_words() -> None:
    (found,) = belongings(units(12, range(11)))
    assert words(found) == "transport_delay belongs to the model: 30.00 ± 0.30 ms on 11 of 12 units"
    (worn,) = belongings([outcome("7", f"j{k}", PLAY if k < 4 else {}) for k in range(6)])
    assert words(worn) == "backlash belongs to unit 7: 1.146 ± 0.029 deg on 4 of 6 joints"


def test_sizes_that_are_not_alike_are_a_range() -> None:
    jobs = [outcome(f"{k}", "elbow", {"transport_delay": (0.01 * 3**k, 1e-3)}) for k in range(3)]
    (found,) = belongings(jobs)
    assert words(found).endswith("the model: 10 to 90 ms on 3 of 3 units")


def test_sizes_of_several_units_of_measure_are_not_compared() -> None:
    turning, sliding = (outcome("7", joint, PLAY) for joint in ("wrist", "gripper"))
    size = msgspec.structs.replace(sliding.causes[0].sizes[0], unit="m")
    sliding.causes[0].sizes[:] = [size]
    (worn,) = belongings([turning, sliding])
    assert words(worn).endswith("unit 7: of no common size on 2 of 2 joints")


def test_one_unit_has_no_model_and_one_joint_no_unit() -> None:
    assert told(belongings(units(1, [0]))) == {("transport_delay", SINGLE, "0", ("elbow",))}


def test_a_cause_of_one_joint_of_all_units_belongs_to_the_model_of_that_joint() -> None:
    jobs = [
        outcome(f"{k}", joint, PLAY if joint == "wrist" else {})
        for k in range(4)
        for joint in ("base", "elbow", "wrist")
    ]
    assert told(belongings(jobs)) == {("backlash", MODEL, "", ("wrist",))}


def test_a_failed_job_says_nothing() -> None:
    jobs = [*units(3, range(2)), *(outcome(f"x{k}", "elbow", failure="no log") for k in range(9))]
    (found,) = belongings(jobs)
    assert (found.owner, found.asked) == (MODEL, 3)


@pytest.mark.parametrize(("others", "owner"), [(0, BATCH), (1, BATCH), (2, SINGLE)])
def test_a_batch_has_what_few_others_have(others: int, owner: str) -> None:
    """Of 4 and 16 units, a tenth of which is 1.6."""
    jobs = [
        outcome(f"{k:02}", "elbow", DELAY if k < 4 + others else {}, firmware="2" if k < 4 else "1")
        for k in range(20)
    ]
    assert belongings(jobs)[0].owner == owner


def delays(random: np.random.Generator, late: int, by: float) -> list[Outcome]:
    """20 units with 2 joints that have a delay of 30 and 50 ms, longer on the first ``late``."""
    return [
        outcome(
            f"{k:02}",
            joint,
            {"transport_delay": (delay + by * (k < late) + 1e-3 * random.normal(), 1e-3)},
            firmware="2" if k < late else "1",
            day=f"{k // 2}",
        )
        for k in range(20)
        for joint, delay in (("elbow", 0.03), ("wrist", 0.05))
    ]


@pytest.mark.parametrize(
    ("late", "batch", "sizes"), [(3, "2", [0.052, 0.04]), (14, "1", [0.04, 0.052])]
)
def test_fewer_units_may_have_another_size_of_what_all_have(
    late: int, batch: str, sizes: list[float]
) -> None:
    found = belongings(delays(np.random.default_rng(1), late, 0.012))
    few = min(late, 20 - late)
    assert [(it.owner, it.whose, it.asked, len(it.places)) for it in found] == [
        (BATCH, f"firmware = {batch}", few, 2 * few),
        (MODEL, "", 20 - few, 2 * (20 - few)),
    ]
    assert [it.size.mean for it in found if it.size] == pytest.approx(sizes, abs=1e-3)


def test_units_that_are_alike_hardly_ever_have_a_batch_of_another_size() -> None:
    random = np.random.default_rng(2)
    owners = [it.owner for _ in range(50) for it in belongings(delays(random, 8, 0.0))]
    assert owners.count(BATCH) <= 3  # of 50; 1 in 100 is wanted


def test_a_parameter_that_moved_on_most_units_belongs_to_the_model() -> None:
    jobs = [
        outcome(f"{k}", "elbow", parameters=[estimate("inertia", 3.0, 0.05, 1.0, 0.5)])
        for k in range(3)
    ]
    near = [
        outcome(f"{k}", "elbow", parameters=[estimate("inertia", 1.9, 0.05, 1.0, 0.5)])
        for k in range(3)
    ]
    assert told(belongings(jobs)) == {("inertia", MODEL, "", ())}
    assert not belongings(near)


LATE = "transport_delay.time"


def with_delays(delays: Iterable[float | None], late: int, prior: float) -> list[Outcome]:
    """Units whose model has a delay of 5 ms, as re-tuned; None on the bound 0, without an error."""
    return [
        outcome(
            f"{k:02}",
            "elbow",
            parameters=[
                estimate(LATE, delay or 0.0, None if delay is None else 5e-5, 5e-3, prior),
                estimate("inertia", 1.0 + 0.01 * np.sin(k * k), 0.01, 1.0, 0.5),
            ],
            firmware="2" if k < late else "1",
            bench=f"{k % 2}",
        )
        for k, delay in enumerate(delays)
    ]


@pytest.mark.parametrize("prior", [1e-3, 4e-3, 50e-3])
@pytest.mark.parametrize(
    "others", [[5.1e-3, 4.9e-3, 5e-3, 5.05e-3], [None, 2e-5, None, None], [5e-3] * 4]
)
def test_a_firmware_that_is_late_is_told_where_the_delay_is_a_parameter(
    prior: float, others: list[float | None]
) -> None:
    """By 12 ms: 12, 3 and 0.24 standard deviations of what was believed."""
    jobs = with_delays([17e-3, 17.1e-3, 16.9e-3, *others], 3, prior)
    late = [it for it in belongings(jobs) if it.whose]
    assert told(late) == {(LATE, BATCH, "firmware = 2", ())}
    assert words(late[0]).startswith(f"{LATE} belongs to units of firmware = 2: 17.0")
    assert words(late[0]).endswith("3 of 3 units")


def test_a_parameter_on_the_bound_of_its_prior_has_moved() -> None:
    """Where it has no standard error."""
    at_bound = outcome("a", "elbow", parameters=[estimate(LATE, 9e-3, None, 5e-3, 1e-3)])
    (found,) = belongings([at_bound])
    assert words(found) == f"{LATE} belongs to unit a, elbow: of no size that the logs tell"


def test_parameters_of_units_that_are_alike_hardly_ever_set_a_batch_apart() -> None:
    random = np.random.default_rng(4)
    names = [f"parameter_{k}" for k in range(8)]
    owners = []
    for _ in range(50):
        values = 1.0 + 0.1 * random.standard_normal((8, 8))
        jobs = [
            outcome(
                f"{k}",
                "elbow",
                parameters=[estimate(n, v, 0.01, 1.0, 0.5) for n, v in zip(names, row)],
                firmware="2" if k < 3 else "1",
            )
            for k, row in enumerate(values)
        ]
        owners += [it.owner for it in belongings(jobs)]
    assert owners.count(BATCH) <= 3  # of 50 fleets; 1 in 100 is wanted


@pytest.mark.parametrize("other", [{"stopped": "after 60 s"}, {"verdict": OUTSIDE}])
def test_what_was_stopped_or_is_outside_the_catalogue_is_nobodys(other: dict[str, str]) -> None:
    """Whatever owner it would have, and says nothing of what others have."""
    jobs = [*fleet(30, 2, episodes=0, parameters=2), outcome("one", "elbow", ZONE)]
    moved = [estimate("inertia", 3.0, 0.05, 1.0, 0.5)]
    same = [msgspec.structs.replace(it, unit=f"x{it.unit}", parameters=moved) for it in jobs]
    unsure = [msgspec.structs.replace(it, **other) for it in same]
    assert {it.owner for it in belongings(same)} == {MODEL, BATCH, UNIT, SINGLE}
    assert belongings(unsure) == []
    assert belongings([*jobs, *unsure]) == belongings(jobs)


def test_jobs_that_leave_a_choice_are_explained_as_one() -> None:
    """Weights of 0.6 and 0.4 have odds of 1.5 each, 1.5**8 = 25.6 together, beyond 19."""
    weights = {("backlash",): 0.6, ("dead_zone",): 0.4}
    jobs = [outcome(f"{k}", "elbow", PLAY if k % 2 else ZONE, weights) for k in range(8)]
    (found,) = belongings(jobs)
    assert (found.name, found.owner, len(found.places)) == ("backlash", MODEL, 8)
    assert (found.single_set, found.fleet_set) == (2.0, [["backlash"]])
    (few,) = belongings(jobs[:7])  # 17.1
    assert few.fleet_set == [["backlash"], ["dead_zone"]]


def test_causes_of_their_own_are_not_one_by_what_could_hardly_explain_them() -> None:
    """An effect that is in every set with little weight."""
    own = [{name: (0.02, 0.001)} for name in ("backlash", "dead_zone", "cogging", "end_stops")]
    jobs = [
        outcome(f"{k}", "elbow", one, {tuple(one): 0.9, ("lag",): 0.1}) for k, one in enumerate(own)
    ]
    assert {(it.name, it.owner) for it in belongings(jobs)} == {
        (n, SINGLE) for it in own for n in it
    }


def test_a_shared_cause_explains_what_its_set_holds_with_little_weight() -> None:
    unsure = {("lag",): 0.9, ("transport_delay",): 0.1}
    (found,) = belongings(
        [*units(7, range(7)), outcome("slow", "elbow", {"lag": (0.03, 0.001)}, unsure)]
    )
    assert (found.name, found.owner, len(found.places)) == ("transport_delay", MODEL, 8)


def test_what_is_left_beside_a_shared_cause_is_a_choice_of_its_own() -> None:
    both = {("transport_delay", "backlash"): 0.7, ("transport_delay", "dead_zone"): 0.3}
    jobs = [*units(5, range(4)), outcome("worn", "elbow", {**DELAY, **PLAY}, both)]
    shared, worn = belongings(jobs)
    assert (shared.name, len(shared.places), shared.fleet_set) == (
        "transport_delay",
        5,
        [["transport_delay"]],
    )
    assert (worn.name, worn.whose, worn.single_set) == ("backlash", "worn", 2.0)


def test_a_clean_fleet_with_some_false_alarms_blames_no_model() -> None:
    random = np.random.default_rng(3)
    jobs = [
        outcome(f"{u}", f"j{j}", PLAY if random.random() < 0.05 else {}, firmware=f"{u % 3}")
        for u in range(30)
        for j in range(6)
    ]
    assert {it.owner for it in belongings(jobs)} == {SINGLE}
