"""How many columns in a wrong unit ``check`` names, and how many sane logs it doubts.

``python tests/fuzz/units.py --first 200 --count 10`` takes so many rigs of every subject, each
with a share of its outputs logged.  Seeds below 100 were used to choose thresholds.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.support.plausible_logs import (
    doubts,
    is_refused,
    misread,
    mistakes,
    names,
    sane,
    with_outputs,
)

SUBJECTS = (
    ("sg90", "measured"),
    ("sg90", "printed"),
    ("sg90", "linear"),
    ("torque_motor", "identified"),
    ("torque_motor", "measured"),
    ("linear_drive", "identified"),
    ("linear_drive", "simple"),
    ("smart_servo", "xl330"),
    ("smart_servo", "sts3215"),
    ("second_order_servo", "pulse"),
    ("second_order_servo", "bus"),
    ("dc_motor", "direct"),
    ("dc_motor", "geared"),
    ("dc_motor_current", "direct"),
    ("dc_motor_speed", "geared"),
    ("dc_motor_speed", "odrive"),
)


def main() -> None:
    """Print counts, and every mistake that was not named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=200)
    parser.add_argument("--count", type=int, default=2)
    given = parser.parse_args()
    count: Counter[str] = Counter()
    for name, variant in SUBJECTS:
        for seed in range(given.first, given.first + given.count):
            chosen, every = sane(name, variant, seed)
            random = np.random.default_rng(seed)
            outputs = list(every.outputs)
            some = random.choice(outputs, random.integers(1, len(outputs) + 1), replace=False)
            log = with_outputs(every, sorted(map(str, some)))
            count["sane logs"] += 1
            doubted = doubts(chosen, log)
            count["sane logs doubted"] += bool(doubted)
            for wrong in mistakes(chosen, log):
                changed = misread(log, wrong)
                if is_refused(chosen, changed):
                    count["refused with the row"] += 1
                    continue
                count["misread"] += 1
                said = " ".join(doubts(chosen, changed))
                if names(said, wrong.signal, wrong.written):
                    count["named with the unit"] += 1
                else:
                    print(name, variant, seed, wrong, list(log.outputs), said or "nothing")
    for what, number in count.items():
        print(f"{what}: {number}")


if __name__ == "__main__":
    main()
