"""What the JSON of a diagnosis holds: ``schema.json`` is made from this."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar

from msgspec import Meta

from servo_models.data.sensor import Floor
from servo_models.diagnosis import verdict
from servo_models.diagnosis.localisation import Breakdown
from servo_models.diagnosis.residual_map import WORDS
from servo_models.diagnosis.stretches import HeldOut, UnseenOutput
from servo_models.report.document import (
    Digest,
    Document,
    Figure,
    Magnitude,
    Share,
    about,
    choice,
    constant,
)

VERSION = 3  # it counts up when a reader of the one before would go wrong
KINDS = (
    verdict.NO_GAP,
    verdict.PARAMETERS,
    verdict.EFFECT,
    verdict.EFFECTS,
    verdict.OUTSIDE,
    verdict.NOT_IDENTIFIABLE,
)

Positive = Annotated[float, Meta(gt=0)]
Names = Sequence[str]
SomeNames = Annotated[Names, Meta(min_length=1)]
Interval = Annotated[tuple[Figure, Figure], about("95 %.")]
Block = Annotated[str, about("Wire on which it acts.")]


class Stages(Document, frozen=True):
    before: Figure
    after: Figure


class Intervals(Document, frozen=True):
    before: Interval
    retuned: Interval
    after: Interval


class Reduction(Document, frozen=True):
    """RMS errors on blocks of time that the fit of each stage left out: ``held_out`` is of these,
    and not of what the description holds out. ``closed`` is (before - after) / (before - floor);
    null where there is nothing to close."""

    before: Magnitude
    retuned: Magnitude
    after: Magnitude
    floor: Annotated[Positive, about("Noise floor.")]
    unit: str
    held_out: Annotated[bool, constant(True)]
    intervals: Intervals
    closed: Figure
    closed_interval: Interval


class Worst(Document, frozen=True):
    """Log and time [s] of the largest error before."""

    log: str
    time: float


class OutputGap(Reduction, frozen=True):
    """In SI. ``delay`` [s] is the shift of the simulation that takes most of the gap before away;
    positive: the rig lags."""

    floor_origin: Annotated[str, about("What the noise floor is from.")]
    nrmse: Annotated[Figure, about("Error before over the measured range.")]
    delay: Figure
    worst: Worst


class WholeGap(Reduction, frozen=True):
    """All outputs together, in noise floors."""

    outputs: Annotated[dict[str, OutputGap], Meta(min_length=1)]


class ConfirmedOutput(Document, frozen=True):
    """``held_out`` are samples that the description holds out; null where it holds out none."""

    unit: str
    fit: Stages
    held_out: Stages


class Confirmed(Document, frozen=True):
    """RMS [SI] by one run over each log: before of the nominal model, after of the FMU with the
    diagnosed parameters, run in a process of its own. null where the FMU cannot be run; a warning
    says why. ``difference`` is the largest one between FMU and simulation over full scale; 0: equal
    to the last bit."""

    difference: Magnitude
    outputs: dict[str, ConfirmedOutput]


class Value(Document, frozen=True):
    """A parameter. ``standard_error`` is null on a bound, or where the logs do not determine it."""

    name: str
    prior: float
    value: float
    standard_error: Figure
    unit: str
    doubt: Annotated[str, about("Why its value is doubtful.")]


class Parameter(Value, frozen=True):
    """A parameter that was free in the diagnosed model; ``retuned`` without any effect, null where
    it was not free then."""

    retuned: Figure
    prior_deviations: Annotated[Figure, about("How far it moved; null without a prior.")]


class Effect(Document, frozen=True):
    """An effect that was fitted, the most likely first."""

    name: str
    block: Block
    model_weight: Annotated[
        Share | None,
        about(
            "Share of the fitted models of as many effects as were taken that have it, each with"
            " its weight: it ranks and is surer than it should be. null where none of them has it,"
            " and where parameters alone were taken."
        ),
    ]
    probability: Annotated[
        Share | None,
        about(
            "That it is among the causes: how often effects with such a model weight were there on"
            " withheld rigs. Several may be there, so these need not add up to 1. null without a"
            " model weight, where the search was stopped, and outside the catalogue, where model"
            " weights rank effects none of which explains all."
        ),
    ]
    in_set: Annotated[
        bool,
        about("It cannot be told apart or, where parameters explain the gap, they may mask it."),
    ]
    taken: Annotated[bool, about("Whether the gap after, the parameters and the FMU are with it.")]
    parameters: Annotated[list[Value], about("In the best explanation that has it.")]
    gap_after: Annotated[Figure, about("Noise floors that this explanation leaves on blocks.")]
    closed: Annotated[Figure, about("Share of the reducible gap that it closes.")]
    converged: bool
    detectability: Annotated[
        Figure,
        about("How far it moves the outputs [noise floors] beyond what parameters imitate."),
    ]
    beside: Annotated[Names, about("The other effects of that explanation.")]


class FittedEffects(Document, frozen=True):
    effects: SomeNames
    model_weight: Share


class Choice(Document, frozen=True):
    """``count`` of the effects, which exchange for each other while the rest stays, are in each
    model. ``family`` is what all of them are, such as friction; empty where they are of several."""

    family: str
    count: Annotated[int, Meta(ge=1)]
    effects: SomeNames


class ConfidenceSet(Document, frozen=True):
    """Fitted models that cannot be told apart, the likeliest first; their model weights add up to 1
    with those outside the set. The same as ``alternatives``, of which one holds: each is a list of
    choices, all of which are made."""

    models: list[FittedEffects]
    alternatives: list[Annotated[list[Choice], Meta(min_length=1)]]


class RuledOut(Document, frozen=True):
    """An effect that is neither named nor imitated, and why."""

    name: str
    reason: str


class Masked(Document, frozen=True):
    """An effect that may be there and not show, since re-tuned parameters imitate it in these logs,
    the largest first; none unless parameters are said to explain the gap. ``up_to`` is how far it
    moves the outputs [RMS, noise floors] at the largest size found at which it does not show; more
    than the tolerance, and than 1."""

    name: str
    block: Block
    up_to: Positive


class MapCurve(Document, frozen=True):
    """It goes straight between its knots and is held at its ends."""

    of: Annotated[str, choice(*WORDS)]
    wire: str
    unit: Annotated[str, about("Of the knots.")]
    knots: list[float]
    values: Annotated[list[float], about("In the unit of the map.")]
    standard_errors: list[float]
    samples: Annotated[list[int], about("Nearest to each knot; 0: nothing is known there.")]


class LearntMap(Document, frozen=True):
    """What is left outside the catalogue, learnt as a shape; null where nothing is left, or no
    shape holds on blocks that a fit left out, whose RMS [noise floors] are ``before`` and
    ``after``. It is the sum of ``curves``; effects ``beside`` it may hold a part of the shape.
    ``parameters`` [SI] are of the diagnosed model with the map, all fitted together."""

    block: Block
    unit: str
    text: Annotated[str, about("What it looks like.")]
    before: float
    after: float
    beside: Names
    curves: Annotated[list[MapCurve], Meta(min_length=1)]
    parameters: dict[str, float]


class ExplainedPart(Document, frozen=True):
    """A log, or a half of one, of which parameters of its own leave far less than all together do,
    with the one that differs most [SI]: two actuators, or one that was changed. None otherwise."""

    log: str
    half: Annotated[str, choice("first", "second")] | None
    parameter: str
    value: float
    standard_error: Figure
    left: Annotated[float, about("RMS in noise floors.")]
    sure: Annotated[bool, about("No part leaves more than noise.")]


class Explanation(Document, frozen=True):
    effects: Annotated[Names, about("None for parameters alone.")]
    weight: Annotated[Share, about("Probability among these.")]


class Pair(Document, frozen=True):
    right: Annotated[Names, about("Effects of the explanation that is right.")]
    model: Annotated[Names, about("Effects of another one.")]
    leaves: Annotated[Figure, about("Expected to be left of the log, re-fitted [noise floors].")]
    ruled_out: Annotated[bool, about("Whether that would rule it out.")]


class NextExperiment(Document, frozen=True):
    """What tells apart the explanations left, none where only one is: the cheapest that decides as
    well as any, then others that do without what it needs. ``file`` is the table of the command,
    beside the JSON file or the report, null where neither is written; a Python file of the same
    name plays it."""

    explanations: Annotated[list[Explanation], Meta(min_length=2)]
    pairs: list[Pair]
    text: Annotated[str, about("Instruction.")]
    input: Annotated[str, about("Input that is played.")]
    unit: str
    constants: Annotated[dict[str, float], about("Inputs and parameters [SI] that hold meanwhile.")]
    changed: Annotated[
        list[dict[str, float]], about("Those of further logs of the same command, one each.")
    ]
    outputs: Annotated[Names, about("What is logged.")]
    decides: Annotated[Share, about("Probability expected to be left to the right one.")]
    duration: Annotated[Positive, about("Of a log [s].")]
    seconds: Annotated[Positive, about("That all of it takes, about.")]
    file: str | None


class ReadOutput(Document, frozen=True):
    """``clipped`` is the share of the samples held at an extreme while the command moves on."""

    unit: str
    low: float
    high: float
    step: Annotated[float, about("Smallest common step, 0 for none.")]
    clipped: float
    stale: Annotated[float, about("Share of the moving samples that repeat the one before.")]
    floor: Floor


class AuditedLog(Document, frozen=True):
    """``notes`` say what reading has changed of the file, such as times put back on an even
    grid."""

    name: str
    file: str
    sha256: Digest
    samples: int
    duration: float
    step: Annotated[float, about("Mean time between samples.")]
    jitter: Annotated[float, about("Standard deviation of that time.")]
    gaps: Annotated[int, about("Places where samples are missing.")]
    at_rest: Annotated[float, about("Share of the samples in which nothing moves.")]
    notes: Sequence[str]
    readings: Annotated[dict[str, ReadOutput], about("Outputs as they were read, by name.")]


class SourceFile(Document, frozen=True):
    """The description, by which ``servo-models compare`` finds the logs; null for one in memory."""

    file: str
    sha256: Digest


class DiagnosisDocument(Document, frozen=True):
    """Figures are SI with their unit beside them, or noise floors. null is a figure that does not
    exist."""

    title: ClassVar[str] = f"servo-models diagnose --json, schema_version {VERSION}"

    schema_version: Annotated[int, constant(VERSION)]
    description: SourceFile | None
    actuator: str
    variant: str
    verdict: Annotated[str, choice(*KINDS)]
    sentence: Annotated[str, Meta(min_length=1)]
    not_asserted: Annotated[str, about("Why the effects taken are not said to explain the gap.")]
    tolerance: Annotated[Magnitude, about("Gap in noise floors that counts as none.")]
    settings: Annotated[
        dict[str, Magnitude],
        about("Fields of servo_models.Settings, which decided the verdict.", min_length=1),
    ]
    gap: WholeGap
    confirmation: Confirmed | None
    effects: list[Effect]
    confidence_set: ConfidenceSet
    ruled_out: list[RuledOut]
    masked: list[Masked]
    parameters: list[Parameter]
    residual_map: LearntMap | None
    between_rows: Annotated[
        bool,
        about("It explains the logs only if commands were sent before the rows that have them."),
    ]
    parts: list[ExplainedPart]
    held_out: Sequence[HeldOut]
    held_out_outputs: Annotated[
        dict[str, UnseenOutput], about("All logs of held_out together, by output.")
    ]
    localisation: Sequence[Breakdown]
    next_experiments: list[NextExperiment]
    repeats_wanted: Annotated[
        str | None, about("Instruction, where only repeats tell noise from structure.")
    ]
    unfinished: Annotated[
        list[str],
        about(
            "What was not tried, or not to the end, since the diagnosis was stopped by a time"
            " limit, Ctrl-C or --quick; none if it was not. With any, verdict and effects are the"
            " best so far."
        ),
    ]
    warnings: list[str]
    seed: int
    versions: dict[str, str]
    logs: Annotated[list[AuditedLog], Meta(min_length=1)]
