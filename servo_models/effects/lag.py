"""First-order lag of a signal."""

import math
from typing import Annotated

from servo_models.core.block import FirstOrderLag, Hints, Memory, Param, effect


@effect(
    "signal",
    source="Franklin, Powell, Workman, Digital Control, 1998, ch. 6 (ramp invariant)",
    hints=Hints(
        says="the {wire} lags with a time constant of {time_constant}",
        family="delay",
        small_signal=FirstOrderLag("time_constant", input="last", output="value"),
        parameter_units=("s",),
    ),
)
def lag(
    signal: float,
    elapsed: float,
    time_constant: Annotated[
        float, Param("{time}", "time constant", high=1.0, switch=True, typical=0.01, display="ms")
    ],
    value: Annotated[float, Memory("rest")],
    last: Annotated[float, Memory("rest")],
) -> tuple[float, float, float]:
    """time_constant y' + y = u, exact for a signal that runs straight between commits."""
    if time_constant <= 0.0:
        return signal, value, last
    if elapsed <= 0.0:
        return value, value, signal
    behind = time_constant * (signal - last) / elapsed
    decay = math.exp(-elapsed / time_constant)
    reached = signal - behind + (value - last + behind) * decay
    return reached, reached, signal
