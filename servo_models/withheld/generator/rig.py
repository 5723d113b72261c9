"""The constants of a rig and the sizes of what acts on it, as the simulation takes them."""

from __future__ import annotations

from typing import NamedTuple


class Rig(NamedTuple):
    """Constants of a rig and sizes of what acts on it; what is 0 is absent."""

    servo: float = 0.0  # 1 a closed-loop servo, 0 a torque motor
    inertia: float = 1.0
    natural_frequency: float = 1.0
    damping_ratio: float = 1.0
    top_speed: float = 0.0  # servo: speed of full drive
    rest: float = 0.0  # servo: feedback angle at which the output is 0
    drive_per_load: float = 0.0
    corner: float = 0.0  # motor: resistance over inductance
    resistance: float = 1.0
    flux_per_angle: float = 0.0  # motor: as a current
    torque_per_current: float = 0.0
    travel: float = 0.0
    stop_frequency: float = 1.0  # of the shaft on its stop
    contact_rate: float = 1.0  # stiffness of the play's contact over the drag of the output
    bristle_stiffness: float = 1.0  # N m/rad

    extra_inertia: float = 0.0
    load: float = 0.0
    constant_load: float = 0.0
    gravity: float = 0.0
    gravity_phase: float = 0.0
    cogging: float = 0.0
    cogging_count: float = 0.0
    cogging_phase: float = 0.0
    drag: float = 0.0
    coulomb: float = 0.0
    load_friction: float = 0.0
    stiction: float = 0.0
    stribeck_speed: float = 1.0
    load_inertia: float = 0.0
    load_frequency: float = 0.0
    load_damping: float = 0.0
    play: float = 0.0
    lag: float = 0.0
    bow: float = 0.0
    cubic: float = 0.0
    full_scale: float = 1.0
    feedback_offset: float = 0.0
    feedback_step: float = 0.0
    asymmetry: float = 0.0
    hysteresis: float = 0.0
    turn: float = 1.0
    dead_zone: float = 0.0
    ceiling: float = 0.0
    sag: float = 0.0  # resistance of the source; of the servo over its armature's
    heating: float = 0.0
    heating_time: float = 1.0
    knee: float = 0.0  # inverse current of flux saturation
    curvature: float = 0.0
    inverse_torque: float = 0.0
    null: float = 0.0
    hardening: float = 0.0

    quadratic_drag: float = 0.0
    forward_drag: float = 0.0
    bouc_torque: float = 0.0
    bouc_travel: float = 1.0
    mode_share: float = 0.0
    mode_frequency: float = 0.0
    mode_damping: float = 0.0
    kink_slope: float = 0.0
    kink_angle: float = 0.0
