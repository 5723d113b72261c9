"""Motion of a rig: a shaft with what drives it, brakes it and hangs on it.

The states are those of ``Q`` to ``BOUC``; what friction, winding and magnet remember is kept
in ``memory`` and moves on at the end of a step.  All quantities in SI but the drive of the
servo, which is a share of its supply, and its feedback, which is an angle.

Sources: C. Canudas de Wit et al., "A new model for control of systems with friction", IEEE
Trans. Automatic Control 40 (1995) 419 (bristle); P. R. Dahl, AIAA J. 14 (1976) 1675 (hysteresis
with an exponent); R. Bouc (1967), Y. K. Wen, J. Eng. Mech. 102 (1976) 249; K. Heun (1900), third
order.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from servo_models.withheld.generator.compiled import compiled
from servo_models.withheld.generator.rig import Rig

Array = NDArray[np.float64]

Q, W, LOAD_Q, LOAD_W, PLAY, ELECTRIC, MODE, MODE_RATE, BOUC = range(9)
"""Shaft and load angle and speed, output behind the play, feedback lag or flux linkage (as the
current that makes it), the drive's resonance, Bouc-Wen's variable."""
STATES = 9
ANGLE, DRIVE, FEEDBACK, BENT, PRESS, HEAT = range(STATES, STATES + 6)
"""Beside the rates: output angle, drive or current, feedback, what the hysteresis reads, load
on the gears, drive that heats."""
WIDTH = STATES + 6
COMMAND, GAIN, STICKING, TORQUE = range(4)
BRISTLE, FRICTION, WARMTH, LAST, MAGNET = range(5)
MEMORY = 5
DAHL = 1.25
"""Exponent of the hysteresis; with 1 it would be that of Coleman and Hodgdon."""
LEAST_LEVEL = 1e-3
"""Of breakaway, so that a bristle always has some reach."""
BRISTLE_DAMPING, STOP_DAMPING = 0.6, 5.0
"""Over stiffness and swing; a stop so damped gives back 3 % of the speed."""
SPLITS, HALVINGS = 6, 12


@compiled
def bent(value: float, m: Array, r: Rig) -> float:
    """Hysteresis variable, -1 to 1, at a value: turn dz/dv = (1 - z)^p where v grows.

    Solved exactly from the value and the variable that were remembered.
    """
    way = math.copysign(1.0, value - m[LAST])
    left: float = 1.0 - way * m[MAGNET]
    if left > 0.0:
        grown = (DAHL - 1.0) * abs(value - m[LAST]) / r.turn
        left = math.pow(math.pow(left, 1.0 - DAHL) + grown, -1.0 / (DAHL - 1.0))
    return way * (1.0 - left)


@compiled
def dead(value: float, half: float) -> float:
    """What of a value is beyond +/- half."""
    return value - min(max(value, -half), half)


@compiled
def side(value: float, half: float) -> int:
    """0 below -half, 1 between, 2 above half."""
    return 0 if value < -half else (2 if value > half else 1)


@compiled
def resonant(value: float, x: Array, r: Rig, d: Array) -> float:
    """A signal of which a share passes through a second-order resonance."""
    if r.mode_share <= 0.0:
        return value
    own = r.mode_frequency
    d[MODE] = x[MODE_RATE]
    ahead: float = value - x[MODE]
    d[MODE_RATE] = own * (own * ahead - 2.0 * r.mode_damping * x[MODE_RATE])
    return value - r.mode_share * ahead


@compiled
def servo_torque(
    x: Array, m: Array, r: Rig, command: float, gain: float, load: float, d: Array
) -> int:
    """Add the motor's torque of a loop about the output to d[W]; returns its regime."""
    output = d[ANGLE]
    seen = output
    if r.lag > 0.0:
        d[ELECTRIC] = (output - x[ELECTRIC]) / r.lag
        seen = x[ELECTRIC]
    seen += r.rest
    ratio = seen / r.full_scale
    seen += seen * ratio * (r.bow + r.cubic * ratio) + r.feedback_offset
    regime = 0
    if r.feedback_step > 0.0:
        code = math.floor(seen / r.feedback_step + 0.5)
        seen = code * r.feedback_step
        regime = 1000 * int(code)
    d[FEEDBACK] = seen
    damping = 2.0 * r.damping_ratio * r.natural_frequency
    drive = (command - seen) * r.natural_frequency**2 / (damping * r.top_speed)
    drive += r.asymmetry * abs(drive)
    d[BENT] = drive
    if r.hysteresis > 0.0:
        drive -= r.hysteresis * bent(drive, m, r)
    if r.dead_zone > 0.0:
        regime += 100 * side(drive, r.dead_zone)
        drive = dead(drive, r.dead_zone)
    if r.ceiling > 0.0:
        regime += 30 * side(drive, r.ceiling)
        drive = min(max(drive, -r.ceiling), r.ceiling)
    drive = gain * resonant(drive, x, r, d)
    opposing = math.copysign(x[W], x[W] * drive) / r.top_speed
    full = 1.0 - r.sag / (1.0 + r.sag) * max(0.0, 1.0 - opposing)
    regime += 10 * side(drive, full)
    drive = min(max(drive, -full), full)
    d[DRIVE] = drive
    used = drive - r.drive_per_load * load
    d[HEAT] = used
    used *= 1.0 - r.heating * m[WARMTH]
    kink = 1.0 + r.kink_slope * max(0.0, output - r.kink_angle)
    d[W] += r.inertia * damping * (r.top_speed * used * kink - x[W])
    return regime


