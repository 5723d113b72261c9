"""A servo identified element by element, and the synthesis of its loop (SG90 paper)."""

from __future__ import annotations

from servo_models.identification.elements.identify import (
    ElementFigure,
    ElementsResult,
    identify_elements,
)
from servo_models.identification.elements.loop import Choice, Loop, Response, Synthesis

__all__ = [
    "Choice",
    "ElementFigure",
    "ElementsResult",
    "Loop",
    "Response",
    "Synthesis",
    "identify_elements",
]
