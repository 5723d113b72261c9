from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from servo_models.survey.job import Outcome


@dataclass(frozen=True, eq=False, repr=False)
class Survey:
    name: str
    outcomes: tuple[Outcome, ...]
    notes: tuple[str, ...]
    earlier: tuple[Outcome, ...]
    folder: Path

    def table(self):
        import polars as pl

        return pl.DataFrame(
            [
                {
                    "unit": o.unit,
                    "joint": o.joint,
                    "verdict": o.verdict,
                    "failure": o.failure,
                    "seconds": o.seconds,
                    "gap": o.gap_before,
                    "after": o.gap_after,
                }
                for o in self.outcomes
            ]
        )

    estimates = table
