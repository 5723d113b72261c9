"""Real logs and logs of the papers' own gap, with what is known of each.

What a log is known to show comes from its authors, or from fits that the diagnosis has no part in.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from servo_models.data.audit import LEAST_GAP

ROOT = Path(__file__).parent.parent
REAL = ROOT / "examples" / "real_logs"
PAPERS = ROOT / "examples" / "papers_gap"
MEAN_ABSOLUTE, RMS = "mean absolute", "RMS"
COUNT = np.radians(7.75)
"""Rate [rad/s] that the description of the SG90 takes for a count of its gyro."""


@dataclass(frozen=True)
class Bar:
    """A held-out error to reach: of an output, in ``unit`` of size ``scale`` [SI]."""

    output: str
    limit: float
    unit: str
    scale: float
    measure: str = RMS


@dataclass(frozen=True)
class Case:
    """A log, and what is known of it.

    Attributes:
        file: of the description.
        known: in words, with its origin.
        named: of each group an effect has to be named.
        absent: effects that must not be named.
        possible: known effects that a log need not show.
        bars: held-out errors to reach.
        tolerance: gap [noise floors] that counts as none.
        before: verdict, effects and held-out noise floors of the diagnosis of commit cae452d.
        remark: on what was found, looked into by hand.
    """

    title: str
    file: Path
    known: str
    named: tuple[frozenset[str], ...] = ()
    absent: frozenset[str] = frozenset()
    possible: frozenset[str] = frozenset()
    bars: tuple[Bar, ...] = ()
    tolerance: float = LEAST_GAP
    before: str = ""
    remark: str = ""


def one_of(*names: str) -> frozenset[str]:
    return frozenset(names)


def joint(name: str, limit: float, before: str, remark: str = "") -> Case:
    """A joint of the SO-101 arm."""
    return Case(
        f"SO-101, {name.replace('_', ' ')}",
        REAL / "diagnosis" / f"so101_{name}.toml",
        "A dead zone of the error and Coulomb friction explain these motions alike, so both"
        " belong in the set; neither explains the motions of ±0.04 rad.",
        (one_of("error_dead_zone"), one_of("coulomb_friction")),
        bars=(Bar("angle_reading", limit, "mrad", 1e-3),),
        before=before,
        remark=remark,
    )


CASES = {
    "emps": Case(
        "EMPS: a linear drive in its position loop",
        REAL / "diagnosis" / "emps.toml",
        "Its authors give Coulomb friction of 20.4 N and an offset of -3.16 N; friction that"
        " falls with speed has not been shown, a fit of it comes out with the wrong sign.",
        (one_of("coulomb_friction"),),
        one_of("stribeck_friction"),
        bars=(Bar("position", 3.7, "um", 1e-6), Bar("drive", 0.15, "V", 1.0)),
        before="`outside-catalogue`, coulomb_friction, 88.5 -> 14.9",
    ),
    "sg90_steps": Case(
        "SG90: steps read by a gyro",
        REAL / "diagnosis" / "sg90_steps.toml",
        "[Fits of their own](sg90_measured.md) say drive saturation, a delay and the frame, of"
        " 20.002 ms by all 52 steps; the half that is fitted, 8 s apart, cannot tell a period from"
        " its aliases. Steps as large as these cannot show a dead zone or Coulomb friction.",
        (one_of("supply_limit", "drive_saturation"), one_of("transport_delay")),
        one_of("drive_dead_zone", "dead_band", "coulomb_friction"),
        one_of("sample_hold"),
        (Bar("rate_reading", 4.5, "counts", COUNT),),
        before="`outside-catalogue`, transport_delay, sample_hold, drive_saturation, 100 -> 13.6",
        remark="The period of the frame is an alias of the 20 ms that all steps show.",
    ),
    "sg90_video": Case(
        "SG90, filmed: what the variant `measured` misses of another unit",
        REAL / "diagnosis" / "sg90_video.toml",
        "[The film](sg90_measured.md) swings by 180 degrees with 0.1 and 0.8 degrees of overshoot;"
        " the variant overshoots by 5.8. Why is not known, and the clock of the commands is late."
        " Other SG90 act on pulses that come every 20 ms.",
        possible=one_of("sample_hold"),
        tolerance=1.0,
        before="`effect`, sample_hold, 1.11 -> 0.471",
        remark="A frame that drifts past the commands makes repeats differ. This stands on a"
        " hundred samples, and on those held out little is gained.",
    ),
    "so101_wrist_roll": joint(
        "wrist_roll", 5.0, "`outside-catalogue`, drive_dead_zone, 6.11 -> 3.32"
    ),
    "so101_rotation": joint(
        "rotation",
        4.7,
        "`outside-catalogue`, drive_dead_zone, 3.68 -> 2.22",
        "The dead zone that the fitted motions prefer keeps about a tenth of its half width;"
        " one that keeps nearly all of it meets the motions held out to 4.6 mrad, but leaves 5 %"
        " more of those that are fitted, so a diagnosis that may not look at the former has no"
        " reason to take it.",
    ),
    "xl330": Case(
        "XL330: a smart servo with a pendulum",
        REAL / "diagnosis" / "xl330.toml",
        "Duclusaud et al. found friction that grows with the load; Coulomb friction alone gains"
        " nothing on the gain held out. No model in reach gets below 20 steps of the encoder. The"
        " rig ran at 7.4 V and not at the data sheet's 5 V; its pendulum is in the inertia.",
        (one_of("load_friction"),),
        bars=(Bar("angle_reading", 34.0, "mrad", 1e-3, MEAN_ABSOLUTE),),
        before="`outside-catalogue`, load_friction, 502 -> 96.5",
    ),
    "odrive_nocomp": Case(
        "ODrive, compensation of cogging off: a motor that turns slowly in its speed loop",
        REAL / "diagnosis" / "odrive_nocomp.toml",
        "The experimenter switched the compensation of cogging. Off, position deviates from a"
        " ramp by 32 counts at 7 periods a turn, 31 at 28, 16 at 14 and 16 at 36.",
        (one_of("cogging"),),
        remark="The sines of the cogging are those at 7, 28 and 14 periods a turn, and one at 12"
        " instead of 36, the fourth that is known.",
    ),
    "odrive_comp": Case(
        "ODrive, compensation of cogging on",
        REAL / "diagnosis" / "odrive_comp.toml",
        "The same motor with the compensation on: 6 counts at 7 periods a turn are left, 2.6 at 28,"
        " 3 at 14 and 2.5 at 36.",
        possible=one_of("cogging"),
    ),
    "torque_motor": Case(
        "The valve paper: Table 1 as the simulation, eq. 12 as the plant",
        PAPERS / "torque_motor.toml",
        "A transport delay of 1.1 ms is all that the model lacks; K_t is 19 % and L 12 % lower"
        " than measured one by one.",
        (one_of("transport_delay"),),
        before="`effect`, transport_delay, 118 -> 0.997",
    ),
    "sg90": Case(
        "The servo paper: linear eq. 7 as the simulation, the printed nonlinear servo as the plant",
        PAPERS / "sg90.toml",
        "Left out of the plant one at a time, the dead zone changes this angle by 328 noise"
        " levels, the asymmetry of its edges by 54, the levels of the command by 19, the top speed"
        " by 7 and the frame by 0, since the log's rows fall on the frames: it can show all but"
        " the frame.",
        (
            one_of("drive_dead_zone"),
            one_of("direction_asymmetry"),
            one_of("command_quantisation"),
            one_of("drive_saturation", "supply_limit"),
        ),
        before="`effect`, drive_dead_zone, 342 -> 39",
        remark="The asymmetry of the dead zone's edges has no twin in the catalogue, whose"
        " asymmetry is one of the gain; and without it no further effect earns its place.",
    ),
}
