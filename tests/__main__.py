"""``python -m tests`` sets itself up and runs the tests, in parallel where there are cores."""

import os
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bootstrap

if __name__ == "__main__":
    bootstrap.ensure("test", needs="pytest-xdist")
    os.chdir(bootstrap.HERE)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # one worker a core is all there is
    import pytest

    # Errors cross pythonfmu's binary as C++ exceptions, which other extension modules in the
    # same process can spoil: they are tested in a process that has loaded nothing else.
    apart = "tests/test_fmu_errors.py"
    if len(sys.argv) > 1:
        raise SystemExit(pytest.main(sys.argv[1:]))
    alone = subprocess.run([sys.executable, "-m", "pytest", apart], check=False).returncode
    rest = pytest.main(["-n", str(os.cpu_count() or 1), f"--ignore={apart}"])
    raise SystemExit(alone or rest)
