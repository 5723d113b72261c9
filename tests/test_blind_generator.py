"""The generator of withheld cases against the product's own simulation, and its bookkeeping."""

from __future__ import annotations

import hashlib
import json
import math
import re
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import kstest, norm

from servo_models.blind.answers import unlock
from servo_models.blind.generator.bench import BENCHES, Bench
from servo_models.blind.generator.case import (
    HIDDEN,
    LEAST_VALUE,
    RATIO,
    VISIBLE,
    Acting,
    draw_experiment,
    sized,
)
from servo_models.blind.generator.cause import Cause, draw
from servo_models.blind.generator.effects import CATALOGUE
from servo_models.blind.generator.excitation import Plan, large_step, rich
from servo_models.blind.generator.experiment import Experiment
from servo_models.blind.generator.files import generate
from servo_models.blind.generator.foreign import FOREIGN
from servo_models.catalogue import actuator
from servo_models.description import Description, read_description
from servo_models.errors import UserError
from servo_models.reference.torque_motor import Constants, Contact
from servo_models.simulate import model, simulate

Array = NDArray[np.float64]

SERVO, MOTOR = BENCHES
CASES, SEED = 36, 20

every_bench = pytest.mark.parametrize("bench", BENCHES, ids=lambda b: b.actuator)


def experiment(bench: Bench, plans: tuple[Plan, ...], load: float = 0.0) -> Experiment:
    """The nominal rig; its delay is a whole number of steps."""
    return Experiment(bench, bench.nominal, load, plans, (0, 1), seed=5)


def product(e: Experiment, parameters: dict[str, float]) -> tuple[Array, ...]:
    """What the product's own simulation says, one array per log as the experiment's."""
    chosen = model(e.bench.actuator, e.bench.variant, {**e.true, **parameters})
    logs = []
    for plan in e.plans:
        rows = np.arange(len(plan.command))
        times = np.concatenate([[0.0], e.bench.settle + rows * plan.stride * e.bench.step])
        command = np.concatenate([plan.command[:1], plan.command])
        found = simulate(chosen, times, {e.bench.command.name: command, "load_torque": e.load})
        names = [s.name for s, place in e.bench.readings if place in e.readings]
        logs.append(np.column_stack([found[name][1:] for name in names]))
    return tuple(logs)


def rms(one: tuple[Array, ...], other: tuple[Array, ...]) -> float:
    """RMS difference in the judged reading."""
    apart = np.concatenate([a[:, 0] - b[:, 0] for a, b in zip(one, other)])
    return float(np.sqrt(np.mean(apart * apart)))


def ladder(bench: Bench) -> tuple[Plan, ...]:
    """Steps beyond any amplitude that is drawn: the servo's drive and the motor's stops."""
    levels = np.array([0.0, 1.2, -1.6, 1.6, 0.1, -0.1]) * bench.amplitude[1]
    stride = bench.sampling[0]
    rows = round(3.0 * bench.slowest / (stride * bench.step))
    return (Plan(stride, bench.rest + np.repeat(levels, rows)),)


PLANS = {
    "rich": lambda bench: rich(bench, np.random.default_rng(1), 1),
    "sparse": lambda bench: rich(bench, np.random.default_rng(2), 4),
    "large step": lambda bench: large_step(bench, np.random.default_rng(3)),
    "ladder": ladder,
}


@every_bench
@pytest.mark.parametrize("excitation", PLANS)
@pytest.mark.parametrize("load", [0.0, 0.5])
def test_without_a_cause_it_is_the_products_model(
    bench: Bench, excitation: str, load: float
) -> None:
    e = experiment(bench, PLANS[excitation](bench), load * bench.load[1])
    for own, other in zip(e.plain, product(e, {})):
        assert np.all(np.abs(own - other).max(axis=0) < 1e-3 * np.ptp(other, axis=0))


SAME = 0.01
OTHER_LAW = {
    "coulomb_friction": 0.03,
    "load_friction": 0.03,
    "stribeck_friction": 0.06,
    "hysteresis": 0.15,
    "end_stops": 0.06,
    "backlash": 0.03,
}
"""Where the law is another one on purpose: part of the gap that may differ."""


class Subject(NamedTuple):
    bench: Bench
    cause: Cause


