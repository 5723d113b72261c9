"""Run an FMU in libcosim, a master written in C++ by other people, and print what it reads.

A process of its own: libcosim and fmpy in one process free the same library at its end.

    python second_master.py FMU STEPS '{"inputs": {"0": 1.5}, "outputs": [3]}'

Steps are of 1 ms, keys are value references; prints the outputs after the last step as JSON.
"""

from __future__ import annotations

import json
import sys

from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimManipulator import CosimManipulator
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

STEP = 1_000_000
"""Nanoseconds."""


def outputs(fmu: str, steps: int, inputs: dict[int, float], wanted: list[int]) -> list[float]:
    execution = CosimExecution.from_step_size(step_size=STEP)
    slave = execution.add_local_slave(CosimLocalSlave(fmu_path=fmu, instance_name="servo"))
    for reference, value in inputs.items():
        execution.real_initial_value(slave, reference, value)
    manipulator, observer = CosimManipulator.create_override(), CosimObserver.create_last_value()
    execution.add_manipulator(manipulator)
    execution.add_observer(observer)
    manipulator.slave_real_values(slave, list(inputs), list(inputs.values()))
    assert execution.step(steps)
    assert execution.status().current_time == steps * STEP
    return list(observer.last_real_values(slave, wanted))


if __name__ == "__main__":
    asked = json.loads(sys.argv[3])
    chosen = {int(key): value for key, value in asked["inputs"].items()}
    print(json.dumps(outputs(sys.argv[1], int(sys.argv[2]), chosen, asked["outputs"])))
