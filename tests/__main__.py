"""``python -m tests`` sets itself up and runs the quick tests; ``--all`` goes on with the rest.

Other words go to pytest, which then runs them in one process.
"""

import os
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bootstrap

# neighbours share fixtures and compiled text, so a worker keeps them until another has nothing
PARALLEL = ["-n", str(os.cpu_count() or 1), "--dist", "worksteal"]
REST = ["-m", "thorough and not long"]


def run(words: list[str]) -> int:
    """Run pytest in a process of its own; its exit code."""
    return subprocess.run([sys.executable, "-m", "pytest", *words], check=False).returncode


if __name__ == "__main__":
    bootstrap.ensure("test", needs="pytest-xdist")
    os.chdir(bootstrap.HERE)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # one worker a core is all there is
    words = sys.argv[1:]
    if words == ["--all"]:
        codes = [run(PARALLEL), run([*PARALLEL, *REST])]
        raise SystemExit(max(codes))
    raise SystemExit(run(words or PARALLEL))
