"""What a diagnosis says of a case, of which it sees the description and its logs."""

from __future__ import annotations

import time
import warnings
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from servo_models.diagnosis.diagnose import Diagnosis, diagnose
from servo_models.diagnosis.verdict import NO_GAP
from servo_models.errors import UserError

FAILED = "failed"


@dataclass(frozen=True)
class Said:
    """What a diagnosis said.

    Attributes:
        case: its name.
        verdict: one of the six, or ``"failed"``, with ``why``.
        seconds: that it took, files read included.
        named: effects of the explanation at first place, none where there is no gap.
        members: effects of the set that cannot be told apart.
        chances: probability of each effect, by name.
        tried: effects of every explanation that was fitted, best first.
        left: held-out error [noise floors] that each of them leaves.
        values: free parameters [SI] of each of them, by name.
        floors: noise floor [SI] by output.
        imitated: effects that re-tuned parameters are said to imitate, None where that was not
            looked at.
        before, after: held-out error [noise floors] of the nominal model and of the one named.
    """

    case: str
    verdict: str
    seconds: float
    why: str = ""
    named: list[str] = field(default_factory=list)
    members: list[str] = field(default_factory=list)
    chances: dict[str, float] = field(default_factory=dict)
    tried: list[list[str]] = field(default_factory=list)
    left: list[float] = field(default_factory=list)
    values: list[dict[str, float]] = field(default_factory=list)
    floors: dict[str, float] = field(default_factory=dict)
    before: float = 0.0
    after: float = 0.0
    imitated: list[str] | None = None


def diagnose_case(folder: Path) -> dict[str, Any]:
    """Diagnose the case in a folder; returns a ``Said`` as a dictionary.

    Whatever goes wrong is an answer too, and a wrong one: the other cases go on.
    """
    begin = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = diagnose(folder / "description.toml", jobs=1)
    except Exception as error:  # a crash is a figure of the diagnosis, not of this run
        why = f"{type(error).__name__}: {error}" if not isinstance(error, UserError) else str(error)
        return asdict(Said(folder.name, FAILED, time.perf_counter() - begin, why))
    return asdict(_said(folder.name, found, time.perf_counter() - begin))


def _said(case: str, found: Diagnosis, seconds: float) -> Said:
    causes, verdict = found.causes, found.verdict
    tried = sorted([*causes.singles, *causes.pairs, *causes.more], key=lambda one: one.evidence.rms)
    return Said(
        case=case,
        verdict=verdict.kind,
        seconds=seconds,
        named=[] if verdict.kind == NO_GAP else list(causes.taken.effects),
        members=list(verdict.members),
        chances=verdict.chances,
        tried=[list(one.effects) for one in tried],
        left=[one.evidence.rms for one in tried],
        values=[one.values for one in tried],
        floors=found.floors,
        before=causes.before.rms,
        after=causes.taken.evidence.rms,
        imitated=[one.name for one in found.imitated],
    )
