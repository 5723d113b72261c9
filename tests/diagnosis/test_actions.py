"""What a person can set and measure: asked for where a closed form says that it alone tells."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomllib

from servo_models.catalogue import model
from servo_models.core.block import Bench, block
from servo_models.core.plant import Actuator, Plant, State, Variant, Wire, internal_step, place
from servo_models.core.simulate import Model
from servo_models.data.description import read_description
from servo_models.diagnosis.design import Experiment, next_experiments
from servo_models.diagnosis.design.play_script import script
from servo_models.diagnosis.search.fitting import FittedModel, Fitter
from servo_models.effects.gain_error import gain_error
from servo_models.effects.offset import offset
from servo_models.identification.problem import free_parameter
from tests.support.delayed_motor import describe
from tests.support.logs import changed, measured

FLOOR = 0.005  # V
LOWERED = Bench("lower the supply", 60.0, 0.7)
SUPPLY = Wire("supply", "V", "supply", 5.0, rest=5.0, low=0.0, high=10.0)


@block("drive")
def bridge(command: float, supply: float) -> float:
    """A share of the supply."""
    return command * supply


@block("output_rate")
def follows(drive: float, output: float) -> float:
    """The output follows the drive."""
    return (drive - output) / 0.01


def rig(*bench: Bench) -> Model:
    """command x supply, behind a lag of 10 ms; the supply can be set by this."""
    plant = Plant(
        inputs=(
            Wire("command", "1", "share of the supply", low=-1.0, high=1.0),
            replace(SUPPLY, bench=bench),
        ),
        wires=(Wire("drive", "V", "drive", 5.0),),
        chain=(
            place("scale", gain_error, "command"),
            place("shift", offset, "supply"),
            bridge,
            follows,
        ),
        states=(State(Wire("output", "V", "output", 5.0), "output_rate"),),
        outputs=("output",),
        constants=internal_step(2e-3),
    )
    actuator = Actuator(
        name="bridge",
        title="A bridge",
        about="",
        source="",
        plant=plant,
        variants=(Variant("one", "", {}, ""),),
        stop_time=0.3,
        step_size=0.001,
        step=("command", 1.0),
    )
    return model(actuator)


def rivals(chosen: Model) -> list[FittedModel]:
    """A gain of 1.04 and a supply that is 0.2 V higher: at 5 V both make 5.2 of each command."""
    times = 1e-3 * np.arange(300.0)
    sizes = {"scale.error": 0.04, "shift.value": 0.2}
    played, true = np.sign(np.sin(80.0 * times)), changed(chosen, {"scale.error": 0.04})
    log = measured(true, times, {"command": played}, {"output": FLOOR}, 1)
    fitter, parameters = Fitter(chosen, [log], (), {"output": FLOOR}), chosen.plant.parameters
    return [
        fitter.at_values(
            (name.partition(".")[0],), [free_parameter(parameters[name], 0.0, None)], {name: size}
        )
        for name, size in sizes.items()
    ]


def designed(chosen: Model) -> Experiment:
    first, *_ = next_experiments(rivals(chosen), (0.5, 0.5))
    return first


def test_the_supply_is_asked_for_where_only_the_supply_tells() -> None:
    """command (s + 0.2) against 1.04 command s: the same at s = 5, not at 3.5."""
    found = designed(rig(LOWERED))
    assert [plan.constants for plan in found.plans] == [{}, {"supply": 3.5}]
    assert found.told[0, 1]
    assert found.told[1, 0]
    assert found.decides > 0.99
    assert found.imitated == ()
    assert found.seconds > LOWERED.seconds
    assert "Then lower the supply and play it again." in found.steps[0]
    # 5 (1 + e) and 3.5 (1 + e) together miss 5.2 and 3.7 by least squares, each in half of the time
    gain = (5.0 * 5.2 + 3.5 * 3.7) / (5.0**2 + 3.5**2)
    missed = np.hypot(5.2 - 5.0 * gain, 3.7 - 3.5 * gain)
    assert found.separations[1, 0] <= missed / FLOOR
    assert found.separations[1, 0] > 0.5 * missed / FLOOR * np.sqrt(np.mean(found.command**2))


def test_without_it_the_choice_makes_no_difference() -> None:
    found = designed(rig())
    assert not found.telling
    assert found.imitated == ((0, 1), (1, 0))
    assert "makes no difference to these outputs" in found.text


def test_the_script_makes_the_log_that_its_description_reads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Filled in with an actuator whose angle is a tenth of the last command."""
    wires = model("torque_motor").plant.wire
    described = describe(tmp_path, seconds=0.1)
    (log,) = read_description(described).logs
    times = 1e-3 * np.arange(40.0)
    plans = [
        replace(log, times=times, settle=0.0, constants=constants)
        for constants in ({}, {"load_torque": 0.01, "constant_load.torque": 0.0})
    ]
    table, played = tmp_path / "next.csv", np.sin(200.0 * times)
    text = "".join(f"{t!r},{u!r}\n" for t, u in zip(times.tolist(), played.tolist()))
    table.write_text(f"time [s],voltage [V]\n{text}")
    source = script("next.csv", wires["voltage"], [wires["angle"], wires["current"]], plans)
    send, read = "sent.append(value)", "return 0.1 * sent[-1], 1e-3 * sent[-1]"
    for body in (send, read):
        source = source.replace("raise NotImplementedError", body, 1)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "script", "sent": []}
    exec(source, names)
    entries = str(names["__doc__"]).partition("[[logs]]")
    for entry in tomllib.loads("".join(entries[1:]))["logs"]:
        names["play"](entry["file"])  # type: ignore[operator]
    head = described.read_text().partition("[[logs]]")[0]
    described.write_text(head + "".join(entries[1:]))
    first, second = read_description(described).logs
    assert (first.constants, second.constants) == ({}, plans[1].constants)
    np.testing.assert_array_equal(first.inputs["voltage"], played)
    np.testing.assert_array_equal(first.outputs["angle"][1:], 0.1 * played[:-1])
    assert np.all(np.diff(first.times) > 0.0)
