"""Build a model as an FMU: FMI 2.0 co-simulation, one self-contained Python slave."""

from __future__ import annotations

from pathlib import Path

from fmu_src.archive import write_fmu
from servo_models.core.simulate import Model
from servo_models.errors import UserError
from servo_models.files import write_with


def build(model: Model, path: str | Path) -> Path:
    """Write the FMU of ``model`` to ``path`` and return the path.

    The chosen parameter values become the start values; the FMU simulates the same text as
    ``Model.run``, bit for bit.  The same model gives the same bytes.

    Args:
        model: from ``servo_models.core.simulate.model``.
        path: file to write, ending in ``.fmu``; its folder is made.

    Raises:
        UserError: a path without ``.fmu``, or a folder that cannot be written.

    Example:
        >>> import servo_models as sm
        >>> sm.build(sm.model("gimbal.py"), "fmus/gimbal.fmu").name
        'gimbal.fmu'
    """
    target = Path(path)
    if target.suffix != ".fmu":
        raise UserError(f"'{target}' is no name for an FMU: let it end in .fmu")
    write_with(target, lambda part: write_fmu(model, part))
    return target


def path_of(model: Model, out: str | Path) -> Path:
    """Return where the FMU of ``model`` goes: the file ``out``, or one in the folder ``out``.

    In a folder it is called like the actuator, and like the variant too unless that is the default
    one: variants stand beside each other.
    """
    if Path(out).suffix == ".fmu":
        return Path(out)
    is_default = model.variant == model.actuator.default_variant
    return Path(out) / f"{model.actuator.name}{'' if is_default else f'_{model.variant}'}.fmu"
