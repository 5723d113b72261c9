"""The Aerosonde UAV: attitude of a rigid body in trimmed level flight, four surfaces.

Equations: R. Beard, T. McLain, Small Unmanned Aircraft: Theory and Practice, Princeton University
Press, 2012, secs. 3.3 (rigid body), 4.2 (aerodynamics) and 5.4 (linear models).  Values: the
Aerosonde as its authors revised it later, in their code mavsim_public.

The airspeed is constant and all angles are deviations from trim, in stability axes.  Left out:
position and height, wind, stall, and the loads of the surfaces on their servos.
"""

from __future__ import annotations

import math
from typing import Annotated

from servo_models import Actuator, Param, Plant, State, Variant, Wire, block

SOURCE = "Beard, McLain, Small Unmanned Aircraft"
MASS, GRAVITY, DENSITY = 11.0, 9.81, 1.2682
SPAN, CHORD, AREA = 2.8956, 0.18994, 0.55
JX, JY, JZ, JXZ = 0.8244, 1.135, 1.759, 0.1204
LIFT_ATTACK, LIFT_RATE, LIFT_ELEVATOR = 5.61, 7.95, 0.13
PITCH_ATTACK, PITCH_RATE, PITCH_ELEVATOR = -2.74, -38.21, -0.99
SIDE_SLIP, SIDE_AILERON, SIDE_RUDDER = -0.98, 0.075, 0.19
ROLL_SLIP, ROLL_ROLL, ROLL_YAW, ROLL_AILERON, ROLL_RUDDER = -0.13, -0.51, 0.25, 0.17, 0.0024
YAW_SLIP, YAW_ROLL, YAW_YAW, YAW_AILERON, YAW_RUDDER = 0.073, 0.069, -0.095, -0.011, -0.069

DETERMINANT = JX * JZ - JXZ * JXZ
G1 = JXZ * (JX - JY + JZ) / DETERMINANT
G2 = (JZ * (JZ - JY) + JXZ * JXZ) / DETERMINANT
G3, G4, G8 = JZ / DETERMINANT, JXZ / DETERMINANT, JX / DETERMINANT
G5, G6 = (JZ - JX) / JY, JXZ / JY
G7 = ((JX - JY) * JX + JXZ * JXZ) / DETERMINANT

Airspeed = Annotated[float, Param("m/s", "airspeed", default=25.0, low=15.0, high=40.0)]


@block("aileron")
def ailerons(left_aileron: float, right_aileron: float) -> float:
    """Aileron [rad]: what the left surface goes down and the right one up."""
    return 0.5 * (left_aileron - right_aileron)


@block("roll_acceleration", "yaw_acceleration", source=f"{SOURCE} eqs. 3.17, 4.15, 4.16")
def roll_and_yaw(
    aileron: float,
    rudder: float,
    slip: float,
    roll_rate: float,
    pitch_rate: float,
    yaw_rate: float,
    airspeed: Airspeed,
) -> tuple[float, float]:
    """Angular accelerations [rad/s^2] about the axes of roll and yaw."""
    force = 0.5 * DENSITY * airspeed * airspeed * AREA
    p, r = 0.5 * SPAN / airspeed * roll_rate, 0.5 * SPAN / airspeed * yaw_rate
    rolling = ROLL_SLIP * slip + ROLL_ROLL * p + ROLL_YAW * r
    rolling = force * SPAN * (rolling + ROLL_AILERON * aileron + ROLL_RUDDER * rudder)
    yawing = YAW_SLIP * slip + YAW_ROLL * p + YAW_YAW * r
    yawing = force * SPAN * (yawing + YAW_AILERON * aileron + YAW_RUDDER * rudder)
    along = pitch_rate * (G1 * roll_rate - G2 * yaw_rate)
    across = pitch_rate * (G7 * roll_rate - G1 * yaw_rate)
    return along + G3 * rolling + G4 * yawing, across + G4 * rolling + G8 * yawing


