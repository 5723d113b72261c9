"""A simulated response: a run from rest, and what of it is not to be relied on."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from servo_models.core.flat import noticed
from servo_models.core.plant import check_known, unknown
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.report.result import Result as Reported

SHORTEST = 1e-12  # communication step [s] below which an internal step is not halved
CHANGED = 1e-3  # change of an output by half the internal step over full scale, if it is told
FAR = 100.0  # size of an output over full scale beyond which it is hardly meant
NUMBERS = "biufO"  # kinds of arrays taken as numbers: bool, whole, float, what float() takes
SECONDS = "give seconds, shape (n,)"


@dataclass(frozen=True, repr=False)
class Result(Reported):
    """A simulated response; a notebook shows its signals and figures.

    Attributes:
        model: model that was simulated.
        times: communication points [s], shape (n,).
        inputs, outputs: SI values by name, each of shape (n,); an input is held from its
            row on, an output is the value at its row.
        warnings: what is not to be relied on, in words: see ``doubts``.
    """

    model: Model
    times: Array
    inputs: dict[str, Array]
    outputs: dict[str, Array]
    warnings: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> Array:
        if name in self.outputs:
            return self.outputs[name]
        if name in self.inputs:
            return self.inputs[name]
        raise UserError(unknown("signal", name, {**self.outputs, **self.inputs}))

    def to_pandas(self) -> Any:
        """Return a DataFrame in SI: a column for each input and output, times [s] as its index.

        Raises:
            UserError: pandas is not installed.
        """
        try:
            import pandas as pd  # type: ignore[import-untyped]
        except ImportError:
            raise UserError("pandas is not installed: pip install pandas") from None
        index = pd.Index(self.times, name="time")
        return pd.DataFrame({**self.inputs, **self.outputs}, index=index)


def simulate(
    chosen: Model, times: ArrayLike, inputs: Mapping[str, ArrayLike] | None = None
) -> Result:
    """Simulate from rest.

    Args:
        chosen: the model, from ``model``.
        times: communication points [s], increasing, shape (n,); equal neighbours are a
            clean step of the inputs.
        inputs: SI values by name, scalars or shape (n,); an input not named stays at rest.

    Raises:
        UserError: see ``Model.run``; also an unknown input, or what is no array of numbers of
            these shapes.

    Example:
        >>> import numpy as np
        >>> import servo_models as sm
        >>> times = np.arange(0.0, 1.0, 0.001)  # s
        >>> response = sm.simulate(sm.model("sg90"), times, {"pulse_width": 1.9e-3})
        >>> response["angle"].shape  # rad
        (1000,)
    """
    if not isinstance(chosen, Model):
        raise UserError(
            f"argument 'chosen' is no model, but {chosen!r:.60}: choose one by sm.model"
        )
    grid = np.ascontiguousarray(_numbers("argument 'times'", times, SECONDS))
    if grid.ndim != 1:
        raise UserError(f"argument 'times' has shape {grid.shape}: {SECONDS}")
    columns = _columns(chosen, {} if inputs is None else inputs, grid.shape)
    matrix = np.column_stack(list(columns.values()))
    state = chosen.start()
    out = chosen.run(grid, matrix, state)
    named = {name: out[:, i] for i, name in enumerate(chosen.plant.outputs)}
    notices = noticed(chosen.flat, state.tolist()).values()
    warnings = (*doubts(chosen, grid, matrix, out), *notices)
    return Result(chosen, grid, columns, named, warnings)


def _columns(
    chosen: Model, inputs: Mapping[str, ArrayLike], shape: tuple[int, ...]
) -> dict[str, Array]:
    """The values [SI] of every input at every time; one that is not given stays at rest."""
    known = {wire.name: wire for wire in chosen.plant.inputs}
    if not isinstance(inputs, Mapping):
        example = f"give {{'{next(iter(known), 'input')}': ...}}"
        raise UserError(f"argument 'inputs' is no mapping, but {inputs!r:.60}: {example}")
    settable = [wire.name for wire in chosen.plant.settable]
    check_known("input", inputs, settable, f"actuator '{chosen.actuator.name}'")
    columns: dict[str, Array] = {}
    for name, wire in known.items():
        cure = f"give one number in {wire.unit}, or one for each time"
        values = _numbers(f"input '{name}'", inputs.get(name, wire.rest), cure)
        if values.shape not in ((), shape):
            raise UserError(f"input '{name}' has shape {values.shape}, the times {shape}: {cure}")
        columns[name] = np.broadcast_to(values, shape)
    return columns


def _numbers(what: str, given: ArrayLike, cure: str) -> Array:
    """An argument as an array of floats; texts, dates and complex numbers would lose their unit."""
    if np.ma.is_masked(given):
        raise UserError(f"{what} is masked in places: fill the gaps")
    with contextlib.suppress(TypeError, ValueError):
        values = np.asarray(given)
        if values.dtype.kind in NUMBERS:
            return values.astype(float)
    raise UserError(f"{what} is not of numbers, but {given!r:.60}: {cure}")


def doubts(chosen: Model, times: Array, inputs: Array, out: Array) -> Iterator[str]:
    """Yield, in words, why ``out`` of a run from rest is not to be relied on.

    The run is made again with half the internal step: where an output other than a flag
    changes by more than a thousandth of its full scale, what it does at a time is chance, as
    behind a jump of the right-hand side that is not a mode or where a loop is chaotic.  An
    output beyond a hundred full scales is told as well.
    """
    for one, values in zip(chosen.actuator.checked(chosen.variant), inputs.T):
        beyond = (values < one.low) | (values > one.high)
        if beyond.any():
            yield f"{one.beyond}, at t = {times[beyond.argmax()]:g} s"
    step = min(chosen.values["internal_step"], float(np.diff(times).max(initial=0.0)))
    if step > SHORTEST:
        step *= 0.5
    else:  # nothing moves meanwhile, and equations divide by the step
        step = chosen.values["internal_step"]
    finer = {**chosen.values, "internal_step": step}
    try:
        again = chosen.from_rest(np.array(list(finer.values())), times, inputs)
    except UserError as error:
        yield f"with half the internal step the run fails: {error}"
        return
    for name, column, other in zip(chosen.plant.outputs, out.T, again.T):
        wire = chosen.plant.wire[name]
        change, size = np.abs(column - other) / wire.scale, np.abs(column) / wire.scale
        row, largest = int(change.argmax()), int(size.argmax())
        if change[row] > CHANGED and not wire.flag:
            yield (
                f"output '{name}' depends on the internal step: with half of it, it changes by"
                f" {100.0 * change[row]:.2g} % of full scale at t = {times[row]:g} s; rely on what"
                " both runs share, or choose a shorter internal_step"
            )
        if size[largest] > FAR and not wire.flag:
            yield (
                f"output '{name}' reaches {size[largest]:.2g} times its full scale at"
                f" t = {times[largest]:g} s: check parameters and inputs"
            )
