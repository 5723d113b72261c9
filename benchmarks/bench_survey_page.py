"""What the tables and the page of a survey cost, of jobs that are made up: seconds and memory.

Run: ``python -m benchmarks.bench_survey_page`` (a minute, POSIX).
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import msgspec

from servo_models.files import scratch
from servo_models.survey.job import Outcome
from servo_models.survey.result import Survey
from tests.support.made_outcomes import fleet

UNITS, JOINTS = 1700, 6
DIAGNOSIS_BYTES = 30_000
BAR_SECONDS, BAR_MEGABYTES = 60.0, 1024.0


def main() -> None:
    """Print a row a step, then the sum of all with the largest memory of the process."""
    made = tuple(map(_read, fleet(UNITS, JOINTS)))
    survey = Survey("fleet", made, earlier=made[JOINTS:])
    print(f"{len(made)} jobs; before: {_megabytes():.0f} MB")
    with scratch() as folder:
        steps: dict[str, Callable[[], object]] = {
            "table": lambda: survey.table().write_csv(folder / "table.csv"),
            "estimates": lambda: survey.estimates().write_parquet(folder / "estimates.parquet"),
            "whose causes": lambda: survey.belongings,
            "variations": lambda: survey.variations,
            "mixed models": lambda: survey.splits,
            "page": lambda: survey.write_report(folder / "index.html"),
            "document": lambda: (folder / "survey.json").write_text(survey.to_json(), "utf-8"),
            "terminal": lambda: str(survey),
        }
        whole = 0.0
        for name, step in steps.items():
            begin = time.perf_counter()
            step()
            spent = time.perf_counter() - begin
            whole += spent
            print(f"{name:14}{spent:8.1f} s", flush=True)
        size = (folder / "index.html").stat().st_size / 1e6
    print(f"{'in all':14}{whole:8.1f} s of {BAR_SECONDS:.0f}", end="")
    print(f"{_megabytes():8.0f} MB of {BAR_MEGABYTES:.0f}; page {size:.2f} MB")


def _read(made: Outcome) -> Outcome:
    """A job as it is read from its file, with a diagnosis of the usual size."""
    diagnosis = msgspec.Raw(b'"%s"' % (b"x" * DIAGNOSIS_BYTES))
    whole = msgspec.json.encode(msgspec.structs.replace(made, diagnosis=diagnosis))
    return msgspec.json.decode(whole, type=Outcome)


def _megabytes() -> float:
    """Largest memory so far."""
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


if __name__ == "__main__":
    main()

# Result: two cores, quiet, CPython 3.11.
#
# 10200 jobs; before: 747 MB
# table              0.3 s
# estimates          1.4 s
# whose causes       1.6 s
# variations         2.2 s
# mixed models       6.2 s
# page               2.3 s
# document           0.1 s
# terminal           0.3 s
# in all            14.3 s of 60     927 MB of 1024; page 0.17 MB
