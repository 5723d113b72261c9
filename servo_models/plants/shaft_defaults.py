"""What a shaft is before any effect acts on it; shared by the actuators."""

from __future__ import annotations

from servo_models.block import block


@block("friction", "travel")
def free_shaft() -> tuple[float, float]:
    """No dry friction and no stops, unless an effect says so."""
    return 0.0, 0.0


@block("load_rate", "load_acceleration")
def no_second_mass() -> tuple[float, float]:
    """Nothing moves behind the shaft, unless an effect says so."""
    return 0.0, 0.0


@block("load")
def external_load(load_torque: float) -> float:
    """Load torque [N m] against positive motion."""
    return load_torque


@block("angle", "rate")
def shaft_output(shaft_angle: float, shaft_rate: float) -> tuple[float, float]:
    """The output is the shaft."""
    return shaft_angle, shaft_rate
