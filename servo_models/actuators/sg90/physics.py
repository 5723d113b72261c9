"""A closed-loop hobby servo, element by element (SG90 paper, Figs. 4 and 5).

command decoder -> comparator -> amplifier -> DC motor -> gearbox -> potentiometer -> back.

The paper adds motor speed in rad/s over the gear ratio to an angle in degrees.
``angle_unit`` [rad of output per rad of shaft] keeps that choice explicit: pi/180 counts
as printed, 1 is the strict reading, whose loop gain is 57.3 times larger.
"""

from __future__ import annotations

from typing import Annotated

from servo_models.core.block import Mode, Param, block

PAPER = "SG90 paper"
REST_PULSE = 1.5e-3  # pulse in the middle of the range [s]


@block("shaft_inertia", "stall_stiffness", source="data sheet: 1.8 kg cm at 4.8 V")
def equivalent_shaft(
    motor_time_constant: Annotated[
        float, Param("s", "time constant of the motor's speed", low=1e-3, high=10.0)
    ],
    stall_torque: Annotated[
        float, Param("N.m", "stall torque at the output", default=0.1765, low=1e-3, high=10.0)
    ],
    stall_voltage: Annotated[
        float, Param("V", "motor voltage of the stall torque", default=1.923, low=0.1, high=20.0)
    ],
    no_load_speed: Annotated[
        float, Param("rad/s", "top speed of the motor", default=670.0, low=1.0, high=5000.0)
    ],
    gear_ratio: Annotated[float, Param("1", "gear ratio K_R", default=24.0, low=1.0, high=1000.0)],
) -> tuple[float, float]:
    """Inertia [kg m^2] on the output that a motor of this torque and slowness would have, and
    motor voltage per load torque [V/(N m)].

    T = 0.765 s makes the inertia an absurd 4.8e-3 kg m^2: a real SG90 is far faster.
    """
    inertia = motor_time_constant * stall_torque / (no_load_speed / gear_ratio)
    return inertia, stall_voltage / stall_torque


@block(source=f"{PAPER} Fig. 5; start in equilibrium at 1.5 ms")
def rest_angle(
    reference_voltage: Annotated[
        float, Param("V", "voltage of a full frame", default=5.0, low=0.1, high=50.0)
    ],
    frame_time: Annotated[
        float, Param("s", "frame of the command", default=0.02, low=1e-3, high=0.1, display="ms")
    ],
    feedback_coefficient: Annotated[
        float, Param("1", "feedback coefficient K_f", default=0.1, low=0.01, high=1.0)
    ],
    potentiometer_gain: Annotated[
        float,
        Param("V/rad", "potentiometer k_FS", default=1.4324, low=0.01, high=50.0, display="V/deg"),
    ],
    middle_pulse: Annotated[
        float,
        Param(
            "s",
            "pulse at which the reported angle is 0",
            default=REST_PULSE,
            low=1e-3,
            high=2e-3,
            display="us",
            fixed=True,
        ),
    ],
) -> float:
    """Angle [rad] of the potentiometer where the reported angle is 0."""
    rest_voltage = reference_voltage * middle_pulse / frame_time
    return rest_voltage / (feedback_coefficient * potentiometer_gain)


@block("full_speed")
def top_speed(no_load_speed: float, gear_ratio: float) -> float:
    """Speed of the shaft [rad/s] at the motor's top speed."""
    return no_load_speed / gear_ratio


@block(source=f"{PAPER} eq. 2, read as U = 5 V t / 20 ms")
def command_voltage(pulse_width: float, reference_voltage: float, frame_time: float) -> float:
    """Voltage [V] of the command."""
    return reference_voltage * pulse_width / frame_time


@block("command_angle", source="the angle at which the comparator is at 0")
def commanded_angle(
    command_voltage: float,
    feedback_coefficient: float,
    potentiometer_gain: float,
    rest_angle: float,
) -> float:
    """Angle [rad] that is asked for."""
    return command_voltage / (feedback_coefficient * potentiometer_gain) - rest_angle


@block(source=f"{PAPER} Fig. 6")
def feedback_voltage(angle: float, rest_angle: float, potentiometer_gain: float) -> float:
    """Voltage [V] of the potentiometer."""
    return potentiometer_gain * (angle + rest_angle)


@block(source=f"{PAPER} Fig. 5")
def error(
    command_angle: float,
    feedback_voltage: float,
    feedback_coefficient: float,
    potentiometer_gain: float,
    rest_angle: float,
) -> float:
    """Comparator [V]."""
    return feedback_coefficient * (
        potentiometer_gain * (command_angle + rest_angle) - feedback_voltage
    )


@block("driven", source="hobby servos give no torque until pulses come")
def pulse_detector(
    pulse_width: float,
    shortest_pulse: Annotated[
        float,
        Param(
            "s",
            "the motor gives no torque while the pulse is shorter, 0: it always does",
            high=1e-3,
            display="us",
            fixed=True,
        ),
    ],
) -> float:
    """1 while there are pulses, else 0."""
    return 1.0 if pulse_width >= shortest_pulse else 0.0


@block("motor_voltage", source=f"{PAPER} sec. 4.2")
def amplifier(
    error: float,
    driven: float,
    amplifier_gain: Annotated[float, Param("1", "amplifier gain K_AP", low=0.1, high=1e3)],
) -> float:
    """Voltage [V] that the amplifier would give without any limit."""
    return driven * amplifier_gain * error


@block("motor_speed")
def motor_shaft(shaft_speed: float, gear_ratio: float) -> float:
    """Speed of the motor [rad/s]."""
    return gear_ratio * shaft_speed


