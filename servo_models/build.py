"""Build a model as an FMU for co-simulation: a Python slave, or native code."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from fmu_src.archive import python_entries, write_archive
from fmu_src.native.archive import NATIVE as NATIVE_FORM
from fmu_src.native.archive import NATIVE3, native_entries
from servo_models.core.compilers import TARGETS, Target, compiler, needed_compiler
from servo_models.core.simulate import Model
from servo_models.errors import UserError
from servo_models.files import write_with

PYTHON, NATIVE, NATIVE_ARM, FMI3 = KINDS = ("python", "native", "native-arm", "fmi3")
"""Kinds of FMUs; ARM Linux has one of its own, since hosts of FMI 2.0 look into one folder for all
Linux."""
(ARM_LINUX,) = (target for target in TARGETS if target.name == "linux-aarch64")


def build(model: Model, path: str | Path, kind: str = PYTHON) -> Path:
    """Write the FMU of ``model`` to ``path`` and return the path.

    The chosen parameter values become the start values; the FMU simulates the same text as
    ``Model.run``, bit for bit.  The same model gives the same bytes, of a native FMU with the
    same compiler.  Of a simulation that is not ours it has the effects around it, to be connected
    with it.

    Args:
        model: from ``servo_models.model``.
        path: file to write, ending in ``.fmu``; its folder is made.
        kind: ``python``, for hosts with a Python library; ``native``, compiled C for any host, on
            every platform where the extra ``native`` is installed, else on this one;
            ``native-arm``, the same for Linux on 64-bit ARM; ``fmi3``, native for FMI 3.0, all of
            these platforms in one.

    Raises:
        UserError: a path without ``.fmu``, a folder that cannot be written, an unknown kind, or
            no compiler for a native FMU.

    Example:
        >>> import servo_models as sm
        >>> sm.build(sm.model("gimbal.py"), "fmus/gimbal.fmu").name
        'gimbal.fmu'
    """
    target = Path(path)
    if target.suffix != ".fmu":
        raise UserError(f"'{target}' is no name for an FMU: let it end in .fmu")
    if kind not in KINDS:
        raise UserError(f"'{kind}' is no kind of FMU: choose one of {', '.join(KINDS)}")
    # of a simulation that is not ours, the effects around it
    model = replace(model, actuator=replace(model.actuator, inner=None))
    if kind == PYTHON:
        entries = python_entries(model)
    else:
        found = needed_compiler()
        form = NATIVE3 if kind == FMI3 else NATIVE_FORM
        entries = native_entries(model, form, found, _platforms(found.targets, kind))
    write_with(target, lambda part: write_archive(entries, part))
    return target


def _platforms(targets: Sequence[Target], kind: str) -> Sequence[Target]:
    """What goes into one native FMU, of what the compiler builds for."""
    if kind == FMI3:
        return targets
    others = [target for target in targets if target != ARM_LINUX]
    return others if kind == NATIVE and others else [ARM_LINUX]


def kinds_for(out: str | Path, native: bool, fmi: int = 2) -> tuple[str, ...]:
    """Return the kinds to build: every one that this machine can, or the native ones alone.

    Where ``out`` is one file it is one kind.  Without a compiler a native one is asked for all the
    same, and ``build`` says what is missing.

    Args:
        out: folder or file of the FMUs.
        native: leave the Python FMU out.
        fmi: version of FMI, 2 or 3; what is of version 3 is native.
    """
    if fmi == 3:
        return (FMI3,)
    found = compiler()
    natives: tuple[str, ...] = ()
    if native or found:
        natives = (NATIVE, NATIVE_ARM) if found and {ARM_LINUX} < {*found.targets} else (NATIVE,)
    kinds = natives if native else (PYTHON, *natives)
    return kinds[:1] if Path(out).suffix == ".fmu" else kinds


def path_of(model: Model, out: str | Path, kind: str = PYTHON) -> Path:
    """Return where the FMU of ``model`` goes: the file ``out``, or one in the folder ``out``.

    In a folder it is called like the actuator, and like the variant too unless that is the default
    one: variants stand beside each other.  So do kinds: ``sg90.fmu``, ``sg90.native.fmu``,
    ``sg90.fmi3.fmu``.
    """
    if Path(out).suffix == ".fmu":
        return Path(out)
    is_default = model.variant == model.actuator.default_variant
    name = model.actuator.name if is_default else f"{model.actuator.name}_{model.variant}"
    return Path(out) / f"{name}{'' if kind == PYTHON else f'.{kind}'}.fmu"
