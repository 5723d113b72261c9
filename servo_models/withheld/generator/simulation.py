"""Simulate a rig: what its command goes through, how it moves, and what a sensor makes of it.

All on one fine grid; delays and frames are whole numbers of its steps.  A command passes the
stages of ``Command`` and drives the shaft; its angle passes those of ``Reading``, each in the order
in which a signal meets them.  ``Outside`` comes and goes by itself.

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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from servo_models.withheld.generator.rigs import (
    ANGLE_LOOP,
    CURRENT,
    FIRMWARE,
    SPEED_LOOP,
    VOLTAGE,
    Rig,
)
from servo_models.withheld.rig.laws import (
    Array,
    clip,
    code_of,
    coded,
    compiled,
    dead,
    duty,
    pressed,
)


class Loop(NamedTuple):
    kind: float = CURRENT
    gain: float = 0.0  # of speed: current per speed
    rate: float = 0.0  # of speed: inverse of the integral time
    largest_current: float = math.inf  # of speed
    top_speed: float = 0.0  # of angle: speed of full drive
    largest_error: float = math.inf  # of angle: that asks for full drive, before all else
    error_dead_zone: float = 0.0  # of angle
    full: float = 1.0  # of angle: largest drive, after all else
    acceleration: float = math.inf  # of angle: largest of the shaft without a load
    rest: float = 0.0  # of angle: feedback angle at which the output is 0
    drive_per_load: float = 0.0  # of angle: 0 for a load that acts on the shaft
    duty_per_angle: float = 0.0  # firmware
    supply: float = 0.0  # firmware
    tick: float = 0.0  # steps of the simulation from one drive to the next, 0 without a clock


class Feedback(NamedTuple):
    lag: float = 0.0
    bow: float = 0.0
    cubic: float = 0.0
    full_scale: float = 1.0
    offset: float = 0.0
    step: float = 0.0


class Drive(NamedTuple):
    asymmetry: float = 0.0
    hysteresis: float = 0.0
    turn: float = 1.0
    dead_zone: float = 0.0
    ceiling: float = math.inf
    sag: float = 0.0  # resistance of the source; of the servo over its armature's
    heating: float = 0.0
    heating_time: float = 1.0
    mode_share: float = 0.0
    mode_frequency: float = 0.0
    mode_damping: float = 0.0
    kink_slope: float = 0.0
    kink_angle: float = 0.0


class Motor(NamedTuple):
    corner: float = 0.0  # resistance over inductance
    resistance: float = 1.0
    flux_per_angle: float = 0.0  # as a current
    torque_per_current: float = 0.0
    current_limit: float = math.inf
    knee: float = 0.0  # inverse current of flux saturation
    curvature: float = 0.0
    inverse_torque: float = 0.0


class Shaft(NamedTuple):
    inertia: float = 1.0
    extra_inertia: float = 0.0
    natural_frequency: float = 1.0
    decay: float = 1.0  # of a free shaft's speed [1/s]: 2 zeta omega
    null: float = 0.0
    hardening: float = 0.0
    travel: float = math.inf
    stop_frequency: float = 1.0  # of the shaft on its stop


class Gear(NamedTuple):
    load_inertia: float = 0.0  # on a spring
    load_frequency: float = 0.0
    load_damping: float = 0.0
    coasting_share: float = 0.0  # of the inertia, behind a contact with play
    coasting_play: float = 0.0  # to either side
    contact_hertz: float = 0.0  # of the coasting mass on the contact
    contact_damping: float = 0.0
    play: float = 0.0
    contact_rate: float = 1.0  # stiffness of the play's contact over the drag of the output


class Load(NamedTuple):
    constant: float = 0.0
    gravity: float = 0.0
    gravity_phase: float = 0.0
    cogging: float = 0.0
    cogging_count: float = 0.0
    cogging_phase: float = 0.0
    drag: float = 0.0
    quadratic_drag: float = 0.0
    forward_drag: float = 0.0
    bouc_torque: float = 0.0
    bouc_stiffness: float = 0.0


class Friction(NamedTuple):
    coulomb: float = 0.0
    per_load: float = 0.0
    stiction: float = 0.0
    stribeck_speed: float = 1.0
    bristle_stiffness: float = 1.0  # N m/rad


class Command(NamedTuple):
    zero: float = 0.0  # command of no drive
    input_gain: float = 0.0  # before all else
    delay: float = 0.0  # s
    filter_time: float = 0.0  # s
    hold: float = 0.0  # s
    dead_band: float = 0.0
    scale: float = 1.0  # drive per command
    step: float = 0.0
    gain: float = 0.0
    offset: float = 0.0
    asymmetry: float = 0.0
    dead_zone: float = 0.0
    ceiling: float = math.inf
    slew: float = math.inf
    cruise: float = math.inf
    speeding_time: float = 0.0
    stick_band: float = 0.0
    slip_jump: float = 0.0  # over the band


class Reading(NamedTuple):
    play: float = 0.0
    lag: float = 0.0
    bow: float = 0.0
    cubic: float = 0.0
    full_scale: float = 1.0
    gain: float = 0.0
    slew: float = math.inf
    offset: float = 0.0
    step: float = 0.0
    drive_unit: float = 1.0  # what is logged over the drive
    feedback_unit: float = 1.0


BURST = (0.4, 1.6)  # length of a burst, in slowest time constants of the rig
SPELL = 0.3  # length of a spell in which a command is lost or not, likewise


class Outside(NamedTuple):
    lost_share: float = 0.0
    burst: float = 0.0
    sticking: float = 0.0
    hum: float = 0.0
    hum_frequency: float = 0.0
    load_gain: float = 0.0


class Settings(NamedTuple):
    """All that a simulation takes; a setting is called by both names, as in ``gear.play``.

    A torque, a share, a time or a step of codes that a rig has not is 0, a limit infinite.
    """

    loop: Loop = Loop()  # what makes a drive of the command
    feedback: Feedback = Feedback()  # what a loop reads of the output, or of the speed
    drive: Drive = Drive()  # what a voltage, a current or a share of the supply goes through
    motor: Motor = Motor()  # winding and magnet
    shaft: Shaft = Shaft()  # what turns, on a spring or free
    gear: Gear = Gear()  # what is between shaft and output
    load: Load = Load()  # torques on shaft and output
    friction: Friction = Friction()  # dry friction of the shaft
    command: Command = Command()  # its stages, up to ``scale`` in its own unit
    reading: Reading = Reading()  # stages of the judged one, in SI, and units of two others
    outside: Outside = Outside()  # what comes and goes by itself


ABSENT = {group: it._asdict() for group, it in Settings()._asdict().items()}
RECORD = np.dtype([(group, [(name, float) for name in it]) for group, it in ABSENT.items()])


def settled(values: Mapping[str, float]) -> Settings:
    """Settings by name in the form that is compiled fast, a record.

    Raises:
        KeyError: there is no such setting.
    """
    every = np.rec.array([Settings()], dtype=RECORD)
    for name, value in values.items():
        group, _, field = name.partition(".")
        if field not in ABSENT.get(group, ()):
            raise KeyError(f"no such setting: '{name}'")
        every[group][field] = value
    return cast(Settings, every[0])


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
def travelled(command: Array, lost: Array, s: Settings, h: float) -> Array:
    """Return what of a command arrives at the drive.

    Args:
        command: shape (n,), begins at rest.
        lost: 1 where a command is not received, so that the one before stays, shape (n,).
        s: of which it passes the stages of ``command``.
        h: step [s].
    """
    c = s.command
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
        if abs(out - kept) > c.dead_band:
            kept = out
        out = coded(kept * c.scale, c.step)
        out = (1.0 + c.gain) * out + c.offset
        out += c.asymmetry * abs(out)
        out = clip(dead(out, c.dead_zone), c.ceiling)
        if min(c.slew, c.cruise) == math.inf or n == 0:
            arrived[n] = last = out
        else:
            before = last
            if c.slew < math.inf:
                last += clip(out - last, c.slew * h)
            else:
                push = c.cruise / max(c.speeding_time, h)
                stopping = math.sqrt(2.0 * push * abs(out - last))
                wanted = math.copysign(min(c.cruise, stopping), out - last)
                begun = speed
                speed += clip(wanted - speed, push * h)
                last += 0.5 * (begun + speed) * h
            arrived[n] = 0.5 * (before + last)
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
def bend(value: float, full_scale: float, bow: float, cubic: float) -> float:
    """What a sensor adds to a value that is not on its straight line."""
    ratio = value / full_scale
    return value * ratio * (bow + cubic * ratio)


@compiled
def read(exact: Array, s: Settings, h: float) -> Array:
    """Return what a sensor makes of an exact value [SI], shape (n,), before noise."""
    r = s.reading
    reading = np.empty_like(exact)
    output = lagged = slewed = before = 0.0
    follow = -math.expm1(-h / max(r.lag, h))
    for n in range(len(exact)):
        output += dead(exact[n] - output, r.play)
        if r.lag > 0.0:
            lagged += follow * (0.5 * (before + output) - lagged)
        else:
            lagged = output
        before = output
        value = (1.0 + r.gain) * lagged
        value += bend(lagged, r.full_scale, r.bow, r.cubic)
        if r.slew < math.inf:
            slewed += clip(value - slewed, r.slew * h)
            value = slewed
        reading[n] = coded(value + r.offset, r.step)
    return reading


Q, W, LOAD_Q, LOAD_W, PLAY, ELECTRIC, MODE, MODE_RATE, BOUC, INTEGRAL, FAR_Q, FAR_W = range(12)
"""Shaft and load angle and speed, output behind the play, feedback lag or flux linkage (as the
current that makes it), the drive's resonance, Bouc-Wen's variable, integral part of a loop, angle
and speed of the coasting mass."""
STATES = 12
ANGLE, DRIVE, FEEDBACK, RATE, AMPERES, ASKED, BENT, PRESS, HEAT = range(STATES, STATES + 9)
"""Beside the rates: output angle, drive or current, feedback, rate of the output, current under a
duty, drive that a loop with a clock asks for, what the hysteresis reads, load on the gears, what
heats."""
WIDTH = STATES + 9
SEEN = 5  # the first of these, which may be logged
COMMAND, GAIN, STICKING, TORQUE = range(4)
BRISTLE, FRICTION, WARMTH, LAST, MAGNET, HELD = range(6)
MEMORY = 6
DAHL = 1.25  # exponent of the hysteresis; with 1 it would be that of Coleman and Hodgdon
LEAST_LEVEL = 1e-3  # of breakaway, so that a bristle always has some reach
BRISTLE_DAMPING, STOP_DAMPING = 0.6, 5.0
"""Over stiffness and swing; a stop so damped gives back 3 % of the speed."""
SPLITS, HALVINGS = 6, 12


@compiled
def side(value: float, half: float) -> int:
    """0 below -half, 1 between, 2 above half."""
    return 0 if value < -half else (2 if value > half else 1)


@compiled
def bent(value: float, m: Array, turn: float) -> float:
    """Hysteresis variable, -1 to 1, at a value: turn dz/dv = (1 - z)^p where v grows.

    Solved exactly from the value and the variable that were remembered.
    """
    way = math.copysign(1.0, value - m[LAST])
    left: float = 1.0 - way * m[MAGNET]
    if left > 0.0:
        grown = (DAHL - 1.0) * abs(value - m[LAST]) / turn
        left = math.pow(math.pow(left, 1.0 - DAHL) + grown, -1.0 / (DAHL - 1.0))
    return way * (1.0 - left)


@compiled
def uneven(drive: float, m: Array, s: Settings, d: Array) -> float:
    """A drive that is larger one way, behind its hysteresis."""
    drive += s.drive.asymmetry * abs(drive)
    d[BENT] = drive
    if s.drive.hysteresis > 0.0:
        drive -= s.drive.hysteresis * bent(drive, m, s.drive.turn)
    return drive


@compiled
def resonant(value: float, x: Array, s: Settings, d: Array) -> float:
    """A signal of which a share passes through a second-order resonance."""
    if s.drive.mode_share <= 0.0:
        return value
    own = s.drive.mode_frequency
    d[MODE] = x[MODE_RATE]
    ahead: float = value - x[MODE]
    d[MODE_RATE] = own * (own * ahead - 2.0 * s.drive.mode_damping * x[MODE_RATE])
    return value - s.drive.mode_share * ahead


@compiled
def warm(m: Array, s: Settings) -> float:
    """What heat leaves of a drive."""
    left: float = 1.0 - s.drive.heating * m[WARMTH]
    return left


@compiled
def kinked(angle: float, s: Settings) -> float:
    """Gain of the drive, which changes its slope at an angle."""
    return 1.0 + s.drive.kink_slope * max(0.0, angle - s.drive.kink_angle)


@compiled
def sensed(exact: float, x: Array, s: Settings, d: Array) -> int:
    """Write what a loop reads of an angle or speed to d[FEEDBACK]; returns its code."""
    f = s.feedback
    seen = exact
    if f.lag > 0.0:
        d[ELECTRIC] = (exact - x[ELECTRIC]) / f.lag
        seen = x[ELECTRIC]
    seen += s.loop.rest
    seen += bend(seen, f.full_scale, f.bow, f.cubic) + f.offset
    code = 0
    if f.step > 0.0:
        code = code_of(seen, f.step)
        seen = code * f.step
    d[FEEDBACK] = seen
    return code


@compiled
def firmware_torque(x: Array, m: Array, s: Settings, acts: Array, load: float, d: Array) -> int:
    """Add the torque of a motor under the duty of its firmware to d[W]; returns its regime."""
    sensed(d[ANGLE], x, s, d)
    most = min(s.drive.ceiling, 1.0)
    d[ASKED] = duty(acts[COMMAND], d[FEEDBACK], s.loop.duty_per_angle, most)
    d[DRIVE] = m[HELD]
    voltage = m[HELD] * s.loop.supply
    voltage += s.drive.asymmetry * abs(voltage)
    voltage = acts[GAIN] * resonant(dead(voltage, s.drive.dead_zone), x, s, d)
    d[HEAT] = voltage / s.loop.supply
    voltage *= warm(m, s)
    current = (voltage - s.motor.torque_per_current * x[W]) / s.motor.resistance
    regime = 10 * side(current, s.motor.current_limit)
    current = clip(current, s.motor.current_limit)
    d[AMPERES] = current
    d[W] += s.motor.torque_per_current * current * kinked(d[ANGLE], s) - load
    return regime


@compiled
def servo_torque(x: Array, m: Array, s: Settings, acts: Array, load: float, d: Array) -> int:
    """Add the motor's torque of a loop about the output to d[W]; returns its regime."""
    top = s.loop.top_speed
    regime = 1000 * sensed(d[ANGLE], x, s, d)
    error = dead(acts[COMMAND] - d[FEEDBACK], s.loop.error_dead_zone)
    regime += 90 * side(error, s.loop.largest_error)
    error = clip(error, s.loop.largest_error)
    drive = error * s.shaft.natural_frequency**2 / (s.shaft.decay * top)
    drive = uneven(drive, m, s, d)
    if s.drive.dead_zone > 0.0:
        regime += 100 * side(drive, s.drive.dead_zone)
        drive = dead(drive, s.drive.dead_zone)
    regime += 30 * side(drive, s.drive.ceiling)
    drive = acts[GAIN] * resonant(clip(drive, s.drive.ceiling), x, s, d)
    opposing = math.copysign(x[W], x[W] * drive) / top
    full = s.loop.full - s.drive.sag / (1.0 + s.drive.sag) * max(0.0, 1.0 - opposing)
    regime += 10 * side(drive, full)
    drive = clip(drive, full)
    d[DRIVE] = drive
    used = drive - s.loop.drive_per_load * load
    d[HEAT] = used
    used *= warm(m, s)
    push = s.shaft.decay * (top * used * kinked(d[ANGLE], s) - x[W])
    regime += 270 * side(push, s.loop.acceleration)
    d[W] += s.shaft.inertia * clip(push, s.loop.acceleration)
    if s.loop.drive_per_load == 0.0:
        d[W] -= load
    return regime


