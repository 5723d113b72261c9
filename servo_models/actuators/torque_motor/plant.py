"""Limited-angle torque motor of a pneumatic servo valve (Toorani, Farahmandzad, Aghamirsalim).

Source of all values: F. Toorani, H. Farahmandzad, M. Aghamirsalim, "Gray-Box Modeling of a
Pneumatic Servo-Valve" (the *valve paper*), Tables 1 and 2 and eq. 12.
"""

from __future__ import annotations

import math

from servo_models.actuators.shaft import (
    external_load,
    free_shaft,
    no_second_mass,
    shaft_acceleration,
    shaft_contact,
    shaft_output,
)
from servo_models.actuators.torque_motor import physics as motor
from servo_models.actuators.wiring import (
    AMMETER,
    BENCH_DRIVE,
    CALIBRATED,
    LEARNT,
    LOADS,
    input_scale,
    residual_curves,
    without,
)
from servo_models.core.plant import Plant, State, Wire, internal_step, place
from servo_models.effects import effects_on
from servo_models.effects.gear_compliance import compliant_load, compliant_output, resonance_step
from servo_models.effects.residual_map import residual_drive, residual_reading, residual_torque

STOP = math.radians(3.0)
SECOND_MASS = {
    "compliance": {"unit": "rad/(N.m)", "high": 5.0, "typical": 1.0},
    "inertia": {"unit": "kg.m2", "default": 1e-6, "low": 1e-8, "high": 1e-4},
}

PLANT = Plant(
    inputs=(
        Wire("voltage", "V", "coil voltage", scale=50.0, low=-200.0, high=200.0),
        Wire(
            "load_torque",
            "N.m",
            "flow force against positive motion",
            0.06,
            low=-10.0,
            high=10.0,
            bench=LOADS,
        ),
    ),
    wires=(
        Wire("angle", "rad", "angle as read by the sensor", scale=STOP, display="deg"),
        Wire("rate", "rad/s", "angular rate of the output", scale=100.0, display="deg/s"),
        Wire("motor_torque", "N.m", "torque of the coil current", scale=0.06),
        Wire("at_stop", "1", "the rotor rests on a stop", flag=True),
        Wire("friction", "N.m", "dry friction level", scale=0.06),
        Wire("load", "N.m", "load torque with all its parts", scale=0.06),
        Wire("load_rate", "rad/s", "rate behind the compliance", scale=100.0),
        Wire("load_acceleration", "rad/s2", "acceleration behind the compliance", scale=1e5),
        Wire("shaft_inertia", "kg.m2", "accelerated inertia", scale=1e-6),
        Wire("flux_slope", "H", "slope of the flux linkage over current", scale=34.0),
        Wire("flux_turning", "V.s/rad", "slope of the flux linkage over angle", scale=0.08),
        Wire("spring_torque", "N.m", "stiffness torque", scale=0.06),
        Wire("spring_angle", "rad", "angle from the magnetic null", scale=STOP, display="deg"),
        Wire("effective_current", "A", "current that makes the torque", scale=0.011),
        Wire("travel", "rad", "half range of the shaft", scale=STOP, display="deg"),
        *LEARNT,
    ),
    constants=internal_step(1e-4, low=1e-6, high=5e-4),
    chain=(
        motor.rotor,
        free_shaft,
        no_second_mass,
        motor.conventions,
        *effects_on("shaft_inertia", "load_inertia"),
        place("gear_compliance", resonance_step, "internal_step", params=SECOND_MASS),
        *effects_on("travel", "end_stops"),
        input_scale("load_gain", "load_torque"),
        *effects_on(
            "voltage",
            "transport_delay",
            "sample_hold",
            time={"high": 0.02, "typical": 0.0011},
            period={"high": 0.02, "typical": 0.001},
        ),
        *without(
            BENCH_DRIVE,
            *effects_on(
                "voltage",
                "dead_band",
                "command_quantisation",
                "gain_error",
                "voltage_offset",
                "direction_asymmetry",
                "drive_dead_zone",
                "drive_saturation",
                "rate_limit",
            ),
        ),
        *effects_on("voltage", "thermal_drift", "stiction"),
        *residual_curves("voltage"),
        place("residual_map", residual_drive, "voltage"),
        motor.supply_load,
        *effects_on(
            "voltage", "supply_sag", resistance={"unit": "Ohm", "high": 1e3, "typical": 100.0}
        ),
        motor.shaft_motion,
        shaft_output,
        place("gear_compliance", compliant_output, "angle", "rate", "load_rate"),
        external_load,
        *effects_on("load", "constant_load", "gravity_load"),
        place("gear_compliance", compliant_load, "load", "load_acceleration"),
        *effects_on("friction", "load_friction"),
        *effects_on("load", "viscous_friction", "presliding_friction", "cogging"),
        place("residual_map", residual_torque, "load"),
        *effects_on("friction", "coulomb_friction", "stribeck_friction"),
        motor.flux_linkage,
        *effects_on(
            ("flux_slope", "flux_turning"),
            "flux_saturation",
            inverse_current={"unit": "1/A", "high": 500.0, "typical": 50.0},
            curvature={"unit": "1/rad2", "low": -100.0, "high": 100.0, "typical": 30.0},
        ),
        motor.current_rate,
        motor.magnetising_current,
        *effects_on("effective_current", "hysteresis"),
        motor.motor_torque,
        *effects_on("motor_torque", "torque_saturation"),
        motor.spring_position,
        *effects_on("spring_angle", "null_shift"),
        motor.spring_torque,
        *effects_on(
            "spring_torque",
            "stiffness_hardening",
            coefficient={"unit": "1/rad2", "low": -200.0, "high": 1000.0, "typical": 100.0},
        ),
        motor.torque,
        shaft_acceleration,
        motor.stop_flag,
        *effects_on(("angle", "rate"), "backlash"),
        *effects_on("angle", "sensor_lag"),
        *without(CALIBRATED, *effects_on("angle", "sensor_nonlinearity", "sensor_offset")),
        *effects_on("angle", "sensor_quantisation"),
        place("residual_map", residual_reading, "angle"),
    ),
    states=(
        State(
            Wire("current", "A", "coil current", scale=0.011, display="mA", bench=AMMETER),
            "current_rate",
        ),
        State(
            Wire("shaft_angle", "rad", "angle of the rotor", scale=STOP, display="deg"),
            "shaft_speed",
        ),
        State(Wire("shaft_speed", "rad/s", "speed of the rotor", scale=100.0), "acceleration"),
        State(
            Wire("load_angle", "rad", "angle behind the compliance", scale=STOP, display="deg"),
            "load_rate",
            owner="gear_compliance",
        ),
        State(
            Wire("load_speed", "rad/s", "speed behind the compliance", scale=100.0),
            "load_acceleration",
            owner="gear_compliance",
        ),
    ),
    projection=shaft_contact,
    outputs=("angle", "rate", "current", "motor_torque", "at_stop"),
    terminals={"shaft": ("load_torque", "angle", "rate")},
)
