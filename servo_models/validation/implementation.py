"""The claim *implementation*: an FMU equals the simulation in this process."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from xml.etree import ElementTree

import numpy as np

from fmu_src.description import model_description, token_of
from fmu_src.native.archive import form_of
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.fmu.archive import DESCRIPTION
from servo_models.validation.fmu_subject import Subject
from servo_models.validation.rows import IMPLEMENTATION, Row, failure, judged

Element = tuple[str, dict[str, str]]  # tag and attributes of an element of a description

LIMIT = 1e-12  # largest difference of an output over its full scale; the aim is 0, bit for bit
STEPS = (0.7e-3, 1e-3, 3.3e-3, 20e-3)
"""Communication steps [s]; 0.7 and 3.3 ms are no multiples of any internal step."""
ROWS = 241  # communication points of a run


def implementation_rows(subject: Subject) -> list[Row]:
    """Compare an FMU with its model on several grids, over a restore, and beside another.

    The first row counts the problems that ``fmpy validate`` finds in its description.
    """
    rows = [_description_row(subject)]
    comparisons: list[tuple[str, Callable[[], float]]] = [
        *((f"communication step {1e3 * step:g} ms", _steady(subject, step)) for step in STEPS),
        ("irregular communication steps", lambda: _compared(subject, irregular(ROWS))),
        ("saved and restored in mid-run", lambda: _restored(subject, same_instance=True)),
        ("restored into another instance", lambda: _restored(subject, same_instance=False)),
        ("two instances at once", lambda: _two_at_once(subject)),
    ]
    for case, compare in comparisons:
        where = (subject.model.actuator.name, subject.model.variant, case)
        try:
            value = compare()
        except UserError as error:
            rows.append(failure(IMPLEMENTATION, where, str(error), subject.name))
            if subject.over:
                break
            continue
        note = "equal bit for bit" if value == 0.0 else "not bit for bit"
        quantity = "largest difference of any output"
        rows.append(judged(IMPLEMENTATION, where, quantity, value, LIMIT, "1", note, subject.name))
    return rows


def _description_row(subject: Subject) -> Row:
    """Problems that fmpy finds in the description, and differences from how we write it."""
    from fmpy.validation import validate_fmu

    problems = [str(problem) for problem in validate_fmu(str(subject.folder))]
    problems += _unlike_ours(subject)
    where = (subject.model.actuator.name, subject.model.variant, "model description")
    note = subject.clean("; ".join(problems)) if problems else "no problem"
    quantity = "problems, fmpy's validation included"
    count = float(len(problems))
    return judged(IMPLEMENTATION, where, quantity, count, 0.0, "1", note, subject.name)


def _unlike_ours(subject: Subject) -> list[str]:
    """Differences of a description from the one that this version writes of the same model.

    Descriptions in words and the origin of the build do not count.
    """
    description = ElementTree.parse(subject.folder / DESCRIPTION).getroot()
    form, identity = form_of(subject.folder)
    wanted = ElementTree.fromstring(model_description(subject.model, form, identity, ""))
    problems = []
    version = form.version
    if description.get(version.token) != token_of(description, identity, version):
        problems.append(f"'{version.token}' is not that of this description and this code")
    for part in ("CoSimulation", "UnitDefinitions", "ModelVariables", "ModelStructure"):
        ours, theirs = (_elements(root, part) for root in (wanted, description))
        if ours != theirs:
            nothing: Element = ("nothing", {})
            pairs = itertools.zip_longest(ours, theirs, fillvalue=nothing)
            expected, actual = next((a, b) for a, b in pairs if a != b)
            problems.append(f"{part} is not that of the actuator: {_difference(expected, actual)}")
    return problems


def _elements(root: ElementTree.Element, part: str) -> list[Element]:
    """Every element of a part of a description, without descriptions in words."""
    return [
        (element.tag, {name: v for name, v in element.attrib.items() if name != "description"})
        for parent in root.iter(part)
        for element in parent.iter()
    ]


def _difference(wanted: Element, actual: Element) -> str:
    (tag, ours), (other, theirs) = wanted, actual
    names = [name for name in (*ours, *theirs) if ours.get(name) != theirs.get(name)]
    if tag != other or not names:
        return f"{other} in place of {tag}"
    name = names[0]
    which = f" '{ours['name']}'" if "name" in ours else ""
    return f"{tag}{which} has {name} {theirs.get(name)}, not {ours.get(name)}"


def irregular(rows: int) -> Array:
    """Return times [s] whose steps vary from 0.2 to 5.2 ms without ever repeating."""
    steps = 0.2e-3 + 5e-3 * np.modf(np.arange(1, rows) * 0.6180339887498949)[0]
    return np.concatenate([[0.0], np.cumsum(steps)])


def input_signals(model: Model, times: Array, seed: int = 1, held: int = 20) -> Array:
    """Return inputs, shape (n, inputs), that jump at random within their working range.

    They jump every ``held`` rows.
    """
    random = np.random.default_rng(seed)
    columns = []
    for wire in model.plant.inputs:
        rest, spread = float(wire.rest), 0.5 * wire.scale
        levels = np.clip(
            rest + spread * random.uniform(-1.0, 1.0, 1 + len(times) // held), wire.low, wire.high
        )
        columns.append(levels[np.arange(len(times)) // held])
    return np.column_stack(columns)


def difference(expected: Array, got: Array) -> float:
    """Return the largest difference of any output over that output's largest value."""
    scale = np.maximum(np.max(np.abs(expected), axis=0), np.finfo(float).tiny)
    return float(np.max(np.abs(got - expected) / scale))


def _steady(subject: Subject, step: float) -> Callable[[], float]:
    return lambda: _compared(subject, step * np.arange(ROWS, dtype=float))


def _compared(subject: Subject, times: Array) -> float:
    inputs = input_signals(subject.model, times)
    expected = subject.model.run(times, inputs)
    return difference(expected, subject.run(subject.model, times, inputs))


def _restored(subject: Subject, same_instance: bool) -> float:
    """Save the state in the middle, run on, restore it, and finish the run again."""
    times = irregular(ROWS)
    inputs, middle = input_signals(subject.model, times), ROWS // 2
    expected = subject.model.run(times, inputs)
    values, start = subject.model.values, float(times[0])
    with (
        subject.instance(values, start, inputs[0]) as spoiled,
        subject.instance(values, start, inputs[0]) as other,
    ):
        spoiled.drive(times[: middle + 1], inputs)
        saved = spoiled.saved()
        spoiled.drive(times, inputs, first=middle)
        resumed = spoiled if same_instance else other
        resumed.restore(saved)
        return difference(expected[middle:], resumed.drive(times, inputs, first=middle))


def _two_at_once(subject: Subject) -> float:
    """Step two instances in turn with different inputs."""
    times = irregular(ROWS)
    both = [input_signals(subject.model, times, seed) for seed in (1, 2)]
    start, values = float(times[0]), subject.model.values
    with (
        subject.instance(values, start, both[0][0]) as first,
        subject.instance(values, start, both[1][0]) as second,
    ):
        outs = [[first.outputs()], [second.outputs()]]
        for k in range(ROWS - 1):
            for instance, inputs, out in zip((first, second), both, outs):
                instance.step(float(times[k]), float(times[k + 1] - times[k]), inputs[k])
                out.append(instance.outputs())
    expected = [subject.model.run(times, inputs) for inputs in both]
    return max(difference(e, np.array(out)) for e, out in zip(expected, outs))
