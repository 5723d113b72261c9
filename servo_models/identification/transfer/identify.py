"""Transfer functions of many structures from records and sweeps, and the one that will do."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from servo_models.core.plant import GreyBox, Wire, unknown
from servo_models.core.simulate import Model
from servo_models.data.log import Log
from servo_models.errors import UserError
from servo_models.identification.grey_box import Constant, PhysicalConstants, physical_constants
from servo_models.identification.result import Doubt
from servo_models.identification.transfer.choose import Candidate, choose, warnings
from servo_models.identification.transfer.fit import fit
from servo_models.identification.transfer.functions import STRUCTURES, Structure, TransferFunction
from servo_models.identification.transfer.measurements import (
    Measurement,
    Measurements,
    Record,
    Sweep,
)
from servo_models.report.result import Result


@dataclass(frozen=True, eq=False, repr=False)
class TransferResult(Result):
    """All candidates with verdicts, and the one chosen.

    Attributes:
        source, output: wires that the functions connect.
        measurements: records and frequency responses.
        candidates: in order of size, given ones first.
        chosen: the one without a reason against it.
        constants: physical constants, where the actuator has a grey box.
        warnings: sentences.
        interrupted: not every structure was tried.
    """

    source: Wire
    output: Wire
    measurements: tuple[Measurement, ...]
    candidates: tuple[Candidate, ...]
    chosen: Candidate
    constants: PhysicalConstants | None = None
    warnings: tuple[str, ...] = ()
    interrupted: bool = False


def identify_transfer(
    logs: Sequence[Log] = (),
    sweeps: Sequence[Sweep] = (),
    *,
    model: Model,
    source: str | None = None,
    output: str | None = None,
    structures: Iterable[Structure] = STRUCTURES,
    given: Mapping[str, TransferFunction] | None = None,
    known_errors: Mapping[str, float] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> TransferResult:
    """Identify the transfer function between two signals of an actuator.

    Args:
        logs: time records; ``held_out`` samples score, all others fit.
        sweeps: frequency responses; fitted together with the logs, each weighted by its
            own noise.
        model: says what the signals are, and the known constants of a grey box.
        source, output: names of input and output; default the actuator's main input and
            first output.
        structures: to be fitted.
        given: transfer functions to be judged beside the fitted ones, SI.
        known_errors: standard errors of the grey box's known constants, SI by parameter.
        progress: is told the name of each structure before its fit.

    Raises:
        UserError: an unknown signal, no data of it, or no structure that is fit for use.
    """
    plant, place = model.plant, f"actuator '{model.actuator.name}'"
    inputs = {wire.name: wire for wire in plant.inputs}
    outputs = {name: plant.wire[name] for name in plant.outputs}
    source, output = source or model.actuator.step[0], output or plant.outputs[0]
    if source not in inputs:
        raise UserError(unknown("input", source, inputs, place))
    if output not in outputs:
        raise UserError(unknown("output", output, outputs, place))
    rest = inputs[source].rest
    rest = rest if isinstance(rest, float) else 0.0
    measurements: list[Measurement] = [Record.of(log, source, output, rest) for log in logs]
    measurements += [s for s in sweeps if (s.source, s.output) == (source, output)]
    if not any(data.fitted.any() for data in measurements):
        raise UserError(
            f"nothing to fit from '{source}' to '{output}': give a log or a sweep of them that is"
            " not held out"
        )
    longest = max((float(e.times[-1]) for e in measurements if isinstance(e, Record)), default=None)
    used = [data for data in measurements if data.fitted.any()]
    tried = [Candidate.of(n, f, None, measurements) for n, f in (given or {}).items()]
    fits, interrupted = _fits(structures, used, progress)
    tried += [Candidate.of(str(s), *fitted, measurements) for s, fitted in fits.items()]
    candidates = choose(tried, measurements, longest)
    chosen = next(c for c in candidates if not c.reason)
    box = model.actuator.grey_box
    constants, doubts = None, list[str]()
    if box and (box.source, box.output) == (source, output):
        constants, doubts = _constants(model, box, candidates, chosen, known_errors)
    told = "interrupted: larger structures were not tried; the best of the others is chosen"
    return TransferResult(
        inputs[source],
        outputs[output],
        tuple(measurements),
        tuple(candidates),
        chosen,
        constants,
        warnings=(
            *[Doubt(told)] * interrupted,
            *(
                f"'{sweep.name}' is from '{sweep.source}' to '{sweep.output}', and is left out of"
                f" what is fitted from '{source}' to '{output}'"
                for sweep in sweeps
                if (sweep.source, sweep.output) != (source, output)
            ),
            *warnings(chosen, candidates, longest),
            *doubts,
            *(constants.warnings if constants else ()),
        ),
        interrupted=interrupted,
    )


def _fits(
    structures: Iterable[Structure],
    measurements: Measurements,
    progress: Callable[[str], None],
) -> tuple[dict[Structure, tuple[TransferFunction, np.ndarray]], bool]:
    """Fit every structure, the small ones first since they are starts of the larger ones.

    Whoever interrupts gets those that are done, and True.
    """
    rows = min(int(np.sum(data.fitted)) for data in measurements)
    done: dict[Structure, tuple[TransferFunction, np.ndarray]] = {}
    for structure in sorted(structures, key=lambda s: (s.poles, s.delay, s.zeros)):
        if structure.size >= rows:
            continue
        n, m = structure.poles, structure.zeros
        parents = [replace(structure, poles=n - 1), replace(structure, zeros=m - 1)]
        parents += [replace(structure, delay=False)] if structure.delay else []
        try:
            progress(str(structure))
            smaller = [done[parent][0] for parent in parents if parent in done]
            fitted = fit(structure, measurements, smaller)
        except KeyboardInterrupt:
            if not done:
                raise
            return done, True
        if fitted:
            done[structure] = fitted
    return done, False


def _constants(
    model: Model,
    box: GreyBox,
    candidates: Sequence[Candidate],
    chosen: Candidate,
    known_errors: Mapping[str, float] | None,
) -> tuple[PhysicalConstants | None, list[str]]:
    """Constants from the candidate that the grey box solves, chosen or not, within the bounds of
    the actuator; and what to say of them."""
    fitted = [(c, c.function.structure) for c in candidates if c.covariance is not None]
    shaped = [c for c, shape in fitted if (shape.poles, shape.zeros) == (box.poles, 0)]
    sound = [c for c in shaped if not c.fault]
    if not sound:
        faults = "; ".join(f"'{c.name}': {c.fault}" for c in shaped) or "none was asked for"
        return None, [
            f"no physical constants, since no function of order {box.poles} will do ({faults})"
        ]
    taken = chosen if chosen in sound else min(sound, key=lambda c: c.bic)
    physical = physical_constants(
        box, taken.function.coefficients, model.values, taken.covariance, known_errors
    )
    constants, doubts = dict(physical.constants), list[str]()
    if model.values.get(box.delay):  # of the variant, which would stay where the function has none
        constants.setdefault(box.delay, Constant(box.delay, 0.0, None))
    for name, constant in constants.items():
        param = model.plant.parameters[name].param
        value = min(max(constant.value, param.low), param.high)
        if value != constant.value:
            constants[name] = replace(constant, value=value, standard_error=None)
            text = (
                f"'{name}' was found at {constant.value:.3g} {param.unit} and is taken as"
                f" {value:g}, on its bound: the constants no longer make this function; check those"
                " that are known"
            )
            doubts.append(Doubt(text))
    if taken is not chosen:
        doubts.append(
            f"the physical constants are those of '{taken.name}', which the data do not prefer:"
            f" {taken.reason}"
        )
    return replace(physical, constants=constants), doubts
