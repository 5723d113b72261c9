"""Limited-angle torque motor of a servo valve: coil, magnet spring, rotor (valve paper, sec. 3).

The general form, eqs. 1-2, has a flux linkage lambda(i, theta), a torque T_m(i, theta) and
a stiffness torque T_s(theta) of any shape.  The paper measures all three straight; each can
be bent by an effect (flux_saturation, torque_saturation, stiffness_hardening).  lambda and
T_m are bent apart, since the paper's K_t and K_b do not agree as they would in a lossless
transducer (6.432 N m/A against 0.08 V s/rad).
"""

from __future__ import annotations

from typing import Annotated

from servo_models.core.block import Param, block

PAPER = "valve paper"


@block("flux_slope", "flux_turning", source=f"{PAPER} eq. 3")
def flux_linkage(
    inductance: Annotated[float, Param("H", "winding inductance", low=0.5, high=1e3)],
    back_emf_constant: Annotated[
        float, Param("V.s/rad", "back EMF constant", low=-10.0, high=10.0)
    ],
) -> tuple[float, float]:
    """Slopes of lambda = L i + K_b theta over current [H] and angle [V s/rad]."""
    return inductance, back_emf_constant


@block(source=f"{PAPER} eq. 1")
def current_rate(
    voltage: float,
    current: float,
    flux_slope: float,
    flux_turning: float,
    shaft_speed: float,
    resistance: Annotated[float, Param("Ohm", "winding resistance", low=1.0, high=1e5)],
) -> float:
    """di/dt [A/s] from v = R i + (d lambda / d i) di/dt + (d lambda / d theta) d theta / dt."""
    return (voltage - resistance * current - flux_turning * shaft_speed) / flux_slope


@block(source=f"{PAPER} eq. 6")
def motor_torque(
    effective_current: float,
    torque_constant: Annotated[float, Param("N.m/A", "torque constant", low=0.01, high=1e3)],
) -> float:
    """Torque [N m] of the current."""
    return torque_constant * effective_current


@block(source=f"{PAPER} eqs. 5 and 10")
def spring_torque(
    spring_angle: float,
    stiffness: Annotated[float, Param("N.m/rad", "magnetic stiffness", low=1e-3, high=1e3)],
) -> float:
    """Stiffness torque T_s = K_s theta [N m]."""
    return stiffness * spring_angle


@block(source=f"{PAPER} eq. 4")
def torque(
    motor_torque: float,
    spring_torque: float,
    load: float,
    shaft_speed: float,
    friction_coefficient: Annotated[
        float, Param("N.m.s/rad", "friction coefficient of air", high=2e-3)
    ],
) -> float:
    """Torque [N m] that accelerates the rotor."""
    return motor_torque - spring_torque - friction_coefficient * shaft_speed - load


@block("shaft_inertia", source=f"{PAPER} Table 1")
def rotor(
    rotor_inertia: Annotated[
        float, Param("kg.m2", "inertia of rotor and nozzle", low=1e-8, high=1e-2)
    ],
) -> float:
    """Inertia on the shaft."""
    return rotor_inertia


@block("full_speed", "angle_unit")
def conventions() -> tuple[float, float]:
    """Speed that friction parameters call full speed [rad/s]; the angle is in radians."""
    return 100.0, 1.0


@block("supply_current", "supply_conductance")
def supply_load(current: float) -> tuple[float, float]:
    """Current that the source delivers; the coil makes it react slowly."""
    return current, 0.0


@block("effective_current")
def magnetising_current(current: float) -> float:
    """Current that makes the torque."""
    return current


@block("spring_angle")
def spring_position(shaft_angle: float) -> float:
    """Angle from the magnetic null."""
    return shaft_angle


@block("shaft_rate")
def shaft_motion(shaft_speed: float) -> float:
    """Rate of the shaft [rad/s]."""
    return shaft_speed


@block("at_stop", source=f"{PAPER} sec. 2: the bobbins limit the position")
def stop_flag(shaft_angle: float, travel: float) -> float:
    """1 on a stop, else 0."""
    if travel > 0.0 and abs(shaft_angle) >= travel:
        return 1.0
    return 0.0
