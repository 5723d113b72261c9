"""The causes drawn: those of the catalogue, by the product's names, and those outside of it.

Left out, since a description states it already, with its uncertainty: ``transport_delay`` and
``supply_limit`` of the sg90, ``end_stops`` of the torque motor, clock and encoder of the smart
servo, ``transport_delay`` and ``command_gain`` of the second-order servo.

Left out, since its log cannot show it: ``thermal_drift`` of the torque motor, over 1 s in logs of
0.2 s, and of the motor on a current, whose winding stays cold; what a gyro does, as it is never
judged; what the encoder's angle, the play and the stops of the motor in a speed loop do, as its
speed is judged; the play behind the encoder, and what its speed does, of the motors that nothing
holds; friction that gives of the motors in a speed loop or on a current, which turn much farther
than it gives.

Left out, since the generator has no law of it: ``supply_sag``,
``error_dead_zone`` and ``drive_lag`` of the smart servo, ``drive_lag`` of the second-order servo,
and ``hysteresis`` of the smart servo and of the motors with an encoder.
Left out, since a loop without a clock slides between two codes, and no two simulations do so at the
same pace: ``speed_quantisation`` of the motor.

Left out of the motors that nothing holds, since their angle keeps every small difference for good:
``end_stops``, where no two laws of a stop agree, and ``rate_limit`` of the motor on a current, with
a ramp that the product integrates in steps of half a millisecond.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from servo_models.withheld.generator.rigs import Rig


@dataclass(frozen=True)
class Quantity:
    """A parameter of a cause: its name, the setting it becomes, and its range.

    Attributes:
        weak, strong: range [SI], drawn evenly on a logarithmic scale, or a linear one where
            ``weak`` is not above 0; a cause grows from ``weak`` to ``strong``.
        unit: name of the factor from SI to the setting, see ``Rig.units``.
        signed: either sign.
        grid: a time in whole steps of the simulation.
    """

    name: str
    setting: str
    weak: float
    strong: float
    unit: str = "1"
    signed: bool = False
    grid: bool = False

    @property
    def decades(self) -> float:
        """Natural logarithm of the range."""
        return abs(math.log(self.strong / self.weak))

    def at(self, share: float) -> float:
        """Return the value at a share of the range, 0 to 1."""
        if self.weak <= 0.0:
            return self.weak + share * (self.strong - self.weak)
        return self.weak * math.pow(self.strong / self.weak, share)


@dataclass(frozen=True)
class Cause:
    """One thing that a model leaves out; ``size`` makes it large or small, ``others`` shape it.

    ``same`` are parameters that it has always at one value [SI].
    """

    name: str
    size: Quantity
    others: tuple[Quantity, ...] = ()
    same: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Drawn:
    """A cause with its sign and shape drawn, its size open."""

    cause: Cause
    sign: float
    others: Mapping[str, float]

    def values(self, share: float, step: float) -> dict[str, float]:
        """Return its parameters [SI] by name, sized at ``share`` of the range."""
        size = self.cause.size
        value = self.sign * size.at(share)
        if size.grid:
            value = max(1, round(value / step)) * step
        return {size.name: value, **self.others, **self.cause.same}

    def settings(self, share: float, rig: Rig, units: Mapping[str, float]) -> dict[str, float]:
        """Return what the simulation takes."""
        values = self.values(share, rig.step)
        every = (self.cause.size, *self.cause.others)
        return {q.setting: values[q.name] * units[q.unit] for q in every}


def draw(cause: Cause, rng: np.random.Generator) -> Drawn:
    """Draw the sign and the shape of a cause."""
    sign = float(rng.choice([-1.0, 1.0])) if cause.size.signed else 1.0
    return Drawn(cause, sign, {q.name: q.at(float(rng.random())) for q in cause.others})


D = math.pi / 180.0
TURN = 2.0 * math.pi


def _one(
    name: str,
    parameter: str,
    setting: str,
    weak: float,
    strong: float,
    unit: str = "1",
    shape: tuple[Quantity, ...] = (),
    signed: bool = False,
    grid: bool = False,
) -> Cause:
    return Cause(name, Quantity(parameter, setting, weak, strong, unit, signed, grid), shape)


def _signed(name: str, parameter: str, setting: str, weak: float, strong: float) -> Cause:
    return _one(name, parameter, setting, weak, strong, signed=True)


def _mass(low: float, high: float, slow: float, fast: float) -> Cause:
    """A load on a spring; its resonance with the shaft held is between two frequencies [Hz]."""
    shape = (
        Quantity("frequency", "gear.load_frequency", TURN * slow, TURN * fast),
        Quantity("damping", "gear.load_damping", 0.03, 0.15),
    )
    return _one("gear_compliance", "inertia", "gear.load_inertia", low, high, shape=shape)


def _coasting(low: float, high: float) -> Cause:
    """A part of the inertia behind a play; all friction is before it."""
    shape = (
        Quantity("share", "gear.coasting_share", 0.1, 0.5),
        Quantity("contact", "gear.contact_hertz", 40.0, 100.0),
        Quantity("damping", "gear.contact_damping", 0.2, 0.6),
    )
    size = Quantity("half_width", "gear.coasting_play", low, high)
    return Cause("coasting_backlash", size, shape, {"friction_share": 0.0})


def _ripple(low: float, high: float, few: float, many: float) -> Cause:
    shape = (
        Quantity("count", "load.cogging_count", few, many),
        Quantity("phase", "load.cogging_phase", -math.pi, math.pi),
    )
    return _one("cogging", "torque", "load.cogging", low, high, shape=shape)


def _gravity(low: float, high: float) -> Cause:
    shape = (Quantity("phase", "load.gravity_phase", -math.pi, math.pi),)
    return _one("gravity_load", "torque", "load.gravity", low, high, shape=shape)


def _stribeck(low: float, high: float, slow: float, fast: float) -> Cause:
    shape = (Quantity("speed", "friction.stribeck_speed", slow, fast, "speed"),)
    return _one("stribeck_friction", "excess", "friction.stiction", low, high, shape=shape)


def _presliding(low: float, high: float, soft: float, stiff: float) -> tuple[Cause, ...]:
    """Friction that gives by a part of a move: a bristle, or Bouc and Wen's law."""
    same = {"speed": 0.3}
    return tuple(
        Cause(
            "presliding_friction",
            Quantity("level", level, low, high),
            (Quantity("stiffness", stiffness, soft, stiff),),
            same,
        )
        for level, stiffness in (
            ("friction.coulomb", "friction.bristle_stiffness"),
            ("load.bouc_torque", "load.bouc_stiffness"),
        )
    )


