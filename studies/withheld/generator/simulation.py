"""Simulate a rig: what its command goes through, how it moves, and what a sensor makes of it.

All on one fine grid; delays and frames are whole numbers of its steps.  A command passes the
stages of ``Command`` and drives the shaft; its angle passes those of ``Sensor``, each in the order
in which a signal meets them; one that is 0 is absent.  ``Outside`` comes and goes by itself.

The states are those of ``Q`` to ``FAR_W``; what friction, winding and magnet remember is kept
in ``memory`` and moves on at the end of a step.  All quantities in SI but the drive of a
servo, which is a share of its supply or top speed, and its feedback, which is an angle.

Sources: C. Canudas de Wit et al., "A new model for control of systems with friction", IEEE
Trans. Automatic Control 40 (1995) 419 (bristle); P. R. Dahl, AIAA J. 14 (1976) 1675 (hysteresis
with an exponent); R. Bouc (1967), Y. K. Wen, J. Eng. Mech. 102 (1976) 249; K. Heun (1900), third
order; M. Nordin, P.-O. Gutman, Automatica 38 (2002) 1633 (contacts of a mass in its play).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

from studies.withheld.generator.rigs import Rig

F = TypeVar("F", bound=Callable[..., Any])
Array = NDArray[np.float64]


class Constants(NamedTuple):
    """Constants of a rig and sizes of what acts on it; what is 0 is absent."""

    servo: float = 0.0  # 1 a closed-loop servo, 2 one with firmware, 0 a motor
    inertia: float = 1.0
    natural_frequency: float = 1.0
    decay: float = 1.0  # of a free shaft's speed [1/s]: 2 zeta omega
    top_speed: float = 0.0  # servo: speed of full drive
    largest_error: float = 0.0  # servo: that asks for full drive, before all else
    full: float = 1.0  # servo: largest drive, after all else
    acceleration: float = 0.0  # servo: largest of the shaft without a load
    rest: float = 0.0  # servo: feedback angle at which the output is 0
    drive_per_load: float = 0.0  # servo: 0 for a load that acts on the shaft
    tick: float = 0.0  # steps of the simulation from one drive of a loop to the next
    duty_per_angle: float = 0.0
    supply: float = 0.0
    corner: float = 0.0  # motor: resistance over inductance
    resistance: float = 1.0
    flux_per_angle: float = 0.0  # motor: as a current
    torque_per_current: float = 0.0
    loop_limit: float = 0.0  # motor: largest current of its speed loop
    loop_gain: float = 0.0  # current per speed
    loop_rate: float = 0.0  # inverse of the integral time
    travel: float = 0.0
    stop_frequency: float = 1.0  # of the shaft on its stop
    contact_rate: float = 1.0  # stiffness of the play's contact over the drag of the output
    bristle_stiffness: float = 1.0  # N m/rad

    extra_inertia: float = 0.0
    constant_load: float = 0.0
    gravity: float = 0.0
    gravity_phase: float = 0.0
    cogging: float = 0.0
    cogging_count: float = 0.0
    cogging_phase: float = 0.0
    drag: float = 0.0
    coulomb: float = 0.0
    load_friction: float = 0.0
    stiction: float = 0.0
    stribeck_speed: float = 1.0
    load_inertia: float = 0.0
    load_frequency: float = 0.0
    load_damping: float = 0.0
    coasting_share: float = 0.0  # of the inertia, behind a contact with play
    coasting_play: float = 0.0  # to either side
    contact_hertz: float = 0.0  # of the coasting mass on the contact
    contact_damping: float = 0.0
    play: float = 0.0
    lag: float = 0.0
    bow: float = 0.0
    cubic: float = 0.0
    full_scale: float = 1.0
    feedback_offset: float = 0.0
    feedback_step: float = 0.0
    asymmetry: float = 0.0
    error_dead_zone: float = 0.0
    hysteresis: float = 0.0
    turn: float = 1.0
    dead_zone: float = 0.0
    ceiling: float = 0.0
    current_limit: float = 0.0
    sag: float = 0.0  # resistance of the source; of the servo over its armature's
    heating: float = 0.0
    heating_time: float = 1.0
    knee: float = 0.0  # inverse current of flux saturation
    curvature: float = 0.0
    inverse_torque: float = 0.0
    null: float = 0.0
    hardening: float = 0.0

    quadratic_drag: float = 0.0
    forward_drag: float = 0.0
    bouc_torque: float = 0.0
    bouc_travel: float = 1.0
    mode_share: float = 0.0
    mode_frequency: float = 0.0
    mode_damping: float = 0.0
    kink_slope: float = 0.0
    kink_angle: float = 0.0


class Command(NamedTuple):
    """Stages of the command, in its own unit up to ``scale`` and that of the drive after it."""

    zero: float = 0.0  # command of no drive
    input_gain: float = 0.0  # before all else
    delay: float = 0.0  # s
    filter_time: float = 0.0  # s
    hold: float = 0.0  # s
    dead_band: float = 0.0
    scale: float = 1.0  # drive per command
    command_step: float = 0.0
    command_gain: float = 0.0
    command_offset: float = 0.0
    command_asymmetry: float = 0.0
    command_dead_zone: float = 0.0
    command_ceiling: float = 0.0
    slew: float = 0.0
    cruise: float = 0.0
    speeding_time: float = 0.0
    stick_band: float = 0.0
    slip_jump: float = 0.0  # over the band


class Sensor(NamedTuple):
    """Stages of the judged reading, in SI, and units of two others."""

    reading_play: float = 0.0
    reading_lag: float = 0.0
    reading_bow: float = 0.0
    reading_cubic: float = 0.0
    reading_scale: float = 1.0
    reading_gain: float = 0.0
    reading_slew: float = 0.0
    reading_offset: float = 0.0
    reading_step: float = 0.0
    drive_unit: float = 1.0  # what is logged over the drive
    feedback_unit: float = 1.0


BURST = (0.4, 1.6)  # length of a burst, in slowest time constants of the rig
SPELL = 0.3  # length of a spell in which a command is lost or not, likewise


class Outside(NamedTuple):
    """What comes and goes by itself."""

    lost_share: float = 0.0
    burst: float = 0.0
    sticking: float = 0.0
    hum: float = 0.0
    hum_frequency: float = 0.0
    load_gain: float = 0.0


def compiled(function: F) -> F:
    """Compile with numba, and keep what was compiled beside the file."""
    return cast(F, njit(cache=True, error_model="numpy")(function))


@compiled
def clip(value: float, limit: float) -> float:
    """A value inside +/- limit."""
    return min(max(value, -limit), limit)


@compiled
def coded(value: float, step: float) -> float:
    """A value rounded to whole codes; no step leaves it."""
    return value if step <= 0.0 else step * math.floor(value / step + 0.5)


@compiled
def filtered(command: Array, time: float, h: float) -> Array:
    """Return a command behind a first-order filter of this time constant [s], 0 for none."""
    if time <= 0.0:
        return command
    share = -math.expm1(-h / time)
    smooth = np.empty_like(command)
    smooth[0] = command[0]
    for n in range(1, len(command)):
        smooth[n] = smooth[n - 1] + share * (command[n] - smooth[n - 1])
    return smooth


@compiled
def travelled(command: Array, lost: Array, c: Command, h: float) -> Array:
    """Return what of a command arrives at the drive.

    Args:
        command: shape (n,), begins at rest.
        lost: 1 where a command is not received, so that the one before stays, shape (n,).
        c: stages.
        h: step [s].
    """
    late, frame = round(c.delay / h), round(c.hold / h)
    command = filtered((1.0 + c.input_gain) * (command - c.zero), c.filter_time, h)
    received = kept = held = command[0]
    arrived = np.empty_like(command)
    last = np.nan
    line = np.full(late + 1, command[0])
    static = 0.5 * (1.0 + c.slip_jump) * c.stick_band
    kinetic = 0.5 * (1.0 - c.slip_jump) * c.stick_band
    force = valve = driven = speed = 0.0
    for n in range(len(command)):
        if lost[n] == 0.0:
            received = command[n]
        line[n % (late + 1)] = received
        out = line[(n + 1) % (late + 1)]
        if frame > 0:
            if n % frame == 0:
                held = out
            out = held
        if c.dead_band > 0.0:
            if abs(out - kept) > c.dead_band:
                kept = out
            out = kept
        out = coded(out * c.scale, c.command_step)
        out = (1.0 + c.command_gain) * out + c.command_offset
        out += c.command_asymmetry * abs(out)
        out -= clip(out, c.command_dead_zone)
        if c.command_ceiling > 0.0:
            out = clip(out, c.command_ceiling)
        if c.slew > 0.0 and n > 0:
            before = last
            last += clip(out - last, c.slew * h)
            arrived[n] = 0.5 * (before + last)
        elif c.cruise > 0.0 and n > 0:
            push = c.cruise / max(c.speeding_time, h)
            stopping = math.sqrt(2.0 * push * abs(out - last))
            wanted = math.copysign(min(c.cruise, stopping), out - last)
            before, begun = last, speed
            speed += clip(wanted - speed, push * h)
            last += 0.5 * (begun + speed) * h
            arrived[n] = 0.5 * (before + last)
        else:
            arrived[n] = last = out
        if c.stick_band > 0.0:
            force += arrived[n] - driven
            driven = arrived[n]
            if abs(force) > static:
                residue = math.copysign(kinetic, force)
                valve += force - residue
                force = residue
            arrived[n] = valve
    return arrived


@compiled
def read(exact: Array, s: Sensor, h: float) -> Array:
    """Return what a sensor makes of an exact value [SI], shape (n,), before noise."""
    reading = np.empty_like(exact)
    output = lagged = slewed = before = 0.0
    follow = -math.expm1(-h / max(s.reading_lag, h))
    for n in range(len(exact)):
        value = exact[n]
        output += value - output - clip(value - output, s.reading_play)
        if s.reading_lag > 0.0:
            lagged += follow * (0.5 * (before + output) - lagged)
        else:
            lagged = output
        before = output
        ratio = lagged / s.reading_scale
        value = (1.0 + s.reading_gain) * lagged
        value += lagged * ratio * (s.reading_bow + s.reading_cubic * ratio)
        if s.reading_slew > 0.0:
            slewed += clip(value - slewed, s.reading_slew * h)
            value = slewed
        reading[n] = coded(value + s.reading_offset, s.reading_step)
    return reading


Q, W, LOAD_Q, LOAD_W, PLAY, ELECTRIC, MODE, MODE_RATE, BOUC, INTEGRAL, FAR_Q, FAR_W = range(12)
"""Shaft and load angle and speed, output behind the play, feedback lag or flux linkage (as the
current that makes it), the drive's resonance, Bouc-Wen's variable, integral part of a loop, angle
and speed of the coasting mass."""
STATES = 12
ANGLE, DRIVE, FEEDBACK, RATE, ASKED, BENT, PRESS, HEAT = range(STATES, STATES + 8)
"""Beside the rates: output angle, drive or current, feedback, rate of the output, drive that a
loop with a clock asks for, what the hysteresis reads, load on the gears, what heats."""
WIDTH = STATES + 8
SEEN = 4  # the first of these, which may be logged
COMMAND, GAIN, STICKING, TORQUE = range(4)
BRISTLE, FRICTION, WARMTH, LAST, MAGNET, HELD = range(6)
MEMORY = 6
FIRMWARE = 2.0
DAHL = 1.25  # exponent of the hysteresis; with 1 it would be that of Coleman and Hodgdon
LEAST_LEVEL = 1e-3  # of breakaway, so that a bristle always has some reach
BRISTLE_DAMPING, STOP_DAMPING = 0.6, 5.0
"""Over stiffness and swing; a stop so damped gives back 3 % of the speed."""
SPLITS, HALVINGS = 6, 12


@compiled
def bent(value: float, m: Array, r: Constants) -> float:
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
def resonant(value: float, x: Array, r: Constants, d: Array) -> float:
    """A signal of which a share passes through a second-order resonance."""
    if r.mode_share <= 0.0:
        return value
    own = r.mode_frequency
    d[MODE] = x[MODE_RATE]
    ahead: float = value - x[MODE]
    d[MODE_RATE] = own * (own * ahead - 2.0 * r.mode_damping * x[MODE_RATE])
    return value - r.mode_share * ahead


@compiled
def sensed(exact: float, x: Array, r: Constants, d: Array) -> int:
    """Write what a loop reads of an angle or speed to d[FEEDBACK]; returns its code."""
    seen = exact
    if r.lag > 0.0:
        d[ELECTRIC] = (exact - x[ELECTRIC]) / r.lag
        seen = x[ELECTRIC]
    seen += r.rest
    ratio = seen / r.full_scale
    seen += seen * ratio * (r.bow + r.cubic * ratio) + r.feedback_offset
    code = 0
    if r.feedback_step > 0.0:
        code = math.floor(seen / r.feedback_step + 0.5)
        seen = code * r.feedback_step
    d[FEEDBACK] = seen
    return code


@compiled
def firmware_torque(
    x: Array, m: Array, r: Constants, command: float, gain: float, load: float, d: Array
) -> int:
    """Add the torque of a motor under the duty of its firmware to d[W]; returns its regime."""
    sensed(d[ANGLE], x, r, d)
    duty = r.duty_per_angle * (command - d[FEEDBACK])
    d[ASKED] = clip(duty, r.ceiling if r.ceiling > 0.0 else 1.0)
    d[DRIVE] = m[HELD]
    voltage = m[HELD] * r.supply
    voltage += r.asymmetry * abs(voltage)
    voltage = gain * resonant(dead(voltage, r.dead_zone), x, r, d)
    d[HEAT] = voltage / r.supply
    voltage *= 1.0 - r.heating * m[WARMTH]
    current = (voltage - r.torque_per_current * x[W]) / r.resistance
    regime = 0
    if r.current_limit > 0.0:
        regime = 10 * side(current, r.current_limit)
        current = clip(current, r.current_limit)
    kink = 1.0 + r.kink_slope * max(0.0, d[ANGLE] - r.kink_angle)
    d[W] += r.torque_per_current * current * kink - load
    return regime


@compiled
def servo_torque(
    x: Array, m: Array, r: Constants, command: float, gain: float, load: float, d: Array
) -> int:
    """Add the motor's torque of a loop about the output to d[W]; returns its regime."""
    output = d[ANGLE]
    regime = 1000 * sensed(output, x, r, d)
    seen = d[FEEDBACK]
    error = dead(command - seen, r.error_dead_zone)
    if r.largest_error > 0.0:
        regime += 90 * side(error, r.largest_error)
        error = clip(error, r.largest_error)
    drive = error * r.natural_frequency**2 / (r.decay * r.top_speed)
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
    full = r.full - r.sag / (1.0 + r.sag) * max(0.0, 1.0 - opposing)
    regime += 10 * side(drive, full)
    drive = min(max(drive, -full), full)
    d[DRIVE] = drive
    used = drive - r.drive_per_load * load
    d[HEAT] = used
    used *= 1.0 - r.heating * m[WARMTH]
    kink = 1.0 + r.kink_slope * max(0.0, output - r.kink_angle)
    push = r.decay * (r.top_speed * used * kink - x[W])
    if r.acceleration > 0.0:
        regime += 270 * side(push, r.acceleration)
        push = clip(push, r.acceleration)
    d[W] += r.inertia * push
    if r.drive_per_load == 0.0:
        d[W] -= load
    return regime


