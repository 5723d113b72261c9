"""An FMU of ours under validation, and the model that it says it is."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path

from servo_models.catalogue import model, of_catalogue
from servo_models.core.plant import Actuator
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.fmu.fmu import LIMITS, Fmu, Instance, Limits

ANY = "it is of another maker: name a --reference ref.csv, or take --static-only"


class Subject(Fmu):
    """An FMU of ours, and the model that it says it is, with the start values as parameters.

    The model description names the actuator and holds every parameter's start value; the
    variant is the one that differs from these in the fewest parameters.
    """

    strict = True

    def __init__(
        self, path: str | Path, own: Actuator | None = None, limits: Limits = LIMITS
    ) -> None:
        """Unpack and read an FMU, of the actuator ``own`` if that is not in the catalogue.

        Raises:
            UserError: no such file, no FMU, one too large, or one of an unknown actuator.
        """
        super().__init__(path, limits)
        try:
            self.model = self._named_model(own)
        except UserError as error:
            self.close()
            raise UserError(f"FMU '{path}': {error}") from error
        self.over = self._unlike_its_model() or self.over

    def _understand(self) -> None:
        super()._understand()
        self._starts = {
            v.name: float(v.start)
            for v in self.description.modelVariables
            if v.causality == "parameter" and v.type in ("Real", "Float64")
        }

    def run(self, chosen: Model, times: Array, inputs: Array) -> Array:
        """Return what ``chosen.run`` returns, with the FMU at the parameters of ``chosen``.

        Raises:
            FmuError: it stops, or its process does.
        """
        with self.instance(chosen.values, float(times[0]), inputs[0]) as running:
            return running.drive(times, inputs)

    def instance(
        self, values: Mapping[str, float], start: float, inputs: Array
    ) -> AbstractContextManager[Instance]:
        """Return an instance, see ``Fmu.started``, with a row of inputs of the plant."""
        plant = self.model.plant
        given = dict(zip((wire.name for wire in plant.inputs), inputs))
        return self.started(values, start, given, plant.outputs)

    def _unlike_its_model(self) -> str:
        """Why it cannot be run as that, by its description."""
        plant = self.model.plant
        wanted = {wire.name for wire in plant.inputs} | {*plant.outputs, *plant.parameters}
        named = {v.name for v in self.variables.values() if v.causality != "independent"}
        if unlike := sorted(wanted ^ named):
            names = ", ".join(repr(name[:60]) for name in unlike[:3])
            more = f" and {len(unlike) - 3} more" if len(unlike) > 3 else ""
            cure = "build it again with this version" if self.is_ours else ANY
            return (
                f"has not the variables of actuator '{self.model.actuator.name}'"
                f" ({names}{more}): {cure}"
            )
        return ""

    def _named_model(self, own: Actuator | None) -> Model:
        """Find the variant and the parameters by the start values."""
        name = self.description.modelName
        actuator = own if own and own.name == name else of_catalogue(name)
        differing = {
            variant.name: sum(
                value != self._starts.get(name)
                for name, value in actuator.values(variant.name).items()
            )
            + len(self._starts.keys() - actuator.plant_of(variant.name).parameters.keys())
            for variant in actuator.variants
        }
        variant = min(differing, key=lambda name: differing[name])
        known = actuator.plant_of(variant).parameters
        return model(actuator, variant, {n: v for n, v in self._starts.items() if n in known})