_WARM = (Quantity("time_constant", "drive.heating_time", 1.0, 2.0),)
_TURN = Quantity("turn", "drive.turn", 0.1, 2.0, "drive")

_LOADED: tuple[Cause, ...] = (
    _signed("load_gain", "error", "outside.load_gain", 0.02, 0.9),
    _one("load_friction", "coefficient", "friction.per_load", 0.01, 0.8),
)
"""Of rigs with a load."""
_HORN: tuple[Cause, ...] = (
    *_LOADED,
    _one("end_stops", "half_range", "shaft.travel", 75.0 * D, 20.0 * D),
    _one("command_lag", "time_constant", "command.filter_time", 2e-3, 0.1),
    _one("backlash", "half_width", "gear.play", 0.05 * D, 6.0 * D),
    _signed("direction_asymmetry", "ratio", "drive.asymmetry", 0.01, 0.5),
)
"""Of servos with a horn."""
_HOBBY: tuple[Cause, ...] = (
    *_HORN,
    _mass(3e-5, 1e-3, 30.0, 60.0),
    _one("sample_hold", "period", "command.hold", 4e-3, 0.06, grid=True),
    _one("sensor_lag", "time_constant", "feedback.lag", 1e-3, 0.03),
    _signed("constant_load", "torque", "load.constant", 2e-3, 0.15),
    _gravity(1e-3, 0.17),
    _one("viscous_friction", "torque", "load.drag", 5e-3, 0.35, "drag"),
    _ripple(5e-4, 0.09, 6.0, 30.0),
    _one("coulomb_friction", "level", "friction.coulomb", 5e-4, 0.09),
    _stribeck(1e-3, 0.09, 0.02, 0.2),
    *_presliding(1e-3, 0.09, 0.3, 5.0),
    _one("reading_lag", "time_constant", "reading.lag", 1e-3, 0.05),
    _signed("reading_gain", "error", "reading.gain", 5e-3, 0.3),
    _signed("reading_offset", "value", "reading.offset", 0.2 * D, 15.0 * D),
    _one("reading_quantisation", "step", "reading.step", 0.5 * D, 15.0 * D),
)
"""Of servos on pulses."""
_ENCODER: tuple[Cause, ...] = (
    _signed("command_gain", "error", "command.input_gain", 5e-4, 0.4),
    _one("transport_delay", "time", "command.delay", 1e-4, 0.02, grid=True),
    _one("sensor_quantisation", "step", "reading.step", 0.02, 1.25, "encoder"),
)
"""Of motors that nothing holds, read by their encoder."""

