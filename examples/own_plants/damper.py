"""A rotary damper driven by a torque: inertia, oil, and what seals and oil may add."""

from typing import Annotated

from servo_models import Actuator, Param, Plant, State, Variant, Wire, block, effects_on
from servo_models.actuators.shaft import (
    free_shaft,
    shaft_acceleration,
    shaft_contact,
    shaft_output,
    unloaded,
)

Inertia = Annotated[float, Param("kg.m2", "inertia of the rotor", 0.05, low=1e-3, high=1.0)]
Damping = Annotated[float, Param("N.m.s/rad", "drag of the oil", 0.4, low=0.01, high=10.0)]
FULL_SPEED = 5.0  # rad/s


@block("shaft_inertia", "full_speed", "angle_unit")
def rotor(inertia: Inertia) -> tuple[float, float, float]:
    """What blocks and effects of a shaft read."""
    return inertia, FULL_SPEED, 1.0


@block("shaft_rate")
def motion(shaft_speed: float) -> float:
    """Rate [rad/s] of the shaft."""
    return shaft_speed


@block("oil_torque")
def oil(shaft_speed: float, damping: Damping) -> float:
    """Torque [N m] of the oil against the motion."""
    return damping * shaft_speed


@block("torque")
def net(motor_torque: float, oil_torque: float, load: float) -> float:
    """Torque [N m] that accelerates the rotor."""
    return motor_torque - oil_torque - load


PLANT = Plant(
    inputs=(Wire("motor_torque", "N.m", "driving torque", 2.0, low=-10.0, high=10.0),),
    wires=(
        Wire("angle", "rad", "angle of the rotor", 2.0, display="deg"),
        Wire("rate", "rad/s", "rate of the rotor", FULL_SPEED, display="deg/s"),
        Wire("oil_torque", "N.m", "torque of the oil", 2.0),
        Wire("load", "N.m", "load with all its parts", 2.0),
        Wire("friction", "N.m", "dry friction level", 2.0),
        Wire("shaft_inertia", "kg.m2", "accelerated inertia", 0.05),
        Wire("travel", "rad", "half range", 3.0, display="deg"),
    ),
    chain=(
        rotor,
        free_shaft,
        *effects_on("shaft_inertia", "load_inertia"),
        *effects_on("travel", "end_stops"),
        *effects_on("motor_torque", "transport_delay", "motor_saturation"),
        motion,
        shaft_output,
        *effects_on(("angle", "rate"), "backlash"),
        oil,
        *effects_on("oil_torque", "direction_asymmetry", "nonlinearity", "thermal_drift"),
        unloaded,
        *effects_on("load", "constant_load", "gravity_load", "cogging"),
        *effects_on("friction", "coulomb_friction", "stribeck_friction"),
        net,
        shaft_acceleration,
        *effects_on("angle", "sensor_offset", "sensor_quantisation"),
    ),
    states=(
        State(Wire("shaft_angle", "rad", "angle of the rotor", 2.0), rate="shaft_rate"),
        State(Wire("shaft_speed", "rad/s", "speed of the rotor", FULL_SPEED), rate="acceleration"),
    ),
    projection=shaft_contact,
    outputs=("angle", "rate"),
    constants={"internal_step": Param("s", "longest internal step", 2e-3, low=1e-5, high=1e-2)},
)

ACTUATOR = Actuator(
    name="damper",
    title="Rotary damper",
    about="A damper driven by a torque.",
    source="data sheet",
    plant=PLANT,
    variants=(
        Variant(
            "nominal",
            "by its data sheet",
            values={},
            source="data sheet",
            uncertainty={"inertia": 0.2, "damping": 0.2},
        ),
    ),
    stop_time=1.0,
    step_size=0.01,
    step=("motor_torque", 1.0),
)
