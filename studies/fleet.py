"""A withheld fleet: what a survey says of it against what is true of every joint.

::

    python -m studies fleet OUT --seed 1 --score

    OUT/fleet/joints.csv, unit_07/joint_3.toml, joint_3_steps.csv, joint_3_moves.csv
    OUT/answers.json      what is true of every joint, and is not surveyed
    OUT/survey/           what the survey keeps; it goes on where it was ended
    OUT/figures.json      and joints that went wrong; with ``--score``

Units are of one model with six joints, each a servo of ``studies.second_plant`` with two masses.
A true value scatters about the nominal one of the model by half of the uncertainty that the owner
states: his holds the error of the model as well.  Beside that

* *late*: 8 of 30 units have firmware 2.1, which sees every goal 12 ms later;
* *worn*: 2 of 30 units have play in all their gears;
* *planted*: 20 of 180 joints, in other units, have a cause of their own;
* the model's last joint has a loop factor that is 15 % more than the nominal one, in every unit;
* all other joints are *clean*, those with that loop factor too: no effect is to be named there.

What names a cause is in ``second_plant.rigs``.  Bars are those of 20 causes and 160 clean joints.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from servo_models.cli.console import progress, show
from servo_models.diagnosis.verdict import NO_GAP, PARAMETERS
from servo_models.errors import UserError
from servo_models.files import being_written, write_whole
from servo_models.report.interchange import conditions, plain
from servo_models.report.result import Report
from servo_models.report.sections import Section, Table
from servo_models.survey.belonging import BATCH, MODEL, SINGLE, UNIT, Belonging
from servo_models.survey.job import Outcome
from servo_models.survey.survey import Survey, survey
from servo_models.withheld.score import Statistic, mean, share
from servo_models.withheld.sections import AT_LEAST, AT_MOST, COLUMNS, Bar, figure_rows
from studies.second_plant import rigs
from studies.second_plant.judge import sets_of
from studies.second_plant.rigs import FARTHEST, MOTORS, UNCERTAINTY, Rig

CLEAN, PLANTED, WORN, LATE = "clean", "planted", "worn", "late"
JOINTS = 6
LATE_SHARE, WORN_SHARE = 8 / 30, 2 / 30  # of the units
PLANTED_SHARE = 20 / 180  # of the joints
CAUSES = ("delay", "play", "gravity", *rigs.LIMITS)
"""Of joints with a cause of their own, in turn.  Without what nominal parameters imitate where no
load is known: inertia, friction, and a viscous drag, which acts as a larger torque constant."""
SHARED = {LATE: "delay", WORN: "play"}
LATE_FIRMWARE, LATE_BY = "2.1", 0.012  # of late units, and its delay [s]
SCATTER = 0.5  # standard deviation between units over the uncertainty that the owner states
MISSTATED, MISSTATED_BY = "loop_factor", 0.15
"""The nominal value that is wrong, and the share that it lacks."""
NOISE = (0.2, 0.8)  # standard deviation of the encoder before it counts [codes]
ROW_SECONDS = 0.01
ROW_TICKS = 5  # of the firmware; one of twice the rate doubles the time of a diagnosis
LOG_ROWS = 400

Place = tuple[str, str]
"""Unit and joint."""
Answer = Mapping[str, Any]


@dataclass(frozen=True)
class Joint:
    """A joint of a unit: how it came by its cause, and its rig, which is true."""

    unit: str
    joint: str
    kind: str
    misstated: bool
    rig: Rig

    def answer(self) -> Answer:
        """What is true, as JSON has it."""
        told = {name: it for name, it in vars(self).items() if name != "rig"}
        return {**self.rig.answer(), "nominal": dict(self.rig.nominal), **told}


def drawn(seed: int, units: int, joints: int = JOINTS) -> list[Joint]:
    """Draw a fleet: its model, which units are late or worn, and which joints have a cause."""
    rng = np.random.default_rng(seed)
    model = [_designed(rng) for _ in range(joints)]
    order = rng.permutation(units).tolist()
    late, worn = round(LATE_SHARE * units), round(WORN_SHARE * units)
    kinds = dict.fromkeys(order[:late], LATE) | dict.fromkeys(order[late : late + worn], WORN)
    others = [(unit, joint) for unit in order[late + worn :] for joint in range(joints - 1)]
    chosen = rng.permutation(others)[: round(PLANTED_SHARE * units * joints)].tolist()
    planted = {(u, j): CAUSES[i % len(CAUSES)] for i, (u, j) in enumerate(chosen)}
    found = []
    for unit, joint in np.ndindex(units, joints):
        kind = kinds.get(unit, PLANTED if (unit, joint) in planted else CLEAN)
        cause = SHARED.get(kind) or planted.get((unit, joint), "")
        given = {"delay": LATE_BY} if kind == LATE else {}
        misstated = joint == joints - 1
        own = np.random.default_rng([seed, unit, joint])
        rig = _made(model[joint], cause, given, misstated, own)
        found.append(Joint(f"unit_{unit + 1:02d}", f"joint_{joint + 1}", kind, misstated, rig))
    return found


def _designed(rng: np.random.Generator) -> Rig:
    """A joint as it was designed, with a friction that its owner knows."""
    while True:
        rig = rigs.build("", "two_mass", (), {}, rng)
        ticks = round(ROW_SECONDS / rig.firmware.tick)
        if "coulomb_friction.level" in rig.true and ticks == ROW_TICKS:
            goals = tuple(goal[:LOG_ROWS] for goal in rigs.goals(ROW_SECONDS, rng))
            return replace(rig, ticks=ROW_TICKS, goals=goals, nominal=rig.true)


def _made(
    model: Rig, cause: str, given: Mapping[str, float], misstated: bool, rng: np.random.Generator
) -> Rig:
    """A joint as it was made, with a cause or "" for none; a limit is drawn until it binds."""
    motor = next(it for it in MOTORS if it.supply == model.firmware.supply)
    off = {}
    for name in model.nominal:
        apart = float(np.clip(rng.standard_normal(), -FARTHEST, FARTHEST))
        off[name] = 1.0 + SCATTER * UNCERTAINTY[name] * apart
    if misstated:
        off[MISSTATED] *= 1.0 + MISSTATED_BY
    drive, firmware, rubs = model.drive, model.firmware, off["coulomb_friction.level"]
    rig = replace(
        model,
        causes=(cause,) if cause else (),
        drive=replace(
            drive,
            torque_constant=off["torque_constant"] * drive.torque_constant,
            resistance=off["resistance"] * drive.resistance,
            motor_inertia=off["inertia"] * drive.motor_inertia,
            output_inertia=off["inertia"] * drive.output_inertia,
            motor_friction=rubs * drive.motor_friction,
            output_friction=rubs * drive.output_friction,
        ),
        firmware=replace(
            firmware,
            stiffness=off["loop_factor"] * firmware.stiffness,
            noise=float(rng.uniform(*NOISE)),
        ),
        true={name: off[name] * value for name, value in model.nominal.items()},
        seed=int(rng.integers(2**31)),
    )
    made = rigs.with_causes(rig, motor, given, rng)
    while cause in rigs.LIMITS and not rigs.binds(made, cause):
        made = rigs.with_causes(rig, motor, given, rng)
    return made


def write(out: Path, title: str, fleet: Sequence[Joint]) -> None:
    """Write a fleet and its answers into a new folder, whole or not at all."""
    table = ["log,unit,joint,firmware,date"]
    with being_written(out) as part:
        for it in fleet:
            folder = part / "fleet" / it.unit
            folder.mkdir(parents=True, exist_ok=True)
            for name, text in rigs.recording(it.rig, f"{it.joint}.toml", f"{it.joint}_").items():
                (folder / name).write_text(text, encoding="utf-8")
            firmware = LATE_FIRMWARE if it.kind == LATE else "2.0"
            date = np.datetime64("2026-03-02") + int(it.unit.removeprefix("unit_"))
            table.append(f"{it.unit}/{it.joint}.toml,{it.unit},{it.joint},{firmware},{date}")
        (part / "fleet" / "joints.csv").write_text("\n".join([*table, ""]), encoding="utf-8")
        answers = {"fleet": title, "joints": [it.answer() for it in fleet]}
        (part / "answers.json").write_text(json.dumps(answers, indent=1), encoding="utf-8")
        part.rename(out)


@dataclass(frozen=True)
class Scored:
    """A survey beside the answers."""

    found: Survey
    answers: Sequence[Answer]

    def of(self, *kinds: str) -> Iterator[tuple[Answer, Outcome]]:
        """Yield what is true and what is said of joints of some kinds."""
        for answer in self.answers:
            if answer["kind"] in kinds:
                yield answer, self.found.by_place[place_of(answer)]

    def told(self) -> Iterator[tuple[Place, Belonging, bool]]:
        """Yield what the survey gives to somebody, for each joint, and whether it is his."""
        answers = {place_of(answer): answer for answer in self.answers}
        for told in self.found.belongings:
            whose = (told.owner, told.whose)
            for place in told.places:
                true = owners_of(answers[place])
                yield place, told, any(told.name in names and whose == his for names, his in true)


def place_of(answer: Answer) -> Place:
    """Return unit and joint."""
    return answer["unit"], answer["joint"]


def owners_of(answer: Answer) -> Iterator[tuple[frozenset[str], tuple[str, str]]]:
    """Yield what names each cause of a joint, and whose it is, as a survey says it."""
    unit, kind = answer["unit"], answer["kind"]
    owners = {
        PLANTED: (SINGLE, unit),
        WORN: (UNIT, unit),
        LATE: (BATCH, f"firmware = {LATE_FIRMWARE}"),
    }
    if kind != CLEAN:
        yield names_of(answer), owners[kind]
    if answer["misstated"]:
        yield frozenset({MISSTATED}), (MODEL, "")


def names_of(answer: Answer) -> frozenset[str]:
    """Return every effect that names the cause of a joint."""
    return frozenset[str]().union(*sets_of(answer["causes"]))


def is_right(answer: Answer, said: Outcome) -> bool:
    """Return whether the most probable effect that is named is the cause; for a clean joint,
    whether the verdict is ``no-gap`` or ``parameters``."""
    if answer["kind"] == CLEAN:
        return said.verdict in (NO_GAP, PARAMETERS)
    return any(it.taken for it in said.causes) and said.causes[0].effect in names_of(answer)


def planted_first(scored: Scored) -> Statistic:
    """Joints with a cause of their own: the most probable effect is it."""
    return share(is_right(*it) for it in scored.of(PLANTED))


def shared_first(scored: Scored) -> Statistic:
    """Joints of late and of worn units: the most probable effect is the delay, or play."""
    return share(is_right(*it) for it in scored.of(LATE, WORN))


def false_alarms(scored: Scored) -> Statistic:
    """Clean joints: another verdict than ``no-gap`` or ``parameters``."""
    return share(not is_right(*it) for it in scored.of(CLEAN))


def owner_right(scored: Scored) -> Statistic:
    """Causes, once for each joint that has them: given to whom they belong."""
    right = {(place, told.owner) for place, told, is_his in scored.told() if is_his}
    return share(
        (place_of(answer), owner) in right
        for answer in scored.answers
        for _, (owner, _) in owners_of(answer)
    )


def owner_invented(scored: Scored) -> Statistic:
    """What the survey gives to somebody, once for each joint: it is not his."""
    return share(not is_his for _, _, is_his in scored.told())


def set_size_single(scored: Scored) -> Statistic:
    """Effects that the survey gives to whom they belong, once for each joint: explanations in the
    set of 95 % of one job, the mean of those that share the effect."""
    return mean(told.single_set for told in _effects(scored))


def set_size_fleet(scored: Scored) -> Statistic:
    """The same: explanations in the set of all jobs that share the effect."""
    return mean(len(told.fleet_set) for told in _effects(scored))


def _effects(scored: Scored) -> Iterator[Belonging]:
    return (told for _, told, is_his in scored.told() if is_his and told.owner != MODEL)


def seconds(scored: Scored) -> Statistic:
    """Time [s] that a job took."""
    return mean(it.seconds for it in scored.found.outcomes)


FIGURES = (
    planted_first,
    shared_first,
    false_alarms,
    owner_right,
    owner_invented,
    set_size_single,
    set_size_fleet,
    seconds,
)
BARS: dict[str, Bar] = {
    "planted_first": (AT_LEAST, 18 / 20),
    "false_alarms": (AT_MOST, 5 / 160),
    "owner_right": (AT_LEAST, 0.9),
}


def scored_survey(out: Path, title: str, jobs: int | None) -> Scored:
    """Survey the fleet in a folder, and write its figures.

    Raises:
        UserError: it is another one; see ``survey``.
    """
    answers = json.loads((out / "answers.json").read_text(encoding="utf-8"))
    if answers["fleet"] != title:
        raise UserError(f"'{out}' holds {answers['fleet']}, not {title}: name a new folder")
    with progress("surveying") as tell:
        table, folder = out / "fleet" / "joints.csv", out / "survey"
        found = survey(table, folder, jobs=jobs, reports=False, tell=tell)
    scored = Scored(found, answers["joints"])
    wrong = [
        {**answer, "said": said.failure or said.sentence}
        for answer, said in scored.of(CLEAN, PLANTED, WORN, LATE)
        if not is_right(answer, said)
    ]
    figures = {define.__name__: define(scored) for define in FIGURES}
    document = {"fleet": title, "versions": conditions(), "figures": figures, "wrong": wrong}
    write_whole(out / "figures.json", f"{json.dumps(plain(document), indent=1)}\n".encode())
    return scored


def main() -> int:
    """Run the command line; 0 done, 2 could not run."""
    parser = argparse.ArgumentParser(prog="python -m studies fleet")
    parser.add_argument("out", type=Path, help="folder of the fleet, its answers and its survey")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--units", type=int, default=30, help="of six joints each")
    parser.add_argument("--score", action="store_true", help="survey it and score what is said")
    parser.add_argument("--jobs", type=int, help="processes of the survey")
    given = parser.parse_args()
    if given.units < 1 or given.seed < 0:
        parser.error("give 1 unit or more and a seed of 0 or more")
    try:
        title = f"a fleet of {given.units} units, seed {given.seed}"
        if not given.out.exists():
            write(given.out, title, drawn(given.seed, given.units))
        if given.score:
            scored = scored_survey(given.out, title, given.jobs)
            table = Table("", COLUMNS, tuple(figure_rows(FIGURES, BARS, scored, wanted=1)))
            show(Report("withheld fleet", title, sections=(Section("Figures", tables=(table,)),)))
    except (UserError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
