"""A position servo: a geared motor in a proportional loop.  Make it yours from top to bottom.

    servo-models explain servo.py     equations, parameters, effects
    servo-models simulate servo.py    the standard step
    servo-models build servo.py       its FMU

Change names, numbers and equations; leave out what you do not have.  Everything is in SI.
What may stand here, and which names effects need: docs/own_actuator.md.
"""

from typing import Annotated

from servo_models import Actuator, Param, Plant, State, Variant, Wire, block, effects_on
from servo_models.actuators.shaft import (
    external_load,  # load = load_torque
    free_shaft,  # friction = travel = 0, which effects raise
    shaft_acceleration,  # torque, friction, shaft_inertia -> acceleration; sticks and slides
    shaft_contact,  # exact standstill, rest at end stops
    shaft_output,  # angle, rate = shaft_angle, shaft_rate
)

# Parameters: unit, what it is, default, bounds.  A fit stays within the bounds.
Inertia = Annotated[
    float, Param("kg.m2", "inertia at the output, rotor included", 2e-3, low=1e-5, high=1.0)
]
TopSpeed = Annotated[float, Param("rad/s", "speed without load", 8.0, low=0.1, high=100.0)]
StallTorque = Annotated[float, Param("N.m", "torque at standstill", 1.0, low=0.01, high=100.0)]
Gain = Annotated[float, Param("1/rad", "full drive per error", 6.0, low=0.1, high=1000.0)]


# Blocks: one equation each.  @block names what it gives; arguments are found by their names.
@block("shaft_inertia", "full_speed", "angle_unit")
def shaft(inertia: Inertia, top_speed: TopSpeed) -> tuple[float, float, float]:
    """What the ready-made blocks and effects of a shaft read; angle_unit 1 is for radians."""
    return inertia, top_speed, 1.0


@block("shaft_rate")
def motion(shaft_speed: float) -> float:
    """Rate [rad/s] of the shaft."""
    return shaft_speed


@block("reading")
def sensor(angle: float) -> float:
    """Angle [rad] as the loop reads it."""
    return angle


@block("drive")
def controller(command: float, reading: float, gain: Gain) -> float:
    """Drive [1] that the loop asks for: 1 is all that there is."""
    return gain * (command - reading)


@block("torque")
def motor(
    drive: float, shaft_speed: float, load: float, stall_torque: StallTorque, top_speed: TopSpeed
) -> float:
    """Torque [N m] that accelerates the shaft: a DC motor by its two points, less the load."""
    return stall_torque * (drive - shaft_speed / top_speed) - load


PLANT = Plant(
    # Set from outside.  0.5 is the full scale: effects and their trial values are sized by it.
    inputs=(
        Wire("command", "rad", "commanded angle", 0.5, low=-3.0, high=3.0, display="deg"),
        Wire("load_torque", "N.m", "load against positive motion", 1.0, low=-10.0, high=10.0),
    ),
    # Every other signal that is an output, or that an effect acts on.
    wires=(
        Wire("angle", "rad", "angle of the output", 0.5, display="deg"),
        Wire("rate", "rad/s", "rate of the output", 8.0, display="deg/s"),
        Wire("reading", "rad", "angle as the loop reads it", 0.5, display="deg"),
        Wire("drive", "1", "drive of the motor"),
        Wire("load", "N.m", "load with all its parts"),
        Wire("friction", "N.m", "dry friction level"),
        Wire("shaft_inertia", "kg.m2", "accelerated inertia", 2e-3),
        Wire("travel", "rad", "half range of the shaft", 1.5, display="deg"),
    ),
    # Blocks in the order of evaluation, with effects where they act.  An effect does nothing until
    # its parameter is set; a diagnosis tries each of them.
    chain=(
        shaft,
        free_shaft,
        *effects_on("shaft_inertia", "load_inertia"),
        *effects_on("travel", "end_stops"),
        *effects_on("command", "transport_delay", "rate_limit"),
        motion,
        shaft_output,
        *effects_on(("angle", "rate"), "backlash"),
        sensor,
        *effects_on("reading", "sensor_lag", "sensor_offset", "sensor_quantisation"),
        controller,
        *effects_on("drive", "drive_dead_zone", "drive_saturation", "thermal_drift"),
        external_load,
        *effects_on("load", "constant_load", "gravity_load"),
        *effects_on("friction", "load_friction"),
        *effects_on("load", "viscous_friction", "presliding_friction"),
        *effects_on("friction", "coulomb_friction", "stribeck_friction"),
        motor,
        shaft_acceleration,
    ),
    # What is integrated: the state, and the signal that is its rate of change.
    states=(
        State(Wire("shaft_angle", "rad", "angle of the motor side", 0.5), rate="shaft_rate"),
        State(Wire("shaft_speed", "rad/s", "speed of the motor side", 8.0), rate="acceleration"),
    ),
    projection=shaft_contact,
    # What a log or an FMU may hold; pictures and figures are about the first one.
    outputs=("reading", "angle", "rate", "drive"),
    # What hosts of FMI 3.0 connect as one.
    terminals={"shaft": ("load_torque", "angle", "rate")},
    # At most a tenth of the fastest time constant.
    constants={"internal_step": Param("s", "longest internal step", 1e-3, low=1e-5, high=5e-3)},
)

ACTUATOR = Actuator(
    name="servo",
    title="Position servo",
    about="A geared motor in a proportional loop.",
    source="data sheet",
    plant=PLANT,
    variants=(
        Variant(
            "nominal",
            "by its data sheet",
            values={"drive_saturation.limit": 1.0},  # what differs from the defaults
            source="data sheet",
            # How well each value is known, as a share of it: these are what a fit adjusts.
            uncertainty={"inertia": 0.3, "top_speed": 0.1, "stall_torque": 0.1, "gain": 0.2},
        ),
    ),
    stop_time=1.0,
    step_size=0.005,
    step=("command", 0.2),  # the main input and its standard step
)