@compiled
def motor_torque(
    x: Array, m: Array, r: Rig, voltage: float, gain: float, load: float, d: Array
) -> int:
    """Add the torque of coil and magnet to d[W]; returns its regime."""
    linked = (x[ELECTRIC] - r.flux_per_angle * x[Q]) / (1.0 + r.curvature * x[Q] * x[Q])
    current = linked
    if r.knee > 0.0:
        current = math.tan(min(max(r.knee * linked, -1.5), 1.5)) / r.knee
    applied = gain * resonant(voltage, x, r, d) - r.sag * current
    d[ELECTRIC] = r.corner * (applied / r.resistance - current)
    d[DRIVE] = current
    d[BENT] = current
    if r.hysteresis > 0.0:
        current -= r.hysteresis * bent(current, m, r)
    pull = r.torque_per_current * current
    if r.inverse_torque > 0.0:
        pull /= math.sqrt(1.0 + (r.inverse_torque * pull) ** 2)
    pull *= 1.0 + r.kink_slope * max(0.0, x[Q] - r.kink_angle)
    away = x[Q] - r.null
    spring = r.natural_frequency**2 * away * (1.0 + r.hardening * away * away)
    air = 2.0 * r.damping_ratio * r.natural_frequency * x[W]
    d[W] += pull - r.inertia * (spring + air) - load
    return 0


@compiled
def rates(x: Array, m: Array, r: Rig, acts: Array, d: Array) -> int:
    """Rates of the states and what is seen of them into d, shape (WIDTH,).

    ``acts``: command, factor on the drive, level of sticking [N m], load torque [N m].
    Returns a number that changes where the right hand side has a corner.
    """
    for i in range(STATES):
        d[i] = 0.0
    d[Q] = x[W]
    regime = 0
    output = x[LOAD_Q] if r.load_inertia > 0.0 else x[Q]
    if r.play > 0.0:
        regime = side(output - x[PLAY], r.play)
        d[PLAY] = r.contact_rate * dead(output - x[PLAY], r.play)
        output = x[PLAY]
    d[ANGLE] = output
    load = r.load + r.constant_load + acts[TORQUE]
    if r.gravity != 0.0:
        load += r.gravity * math.sin(output + r.gravity_phase)
    if r.load_inertia > 0.0:
        own = r.load_frequency
        twist = own * (x[Q] - x[LOAD_Q]) + 2.0 * r.load_damping * (x[W] - x[LOAD_W])
        d[LOAD_Q] = x[LOAD_W]
        d[LOAD_W] = own * twist - load / r.load_inertia
        load = r.load_inertia * own * twist
    d[PRESS] = abs(load)
    load += x[W] * (r.drag + r.quadratic_drag * abs(x[W]))
    if x[W] > 0.0:
        load += r.forward_drag * x[W]
    if r.cogging > 0.0:
        load += r.cogging * math.sin(r.cogging_count * x[Q] + r.cogging_phase)
    if r.bouc_torque > 0.0:
        z = x[BOUC]
        d[BOUC] = (x[W] - z * (0.8 * abs(x[W] * z) + 0.2 * x[W] * z)) / r.bouc_travel
        load += r.bouc_torque * z
    if r.servo > 0.0:
        regime += servo_torque(x, m, r, acts[COMMAND], acts[GAIN], load, d)
    else:
        motor_torque(x, m, r, acts[COMMAND], acts[GAIN], load, d)
    total = r.inertia + r.extra_inertia
    d[W] -= m[FRICTION]
    if r.travel > 0.0:
        beyond = dead(x[Q], r.travel)
        regime += 3 * side(x[Q], r.travel)
        push = total * r.stop_frequency * (r.stop_frequency * beyond + STOP_DAMPING * x[W])
        if push * beyond > 0.0:
            d[W] -= push
    d[W] /= total
    return regime


