"""A servo identified element by element, and the synthesis of its loop (SG90 paper)."""

from __future__ import annotations

from servo_models.identification.elements.identify import ElementsResult, identify_elements
from servo_models.identification.elements.loop import Loop

__all__ = ["ElementsResult", "Loop", "identify_elements"]