SG90: tuple[Cause, ...] = (
    *_HOBBY,
    _one("load_inertia", "inertia", "shaft.extra_inertia", 2e-5, 1.2e-3),
    _one("dead_band", "half_width", "command.dead_band", 1e-6, 1e-4),
    _one("command_quantisation", "step", "command.step", 2e-3, 0.06, "command"),
    _signed("gain_error", "error", "command.gain", 5e-4, 0.1),
    _one("command_offset", "value", "command.offset", 1e-3, 0.08, "command", signed=True),
    _one("rate_limit", "rate", "command.slew", 200.0, 4.0),
    _signed("sensor_nonlinearity", "bow", "feedback.bow", 2e-3, 0.2),
    _signed("sensor_nonlinearity", "cubic", "feedback.cubic", 3e-3, 0.3),
    _one("sensor_offset", "value", "feedback.offset", 0.01, 0.8, "feedback", signed=True),
    _one("sensor_quantisation", "step", "feedback.step", 0.03, 0.8, "feedback"),
    _one("hysteresis", "half_width", "drive.hysteresis", 0.05, 1.5, "drive", (_TURN,)),
    _one("drive_dead_zone", "half_width", "drive.dead_zone", 0.01, 1.0, "drive"),
    _one("drive_saturation", "limit", "drive.ceiling", 4.8, 1.2, "drive"),
    _one("supply_sag", "resistance", "drive.sag", 0.2, 30.0, "source"),
    _one("thermal_drift", "loss", "drive.heating", 0.03, 0.5, "heat", _WARM),
)

_SLIP = Quantity("jump", "command.slip_jump", 0.1, 0.9)
_COIL_TURN = Quantity("turn", "drive.turn", 2e-4, 4e-3)

TORQUE_MOTOR: tuple[Cause, ...] = (
    *_LOADED,
    _one("load_inertia", "inertia", "shaft.extra_inertia", 5e-8, 3e-6),
    _mass(1e-7, 1e-6, 700.0, 1500.0),
    _one("transport_delay", "time", "command.delay", 1e-4, 4e-3, grid=True),
    _one("sample_hold", "period", "command.hold", 2e-4, 8e-3, grid=True),
    _one("dead_band", "half_width", "command.dead_band", 0.03, 5.0),
    _one("command_quantisation", "step", "command.step", 0.3, 8.0),
    _signed("gain_error", "error", "command.gain", 0.01, 0.4),
    _signed("voltage_offset", "value", "command.offset", 0.1, 8.0),
    _signed("direction_asymmetry", "ratio", "command.asymmetry", 0.01, 0.4),
    _one("drive_dead_zone", "half_width", "command.dead_zone", 0.02, 6.0),
    _one("drive_saturation", "limit", "command.ceiling", 25.0, 6.0),
    _one("rate_limit", "rate", "command.slew", 1e5, 500.0),
    _one("stiction", "band", "command.stick_band", 0.1, 12.0, shape=(_SLIP,)),
    _one("supply_sag", "resistance", "drive.sag", 20.0, 1000.0),
    _signed("constant_load", "torque", "load.constant", 5e-5, 0.03),
    _gravity(2e-4, 0.055),
    _one("viscous_friction", "torque", "load.drag", 5e-3, 0.12, "drag"),
    _ripple(5e-5, 0.02, 100.0, 400.0),
    _one("coulomb_friction", "level", "friction.coulomb", 3e-5, 0.02),
    _stribeck(5e-5, 0.02, 0.01, 0.06),
    *_presliding(5e-5, 0.02, 1.0, 20.0),
    _one("flux_saturation", "inverse_current", "motor.knee", 20.0, 500.0),
    _signed("flux_saturation", "curvature", "motor.curvature", 3.0, 100.0),
    _one("hysteresis", "half_width", "drive.hysteresis", 5e-5, 3e-3, shape=(_COIL_TURN,)),
    _one("torque_saturation", "inverse_torque", "motor.inverse_torque", 3.0, 80.0),
    _signed("null_shift", "angle", "shaft.null", 0.004 * D, 1.2 * D),
    _one("stiffness_hardening", "coefficient", "shaft.hardening", 10.0, 1000.0),
    _one("backlash", "half_width", "reading.play", 1e-3 * D, 0.5 * D),
    _one("sensor_lag", "time_constant", "reading.lag", 5e-5, 5e-3),
    _signed("sensor_nonlinearity", "bow", "reading.bow", 5e-3, 0.35),
    _signed("sensor_nonlinearity", "cubic", "reading.cubic", 5e-3, 0.35),
    _signed("sensor_offset", "value", "reading.offset", 0.01 * D, 1.0 * D),
    _one("sensor_quantisation", "step", "reading.step", 0.03 * D, 0.6 * D),
)

