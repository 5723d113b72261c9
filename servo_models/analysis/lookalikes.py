"""Causes that look alike in a log, and the experiment that separates each pair.

A cause is an effect by its name, or a kind of parameter of the plant: see ``cause``.
"""

from __future__ import annotations

from servo_models.core.plant import Parameter, Plant

INERTIA, GAIN, LAG, FRICTION = "inertia", "gain", "lag", "viscous_friction"

Causes = frozenset[str]


def _causes(text: str) -> Causes:
    return frozenset(text.split())


EXPERIMENTS: tuple[tuple[Causes, Causes, str], ...] = (
    (
        _causes("dead_zone dead_band coulomb_friction load_friction"),
        _causes("dead_zone dead_band coulomb_friction load_friction gain gain_error"),
        "steps in many sizes from the least that moves it, then a slow triangle of twice that size"
        " at two supplies or loads; log drive or current: not 0 while it sticks means friction",
    ),
    (
        _causes("dead_zone dead_band coulomb_friction stribeck_friction hysteresis"),
        _causes("backlash"),
        "log a motor-side signal or the current; a one-sided load removes backlash",
    ),
    (
        _causes("coulomb_friction stribeck_friction load_friction"),
        _causes("coulomb_friction stribeck_friction load_friction"),
        "very slow ramps, as slow as it still moves, both ways, without and with a load",
    ),
    (
        _causes("transport_delay lag sample_hold"),
        _causes("transport_delay lag sample_hold"),
        "a chirp up to 1 / (4 x the delay) or beyond: a delay turns the phase in a line, a lag"
        " rolls off, a hold jitters on the clock of the command",
    ),
    (
        _causes("saturation rate_limit supply_sag supply_limit torque_saturation"),
        _causes("saturation rate_limit supply_sag supply_limit torque_saturation"),
        "a ladder of steps up to the largest that the rig allows, back to back and spaced; log the"
        " supply voltage",
    ),
    (
        _causes("inertia load_inertia"),
        _causes("gain gain_error"),
        "add a known inertia, or switch the torque off and let it run out",
    ),
    (
        _causes("offset null_shift"),
        _causes("constant_load gravity_load direction_asymmetry"),
        "the same moves with the pose turned upside down",
    ),
    (
        _causes("gear_compliance"),
        _causes("lag transport_delay"),
        "a chirp through the resonance, sampled 20 times faster than it",
    ),
    (
        _causes("thermal_drift"),
        _causes("supply_sag gain gain_error"),
        "ten minutes of the same step",
    ),
)
"""Causes of one side, causes of the other, and the experiment that separates them."""

INERTIAS = ("kg", "kg.m2")
TIMES = ("s",)
DAMPING = ("N.m.s/rad", "N.s/m")


def cause(name: str, plant: Plant) -> str:
    """Return the effect or the kind of parameter that a name stands for.

    Args:
        name: an effect's place, or a parameter.
        plant: to which they belong.
    """
    parameters: dict[str, Parameter] = plant.parameters
    owner = parameters[name].owner if name in parameters else name
    if owner:
        module = plant.placements[owner][0].effect.function.__module__
        return module.rsplit(".", 1)[-1]
    unit = parameters[name].param.unit
    if unit in INERTIAS:
        return INERTIA
    if unit in DAMPING:
        return FRICTION
    return LAG if unit in TIMES else GAIN


def experiment(one: str, other: str) -> str:
    """Return what separates two causes, "" where nothing is on record.

    Two places of one effect, and two gains, have nothing on record either.
    """
    for these, those, text in EXPERIMENTS:
        if one != other and (
            (one in these and other in those) or (other in these and one in those)
        ):
            return text
    return ""
