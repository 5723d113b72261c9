"""``python -m tests`` sets itself up and runs the quick tests; ``--all`` the thorough ones as well.

Other words go to pytest, which then runs them in one process.
"""

import os
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bootstrap

CORES = os.cpu_count() or 1
# neighbours share fixtures and compiled text, so a worker keeps them until another has nothing
PARALLEL = ["-n", str(CORES), "--dist", "worksteal"]
WITH_THOROUGH = ["-m", "not long"]


def compiled(name: str) -> str:
    """Compile an actuator into the cache: in C where there is a compiler, else by numba."""
    from servo_models.catalogue import model
    from servo_models.core.compiled import compiled_run
    from servo_models.core.stepper import run_text

    compiled_run(run_text(model(name).flat))
    return name


def generated(folder: str) -> str:
    """Make a few withheld cases, so that their simulation is compiled into the cache of numba."""
    words = ["-m", "servo_models.withheld.generator", folder, "--cases", "4", "--seed", "1"]
    subprocess.run([sys.executable, *words], check=True, capture_output=True)
    return "the generator of withheld cases"


def compile_all() -> None:
    """Compile every actuator once: else each worker would do it beside the others."""
    from servo_models.catalogue import actuators

    with ProcessPoolExecutor(CORES) as pool, tempfile.TemporaryDirectory() as folder:
        cases = pool.submit(generated, str(Path(folder) / "cases"))
        for name in pool.map(compiled, actuators()):
            print(f"compiled {name}", flush=True)
        print(f"compiled {cases.result()}", flush=True)


def run(words: list[str]) -> int:
    """Run pytest in a process of its own; its exit code."""
    return subprocess.run([sys.executable, "-m", "pytest", *words], check=False).returncode


def main(words: list[str]) -> int:
    """Run what is asked for; its exit code."""
    if words not in ([], ["--all"]):
        return run(words)
    print(f"on two cores about {20 if words else 6} minutes", flush=True)
    compile_all()
    return run([*PARALLEL, *(WITH_THOROUGH if words else [])])


if __name__ == "__main__":
    bootstrap.ensure("test", needs="pytest-xdist")
    os.chdir(bootstrap.HERE)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # one worker a core is all there is
    try:
        raise SystemExit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        raise SystemExit(130) from None
