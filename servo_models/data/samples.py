"""Parameter sets drawn from what an identification knows, and ranges for domain randomisation."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from servo_models.analysis.explain import display_scale, display_unit
from servo_models.core.types import Array
from servo_models.data.parameters import ParameterSet
from servo_models.errors import UserError
from servo_models.files import write_whole
from servo_models.report.numbers import Quantity
from servo_models.report.result import Report, data_sheet
from servo_models.report.sections import Cell, Table

QUANTILES = (0.025, 0.5, 0.975)  # lower end, middle and upper end of a range that holds 95 %
BATCHES = 200  # tries to draw sets within all bounds
SSV = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
SUFFIXES = (".csv", ".json", ".ssv")


@dataclass(frozen=True)
class Samples:
    """Drawn parameter sets.

    Attributes:
        chosen: parameters that they were drawn from.
        names: parameters that were drawn.
        values: SI, shape (count, parameters).
        held: parameters with a standard error that says nothing, which keep their value.
    """

    chosen: ParameterSet
    names: tuple[str, ...]
    values: Array
    held: tuple[str, ...] = ()

    def starts(self) -> list[dict[str, float]]:
        """Return a dict a set with every listed parameter [SI], such as fmpy's ``start_values``."""
        given = self.chosen.settings()
        return [{**given, **dict(zip(self.names, row))} for row in self.values.tolist()]

    def report(self) -> Report:
        """Return the ranges in the units that a person reads."""
        known = self.chosen.model().plant.parameters
        rows: list[tuple[Cell, ...]] = []
        for name, column in zip(self.names, self.values.T):
            parameter, value = known[name], self.chosen.settings()[name]
            scale, unit = display_scale(parameter), display_unit(parameter)
            ends = [Quantity(scale * it, unit) for it in np.quantile(column, QUANTILES)]
            rows.append((name, Quantity(scale * value, unit), *ends))
        count = len(self.values)
        told = [f"{count} sets drawn from {self.chosen.file or 'the parameters'}, within bounds."]
        if self.held:
            told.append(f"Held, since the logs say nothing of them: {', '.join(self.held)}.")
        columns = ("parameter", "found", "from (2.5 %)", "middle", "to (97.5 %)")
        return data_sheet("Ranges", tuple(told), (Table("", columns, tuple(rows)),))

    def write(self, path: str | Path) -> list[Path]:
        """Write all sets [SI] and return the files: ``.csv`` a row a set; ``.json`` a list of
        start values by name; ``.ssv`` an SSP parameter set, for several sets a numbered file
        each.

        Raises:
            UserError: another suffix, or a folder that cannot be written.
        """
        path, starts = Path(path), self.starts()
        check_suffix(path)
        if path.suffix == ".csv":
            text = io.StringIO()
            table = csv.DictWriter(text, list(starts[0]), lineterminator="\n")
            table.writeheader()
            table.writerows(starts)
            files = {path: text.getvalue()}
        elif path.suffix == ".json":
            files = {path: json.dumps(starts, indent=1) + "\n"}
        else:
            several = len(starts) > 1
            files = {
                path.with_stem(f"{path.stem}_{k}") if several else path: self._ssv(values)
                for k, values in enumerate(starts, 1)
            }
        for file, content in files.items():
            write_whole(file, content.encode())
        return list(files)

    def _ssv(self, values: dict[str, float]) -> str:
        """A parameter set of SSP 1.0, sec. 5.3."""
        root = ElementTree.Element(
            "ssv:ParameterSet", {"xmlns:ssv": SSV, "version": "1.0", "name": self.chosen.actuator}
        )
        inner = ElementTree.SubElement(root, "ssv:Parameters")
        for name, value in values.items():
            parameter = ElementTree.SubElement(inner, "ssv:Parameter", {"name": name})
            ElementTree.SubElement(parameter, "ssv:Real", {"value": repr(value)})
        ElementTree.indent(root)
        return ElementTree.tostring(root, "unicode", xml_declaration=True) + "\n"


def sample(chosen: ParameterSet, count: int, seed: int = 0) -> Samples:
    """Draw parameter sets from the estimates with their correlations, within bounds.

    Args:
        chosen: parameters with standard errors, as ``identify`` and ``diagnose`` write them.
        count: number of sets.
        seed: seed of the draws.

    Raises:
        UserError: no standard error, or bounds that hold next to none of the draws.

    Example:
        >>> import servo_models as sm
        >>> found = sm.identify("gimbal.toml").parameters
        >>> sm.sample(found, 100).values.shape[0]
        100
    """
    known = chosen.model().plant.parameters
    told = [it for it in chosen.estimates if it.standard_error]
    drawn = [it for it in told if np.isfinite(it.standard_error or 0.0)]
    if not drawn:
        raise UserError(
            f"'{chosen.file or chosen.actuator}' has no standard errors to draw from: give a file"
            " that identify or diagnose has written"
        )
    names = tuple(it.name for it in drawn)
    place = {name: k for k, name in enumerate(names)}
    correlation = np.eye(len(names))
    for first, second, value in chosen.correlations:
        if first in place and second in place:
            i, j = place[first], place[second]
            correlation[i, j] = correlation[j, i] = value
    errors = np.array([it.standard_error for it in drawn], dtype=float)
    low, high = (
        np.array([getattr(known[name].param, bound) for name in names]) for bound in ("low", "high")
    )
    sizes, axes = np.linalg.eigh(correlation)
    root = axes * np.sqrt(np.maximum(sizes, 0.0))
    random, kept = np.random.default_rng(seed), np.empty((0, len(names)))
    for _ in range(BATCHES):
        unit = random.standard_normal((count, len(names))) @ root.T
        values = np.array([it.value for it in drawn]) + errors * unit
        inside = np.all((values >= low) & (values <= high), axis=1)
        kept = np.vstack([kept, values[inside]])[:count]
        if len(kept) == count:
            held = tuple(it.name for it in told if it.name not in place)
            return Samples(chosen, names, kept, held)
    widest = names[int(np.argmax(errors / (high - low)))]
    raise UserError(
        f"next to no draw lies within all bounds: the standard error of '{widest}' is wider than"
        " they are; identify it from other logs, or give its range yourself"
    )


def check_suffix(path: Path) -> None:
    """Raise UserError unless a name ends as that of a file of samples does."""
    if path.suffix not in SUFFIXES:
        raise UserError(f"'{path}': let the name end in {', '.join(SUFFIXES)}")