@block("pitch_acceleration", source=f"{SOURCE} eqs. 3.17, 4.5")
def pitching(
    elevator: float,
    attack: float,
    roll_rate: float,
    pitch_rate: float,
    yaw_rate: float,
    airspeed: Airspeed,
) -> float:
    """Angular acceleration [rad/s^2] about the axis of pitch."""
    q = 0.5 * CHORD / airspeed * pitch_rate
    moment = PITCH_ATTACK * attack + PITCH_RATE * q + PITCH_ELEVATOR * elevator
    moment = 0.5 * DENSITY * airspeed * airspeed * AREA * CHORD * moment
    turning = G5 * roll_rate * yaw_rate - G6 * (roll_rate * roll_rate - yaw_rate * yaw_rate)
    return turning + moment / JY


@block("attack_rate", "slip_rate", source=f"{SOURCE} eqs. 4.6, 4.14; small angles")
def flow(
    aileron: float,
    elevator: float,
    rudder: float,
    attack: float,
    slip: float,
    roll: float,
    pitch: float,
    roll_rate: float,
    pitch_rate: float,
    yaw_rate: float,
    airspeed: Airspeed,
) -> tuple[float, float]:
    """Rates [rad/s] of the angles of attack and of sideslip."""
    per_force = 0.5 * DENSITY * airspeed * AREA / MASS
    lift = LIFT_ATTACK * attack + LIFT_RATE * 0.5 * CHORD / airspeed * pitch_rate
    lift = per_force * (lift + LIFT_ELEVATOR * elevator)
    side = per_force * (SIDE_SLIP * slip + SIDE_AILERON * aileron + SIDE_RUDDER * rudder)
    weight = GRAVITY / airspeed
    down = weight * (math.cos(pitch) * math.cos(roll) - 1.0)
    aside = weight * math.cos(pitch) * math.sin(roll)
    return pitch_rate - roll_rate * slip - lift + down, roll_rate * attack - yaw_rate + side + aside


@block("roll_change", "pitch_change", source=f"{SOURCE} eq. 3.16")
def attitude(
    roll: float, pitch: float, roll_rate: float, pitch_rate: float, yaw_rate: float
) -> tuple[float, float]:
    """Rates [rad/s] of the Euler angles."""
    upward = pitch_rate * math.sin(roll) + yaw_rate * math.cos(roll)
    return (
        roll_rate + math.tan(pitch) * upward,
        pitch_rate * math.cos(roll) - yaw_rate * math.sin(roll),
    )


def surface(name: str, about: str) -> Wire:
    """An input: the angle of a surface."""
    return Wire(name, "rad", about, 0.3, low=-1.0, high=1.0, display="deg")


def angle(name: str, rate: str, about: str) -> State:
    """A state that is an angle."""
    return State(Wire(name, "rad", about, 0.5, display="deg"), rate)


def speed(name: str, rate: str, about: str) -> State:
    """A state that is an angular rate."""
    return State(Wire(name, "rad/s", about, 1.0, display="deg/s"), rate)


PLANT = Plant(
    inputs=(
        surface("left_aileron", "left aileron, down"),
        surface("right_aileron", "right aileron, down"),
        surface("elevator", "elevator, down"),
        surface("rudder", "rudder, to the left"),
    ),
    wires=(Wire("aileron", "rad", "aileron", 0.3, display="deg"),),
    constants={"internal_step": Param("s", "integration", default=2e-3, low=1e-5, high=1e-2)},
    chain=(ailerons, roll_and_yaw, pitching, flow, attitude),
    states=(
        angle("roll", "roll_change", "roll angle"),
        angle("pitch", "pitch_change", "pitch angle, from trim"),
        speed("roll_rate", "roll_acceleration", "roll rate"),
        speed("pitch_rate", "pitch_acceleration", "pitch rate"),
        speed("yaw_rate", "yaw_acceleration", "yaw rate"),
        angle("attack", "attack_rate", "angle of attack, from trim"),
        angle("slip", "slip_rate", "angle of sideslip"),
    ),
    outputs=("roll", "pitch", "roll_rate", "pitch_rate", "yaw_rate", "slip"),
)

ACTUATOR = Actuator(
    name="airframe",
    title="Aerosonde UAV",
    about="Attitude of a small fixed-wing UAV at constant airspeed.",
    source=f"{SOURCE}: Theory and Practice, 2012; values of their mavsim_public",
    plant=PLANT,
    variants=(Variant("cruise", "trimmed level flight at 25 m/s", {}, SOURCE),),
    stop_time=2.0,
    step_size=0.001,
    step=("left_aileron", 0.02),
)