@compiled
def wound(x: Array, r: Constants, voltage: float, gain: float, d: Array) -> float:
    """Current of a coil whose flux linkage is a state."""
    linked = (x[ELECTRIC] - r.flux_per_angle * x[Q]) / (1.0 + r.curvature * x[Q] * x[Q])
    current: float = linked
    if r.knee > 0.0:
        current = math.tan(min(max(r.knee * linked, -1.5), 1.5)) / r.knee
    applied = gain * resonant(voltage, x, r, d) - r.sag * current
    d[ELECTRIC] = r.corner * (applied / r.resistance - current)
    return current


@compiled
def regulated(
    x: Array, m: Array, r: Constants, command: float, gain: float, d: Array
) -> tuple[float, int]:
    """Current that a PI loop about the speed gives, and its regime.

    At its limit the integral part follows what is given, so that it never winds up.
    """
    regime = 1000 * sensed(x[W], x, r, d)
    wanted = r.loop_gain * (command - d[FEEDBACK]) + x[INTEGRAL]
    regime += 90 * side(wanted, r.loop_limit)
    d[ASKED] = clip(wanted, r.loop_limit)
    d[INTEGRAL] = r.loop_rate * (d[ASKED] - x[INTEGRAL])
    current = m[HELD] if r.tick > 0.0 else d[ASKED]
    regime += 30 * side(current, r.dead_zone)
    return gain * resonant(dead(current, r.dead_zone), x, r, d), regime


