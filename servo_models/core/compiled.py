"""Compile a flattened plant for simulations in this process: in C, else with numba.

The C compiler of the machine takes half a second where numba takes 5 to 8, and a process that
finds the library in the cache does not import numba either.  Numba compiles where there is no
compiler for this platform, where it fails, and where a block has no form in C.  Both compute the
same bits and let other threads run; C takes 5 to 22 % less time for the variants as they are.

What was compiled is kept under a digest of the text and of what compiles it, in a folder of the
cache whose files are compared with their digests before they are loaded (``files.cached``).  Set
``SERVO_MODELS_CACHE`` to keep the cache elsewhere.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import hashlib
import sys
from collections.abc import Callable
from math import inf
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from servo_models.core import c_text
from servo_models.core.compilers import cached_library, for_this_processor, here, host
from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.files import cached

Run = Callable[..., tuple[int, int]]
"""``run`` as ``stepper.run_text`` says, of any number of sub-steps unless ``most`` are given.  It
takes arrays of float64 in C order and no other."""

FAST = ("-fno-math-errno", "-fno-trapping-math")  # flags that change no bit: nobody reads errno
KEPT = 64  # compiled texts that a process keeps, the latest ones
_FILE = "model.py"
_HEAD = '''"""Compiled by servo-models from one declaration; delete freely."""
from numba import njit, types


def array(dimensions, readonly=False):
    return types.Array(types.float64, dimensions, "C", readonly=readonly)

'''
_TAIL = """

SIGNATURE = (array(1, True), array(1), array(1, True), array(2, True), array(2), types.float64)
run = njit([SIGNATURE], cache=True, nogil=True, error_model="numpy")(run)
"""


@functools.lru_cache(maxsize=KEPT)
def compiled_run(text: str) -> Run:
    """Return the compiled ``run`` of a text printed by ``stepper.run_text``."""
    with contextlib.suppress(UserError, ValueError, OSError):
        return run_in_c(text)
    return run_by_numba(text)


def run_in_c(text: str) -> Run:
    """Return ``run`` compiled by the host's C compiler.

    Raises:
        UserError: there is none for this platform, or it fails.
        ValueError: a block has no form in C.
        OSError: the library cannot be loaded.
    """
    compiler, target = host(), here()
    # on Windows a compiler may bring other functions of mathematics than Python's
    if compiler is None or target not in compiler.targets or target.suffix == ".dll":
        raise UserError("no C compiler for this platform was found")
    flags, processor = for_this_processor(compiler)
    made_of = [text, Path(c_text.__file__).read_text(encoding="utf-8"), processor]
    library = cached_library(
        compiler,
        target,
        made_of,
        "run.c",
        lambda: {"run.c": c_text.c_run_text(text).encode()},
        (*FAST, *flags),
    )
    function = ctypes.CDLL(str(library)).run
    count, pointer, number = ctypes.c_longlong, ctypes.c_void_p, ctypes.c_double
    function.argtypes = [pointer, pointer, count, pointer, pointer, pointer, number, pointer]

    def run(
        p: Array, x: Array, times: Array, inputs: Array, out: Array, most: float = inf
    ) -> tuple[int, int]:
        row = count()
        code = function(
            *(_address(p, 1), _address(x, 1, changed=True), len(times)),
            *(_address(times, 1), _address(inputs, 2), _address(out, 2, changed=True)),
            most,
            ctypes.addressof(row),
        )
        return code, row.value

    return run


def _address(array: Array, dimensions: int, changed: bool = False) -> int:
    """Where an array begins; ``ndpointer`` of numpy would take as long as a short run."""
    flags = array.flags
    fits = array.dtype == np.float64 and array.ndim == dimensions and flags.c_contiguous
    if not fits or (changed and not flags.writeable):
        raise TypeError(f"not an array of {dimensions} dimensions of float64 in C order: {array!r}")
    return array.ctypes.data


def run_by_numba(text: str) -> Run:
    """Return ``run`` compiled by numba, whose own cache cannot see edits in other files, cannot
    hold closures, and believes what it reads."""
    source = _HEAD + text + _TAIL
    digest = hashlib.sha256((_origin() + source).encode()).hexdigest()
    name = f"model_{digest[:32]}"

    def make(folder: Path) -> None:
        (folder / _FILE).write_bytes(source.encode())
        _executed(folder / _FILE, source, name)

    jitted = _executed(cached(name, make) / _FILE, source, name).run

    def run(
        p: Array, x: Array, times: Array, inputs: Array, out: Array, most: float = inf
    ) -> tuple[int, int]:
        code, row = jitted(p, x, times, inputs, out, most)
        return int(code), int(row)

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