_SPEED_TURN = Quantity("turn", "drive.turn", 0.1, 2.0, "drive")
_SPEEDING = Quantity("acceleration_time", "command.speeding_time", 0.02, 0.3)

SMART_SERVO: tuple[Cause, ...] = (
    *_HORN,
    _one("load_inertia", "inertia", "shaft.extra_inertia", 5e-4, 0.05),
    _mass(1e-3, 0.02, 12.0, 25.0),
    _signed("command_gain", "error", "command.gain", 5e-4, 0.3),
    _one("transport_delay", "time", "command.delay", 1e-3, 0.06, grid=True),
    _one("motion_profile", "velocity", "command.cruise", 30.0, 0.5, shape=(_SPEEDING,)),
    _coasting(0.05 * D, 6.0 * D),
    _one("sensor_lag", "time_constant", "feedback.lag", 1e-3, 0.05),
    _signed("sensor_nonlinearity", "bow", "feedback.bow", 2e-3, 0.2),
    _signed("sensor_nonlinearity", "cubic", "feedback.cubic", 2e-3, 0.2),
    _signed("sensor_offset", "value", "feedback.offset", 0.05 * D, 6.0 * D),
    _one("drive_saturation", "limit", "drive.ceiling", 0.95, 0.15),
    _one("drive_dead_zone", "half_width", "drive.dead_zone", 0.02, 1.4),
    _one("current_limit", "limit", "motor.current_limit", 1.3, 0.15),
    _one("thermal_drift", "loss", "drive.heating", 0.03, 0.5, "heat", _WARM),
    _signed("constant_load", "torque", "load.constant", 5e-3, 0.5),
    _gravity(5e-3, 0.5),
    _one("viscous_friction", "torque", "load.drag", 0.02, 2.5, "drag"),
    _ripple(5e-3, 0.25, 6.0, 30.0),
    _one("coulomb_friction", "level", "friction.coulomb", 2e-3, 0.25),
    _stribeck(5e-3, 0.25, 0.02, 0.2),
    *_presliding(5e-3, 0.25, 1.0, 20.0),
)

PULSE_SERVO: tuple[Cause, ...] = (
    *_HOBBY,
    _one("load_inertia", "inertia", "shaft.extra_inertia", 2e-5, 3e-3),
    _one("dead_band", "half_width", "command.dead_band", 0.1 * D, 8.0 * D, "command"),
    _one("command_quantisation", "step", "command.step", 0.2 * D, 6.0 * D),
    _signed("command_offset", "value", "command.offset", 0.1 * D, 8.0 * D),
    _one("rate_limit", "rate", "command.slew", 30.0, 0.6),
    _one("stiction", "band", "command.stick_band", 0.1 * D, 20.0 * D, shape=(_SLIP,)),
    _signed("sensor_nonlinearity", "bow", "feedback.bow", 2e-3, 0.3),
    _signed("sensor_nonlinearity", "cubic", "feedback.cubic", 2e-3, 0.3),
    _signed("sensor_offset", "value", "feedback.offset", 0.1 * D, 8.0 * D),
    _one("sensor_quantisation", "step", "feedback.step", 0.2 * D, 6.0 * D),
    _one("error_dead_zone", "half_width", "loop.error_dead_zone", 0.1 * D, 8.0 * D),
    _one("hysteresis", "half_width", "drive.hysteresis", 0.03, 2.5, "drive", (_SPEED_TURN,)),
    _one("thermal_drift", "loss", "drive.heating", 0.03, 0.5, "heat", _WARM),
)