@compiled
def wound(x: Array, s: Settings, voltage: float, gain: float, d: Array) -> float:
    """Current of a coil whose flux linkage is a state."""
    linked = x[ELECTRIC] - s.motor.flux_per_angle * x[Q]
    current: float = linked / (1.0 + s.motor.curvature * x[Q] * x[Q])
    if s.motor.knee > 0.0:
        current = math.tan(clip(s.motor.knee * current, 1.5)) / s.motor.knee
    applied = gain * resonant(voltage, x, s, d) - s.drive.sag * current
    d[ELECTRIC] = s.motor.corner * (applied / s.motor.resistance - current)
    return current


@compiled
def regulated(x: Array, m: Array, s: Settings, acts: Array, d: Array) -> tuple[float, int]:
    """Current that a PI loop about the speed gives, and its regime.

    At its limit the integral part follows what is given, so that it never winds up.
    """
    regime = 1000 * sensed(x[W], x, s, d)
    wanted = s.loop.gain * (acts[COMMAND] - d[FEEDBACK]) + x[INTEGRAL]
    regime += 90 * side(wanted, s.loop.largest_current)
    d[ASKED] = clip(wanted, s.loop.largest_current)
    d[INTEGRAL] = s.loop.rate * (d[ASKED] - x[INTEGRAL])
    current = m[HELD] if s.loop.tick > 0.0 else d[ASKED]
    regime += 30 * side(current, s.drive.dead_zone)
    return acts[GAIN] * resonant(dead(current, s.drive.dead_zone), x, s, d), regime


