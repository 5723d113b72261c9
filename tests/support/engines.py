"""Exported lines in minimal models of the engines themselves; each needs its package.

ArduPilot has none: its law is written a second time, independently of the package.
"""

from __future__ import annotations

import math
import re
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import butter, lfilter

from servo_models.core.types import Array

BARE = 1e-9  # kg m2 of the body that a joint of MuJoCo needs

MUJOCO = """<mujoco><worldbody><body><inertial pos="0 0 0" mass="1e-9" diaginertia="{0} {0} {0}"/>
{1}</body></worldbody>{2}<actuator>{3}</actuator></mujoco>"""

JSBSIM = """<?xml version="1.0"?>
<fdm_config name="servo" version="2.0" release="ALPHA">
<metrics><wingarea unit="FT2">1</wingarea><wingspan unit="FT">1</wingspan>
<chord unit="FT">1</chord><htailarea unit="FT2">0</htailarea><htailarm unit="FT">0</htailarm>
<vtailarea unit="FT2">0</vtailarea><vtailarm unit="FT">0</vtailarm>
<location name="AERORP" unit="IN"><x>0</x><y>0</y><z>0</z></location></metrics>
<mass_balance><ixx unit="SLUG*FT2">1</ixx><iyy unit="SLUG*FT2">1</iyy><izz unit="SLUG*FT2">1</izz>
<emptywt unit="LBS">10</emptywt>
<location name="CG" unit="IN"><x>0</x><y>0</y><z>0</z></location></mass_balance>
<ground_reactions/><propulsion/>
<flight_control name="FCS"><channel name="servo">{}</channel></flight_control><aerodynamics/>
</fdm_config>"""


def mujoco_model(lines: str) -> str:
    """An MJCF of one body with the exported option, comment, joint and actuator."""
    option, _, joint, actuator = lines.splitlines()
    return MUJOCO.format(BARE, joint, option, actuator)


def mujoco_angles(model: str, goal: Array, load: Array) -> Array:
    """Angle [rad] before each step of the engine, shape (n,)."""
    import mujoco

    made: Any = mujoco.MjModel.from_xml_string(model)
    data: Any = mujoco.MjData(made)
    angles = []
    for wanted, torque in zip(goal, load):
        angles.append(float(data.qpos[0]))
        data.ctrl[0], data.qfrc_applied[0] = wanted, -torque
        mujoco.mj_step(made, data)
    return np.array(angles)


def jsbsim_angles(lines: str, step: float, goal: Array, folder: Path) -> Array:
    """Output of the actuator after each frame of the engine, shape (n,)."""
    import jsbsim

    (folder / "aircraft" / "servo").mkdir(parents=True, exist_ok=True)
    channel = lines.replace("fcs/servo-goal", "fcs/goal")
    (folder / "aircraft" / "servo" / "servo.xml").write_text(JSBSIM.format(channel))
    engine = jsbsim.FGFDMExec(str(folder), None)
    engine.set_debug_level(0)
    engine.set_dt(step)
    engine["fcs/goal"] = goal[0]
    assert engine.load_model("servo")
    engine.run_ic()
    angles = []
    for wanted in goal:
        engine["fcs/goal"] = wanted
        engine.run()
        angles.append(engine["fcs/servo"])
    return np.array(angles)


def ardupilot_angles(lines: str, step: float, goal: Array) -> Array:
    """SITL's ServoModel from the parameters as printed; scipy's Butterworth filter."""
    told = dict(re.findall(r"SIM_SERVO_(\w+),([\d.e-]+)", lines))
    speed, delay, cutoff = (float(told[name]) for name in ("SPEED", "DELAY", "FILTER"))
    if delay == 0.0 and cutoff == 0.0:
        reached, angles = 0.0, []
        for wanted in goal:
            reached += (wanted - reached) * step / (step + speed)
            angles.append(reached)
        return np.array(angles)
    moved, angles = 0.0, []
    size = max(1, int(delay / step))
    buffer: deque[float] = deque()
    for wanted in goal:
        while delay > 0.0 and len(buffer) < size:
            buffer.append(wanted)
        late = buffer.popleft() if delay > 0.0 else wanted
        reach = math.radians(60.0) / speed * step if speed else math.inf
        moved = float(np.clip(late, moved - reach, moved + reach))
        angles.append(moved)
    slewed = np.array(angles)
    if cutoff:
        slewed = lfilter(*butter(2, cutoff, fs=1.0 / step), slewed)
    return slewed