SPEED_LOOP: tuple[Cause, ...] = (
    *_LOADED,
    _one("load_inertia", "inertia", "shaft.extra_inertia", 2e-7, 1e-4),
    _mass(2e-6, 2e-5, 20.0, 50.0),
    _one("transport_delay", "time", "command.delay", 2e-4, 0.02, grid=True),
    _one("sample_hold", "period", "loop.tick", 5e-4, 0.02, "tick", grid=True),
    _signed("command_gain", "error", "command.gain", 5e-4, 0.3),
    _signed("command_offset", "value", "command.offset", 0.5, 60.0),
    _one("rate_limit", "rate", "command.slew", 1e5, 1e3),
    _one("speed_lag", "time_constant", "feedback.lag", 2e-4, 0.02),
    _signed("direction_asymmetry", "ratio", "drive.asymmetry", 0.01, 0.5),
    _one("drive_dead_zone", "half_width", "drive.dead_zone", 5e-3, 0.4),
    _one("thermal_drift", "loss", "drive.heating", 0.01, 0.5, "heat", _WARM),
    _signed("constant_load", "torque", "load.constant", 5e-4, 0.06),
    _gravity(5e-4, 0.06),
    _one("viscous_friction", "torque", "load.drag", 5e-4, 0.1, "drag"),
    _ripple(5e-4, 0.03, 1.0, 8.0),
    _one("coulomb_friction", "level", "friction.coulomb", 3e-4, 0.03),
    _stribeck(3e-4, 0.03, 0.02, 0.2),
)

ON_VOLTAGE: tuple[Cause, ...] = (
    *_ENCODER,
    _one("load_inertia", "inertia", "shaft.extra_inertia", 5e-4, 0.4),
    _mass(2e-3, 0.02, 15.0, 40.0),
    _one("sample_hold", "period", "command.hold", 2e-3, 0.06, grid=True),
    _one("command_quantisation", "step", "command.step", 0.05, 4.8),
    _signed("command_offset", "value", "command.offset", 0.01, 4.0),
    _one("drive_dead_zone", "half_width", "command.dead_zone", 0.01, 4.0),
    _one("drive_saturation", "limit", "command.ceiling", 24.0, 4.0),
    _one("rate_limit", "rate", "command.slew", 5e4, 100.0),
    _signed("load_gain", "error", "outside.load_gain", 0.02, 1.5),
    _one("sensor_lag", "time_constant", "reading.lag", 1e-4, 0.02),
    _signed("sensor_nonlinearity", "bow", "reading.bow", 1e-4, 0.2),
    _signed("sensor_nonlinearity", "cubic", "reading.cubic", 1e-5, 0.1),
    _one("sensor_offset", "value", "reading.offset", 0.02, 3.0, "encoder", signed=True),
    _signed("direction_asymmetry", "ratio", "drive.asymmetry", 5e-3, 0.5),
    _one("thermal_drift", "loss", "drive.heating", 5e-3, 0.5, "heat", _WARM),
    _signed("constant_load", "torque", "load.constant", 0.01, 3.0),
    _gravity(0.01, 3.0),
    _one("load_friction", "coefficient", "friction.per_load", 0.01, 0.8),
    _one("viscous_friction", "torque", "load.drag", 0.03, 6.0, "drag"),
    _ripple(0.02, 1.5, 50.0, 400.0),
    _one("coulomb_friction", "level", "friction.coulomb", 0.01, 1.5),
    _stribeck(0.03, 1.5, 0.02, 0.2),
    *_presliding(0.03, 1.5, 2.0, 50.0),
)

ON_CURRENT: tuple[Cause, ...] = (
    *_ENCODER,
    _one("load_inertia", "inertia", "shaft.extra_inertia", 3e-8, 1e-5),
    _mass(2e-6, 2e-5, 20.0, 50.0),
    _one("sample_hold", "period", "command.hold", 1e-3, 0.06, grid=True),
    _one("command_quantisation", "step", "command.step", 2e-3, 0.4),
    _signed("command_offset", "value", "command.offset", 3e-5, 0.1),
    _one("drive_dead_zone", "half_width", "command.dead_zone", 6e-4, 0.3),
    _one("drive_saturation", "limit", "command.ceiling", 3.0, 0.2),
    _signed("load_gain", "error", "outside.load_gain", 5e-3, 1.5),
    _one("sensor_lag", "time_constant", "reading.lag", 1e-4, 0.03),
    _signed("sensor_nonlinearity", "bow", "reading.bow", 1e-4, 0.4),
    _signed("sensor_nonlinearity", "cubic", "reading.cubic", 1e-5, 0.3),
    _one("sensor_offset", "value", "reading.offset", 0.01, 3.0, "encoder", signed=True),
    _signed("direction_asymmetry", "ratio", "drive.asymmetry", 1e-4, 0.2),
    _signed("constant_load", "torque", "load.constant", 1e-6, 3e-3),
    _gravity(3e-6, 0.01),
    _one("load_friction", "coefficient", "friction.per_load", 2e-3, 0.8),
    _one("viscous_friction", "torque", "load.drag", 1e-4, 0.05, "drag"),
    _ripple(2e-5, 0.02, 1.0, 8.0),
    _one("coulomb_friction", "level", "friction.coulomb", 3e-5, 5e-3),
    _stribeck(3e-5, 0.01, 0.02, 0.2),
)