@compiled
def motor_torque(x: Array, m: Array, s: Settings, acts: Array, load: float, d: Array) -> int:
    """Add the torque of a current to d[W], from a speed loop, a voltage or as it is; returns its
    regime."""
    regime = 0
    d[FEEDBACK] = x[Q]
    if s.loop.kind == SPEED_LOOP:
        current, regime = regulated(x, m, s, acts, d)
    elif s.loop.kind == VOLTAGE:
        current = wound(x, s, acts[COMMAND], acts[GAIN], d)
    else:
        current = acts[GAIN] * resonant(acts[COMMAND], x, s, d)
    current = uneven(current, m, s, d)
    d[DRIVE] = d[BENT]
    pull = s.motor.torque_per_current * current
    if s.motor.inverse_torque > 0.0:
        pull /= math.sqrt(1.0 + (s.motor.inverse_torque * pull) ** 2)
    d[HEAT] = pull
    pull *= warm(m, s)
    pull *= kinked(x[Q], s)
    away = x[Q] - s.shaft.null
    spring = s.shaft.natural_frequency**2 * away * (1.0 + s.shaft.hardening * away * away)
    d[W] += pull - s.shaft.inertia * (spring + s.shaft.decay * x[W]) - load
    return regime


@compiled
def pushed(x: Array, s: Settings, load: float, d: Array) -> tuple[float, int]:
    """Torque on a mass that coasts through its play, and its regime; the load acts on that mass."""
    g = s.gear
    near, near_rate = (x[LOAD_Q], x[LOAD_W]) if g.load_inertia > 0.0 else (x[Q], x[W])
    mass = g.coasting_share * (s.shaft.inertia + s.shaft.extra_inertia)
    own = 2.0 * math.pi * g.contact_hertz
    apart = near - x[FAR_Q]
    beyond = dead(apart, g.coasting_play)
    push = pressed(beyond, near_rate - x[FAR_W], own, 2.0 * g.contact_damping, own)
    d[FAR_Q] = x[FAR_W]
    d[FAR_W] = push - load / mass
    return mass * push, side(apart, g.coasting_play) if push != 0.0 else 1


