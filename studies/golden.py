"""The golden set: answers that a change must not make worse, or must not change at all.

    python -m studies golden --quick                      # 20 withheld logs and some examples
    python -m studies golden                              # all but the real logs
    python -m studies golden --real --only real_logs      # those alone; some take 20 minutes
    python -m studies golden --relative 1e-6              # where a library has replaced ours
    python -m studies golden --compare verdicts           # where answers may change
    python -m studies golden --write                      # after a change that is meant

    python -m studies golden --cases FOLDER --out answers.jsonl    # answers of generated cases
    python -m studies golden --cases FOLDER --out now.jsonl --against then.jsonl
    python -m studies golden --cases FOLDER --out now.jsonl --separable  # single causes
    python -m studies golden --cases FOLDER --out now.jsonl --identify

``--compare equal`` asks for the same choices, numbers to ``--relative`` (0: to the last digit) and,
where they are stored, the same reports.  ``--compare verdicts`` asks of diagnoses and
identifications for the same verdict, named effects and set, and for sizes within their combined
standard errors; what changed is a table, against the truth where that is known.

Inputs and answers are files in ``studies/golden_set``; its README.md says what is in them.  An
answer is names, choices and numbers [SI]: no sentences, which may be rewritten, and no seconds,
which are in files of ``--out`` only.  Such a file goes on where it was interrupted.

Exit code 0: equal, 1: something differs, 2: could not run, or an input is not the one stored.
Real logs are read in the folder that SERVO_MODELS_DATA names.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import json
import math
import os
import re
import shutil
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import chdir
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a process a processor is all there is

from servo_models.catalogue import actuators
from servo_models.data.description import read_description
from servo_models.diagnosis.verdict import OUTSIDE
from servo_models.errors import UserError
from servo_models.files import scratch, write_whole
from servo_models.identification.problem import prior_parameters
from servo_models.withheld.oracle import FAILED, Diagnosed, Question, ask_oracle, said_of
from servo_models.withheld.run import work_through
from servo_models.withheld.score import good, join, share

Figures = dict[str, Any]
Find = Callable[[Path], Any]
Row = dict[str, Any]
"""``case``, its ``answer``, ``texts`` of reports, ``seconds`` of a processor, ``simulations``."""

HERE = Path(__file__).resolve().parent
EXAMPLES = HERE.parent / "examples"
GOLDEN = HERE / "golden_set"
LOGS = Path(os.environ.get("SERVO_MODELS_DATA", HERE.parents[1] / "shared" / "data"))
QUICK = (
    *("0028", "0044", "0048", "0052", "0056"),
    *("0021", "0033", "0037", "0045", "0053"),
    *("0002", "0022", "0026", "0042", "0058"),
    *("0015", "0031", "0043", "0047", "0059"),
)
"""Withheld cases of the small share: fast ones of all rigs, kinds and faults, five a tier."""
REPORTED = QUICK[::2]  # cases of which reports are stored
ROUNDING = 1e-12
"""Difference up to which two numbers are equal whatever they are; probabilities may be 1e-30."""
SAME_SIZE = 1e-6
"""Relative difference of two sizes that counts as none, where they have no standard error."""
SHOWN = 40  # differences that are printed
DETERMINED = "parameters, determined"
NORMAL_95 = 1.96  # standard errors to each side that hold 95 % of a normal distribution


@dataclass(frozen=True)
class Job:
    """An answer to be found.

    Attributes:
        name: kind and case.
        find: from ``source`` to its figures, a function of this module.
        source: the file that it is found from, or the name of an actuator.
        inputs: files that it depends on, by the name under which their hash is stored.
        quick: whether it belongs to the small share.
        reported: whether its reports are wanted.
        truth: of a case of which it is to be asked whether its logs tell its cause.
    """

    name: str
    find: Find
    source: Path
    inputs: Mapping[str, Path]
    quick: bool = False
    reported: bool = False
    truth: Row | None = None


# Answers


def diagnosed(description: Path) -> Any:
    """The diagnosis of a description."""
    from servo_models.diagnosis.diagnose import diagnose

    return diagnose(description, jobs=1)


def identified(description: Path) -> Any:
    """The identification by a description."""
    from servo_models.identification.identify import identify

    return identify(description, jobs=1)


def papers_gap(description: Path) -> Any:
    """The diagnosis of the papers' gap, whose logs a script of the example makes."""
    with scratch() as folder:
        shutil.copytree(description.parent, folder / "gap")
        order = [sys.executable, "make_logs.py"]
        subprocess.run(order, cwd=folder / "gap", check=True, capture_output=True)
        return diagnosed(folder / "gap" / description.name)