SUBJECTS = [Subject(bench, cause) for bench in BENCHES for cause in CATALOGUE[bench.actuator]]
FOREIGNERS = [Subject(bench, cause) for bench in BENCHES for cause in FOREIGN[bench.actuator]]


def title(subject: Subject) -> str:
    return f"{subject.bench.actuator}-{subject.cause.name}-{subject.cause.size.name}"


def acting(subject: Subject, share: float) -> tuple[Experiment, Acting]:
    """A cause that makes a gap of ``share`` of the range."""
    bench = subject.bench
    plans = rich(bench, np.random.default_rng(1), 1)
    e = experiment(bench, plans, load=bench.load[1])
    drawn = draw(subject.cause, np.random.default_rng(4))
    return e, sized(e, drawn, share * float(e.ranges[0]), 0.2)


@pytest.mark.parametrize("subject", SUBJECTS, ids=title)
def test_a_cause_is_the_products_effect_of_that_size(subject: Subject) -> None:
    e, found = acting(subject, 0.02)
    assert VISIBLE[0] < found.gap / e.ranges[0] < VISIBLE[1]
    theirs = product(e, found.parameters(e.bench))
    bound = OTHER_LAW.get(found.name, SAME)
    if title(subject) == "sg90-sensor_quantisation-step":
        bound = 0.1  # it chatters between codes at the pace of either integrator
    assert rms(e.logs(found.settings(e)), theirs) < bound * found.gap


@pytest.mark.parametrize("subject", FOREIGNERS, ids=title)
def test_a_foreign_cause_shows_and_is_none_of_the_catalogue(subject: Subject) -> None:
    e, found = acting(subject, 0.02)
    assert VISIBLE[0] < found.gap / e.ranges[0] < VISIBLE[1]
    assert found.name not in actuator(e.bench.actuator).plant_of("measured").placements


@every_bench
def test_every_name_is_one_of_the_products(bench: Bench) -> None:
    parameters = actuator(bench.actuator).plant_of(bench.variant).parameters
    variant = actuator(bench.actuator).variant(bench.variant)
    for cause in CATALOGUE[bench.actuator]:
        for seed in range(8):
            found = Acting(draw(cause, np.random.default_rng(seed)), float(seed % 2), 0.0)
            for name, value in found.parameters(bench).items():
                param = parameters[name].param
                assert param.low <= value <= param.high, name
    assert {**bench.spread} == {**variant.uncertainty}
    for name, value in bench.nominal.items():
        assert value == pytest.approx(variant.values[name], rel=1e-12), name


def test_bristles_end_in_dry_friction_as_they_stiffen() -> None:
    e = experiment(MOTOR, large_step(MOTOR, np.random.default_rng(3)))
    t = e.true
    plan = e.plans[0]
    rows = np.arange(len(plan.command))
    times = np.concatenate([[0.0], MOTOR.settle + rows * plan.stride * MOTOR.step])
    exact = Contact(
        Constants(
            t["torque_constant"],
            t["back_emf_constant"],
            t["resistance"],
            t["inductance"],
            t["rotor_inertia"],
            t["friction_coefficient"],
            t["stiffness"],
        ),
        stop=math.radians(3.0),
        friction=2e-3,
    )
    inputs = {
        "voltage": np.concatenate([plan.command[:1], plan.command]),
        "load_torque": np.zeros(len(times)),
    }
    truth = (exact(times, inputs)["angle"][1:, None],)
    off = [
        rms(e.logs({"coulomb": 2e-3, "bristle_stiffness": k}), truth) for k in (50.0, 250.0, 1250.0)
    ]
    assert off[0] > 2.0 * off[1] > 4.0 * off[2]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Generated cases of all tiers, and their seal."""
    path = tmp_path_factory.mktemp("withheld") / "cases of a test"
    return path, generate(path, CASES, SEED)


def case_of(folder: Path, answer: dict[str, Any]) -> tuple[Description, Description]:
    """A case as the diagnosis reads it, and with the noise-free logs in place of its own."""
    measured = read_description(folder / "cases" / answer["case"] / "description.toml")
    truth = folder / "truth" / answer["case"] / "description.toml"
    truth.write_bytes(measured.path.read_bytes())
    try:
        return measured, read_description(truth)
    finally:
        truth.unlink()


def joined(description: Description, name: str) -> Array:
    return np.concatenate([log.outputs[name] for log in description.logs])


def simulated(description: Description, name: str, parameters: dict[str, float]) -> Array:
    """The product's response to the commands of a case."""
    chosen = model(description.actuator, description.variant, parameters)
    parts = []
    for log in description.logs:
        times = np.concatenate([[0.0], log.times + log.settle])
        inputs = {key: np.concatenate([v[:1], v]) for key, v in log.inputs.items()}
        inputs |= {key: np.full(len(times), value) for key, value in log.constants.items()}
        parts.append(simulate(chosen, times, inputs)[name][1:])
    return np.concatenate(parts)