@compiled
def placed(x: Array, s: Settings, d: Array) -> int:
    """Write angle and rate of the output to d; returns the regime of its play."""
    g = s.gear
    regime = 0
    output, d[RATE] = x[Q], x[W]
    if g.load_inertia > 0.0:
        output, d[RATE] = x[LOAD_Q], x[LOAD_W]
    if g.coasting_share > 0.0:
        output, d[RATE] = x[FAR_Q], x[FAR_W]
    if g.play > 0.0:
        regime = side(output - x[PLAY], g.play)
        d[PLAY] = g.contact_rate * dead(output - x[PLAY], g.play)
        output, d[RATE] = x[PLAY], d[PLAY]
    d[ANGLE] = output
    return regime


@compiled
def rates(x: Array, m: Array, s: Settings, acts: Array, d: Array) -> int:
    """Rates of the states and what is seen of them into d, shape (WIDTH,).

    ``acts``: command, factor on the drive, level of sticking [N m], load torque [N m].
    Returns a number that changes where the right hand side has a corner.
    """
    t, g = s.load, s.gear
    for i in range(STATES):
        d[i] = 0.0
    d[Q] = x[W]
    regime = placed(x, s, d)
    load = t.constant + acts[TORQUE]
    if t.gravity != 0.0:
        load += t.gravity * math.sin(d[ANGLE] + t.gravity_phase)
    if g.coasting_share > 0.0:
        load, contact = pushed(x, s, load, d)
        regime += 9 * contact
    if g.load_inertia > 0.0:
        own = g.load_frequency
        twist = own * (x[Q] - x[LOAD_Q]) + 2.0 * g.load_damping * (x[W] - x[LOAD_W])
        d[LOAD_Q] = x[LOAD_W]
        d[LOAD_W] = own * twist - load / g.load_inertia
        load = g.load_inertia * own * twist
    d[PRESS] = abs(load)
    load += x[W] * (t.drag + t.quadratic_drag * abs(x[W]))
    load += t.forward_drag * max(x[W], 0.0)
    if t.cogging > 0.0:
        load += t.cogging * math.sin(t.cogging_count * x[Q] + t.cogging_phase)
    if t.bouc_torque > 0.0:
        z = x[BOUC]
        d[BOUC] = x[W] - z * (0.8 * abs(x[W] * z) + 0.2 * x[W] * z)
        d[BOUC] *= t.bouc_stiffness / t.bouc_torque
        load += t.bouc_torque * z
    if s.loop.kind == FIRMWARE:
        regime += firmware_torque(x, m, s, acts, load, d)
    elif s.loop.kind == ANGLE_LOOP:
        regime += servo_torque(x, m, s, acts, load, d)
    else:
        regime += motor_torque(x, m, s, acts, load, d)
    total = (1.0 - g.coasting_share) * (s.shaft.inertia + s.shaft.extra_inertia)
    d[W] -= m[FRICTION]
    regime += 3 * side(x[Q], s.shaft.travel)
    beyond, own = dead(x[Q], s.shaft.travel), s.shaft.stop_frequency
    d[W] -= pressed(beyond, x[W], own, STOP_DAMPING, total * own)
    d[W] /= total
    return regime


