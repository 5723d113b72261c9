"""Cases of the SG90."""

from __future__ import annotations

import math

from servo_models.validation.cases import EVENTS, EXACT, TRANSFER, Case, grid, schedule
from servo_models.validation.sg90 import reference as sg90


def cases() -> list[Case]:
    """Return the steps of every set, then the others."""
    return [*_real(), *_steps(), *_others()]


def _real() -> list[Case]:
    fine, odd = grid(1.0, 1e-3), grid(1.9995, 3.1e-3)
    pulses = schedule(odd, (0, 1.5e-3), (0.1, 2.2e-3), (0.5, 1.6e-3), (0.9, 0.8e-3), (1.4, 1.5e-3))
    loads = schedule(odd, (0, 0.0), (0.6, 0.03), (1.6, -0.02))
    weak = schedule(odd, (0, 5.0), (1.2, 4.0))
    work = {"pulse_width": pulses, "load_torque": loads, "supply_voltage": weak}
    real, name = sg90.RealServo(), "measured"
    return [
        Case(
            "sg90",
            name,
            "step to 2 ms, every 1 ms",
            fine,
            {"pulse_width": 2e-3},
            real,
            EVENTS,
            False,
            is_step=True,
        ),
        Case(
            "sg90",
            name,
            "pulses, load and weak supply, every 3.1 ms",
            odd,
            work,
            real,
            EVENTS,
            False,
            cost=("angle", "rate", "motor_voltage"),
        ),
        Case(
            "sg90",
            "airframe",
            "too far, overloaded and without pulses, every 3.1 ms",
            odd,
            {
                "pulse_width": schedule(odd, (0, 1.5e-3), (0.1, 5e-3), (0.6, 0.8e-3), (1.3, 0.0)),
                "load_torque": schedule(odd, (0, 0.0), (0.8, 0.25), (1.2, 0.003), (1.5, -0.01)),
                "supply_voltage": 5.0,
            },
            sg90.Airframe(),
            EVENTS,
            False,
        ),
    ]


def _steps() -> list[Case]:
    times = grid(20.0, 0.02)
    cases = []
    for k_ap, amplifier in ((sg90.LOADED, ""), (sg90.UNLOADED, "_unloaded")):
        for k_f, feedback in ((0.1, ""), (0.18, "_kf018"), (0.05, "_kf005")):
            cases += [
                Case(
                    "sg90",
                    kind + amplifier + feedback,
                    "step to 2 ms, every 20 ms",
                    times,
                    {"pulse_width": 2e-3},
                    reference,
                    method,
                    linear=kind == "linear",
                    is_step=True,
                )
                for kind, reference, method in (
                    ("linear", sg90.Linear(k_f, k_ap), EXACT),
                    ("printed", sg90.Printed(k_f, k_ap), EVENTS),
                )
            ]
    return cases


def _others() -> list[Case]:
    times = grid(20.0, 0.02)
    odd = grid(19.9947, 0.0073)
    step = {"pulse_width": 2e-3}
    pulses = schedule(odd, (0, 1.5e-3), (1, 2.4e-3), (5, 0.7e-3), (9, 2.3e-3), (14, 1.2e-3))
    work = {"pulse_width": pulses, "load_torque": schedule(odd, (0, 0.0), (6, 0.05), (11, 0.0))}
    weak = {**work, "supply_voltage": schedule(odd, (0, 5.0), (10, 1.2), (15, 5.0))}
    swings = "pulses and load, every 7.3 ms"
    strict = {"angle_unit": 1.0}
    play = {"backlash.half_width": math.radians(2.0)}
    return [
        Case("sg90", "linear", "eq. 7", times, step, sg90.equation_7_response, TRANSFER, True),
        Case("sg90", "linear", swings, odd, work, sg90.Linear(), EXACT, True),
        Case(
            "sg90",
            "linear",
            "angle unit read strictly",
            times[:501],
            step,
            sg90.Linear(degrees=180.0 / math.pi),
            EXACT,
            True,
            parameters=strict,
        ),
        Case(
            "sg90",
            "oscillatory_motor",
            "step to 2 ms, every 20 ms",
            times[:501],
            step,
            sg90.Linear(rejected=True),
            EXACT,
            True,
        ),
        Case(
            "sg90",
            "printed",
            "pulses, load and weak supply, every 7.3 ms",
            odd,
            weak,
            sg90.Printed(),
            EVENTS,
            False,
            cost=("angle", "rate", "motor_voltage"),
        ),
        Case(
            "sg90",
            "printed_kf005",
            "into both stops, every 7.3 ms",
            odd,
            {"pulse_width": pulses},
            sg90.Printed(0.05),
            EVENTS,
            False,
        ),
        Case(
            "sg90",
            "linear",
            "backlash of +/- 2 deg in the loop, every 7.3 ms",
            odd,
            work,
            sg90.ServoBacklash(2.0),
            EVENTS,
            False,
            parameters=play,
        ),
    ]
