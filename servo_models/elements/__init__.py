"""A servo identified element by element, and the synthesis of its loop (SG90 paper)."""

from __future__ import annotations

from servo_models.elements.identify import identify_elements
from servo_models.elements.loop import Choice, Loop, Response
from servo_models.elements.result import ElementsResult, Figure, Synthesis
from servo_models.elements.sheet import sheet

__all__ = [
    "Choice",
    "ElementsResult",
    "Figure",
    "Loop",
    "Response",
    "Synthesis",
    "identify_elements",
    "sheet",
]
