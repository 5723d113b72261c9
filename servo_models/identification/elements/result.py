"""What the elements of a servo were found to be, and the loop they make."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from servo_models.core.simulate import Model
from servo_models.identification.elements.estimate import Estimate
from servo_models.identification.elements.loop import Choice, Loop, Response
from servo_models.identification.elements.tables import Wish


@dataclass(frozen=True)
class Figure:
    """A figure of one element.

    Attributes:
        element: which, such as ``"motor"``.
        name: in words.
        estimate: in ``unit``.
        unit: SI.
        file: name of the file that it is from.
        display: unit that a person reads it in, "" for ``unit``.
    """

    element: str
    name: str
    estimate: Estimate
    unit: str
    file: str
    display: str = ""

    @property
    def value(self) -> float:
        return self.estimate.value

    @property
    def standard_error(self) -> float:
        return self.estimate.standard_error


@dataclass(frozen=True)
class Synthesis:
    """The closed loop of the elements.

    Attributes:
        loop: all but its feedback coefficient.
        wish: what it shall be.
        choices: of K_f, for the band of the wish first, then for the other usual one.
        rows: of the table of K_f, ascending.
    """

    loop: Loop
    wish: Wish
    choices: tuple[Choice, ...]
    rows: tuple[Response, ...]


@dataclass(frozen=True, eq=False)
class ElementsResult:
    """Elements of a servo, identified one by one.

    Attributes:
        model: the actuator with its nominal values.
        figures: every figure of every element.
        parameters: value and standard error [SI] of what they imply, by name of the
            actuator's parameter.
        synthesis: the loop and its feedback coefficient.
        notes: sentences on what was taken from where.
        warnings: sentences that whoever uses the values should know.
        files: SHA-256 of the bytes by name of the file.
    """

    model: Model
    figures: tuple[Figure, ...]
    parameters: Mapping[str, tuple[float, float]]
    synthesis: Synthesis
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    files: Mapping[str, str]

    def figure(self, element: str, name: str) -> Figure:
        """Return a figure by element and name."""
        return next(f for f in self.figures if (f.element, f.name) == (element, name))
