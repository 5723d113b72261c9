"""Random sequences of FMI calls on the native FMUs, in C: ``fmi_calls.c`` says what is checked.

    python tests/fuzz/native.py [--sequences 100000] [--seed 0] [ACTUATOR ...]
    python tests/fuzz/native.py --sanitize     # with the address and undefined-behaviour sanitizers
    python tests/fuzz/native.py --valgrind
    python tests/fuzz/native.py --threads 4    # with the thread sanitizer
    python tests/fuzz/native.py --fmi 3        # the FMUs of FMI 3.0, by fmi3_as_fmi2.c

The sources of each FMU are compiled anew for this.  Batches run in processes of their own, so a
crash, a hang or a report of a sanitizer is counted, and its sequence named; ``--sequences 1
--seed N`` plays that one alone.  ``tests/fmu/test_fuzz_native.py`` runs a share.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import fmpy

from fmu_src.native.archive import headers
from servo_models.build import FMI3, NATIVE, build
from servo_models.catalogue import actuators, model
from servo_models.core.simulate import Model

HERE = Path(__file__).parent
SUPPORT = HERE.parent / "support"
BATCH = {"plain": 1000, "sanitize": 500, "valgrind": 100, "threads": 100}
"""Sequences in a process, by mode: some seconds."""
PATIENCE = 600.0  # seconds for a batch; the driver itself gives up a sequence after 60
LAST_CALLS = 40  # lines shown of a sequence at fault
REPORTED = 99  # exit code of valgrind and the sanitizers, after a report
FLAGS = ("-O1", "-g", "-fPIC", "-ffp-contract=off", "-Wall", "-Wextra")
MODE_FLAGS = {
    "sanitize": ("-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all"),
    "threads": ("-fsanitize=thread",),
}
SCARCE = ("-Dmalloc=scarce_malloc", "-Dcalloc=scarce_calloc")  # the driver lets memory run out
VALGRIND = (
    *("valgrind", "-q", f"--error-exitcode={REPORTED}", "--exit-on-first-error=yes"),
    *("--leak-check=full", "--errors-for-leak-kinds=definite,indirect,possible"),
)


@dataclass(frozen=True)
class Subject:
    """A compiled FMU and the driver for it."""

    driver: Path
    library: Path
    variables: Path
    mode: str


@dataclass
class Outcome:
    """What came of sequences.

    Attributes:
        counts: sequences played, calls, refused ones, steps.
        faults: the text of each.
    """

    counts: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)


def has(mode: str) -> bool:
    """Whether what a mode needs is on this machine."""
    if sys.platform != "linux" or shutil.which("cc") is None:
        return False
    if mode == "valgrind":
        return shutil.which("valgrind") is not None
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "empty.c"
        source.write_text("int main(void) { return 0; }\n")
        words = ["cc", *MODE_FLAGS.get(mode, ()), str(source), "-o", str(source.with_suffix(""))]
        built = subprocess.run(words, capture_output=True, check=False).returncode == 0
        return built and subprocess.run([source.with_suffix("")], check=False).returncode == 0


def unpacked(chosen: Model, folder: Path, kind: str = NATIVE) -> Path:
    """Return the folder of a native FMU of ``chosen``."""
    return Path(fmpy.extract(str(build(chosen, folder / "it.fmu", kind)), str(folder / "fmu")))


def variables_of(fmu: Path) -> str:
    """Return what the driver is to know of an unpacked FMU."""
    description = fmpy.read_model_description(str(fmu))
    identity = description.guid or description.instantiationToken
    text = (fmu / "modelDescription.xml").read_text(encoding="utf-8")
    derives = re.search('providesDirectionalDerivatives?="true"', text)  # fmpy knows that of 2.0
    lines = [f"{identity} {int(derives is not None)}"]
    for v in description.modelVariables:
        kind = {"independent": "output"}.get(v.causality, v.causality)
        if kind == "parameter" and v.variability == "fixed":
            kind = "fixed"
        if kind == "output" and v.type == "Boolean":
            kind = "flag"
        low, high = v.min or -sys.float_info.max, v.max or sys.float_info.max
        lines.append(
            f"{kind} {v.valueReference} {low} {high} {v.start or 0} {v.nominal or 1} {v.name}"
        )
    return "\n".join(lines) + "\n"


def compiled_driver(mode: str, folder: Path) -> Path:
    driver = folder / f"fmi_calls_{mode}"
    libraries = ("-rdynamic", "-o", driver, "-ldl", "-lm", "-lpthread")
    _compile(mode, "-std=c11", f"-I{SUPPORT}", HERE / "fmi_calls.c", *libraries)
    return driver


def compiled_library(fmu: Path, mode: str, folder: Path) -> Path:
    """Compile the sources of an unpacked FMU."""
    library = folder / f"fmu_{mode}.so"
    sources = fmu / "sources"
    main = sources / "fmi2.c"
    source = main if main.exists() else HERE / "fmi3_as_fmi2.c"
    _compile(mode, "-std=c99", *SCARCE, f"-I{sources}", source, "-shared", "-o", library, "-lm")
    return library


def _compile(mode: str, *words: str | Path) -> None:
    flags = (*FLAGS, *MODE_FLAGS.get(mode, ()), f"-I{headers()}")
    done = subprocess.run(["cc", *flags, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def subject_of(fmu: Path, mode: str, driver: Path, folder: Path) -> Subject:
    """Prepare an unpacked FMU for a driver of the same mode, in a folder of its own."""
    folder.mkdir()
    variables = folder / "variables.txt"
    variables.write_text(variables_of(fmu))
    return Subject(driver, compiled_library(fmu, mode, folder), variables, mode)


def run(subject: Subject, seeds: range, threads: int = 0) -> Outcome:
    """Play the sequences of ``seeds``; a batch goes on behind a sequence at fault."""
    outcome = Outcome()
    first = seeds.start
    while first < seeds.stop:
        count = min(BATCH[subject.mode], seeds.stop - first)
        text, fault = _batch(subject, first, count, threads)
        begun = [line for line in text.splitlines() if line.startswith("seed ")]
        if fault:
            at = int(begun[-1].split()[1]) if begun else None
            outcome.faults.append(fault if at is None else f"{fault}\n{_calls(subject, at)}")
            count = count if at is None else at + 1 - first
        else:
            words = text.splitlines()[-1].split()
            outcome.counts.update(dict(zip(words[::2], map(int, words[1::2]))))
        first += count
    return outcome


def _calls(subject: Subject, seed: int) -> str:
    """Return the last calls of a sequence at fault, which is played once more."""
    words = [subject.driver, subject.library, subject.variables, str(seed), "1"]
    done = subprocess.run(
        words,
        capture_output=True,
        text=True,
        errors="replace",
        timeout=PATIENCE,
        check=False,
        env={**os.environ, "FMI_CALLS_TRACE": "1"},
    )
    return "\n".join(done.stdout.splitlines()[-LAST_CALLS:])


def _batch(subject: Subject, first: int, count: int, threads: int) -> tuple[str, str]:
    """Return what the driver printed, and the text of a fault."""
    report = subject.library.parent / f"report-{first}"
    checked = f"log_path={report}:exitcode={REPORTED}:halt_on_error=1:abort_on_error=0"
    words = [subject.driver, subject.library, subject.variables, str(first), str(count)]
    words = [*words, str(threads)] if threads else words
    if subject.mode == "valgrind":
        words = [*VALGRIND, f"--log-file={report}", *words]
    try:
        done = subprocess.run(
            words,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=PATIENCE,
            check=False,
            env={**os.environ, **dict.fromkeys(_OPTIONS, checked)},
        )
    except subprocess.TimeoutExpired as error:
        return str(error.stdout), f"sequences {first} to {first + count - 1}: no end"
    if done.returncode == 0:
        return done.stdout, ""
    reports = [path.read_text(errors="replace") for path in report.parent.glob(f"{report.name}*")]
    lines = [line for line in done.stdout.splitlines() if not line.startswith("seed ")]
    seeds = [line for line in done.stdout.splitlines() if line.startswith("seed ")]
    where = f"{seeds[-1] if seeds else f'seeds from {first} on'}: exit code {done.returncode}"
    return done.stdout, "\n".join([where, *lines, *reports, done.stderr]).strip()


_OPTIONS = ("ASAN_OPTIONS", "UBSAN_OPTIONS", "TSAN_OPTIONS")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sequences", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    mode = parser.add_mutually_exclusive_group()
    mode.add_argument("--sanitize", action="store_true")
    mode.add_argument("--valgrind", action="store_true")
    mode.add_argument("--threads", type=int, default=0)
    parser.add_argument("--fmi", type=int, choices=(2, 3), default=2)
    parser.add_argument("actuators", nargs="*", default=list(actuators()))
    chosen = parser.parse_args(arguments)
    name = next((n for n in ("sanitize", "valgrind", "threads") if getattr(chosen, n)), "plain")
    failed = False
    with tempfile.TemporaryDirectory() as scratch:
        driver = compiled_driver(name, Path(scratch))
        for actuator in chosen.actuators:
            folder = Path(scratch) / actuator
            folder.mkdir()
            kind = NATIVE if chosen.fmi == 2 else FMI3
            fmu = unpacked(model(actuator), folder, kind)
            subject = subject_of(fmu, name, driver, folder / name)
            seeds = range(chosen.seed, chosen.seed + chosen.sequences)
            found = run(subject, seeds, chosen.threads)
            counted = ", ".join(f"{count} {what}" for what, count in found.counts.items())
            print(
                f"{actuator}, FMI {chosen.fmi}, {name}: {counted}: {len(found.faults)} faults",
                flush=True,
            )
            print(*found.faults[:5], sep="\n\n", end="\n" if found.faults else "")
            failed = failed or bool(found.faults)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
