"""What a command costs from the shell: wall clock, processor and peak memory of its process.

The yardstick of each run is the bare interpreter.  A first ``simulate`` fills the cache of
compiled texts; the ones measured find it warm.

Run: ``python benchmarks/bench_cli.py`` (about half a minute, POSIX).
"""

from __future__ import annotations

import os
import statistics
import sys
import time

ROUNDS = 5
COMMANDS = {
    "bare python": ["-c", "pass"],
    "--help": ["-m", "servo_models", "--help"],
    "list": ["-m", "servo_models", "list"],
    "explain backlash": ["-m", "servo_models", "explain", "backlash"],
    "simulate sg90, 10 s": ["-m", "servo_models", "simulate", "sg90", "--stop", "10"],
    "simulate torque_motor, 10 s": [
        *("-m", "servo_models", "simulate", "torque_motor", "--stop", "10")
    ],
}
BARS = {"--help": 0.3, "simulate sg90, 10 s": 2.0, "simulate torque_motor, 10 s": 2.0}  # seconds


def run(words: list[str]) -> tuple[float, float, float]:
    """Return wall clock [s], processor time [s] and peak memory [MB] of one process."""
    begin = time.perf_counter()
    quiet = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
    child = os.posix_spawn(sys.executable, [sys.executable, *words], os.environ, file_actions=quiet)
    _, status, usage = os.wait4(child, 0)
    assert status == 0, words
    peak = usage.ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
    return time.perf_counter() - begin, usage.ru_utime + usage.ru_stime, peak


def main() -> None:
    for words in COMMANDS.values():
        run(words)
    print(f"{'command':29}{'bar':>7}{'wall':>8}{'fastest':>10}{'processor':>11}{'memory':>9}")
    for name, words in COMMANDS.items():
        wall, processor, memory = zip(*(run(words) for _ in range(ROUNDS)))
        bar = f"{BARS[name]:.1f} s" if name in BARS else ""
        print(
            f"{name:29}{bar:>7}{statistics.median(wall):6.2f} s{min(wall):8.2f} s"
            f"{statistics.median(processor):9.2f} s{max(memory):6.0f} MB"
        )


if __name__ == "__main__":
    main()

# Result: two cores, CPython 3.11.
#
# command                          bar    wall   fastest  processor   memory
# bare python                           0.02 s    0.02 s     0.02 s    11 MB
# --help                         0.3 s  0.16 s    0.16 s     0.16 s    24 MB
# list                                  0.25 s    0.24 s     0.25 s    34 MB
# explain backlash                      0.48 s    0.43 s     0.58 s    52 MB
# simulate sg90, 10 s            2.0 s  1.25 s    1.15 s     1.46 s   171 MB
# simulate torque_motor, 10 s    2.0 s  1.15 s    1.09 s     1.35 s   171 MB
