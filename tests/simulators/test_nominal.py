"""Nominal values from files of simulators, against the simulators and against hand calculation."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from servo_models.analysis.simulate import simulate
from servo_models.data.parameters import read_parameters, write_parameters
from servo_models.diagnosis.diagnose import diagnose
from servo_models.errors import UserError
from servo_models.simulators import simulator
from servo_models.simulators.nominal import import_nominal as nominal
from tests.conftest import Run
from tests.support.engines import jsbsim_angles, mujoco_angles

ROBOT = """<mujoco><compiler angle="{angle}"/>
<option integrator="implicitfast" timestep="0.0002"/>
<default><joint damping="0.02"/><default class="arm">
<joint frictionloss="0.03" damping="0.04"/><position kp="5" forcerange="-0.4 0.4"/>
</default></default>
<worldbody><body name="upper" childclass="arm">
<inertial pos="0 0 0" mass="1" diaginertia="{i} {i} {i}"/>
<joint name="elbow" armature="0.004" range="-90 90" limited="false"/></body>
<body name="hand"><inertial pos="0 0 0" mass="1" diaginertia="{i} {i} {i}"/>
<joint name="wrist" armature="0.001"/></body></worldbody>
<actuator>{actuators}</actuator></mujoco>"""
ELBOW = '<position class="arm" joint="elbow"/>'
CONFIGURATION = """
STIFF = 80.0
CFG = ArticulationCfg(actuators={
    "legs": DelayedPDActuatorCfg(
        joint_names_expr=[".*_knee", ".*_hip"], stiffness={".*_knee": STIFF, ".*_hip": 20},
        damping=2.0, armature=0.01, friction=0.1, effort_limit=20, velocity_limit_sim=9.0,
        min_delay=0, max_delay=4),
    "arm": ImplicitActuatorCfg(joint_names_expr=["elbow"], stiffness=None, damping=1.0),
    "\\x1b[31mneck": ImplicitActuatorCfg(joint_names_expr=["n"], stiffness=2.0 * STIFF, damping=1),
})
"""
ACTUATOR = """<system name="s"><channel name="c"><actuator name="fcs/elevator-deg">
<input>fcs/command</input><lag>20</lag><rate_limit>90</rate_limit><bias>1.5</bias>
<hysteresis_width>2</hysteresis_width><delay type="frames">6</delay>
</actuator></channel></system>"""


def robot(
    folder: Path, actuators: str = ELBOW, inertia: float = 1e-9, angle: str = "degree"
) -> str:
    path = folder / "robot.xml"
    path.write_text(ROBOT.format(actuators=actuators, i=inertia, angle=angle))
    return str(path)


LAGGED = '<position joint="wrist" kp="2" kv="0.09" forcerange="-0.3 0.3" timeconst="0.01"/>'
PID = '<pid class="arm" joint="elbow" kp="3" kv="0.01" gear="2" slewmax="6" input="pos"/>'
MOTOR = '<motor joint="wrist" gear="{}" armature="1e-4" damping="1e-3"/>'
DC = '<dcmotor joint="wrist" gear="10" motorconst="0.02" resistance="2" {}/>'
POSITION = 'input="pos" controller="0.03 0 0.002'
NOMINAL = 'joint="wrist" gear="-10" nominal="12 0.12 600" inductance="0 3e-3"'


@pytest.mark.parametrize(
    ("actuator", "command", "size", "within"),
    [
        # damping by the joint, force limited: the largest speed is their ratio
        (ELBOW, "goal", 1.0, 0.02),
        (LAGGED, "goal", 1.0, 0.02),
        (PID, "goal", 1.0, 0.02),
        ('<position joint="wrist" kp="2" kv="0.1" damping="0.1"/>', "goal", 1.0, 1e-3),
        (MOTOR.format(3), "current_command", 0.02, 1e-3),
        (MOTOR.format(-3), "current_command", 0.02, 1e-3),
        (DC.format('armature="1e-5" damping="1e-6"'), "voltage", 6.0, 1e-3),
        (DC.format('inductance="0.02" ctrlrange="-4 4"'), "voltage", 6.0, 1e-3),
        (f'<dcmotor {NOMINAL} delay="0.004" nsample="20"/>', "voltage", 6.0, 1e-3),
        (DC.format(f'{POSITION}"'), "goal", 6.0, 1e-3),
        (DC.format(f'{POSITION} 30 0 0" saturation="0.05"'), "goal", 6.0, 1e-3),
        (DC.format(f'{POSITION}" saturation="0 2"'), "goal", 6.0, 1e-3),
        (DC.format(f'{POSITION} 0 0 12"'), "goal", 6.0, 0.01),  # torque falls with speed there
    ],
)
def test_the_model_moves_as_mujoco_moves_the_joint(
    actuator: str, command: str, size: float, within: float, tmp_path: Path
) -> None:
    """But for a friction loss, which is a soft constraint there, and a least of damping here."""
    pytest.importorskip("mujoco", minversion="4.0")  # which has pid and dcmotor
    path = robot(tmp_path, actuator, inertia=0.002)
    joint = "wrist" if "wrist" in actuator else "elbow"
    found = nominal(f"{path}#{joint}", "0.002 kg.m2").model()
    step = 2e-4
    times = step * np.arange(5000)
    goal = size * np.where(times < 0.02, 0.0, np.where(times < 0.5, 1.0, -0.4))
    model = Path(path).read_text()
    other = "hand" if joint == "elbow" else "upper"
    cut = model.index(f'<body name="{other}"'), model.index("</body>", model.index(f'"{other}"'))
    engine = mujoco_angles(model[: cut[0]] + model[cut[1] + 7 :], goal, np.zeros(5000))
    ours = simulate(found, times, {command: goal})["angle"]
    assert np.ptp(engine) > 0.5
    assert ours == pytest.approx(engine, abs=within * np.ptp(engine))


@pytest.mark.long
def test_a_diagnosis_says_what_the_joint_lacks(tmp_path: Path) -> None:
    """A joint with late commands and play, both put in here, beside what its MJCF says."""
    found = nominal(f"{robot(tmp_path)}#elbow", "0.002 kg.m2")
    write_parameters(found, tmp_path / "elbow.toml")
    random = np.random.default_rng(1)
    times = np.arange(0.0, 12.0, 0.01)
    sweep = 0.3 * np.sin(2.0 * np.pi * (0.2 + 0.15 * times) * times)
    goal = np.repeat(random.uniform(-0.6, 0.6, 30), 40) + sweep
    late = found.model({"backlash.half_width": 0.02, "transport_delay.time": 0.02})
    angle = simulate(late, times, {"goal": goal})["angle"] + random.normal(0.0, 5e-4, len(times))
    columns = np.column_stack([times, goal, angle])
    log = tmp_path / "elbow.csv"
    np.savetxt(log, columns, delimiter=",", header="time,goal,angle", comments="")
    (tmp_path / "log.toml").write_text(
        'params = "elbow.toml"\n[[logs]]\nfile = "elbow.csv"\n'
        'time = {column = "time", unit = "s"}\ninputs.goal = {column = "goal", unit = "rad"}\n'
        'outputs.angle = {column = "angle", unit = "rad"}\n'
    )
    taken = diagnose(tmp_path / "log.toml").selection.taken
    assert {"backlash", "transport_delay"} <= set(taken.effects)


def test_an_mjcf_follows_classes_and_degrees(tmp_path: Path) -> None:
    found = nominal(f"{robot(tmp_path)}#elbow").settings()
    assert found["inertia"] == 0.004
    assert found["natural_frequency"] == pytest.approx(math.sqrt(5.0 / 0.004))
    assert found["damping_ratio"] == pytest.approx(0.04 / (2.0 * math.sqrt(5.0 * 0.004)))
    assert found["speed_limit"] == pytest.approx(0.4 / 0.04)
    assert found["coulomb_friction.level"] == 0.03
    radians = robot(tmp_path, angle="radian")
    Path(radians).write_text(
        Path(radians).read_text().replace("limited", "user").replace("90", "1")
    )
    assert nominal(f"{radians}#elbow").settings()["end_stops.half_range"] == 1.0


def test_a_configuration_of_isaac_lab_is_read_and_not_run(tmp_path: Path) -> None:
    path = tmp_path / "robot_cfg.py"
    path.write_text(CONFIGURATION + "\nraise SystemExit\n")
    found = nominal(f"{path}#left_knee").settings()
    assert found["natural_frequency"] == pytest.approx(math.sqrt(80.0 / 0.01))
    assert found["acceleration_limit"] == pytest.approx(20.0 / 0.01)
    assert found["speed_limit"] == 9.0
    assert found["transport_delay.time"] == pytest.approx(2 * 0.005)
    assert found["coulomb_friction.level"] == 0.1


def test_a_motor_of_isaac_lab_has_no_torque_beyond_its_speed(tmp_path: Path) -> None:
    path = tmp_path / "robot_cfg.py"
    given = CONFIGURATION.replace("DelayedPDActuatorCfg", "DCMotorCfg")
    path.write_text(given.replace("velocity_limit_sim=9.0", "velocity_limit=7.0"))
    found = nominal(f"{path}#left_knee")
    assert found.settings()["speed_limit"] == 7.0
    (falls,) = found.warnings
    assert "falls to 0 at velocity_limit" in falls


def test_an_actuator_of_jsbsim_in_degrees(tmp_path: Path) -> None:
    path = tmp_path / "plane.xml"
    path.write_text(ACTUATOR)
    found = nominal(str(path)).settings()
    assert found["rate_limit.rate"] == pytest.approx(math.pi / 2.0)
    assert found["stiction.band"] == pytest.approx(math.radians(2.0))  # play, without a slip
    assert found["stiction.jump"] == 0.0
    assert found["command_offset.value"] == pytest.approx(math.radians(1.5))
    assert found["command_lag.time_constant"] == 0.05
    assert found["transport_delay.time"] == pytest.approx(5.0 / 120.0)  # as its engine runs six
    path.write_text('<s><actuator name="fcs/elevator-norm"><lag>20</lag></actuator></s>')
    (normalised,) = nominal(str(path)).warnings
    assert "1 rad is 1 of it" in normalised


def test_the_model_moves_as_jsbsim_moves_the_actuator(tmp_path: Path) -> None:
    """Within two frames of the fastest motion; the goal goes beyond the nearer end of clipto."""
    pytest.importorskip("jsbsim")
    lines = (
        '<actuator name="fcs/servo"><input>fcs/goal</input><lag>20</lag><rate_limit>3</rate_limit>'
        "<hysteresis_width>0.2</hysteresis_width><delay>0.05</delay>"
        "<clipto><min>-0.4</min><max>0.5</max></clipto></actuator>"
    )
    (tmp_path / "servo.xml").write_text(f"<system>{lines}</system>")
    found = nominal(f"{tmp_path / 'servo.xml'}")
    (uneven,) = found.warnings
    assert "-0.4 to 0.5" in uneven
    step = 1.0 / 120.0
    times = step * np.arange(360)
    goal = np.where(times < 0.1, 0.0, np.where(times < 1.2, 0.3, -1.0)) + 0.1 * (times > 2.0)
    engine = jsbsim_angles(lines, step, goal, tmp_path)
    ours = simulate(found.model(), times, {"goal": goal})["angle"]
    assert engine.min() == -0.4
    assert ours == pytest.approx(engine, abs=2.0 * 3.0 * step)


def test_what_is_exported_can_be_read_again(tmp_path: Path) -> None:
    """A joint without limits, as a configuration writes it: a limit that no joint reaches."""
    fields = {it.name: 0.0 for it in simulator("isaaclab").fields}
    lines = simulator("isaaclab").lines({**fields, "stiffness": 9.0, "damping": 0.5}, 0.005, 0.01)
    path = tmp_path / "again.py"
    path.write_text(f"CFG = {{{lines}}}")
    found = nominal(str(path)).settings()
    assert found["natural_frequency"] == pytest.approx(30.0)
    assert found["damping_ratio"] == pytest.approx(0.5 / (2.0 * 30.0 * 0.01))
    assert (found["speed_limit"], found["acceleration_limit"]) == (1e4, 1e7)


def test_parameters_of_ardupilot(tmp_path: Path) -> None:
    path = tmp_path / "plane.parm"
    path.write_text("# mine\nSIM_SERVO_SPEED 0.2\nSIM_SERVO_FILTER,5 # Hz\nSCHED_LOOP_RATE 300\n")
    found = nominal(str(path)).settings()
    assert found["rate_limit.rate"] == pytest.approx(math.radians(60.0) / 0.2)
    assert found["natural_frequency"] == pytest.approx(10.0 * math.pi)
    assert found["damping_ratio"] == pytest.approx(math.sqrt(0.5))
    path.write_text("SIM_SERVO_SPEED 0.2")
    assert nominal(str(path)).settings()["command_lag.time_constant"] == 0.2


def test_a_motor_of_bam(tmp_path: Path) -> None:
    path = tmp_path / "m4.json"
    motor = {"kt": 0.3, "R": 2.5, "armature": 0.002, "friction_base": 0.01, "model": "m4"}
    more = {"load_friction_base": 0.1, "friction_viscous": 0.01, "friction_stribeck": 0.02}
    path.write_text(json.dumps({**motor, **more, "dtheta_stribeck": 0.5, "vin": 7.4}))
    found = nominal(str(path))
    told = found.settings()
    assert (told["torque_constant"], told["resistance"], told["inertia"]) == (0.3, 2.5, 0.002)
    assert found.variant == "xl330"
    path.write_text(json.dumps({**motor, "actuator": "sts3215"}))
    assert nominal(str(path)).variant == "sts3215"
    path.write_text(json.dumps({**motor, "actuator": "mx106"}))
    assert "of 'mx106' we have no variant" in nominal(str(path)).warnings[-1]
    assert told["load_friction.coefficient"] == 0.2  # motor and load each bear on the gears
    full_speed = 10.0
    assert told["viscous_friction.torque"] / full_speed == pytest.approx(0.01)
    assert told["stribeck_friction.speed"] * full_speed == pytest.approx(0.5)
    assert "7.4 V" in found.warnings[0]


def test_the_command_writes_a_parameter_file(tmp_path: Path, run: Run) -> None:
    out = tmp_path / "elbow.toml"
    code, said, _ = run("import", f"{robot(tmp_path)}#elbow", "--out", out)
    assert code == 0
    assert "armature of joint 'elbow'" in said
    assert read_parameters(out).settings() == nominal(f"{robot(tmp_path)}#elbow").settings()


BOMB = '<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><mujoco><x y="&b;"/></mujoco>'
PASSIVE = DC.format('input="none"')


@pytest.mark.parametrize(
    ("name", "text", "joint", "said"),
    [
        ("a.xml", None, "#elbw", "did you mean 'elbow'?"),
        ("a.xml", ELBOW + '<position joint="wrist"/>', "", "name it, FILE#NAME; known: elbow"),
        ("a.xml", ELBOW, "#wrist", "joint 'wrist' has no actuator"),
        ("a.xml", '<velocity joint="wrist"/>', "#wrist", "is driven by <velocity>"),
        ("a.xml", '<dcmotor joint="wrist"/>', "", "has no motorconst and resistance"),
        ("a.xml", PASSIVE, "", "has input 'none': give one with voltage or pos"),
        ("a.xml", DC.format('input="pos" controller="1 2"'), "", "integral gain"),
        ("a.xml", '<motor joint="wrist" gear="0"/>', "", "gear of joint 'wrist' is 0"),
        ("a.xml", '<position joint="wrist" kp="-1" dampratio="1"/>', "", "no stiffness"),
        ("a.xml", '<position joint="wrist" kp="stiff"/>', "", "kp of joint 'wrist' is 'stiff'"),
        ("a.xml", '<position joint="wrist" kp="nan"/>', "", "give a number"),
        ("a.xml", '<pid joint="wrist" ki="3"/>', "", "integral gain"),
        ("b.xml", BOMB, "", "document type or entities"),
        ("b.xml", "<mujoco", "", "no XML"),
        ("b.xml", "<mujoco/>", "", "no hinge joint with an actuator in it"),
        ("b.xml", ACTUATOR.replace("20", "fcs/lag"), "", "lag of actuator 'fcs/elevator-deg' is"),
        ("c.py", CONFIGURATION, "#arm", "no stiffness"),
        ("c.py", CONFIGURATION, "#n", "stiffness of '?[31mneck' is no number"),
        ("c.py", CONFIGURATION, "#lgs", "did you mean 'legs'?"),
        ("c.py", CONFIGURATION.replace("ImplicitA", "A"), "#arm", "is a ActuatorCfg, which is not"),
        ("c.py", "def", "", "no Python"),
        ("c.py", "-" * 100_000 + "1", "", "no Python"),
        ("d.parm", "SIM_SPEEDUP 1", "", "none of SIM_SERVO_SPEED"),
        ("d.parm", "SIM_SERVO_SPEED fast", "", "SIM_SERVO_SPEED is 'fast'"),
        ("d.parm", "SIM_SERVO_SPEED 1", "#1", "leave out '#1'"),
        ("e.json", "[" * 100_000, "", "no JSON"),
        ("e.json", "{}", "", "it has no model, kt, R, armature"),
        ("f.urdf", "", "", "may end in .json, .mjcf"),
    ],
)
def test_what_cannot_be_read_is_told_with_the_cure(
    name: str, text: str | None, joint: str, said: str, tmp_path: Path, run: Run
) -> None:
    path = tmp_path / name
    path.write_text(ROBOT.format(actuators=text or ELBOW, i=1e-9, angle="degree"))
    if name != "a.xml":
        path.write_text(text or "")
    code, out, err = run("import", f"{path}{joint}")
    assert (code, out) == (2, "")
    assert said in err
    assert name in err
    assert "\x1b" not in err


def test_what_a_motor_has_and_ours_has_not_is_said(tmp_path: Path) -> None:
    motor = robot(tmp_path, DC.format('cogging="0.01 8" thermal="1 2"'))
    (left_out,) = nominal(f"{motor}#wrist").warnings
    assert "cogging, thermal of joint 'wrist' left out" in left_out
    motor = robot(tmp_path, '<motor joint="wrist" gear="3" ctrlrange="-1 1"/>')
    unit, limit = nominal(f"{motor}#wrist").warnings
    assert "1 A is what a control of 1 does" in unit
    assert "ctrlrange" in limit


def test_the_size_of_a_motor_chooses_the_variant(tmp_path: Path) -> None:
    """A friction of 0.3 N m is within the bounds of a motor with a gearbox alone."""
    path = Path(robot(tmp_path, DC.format("")))
    assert nominal(f"{path}#wrist").variant == "direct"
    path.write_text(path.read_text().replace('name="wrist"', 'name="wrist" frictionloss="0.3"'))
    assert nominal(f"{path}#wrist").variant == "geared"


@pytest.mark.parametrize("actuator", ['<position joint="wrist"/>', DC.format("")])
def test_a_joint_without_inertia_asks_for_it(actuator: str, tmp_path: Path) -> None:
    path = robot(tmp_path, actuator)
    Path(path).write_text(Path(path).read_text().replace('armature="0.001"', ""))
    with pytest.raises(UserError, match="--inertia"):
        nominal(path)
    given = nominal(path, "20 g.cm2").settings()
    carried = given.get("inertia", given.get("rotor_inertia", 0.0) * 10.0**2)  # gear
    assert carried == pytest.approx(2e-6)
