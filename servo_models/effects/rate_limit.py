"""Rate limit of a signal."""

from typing import Annotated

from servo_models.core.block import Hints, Memory, Param, effect

TRIALS_OVER_TYPICAL = tuple(0.03 * 1.35**k for k in range(28))
"""Trial values over the typical one: so close that the fit with a part of one value is no better
than the fit with the next."""


@effect(
    "signal",
    source="Klyde, McRuer, Myers, Pilot-induced oscillation analysis, 1996",
    hints=Hints(
        says="the {wire} changes by {rate} at most",
        family="limit",
        trial_values=TRIALS_OVER_TYPICAL,
        inverse=True,
    ),
)
def rate_limit(
    signal: float,
    elapsed: float,
    rate: Annotated[
        float,
        Param("signal/{time}", "largest rate, 0 for none", high=1e4, switch=True, typical=20.0),
    ],
    last: Annotated[float, Memory("rest")],
) -> tuple[float, float]:
    """y follows u at no more than ``rate``."""
    if rate <= 0.0:
        return signal, last
    reach = rate * elapsed
    if signal > last + reach:
        return last + reach, last + reach
    if signal < last - reach:
        return last - reach, last - reach
    return signal, signal
