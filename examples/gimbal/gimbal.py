"""A camera gimbal: a geared DC motor in a proportional position loop."""

from typing import Annotated

from servo_models import Actuator, Param, Plant, State, Variant, Wire, block, place
from servo_models.effects.dead_zone import dead_zone
from servo_models.effects.quantisation import quantisation
from servo_models.effects.saturation import saturation
from servo_models.effects.transport_delay import transport_delay

Gain = Annotated[float, Param("V/rad", "gain of the loop", default=20.0, low=1.0, high=200.0)]
Speed = Annotated[float, Param("rad/(V.s)", "speed per volt", default=0.8, low=0.05, high=10.0)]
Lag = Annotated[float, Param("s", "time constant", default=0.04, low=0.005, high=1.0, display="ms")]


@block("voltage")
def controller(command: float, angle: float, gain: Gain) -> float:
    """The drive voltage is proportional to the error of the angle."""
    return gain * (command - angle)


@block("acceleration")
def motor(voltage: float, speed: float, speed_constant: Speed, time_constant: Lag) -> float:
    """A DC motor of first order: the speed goes to what the voltage asks for."""
    return (speed_constant * voltage - speed) / time_constant


@block("reading")
def encoder(angle: float) -> float:
    """The angle as it is logged."""
    return angle


PLANT = Plant(
    inputs=(Wire("command", "rad", "commanded angle", 0.5, low=-1.5, high=1.5, display="deg"),),
    wires=(
        Wire("voltage", "V", "drive voltage", 12.0),
        Wire("reading", "rad", "angle as the encoder reads it", 0.5, display="deg"),
    ),
    constants={"internal_step": Param("s", "integration", default=1e-3, low=1e-5, high=1e-2)},
    chain=(
        place("transport_delay", transport_delay, "command"),
        controller,
        place("drive_dead_zone", dead_zone, "voltage"),
        place("drive_saturation", saturation, "voltage"),
        motor,
        encoder,
        place("encoder_quantisation", quantisation, "reading"),
    ),
    states=(
        State(Wire("speed", "rad/s", "speed", 5.0, display="deg/s"), rate="acceleration"),
        State(Wire("angle", "rad", "angle", 0.5, display="deg"), rate="speed"),
    ),
    outputs=("reading", "voltage"),
)

ACTUATOR = Actuator(
    name="gimbal",
    title="Camera gimbal",
    about="A geared DC motor in a proportional position loop.",
    source="data sheet",
    plant=PLANT,
    variants=(
        Variant(
            "bench",
            "without a camera",
            values={"gain": 20.0, "drive_saturation.limit": 12.0},
            source="data sheet",
            uncertainty={"speed_constant": 0.2, "time_constant": 0.3},
        ),
    ),
    stop_time=1.0,
    step_size=0.005,
    step=("command", 0.2),
)