@compiled
def motor_torque(
    x: Array, m: Array, r: Constants, command: float, gain: float, load: float, d: Array
) -> int:
    """Add the torque of a current to d[W], from a speed loop, a voltage or as it is; returns its
    regime."""
    regime = 0
    if r.loop_limit > 0.0:
        current, regime = regulated(x, m, r, command, gain, d)
    else:
        d[FEEDBACK] = x[Q]
        if r.corner > 0.0:
            current = wound(x, r, command, gain, d)
        else:
            current = gain * resonant(command, x, r, d)
    current += r.asymmetry * abs(current)
    d[DRIVE] = current
    d[BENT] = current
    if r.hysteresis > 0.0:
        current -= r.hysteresis * bent(current, m, r)
    pull = r.torque_per_current * current
    if r.inverse_torque > 0.0:
        pull /= math.sqrt(1.0 + (r.inverse_torque * pull) ** 2)
    d[HEAT] = pull
    pull *= 1.0 - r.heating * m[WARMTH]
    pull *= 1.0 + r.kink_slope * max(0.0, x[Q] - r.kink_angle)
    away = x[Q] - r.null
    spring = r.natural_frequency**2 * away * (1.0 + r.hardening * away * away)
    d[W] += pull - r.inertia * (spring + r.decay * x[W]) - load
    return regime


