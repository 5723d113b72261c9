"""TODO."""

from __future__ import annotations

from pathlib import Path

OWN = '''
"""A joint that follows its goal with a lag."""
from __future__ import annotations
from typing import Annotated
from servo_models.core.plant import Actuator, Plant, State, Variant, Wire
from servo_models.core.block import Param, block

@block("speed", source="first-order lag")
def follow(
    goal: float,
    enabled: float,
    angle: float,
    time_constant: Annotated[float, Param("s", "lag", default=0.2, low=0.01, high=10.0)],
) -> float:
    """The speed is the error over the time constant, while the joint is enabled."""
    return enabled * (goal - angle) / time_constant

ACTUATOR = Actuator(
    name="joint",
    title="A joint",
    about="",
    source="",
    plant=Plant(
        inputs=(
            Wire("goal", "rad", "goal", low=-4.0, high=4.0),
            Wire("enabled", "1", "on", rest=1.0, low=0.0, high=1.0, flag=True),
        ),
        wires=(Wire("speed", "rad/s", "speed"), ),
        constants={"internal_step": Param("s", "step", default=1e-3, low=1e-6, high=1e-2)},
        chain=(follow,),
        states=(State(Wire("angle", "rad", "angle"), "speed"),),
        outputs=("angle", "speed"),
    ),
    variants=(Variant("plain", "", {}, ""),),
    stop_time=2.0,
    step_size=0.01,
    step=("goal", 1.0),
)
'''


SOURCE = '''
import pathlib
from typing import Annotated
from servo_models import Actuator, Param, Plant, State, Variant, Wire, block

with open(pathlib.Path(__file__).with_suffix(".ran"), "a") as ran:
    ran.write("x")

@block("speed")
def follow(
    goal: float,
    angle: float,
    time_constant: Annotated[float, Param("s", "lag", default=TIME, low=0.01, high=10.0)],
) -> float:
    """The speed is the error over the time constant."""
    return (goal - angle) / time_constant

ACTUATOR = Actuator(
    name="joint",
    title="A joint",
    about="",
    source="",
    plant=Plant(
        inputs=(Wire("goal", "rad", "goal"),),
        wires=(Wire("speed", "rad/s", "speed"),),
        constants={"internal_step": Param("s", "step", default=1e-3, low=1e-6, high=1e-2)},
        chain=(follow,),
        states=(State(Wire("angle", "rad", "angle"), "speed"),),
        outputs=("angle",),
    ),
    variants=(Variant("plain", "", {}, ""),),
    stop_time=1.0,
    step_size=0.01,
    step=("goal", 1.0),
)
'''


def write(folder: Path, time_constant: float = 0.2, name: str = "joint.py") -> Path:
    """Write the actuator's file; it notes beside itself how often it ran."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_text(SOURCE.replace("TIME", repr(time_constant)))
    return path


def runs(path: Path) -> int:
    marks = path.with_suffix(".ran")
    return len(marks.read_text()) if marks.exists() else 0