@compiled
def bristles(m: Array, r: Rig, speed: float, press: float, sticking: float, h: float) -> None:
    """Bend the bristle for a step h at this speed; its force counts from the next step on.

    The bristle's equation z' = v - |v| z / reach(v) is solved exactly for a constant speed, so
    it may be as stiff as it likes.  Its damping fades with the speed, or a fast reversal would
    meet more of it than of friction (H. Olsson et al., European J. Control 4 (1998) 176).
    """
    sliding = r.coulomb + r.load_friction * press + sticking
    breakaway = sliding + r.stiction
    m[FRICTION] = 0.0
    if breakaway <= 0.0:
        m[BRISTLE] = 0.0
        return
    level = sliding + r.stiction * math.exp(-((speed / r.stribeck_speed) ** 2))
    reach = max(level, LEAST_LEVEL * breakaway) / r.bristle_stiffness
    before = m[BRISTLE]
    end = math.copysign(reach, speed)
    m[BRISTLE] = end + (before - end) * math.exp(-abs(speed) * h / reach)
    swing = math.sqrt(r.bristle_stiffness / (r.inertia + r.extra_inertia))
    fading = math.exp(-((speed * r.bristle_stiffness / (swing * breakaway)) ** 2))
    bending = (m[BRISTLE] - before) / h
    m[FRICTION] = r.bristle_stiffness * (m[BRISTLE] + BRISTLE_DAMPING * fading / swing * bending)


@compiled
def remember(m: Array, r: Rig, d: Array, speed: float, sticking: float, h: float) -> None:
    """Move friction, warmth and hysteresis on by a step h that ended with rates d."""
    bristles(m, r, speed, d[PRESS], sticking, h)
    m[WARMTH] += h / r.heating_time * (d[HEAT] ** 2 - m[WARMTH])
    if r.hysteresis > 0.0:
        m[MAGNET] = bent(d[BENT], m, r)
        m[LAST] = d[BENT]


@compiled
def heun(x: Array, m: Array, r: Rig, acts: Array, h: float, d: Array, k: Array, y: Array) -> None:
    """One step of Heun's third order from x, whose rates are d, to y; k is working space."""
    for i in range(STATES):
        y[i] = x[i] + h / 3.0 * d[i]
    rates(y, m, r, acts, k)
    for i in range(STATES):
        y[i] = x[i] + 2.0 * h / 3.0 * k[i]
    rates(y, m, r, acts, k)
    for i in range(STATES):
        y[i] = x[i] + 0.25 * h * (d[i] + 3.0 * k[i])


@compiled
def run(r: Rig, acts: Array, h: float, seen: Array) -> None:
    """Simulate from the state of rest.

    Args:
        r: the rig.
        acts: shape (n, 4), see ``rates``; each row is held for the step h [s] that follows.
        seen: written: angle, drive or current, and feedback before each step, shape (n, 3).
    """
    x, y = np.zeros(STATES), np.zeros(STATES)
    d, k = np.zeros(WIDTH), np.zeros(WIDTH)
    m = np.zeros(MEMORY)
    for n in range(len(acts)):
        here = rates(x, m, r, acts[n], d)
        for i in range(3):
            seen[n, i] = d[ANGLE + i]
        left = h
        for split in range(SPLITS):
            heun(x, m, r, acts[n], left, d, k, y)
            there = rates(y, m, r, acts[n], k)
            part = left
            if there != here and split < SPLITS - 1:
                part = crossing(x, m, r, acts[n], left, d, k, y, here)
                there = rates(y, m, r, acts[n], k)
            x, y, d, k, here = y, x, k, d, there
            left -= part
            if left <= 0.0:
                break
        remember(m, r, d, x[W], acts[n, STICKING], h)


@compiled
def crossing(
    x: Array, m: Array, r: Rig, acts: Array, h: float, d: Array, k: Array, y: Array, here: int
) -> float:
    """Length of the step to y just past the corner that lies within h, by bisection."""
    low, high = 0.0, h
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        heun(x, m, r, acts, middle, d, k, y)
        if rates(y, m, r, acts, k) == here:
            low = middle
        else:
            high = middle
    heun(x, m, r, acts, high, d, k, y)
    return high
