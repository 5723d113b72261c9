"""servo-models list"""

from __future__ import annotations


def list_() -> None:
    """List actuators with their variants, and effects."""
    from servo_models.analysis.explain import overview
    from servo_models.cli.console import show

    show(overview())
