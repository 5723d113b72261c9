"""Compile a flat text with numba, cached under a hash of the text itself.

Numba's own cache cannot see edits in other files and cannot hold closures, so the text is
written once to the user's cache folder under its hash and imported from there.  Set
``SERVO_MODELS_CACHE`` to keep the cache elsewhere.  A run lets other threads run.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import sys
from collections.abc import Callable
from typing import Any

from servo_models.files import cache_folder, write_whole

_HEAD = '''"""Compiled by servo-models from one declaration; delete freely."""
from numba import njit
'''
_TAIL = """

run = njit(cache=True, nogil=True, error_model="numpy")(run)
"""


@functools.cache
def compiled_run(text: str) -> Callable[..., Any]:
    """Return the compiled ``run`` of a text printed by ``stepper.run_text``."""
    source = _HEAD + text + _TAIL
    name = "servo_models_" + hashlib.sha256(source.encode()).hexdigest()[:16]
    path = cache_folder() / f"{name}.py"
    if not path.exists():
        write_whole(path, source.encode())
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    run: Callable[..., Any] = module.run
    return run


def plain_make(text: str) -> Callable[..., Any]:
    """Return ``make`` of a text printed by ``step_text`` or ``start_text``, in plain Python."""
    namespace: dict[str, Any] = {}
    exec(compile(text, "<flat text>", "exec"), namespace)  # our own text, never a user's
    make: Callable[..., Any] = namespace["make"]
    return make