def located(text: str) -> str:
    """The text of a description of real logs, which are where SERVO_MODELS_DATA says."""
    return re.sub(r'"(\.\./)?logs/', f'"{LOGS.as_posix()}/', text)


def with_logs(find: Find, description: Path) -> Any:
    """What is found from a description of real logs."""
    with scratch() as folder:
        text = located(description.read_text("utf-8"))
        (folder / description.name).write_text(text, encoding="utf-8")
        return find(folder / description.name)


def validated(actuator: Path) -> Any:
    """The validation of the actuator of that name."""
    from servo_models.catalogue import model
    from servo_models.validation.runner import validate

    return validate([model(actuator.name)])


def figures_of(result: Any) -> Figures:
    """Return the names, choices and numbers of a result."""
    from servo_models.diagnosis.result import Diagnosis
    from servo_models.diagnosis.verdict import NO_GAP
    from servo_models.validation.rows import Validation

    if isinstance(result, Validation):
        return {
            " | ".join((row.claim, row.variant, row.case, row.quantity)): [row.value, row.limit]
            for row in result.rows
        }
    if not isinstance(result, Diagnosis):
        return {
            "values": _sizes(result.parameters.estimates if result.parameters else ()),
            "believable": result.believable,
            "converged": result.converged,
        }
    verdict = result.verdict
    return {
        "verdict": verdict.kind,
        "named": [] if verdict.kind == NO_GAP else list(result.selection.taken.effects),
        "set": list(verdict.members),
        "weights": dict(verdict.weights),
        "probabilities": result.probabilities,
        "doubted": list(result.doubted),
        "floors": dict(result.floors),
        "gap": dict(result.gap.rms),
        "values": _sizes(result.found),
        "masked": [effect.name for effect in result.masked],
    }


def _sizes(values: Iterable[Any]) -> dict[str, list[float]]:
    return {value.name: [value.value, value.standard_error] for value in values}


def answered(job: Job) -> Row:
    """Return the row of a job.  A diagnosis that is refused is an answer too, and a wrong one."""
    from servo_models.core.simulate import Model

    run, simulations = Model.ran, 0

    def counted(*given: Any) -> Any:
        nonlocal simulations
        simulations += 1
        return run(*given)

    begin = time.process_time()
    with warnings.catch_warnings(), patch.object(Model, "ran", counted):
        warnings.simplefilter("ignore")
        result = None
        try:
            result = job.find(job.source)
            answer = figures_of(result)
        except UserError:
            answer = {"verdict": FAILED, "named": [], "set": []}
        row: Row = {"case": job.name, "answer": answer, "texts": {}, "simulations": simulations}
        row["seconds"] = round(time.process_time() - begin, 3)
        if job.reported and result is not None:
            row["texts"] = _texts(result, job.source)
    if job.truth and result is not None:
        said = said_of(job.truth["case"], result, row["seconds"])
        question = Question(job.source.parents[2], job.truth, said, left_out=False)
        row["separable"] = ask_oracle(question)["separated"]
    return row


def _texts(diagnosis: Any, description: Path) -> dict[str, str]:
    """What the terminal shows of a diagnosis, a check and an identification."""
    from servo_models.identification.check import check
    from servo_models.report.terminal import text

    with chdir(description.parent):  # a report names the path that it was given
        file = Path(description.name)
        results = {
            "diagnose": diagnosis,
            "check": check(file, jobs=1),
            "identify": identified(file),
        }
        return {name: text(result.report()) for name, result in results.items()}


# Jobs


def withheld(folder: Path, find: Find = diagnosed, separable: bool = False) -> Iterator[Job]:
    """Cases in a folder, of this set or of the generator."""
    truth = truths(folder) if separable else {}
    for path in sorted((folder / "cases").glob("*/description.toml")):
        case = path.parent.name
        inputs = {f"cases/{case}/{file.name}": file for file in sorted(path.parent.iterdir())}
        mine = folder == GOLDEN
        quick, reported = mine and case in QUICK, mine and case in REPORTED
        name = f"withheld/{case}"
        known = truth.get(name)
        alone = known if known and known["kind"] == "one" else None
        yield Job(name, find, path, inputs, quick, reported, alone)