def test_logs_are_what_the_answers_say(folder: tuple[Path, str]) -> None:
    """Noise floor and gap from the written files; without the cause, by the product."""
    kinds = set()
    for answer in unlock(*folder):
        measured, clean = case_of(folder[0], answer)
        name, kind, tier = answer["judged"], answer["kind"], answer["tier"]
        kinds.add((tier, kind))
        noise = joined(measured, name) - joined(clean, name)
        wide = math.sqrt(answer["noise"] ** 2 + answer["quantum"] ** 2 / 12.0)
        rows = len(noise) / (10.0 if tier == "hard" else 1.0)  # as many as are independent
        assert np.std(noise) == pytest.approx(wide, rel=5.0 / math.sqrt(2.0 * rows))
        colour = np.corrcoef(noise[1:], noise[:-1])[0, 1]
        assert (colour > 0.25) == (tier == "hard")
        gap = joined(clean, name) - simulated(measured, name, answer["parameters"])
        size = float(np.sqrt(np.mean(gap * gap)))
        if kind == "nothing":
            assert size < 0.05 * answer["floor"]
        elif kind != "two":
            rest = HIDDEN if tier == "hard" else 0.0
            main = answer["effects"][0]["gap"]
            assert (1.0 - rest - 0.05) * main < size < (1.0 + rest + 0.05) * main
    assert {kind for _, kind in kinds} == {"nothing", "one", "two", "foreign"}


def test_tiers_are_those_that_were_fixed(folder: tuple[Path, str]) -> None:
    for answer in unlock(*folder):
        bench = next(b for b in BENCHES if b.actuator == answer["actuator"])
        description, _ = case_of(folder[0], answer)
        hard = answer["tier"] == "hard"
        for effect in answer["effects"]:
            assert RATIO[0] * 0.999 <= effect["gap"] / answer["floor"] <= RATIO[1] * 1.001
        for hidden in answer["hidden"]:
            assert hidden["gap"] / answer["effects"][0]["gap"] == pytest.approx(HIDDEN, rel=0.051)
        assert len(answer["hidden"]) == (hard and answer["kind"] in ("one", "foreign"))
        assert answer["noise"] == pytest.approx((3.0 if hard else 1.0) * answer["floor"])
        assert (answer["quantum"] > 0.0) == hard
        for log in description.logs:
            assert 10.0 * 0.98 <= log.duration / bench.slowest <= 20.0
            step = np.diff(log.times).max() / (4.0 if hard else 1.0)
            assert bench.fastest / step >= 20.0
            excursion = np.abs(log.inputs[bench.command.name] - bench.rest)
            assert excursion.max() <= bench.amplitude[1] * 1.001
            assert excursion[0] == 0.0
            sizes = np.unique(np.round(log.inputs[bench.command.name] - bench.rest, 9))
            assert (len(sizes) == 2) == (answer["tier"] == "poor")
        if hard:
            codes = joined(description, answer["judged"]) / answer["quantum"]
            assert np.abs(codes - np.round(codes)).max() < 0.01


def test_fastest_and_slowest_are_poles_of_the_paper() -> None:
    """Torque motor: eq. 9 with Table 1; servo: s^2 + s / T + omega^2 of eq. 7's form."""
    from servo_models.reference.torque_motor import TABLE_1

    _, denominator = TABLE_1.equation_9()
    poles = np.abs(np.roots(denominator))
    assert pytest.approx(1.0 / poles.max()) == MOTOR.fastest
    assert pytest.approx(1.0 / poles.min()) == MOTOR.slowest
    values = model("sg90", "measured").values
    lag = values["motor_time_constant"]
    gain = values["motor_gain"] * values["amplifier_gain"] / values["gear_ratio"]
    loop = gain * values["feedback_coefficient"] * values["potentiometer_gain"]
    poles = np.roots([lag, 1.0, loop])
    assert pytest.approx(1.0 / np.abs(poles.real).min()) == SERVO.slowest
    assert min(1.0 / np.abs(poles).max(), lag) == pytest.approx(SERVO.fastest)


