"""What a diagnosis found, complete: printed, saved and drawn from here."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from servo_models.core.simulate import Model
from servo_models.data.audit import Audit
from servo_models.data.log import Log
from servo_models.data.parameters import Parametrised
from servo_models.data.plotjuggler import LAYOUT, Topic, write_layout, write_mcap
from servo_models.diagnosis import design
from servo_models.diagnosis.ambiguity import Slot, alternatives
from servo_models.diagnosis.confirm import Confirmation
from servo_models.diagnosis.gap import Gap, GapSummary
from servo_models.diagnosis.localisation import Breakdown, localise
from servo_models.diagnosis.ranking import RankedEffect, Value, doubted, estimates
from servo_models.diagnosis.residual_map import ResidualMap
from servo_models.diagnosis.search.fitting import FittedModel
from servo_models.diagnosis.search.masking import MaskedEffect
from servo_models.diagnosis.search.selection import Selection
from servo_models.diagnosis.settings import Settings
from servo_models.diagnosis.stretches import HeldOut, Part, contradicted, gains
from servo_models.diagnosis.verdict import (
    NO_GAP,
    PARAMETERS,
    Verdict,
    parameters_explain,
    weights_by_effects,
)
from servo_models.files import write_with
from servo_models.identification.readings import Reading, reading
from servo_models.identification.resolution import BLAMED, ROW, Blur, could_carry
from servo_models.report.result import Result

if TYPE_CHECKING:
    import polars as pl

LEFT = "left"  # name of the signal that is simulated minus measured
MUCH = 0.5  # effect that they imitate, over the gap, from which it is worth an experiment


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Parametrised, Result):
    """What a diagnosis found.

    Printing it, ``to_json``, ``write_report``, ``tables`` and ``plot`` tell it; where the gap lies
    and what to record next is worked out when it is first asked for.

    Attributes:
        name: of the description.
        file, sha256: name of the description's file, and of its bytes; "" for one in memory.
        model: as it was given.
        logs: as they were measured.
        audits: one a log.
        floors: noise floor [SI] by output.
        selection: everything that was tried.
        verdict: what is said.
        gap: before, re-tuned and after, in noise floors.
        gaps: the same by output, in SI.
        ranking: effects, most likely first.
        moved: nominal parameters after re-tuning.
        held_out: what the model leaves of samples that the description holds out, by log.
        tolerance: gap [noise floors] that counts as none.
        residual_map: what is left outside the catalogue, learnt as a shape; None where nothing is,
            or no shape holds on blocks.
        parts: logs, or halves of one, each of which is explained by parameters of its own where
            together they are not; none otherwise.
        between_rows: commands may have been sent any time before the rows that have them: then, and
            not else, the verdict explains the logs.
        blurs: what nobody knows of columns does to what the model simulates, where more than noise
            is left.
        flags: outputs of the logs that say yes or no, which are not judged.
        seed: of intervals and random commands.
        confirmation: the diagnosed model run as an FMU, None where nobody asked or it cannot be.
        unconfirmed: what is amiss with that FMU, "" for nothing.
        written: the next experiment with its table, None before ``with_commands``.
        mistake: what is wrong with a log, since reading it otherwise explains it far better than
            any effect does; "" for nothing.
        unfinished: what was not tried, or not to the end, since the diagnosis was stopped.
        stopped: why it was, "" if it was not.
    """

    name: str
    file: str
    sha256: str
    model: Model
    logs: tuple[Log, ...]
    audits: tuple[Audit, ...]
    floors: dict[str, float]
    selection: Selection
    verdict: Verdict
    gap: GapSummary
    gaps: tuple[Gap, ...]
    ranking: tuple[RankedEffect, ...]
    moved: tuple[Value, ...]
    held_out: tuple[HeldOut, ...]
    tolerance: float
    residual_map: ResidualMap | None = None
    parts: tuple[Part, ...] = ()
    between_rows: bool = False
    blurs: tuple[Blur, ...] = ()
    flags: tuple[str, ...] = ()
    seed: int = 0
    confirmation: Confirmation | None = None
    unconfirmed: str = ""
    written: tuple[design.Experiment, ...] | None = None
    mistake: str = ""
    unfinished: tuple[str, ...] = ()
    stopped: str = ""

    def __repr__(self) -> str:
        gap = f"{self.gap.rms['before']:.3g} to {self.gap.rms['after']:.3g} noise floors"
        effects = ", ".join(self.selection.taken.effects) or "no effect"
        return f"<Diagnosis of {self.name}: {self.verdict.kind}, {effects}, {gap}>"

    @property
    def settings(self) -> Settings:
        """What decided the verdict, and how much was tried."""
        return self.selection.taken.settings

    @property
    def within_tolerance(self) -> bool:
        return self.verdict.kind == NO_GAP

    @cached_property
    def fitted(self) -> Model:
        """The model with nominal parameters re-tuned and the diagnosed effects switched on."""
        return replace(self.model, values={**self.model.values, **self.selection.taken.values})

    @property
    def with_map(self) -> Model:
        """``fitted`` with the residual map switched on and all parameters fitted beside it; without
        a map the same model."""
        if self.residual_map is None:
            return self.fitted
        return replace(self.model, values={**self.model.values, **self.residual_map.values})

    @cached_property
    def found(self) -> tuple[Value, ...]:
        """Every parameter that is other in ``fitted``, nominal ones first."""
        return estimates(self.selection.taken)

    @property
    def explained(self) -> bool:
        """Whether re-tuned parameters explain the gap: else, without an effect, it is noise."""
        return self.verdict.kind == PARAMETERS and parameters_explain(self.selection)

    @property
    def masked(self) -> tuple[MaskedEffect, ...]:
        """Effects that may be there beside re-tuned parameters that explain the gap, and would not
        show, the largest first."""
        return tuple(self.selection.masked) if self.explained else ()

    @property
    def undecided(self) -> tuple[FittedModel, ...]:
        """Fitted models that these logs cannot tell apart, and another experiment may."""
        least = MUCH * self.gap.rms["before"]
        large = [it.fitted_model for it in self.masked if it.moved >= least]
        return (self.selection.retuned, *large) if large else self.verdict.rivals

    @property
    def alternatives(self) -> tuple[tuple[Slot, ...], ...]:
        """What the confidence set leaves open, as choices between effects."""
        plant = self.model.plant
        models = [one.effects for one in self.verdict.rivals]
        return alternatives(models, lambda name: plant.main(name).effect.hints.family)

    @property
    def undecided_weights(self) -> tuple[float, ...]:
        """Model weights of ``undecided``; of what parameters mask nobody knows any, so all are
        equal."""
        weights = weights_by_effects(self.selection, self.verdict)
        if any(one.effects not in weights for one in self.undecided):
            return (1.0,) * len(self.undecided)
        return tuple(weights[one.effects] for one in self.undecided)

    @property
    def carried(self) -> dict[str, float]:
        """How much of what is left commands between rows, steps of a column and late stamps may
        carry [noise floors], by reason, the most first: where that is much and not noise."""
        left, could = self.gap.rms["after"], could_carry(self.blurs, self.logs)
        said = [ROW] if self.between_rows else []  # the verdict supposes it
        return {
            why: min(far, left)
            for why, far in could.items()
            if far >= BLAMED * left and why not in said
        }

    @property
    def doubted(self) -> tuple[str, ...]:
        """Effects that were taken and are not said to explain the gap."""
        return doubted(self.selection, self.verdict, self.contradicted)

    @cached_property
    def contradicted(self) -> tuple[str, ...]:
        """Effects that were taken against which speaks what is held out."""
        return contradicted(self.selection, self.held_out, self.settings.least_gain)

    @property
    def helps(self) -> bool:
        """Whether ``fitted`` does better than the nominal model, or leaves noise, where the
        description holds samples out."""
        noise = all(one.after <= self.tolerance for one in self.held_out)
        return noise or gains(self.held_out, "before", self.settings.least_gain)

    @property
    def probabilities(self) -> dict[str, float]:
        """That are told of effects, by name, most likely first."""
        return {one.name: p for one in self.ranking if (p := one.probability) is not None}

    @property
    def stages(self) -> dict[str, str]:
        """The stages of ``Gap.rms`` that differ, each with its name for people."""
        effects = self.selection.taken.effects
        named = {"before": "before"}
        if self.selection.retuned.problem.free and not self.within_tolerance:
            named["retuned"] = "re-tuned"
        if effects:
            named["after"] = "with effects" if len(effects) > 1 else "with effect"
        return named

    @cached_property
    def readings(self) -> tuple[Reading, ...]:
        """Every output of every log beside what the model of each stage makes of it.

        A model that cannot be simulated on a log that no fit has seen makes nothing of it.
        """
        nominal, readings = self.selection.retuned.problem, []
        values = {
            "before": nominal.values(self.selection.before.vector),
            "retuned": self.selection.retuned.values,
            "after": self.selection.taken.values,
        }
        for log, run in zip(self.logs, nominal.runs):
            every = {name: run.outputs_or_nan(values[stage]) for stage, name in self.stages.items()}
            finite = {name: out for name, out in every.items() if np.isfinite(out).all()}
            for k, output in enumerate(log.outputs):
                wire = self.model.plant.wire[output]
                simulated = {name: out[:, k] for name, out in finite.items()}
                readings.append(reading(log, wire, simulated))
        return tuple(readings)

    def signals(self) -> pl.DataFrame:
        """Return every output of every log: measured, of each stage, and what the last one leaves.

        Example:
            ``found.signals().write_parquet("signals.parquet")``, for PlotJuggler or a notebook.
        """
        import polars as pl

        tables: dict[str, dict[str, Any]] = {}
        for one in self.readings:
            columns = tables.setdefault(one.log.name, {"time [s]": one.log.stamps})
            unit = f" [{one.unit}]" if one.unit else ""
            for name, values in {**one.beside, LEFT: one.error}.items():
                columns[f"{one.wire.name} {name}{unit}"] = values
        frames = [
            pl.DataFrame(columns).insert_column(0, pl.lit(name).alias("log"))
            for name, columns in tables.items()
        ]
        return pl.concat(frames, how="diagonal")

    def write_signals(self, path: Path) -> None:
        """Write ``signals``: as ``.parquet``, as ``.mcap`` with a layout of PlotJuggler beside it,
        else as CSV.

        In an MCAP file each output of a log is a topic.

        Raises:
            UserError: the file cannot be written, or the library for MCAP files is not installed.

        Example:
            ``found.write_signals(Path("signals.mcap"))``, and open ``signals.xml`` in PlotJuggler.
        """
        if path.suffix != ".mcap":
            table = self.signals()
            parquet = path.suffix == ".parquet"
            return write_with(path, table.write_parquet if parquet else table.write_csv)
        topics = [
            Topic(
                f"{one.log.name}/{one.wire.name}".replace(";", ","),
                one.unit,
                one.log.stamps,
                one.beside,
                {LEFT: one.error},
            )
            for one in self.readings
        ]
        write_with(path, lambda part: write_mcap(part, topics))
        layout = path.with_suffix(LAYOUT)
        write_with(layout, lambda part: write_layout(part, path.name, topics))

    @cached_property
    def localisation(self) -> tuple[Breakdown, ...]:
        """Where the gap lies: by output, block, time, frequency, amplitude, speed, position."""
        return localise(self.selection)

    @cached_property
    def next_experiments(self) -> tuple[design.Experiment, ...]:
        """The command that best tells apart what these logs cannot, none where nothing is open."""
        if self.written is not None:
            return self.written
        with self.selection.retuned.problem.workers:
            return design.next_experiments(self.undecided, self.undecided_weights, self.seed)

    @cached_property
    def repeats_wanted(self) -> str:
        """The instruction to repeat a command where only that tells noise from structure, or ""."""
        if self.within_tolerance:
            return ""
        left = self.selection.taken.left.without(self.verdict.limit_cycle)
        origins = [gap.origin for gap in self.gaps]
        return design.repeats_wanted(left, origins, self.logs, self.settings)

    def with_commands(self, *folders: Path) -> Diagnosis:
        """Write the command of the next experiment as a table, ready to play, to these folders;
        return the diagnosis, which names the tables, if there is a folder.

        An earlier table that was played and filled stays: it is a log by now, or holds more than a
        command.

        Raises:
            UserError: a table cannot be written.
        """
        logs = {log.path.name for log in self.logs}
        names = (f"{self.name}_next_{k}.csv" for k in count(1))
        free = (
            name
            for name in names
            if name not in logs and not any(design.is_filled(folder / name) for folder in folders)
        )
        planned, wires = self.next_experiments, self.model.plant.wire
        if folders and any(one.telling for one in planned):
            planned = tuple(replace(one, file=file) for one, file in zip(planned, free))
            for experiment in planned:
                for folder in folders:
                    experiment.write(folder, [wires[name] for name in experiment.floors])
        return replace(self, written=planned)

    def without_next(self, why: str) -> Diagnosis:
        """Return the same diagnosis as one that was stopped before the next experiment was sought,
        in words ``why``, see ``stopped``."""
        left = (*self.unfinished, "the next experiment")
        return replace(self, written=(), stopped=why, unfinished=left)
