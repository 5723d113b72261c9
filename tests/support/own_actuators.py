"""An actuator of one's own: a joint that follows its one input with a lag, in a file."""

from __future__ import annotations

from pathlib import Path

SOURCE = '''
"""A joint that follows its goal with a lag."""
from typing import Annotated
from servo_models import Actuator, Param, Plant, State, Variant, Wire, block

@block("speed", source="first-order lag")
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
COUNT_THE_RUN = """
import pathlib
with open(pathlib.Path(__file__).with_suffix(".ran"), "a") as ran:
    ran.write("x")
"""
WITH_EFFECTS = {
    "import Actuator, Param, Plant, State, Variant, Wire, block\n": (
        "import Actuator, Param, Plant, State, Variant, Wire, block, place\n"
        "from servo_models.effects.saturation import saturation\n"
        "from servo_models.effects.transport_delay import transport_delay\n"
    ),
    "(follow,)": (
        '(place("transport_delay", transport_delay, "goal"), follow,'
        ' place("speed_limit", saturation, "speed"))'
    ),
    '"rad/s", "speed"': '"rad/s", "speed", scale=5.0',
    '"rad", "goal"': '"rad", "goal", low=-10.0, high=10.0',
}
"""Two effects of the catalogue, and bounds and a scale as they need."""
WITH_A_FLAG = {
    "    goal: float,\n": "    goal: float,\n    enabled: float,\n",
    "return (": "return enabled * (",
    '("angle",)': '("angle", "speed")',
    '"rad", "goal"),': (
        '"rad", "goal", low=-4.0, high=4.0),'
        ' Wire("enabled", "1", "on", rest=1.0, low=0.0, high=1.0, flag=True),'
    ),
}
"""A second input that switches the joint on and off."""


def joint(changes: dict[str, str], time_constant: float = 0.2) -> str:
    """The text of the actuator's file with each key of ``changes`` replaced."""
    text = SOURCE
    for old, new in {"default=0.2": f"default={time_constant!r}", **changes}.items():
        assert old in text, old
        text = text.replace(old, new)
    return text


def write(
    folder: Path,
    time_constant: float = 0.2,
    name: str = "joint.py",
    changes: dict[str, str] | None = None,
) -> Path:
    """Write the actuator's file; it notes beside itself how often it ran."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_text(joint(changes or {}, time_constant) + COUNT_THE_RUN)
    return path


def runs(path: Path) -> int:
    """How often the file has run."""
    marks = path.with_suffix(".ran")
    return len(marks.read_text()) if marks.exists() else 0
