"""Transport delay of a held signal, exact to the instant."""

import math
from typing import Annotated

from servo_models.core.block import (
    Ambiguity,
    Clock,
    DeadTime,
    Fault,
    Hints,
    Memory,
    Param,
    Queue,
    effect,
)

EDGES = 512  # changes of the input that a delay holds at most


@effect(
    "signal",
    source="valve paper eq. 12 (1.1 ms); Astrom, Hagglund, Advanced PID Control, 2006",
    hints=Hints(
        says="the {wire} acts {time} late",
        family="delay",
        small_signal=DeadTime("time", input="newest", output="current"),
        ambiguity=Ambiguity(
            "a chirp up to 1 / (4 x the delay) or beyond: a delay turns the phase in a line, a"
            " lag rolls off, a hold jitters on the clock of the command",
            ("transport_delay", "lag", "sample_hold"),
        ),
    ),
)
def transport_delay(
    signal: float,
    now: float,
    due: float,
    time: Annotated[
        float,
        Param("{time}", "delay", high=2.0, switch=True, typical=0.005, display="ms", fixed=True),
    ],
    edges: Annotated[list[float], Queue(2 * EDGES)],
    newest: Annotated[float, Memory("rest")],
    current: Annotated[float, Memory("rest")],
    written: Annotated[float, Memory()],
    read: Annotated[float, Memory()],
    next_edge: Annotated[float, Clock()],
    full: Annotated[
        float,
        Fault(
            message="the delay line is full: more than 512 input changes within the delay;"
            " use a longer communication step or a shorter delay"
        ),
    ],
) -> tuple[float, float, float, float, float, float, float]:
    """y(t) = u(t - time).

    Every change of the signal is kept with its time, and the step is cut where it comes
    out, so the delay need not be a multiple of any step.
    """
    if time <= 0.0:
        return signal, newest, current, written, read, next_edge, full
    if signal != newest:
        slot = 2 * (int(written) % EDGES)
        edges[slot] = now + time
        edges[slot + 1] = signal
        newest = signal
        written = written + 1.0
    waiting = written - read
    if waiting > EDGES:  # or a restored state is none that a run has saved
        full = 1.0
        waiting = 0.0
    while waiting > 0.0 and edges[2 * (int(read) % EDGES)] <= due:
        current = edges[2 * (int(read) % EDGES) + 1]
        read = read + 1.0
        waiting = waiting - 1.0
    next_edge = edges[2 * (int(read) % EDGES)] if waiting > 0.0 else math.inf
    return current, newest, current, written, read, next_edge, full