@compiled
def bristles(m: Array, s: Settings, speed: float, press: float, sticking: float, h: float) -> None:
    """Bend the bristle for a step h at this speed; its force counts from the next step on.

    The bristle's equation z' = v - |v| z / reach(v) is solved exactly for a constant speed, so
    it may be as stiff as it likes.  Its damping fades with the speed, or a fast reversal would
    meet more of it than of friction (H. Olsson et al., European J. Control 4 (1998) 176).
    """
    f = s.friction
    sliding = f.coulomb + f.per_load * press + sticking
    breakaway = sliding + f.stiction
    m[FRICTION] = 0.0
    if breakaway <= 0.0:
        m[BRISTLE] = 0.0
        return
    level = sliding + f.stiction * math.exp(-((speed / f.stribeck_speed) ** 2))
    reach = max(level, LEAST_LEVEL * breakaway) / f.bristle_stiffness
    before = m[BRISTLE]
    end = math.copysign(reach, speed)
    m[BRISTLE] = end + (before - end) * math.exp(-abs(speed) * h / reach)
    swing = math.sqrt(f.bristle_stiffness / (s.shaft.inertia + s.shaft.extra_inertia))
    fading = math.exp(-((speed * f.bristle_stiffness / (swing * breakaway)) ** 2))
    bending = (m[BRISTLE] - before) / h
    m[FRICTION] = f.bristle_stiffness * (m[BRISTLE] + BRISTLE_DAMPING * fading / swing * bending)