@every_bench
def test_true_constants_scatter_as_the_description_says(bench: Bench) -> None:
    rng = np.random.default_rng(8)
    drawn = [draw_experiment(bench, "poor", rng).true for _ in range(400)]
    for name, spread in bench.spread.items():
        standard = [(true[name] / bench.nominal[name] - 1.0) / spread for true in drawn]
        cut = norm.cdf((LEAST_VALUE - 1.0) / spread)
        share = kstest(standard, lambda z, c=cut: (norm.cdf(z) - c) / (1.0 - c)).pvalue
        assert share > 1e-3, name


def test_the_same_seed_gives_the_same_bytes_whatever_the_number(
    folder: tuple[Path, str], tmp_path: Path
) -> None:
    few = tmp_path / "few"
    generate(few, 5, SEED)
    answers = unlock(*folder)[:5]
    assert json.loads((few / "answers.json").read_text())["cases"] == answers
    for answer in answers:
        for name, digest in answer["files"].items():
            assert hashlib.sha256((few / name).read_bytes()).hexdigest() == digest
    other = tmp_path / "other"
    assert generate(other, 2, SEED + 1) != generate(tmp_path / "third", 2, SEED)
    log = "cases/0000/description.toml"
    assert (other / "cases").is_dir()
    assert (other / log).is_file()


def test_nothing_of_the_truth_is_in_a_case(folder: tuple[Path, str]) -> None:
    """No name, no size; what a description says is the same for every case of the rig."""
    names = {c.name for every in (CATALOGUE, FOREIGN) for b in every.values() for c in b}
    said: dict[str, set[str]] = {}
    for answer in unlock(*folder):
        here = folder[0] / "cases" / answer["case"]
        logs = {file.name for file in here.glob("*.csv")}
        assert {file.name for file in here.iterdir()} == {"description.toml", *logs}
        text = (here / "description.toml").read_text()
        assert not [name for name in names if name in text.replace("transport_delay.time", "")]
        secret = [v for e in answer["effects"] for v in e["parameters"].values()]
        secret += [*answer["parameters"].values(), answer["floor"], answer["noise"]]
        numbers = {float(n) for n in re.findall(r"(?<![\w.])\d+\.?\d*(?:e-?\d+)?", text)}
        assert not numbers & {abs(value) for value in secret}
        plain = re.sub(r"load_torque = [-\de.]+", "load_torque = X", text)
        said.setdefault(answer["actuator"], set()).update(plain.splitlines())
    for lines in said.values():
        assert len(lines) < 25
    assert not list((folder[0] / "cases").rglob("*.json"))


def test_a_changed_answer_or_log_breaks_the_seal(tmp_path: Path) -> None:
    path = tmp_path / "two"
    seal = generate(path, 2, 3)
    assert len(unlock(path, seal)) == 2
    answers = path / "answers.json"
    kept = answers.read_bytes()
    answers.write_bytes(kept.replace(b'"tier": "easy"', b'"tier": "hard"'))
    with pytest.raises(UserError, match="is not what was sealed"):
        unlock(path, seal)
    answers.write_bytes(kept)
    log = next((path / "truth").rglob("*.csv"))
    log.write_bytes(log.read_bytes() + b"\n")
    with pytest.raises(UserError, match="is not what was generated"):
        unlock(path, seal)
    with pytest.raises(UserError, match="cannot be read"):
        unlock(tmp_path / "nowhere", seal)


def test_it_runs_as_a_process_of_its_own_and_prints_the_seal(tmp_path: Path) -> None:
    path = tmp_path / "by command"
    command = [sys.executable, "-m", "servo_models.blind.generator", str(path)]
    command += ["--cases", "2", "--seed", "3", "--tiers", "hard,poor"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    answers = unlock(path, done.stdout.strip())
    assert [answer["tier"] for answer in answers] == ["hard", "poor"]
    assert done.stderr.split() == ["1/2", "2/2"]
    again = subprocess.run(command, capture_output=True, text=True, check=False)
    assert again.returncode == 2
    assert again.stderr.count("\n") == 1
    assert "exists already" in again.stderr
