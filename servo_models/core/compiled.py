"""Compile a flat text with numba, cached under a digest of the text and of what compiles it.

Numba's own cache cannot see edits in other files, cannot hold closures, and believes what it
reads: a changed byte of machine code is run.  So each text has a folder of the cache, whose
files are compared with their digests before numba reads them (``files.cached``).  Set
``SERVO_MODELS_CACHE`` to keep the cache elsewhere.  A run lets other threads run.
"""

from __future__ import annotations

import functools
import hashlib
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from servo_models.files import cached

KEPT = 64
"""Compiled texts that a process keeps, the latest ones."""
_FILE = "model.py"
_HEAD = '''"""Compiled by servo-models from one declaration; delete freely."""
from numba import njit, types


def array(dimensions, readonly=False):
    return types.Array(types.float64, dimensions, "C", readonly=readonly)

'''
_TAIL = """

SIGNATURE = (array(1, True), array(1), array(1, True), array(2, True), array(2))
run = njit([SIGNATURE], cache=True, nogil=True, error_model="numpy")(run)
"""


@functools.lru_cache(maxsize=KEPT)
def compiled_run(text: str) -> Callable[..., Any]:
    """Return the compiled ``run`` of a text printed by ``stepper.run_text``.

    It takes arrays of float64 in C order, as the text says, and no other.
    """
    source = _HEAD + text + _TAIL
    digest = hashlib.sha256((_origin() + source).encode()).hexdigest()
    name = f"model_{digest[:32]}"

    def make(folder: Path) -> None:
        (folder / _FILE).write_bytes(source.encode())
        _executed(folder / _FILE, source, name)

    module = _executed(cached(name, make) / _FILE, source, name)
    run: Callable[..., Any] = module.run
    return run


def _executed(path: Path, source: str, name: str) -> ModuleType:
    """Execute the text of a file that is there: numba keeps machine code beside it, which
    names the module that it is for."""
    import numba

    config: Any = numba.config
    module = sys.modules[name] = ModuleType(name)
    module.__file__ = str(path)
    elsewhere, config.CACHE_DIR = config.CACHE_DIR, ""
    try:
        exec(compile(source, str(path), "exec"), vars(module))  # our own text, never a user's
    finally:
        config.CACHE_DIR = elsewhere
    return module


@functools.cache
def _origin() -> str:
    """What makes machine code: versions, and the processor that it is for."""
    import llvmlite
    import numba
    from llvmlite import binding

    processor = binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()
    return repr((sys.version, numba.__version__, llvmlite.__version__, processor))


def plain_make(text: str) -> Callable[..., Any]:
    """Return ``make`` of a text printed by ``step_text`` or ``start_text``, in plain Python."""
    namespace: dict[str, Any] = {}
    exec(compile(text, "<flat text>", "exec"), namespace)  # our own text, never a user's
    make: Callable[..., Any] = namespace["make"]
    return make
