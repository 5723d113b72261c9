"""An FMU whose host connects the command alone does what ``simulate`` does with it alone."""

from __future__ import annotations

from html import unescape
from pathlib import Path
from xml.etree import ElementTree as ET

import fmpy
import numpy as np
import pytest

from fmu_src.archive import PYTHON as PYTHON_FORM
from fmu_src.description import model_description
from fmu_src.documentation import index_html
from fmu_src.native.archive import NATIVE3
from fmu_src.native.description3 import terminals_and_icons
from servo_models.analysis.experiment import step
from servo_models.analysis.live import live_model
from servo_models.analysis.simulate import simulate
from servo_models.build import build
from servo_models.catalogue import actuator, actuators, model
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.simulators.servo import servo_of
from tests.support.fmu_host import Host
from tests.support.own_actuators import write

ROWS = 60
HELD = 20  # rows
LEVELS = np.array([0.3, -0.15, 0.06])  # of the command, over its scale
LATE = 15  # row from which a host that connects late sets the command
OWN = {"bus": "goal", "odrive_position": "position_command", "moteus": "position_command"}
"""Variants whose command is not the main input of their actuator, by what their makers say."""
NAMES = [form for name in actuators() for form in (name, f"{name}_torque")]
EVERY = [(name, variant.name) for name in NAMES for variant in actuator(name).variants]
TWO_COMMANDS = {
    "    goal: float,\n": "    goal: float,\n    trim: float,\n",
    "(goal - angle)": "(goal + trim - angle)",
    '"rad", "goal"),': (
        '"rad", "goal", rest=0.1, low=-4.0, high=4.0),'
        ' Wire("trim", "rad", "trim", rest=0.2, scale=SCALE, high=1.0),'
    ),
    '(Variant("plain", "", {}, ""),)': (
        '(Variant("plain", "", {}, ""), Variant("trimmed", "", {}, "", command="trim"))'
    ),
}


def command_of(name: str, variant: str) -> str:
    return OWN.get(variant, actuator(name).step[0])


def outputs(chosen: Model, times: Array, command: str, values: Array) -> Array:
    return np.column_stack([*simulate(chosen, times, {command: values}).outputs.values()])


@pytest.mark.parametrize(
    ("name", "variant"),
    [
        pytest.param(*it, marks=pytest.mark.thorough if it[1] in OWN else pytest.mark.long)
        for it in EVERY
    ],
)
def test_with_the_command_alone_an_fmu_does_what_simulate_does(
    name: str, variant: str, kind: str, tmp_path: Path
) -> None:
    """From the first row on, and from a later one, until which it makes its standard step."""
    chosen, command = model(name, variant), command_of(name, variant)
    wire = chosen.plant.wire[command]
    times = chosen.step_size * np.arange(float(ROWS))
    values = float(wire.rest) + wire.scale * LEVELS[np.arange(ROWS) // HELD]
    built = build(chosen, tmp_path / "built.fmu", kind)
    with Host(Path(fmpy.extract(str(built), str(tmp_path / "unpacked")))) as host:
        (start,) = (v.start for v in host.description.modelVariables if v.name == command)
        late = np.where(np.arange(ROWS) < LATE, float(start), values)
        for played in (values, late):
            host.start({} if played is late else {command: played[0]})
            found = [host.get()]
            for k, size in enumerate(np.diff(times)):
                if played is values or k >= LATE:
                    host.set({command: played[k]})
                host.fmu.doStep(times[k], size)
                found.append(host.get())
            assert np.array_equal(found, outputs(chosen, times, command, played))
            host.fmu.reset()


@pytest.mark.parametrize(("name", "variant"), EVERY)
def test_no_input_but_the_command_starts_away_from_rest(name: str, variant: str) -> None:
    """The command of another variant says that it is not that of this one."""
    chosen, command = model(name, variant), command_of(name, variant)
    root = ET.fromstring(model_description(chosen, PYTHON_FORM, "", ""))
    inputs = [it for it in root.iterfind(".//ScalarVariable") if it.get("causality") == "input"]
    starts = {it.attrib["name"]: float(it[0].attrib["start"]) for it in inputs}
    rest = {wire: float(column[0]) for wire, column in simulate(chosen, [0.0]).inputs.items()}
    assert [it for it in starts if starts[it] != rest[it]] == [command]
    others = {command_of(name, it.name) for it in chosen.actuator.variants} - {command}
    clause = f"; not the command of variant '{variant}': starts at rest"
    said = {it.attrib["name"] for it in inputs if it.attrib["description"].endswith(clause)}
    assert said == others | ({chosen.actuator.step[0]} - {command})


@pytest.mark.parametrize(
    ("name", "variant"), [it for it in EVERY if it[1] in OWN and it[0] in actuators()]
)
def test_a_position_loop_ends_at_the_goal_of_its_standard_step(name: str, variant: str) -> None:
    """Its gain is 1, which a step of another input does not show."""
    chosen = model(name, variant)
    assert servo_of(chosen).command.name == OWN[variant]  # what is exported
    stepped = step(chosen, stop=2.0)
    assert stepped["angle"][-1] == pytest.approx(stepped[OWN[variant]][-1], rel=0.01)


@pytest.mark.parametrize(
    ("variant", "scale", "stepped"),
    [
        ("plain", 0.5, {"goal": 1.0, "trim": 0.2}),
        ("trimmed", 0.5, {"goal": 0.1, "trim": 0.45}),
        ("trimmed", 3.0, {"goal": 0.1, "trim": 1.0}),  # no further than its bound
    ],
)
def test_the_command_of_an_own_variant_steps_everywhere(
    variant: str, scale: float, stepped: dict[str, float], tmp_path: Path
) -> None:
    changes = {old: new.replace("SCALE", str(scale)) for old, new in TWO_COMMANDS.items()}
    path = write(tmp_path, changes=changes)
    chosen = model(str(path), variant)
    inputs = step(chosen).inputs
    assert {name: inputs[name][0] for name in stepped} == pytest.approx(stepped)
    root = ET.fromstring(model_description(chosen, PYTHON_FORM, "", ""))
    starts = {it.attrib["name"]: it[0].get("start") for it in root.iterfind(".//ScalarVariable")}
    assert {name: float(starts[name] or "nan") for name in stepped} == pytest.approx(stepped)
    command = "goal" if variant == "plain" else "trim"
    terminals = ET.fromstring(terminals_and_icons(chosen, NATIVE3))
    members = terminals.iterfind(".//Terminal[@name='command']/TerminalMemberVariable")
    assert [it.get("variableName") for it in members] == [command]
    size = stepped[command] - float(chosen.plant.wire[command].rest)
    assert live_model(chosen).driven == pytest.approx((command, size))
    page = unescape(index_html(chosen, PYTHON_FORM))
    assert f"but for '{command}', which steps to {stepped[command]:g} rad" in page
