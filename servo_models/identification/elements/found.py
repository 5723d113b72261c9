"""What has been found so far, while the elements are identified one after the other."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from servo_models.core.plant import check_bounds
from servo_models.core.simulate import Model
from servo_models.errors import UserError
from servo_models.identification.elements.estimate import Estimate, exactly
from servo_models.identification.elements.result import Figure
from servo_models.identification.elements.tables import Table


@dataclass(eq=False)
class Found:
    """Figures, and the parameters [SI] that they imply; see ``result.ElementsResult``.

    Attributes:
        model: nominal values, which stand in for elements without a table.
        dynamic_gain: of the motor from the record of a step [rad/s/V], None without.
    """

    model: Model
    figures: list[Figure] = field(default_factory=list)
    parameters: dict[str, Estimate] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    files: dict[str, str] = field(default_factory=dict)
    dynamic_gain: Estimate | None = None

    def add(
        self,
        entry: tuple[str, str],
        name: str,
        estimate: Estimate | None,
        unit: str,
        display: str = "",
    ) -> None:
        """Keep a figure of ``entry``, its element and its file; None is none."""
        if estimate:
            element, file = entry
            self.figures.append(Figure(element, name, estimate, unit, file, display))

    def set(self, name: str, estimate: Estimate | None, place: str) -> None:
        """Keep a parameter [SI] from the table at ``place``.

        Raises:
            UserError: it is out of its bounds.
        """
        if estimate is None:
            return
        try:
            check_bounds(self.model.plant.parameters[name], estimate.value)
        except UserError as error:
            raise UserError(f"{place}: {error}, or correct unit, scale and sign") from error
        self.parameters[name] = estimate

    def set_size(self, name: str, estimate: Estimate | None, place: str) -> None:
        """Keep a parameter that cannot be below 0: an estimate below is taken as 0."""
        if estimate and estimate.value < 0.0:
            self.warnings.append(f"'{name}' was found at {estimate.value:.3g} and is taken as 0")
            estimate = Estimate(0.0, estimate.standard_error, estimate.low, estimate.high)
        self.set(name, estimate, place)

    def value(self, name: str) -> Estimate:
        """A parameter, of the model where no table tells it."""
        return self.parameters.get(name) or exactly(self.model.values[name])

    def read(self, element: str, table: Table) -> tuple[str, str]:
        """Keep the hash of a table's file; return element and file for its figures."""
        self.files[table.path.name] = table.sha256
        return element, table.path.name


@contextmanager
def at(table: Table) -> Iterator[None]:
    """Say in errors which table they are about."""
    try:
        yield
    except UserError as error:
        raise UserError(f"{table.place}: {error}") from error