@compiled
def pushed(x: Array, r: Constants, load: float, d: Array) -> tuple[float, int]:
    """Torque on a mass that coasts through its play, and its regime; the load acts on that mass.

    The contact is a spring and a damper on either side that push it and never pull.
    """
    near, near_rate = (x[LOAD_Q], x[LOAD_W]) if r.load_inertia > 0.0 else (x[Q], x[W])
    mass = r.coasting_share * (r.inertia + r.extra_inertia)
    own = 2.0 * math.pi * r.contact_hertz
    pressed = dead(near - x[FAR_Q], r.coasting_play)
    push = own * (own * pressed + 2.0 * r.contact_damping * (near_rate - x[FAR_W]))
    regime = side(near - x[FAR_Q], r.coasting_play)
    if push * pressed <= 0.0:
        push, regime = 0.0, 1
    d[FAR_Q] = x[FAR_W]
    d[FAR_W] = push - load / mass
    return mass * push, regime


@compiled
def placed(x: Array, r: Constants, d: Array) -> int:
    """Write angle and rate of the output to d; returns the regime of its play."""
    regime = 0
    output, d[RATE] = x[Q], x[W]
    if r.load_inertia > 0.0:
        output, d[RATE] = x[LOAD_Q], x[LOAD_W]
    if r.coasting_share > 0.0:
        output, d[RATE] = x[FAR_Q], x[FAR_W]
    if r.play > 0.0:
        regime = side(output - x[PLAY], r.play)
        d[PLAY] = r.contact_rate * dead(output - x[PLAY], r.play)
        output, d[RATE] = x[PLAY], d[PLAY]
    d[ANGLE] = output
    return regime