def examples() -> Iterator[Job]:
    """The papers' gap, identifications and validations."""
    for name in ("torque_motor", "sg90"):
        path, inputs = EXAMPLES / "papers_gap" / f"{name}.toml", _inputs("papers_gap", "*.[tp]*")
        yield Job(f"papers/{name}", papers_gap, path, inputs, name == "torque_motor")
    for name in ("two_csv_files", "servo_bench", "torque_motor"):
        path, inputs = EXAMPLES / name / "description.toml", _inputs(name, "*.[tc]*")
        yield Job(f"identification/{name}", identified, path, inputs, quick=True)
    for name in actuators():
        yield Job(f"validation/{name}", validated, Path(name), {}, name == "linear_drive")


def real_logs() -> Iterator[Job]:
    """Real logs, diagnosed and identified."""
    if not LOGS.is_dir():
        raise UserError(f"no folder '{LOGS}': set SERVO_MODELS_DATA to that of the real logs")
    for find, folder in ((diagnosed, "real_logs/diagnosis"), (identified, "real_logs")):
        for path in sorted((EXAMPLES / folder).glob("*.toml")):
            named = re.findall(r'"(?:\.\./)?logs/([^"]+)"', path.read_text("utf-8"))
            logs = {log for pattern in named for log in LOGS.glob(pattern)}
            inputs = {f"logs/{log.relative_to(LOGS).as_posix()}": log for log in sorted(logs)}
            inputs |= _inputs(folder, path.name)
            name = f"real_logs/{find.__name__}/{path.stem}"
            yield Job(name, partial(with_logs, find), path, inputs)


def _inputs(folder: str, pattern: str) -> dict[str, Path]:
    files = sorted((EXAMPLES / folder).glob(pattern))
    return {path.relative_to(HERE.parent).as_posix(): path for path in files}


def check_inputs(jobs: Iterable[Job], stored: dict[str, str]) -> dict[str, str]:
    """Return the hashes of all inputs, the stored ones among them.

    Raises:
        UserError: a file is missing, or is not the one whose hash is stored.
    """
    hashes = dict(stored)
    for name, path in {name: path for job in jobs for name, path in job.inputs.items()}.items():
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        if hashes.setdefault(name, digest) != digest:
            raise UserError(
                f"'{path}' is not the input whose answer is stored: restore it, or delete"
                f" '{name}' from '{GOLDEN / 'inputs.json'}' and write the answers anew"
            )
    lost = [name for name in stored if name.startswith("cases/") and not (GOLDEN / name).is_file()]
    if lost:
        raise UserError(f"'{GOLDEN / lost[0]}' is missing: restore it")
    return hashes


def truths(folder: Path) -> dict[str, Row]:
    """What is true of the cases in a folder, by the names of their jobs."""
    sealed = folder / "answers.json"
    if sealed.exists():
        rows = json.loads(sealed.read_text("utf-8"))["cases"]
    else:
        rows = [json.loads(path.read_text("utf-8")) for path in folder.glob("cases/*/truth.json")]
    return {f"withheld/{row['case']}": row for row in rows}


# Comparison


def differences(name: str, before: Any, now: Any, relative: float) -> Iterator[str]:
    """Sentences on what two answers do not share; figures of both are named by their path."""
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        for key in dict.fromkeys([*before, *now]):
            if key not in before or key not in now:
                yield f"{name}: '{key}' is {'new' if key in now else 'gone'}"
            else:
                yield from differences(f"{name}: {key}", before[key], now[key], relative)
    elif isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        for k, pair in enumerate(zip(before, now)):
            yield from differences(f"{name} [{k}]", *pair, relative)
    elif not _equal(before, now, relative):
        yield f"{name}: was {before}, is {now}"


def _equal(before: Any, now: Any, relative: float) -> bool:
    if isinstance(before, float) and isinstance(now, float):
        if math.isnan(before) or math.isnan(now):
            return math.isnan(before) and math.isnan(now)
        return math.isclose(before, now, rel_tol=relative, abs_tol=ROUNDING * (relative > 0.0))
    return bool(before == now)


def changed_verdict(before: Figures, now: Figures) -> bool:
    """Whether two answers differ in a choice: names are compared without their order."""
    names = any(set(before.get(key, ())) != set(now.get(key, ())) for key in ("named", "set"))
    kinds = ("verdict", "believable", "converged")
    return names or any(before.get(key) != now.get(key) for key in kinds)


