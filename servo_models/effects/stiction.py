"""Stiction of a valve: it sticks, then slips by a jump.

Two parameters as in the literature: the band S, which the input crosses at a reversal before the
valve moves (dead band and stick band together), and the slip jump J.
"""

from typing import Annotated

from servo_models.core.block import Ambiguity, Hints, Memory, Mode, Param, effect

TRIALS_OVER_TYPICAL = tuple(0.1 * 1.3**k for k in range(18))
"""Trial values over the typical one: close enough to tell which steps of a log make it slip."""


@effect(
    "signal",
    source="He, Wang, Pottmann, Qin, Ind. Eng. Chem. Res. 46 (2007) 4549; S and J: Choudhury,"
    " Thornhill, Shah, Control Engineering Practice 13 (2005) 641",
    hints=Hints(
        says="it sticks over a band of {band}",
        trial_values=TRIALS_OVER_TYPICAL,
        jump="jump",
        ambiguity=Ambiguity(
            "a slow triangle, then the same with a tenth of the amplitude about two positions: play"
            " follows without a jump, a dead band forgets the direction, a loop of hysteresis"
            " shrinks with the amplitude, friction of the shaft changes with load or supply",
            ("stiction",),
            ("backlash", "dead_band", "hysteresis", "coulomb_friction", "stribeck_friction"),
        ),
    ),
)
def stiction(
    signal: float,
    band: Annotated[
        float,
        Param(
            "signal", "dead band and stick band together, S", high=0.4, switch=True, typical=0.02
        ),
    ],
    jump: Annotated[float, Param("1", "slip jump over the band, J / S", default=0.5)],
    held: Annotated[float, Memory("rest")],
    turned: Annotated[float, Mode()],
) -> tuple[float, float, float]:
    """The valve stays at ``held`` until the input is more than (S + J) / 2 away, then slips up to
    (S - J) / 2 before it.

    He's two forces are distances: his accumulated force is the input minus the position, in the
    sample of a slip as in any other.  So no sum over samples is left, and a look at the same input
    again changes nothing: the response to an input held between instants depends on its values
    alone.  Where the input moves in between, each slip turns a mode, so that it is located.  The
    edges are written with the sums that are remembered, which makes play of J = 0 exact.
    """
    if band <= 0.0:
        return signal, held, turned
    static, kinetic = 0.5 * (1.0 + jump) * band, 0.5 * (1.0 - jump) * band
    if signal - static > held:
        return signal - kinetic, signal - kinetic, 1.0 - turned
    if signal + static < held:
        return signal + kinetic, signal + kinetic, 1.0 - turned
    return held, held, turned