@compiled
def rates(x: Array, m: Array, r: Constants, acts: Array, d: Array) -> int:
    """Rates of the states and what is seen of them into d, shape (WIDTH,).

    ``acts``: command, factor on the drive, level of sticking [N m], load torque [N m].
    Returns a number that changes where the right hand side has a corner.
    """
    for i in range(STATES):
        d[i] = 0.0
    d[Q] = x[W]
    regime = placed(x, r, d)
    load = r.constant_load + acts[TORQUE]
    if r.gravity != 0.0:
        load += r.gravity * math.sin(d[ANGLE] + r.gravity_phase)
    if r.coasting_share > 0.0:
        load, contact = pushed(x, r, load, d)
        regime += 9 * contact
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
    if r.servo == FIRMWARE:
        regime += firmware_torque(x, m, r, acts[COMMAND], acts[GAIN], load, d)
    elif r.servo > 0.0:
        regime += servo_torque(x, m, r, acts[COMMAND], acts[GAIN], load, d)
    else:
        regime += motor_torque(x, m, r, acts[COMMAND], acts[GAIN], load, d)
    total = (1.0 - r.coasting_share) * (r.inertia + r.extra_inertia)
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
def bristles(m: Array, r: Constants, speed: float, press: float, sticking: float, h: float) -> None:
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
def remember(m: Array, r: Constants, d: Array, speed: float, sticking: float, h: float) -> None:
    """Move friction, warmth and hysteresis on by a step h that ended with rates d."""
    bristles(m, r, speed, d[PRESS], sticking, h)
    m[WARMTH] += h / r.heating_time * (d[HEAT] ** 2 - m[WARMTH])
    if r.hysteresis > 0.0:
        m[MAGNET] = bent(d[BENT], m, r)
        m[LAST] = d[BENT]