def sizes_apart(name: str, before: Figures, now: Figures) -> Iterator[str]:
    """Sentences on sizes of both answers that differ by more than their combined standard errors.

    A standard error that is not a number is that of a size on its bound, which stays there.
    """
    old, new = before.get("values", {}), now.get("values", {})
    for key in (key for key in old if key in new):
        (was, error), (value, other) = old[key], new[key]
        both = math.hypot(*(0.0 if math.isnan(each) else each for each in (error, other)))
        if not math.isclose(was, value, rel_tol=SAME_SIZE, abs_tol=both):
            yield f"{name}: {key}: was {was:.4g} +/- {error:.2g}, is {value:.4g} +/- {other:.2g}"


def right(truth: Row, answer: Figures) -> bool:
    """Whether an answer is the truth of a withheld case, as the withheld check counts it."""
    said = Diagnosed(truth["case"], answer["verdict"], 0.0, named=answer["named"])
    return good(join([truth], {said.case: said}, {})[0])


def change(truth: Row | None, before: Figures, now: Figures) -> str:
    """Return whether a right answer is "gained" or "lost", or "neither"."""
    if truth is None or right(truth, before) == right(truth, now):
        return "neither"
    return "gained" if right(truth, now) else "lost"


def verdict_table(
    before: Mapping[str, Figures], now: Mapping[str, Figures], truth: Mapping[str, Row]
) -> list[str]:
    """Return a line for every verdict that changed, below a heading."""
    lines = ["case | before | now | truth | change"]
    for name, answer in now.items():
        old = before[name]
        if changed_verdict(old, answer):
            known = truth.get(name)
            cells = (name, _said(old), _said(answer), _true(known), change(known, old, answer))
            lines.append(" | ".join(cells))
    return lines


def _said(answer: Figures) -> str:
    if "verdict" not in answer:
        return f"believable {answer['believable']}, converged {answer['converged']}"
    names = f"{' + '.join(answer['named']) or 'no effect'}; set {', '.join(answer['set']) or '-'}"
    return f"{answer['verdict']}: {names}"


def _true(truth: Row | None) -> str:
    if truth is None:
        return "unknown"
    names, hidden = (
        " + ".join(cause["name"] for cause in truth[key]) for key in ("effects", "hidden")
    )
    return f"{truth['kind']}: {names or '-'}" + (f" (hidden {hidden})" if hidden else "")


def _causes(truth: Row) -> tuple[set[str], set[str]]:
    """Effects that are to be named, and those that may be named beside them."""
    named, hidden = ({cause["name"] for cause in truth[key]} for key in ("effects", "hidden"))
    return named, named | hidden


def _first(answer: Figures) -> str:
    """The most probable of the effects named, "" where there is none."""
    return max(answer["named"], key=lambda it: answer["probabilities"].get(it, 0.0), default="")


FOUND: dict[str, tuple[tuple[str, ...], Callable[[Row, Figures], bool]]] = {
    "one cause: named first": (("one",), lambda true, it: _first(it) in _causes(true)[0]),
    "one cause: in the set, or masked": (
        ("one",),
        lambda true, it: _causes(true)[0] <= {*it["set"], *it.get("masked", ())},
    ),
    "two causes: both named and no other": (("two",), right),
    "two causes: both in the set": (("two",), lambda true, it: _causes(true)[0] <= set(it["set"])),
    "one, two or none: a false cause": (
        ("one", "two", "nothing"),
        lambda true, it: not set(it["named"]) <= _causes(true)[1],
    ),
    "nothing is wrong, and nothing is said": (("nothing",), right),
    "a cause outside the catalogue is called so": (("foreign",), right),
    "one, two or none: called outside": (
        ("one", "two", "nothing"),
        lambda _, it: it["verdict"] in (OUTSIDE, FAILED),
    ),
}
"""What is counted of withheld cases: their kinds, and whether an answer is so."""