@compiled
def remember(m: Array, s: Settings, d: Array, speed: float, sticking: float, h: float) -> None:
    """Move friction, warmth and hysteresis on by a step h that ended with rates d."""
    bristles(m, s, speed, d[PRESS], sticking, h)
    m[WARMTH] += h / s.drive.heating_time * (d[HEAT] ** 2 - m[WARMTH])
    if s.drive.hysteresis > 0.0:
        m[MAGNET] = bent(d[BENT], m, s.drive.turn)
        m[LAST] = d[BENT]


@compiled
def heun(
    x: Array, m: Array, s: Settings, acts: Array, h: float, d: Array, k: Array, y: Array
) -> int:
    """One step of Heun's third order from x, whose rates are d, to y, whose rates are k; returns
    the regime at y."""
    for i in range(STATES):
        y[i] = x[i] + h / 3.0 * d[i]
    rates(y, m, s, acts, k)
    for i in range(STATES):
        y[i] = x[i] + 2.0 * h / 3.0 * k[i]
    rates(y, m, s, acts, k)
    for i in range(STATES):
        y[i] = x[i] + 0.25 * h * (d[i] + 3.0 * k[i])
    return rates(y, m, s, acts, k)


@compiled
def run(s: Settings, acts: Array, h: float, seen: Array) -> None:
    """Simulate from the state of rest.

    Args:
        s: of the rig and of what acts on it.
        acts: shape (n, 4), see ``rates``; each row is held for the step h [s] that follows.
        seen: written: angle, drive or current, feedback, rate, and current under a duty before each
            step and before what acts in it, shape (n, SEEN).
    """
    x, y = np.zeros(STATES), np.zeros(STATES)
    d, k = np.zeros(WIDTH), np.zeros(WIDTH)
    m = np.zeros(MEMORY)
    rates(x, m, s, acts[0], d)
    for n in range(len(acts)):
        for i in range(SEEN):
            seen[n, i] = d[ANGLE + i]
        here = rates(x, m, s, acts[n], d)
        if s.loop.tick > 0.0 and n % s.loop.tick == 0:
            m[HELD] = d[ASKED]
            here = rates(x, m, s, acts[n], d)
        left = h
        for split in range(SPLITS):
            part, there = left, heun(x, m, s, acts[n], left, d, k, y)
            if there != here and split < SPLITS - 1:
                part = crossing(x, m, s, acts[n], left, d, k, y, here)
                there = heun(x, m, s, acts[n], part, d, k, y)
            x, y, d, k, here = y, x, k, d, there
            left -= part
            if left <= 0.0:
                break
        remember(m, s, d, x[W], acts[n, STICKING], h)


