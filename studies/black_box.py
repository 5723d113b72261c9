"""Does a closed box get the verdict that the same model gets open?

    python -m studies withheld.generator runs/31 --cases 150 --seed 31 --tiers easy --kinds one
    python -m studies black_box runs/31 --out runs/31.jsonl --cases 40

Of withheld cases whose cause acts at the border, on a command or a reading from outside, each is
diagnosed twice: by the description as it is, and with the native FMU of its nominal model as a box.
Effects are compared by what they are: an FMU that has several commands calls its effects after
them.  A file that is there goes on.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from servo_models import build, diagnose, read_description
from servo_models.effects import effects
from servo_models.files import scratch
from servo_models.withheld.score import share

BORDER = (
    "transport_delay",
    "command_lag",
    "sample_hold",
    "dead_band",
    "command_quantisation",
    "command_offset",
    "command_gain",
    "rate_limit",
    "motion_profile",
    "reading_lag",
    "reading_gain",
    "reading_offset",
    "reading_quantisation",
)
"""Causes of the generator that act on a command, or on a reading from outside."""


def kind(name: str) -> str:
    """Return what an effect is, whatever it is called at its place."""
    for known in (effects(), BORDER):
        if found := [it for it in known if f"_{name}".endswith(f"_{it}")]:
            return max(found, key=len)
    return name


def boxed(description: Path, folder: Path) -> Path:
    """Write the description with its model as a native FMU; return it."""
    build(read_description(description).model, folder / "box.fmu", "native")
    for log in description.parent.glob("*.csv"):
        shutil.copy(log, folder)
    text = description.read_text("utf-8")
    text = re.sub(r"(?m)^(actuator|variant) = .*\n", "", text)
    text = re.sub(r"(?ms)^\[parameters\]\n.*?(?=^\[)", "", text)  # they are in the FMU
    text = re.sub(r"(?m)^([a-z_]+)\.([a-z_]+) = (?=\")", r"\1_\2 = ", text)
    (folder / "box.toml").write_text(f'actuator = "box.fmu"\n{text}', encoding="utf-8")
    return folder / "box.toml"


def compared(cases: Path, known: dict[str, Any]) -> dict[str, Any]:
    """Return what is said of a case open and as a box, and what it took."""
    description = cases / "cases" / known["case"] / "description.toml"
    row: dict[str, Any] = {"case": known["case"], "truth": known["effects"][0]["name"]}
    with scratch() as folder:
        for name, path in (("open", description), ("box", boxed(description, Path(folder)))):
            begin = time.perf_counter()
            found = diagnose(path, jobs=1)
            named = list(found.selection.taken.effects)
            row[name] = {
                "verdict": found.verdict.kind,
                "named": named,
                "seconds": round(time.perf_counter() - begin, 1),
            }
    return row


def chosen_cases(folder: Path, count: int) -> Iterator[dict[str, Any]]:
    """Yield so many cases with one cause at the border."""
    rows = json.loads((folder / "answers.json").read_text("utf-8"))["cases"]
    border = [row for row in rows if row["kind"] == "one" and row["effects"][0]["name"] in BORDER]
    yield from border[:count]


def alike(row: dict[str, Any]) -> bool:
    """Whether both verdicts are the same."""
    kinds = [sorted(map(kind, row[name]["named"])) for name in ("open", "box")]
    return row["open"]["verdict"] == row["box"]["verdict"] and kinds[0] == kinds[1]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="of generated cases")
    parser.add_argument("--out", type=Path, required=True, help="answers, to go on with")
    parser.add_argument("--cases", type=int, default=40)
    given = parser.parse_args()
    lines = given.out.read_text("utf-8").splitlines() if given.out.exists() else []
    rows = [json.loads(line) for line in lines]
    done = {row["case"] for row in rows}
    for known in chosen_cases(given.folder, given.cases):
        if known["case"] not in done:
            rows.append(compared(given.folder, known))
            with given.out.open("a", encoding="utf-8") as out:
                out.write(json.dumps(rows[-1]) + "\n")
    print("case | truth | open | box | seconds open, box")
    for row in rows:
        said = [f"{row[it]['verdict']}: {', '.join(row[it]['named'])}" for it in ("open", "box")]
        print(
            row["case"],
            row["truth"],
            *said,
            row["open"]["seconds"],
            row["box"]["seconds"],
            sep=" | ",
        )
    for name in ("open", "box"):
        right = share(
            [kind(row["truth"])] == [kind(it) for it in row[name]["named"]] for row in rows
        )
        print(f"{name}: right {right.value:.2f} ({right.low:.2f} to {right.high:.2f}) of {right.n}")
    same = share(alike(row) for row in rows)
    print(f"same verdict {same.value:.2f} ({same.low:.2f} to {same.high:.2f}) of {same.n}")


if __name__ == "__main__":
    main()
