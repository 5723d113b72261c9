"""Log descriptions: what the author of a log says becomes SI, and every fault has a place."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from servo_models.analysis.simulate import simulate
from servo_models.data.description import DescriptionTable
from servo_models.data.parameters import Estimate, ParameterSet, write_parameters
from servo_models.data.signals import LogTable, Signal
from tests.support.descriptions import DEGREE, HEAD, LOG, TABLE, complaint, describe, text_of
from tests.support.own_actuators import WITH_A_FLAG, write

PAGE = (Path(__file__).parents[2] / "docs" / "description.md").read_text(encoding="utf-8")


def test_the_page_of_the_format_is_read(tmp_path: Path) -> None:
    """Its example, on a log of 25 s whose reading is 2 ms early and whose command is inverted."""
    example = PAGE.split("```toml\n")[2].split("```")[0]
    rows = [(20.0 * i, 25.0 + (i % 3), 0.1 * i) for i in range(1250)]
    found = describe(tmp_path, example, head="", data=text_of(rows, "t,u,angle"))
    assert found.free == ("torque_constant", "inductance")
    assert found.model.values["resistance"] == 3650.0
    assert found.bounds == {"inductance": (25.0, 40.0)}
    assert found.uncertainty["torque_constant"] == 0.25 * found.model.values["torque_constant"]
    assert found.uncertainty["inductance"] == 4.0
    (log,) = found.logs
    assert log.inputs["voltage"][:3] == pytest.approx([0.0, -0.1, -0.2])
    assert log.outputs["angle"][1] == pytest.approx(0.1 * 0.9 * DEGREE)
    assert log.constants == {"load_torque": 5e-3}
    assert log.times[log.held_out][[0, -1]] == pytest.approx([12.0, 20.0])


def test_the_page_of_the_format_has_every_key() -> None:
    named = set(re.findall(r"`(\w+)[`.]", PAGE))
    for table in (DescriptionTable, LogTable, Signal):
        assert {*table.__struct_encode_fields__} <= named


def test_columns_become_signals_in_si(tmp_path: Path) -> None:
    found = describe(tmp_path)
    (log,) = found.logs
    assert (found.actuator.name, found.variant) == ("torque_motor", "measured")
    assert log.name == "log"
    assert log.times == pytest.approx(5e-3 * np.arange(20), rel=1e-12, abs=1e-15)
    assert list(log.inputs["voltage"]) == [row[1] for row in TABLE]
    assert log.outputs["angle"] == pytest.approx([row[2] * DEGREE for row in TABLE], rel=1e-12)
    assert list(log.rows) == list(range(2, 22))
    assert not log.held_out.any()
    channel = log.channels["time"]
    assert channel.scale * 105.0 + channel.offset == pytest.approx(5e-3)


@settings(deadline=None, max_examples=50)
@given(
    scale=st.floats(1e-6, 1e6),
    offset=st.floats(-100.0, 100.0),
    sign=st.sampled_from([1, -1]),
    degrees=st.booleans(),
)
def test_scale_sign_and_offset(
    tmp_path_factory: pytest.TempPathFactory, scale: float, offset: float, sign: int, degrees: bool
) -> None:
    unit, size = ("deg", DEGREE) if degrees else ("rad", 1.0)
    signal = f'{{ column = 3, unit = "{unit}", scale = {scale}, offset = {offset}, sign = {sign} }}'
    log_ = LOG.replace('{ column = "angle_deg", unit = "deg" }', signal)
    (log,) = describe(tmp_path_factory.getbasetemp(), log_).logs
    expected = [size * (sign * scale * row[2] + offset) for row in TABLE]
    size_ = size * (scale * TABLE[-1][2] + abs(offset))
    assert log.outputs["angle"] == pytest.approx(expected, rel=1e-12, abs=1e-12 * size_)


def test_short_forms(tmp_path: Path) -> None:
    log_ = """
    [[logs]]
    file = "log.csv"
    name = "short"
    time = 1
    inputs = { voltage = "u" }
    outputs.angle = { column = "angle_deg", unit = "deg", offset = "20 mrad" }
    constants = { load_torque = "5 mN.m", null_shift.angle = "0.1 deg", stiffness = 1.2 }
    """
    in_seconds = text_of([(1e-3 * time, u, angle) for time, u, angle in TABLE])
    (log,) = describe(tmp_path, log_, data=in_seconds).logs
    assert (log.name, log.duration) == ("short", pytest.approx(0.095))
    assert log.outputs["angle"][0] == pytest.approx(0.02)
    expected = {"load_torque": 5e-3, "null_shift.angle": 0.1 * DEGREE, "stiffness": 1.2}
    assert log.constants == pytest.approx(expected)


def test_parameters_and_their_uncertainty(tmp_path: Path) -> None:
    head = HEAD + (
        'free = ["torque_constant", "null_shift"]\nmethod = "simulation"\n'
        '[parameters]\ntorque_constant = 6.0\nnull_shift.angle = "0.5 deg"\n'
        '"transport_delay.time" = "1.1 ms"\n'
        '[uncertainty]\ntorque_constant = "10 %"\nnull_shift.angle = "0.1 deg"\n'
        "resistance = 20.0\n"
    )
    found = describe(tmp_path, head=head)
    assert found.free == ("torque_constant", "null_shift")
    assert found.method == "simulation"
    given_ = {
        "torque_constant": 6.0,
        "null_shift.angle": 0.5 * DEGREE,
        "transport_delay.time": 1.1e-3,
    }
    assert found.parameters == pytest.approx(given_)
    assert {name: found.model.values[name] for name in given_} == pytest.approx(given_)
    said = {
        "torque_constant": 0.6,
        "null_shift.angle": 0.1 * DEGREE,
        "resistance": 20.0,
        "inductance": 0.25 * 34.0,  # the variant's own, relative to Table 1
        "rotor_inertia": 0.01 * 7.246e-7,
    }
    assert {name: found.uncertainty[name] for name in said} == pytest.approx(said)


def test_values_identified_before(tmp_path: Path) -> None:
    known = ParameterSet("torque_motor", "estimated", (Estimate("stiffness", 1.3),))
    write_parameters(known, tmp_path / "before.toml")
    found = describe(tmp_path, head='params = "before.toml"\n[parameters]\nresistance = 3600\n')
    assert (found.actuator.name, found.variant) == ("torque_motor", "estimated")
    assert found.parameters == {"stiffness": 1.3, "resistance": 3600.0}
    assert found.model.values["stiffness"] == 1.3
    assert "before.toml" in found.model.provenance
    message = complaint(tmp_path, head='params = "before.toml"\nactuator = "sg90"\n')
    assert "is of actuator 'torque_motor', variant 'estimated'" in message


JOINT = """
[[logs]]
file = "log.csv"
time = { column = "time_ms", unit = "ms" }
inputs.goal = "u"
outputs.angle = { column = "angle_deg", unit = "deg" }
"""


def test_an_actuator_of_ones_own(tmp_path: Path) -> None:
    write(tmp_path, name="mine.py", changes=WITH_A_FLAG)
    log_ = JOINT + "constants = { enabled = false }\n"
    found = describe(tmp_path, log_, 'actuator = "mine.py"\nfree = ["time_constant"]\n')
    assert found.logs[0].constants == {"enabled": 0.0}
    times = np.linspace(0.0, 1.0, 11)
    response = simulate(found.model, times, {"goal": 1.0})["angle"]
    assert response == pytest.approx(1.0 - np.exp(-times / 0.2), abs=1e-9)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "cannot read"),
        ("x = 1\n", "defines no ACTUATOR"),
        ("ACTUATOR = 1\n", "defines no ACTUATOR"),
        ("import nothing_like_this\n", "does not run: ModuleNotFoundError"),
        ("def\n", "does not run: SyntaxError"),
    ],
)
def test_faults_of_an_own_actuator(tmp_path: Path, content: str | None, said: str) -> None:
    if content:
        (tmp_path / "mine.py").write_text(content)
    message = complaint(tmp_path, log=JOINT, head='actuator = "mine.py"\n')
    assert "mine.py'" in message
    assert said in message
