"""Nonlinear stiffness: the spring stiffens or softens."""

from typing import Annotated

from servo_models.core.block import Hints, Param, effect


@effect(
    "signal",
    source="valve paper eq. 2, general T_s(theta)",
    hints=Hints(says="the spring stiffens by {coefficient}"),
)
def stiffness_hardening(
    signal: float,
    spring_angle: float,
    coefficient: Annotated[
        float,
        Param(
            "1/{spring_angle}2",
            "relative stiffening with the angle squared",
            low=-0.5,
            high=3.0,
            switch=True,
            typical=0.3,
        ),
    ],
) -> float:
    """T_s = K_s theta (1 + coefficient theta^2)."""
    return signal + signal * coefficient * spring_angle * spring_angle
