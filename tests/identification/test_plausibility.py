"""What makes no sense beside the actuator is said, with the value that would; sane logs pass."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.data.audit import audits
from servo_models.data.description import read_description
from servo_models.data.outliers import outliers_of
from servo_models.data.sensor import outliers
from servo_models.errors import UserError
from servo_models.identification.identify import identify
from servo_models.identification.plausibility import (
    _together,
    implausible,
    implausible_clocks,
    likely,
    questions,
)
from servo_models.identification.simulation import prepared
from servo_models.identification.starts import with_starts
from tests.conftest import Run
from tests.support.logs import changed, log_of
from tests.support.own_actuators import write
from tests.support.plausible_logs import (
    described,
    doubts,
    is_refused,
    misread,
    mistakes,
    names,
    sane,
    with_outputs,
)

SUBJECTS = [
    ("sg90", "measured"),
    ("torque_motor", "identified"),
    ("linear_drive", "simple"),
    ("smart_servo", "xl330"),
    ("second_order_servo", "pulse"),
]
EXAMPLES = Path(__file__).parents[2] / "examples"


def test_columns_of_two_quantities_are_not_in_another_unit_together() -> None:
    """Milli-units share a ratio, and a linear model does not tell them from the right ones."""
    plant = model("torque_motor", "identified").plant
    every = {"voltage": [("mV", 1e-3)], "angle": [("mrad", 1e-3)], "current": [("mA", 1e-3)]}
    assert list(_together(plant, every)) == []


def test_a_log_that_cannot_be_simulated_in_another_unit_is_not_told_to_take_it() -> None:
    """In microseconds it would be over before the first internal step."""
    nominal = model("second_order_servo", "pulse")
    times = np.arange(0.0, 2.3, 1.6e-3)
    random = np.random.default_rng(8)
    pulse = 1.5e-3 + 2e-4 * np.sin(np.outer(times, [3.0, 11.0, 17.0])).sum(axis=1)
    measured = simulate(nominal, times, {"pulse_width": pulse})["angle_reading"]
    late = np.roll(measured, 60) + 1e-3 * random.standard_normal(len(times))
    log = log_of(times, {"pulse_width": pulse}, {"angle_reading": late})
    assert not any("'time'" in text for text in doubts(nominal, log))


@pytest.mark.parametrize(
    ("effect", "size"), [("constant_load.torque", 1e-3), ("command_offset.value", 0.05)]
)
def test_a_free_motor_that_drifts_has_the_right_sign(effect: str, size: float) -> None:
    """What drifts says nothing of the sign: nothing holds the shaft."""
    nominal = model("dc_motor_current", "direct")
    times = np.arange(0.0, 2.0, 2e-3)
    random = np.random.default_rng(7)
    for sign in (1.0, -1.0) * 3:
        rig = model("dc_motor_current", "direct", {effect: sign * size})
        current = 0.3 * random.choice([-1.0, 0.0, 1.0], 10)[(times / 0.2).astype(int)]
        inputs = {"current_command": current}
        angle = simulate(rig, times, inputs)["encoder_angle"]
        log = log_of(times, inputs, {"encoder_angle": angle})
        assert not any("against" in text for text in doubts(nominal, log))


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "variant"), SUBJECTS)
def test_every_column_in_another_unit_is_named_with_its_unit(name: str, variant: str) -> None:
    """Rigs that differ from the nominal model by up to 20 %; seeds that nothing was tuned on."""
    chosen, every = sane(name, variant, 101)
    log = with_outputs(every, list(every.outputs)[:2])
    assert doubts(chosen, log) == ()
    found = []
    for wrong in mistakes(chosen, log):
        changed = misread(log, wrong)
        if not is_refused(chosen, changed):
            said = " ".join(doubts(chosen, changed))
            found.append((names(said, wrong.signal, wrong.written), wrong, said))
    assert len(found) > 4
    assert [row for row in found if not row[0]] == []


@pytest.mark.parametrize("variant", ["xl330", "sts3215"])
def test_degrees_as_radians_in_command_and_reading_alike(variant: str) -> None:
    """Neither contradicts the other, but no motor turns as fast as that."""
    chosen, log = sane("smart_servo", variant, 102)
    log = with_outputs(log, ["angle_reading"])
    turned = replace(
        log,
        inputs={**log.inputs, "goal": np.degrees(log.inputs["goal"])},
        outputs={"angle_reading": np.degrees(log.outputs["angle_reading"])},
    )
    said = " ".join(implausible(described(chosen, turned)))
    assert names(said, "goal", "deg")
    assert names(said, "angle_reading", "deg")


def test_counts_without_a_scale_are_told_with_the_scale() -> None:
    """4096 counts a turn, from the middle of the range."""
    chosen, log = sane("smart_servo", "sts3215", 103)
    counts = 2048.0 + np.round(log.outputs["angle_reading"] * 4096.0 / (2.0 * np.pi))
    (said,) = implausible(described(chosen, replace(log, outputs={"angle_reading": counts})))
    assert "column 'c_angle_reading' ('angle_reading')" in said
    told = float(said.split("scale = ")[1].split()[0])
    assert told == pytest.approx(2.0 * np.pi / 4096.0, rel=0.1)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["second_order_servo", "smart_servo"])
@pytest.mark.parametrize("slower", [12.0, 16.0])
def test_a_time_that_runs_too_slowly_is_told_within_an_octave(name: str, slower: float) -> None:
    """The number of the row, say, where a row is no unit of time."""
    chosen, log = sane(name, dict(SUBJECTS)[name], 105)
    every = implausible(described(chosen, replace(log, times=slower * log.times)))
    (said,) = (text for text in every if "runs about" in text)
    told = float(said.split("runs about ")[1].split()[0])
    assert 0.5 < told / slower < 2.0


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "variant"), SUBJECTS)
@pytest.mark.parametrize("seed", [106, 107])
def test_a_column_of_the_other_sign_is_told(name: str, variant: str, seed: int) -> None:
    """Rigs that differ from the nominal model; the unit of a turned column is not doubted."""
    chosen, every = sane(name, variant, seed)
    log = with_outputs(every, list(every.outputs)[:1])
    (output,) = log.outputs
    turned = replace(log, outputs={output: -log.outputs[output]})
    (said,) = implausible(described(chosen, turned))
    assert f"column 'c_{output}' ('{output}') goes against the command: give it sign = -1" in said
    channel = replace(log.channels[output], scale=-log.channels[output].scale)
    wrong = replace(turned, channels={**log.channels, output: channel})
    (said,) = implausible(described(chosen, wrong))
    assert "leave out its sign = -1" in said
    assert implausible(described(chosen, log)) == ()


def test_a_turned_column_is_told_where_the_first_row_steps() -> None:
    """A start that is fitted to it would hide it."""
    chosen = model("second_order_servo", "bus", {"natural_frequency": 25.0})
    times = 0.005 * np.arange(400)
    goal = np.repeat([0.7, -0.3, 0.1, 0.0], [120, 120, 80, 80])
    angle = simulate(chosen, times, {"goal": goal})["angle"]
    log = replace(log_of(times, {"goal": goal}, {"angle": -angle}), assumed=True, settle=1.0)
    nominal = model("second_order_servo", "bus")
    (log,) = with_starts(nominal, [log])
    (said,) = implausible(described(nominal, log))
    assert "('angle') goes against the command: give it sign = -1" in said
    assert "or turn the sign of 'goal'" in said


def test_a_scale_that_nobody_declared_is_no_reason_for_a_doubt(run: Run, tmp_path: Path) -> None:
    """An own actuator whose wires name no full scale, and its own log, faster than 3 rad/s."""
    write(tmp_path)
    times = 0.01 * np.arange(300)
    goal = 3.0 * ((times // 1.0) % 2.0)
    angle = simulate(model(str(tmp_path / "joint.py")), times, {"goal": goal})["angle"]
    rows = "".join(f"{t},{u},{y}\n" for t, u, y in zip(times, goal, angle))
    (tmp_path / "log.csv").write_text(f"t,u,y\n{rows}")
    (tmp_path / "rig.toml").write_text(
        'actuator = "joint.py"\n[[logs]]\nfile = "log.csv"\ntime = "t"\ninputs.goal = "u"\n'
        'outputs.angle = "y"\n'
    )
    code, out, _ = run("check", tmp_path / "rig.toml")
    assert "Warning" not in out
    assert code == 0


@pytest.mark.parametrize(("scale", "doubted"), [(0.06, True), (1.0, False)])
def test_a_load_is_judged_by_a_full_scale_that_somebody_declared(
    scale: float, doubted: bool
) -> None:
    """Nothing else of the plant changes: a load a hundred times the torque of the magnet."""
    chosen, log = sane("torque_motor", "identified", 104)
    plant = chosen.plant.rated(scales={"load_torque": scale})
    (variant,) = [one for one in chosen.actuator.variants if one.name == chosen.variant]
    actuator = replace(chosen.actuator, variants=(replace(variant, plant=plant),))
    log = replace(log, constants={"load_torque": 6.0})
    said = " ".join(implausible(described(replace(chosen, actuator=actuator), log)))
    assert ("times the full scale" in said) == doubted


@pytest.mark.thorough
@pytest.mark.parametrize("torque_constant", [0.03, 0.032])
@pytest.mark.parametrize(
    ("late", "after", "cure"),
    [
        (0, None, ""),
        (0, 0.0, 'give it after_command = "0 ms"'),
        (4, None, 'give it shift = "-8 ms"'),
        (-1, None, 'give it shift = "2 ms"'),
    ],
)
def test_a_current_that_was_read_at_another_time_is_told(
    late: int, after: float | None, cure: str, torque_constant: float
) -> None:
    """By the key that leaves less when it is tried; another torque constant is no other time."""
    motor, random = model("dc_motor_speed", "direct"), np.random.default_rng(late + 3)
    times = 2e-3 * np.arange(2000)
    held = {"speed_command": np.repeat(random.uniform(-300.0, 300.0, 40), 50)}
    log = log_of(times, held, dict.fromkeys(("encoder_angle", "current"), np.zeros(2000)))
    then = {n: replace(it, after_command=after) for n, it in log.channels.items()}
    rig = changed(motor, {"torque_constant": torque_constant})
    angle, current = prepared(rig, replace(log, channels=then)).outputs({}).T
    noisy = [it + 5e-3 * np.std(it) * random.standard_normal(2000) for it in (angle, current)]
    outputs = dict(zip(log.outputs, (noisy[0], np.roll(noisy[1], late))))
    told = described(motor, replace(log, outputs=outputs))
    told = replace(told, uncertainty={"torque_constant": 0.006})
    said = [text for it in likely(told, questions(told)) for text in it.mistakes]
    assert [text.columns for text in said] == [("current",)] * bool(cure)
    assert all(cure in text for text in said), said


def test_a_delay_of_all_outputs_is_no_reading_that_is_late() -> None:
    motor, random = model("dc_motor_speed", "direct"), np.random.default_rng(5)
    times = 2e-3 * np.arange(2000)
    held = np.repeat(random.uniform(-300.0, 300.0, 40), 50)
    sent = {"speed_command": np.roll(held, 8)}
    found = simulate(motor, times, sent)
    outputs = {
        name: found[name] + 5e-3 * np.std(found[name]) * random.standard_normal(2000)
        for name in ("encoder_angle", "current")
    }
    told = described(motor, log_of(times, {"speed_command": held}, outputs))
    assert not any(it.mistakes for it in likely(told, questions(told)))


@pytest.mark.parametrize("name", ["two_csv_files", "torque_motor"])
def test_examples_make_sense(name: str) -> None:
    told = read_description(EXAMPLES / name / "description.toml")
    assert (*implausible_clocks(told), *implausible(told)) == ()
    assert not any(it.mistakes for it in audits(told.logs, told.model.plant))


@pytest.mark.thorough
@pytest.mark.parametrize(
    "path",
    sorted((EXAMPLES / "real_logs").rglob("*.toml")),
    ids=lambda p: f"{p.parent.name} {p.stem}",
)
def test_real_logs_make_sense(path: Path, logs_folder: Path, tmp_path: Path) -> None:
    """Real servos beside models with and without friction, some of them data sheets: what is asked
    of them is dropped once it is tried."""
    text = path.read_text(encoding="utf-8")
    for folder in ('"../logs/', '"logs/'):
        text = text.replace(folder, f'"{logs_folder.as_posix()}/')
    (tmp_path / path.name).write_text(text, encoding="utf-8")
    told = read_description(tmp_path / path.name)
    assert (*implausible_clocks(told), *implausible(told, columns=False)) == ()
    assert not any(it.mistakes for it in likely(told, questions(told)))


# On the command line

STEP = """actuator = "smart_servo"
variant = "xl330"
free = ["inertia"]
{uncertainty}
[[logs]]
file = "log.csv"
time = {{ column = "t", unit = "s" }}
inputs.goal = {{ column = "u", unit = "rad" }}
outputs.angle_reading = {{ column = "y", unit = "{unit}" }}
constants = {{ supply = "{supply}" }}
"""


def record(
    folder: Path,
    unit: str = "rad",
    supply: str = "5 V",
    uncertainty: str = "",
    odd: dict[int, float] | None = None,
) -> Path:
    """A log of a servo with a larger inertia, simulated, beside its description."""
    times = 5e-3 * np.arange(400)
    goal = np.repeat([0.0, 0.5, -0.3, 0.8, 0.1, 0.6, -0.5, 0.0], 50)
    servo = model("smart_servo", "xl330", {"inertia": 3.2e-3})
    reading = simulate(servo, times, {"goal": goal})["angle"]
    reading = reading + 1e-3 * np.random.default_rng(1).standard_normal(400)
    for row, size in (odd or {}).items():
        reading[row] += size
    table = np.column_stack([times, goal, reading])
    np.savetxt(folder / "log.csv", table, "%.9g", delimiter=",", header="t,u,y", comments="")
    path = folder / "rig.toml"
    path.write_text(STEP.format(unit=unit, supply=supply, uncertainty=uncertainty))
    return path


def test_a_sane_log_is_checked_and_identified_without_a_doubt(run: Run, tmp_path: Path) -> None:
    """All that is told is true: beside an uncertain resistance only their product is seen."""
    path = record(tmp_path)
    code, out, _ = run("check", path)
    warnings = [line for line in out.splitlines() if line.startswith("Warning")]
    assert (code, len(warnings)) == (1, 1)
    assert "'inertia' is to be estimated, but: known from its prior only" in warnings[0]
    assert run("identify", path)[0] == 0


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("wrong", "cure"),
    [
        ({"unit": "deg"}, 'unit = "rad"'),
        ({"unit": "mrad"}, 'unit = "rad"'),
        ({"supply": "24 V"}, "about 5 makes sense"),
        ({"supply": "5 mV"}, "about 5 makes sense"),
        ({"uncertainty": '[uncertainty]\ninertia = "30"'}, '"30 %"'),
        ({"uncertainty": "[uncertainty]\ninertia = 30"}, '"30 %"'),
        ({"uncertainty": '[uncertainty]\nresistance = "40 Ohm"'}, '"40 %"'),
    ],
    ids=str,
)
def test_check_says_what_would_make_sense_and_exits_1(
    run: Run, tmp_path: Path, wrong: dict[str, str], cure: str
) -> None:
    code, out, err = run("check", record(tmp_path, **wrong))
    assert (code, err) == (1, "")
    assert cure in " ".join(out.split())


@pytest.mark.parametrize(("told", "written"), [("s", "ms"), ("us", "ms"), ("us", "s")])
def test_a_wrong_unit_of_time_is_told_before_anything_is_simulated(
    run: Run, tmp_path: Path, told: str, written: str
) -> None:
    """What is a thousand times too long to simulate is refused, what is too short is doubted."""
    path = record(tmp_path)
    table = np.loadtxt(tmp_path / "log.csv", delimiter=",", skiprows=1)
    table[:, 0] *= {"s": 1.0, "ms": 1e3}[written]
    np.savetxt(tmp_path / "log.csv", table, "%.9g", delimiter=",", header="t,u,y", comments="")
    path.write_text(path.read_text().replace('"t", unit = "s"', f'"t", unit = "{told}"'))
    code, out, err = run("check", path)
    assert code == (2 if told == "s" else 1)
    assert f'unit = "{written}"' in " ".join((out + err).split())
    assert "standard error" not in out


def test_a_command_beyond_its_bounds_is_refused_with_a_unit_that_fits(
    run: Run, tmp_path: Path
) -> None:
    path = record(tmp_path)
    table = np.loadtxt(tmp_path / "log.csv", delimiter=",", skiprows=1)
    table[:, 1] = 3.0 * np.degrees(table[:, 1])
    np.savetxt(tmp_path / "log.csv", table, "%.9g", delimiter=",", header="t,u,y", comments="")
    code, _, err = run("check", path)
    assert code == 2
    assert "column 'u'" in err
    assert "in deg it would fit" in err


# Outliers

ODD = {130: 0.9, 330: -2.5}


@pytest.mark.parametrize("command", ["check", "identify"])
def test_outliers_are_named_by_row_and_size(run: Run, tmp_path: Path, command: str) -> None:
    code, out, _ = run(command, record(tmp_path, odd=ODD))
    assert command == "check" or code == 0
    said = " ".join(out.split())
    for index, size in ODD.items():
        row = index + 2  # the header is row 1
        assert f"row {row} by" in said
        told = float(said.split(f"row {row} by ")[1].split()[0])
        assert told == pytest.approx(np.degrees(size), rel=0.05)


def test_outliers_are_left_out_of_a_fit(tmp_path: Path) -> None:
    """Values are those of the log without them."""
    found = [identify(record(tmp_path, odd=odd)).result for odd in ({}, ODD)]
    assert found[1].believable == found[0].believable
    apart = np.abs(found[1].values - found[0].values) / found[0].standard_errors
    assert np.all(apart < 0.3)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("name", "variant"), SUBJECTS)
def test_outliers_are_those_put_in(name: str, variant: str, seed: int) -> None:
    chosen, log = sane(name, variant, 110 + seed)
    random = np.random.default_rng(seed)
    command = log.inputs[chosen.actuator.step[0]]
    moves = np.abs(np.diff(command, prepend=command[0]))
    moves = (np.median(moves) == 0.0) & (moves > 0.0)  # of steps; a sine answers smoothly
    calm = np.convolve(moves, np.ones(15), "same") == 0.0
    calm[[*range(5), *range(-5, 0)]] = False
    for output, values in log.outputs.items():
        wire = chosen.plant.wire[output]
        assert outliers_of(log, wire) == ()
        if output == "bridge_supply":  # a ripple alone, of which the range is no outlier
            continue
        odd = values.copy()
        row = int(random.choice(np.flatnonzero(calm)))
        odd[row] += random.choice([-1.0, 1.0]) * np.ptp(values)
        (found,) = outliers_of(replace(log, outputs={output: odd}), wire)
        assert found.row == row


def test_no_position_answers_a_jump_by_twice_its_range() -> None:
    """A speed may: it rests before and after."""
    times = 0.01 * np.arange(400)
    command = 1.0 * ((times // 0.5) % 2.0)
    servo = model("smart_servo", "xl330")
    simulated = simulate(servo, times, {"goal": command})
    log = log_of(times, {"goal": command}, {name: simulated[name] for name in ("angle", "rate")})
    jump = int(np.flatnonzero(np.diff(command))[2]) + 1
    for output, found in (("angle", (jump,)), ("rate", ())):
        odd = log.outputs[output].copy()
        odd[jump] = 2.5 * np.ptp(odd)
        changed = replace(log, outputs={output: odd})
        rows = tuple(one.row for one in outliers_of(changed, servo.plant.wire[output]))
        assert rows == found


def test_steps_ramps_and_codes_have_no_outliers() -> None:
    times = np.arange(1000.0)
    for values in (
        np.where(times > 500.0, 1.0, 0.0),
        np.floor(times / 37.0),
        np.sign(np.sin(times)),
        np.zeros(1000),
        np.random.default_rng(0).standard_normal(1000),
    ):
        assert not outliers(values).any()


# Identification


@pytest.mark.thorough
def test_a_fit_that_does_not_believe_itself_exits_1(run: Run, tmp_path: Path) -> None:
    """Two loads on one shaft add up."""
    path = record(tmp_path)
    path.write_text(path.read_text().replace('["inertia"]', '["load_inertia", "gear_compliance"]'))
    code, out, _ = run("identify", path)
    assert code == 1
    said = " ".join(out.split())
    assert "cannot be told apart" in said or "is not excited by these logs" in said


@pytest.mark.thorough
@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_a_fit_that_does_not_follow_its_log_exits_1(run: Run, tmp_path: Path, unit: str) -> None:
    """Radians described as degrees leave all of the error, and the estimate at its prior."""
    code, out, _ = run("identify", record(tmp_path, unit=unit))
    hardly = "explains hardly anything of 'angle_reading'" in " ".join(out.split())
    assert hardly == (unit == "deg")
    assert code == hardly


def test_an_error_that_is_not_finite_is_refused(tmp_path: Path) -> None:
    """A description refuses such readings, a log made in Python may hold them."""
    told = read_description(record(tmp_path))
    (log,) = told.logs
    reading = log.outputs["angle_reading"].copy()
    reading[200:] = 1e200
    odd = replace(told, logs=(replace(log, outputs={"angle_reading": reading}),))
    with pytest.raises(UserError, match="RMS error of 'angle_reading'"):
        identify(odd)
