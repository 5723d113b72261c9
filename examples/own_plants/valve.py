"""A spring-return valve: air pushes a stem against a spring.

The stem is counted from the middle of its stroke, where it rests at 1.5 bar.
"""

from typing import Annotated

from servo_models import Actuator, Param, Plant, State, Variant, Wire, block, effects_on
from servo_models.actuators.shaft import (
    free_shaft,
    shaft_acceleration,
    shaft_contact,
    shaft_output,
    unloaded,
)

REST = 1.5e5  # Pa
HALF_STROKE = 0.01  # m

Mass = Annotated[float, Param("kg", "stem and plug", 2.0, low=0.1, high=20.0)]
Area = Annotated[float, Param("m2", "of the diaphragm", 0.01, low=1e-3, high=0.1)]
Rate = Annotated[float, Param("N/m", "stiffness of the spring", 1e5, low=1e3, high=1e7)]
Drag = Annotated[float, Param("N.s/m", "drag of the stem", 400.0, low=1.0, high=1e4)]
Fill = Annotated[float, Param("s", "time constant of the chamber", 0.04, low=0.01, high=5.0)]


@block("shaft_inertia", "angle_unit")
def stem(mass: Mass) -> tuple[float, float]:
    """What the blocks of a shaft read, here in metres and newtons."""
    return mass, 1.0


@block("shaft_rate", "spring_angle")
def motion(shaft_speed: float, shaft_angle: float) -> tuple[float, float]:
    """Rate [m/s] of the stem; its position [m] as the spring has it."""
    return shaft_speed, shaft_angle


@block("filling")
def chamber(command: float, pressure: float, fill_time: Fill) -> float:
    """Rate of the pressure [Pa/s]: the chamber fills through a restriction."""
    return (command - pressure) / fill_time


@block("spring_force")
def spring(spring_angle: float, spring_rate: Rate) -> float:
    """Force [N] of the spring, less that at the middle."""
    return spring_rate * spring_angle


@block("torque")
def net(
    pressure: float, spring_force: float, load: float, shaft_speed: float, area: Area, drag: Drag
) -> float:
    """Force [N] that accelerates the stem."""
    return area * (pressure - REST) - spring_force - drag * shaft_speed - load


PLANT = Plant(
    inputs=(Wire("command", "Pa", "pressure set", 1e5, REST, low=0.0, high=1e6, display="bar"),),
    wires=(
        Wire("angle", "m", "position of the stem", HALF_STROKE, display="mm"),
        Wire("rate", "m/s", "speed of the stem", 0.1, display="mm/s"),
        Wire("spring_angle", "m", "position as the spring has it", HALF_STROKE, display="mm"),
        Wire("spring_force", "N", "force of the spring", 1000.0),
        Wire("load", "N", "force of the flow", 1000.0),
        Wire("friction", "N", "dry friction level", 1000.0),
        Wire("shaft_inertia", "kg", "accelerated mass", 2.0),
        Wire("travel", "m", "half stroke", HALF_STROKE, display="mm"),
    ),
    chain=(
        stem,
        free_shaft,
        *effects_on("travel", "end_stops"),
        *effects_on("command", "transport_delay", "dead_band", "rate_limit"),
        chamber,
        motion,
        *effects_on("spring_angle", "null_shift"),
        spring,
        *effects_on("spring_force", "stiffness_hardening"),
        unloaded,
        *effects_on("load", "constant_load"),
        *effects_on("friction", "coulomb_friction"),
        net,
        shaft_acceleration,
        shaft_output,
        *effects_on(("angle", "rate"), "backlash"),
        *effects_on("angle", "sensor_offset", "sensor_quantisation"),
    ),
    states=(
        State(Wire("pressure", "Pa", "pressure in the chamber", 1e5), "filling", start=REST),
        State(Wire("shaft_angle", "m", "position of the stem", HALF_STROKE), "shaft_rate"),
        State(Wire("shaft_speed", "m/s", "speed of the stem", 0.1), "acceleration"),
    ),
    projection=shaft_contact,
    outputs=("angle", "rate"),
    constants={"internal_step": Param("s", "longest internal step", 1e-3, low=1e-5, high=2e-3)},
)

ACTUATOR = Actuator(
    name="valve",
    title="Spring-return valve",
    about="Air pushes a stem against a spring.",
    source="data sheet",
    plant=PLANT,
    variants=(
        Variant(
            "nominal",
            "by its data sheet",
            values={"end_stops.half_range": HALF_STROKE},
            source="data sheet",
            uncertainty={"mass": 0.1, "spring_rate": 0.05, "drag": 0.3, "fill_time": 0.2},
        ),
    ),
    stop_time=2.0,
    step_size=0.01,
    step=("command", 1.9e5),
)