@compiled
def heun(
    x: Array, m: Array, r: Constants, acts: Array, h: float, d: Array, k: Array, y: Array
) -> None:
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
def run(r: Constants, acts: Array, h: float, seen: Array) -> None:
    """Simulate from the state of rest.

    Args:
        r: the constants of the rig.
        acts: shape (n, 4), see ``rates``; each row is held for the step h [s] that follows.
        seen: written: angle, drive or current, feedback, and rate before each step and before what
            acts in it, shape (n, 4).
    """
    x, y = np.zeros(STATES), np.zeros(STATES)
    d, k = np.zeros(WIDTH), np.zeros(WIDTH)
    m = np.zeros(MEMORY)
    rates(x, m, r, acts[0], d)
    for n in range(len(acts)):
        for i in range(SEEN):
            seen[n, i] = d[ANGLE + i]
        here = rates(x, m, r, acts[n], d)
        if r.tick > 0.0 and n % r.tick == 0:
            m[HELD] = d[ASKED]
            here = rates(x, m, r, acts[n], d)
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
    x: Array, m: Array, r: Constants, acts: Array, h: float, d: Array, k: Array, y: Array, here: int
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


STAGES = (Constants, Command, Sensor, Outside)
RECORD = np.dtype([(name, float) for name in Constants._fields])


@dataclass(frozen=True)
class Plan:
    """What a log is made of.

    Attributes:
        stride: steps of the simulation per row.
        command: SI, one value per row, shape (n,).
        load: over the load torque of the experiment, shape (n,); None for 1 in all rows.
        rows: those that are logged, rising; None for all.
    """

    stride: int
    command: Array
    load: Array | None = None
    rows: NDArray[np.int64] | None = None

    @property
    def logged(self) -> NDArray[np.int64]:
        """Rows that are logged, shape (m,)."""
        return np.arange(len(self.command)) if self.rows is None else self.rows

    @property
    def shares(self) -> Array:
        """The load over that of the experiment, shape (n,)."""
        return np.ones(len(self.command)) if self.load is None else self.load

    def held(self, rows: Array, before: int) -> Array:
        """Rows held for the steps of each, after ``before`` steps of the first."""
        held = np.repeat(rows, self.stride)[: -self.stride + 1 or None]
        return np.concatenate([np.full(before, rows[0]), held])


