"""Set up everything a command of this repository needs, with the standard library only.

A command calls ``ensure`` first.  In an environment in which servo-models is installed it
does nothing; anywhere else it makes ``.venv`` beside this file, installs the package with
what it needs, and runs the command again in there.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import os
import subprocess
import sys
import venv
from pathlib import Path

HERE = Path(__file__).resolve().parent
ENVIRONMENT = HERE / ".venv"
OLDEST = (3, 10)
COULD_NOT_RUN = 2


def ensure(extras: str, needs: str) -> None:
    """Return if this interpreter can run the command, else run it in ``.venv`` and exit.

    Args:
        extras: extras of the package to install, e.g. ``"test"``; "" for none.
        needs: a distribution that tells that they are installed.
    """
    if sys.version_info < OLDEST:
        oldest = ".".join(str(part) for part in OLDEST)
        _fail(f"Python {oldest} or newer is needed, this is {sys.version.split()[0]}")
    if _installed("servo-models", needs):
        return
    _set_up(extras)
    result = subprocess.run([str(_python()), *sys.orig_argv[1:]], check=False)
    raise SystemExit(result.returncode)


def _installed(*names: str) -> bool:
    try:
        for name in names:
            importlib.metadata.distribution(name)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def _python() -> Path:
    folder = "Scripts" if os.name == "nt" else "bin"
    return ENVIRONMENT / folder / ("python.exe" if os.name == "nt" else "python")


def _set_up(extras: str) -> None:
    """Install once; again only when pyproject.toml has changed."""
    wanted = hashlib.sha256((HERE / "pyproject.toml").read_bytes()).hexdigest()
    stamp = ENVIRONMENT / f"installed-{extras or 'base'}"
    if stamp.exists() and stamp.read_text() == wanted and _python().exists():
        return
    print("setting up .venv (once; a minute or two) ...", file=sys.stderr, flush=True)
    target = f"{HERE}[{extras}]" if extras else str(HERE)
    quiet = ["--quiet", "--disable-pip-version-check"]
    try:
        venv.create(ENVIRONMENT, with_pip=True)
        subprocess.run(
            [_python(), "-m", "pip", "install", *quiet, "-e", target], check=True, cwd=HERE
        )
    except (subprocess.CalledProcessError, OSError) as error:
        _fail(
            f"could not set up {ENVIRONMENT.name}: {error}; check that a package registry can"
            " be reached and that the folder can be written, then run the command again"
        )
    stamp.write_text(wanted)


def _fail(message: str) -> None:
    print(f"servo-models: {message}", file=sys.stderr)
    raise SystemExit(COULD_NOT_RUN)