CATALOGUE = {
    "sg90": SG90,
    "torque_motor": TORQUE_MOTOR,
    "smart_servo": SMART_SERVO,
    "second_order_servo": PULSE_SERVO,
    "dc_motor_speed": SPEED_LOOP,
    "dc_motor": ON_VOLTAGE,
    "dc_motor_current": ON_CURRENT,
}


def _causes(
    torque: float, speed: float, angle: float, hertz: float, slow: float
) -> tuple[Cause, ...]:
    """Those of a rig with this full torque [N m], speed [rad/s], angle [rad] and bandwidth [Hz].

    ``slow`` is the slew rate [rad/s] of a sensor that shows.
    """

    def part(setting: str, weak: float, strong: float, name: str = "size") -> Quantity:
        return Quantity(name, setting, weak, strong)

    mode = (
        part("drive.mode_frequency", TURN * 0.6 * hertz, TURN * 2.5 * hertz, "frequency"),
        part("drive.mode_damping", 0.05, 0.3, "damping"),
    )
    kink = Quantity("size", "drive.kink_slope", 0.05 / angle, 3.0 / angle, signed=True)
    bend = Quantity("angle", "drive.kink_angle", -0.3 * angle, 0.3 * angle)
    hum = part("outside.hum_frequency", TURN * hertz, TURN * 2.0 * hertz, "frequency")
    square = torque / (speed * speed)
    return (
        Cause("quadratic_drag", part("load.quadratic_drag", 0.02 * square, 2.0 * square)),
        Cause("asymmetric_drag", part("load.forward_drag", 0.02 * torque / speed, torque / speed)),
        Cause("dropped_commands", part("outside.lost_share", 0.03, 0.6)),
        Cause("gain_bursts", part("outside.burst", 3e-3, 0.8)),
        Cause("second_resonance", part("drive.mode_share", 0.03, 1.0), mode),
        Cause("gain_kink", kink, (bend,)),
        Cause("sensor_slew", part("reading.slew", slow, 0.1 * slow)),
        Cause("intermittent_sticking", part("outside.sticking", 0.02 * torque, 0.6 * torque)),
        Cause("hum", part("outside.hum", 0.01 * torque, 0.4 * torque), (hum,)),
    )


_TORQUES = (
    "quadratic_drag",
    "asymmetric_drag",
    "intermittent_sticking",
    "hum",
)


def _without(names: tuple[str, ...], causes: tuple[Cause, ...]) -> tuple[Cause, ...]:
    """All causes but those of some names."""
    return tuple(cause for cause in causes if cause.name not in names)


FOREIGN = {
    "sg90": _causes(torque=0.18, speed=10.0, angle=70.0 * D, hertz=6.0, slow=12.0),
    "torque_motor": _causes(torque=0.04, speed=10.0, angle=2.0 * D, hertz=80.0, slow=10.0),
    "smart_servo": _causes(torque=1.9, speed=5.4, angle=35.0 * D, hertz=2.0, slow=5.0),
    "dc_motor_speed": _without(
        ("gain_kink",),  # a motor that turns leaves its angle behind
        _causes(torque=0.06, speed=400.0, angle=6.0, hertz=5.0, slow=15e3),
    ),
    "second_order_servo": _causes(torque=0.18, speed=8.7, angle=70.0 * D, hertz=5.0, slow=12.0),
    "dc_motor": _without(
        ("asymmetric_drag",),  # an offset imitates it
        _causes(torque=3.0, speed=14.0, angle=40.0 * D, hertz=5.0, slow=15.0),
    ),
    "dc_motor_current": _without(
        # it leaves for good with the first command lost; torques are integrated twice, so that an
        # offset and a ripple imitate them to less than the noise
        ("gain_kink", "dropped_commands", *_TORQUES),
        _causes(torque=4e-3, speed=150.0, angle=6.0, hertz=5.0, slow=300.0),
    ),
}