@dataclass(frozen=True)
class Experiment:
    """A rig and its plans.

    Attributes:
        rig: which rig.
        true: its constants by the product's names [SI].
        load: load torque [N m], of which a plan may have other shares in each row.
        plans: one per log.
        readings: places of what is logged, the judged one first.
        seed: of what comes and goes by itself.
    """

    rig: Rig
    true: Mapping[str, float]
    load: float
    plans: Sequence[Plan]
    readings: tuple[int, ...]
    seed: int

    @property
    def varied(self) -> bool:
        """Whether the load changes, so that a log has a column of it."""
        return self.load != 0.0 and any(plan.load is not None for plan in self.plans)

    @cached_property
    def units(self) -> dict[str, float]:
        return self.rig.units(self.true)

    @cached_property
    def plain(self) -> tuple[Array, ...]:
        """Logs without any cause."""
        return self.logs({})

    def logs(self, settings: Mapping[str, float]) -> tuple[Array, ...]:
        """Return noise-free logs [SI], one of shape (logged rows, readings) per plan."""
        every = {**self.rig.constants(self.true), **settings}
        unknown = set(every) - {name for stage in STAGES for name in stage._fields}
        if unknown:
            raise KeyError(f"no such settings: {sorted(unknown)}")
        return tuple(self._log(plan, every, i) for i, plan in enumerate(self.plans))

    def gap(self, logs: Sequence[Array]) -> float:
        """Return the RMS difference [SI] of the judged reading from that without any cause."""
        apart = np.concatenate([a[:, 0] - b[:, 0] for a, b in zip(logs, self.plain)])
        return float(np.sqrt(np.mean(apart * apart)))

    @cached_property
    def ranges(self) -> Array:
        """Range of every reading without any cause [SI], shape (readings,)."""
        return np.asarray(np.ptp(np.concatenate(self.plain), axis=0))

    def _log(self, plan: Plan, settings: Mapping[str, float], number: int) -> Array:
        step = self.rig.step
        before = round(self.rig.settle / step)
        command = plan.held(plan.command, before)
        outside, lost = disturbed(
            settings, len(command), step, self.rig.slowest, self.seed + number
        )
        scale = 1.0 + settings.get("load_gain", 0.0)
        outside[:, TORQUE - GAIN] += scale * self.load * plan.held(plan.shares, before)
        seen = np.empty((len(command), SEEN))
        drive = travelled(command, lost, _some(Command, settings), step)
        constants: Any = np.rec.array([tuple(_some(Constants, settings))], dtype=RECORD)[0]
        run(constants, np.column_stack([drive, outside]), step, seen)
        sensor = _some(Sensor, settings)
        judged = self.readings[0]
        seen[:, judged] = read(seen[:, judged].copy(), sensor, step)
        seen[:, DRIVE - ANGLE] *= sensor.drive_unit
        seen[:, FEEDBACK - ANGLE] *= sensor.feedback_unit
        return seen[before :: plan.stride][plan.logged][:, self.readings]


def _some(stage: Any, settings: Mapping[str, float]) -> Any:
    """The settings of one stage."""
    return stage(**{name: settings[name] for name in stage._fields if name in settings})


def disturbed(
    settings: Mapping[str, float], count: int, step: float, slow: float, seed: int
) -> tuple[Array, Array]:
    """Return what comes and goes during a log.

    Args:
        settings: sizes by name, see ``Outside``.
        count, step: of the simulation's grid [s].
        slow: slowest time constant [s].
        seed: the same one gives the same instants for every size.

    Returns:
        factor on the drive, sticking [N m] and torque [N m], shape (count, 3); and 1 where a
        command is lost, shape (count,).
    """
    o = Outside(**{key: settings[key] for key in Outside._fields if key in settings})
    outside, lost = np.zeros((count, 3)), np.zeros(count)
    outside[:, 0] = 1.0
    rng = np.random.default_rng(seed)
    if o.lost_share > 0.0:
        spell = round(SPELL * slow / step)
        fate = rng.random(count // spell + 1)
        lost = np.repeat((fate < o.lost_share).astype(float), spell)[:count]
    if o.burst > 0.0:
        outside[:, 0] += o.burst * _bursts(rng, count, slow / step, smooth=True)
    if o.sticking > 0.0:
        outside[:, 1] = o.sticking * np.abs(_bursts(rng, count, slow / step, smooth=False))
    if o.hum > 0.0:
        phase = o.hum_frequency * step * np.arange(count) + 2.0 * math.pi * rng.random()
        outside[:, 2] = o.hum * np.sin(phase)
    return outside, lost


def _bursts(rng: np.random.Generator, count: int, slow: float, smooth: bool) -> Array:
    """Bursts of either sign with pauses between them, each as long as chance will have it."""
    level, at = np.zeros(count), 0
    while at < count:
        pause, length = (int(slow * rng.uniform(*BURST)) for _ in range(2))
        height = rng.uniform(0.5, 1.0) * rng.choice([-1.0, 1.0])
        shape = np.sin(np.pi * (np.arange(length) + 0.5) / length) ** 2 if smooth else 1.0
        inside = level[at + pause : at + pause + length]
        inside += (height * shape)[: len(inside)] if smooth else height
        at += pause + length
    return level