@block("supply")
def stiff_supply(supply_voltage: float) -> float:
    """Supply [V] of the amplifier."""
    return supply_voltage


@block("supply_current", "supply_conductance", source="Ohm's law; resistance assumed")
def supply_load(
    supply_voltage: float,
    motor_voltage: float,
    motor_speed: float,
    motor_gain: Annotated[
        float, Param("rad/(V.s)", "motor speed per volt K_EN", low=1.0, high=5e3)
    ],
    armature_resistance: Annotated[
        float, Param("Ohm", "resistance of the motor", default=7.0, low=0.1, high=1e3)
    ],
) -> tuple[float, float]:
    """Current [A] of a motor that gets all of a stiff supply, and its slope [S].

    The supply under load only matters where the amplifier is at its limit, and there the
    motor gets all that there is.
    """
    opposing = motor_speed / motor_gain
    if motor_voltage < 0.0:
        opposing = -opposing
    current = (abs(supply_voltage) - opposing) / armature_resistance
    return current if current > 0.0 else 0.0, 1.0 / armature_resistance


@block("loaded_voltage", source="load torque through the stall torque")
def load_voltage(motor_voltage: float, load: float, stall_stiffness: float) -> float:
    """Motor voltage [V] left after the load torque."""
    return motor_voltage - stall_stiffness * load


@block("free_speed", "at_top_speed", source=f"{PAPER} sec. 4.3 and Fig. 8")
def motor_curve(
    loaded_voltage: float,
    elapsed: float,
    motor_gain: float,
    edge_positive: Annotated[float, Param("V", "insensitivity edge, positive", high=5.0)],
    edge_negative: Annotated[float, Param("V", "insensitivity edge, negative side", high=5.0)],
    zero_positive: Annotated[float, Param("V", "where the positive line meets 0", high=5.0)],
    zero_negative: Annotated[float, Param("V", "where the negative line meets 0", high=5.0)],
    top_positive: Annotated[float, Param("rad/s", "top speed, positive, 0 for none", high=5e3)],
    top_negative: Annotated[
        float, Param("rad/s", "top speed, negative side, 0 for none", high=5e3)
    ],
    side: Annotated[float, Mode()],
) -> tuple[float, float, float]:
    """Static characteristic F(u) [rad/s], and whether it is at its top.

    Inside the edges nothing turns; at an edge the speed jumps onto the line, which is why
    the side is a mode.
    """
    now_on = 0.0
    if loaded_voltage > edge_positive:
        now_on = 1.0
    elif loaded_voltage < -edge_negative:
        now_on = -1.0
    if elapsed <= 0.0:
        side = now_on
    if side > 0.0:
        speed = motor_gain * (loaded_voltage - zero_positive)
        if 0.0 < top_positive <= speed:
            return top_positive, 1.0, now_on
        return speed, 0.0, now_on
    if side < 0.0:
        speed = motor_gain * (loaded_voltage + zero_negative)
        if 0.0 < top_negative <= -speed:
            return -top_negative, 1.0, now_on
        return speed, 0.0, now_on
    return 0.0, 0.0, now_on


@block("torque", source=f"{PAPER} eq. 6 (model 2)")
def motor_lag(
    free_speed: float,
    motor_speed: float,
    no_load_speed: float,
    stall_torque: float,
    driven: float,
    load: float,
) -> float:
    """Torque [N m] on the output; over the equivalent inertia it is (F - omega) / (24 T).

    ``free_speed`` holds the load, which is all that turns a motor without current.
    """
    lag = driven * stall_torque / no_load_speed * (free_speed - motor_speed)
    return lag - (1.0 - driven) * load


@block(source=f"{PAPER} sec. 6: rad/s over 24, counted as degrees/s")
def shaft_rate(
    shaft_speed: float,
    angle_unit: Annotated[
        float,
        Param(
            "1",
            "output angle per shaft angle: pi/180 as printed, 1 strictly",
            default=0.017453292519943295,
            low=1e-3,
            high=1.0,
        ),
    ],
) -> float:
    """Rate of the output [rad/s]."""
    return angle_unit * shaft_speed


@block("saturated")
def saturation_flag(motor_voltage: float, supply: float, at_top_speed: float) -> float:
    """1 while the amplifier gives all of its supply or the motor is at its top speed."""
    if abs(motor_voltage) >= abs(supply):
        return 1.0
    return at_top_speed


@block("angle_reading", "rate_reading")
def readings(angle: float, rate: float) -> tuple[float, float]:
    """What a tracker and a gyro on the horn read, apart from the potentiometer in the loop."""
    return angle, rate


@block("acceleration", source=f"{PAPER} eq. 5 (model 1)")
def oscillatory_speed(shaft_acceleration: float) -> float:
    """Acceleration of the shaft [rad/s^2], a state of model 1."""
    return shaft_acceleration


@block(source=f"{PAPER} eq. 5 (model 1, rejected there: undamped)")
def jerk(
    free_speed: float,
    motor_speed: float,
    shaft_acceleration: float,
    gear_ratio: float,
    motor_stiffness: Annotated[
        float, Param("1/s2", "constant term of eq. 5", default=2.255, high=100.0)
    ],
    motor_damping: Annotated[
        float, Param("1/s", "damping term of eq. 5", default=3.434e-11, high=10.0)
    ],
) -> float:
    """Jerk of the shaft [rad/s^3]: omega'' + d omega' + k omega = k F(u)."""
    pull = motor_stiffness * (free_speed - motor_speed) / gear_ratio
    return pull - motor_damping * shaft_acceleration
