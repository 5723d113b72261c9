"""What the resolution of a column may hide is what it hides in logs that were rounded."""

from __future__ import annotations

import numpy as np
import pytest

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.data.arrays import describe
from servo_models.identification.check import check
from servo_models.identification.fit import checked_logs
from servo_models.identification.resolution import ROW, STAMP, STEP, Blur, blurs, could_carry
from servo_models.identification.simulation import prepared
from tests.support.logs import log_of

PERIOD, NOISE, VOLTS = 2e-3, 1e-3, 0.01
TIMES: Array = PERIOD * np.arange(2000)


def volts(seed: int) -> Array:
    """A command that is another one in every row, about 0 [V]."""
    random = np.random.default_rng(seed)
    phases = random.uniform(0.0, 2.0 * np.pi, 3)
    waves = [np.sin(2.0 * np.pi * f * TIMES + p) for f, p in zip((0.7, 1.3, 2.9), phases)]
    return np.asarray(2.0 * np.sum(waves, axis=0))


def angle(given: Array) -> Array:
    return simulate(model("dc_motor", "direct"), TIMES, {"voltage": given})["encoder_angle"]


def found(given: Array) -> dict[str, Blur]:
    log = log_of(TIMES, {"voltage": given}, {"encoder_angle": angle(given)})
    told = blurs(model("dc_motor", "direct"), [log], {"encoder_angle": NOISE}, {})
    return {one.why: one for one in told}


@pytest.mark.thorough
def test_a_step_moves_an_open_loop_as_far_as_rounding_does() -> None:
    """An angle keeps every error of the volts: its RMS over many logs that were rounded."""
    off = [angle(np.round(volts(k) / VOLTS) * VOLTS) - angle(volts(k)) for k in range(30)]
    told = [found(np.round(volts(k) / VOLTS) * VOLTS)[STEP] for k in range(5)]
    assert all(one.size == pytest.approx(VOLTS, rel=1e-6) for one in told)
    moves = np.sqrt(np.mean([one.moves["encoder_angle"] ** 2 for one in told]))
    assert moves == pytest.approx(np.sqrt(np.mean(np.square(off))) / NOISE, rel=0.35)


def test_a_row_moves_it_as_far_as_commands_between_rows_do() -> None:
    """The same command, each of its steps sent anywhere before its row, on a tenth of the rows."""
    fine = np.repeat(volts(0)[::20], 20)
    rows = slice(None, None, 10)
    coarse = log_of(TIMES[rows], {"voltage": fine[rows]}, {"encoder_angle": angle(fine)[rows]})
    (told,) = (
        one
        for one in blurs(model("dc_motor", "direct"), [coarse], {"encoder_angle": NOISE}, {})
        if one.why == ROW
    )
    random, ends = np.random.default_rng(5), []
    changes = np.flatnonzero(np.diff(fine)) + 1
    for _ in range(40):
        sent = fine.copy()
        for row, early in zip(changes, random.integers(0, 11, len(changes))):
            sent[row - early : row] = fine[row]
        ends.append(angle(sent)[rows])
    off = np.array(ends) - np.mean(ends, axis=0)
    assert told.moves["encoder_angle"] == pytest.approx(
        float(np.sqrt(np.mean(off**2))) / NOISE, rel=0.4
    )


def test_late_stamps_move_it_as_far_as_readings_at_other_times_are_off() -> None:
    """A speed times what the delays scatter by; readings without noise tell whether they are."""
    random, angle_at = np.random.default_rng(3), angle(volts(0))
    rows = np.arange(20, len(TIMES) - 20, 10)
    delays = random.exponential(0.2 * 10 * PERIOD, len(rows))
    stamps = np.maximum.accumulate(TIMES[rows] + delays - 1e-6 * rows) + 1e-6 * rows
    stamps -= stamps[0]
    read = np.interp(stamps + TIMES[rows[0]], TIMES, angle_at)
    loud = read + 0.3 * np.ptp(read) * random.standard_normal(len(read))
    told = {}
    for kind, readings in (("surely", read), ("unsure", loud)):
        log = log_of(stamps, {"voltage": volts(0)[rows]}, {"encoder_angle": readings})
        every = blurs(model("dc_motor", "direct"), [log], {"encoder_angle": NOISE}, {})
        told[kind] = {one.why: one for one in every}
    assert STAMP not in told["surely"]
    (simulated,) = prepared(model("dc_motor", "direct"), log).outputs({}).T
    speed = np.sqrt(np.mean(np.gradient(simulated, stamps) ** 2))
    expected = speed * np.std(delays) / NOISE
    assert told["unsure"][STAMP].moves["encoder_angle"] == pytest.approx(expected, rel=0.3)


def test_what_columns_carry_adds_up_by_squares_of_all_samples() -> None:
    logs = [
        log_of(TIMES[:n], {"voltage": volts(0)[:n]}, {"encoder_angle": TIMES[:n]}, name=name)
        for name, n in (("a", 300), ("b", 100))
    ]
    told = [Blur("a", "voltage", ROW, 0.002, {"encoder_angle": 2.0})]
    told += [Blur("b", name, ROW, 0.002, {"encoder_angle": 4.0}) for name in ("voltage", "load")]
    assert could_carry(told, logs)[ROW] == pytest.approx(np.sqrt((300 * 4 + 100 * 32) / 400))
    assert next(iter(could_carry(told, logs))) == ROW
    assert could_carry(told, logs)[STEP] == 0.0


def test_levels_that_were_commanded_are_no_steps_of_a_column() -> None:
    assert STEP not in found(np.repeat([0.0, 3.0, -3.0, 1.5], 500))


def test_an_input_that_rests_hides_nothing() -> None:
    assert not found(np.full(len(TIMES), 2.0))


@pytest.mark.thorough
@pytest.mark.parametrize("lost", [(), (*range(100, 106), *range(300, 305))])
def test_a_log_that_begins_in_motion_has_copies_with_more_rows(lost: tuple[int, ...]) -> None:
    """Its start is fitted to the readings of its own rows."""
    chosen = model("smart_servo")
    times = 0.01 * np.arange(700)
    goal = 0.3 * np.sin(6.0 * times)
    angle = simulate(chosen, times, {"goal": goal})["angle_reading"]
    angle = angle + 1e-3 * np.random.default_rng(0).standard_normal(700)
    kept = np.delete(np.arange(200, 700), lost)
    log = {"time": times[kept], "goal": goal[kept], "angle_reading": angle[kept]}
    told = describe(chosen, {"run": log}, {name: name for name in log})
    assert check(told, jobs=1).blurs
    (known,) = checked_logs(chosen, told.logs)
    assert known.start is not None
    assert bool(known.unsure) == bool(lost)