def paired(
    before: Mapping[str, Row], now: Mapping[str, Row], truth: Mapping[str, Row]
) -> Iterator[str]:
    """Lines of tables of what two answers to the same cases have found, and what they took."""
    both = [name for name in now if name in truth and now[name].get("separable", True)]
    yield "| | of | before | now | only before | only now |"
    yield "|---|---|---|---|---|---|"
    for title, (kinds, holds) in FOUND.items():
        cases = [name for name in both if truth[name]["kind"] in kinds]
        was, are = (
            [holds(truth[name], rows[name]["answer"]) for name in cases] for rows in (before, now)
        )
        if cases:
            shown = (
                f"{it.value:.2f} ({it.low:.2f} to {it.high:.2f})" for it in map(share, (was, are))
            )
            only = (sum(a and not b for a, b in pairs) for pairs in (zip(was, are), zip(are, was)))
            yield f"| {title} | {len(cases)} | {' | '.join([*shown, *map(str, only)])} |"
    yield "\n| tier | of | right before | right now | seconds before | now | ratio |"
    yield "|---|---|---|---|---|---|---|"
    for tier in dict.fromkeys(truth[name]["tier"] for name in both):
        cases = [name for name in both if truth[name]["tier"] == tier]
        rights, seconds = [], []
        for rows in (before, now):
            rights.append(sum(right(truth[name], rows[name]["answer"]) for name in cases))
            spent = sum(rows[name].get("seconds", math.nan) for name in cases)
            seconds.append(spent / len(cases))
        yield (
            f"| {tier} | {len(cases)} | {rights[0]} | {rights[1]} "
            f"| {seconds[0]:.1f} | {seconds[1]:.1f} | {seconds[1] / seconds[0]:.2f} |"
        )


def intervals(rows: Mapping[str, Row], truth: Mapping[str, Row], folder: Path) -> Iterator[str]:
    """Lines of a table of how often intervals of 95 % hold the truth, in right diagnoses of causes
    that the catalogue has, and in identifications of rigs with which nothing is wrong.

    Values without a standard error, on a bound or not determined, are counted apart.  A parameter
    is *determined* where its standard error is less than half of what is believed of it.
    """
    held: dict[str, list[bool]] = {"parameters": [], "sizes of effects": [], DETERMINED: []}
    unknown = dict.fromkeys(held, 0)
    for name, case in ((it, truth[it]) for it in rows if it in truth):
        answer = rows[name]["answer"]
        trusted = right(case, answer) if "verdict" in answer else case["kind"] == "nothing"
        if case["kind"] == "foreign" or not trusted:
            continue
        told = read_description(folder / "cases" / case["case"] / "description.toml")
        believed = {free.name: free.prior for free in prior_parameters(told)}
        sizes = {key: v for it in case["effects"] for key, v in it["parameters"].items()}
        known = {**case["parameters"], **sizes}
        for key, (value, error) in rows[name]["answer"].get("values", {}).items():
            what = "sizes of effects" if key in sizes else "parameters"
            if key not in known:
                continue
            if error is None or not math.isfinite(error):
                unknown[what] += 1
                continue
            inside = abs(value - known[key]) <= NORMAL_95 * error
            determined = DETERMINED if error < 0.5 * (believed.get(key) or 0.0) else ""
            for title in (what, key.partition(".")[0] if key in sizes else determined):
                held.setdefault(title, []).append(inside)
    yield "\n| 95 % intervals | of | hold the truth | without |"
    yield "|---|---|---|---|"
    for title, inside in held.items():
        if title and inside:
            it = share(inside)
            shown = f"{it.value:.2f} ({it.low:.2f} to {it.high:.2f})"
            yield f"| {title} | {len(inside)} | {shown} | {unknown.get(title, '')} |"


def read_rows(path: Path) -> dict[str, Row]:
    """Return the rows of a file of answers by their case."""
    rows = [json.loads(line) for line in path.read_text("utf-8").splitlines()]
    return {row["case"]: row for row in rows}


def texts_of(rows: Mapping[str, Row]) -> dict[str, str]:
    """Return the reports in rows, by the name of their file."""
    return {
        f"{Path(name).name}_{kind}.txt": f"{text}\n"
        for name, row in rows.items()
        for kind, text in row["texts"].items()
    }


def write(rows: Mapping[str, Row], hashes: dict[str, str]) -> None:
    """Make these rows and inputs the golden ones."""
    path = GOLDEN / "answers.jsonl"
    answers = (
        {name: row["answer"] for name, row in read_rows(path).items()} if path.exists() else {}
    )
    answers |= {name: row["answer"] for name, row in rows.items()}
    lines = [json.dumps({"case": name, "answer": answers[name]}) + "\n" for name in sorted(answers)]
    write_whole(path, "".join(lines).encode())
    write_whole(
        GOLDEN / "inputs.json", f"{json.dumps(hashes, indent=0, sort_keys=True)}\n".encode()
    )
    (GOLDEN / "reports").mkdir(exist_ok=True)
    for name, text in texts_of(rows).items():
        write_whole(GOLDEN / "reports" / name, text.encode())
    print(f"{len(rows)} of {len(answers)} answers written")


