"""Step every kind of FMU in every host that is installed here, and compare with the simulation.

    python tests/platforms/hosts.py [ACTUATOR ...]

All inputs jump, at a communication step of 1/512 s: every host has the same times then, whether it
multiplies, adds up or counts nanoseconds, so the numbers must be equal to the last bit.

Hosts that are not installed are named.  All of them: ``pip install ecospy==0.7.2
fmu-manipulation-toolbox==2.0 fmuloader==0.1.2rc0 fmipp==2.1.0 libcosimpy==0.0.6``.  ecospy needs
``libtbb12`` of Debian.  fmipp is compiled, with swig and Boost; with SUNDIALS 6 only after its
``setup.py`` has lost USE_SUNDIALS, which is for model exchange.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from servo_models.build import FMI3, NATIVE, PYTHON, build
from servo_models.catalogue import actuators, model
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from tests.support.masters import stepped

STEP = 1.0 / 512.0
STEPS = 300
PACKAGES = {
    "fmpy": "fmpy",
    "fmucontainer": "fmu-manipulation-toolbox",
    "libcosim": "libcosimpy",
    "ecos": "ecospy",
    "FMI++": "fmipp",
    "fmuloader": "fmuloader",
}
NOT_TAKEN = {
    ("libcosim", FMI3): "has no FMI 3.0",
    ("FMI++", FMI3): "has no FMI 3.0",
    ("fmuloader", NATIVE): "wants model exchange too",
    ("fmuloader", PYTHON): "wants model exchange too",
}


def jumps(chosen: Model) -> Array:
    """Inputs around rest, held for 25 steps, a row for each step."""
    rng = np.random.default_rng(5)
    columns = []
    for wire in chosen.plant.inputs:
        levels = float(wire.rest) + 0.4 * wire.scale * rng.uniform(-1.0, 1.0, STEPS // 25)
        columns.append(np.repeat(np.clip(levels, wire.low, wire.high), 25))
    return np.column_stack(columns)


def compare(host: str, kind: str, fmu: Path, chosen: Model) -> str:
    if (host, kind) in NOT_TAKEN:
        return NOT_TAKEN[host, kind]
    inputs = jumps(chosen)
    try:
        columns = dict(zip([wire.name for wire in chosen.plant.inputs], inputs.T))
        found = stepped(host, fmu, STEP, columns, chosen.plant.outputs)
    except subprocess.CalledProcessError as error:
        return f"failed with {error.returncode}: {(error.stderr or '').strip()[-300:]}"
    held = np.vstack([inputs, inputs[-1:]])
    wanted = chosen.run(STEP * np.arange(STEPS + 1), held)[1:]
    assert found.shape == wanted.shape
    assert np.all(np.ptp(wanted[:, :2], axis=0) > 0.0)
    if np.array_equal(found, wanted):
        return f"{found.size} numbers equal"
    return f"largest difference {np.max(np.abs(found - wanted)):.1e}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("actuators", nargs="*", default=list(actuators()), metavar="ACTUATOR")
    with tempfile.TemporaryDirectory() as folder:
        for name in parser.parse_args().actuators:
            chosen = model(name)
            for kind in (NATIVE, PYTHON, FMI3):
                fmu = build(chosen, Path(folder) / f"{name}.{kind}.fmu", kind)
                for host, package in PACKAGES.items():
                    try:
                        shown = f"{host} {version(package)}"
                    except PackageNotFoundError:
                        print(f"{name:13} {kind:7} {host:21} not installed")
                        continue
                    print(
                        f"{name:13} {kind:7} {shown:21} {compare(host, kind, fmu, chosen)}",
                        flush=True,
                    )


if __name__ == "__main__":
    main()
