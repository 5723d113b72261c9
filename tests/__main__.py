"""``python -m tests`` sets itself up and runs the tests, in parallel where there are cores."""

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bootstrap

# neighbours share fixtures and compiled text, so a worker keeps them until another has nothing
PARALLEL = ["-n", str(os.cpu_count() or 1), "--dist", "worksteal"]

if __name__ == "__main__":
    bootstrap.ensure("test", needs="pytest-xdist")
    os.chdir(bootstrap.HERE)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # one worker a core is all there is
    import pytest

    raise SystemExit(pytest.main(sys.argv[1:] or PARALLEL))