def _report(name: str) -> str:
    path = GOLDEN / "reports" / name
    return path.read_text("utf-8") if path.exists() else ""


def compare(given: argparse.Namespace, rows: Mapping[str, Row], truth: Mapping[str, Row]) -> int:
    """Compare answers with those of a file, and print what differs."""
    stored = read_rows(given.against or GOLDEN / "answers.jsonl")
    lost = [name for name in rows if name not in stored]
    if lost:
        raise UserError(f"no answer of '{lost[0]}' is stored: write it first, --write")
    was = [stored[name] for name in rows]
    before = {row["case"]: row["answer"] for row in was}
    now = {name: row["answer"] for name, row in rows.items()}
    if set(truth) & set(now):
        print(*paired(stored, rows, truth), sep="\n")
    for key in ("seconds", "simulations"):
        if all(key in row for row in was):
            print(
                f"{key}:",
                *(f"{sum(row[key] for row in each):.0f}" for each in (was, rows.values())),
            )
    if given.compare == "verdicts":
        table = verdict_table(before, now, truth)
        told = [text for name in now for text in sizes_apart(name, before[name], now[name])]
        print(*table, *told, sep="\n")
        print(f"{len(rows)} answers, {len(table) - 1} verdicts changed, {len(told)} sizes apart")
        return 1 if told or len(table) > 1 else 0
    pairs = ((name, before[name], now[name]) for name in now)
    told = [text for pair in pairs for text in differences(*pair, given.relative)]
    texts = texts_of(rows)
    told += [f"reports/{name} differs" for name in texts if texts[name] != _report(name)]
    print(*told[:SHOWN], sep="\n")
    print(f"{len(rows)} answers and {len(texts)} reports, {len(told)} differences")
    return 1 if told else 0


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="a small share")
    parser.add_argument("--real", action="store_true", help="real logs as well")
    parser.add_argument(
        "--only", default="", metavar="KIND", help="such as withheld or papers/sg90"
    )
    parser.add_argument("--compare", choices=("equal", "verdicts"), default="equal")
    parser.add_argument("--relative", type=float, default=0.0, help="default: to the last digit")
    parser.add_argument("--write", action="store_true", help="make these answers the golden ones")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--cases", type=Path, metavar="FOLDER", help="generated cases instead")
    parser.add_argument("--out", type=Path, metavar="FILE", help="keep answers, to go on with")
    parser.add_argument("--identify", action="store_true", help="identify these cases instead")
    parser.add_argument(
        "--separable", action="store_true", help="of single causes count those that logs can tell"
    )
    parser.add_argument("--against", type=Path, metavar="FILE", help="compare with these answers")
    given = parser.parse_args()
    if given.cases and (given.write or not given.out):
        parser.error("--cases needs --out, and is never written to the golden set")
    try:
        with scratch() as folder:
            return run(given, folder)
    except (UserError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def run(given: argparse.Namespace, folder: Path) -> int:
    """Find the answers that are asked for, and compare or write them."""
    source = given.cases or GOLDEN
    find = identified if given.identify else diagnosed
    jobs = list(withheld(source, find, given.separable))
    if not given.cases:
        jobs += [*examples(), *(real_logs() if given.real else ())]
    jobs = [job for job in jobs if job.name.startswith(given.only) and job.quick >= given.quick]
    stored = GOLDEN / "inputs.json"
    known = json.loads(stored.read_text("utf-8")) if stored.exists() else {}
    hashes = {} if given.cases else check_inputs(jobs, known)

    def tell(_: str, done: int = 0, every: int | None = None) -> None:
        print(f"{done} of {every}", file=sys.stderr, flush=True)

    tasks = {job.name: job for job in jobs}
    out = given.out or folder / "answers.jsonl"
    known_rows = work_through(out, tasks, answered, given.jobs, tell, "")
    rows = {name: known_rows[name] for name in tasks}
    if given.write:
        write(rows, hashes)
        return 0
    if given.cases:
        print(*intervals(rows, truths(source), source), sep="\n")
    if given.cases and not given.against:
        return 0
    return compare(given, rows, truths(source))


if __name__ == "__main__":
    # by a name under which other processes find what they do
    raise SystemExit(importlib.import_module("studies.golden").main())
