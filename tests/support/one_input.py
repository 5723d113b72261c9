"""An actuator of one's own with one input, no load, and two effects of the catalogue."""

from __future__ import annotations

from pathlib import Path

SOURCE = '''
from typing import Annotated
from servo_models.core.plant import Actuator, Plant, State, Variant, Wire, place
from servo_models.core.block import Param, block
from servo_models.effects.saturation import saturation
from servo_models.effects.transport_delay import transport_delay

@block("speed")
def follow(
    goal: float,
    angle: float,
    time_constant: Annotated[float, Param("s", "lag", default=0.2, low=0.01, high=10.0)],
) -> float:
    """The speed is the error over the time constant."""
    return (goal - angle) / time_constant

ACTUATOR = Actuator(
    name="joint",
    title="A joint",
    about="",
    source="",
    plant=Plant(
        inputs=(Wire("goal", "rad", "goal", low=-10.0, high=10.0),),
        wires=(Wire("speed", "rad/s", "speed", scale=5.0),),
        constants={"internal_step": Param("s", "step", default=1e-3, low=1e-6, high=1e-2)},
        chain=(
            place("transport_delay", transport_delay, "goal"),
            follow,
            place("speed_limit", saturation, "speed"),
        ),
        states=(State(Wire("angle", "rad", "angle"), "speed"),),
        outputs=("angle",),
    ),
    variants=(Variant("plain", "", {}, ""),),
    stop_time=1.0,
    step_size=0.01,
    step=("goal", 1.0),
)
'''


def write(folder: Path) -> Path:
    """Write the actuator's file."""
    path = folder / "joint.py"
    path.write_text(SOURCE)
    return path
