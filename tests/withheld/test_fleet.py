"""The withheld fleet: what is drawn, the figures by hand, and a small one surveyed."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servo_models.survey.result import Survey
from studies import fleet
from studies.second_plant.rigs import FARTHEST, UNCERTAINTY
from tests.support.made_outcomes import estimate, outcome


def test_a_fleet_is_of_one_model_and_scatters_within_half_of_what_its_owner_states() -> None:
    joints = fleet.drawn(1, 9)
    kinds = Counter(it.kind for it in joints)
    assert kinds == {"late": 2 * 6, "worn": 1 * 6, "planted": 6, "clean": 9 * 6 - 24}
    misstated = []
    for it in joints:
        rig = it.rig
        assert rig.nominal == next(one.rig.nominal for one in joints if one.joint == it.joint)
        assert bool(rig.causes) == (it.kind != "clean")
        assert it.kind != "late" or rig.firmware.delay * rig.firmware.tick == pytest.approx(0.012)
        assert it.kind != "worn" or rig.drive.play > 0.0
        for name, value in rig.true.items():
            off = value / rig.nominal[name] - 1.0
            if name == "loop_factor" and it.misstated:
                misstated.append(off)
            else:
                assert abs(off) <= 0.5 * FARTHEST * UNCERTAINTY[name] * (1.0 + 1e-12)
    assert len(misstated) == 9
    assert np.mean(misstated) == pytest.approx(0.15, abs=0.03)


def answer(unit: int, joint: str, kind: str, cause: str = "") -> dict[str, Any]:
    causes = [cause] if cause else []
    told = {"unit": f"u{unit}", "joint": joint, "kind": kind, "misstated": joint == "b"}
    return {**told, "causes": causes}


ANSWERS = [
    *(answer(unit, joint, "late", "delay") for unit in (1, 2) for joint in "ab"),
    *(answer(3, joint, "worn", "play") for joint in "ab"),
    answer(4, "a", "planted", "gravity"),
    answer(4, "b", "clean"),
    answer(5, "a", "planted", "delay"),
    answer(5, "b", "clean"),
    answer(6, "a", "clean"),
    answer(6, "b", "clean"),
]
SAID = {
    **{(f"u{unit}", joint): "transport_delay" for unit in (1, 2) for joint in "ab"},
    ("u3", "a"): "coasting_backlash",
    ("u3", "b"): "coasting_backlash",
    ("u4", "a"): "gravity_load",
    ("u5", "a"): "viscous_friction",
    ("u6", "b"): "drive_lag",
}
UNSURE = {("coasting_backlash",): 0.6, ("backlash",): 0.4}


def made_survey() -> Survey:
    """Two of fifteen causes are not there, and one joint of a worn unit is not sure of its."""
    loop = estimate("loop_factor", 1.15, 0.01, 1.0, 0.05)
    outcomes = []
    for it in ANSWERS:
        place = fleet.place_of(it)
        outcomes.append(
            outcome(
                *place,
                {SAID[place]: (0.012, 1e-4)} if place in SAID else {},
                UNSURE if place == ("u3", "a") else {},
                [loop] if it["misstated"] else [],
                firmware="2.1" if it["kind"] == "late" else "2.0",
            )
        )
    return Survey("made", tuple(outcomes))


def test_figures_counted_by_hand() -> None:
    scored = fleet.Scored(made_survey(), ANSWERS)
    found = {define.__name__: define(scored) for define in fleet.FIGURES}
    assert {name: (one.value, one.n) for name, one in found.items()} == {
        "planted_first": (1 / 2, 2),
        "shared_first": (1.0, 6),
        "false_alarms": (1 / 4, 4),
        "owner_right": (pytest.approx(13 / 14), 14),
        "owner_invented": (pytest.approx(2 / 15), 15),
        "set_size_single": (pytest.approx((5 * 1 + 2 * (2 + 1) / 2) / 7), 7),
        "set_size_fleet": (1.0, 7),
        "seconds": (5.0, 12),
    }


@pytest.mark.long
def test_a_small_fleet_is_surveyed_without_its_answers(tmp_path: Path) -> None:
    out = tmp_path / "study"
    fleet.write(out, "small", fleet.drawn(2, 2, joints=2))
    assert not [*(out / "fleet").rglob("answers*")]
    scored = fleet.scored_survey(out, "small", jobs=1)
    assert not any(it.failure for it in scored.found.outcomes)
    for true, said in scored.of("late"):  # a slow joint hardly tells a delay from a lag
        assert fleet.names_of(true) & {it.effect for it in said.causes if it.in_set}
    figures = json.loads((out / "figures.json").read_text(encoding="utf-8"))["figures"]
    assert figures["false_alarms"] == {**figures["false_alarms"], "value": 0.0, "n": 2}
