"""Build a model as an FMU: FMI 2.0 co-simulation, one self-contained Python slave."""

from __future__ import annotations

from pathlib import Path

from fmu_src.archive import write_fmu
from servo_models.errors import UserError
from servo_models.files import write_with
from servo_models.simulate import Model


def build(model: Model, path: str | Path) -> Path:
    """Write the FMU of ``model`` to ``path`` and return the path.

    The chosen parameter values become the start values; the FMU simulates the same text as
    ``Model.run``, bit for bit.  The same model gives the same bytes.

    Args:
        model: from ``servo_models.simulate.model``.
        path: file to write, ending in ``.fmu``; its folder is made.

    Raises:
        UserError: a path without ``.fmu``, or a folder that cannot be written.
    """
    target = Path(path)
    if target.suffix != ".fmu":
        raise UserError(f"'{target}' is no name for an FMU: let it end in .fmu")
    write_with(target, lambda part: write_fmu(model, part))
    return target
