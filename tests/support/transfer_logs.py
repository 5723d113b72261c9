"""Records of arrays for fits of transfer functions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from servo_models import model
from servo_models.actuators.torque_motor.variants import EQ_12, EQ_12_DELAY
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.identification.transfer.functions import TransferFunction
from tests.support.logs import log_of

MOTOR = model("torque_motor", "identified", {"end_stops.half_range": 0.0})
EQUATION_12 = TransferFunction.of([EQ_12[0]], [1.0, *EQ_12[1:]], EQ_12_DELAY)
DT = 1e-4


def log(
    name: str,
    times: Array,
    u: Array,
    y: Array,
    held_out: NDArray[np.bool_] | bool = False,
    signals: tuple[str, str] = ("voltage", "angle"),
) -> Log:
    mask = np.broadcast_to(np.asarray(held_out), times.shape)
    more = {"name": name, "path": Path(f"{name}.csv"), "held_out": mask}
    return log_of(times, {signals[0]: u}, {signals[1]: y}, **more)
