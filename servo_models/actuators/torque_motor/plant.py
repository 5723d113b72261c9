"""Limited-angle torque motor of a pneumatic servo valve (Toorani, Farahmandzad, Aghamirsalim).

Source of all values: F. Toorani, H. Farahmandzad, M. Aghamirsalim, "Gray-Box Modeling of a
Pneumatic Servo-Valve" (the *valve paper*), Tables 1 and 2 and eq. 12.
"""

from __future__ import annotations

import math
from dataclasses import replace

from servo_models.actuators.shaft import (
    external_load,
    free_shaft,
    no_second_mass,
    shaft_acceleration,
    shaft_contact,
    shaft_output,
)
from servo_models.actuators.torque_motor import physics as motor
from servo_models.core.block import Param
from servo_models.core.plant import Plant, State, Wire, place
from servo_models.effects.backlash import backlash
from servo_models.effects.cogging import cogging
from servo_models.effects.constant_load import constant_load
from servo_models.effects.coulomb_friction import coulomb_friction
from servo_models.effects.dead_band import dead_band
from servo_models.effects.dead_zone import dead_zone
from servo_models.effects.direction_asymmetry import direction_asymmetry
from servo_models.effects.end_stops import end_stops
from servo_models.effects.flux_saturation import flux_saturation
from servo_models.effects.gain_error import gain_error
from servo_models.effects.gear_compliance import (
    compliant_load,
    compliant_output,
    resonance_step,
)
from servo_models.effects.gravity_load import gravity_load
from servo_models.effects.hysteresis import hysteresis
from servo_models.effects.lag import lag
from servo_models.effects.load_friction import load_friction
from servo_models.effects.load_inertia import load_inertia
from servo_models.effects.nonlinearity import nonlinearity
from servo_models.effects.null_shift import null_shift
from servo_models.effects.offset import offset
from servo_models.effects.quantisation import quantisation
from servo_models.effects.rate_limit import rate_limit
from servo_models.effects.sample_hold import sample_hold
from servo_models.effects.saturation import saturation
from servo_models.effects.stiffness_hardening import stiffness_hardening
from servo_models.effects.stribeck_friction import stribeck_friction
from servo_models.effects.supply_sag import supply_sag
from servo_models.effects.thermal_drift import thermal_drift
from servo_models.effects.torque_saturation import torque_saturation
from servo_models.effects.transport_delay import transport_delay
from servo_models.effects.viscous_friction import viscous_friction

STOP = math.radians(3.0)

_delay = replace(transport_delay.params["time"], high=0.02, typical=0.0011)
_frame = replace(sample_hold.params["period"], high=0.02, typical=0.001)
_twist = replace(compliant_output.params["compliance"], high=5.0, typical=1.0)
_mass = replace(compliant_load.params["inertia"], default=1e-6, low=1e-8, high=1e-4)
_source = replace(supply_sag.params["resistance"], typical=100.0)

PLANT = Plant(
    inputs=(
        Wire("voltage", "V", "coil voltage", scale=50.0, low=-200.0, high=200.0),
        Wire(
            "load_torque",
            "N.m",
            "flow force against positive motion",
            scale=0.06,
            low=-10.0,
            high=10.0,
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
    ),
    constants={
        "internal_step": Param(
            "s",
            "longest internal step",
            default=1e-4,
            low=1e-6,
            high=5e-4,
            display="us",
            fixed=True,
        )
    },
    chain=(
        motor.rotor,
        free_shaft,
        no_second_mass,
        motor.conventions,
        place("load_inertia", load_inertia, "shaft_inertia"),
        place(
            "gear_compliance",
            resonance_step,
            "internal_step",
            params={"compliance": _twist, "inertia": _mass},
        ),
        place("end_stops", end_stops, "travel"),
        place("transport_delay", transport_delay, "voltage", params={"time": _delay}),
        place("sample_hold", sample_hold, "voltage", params={"period": _frame}),
        place("dead_band", dead_band, "voltage"),
        place("command_quantisation", quantisation, "voltage"),
        place("gain_error", gain_error, "voltage"),
        place("voltage_offset", offset, "voltage"),
        place("direction_asymmetry", direction_asymmetry, "voltage"),
        place("drive_dead_zone", dead_zone, "voltage"),
        place("drive_saturation", saturation, "voltage"),
        place("rate_limit", rate_limit, "voltage"),
        place("thermal_drift", thermal_drift, "voltage"),
        motor.supply_load,
        place("supply_sag", supply_sag, "voltage", params={"resistance": _source}),
        motor.shaft_motion,
        shaft_output,
        place("gear_compliance", compliant_output, "angle", "rate", "load_rate"),
        external_load,
        place("constant_load", constant_load, "load"),
        place("gravity_load", gravity_load, "load"),
        place("gear_compliance", compliant_load, "load", "load_acceleration"),
        place("load_friction", load_friction, "friction"),
        place("viscous_friction", viscous_friction, "load"),
        place("cogging", cogging, "load"),
        place("coulomb_friction", coulomb_friction, "friction"),
        place("stribeck_friction", stribeck_friction, "friction"),
        motor.flux_linkage,
        place("flux_saturation", flux_saturation, "flux_slope", "flux_turning"),
        motor.current_rate,
        motor.magnetising_current,
        place("hysteresis", hysteresis, "effective_current"),
        motor.motor_torque,
        place("torque_saturation", torque_saturation, "motor_torque"),
        motor.spring_position,
        place("null_shift", null_shift, "spring_angle"),
        motor.spring_torque,
        place("stiffness_hardening", stiffness_hardening, "spring_torque"),
        motor.torque,
        shaft_acceleration,
        motor.stop_flag,
        place("backlash", backlash, "angle", "rate"),
        place("sensor_lag", lag, "angle"),
        place("sensor_nonlinearity", nonlinearity, "angle"),
        place("sensor_offset", offset, "angle"),
        place("sensor_quantisation", quantisation, "angle"),
    ),
    states=(
        State(Wire("current", "A", "coil current", scale=0.011, display="mA"), "current_rate"),
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
)
