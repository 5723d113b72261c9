"""A log of one of the servos on the bench: 6 s of steps and ramps at 200 Hz.

The servo is a bit faster than the model `measured` and its gears have a play of +-0.6 degrees; the
log has noise of 0.03 degrees.  Written without this package, so that there is a truth to find.

Run: ``python make_log.py``
"""

import numpy as np

PLAY, MOTOR_GAIN, DELAY = np.radians(0.6), 53.0, 0.0289
TIME_CONSTANT, GEARS, AMPLIFIER, SUPPLY = 0.0347, 24.0, 77.7, 5.0
VOLTS = 0.25e-3 * 1856.0 / np.pi  # 5 V in 20 ms, 1856 us in half a turn
CORNERS = [0, 0.2, 0.2, 0.8, 0.8, 1.4, 1.4, 2, 2, 2.6, 2.6, 3.2, 4.2, 5.2, 6]  # s
ANGLES = [0, 0, 20, 20, -10, -10, 5, 5, 2, 2, -20, -20, 0, -4, 4]  # deg

STEP, ROW = 1e-4, 5e-3
times = STEP * np.arange(60_000)
held = ROW * np.floor((times - DELAY) / ROW + 1e-6)  # each command of the log lasts for a row
command = np.radians(np.interp(held, CORNERS, ANGLES))
motor = speed = horn = 0.0
horns = np.empty(len(times))
for i, wanted in enumerate(command):
    horn = min(max(horn, motor - PLAY), motor + PLAY)
    voltage = np.clip(AMPLIFIER * VOLTS * (wanted - horn), -SUPPLY, SUPPLY)
    speed += STEP * (MOTOR_GAIN * voltage / GEARS - speed) / TIME_CONSTANT
    motor += STEP * speed
    horns[i] = horn
rows = slice(0, None, round(ROW / STEP))
pulse = 1500.0 + 1856.0 / 180.0 * np.interp(times[rows], CORNERS, ANGLES)
noise = 0.03 * np.random.default_rng(1).standard_normal(len(pulse))
table = np.column_stack([1e3 * times[rows], pulse, np.degrees(horns[rows]) + noise])
np.savetxt("bench.csv", table, "%.3f", ",", header="time_ms,pulse_us,angle_deg", comments="")
