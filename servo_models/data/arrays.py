"""A description of tables in memory: what a TOML file says, said in Python."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from servo_models.catalogue import model
from servo_models.core.plant import TIME_AXIS, check_known, unknown
from servo_models.core.simulate import Model
from servo_models.data.description import Description, described
from servo_models.data.readers import Columns
from servo_models.data.readers.columns import column_of
from servo_models.data.schema import Section
from servo_models.errors import UserError

OF_THE_TABLE = {"file", "name", "table", "header", "time", "inputs", "outputs"}
"""Keys of a ``[[logs]]`` that say which table it is and what its columns are."""
Column = str | int | tuple[str | int, str] | Mapping[str, Any]
"""A header in SI, or a header and its unit, or all keys of a signal in ``docs/description.md``."""


def describe(
    actuator: str | Model,
    logs: Mapping[str, Any],
    columns: Mapping[str, Column],
    *,
    each: Mapping[str, Mapping[str, Any]] | None = None,
    uncertainty: Mapping[str, float | str] | None = None,
    bounds: Mapping[str, Sequence[float | str]] | None = None,
    free: Sequence[str] = (),
    method: str | None = None,
) -> Description:
    """Describe logs that are in memory, for ``check``, ``identify`` and ``diagnose``.

    Args:
        actuator: its name, for the default variant, or a model from ``model``.
        logs: tables by name, polars or pandas DataFrames or mappings of arrays of shape (n,).
            Errors count their rows from 0; what a masked array masks is missing.
        columns: columns of every log, by ``"time"`` and the names of inputs and outputs: a header,
            in SI; a header with its unit; or a mapping with the keys of a signal in a TOML file,
            such as ``{"column": "u", "unit": "V", "sign": -1}``.
        each: further keys of single logs, by the log's name, as ``[[logs]]`` has them:
            ``held_out``, ``constants``, ``window``, ``judged``, ``settle``, ``start``; but not its
            columns.
        uncertainty: standard deviations by parameter, a share ``"10 %"`` or a size.
        bounds: least and largest value by parameter.
        free: parameters or effects that ``identify`` estimates.
        method: method of ``identify``, ``"simulation"`` or ``"transfer_function"``.

    Raises:
        UserError: an unknown signal, parameter or key; a column that is missing, not of numbers
            or of another length; a unit that does not convert; see ``read_description``.

    Example:
        >>> import numpy as np
        >>> import servo_models as sm
        >>> times = np.arange(0.0, 1.0, 0.01)
        >>> log = {"t": 1e3 * times, "u": np.where(times < 0.1, 0.0, 20.0), "deg": 5.0 * times}
        >>> description = sm.describe(
        ...     sm.model("torque_motor", "measured"),
        ...     logs={"step": log},
        ...     columns={"time": ("t", "ms"), "voltage": "u", "angle": ("deg", "deg")},
        ...     uncertainty={"torque_constant": "10 %"},
        ... )
        >>> round(float(description.logs[0].outputs["angle"].max()), 3)  # rad
        0.086
    """
    chosen = model(actuator) if isinstance(actuator, str) else actuator
    if not isinstance(chosen, Model):
        raise UserError(f"actuator: no name and no model, but {actuator!r:.60}; see sm.model")
    if not isinstance(logs, Mapping):
        raise UserError("logs: give a mapping of names to tables, {'bench': frame}")
    logs = {str(name): table for name, table in logs.items()}
    nominal = chosen.actuator.values(chosen.variant)
    changed = {name: value for name, value in chosen.values.items() if value != nominal[name]}
    _check_mapping("columns", columns, "names to headers", "{'time': 't', 'angle': 'deg'}")
    example = "{'bench': {'held_out': True}}"
    each = {} if each is None else each
    _check_mapping("each", each, "logs to their keys", example)
    further = {str(name): keys for name, keys in each.items()}
    for name, keys in further.items():
        _check_mapping(f"each, '{name}'", keys, "keys to values", example)
        check_known("log", [name], logs, "each")
        if own_keys := sorted({str(key) for key in keys} & OF_THE_TABLE):
            raise UserError(
                f"each, '{name}': '{own_keys[0]}' is of the table, the same for all logs; give the"
                " table of that log in the headers, units and signs of 'columns'"
            )
    signals = _signals(chosen, columns)
    entries = [{**further.get(name, {}), **signals, "name": name, "file": name} for name in logs]
    content = {
        "uncertainty": {} if uncertainty is None else uncertainty,
        "bounds": {} if bounds is None else bounds,
        "free": free,
        "method": method,
        "logs": entries,
    }
    tables = {name: _read(name, table) for name, table in logs.items()}
    place = Path(chosen.actuator.name)  # where a file stands in messages
    return described(Section(place, "", _plain(content)), chosen, changed, tables)


def _check_mapping(what: str, given: object, of: str, example: str) -> None:
    if not isinstance(given, Mapping):
        raise UserError(
            f"{what}: give a mapping of {of}, {example}, and not of type {type(given).__name__}"
        )


def _signals(chosen: Model, columns: Mapping[str, Column]) -> dict[str, Any]:
    """The columns as the keys ``time``, ``inputs`` and ``outputs`` of a ``[[logs]]``."""
    plant = chosen.plant
    inputs, outputs = {wire.name for wire in plant.inputs}, set(plant.outputs)
    keys: dict[str, Any] = {"inputs": {}, "outputs": {}}
    for key, given in columns.items():
        name, column = str(key), given
        if isinstance(given, tuple):
            if len(given) != 2:
                raise UserError(f"columns, '{name}': give a header and a unit, ('u', 'V')")
            column = {"column": _header(given[0]), "unit": given[1]}
        elif isinstance(given, Mapping):
            column = {**given, "column": _header(given["column"])} if "column" in given else given
        else:
            column = _header(given)
        if name == TIME_AXIS:
            keys["time"] = column
        elif name in inputs | outputs:
            keys["inputs" if name in inputs else "outputs"][name] = column
        else:
            known = dict.fromkeys([TIME_AXIS, *sorted(inputs), *plant.outputs])
            raise UserError(unknown("signal", name, known, "columns"))
    return keys


def _header(given: Any) -> Any:
    """A header as text; a whole number, as in a DataFrame of a matrix, is a header, no position."""
    return str(given) if isinstance(given, int | np.integer) else given


def _read(name: str, table: Any) -> Columns:
    """A table in memory as if it had been read from a file of this name."""
    import polars as pl

    eager = hasattr(table, "columns") and not hasattr(table, "collect")
    if not (eager or isinstance(table, Mapping)):
        raise UserError(
            f"log '{name}' is no table, but of type {type(table).__name__}: give a polars or pandas"
            " DataFrame or a mapping of headers to arrays, and logs as {'bench': table}"
        )
    headers = list(getattr(table, "columns", table))
    cells: list[pl.Series] = []
    for header in headers:
        values = table[header]
        if not isinstance(values, pl.Series):
            if np.ma.isMaskedArray(values):  # what is masked was not measured
                values = np.ma.filled(np.ma.asarray(values, dtype=float), np.nan)
            array = np.asarray(values)
            if array.ndim != 1:
                raise UserError(
                    f"log '{name}', column '{header}' has shape {array.shape}: give one of"
                    " shape (n,)"
                )
            objects = array.dtype == np.dtype(object)  # numbers with None among them
            values = column_of("", array.tolist()) if objects else pl.Series(array)
        cells.append(values.alias(str(header)))
    if not any(map(len, cells)):
        raise UserError(f"log '{name}' has no rows: give a table with some")
    digest = hashlib.sha256()
    for column in cells:
        digest.update(f"{column.name} {column.dtype} {column.to_list()}".encode())
    return Columns(Path(name), tuple(cells), first_row=0, sha256=digest.hexdigest())


def _plain(value: Any) -> Any:
    """A value as TOML would have it: text for keys, lists for arrays, Python's own numbers."""
    if isinstance(value, Mapping):
        return {str(name): _plain(inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else value
