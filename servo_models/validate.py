"""Validate actuators: two claims and the figures of the papers, as rows.

*Implementation*: the FMU equals the simulation in this process.  *Model*: the responses of
the FMU equal independent references.  *Paper*: the model gives the printed figures, and
what cannot be reproduced is named.
"""

from __future__ import annotations

from servo_models.validation.rows import (
    CLAIMS,
    IMPLEMENTATION,
    MODEL,
    PAPER,
    CostCurve,
    CostPoint,
    Row,
    Validation,
)

__all__ = [
    "CLAIMS",
    "IMPLEMENTATION",
    "MODEL",
    "PAPER",
    "CostCurve",
    "CostPoint",
    "Row",
    "Validation",
]
