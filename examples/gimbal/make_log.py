"""A log of a gimbal that is not quite the declared one: 4 s of steps at 100 Hz.

Run: ``python make_log.py``
"""

import numpy as np

SPEED_CONSTANT, TIME_CONSTANT, GAIN, DEAD_ZONE, LIMIT = 0.9, 0.04, 20.0, 0.6, 12.0
STEPS = [0, 15, 5, 25, 20, 0, -3, 3, -30, 0]  # deg, each for 0.4 s

speed = angle = 0.0
rows = []
for i in range(40_000):  # Euler steps of 0.1 ms
    command = np.radians(STEPS[i // 4000])
    if i % 100 == 0:
        rows.append((0.1 * i, np.degrees(command), np.degrees(angle)))
    voltage = GAIN * (command - angle)
    voltage = np.sign(voltage) * max(abs(voltage) - DEAD_ZONE, 0.0)
    voltage = np.clip(voltage, -LIMIT, LIMIT)
    speed += 1e-4 * (SPEED_CONSTANT * voltage - speed) / TIME_CONSTANT
    angle += 1e-4 * speed
table = np.array(rows)
table[:, 2] += 0.05 * np.random.default_rng(1).standard_normal(len(table))
np.savetxt("log.csv", table, "%.3f", ",", header="time_ms,command_deg,angle_deg", comments="")