@compiled
def crossing(
    x: Array, m: Array, s: Settings, acts: Array, h: float, d: Array, k: Array, y: Array, here: int
) -> float:
    """Length of the step to just past the corner that lies within h, by bisection."""
    low, high = 0.0, h
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if heun(x, m, s, acts, middle, d, k, y) == here:
            low = middle
        else:
            high = middle
    return high


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
        every = settled({**self.rig.constants(self.true), **settings})
        return tuple(self._log(plan, every, i) for i, plan in enumerate(self.plans))

    def gap(self, logs: Sequence[Array]) -> float:
        """Return the RMS difference [SI] of the judged reading from that without any cause."""
        apart = np.concatenate([a[:, 0] - b[:, 0] for a, b in zip(logs, self.plain)])
        return float(np.sqrt(np.mean(apart * apart)))

    @cached_property
    def ranges(self) -> Array:
        """Range of every reading without any cause [SI], shape (readings,)."""
        return np.asarray(np.ptp(np.concatenate(self.plain), axis=0))

    def _log(self, plan: Plan, s: Settings, number: int) -> Array:
        step = self.rig.step
        before = round(self.rig.settle / step)
        command = plan.held(plan.command, before)
        outside, lost = disturbed(
            s.outside, len(command), step, self.rig.slowest, self.seed + number
        )
        scale = 1.0 + s.outside.load_gain
        outside[:, TORQUE - GAIN] += scale * self.load * plan.held(plan.shares, before)
        seen = np.empty((len(command), SEEN))
        drive = travelled(command, lost, s, step)
        run(s, np.column_stack([drive, outside]), step, seen)
        judged = self.readings[0]
        seen[:, judged] = read(seen[:, judged].copy(), s, step)
        seen[:, DRIVE - ANGLE] *= s.reading.drive_unit
        seen[:, FEEDBACK - ANGLE] *= s.reading.feedback_unit
        return seen[before :: plan.stride][plan.logged][:, self.readings]


def disturbed(o: Outside, count: int, step: float, slow: float, seed: int) -> tuple[Array, Array]:
    """Return what comes and goes during a log.

    Args:
        o: sizes.
        count, step: of the simulation's grid [s].
        slow: slowest time constant [s].
        seed: the same one gives the same instants for every size.

    Returns:
        factor on the drive, sticking [N m] and torque [N m], shape (count, 3); and 1 where a
        command is lost, shape (count,).
    """
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
