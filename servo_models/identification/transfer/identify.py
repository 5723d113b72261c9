"""Transfer functions of many structures from records and sweeps, and the one that will do."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from servo_models.core.plant import Wire, unknown
from servo_models.core.simulate import Model
from servo_models.data.log import Log
from servo_models.errors import UserError
from servo_models.identification.grey_box import Constant, PhysicalConstants, physical_constants
from servo_models.identification.result import Doubt
from servo_models.identification.transfer.choose import (
    Candidate,
    choose,
    score,
    warnings,
    with_criteria,
)
from servo_models.identification.transfer.fit import Fit, fit
from servo_models.identification.transfer.functions import STRUCTURES, Structure, TransferFunction
from servo_models.identification.transfer.measurements import (
    Measurement,
    Measurements,
    Record,
    Sweep,
)
from servo_models.report.result import Result

INTERRUPTED = Doubt(
    "interrupted: larger structures were not tried; the best of the others is chosen"
)


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
    ends = _wires(model, source, output)
    measurements = _measurements(logs, sweeps, ends)
    longest = max((float(e.times[-1]) for e in measurements if isinstance(e, Record)), default=None)
    used = [data for data in measurements if data.fitted.any()]
    fits, interrupted = _fits(structures, used, progress)
    tried = [Candidate(n, f, None, score(f, measurements)) for n, f in (given or {}).items()]
    tried += [
        Candidate(str(f.structure), f.function, f, score(f.function, measurements)) for f in fits
    ]
    judged = choose(with_criteria(tried, measurements), longest)
    chosen = next(c for c in judged if not c.reason)
    constants, vague = _grey_box(model, ends, judged, chosen, known_errors)
    warned = (
        *((INTERRUPTED,) if interrupted else ()),
        *_left_out(sweeps, ends),
        *warnings(chosen, judged, longest),
        *vague,
        *(constants.warnings if constants else ()),
    )
    return TransferResult(
        *ends, tuple(measurements), tuple(judged), chosen, constants, warned, interrupted
    )


def _wires(model: Model, source: str | None, output: str | None) -> tuple[Wire, Wire]:
    plant, place = model.plant, f"actuator '{model.actuator.name}'"
    inputs = {wire.name: wire for wire in plant.inputs}
    outputs = {name: plant.wire[name] for name in plant.outputs}
    first, last = source or model.actuator.step[0], output or plant.outputs[0]
    if first not in inputs:
        raise UserError(unknown("input", first, inputs, place))
    if last not in outputs:
        raise UserError(unknown("output", last, outputs, place))
    return inputs[first], outputs[last]


def _measurements(
    logs: Sequence[Log], sweeps: Sequence[Sweep], ends: tuple[Wire, Wire]
) -> list[Measurement]:
    source, output = ends
    rest = source.rest if isinstance(source.rest, float) else 0.0
    measurements: list[Measurement] = [
        Record.of(log, source.name, output.name, rest) for log in logs
    ]
    measurements += [s for s in sweeps if (s.source, s.output) == (source.name, output.name)]
    if not any(data.fitted.any() for data in measurements):
        raise UserError(
            f"nothing to fit from '{source.name}' to '{output.name}': give a log or a sweep of"
            " them that is not held out"
        )
    return measurements


def _left_out(sweeps: Sequence[Sweep], ends: tuple[Wire, Wire]) -> tuple[str, ...]:
    source, output = (wire.name for wire in ends)
    return tuple(
        f"'{sweep.name}' is from '{sweep.source}' to '{sweep.output}', and is left out of what is"
        f" fitted from '{source}' to '{output}'"
        for sweep in sweeps
        if (sweep.source, sweep.output) != (source, output)
    )


def _fits(
    structures: Iterable[Structure],
    measurements: Measurements,
    progress: Callable[[str], None],
) -> tuple[list[Fit], bool]:
    """Fit every structure, the small ones first since they are starts of the larger ones.

    Whoever interrupts gets those that are done, and True.
    """
    rows = min(int(np.sum(data.fitted)) for data in measurements)
    done: dict[Structure, Fit] = {}
    for structure in sorted(structures, key=lambda s: (s.poles, s.delay, s.zeros)):
        if structure.size >= rows:
            continue
        smaller = [done[s].function for s in _parents(structure) if s in done]
        try:
            progress(str(structure))
            fitted = fit(structure, measurements, smaller)
        except KeyboardInterrupt:
            if not done:
                raise
            return list(done.values()), True
        if fitted:
            done[structure] = fitted
    return list(done.values()), False


def _parents(structure: Structure) -> tuple[Structure, ...]:
    n, m = structure.poles, structure.zeros
    parents = [replace(structure, poles=n - 1), replace(structure, zeros=m - 1)]
    if structure.delay:
        parents.append(replace(structure, delay=False))
    return tuple(p for p in parents if p.zeros >= 0)


def _grey_box(
    model: Model,
    ends: tuple[Wire, Wire],
    candidates: Sequence[Candidate],
    chosen: Candidate,
    known_errors: Mapping[str, float] | None,
) -> tuple[PhysicalConstants | None, tuple[str, ...]]:
    """Constants from the candidate that the actuator's grey box solves, chosen or not; and what
    to say of it."""
    box = model.actuator.grey_box
    if not box or (box.source, box.output) != tuple(wire.name for wire in ends):
        return None, ()
    order = box.poles
    shaped = [c for c in candidates if c.fit and _all_pole(c.function.structure, order)]
    sound = [c for c in shaped if not c.fault]
    if not sound:
        faults = "; ".join(f"'{c.name}': {c.fault}" for c in shaped) or "none was asked for"
        return None, (
            f"no physical constants, since no function of order {order} will do ({faults})",
        )
    taken = chosen if chosen in sound else min(sound, key=lambda c: c.bic)
    assert taken.fit
    physical, moved = _inside(
        physical_constants(
            box, taken.fit.coefficients, model.values, taken.fit.covariance, known_errors
        ),
        model,
        box.delay,
    )
    if taken is chosen:
        return physical, moved
    return physical, (
        *moved,
        f"the physical constants are those of '{taken.name}', which the data do not prefer:"
        f" {taken.reason}",
    )


def _inside(
    physical: PhysicalConstants, model: Model, delay: str
) -> tuple[PhysicalConstants, tuple[str, ...]]:
    """Constants that the actuator takes: no delay where the function has none, and those beyond
    a bound on it, with what to say of these."""
    known, constants = model.plant.parameters, dict(physical.constants)
    texts: list[Doubt] = []
    if model.values.get(delay):
        constants.setdefault(delay, Constant(delay, 0.0, None))
    for name, constant in constants.items():
        low, high = known[name].param.low, known[name].param.high
        if not low <= constant.value <= high:
            value = min(max(constant.value, low), high)
            constants[name] = replace(constant, value=value, standard_error=None)
            unit = known[name].param.unit
            texts.append(
                Doubt(
                    f"'{name}' was found at {constant.value:.3g} {unit} and is taken as {value:g},"
                    " on its bound: the constants no longer make this function; check those that"
                    " are known"
                )
            )
    return replace(physical, constants=constants), tuple(texts)


def _all_pole(structure: Structure, order: int) -> bool:
    return (structure.poles, structure.zeros) == (order, 0)
