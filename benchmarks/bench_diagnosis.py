"""Speed of a diagnosis: two long logs, the full catalogue, pairs included.

    python -m benchmarks.bench_diagnosis
    python -m benchmarks.bench_diagnosis --against FOLDER   # ratios to the code in FOLDER
    python -m benchmarks.bench_diagnosis --against FOLDER --only "ten motions" --turns 1
    python -m benchmarks.bench_diagnosis --picture FILE     # growth, as a picture

A 60 s log of the SG90 at 200 Hz and 1 s of the torque motor at 10 kHz, each with one effect that
the model lacks, are written as files.  The command runs on them as a process of its own, first
with an empty cache, then again; and on logs with two such effects, and with a hum that is no effect
of the catalogue, for which pairs and further effects are sought.  After that, in this process, how
the cost grows with the length of a log and with the number of effects, and what a second processor
brings.

The code to compare with is another commit in a folder of its own (``git worktree add FOLDER
COMMIT``).  Both diagnose the same files in processes of their own, in turn, three times; ratios are
of processor seconds within the diagnosis, the least of each, so that what runs beside them does not
count.  A diagnosis that takes more than ``--timeout`` seconds of the wall clock is ended and not
run again.  Real logs are compared where SERVO_MODELS_DATA names their folder.
"""

from __future__ import annotations

import argparse
import math
import os
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.diagnosis.diagnose import diagnose
from servo_models.diagnosis.search.candidates import candidates
from studies.second_plant import long_logs

COMMAND = "import sys; from servo_models.cli import main; sys.exit(main())"
PEAK = (
    "import resource, subprocess, sys; code = subprocess.run(sys.argv[1:],"
    " stdout=subprocess.DEVNULL).returncode;"
    "print(code, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024)"
)

TIMED = (
    "import resource, sys, time, warnings; from pathlib import Path; import servo_models;"
    "warnings.simplefilter('ignore'); path = Path(sys.argv[1]);"
    "begin = time.process_time(); found = servo_models.diagnose(path, jobs=1);"
    "print(time.process_time() - begin,"
    " resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, found.verdict.kind)"
)
HERE = Path(__file__).resolve().parent.parent
LOGS = Path(os.environ.get("SERVO_MODELS_DATA", HERE.parent / "shared" / "data"))
SEED, WITHHELD = 101, 3
"""Withheld cases are one of each tier."""
LONG = {
    "STS3215, ten motions": long_logs.sts3215_joint,
    "current motor, spin-ups": long_logs.current_motor,
    "servo with known loads": long_logs.loaded_servo,
}
REAL = {
    "EMPS": "emps",
    "SG90, 52 real steps": "sg90_steps",
    "SO-101, wrist roll": "so101_wrist_roll",
}

NOISE, HUM = 2e-3, 1e-2
"""Of a reading's range: its noise, and the amplitude of a hum of 50 Hz."""
SECOND = {
    "sg90": {"backlash.half_width": 0.02},
    "torque_motor": {"transport_delay.time": 5e-4},
}
"""The effect that a log with two has beside the first one, by actuator."""


def excitation(count: int) -> Array:
    """Steps of several sizes, a slow triangle and a chirp, in shares of the largest."""
    third = count // 3
    levels = np.array([0.0, 0.1, 0.0, -0.3, 0.0, 0.6, -0.6, 1.0, -1.0, 0.0])
    steps = np.repeat(levels, third // len(levels) + 1)[:third]
    ramp = np.arange(third) / third
    triangle = 0.25 * np.interp(ramp, [0.0, 0.25, 0.75, 1.0], [0.0, 1.0, -1.0, 0.0])
    rest = np.arange(count - 2 * third) / (count - 2 * third)
    chirp = 0.3 * np.sin(2.0 * np.pi * count / 240.0 * (0.02 * rest + 0.48 * rest**2))
    return np.concatenate([steps, triangle, chirp])


def sg90(folder: Path, seconds: float = 60.0, second: bool = False, hum: float = 0.0) -> Path:
    times: Array = 5e-3 * np.arange(200.0 * seconds)
    pulse: Array = 1.5e-3 + 500e-6 * excitation(len(times))
    rig = {"drive_saturation.limit": 3.0, "motor_gain": 47.0}
    rig |= SECOND["sg90"] if second else {}
    uncertain = "motor_time_constant = '20 %'\nmotor_gain = '10 %'\namplifier_gain = '20 %'\n"
    uncertain += "transport_delay.time = '35 %'\npotentiometer_gain = '5 %'\n"
    return write(folder, "sg90", times, "pulse_width", pulse, "angle_reading", rig, hum, uncertain)


def torque_motor(
    folder: Path, seconds: float = 1.0, second: bool = False, hum: float = 0.0
) -> Path:
    times: Array = 1e-4 * np.arange(10_000.0 * seconds)
    volts: Array = np.round(30.0 * excitation(len(times)), 3)
    rig = {"coulomb_friction.level": 2e-3, "torque_constant": 5.2}
    rig |= SECOND["torque_motor"] if second else {}
    uncertain = "torque_constant = '25 %'\ninductance = '25 %'\nback_emf_constant = '50 %'\n"
    uncertain += "friction_coefficient = '50 %'\nresistance = '1 %'\nstiffness = '1 %'\n"
    return write(folder, "torque_motor", times, "voltage", volts, "angle", rig, hum, uncertain)


def write(
    folder: Path,
    actuator: str,
    times: Array,
    command: str,
    values: Array,
    output: str,
    rig: Mapping[str, float],
    hum: float,
    uncertain: str,
) -> Path:
    """A log of a simulated rig with noise of 0.2 % of its range, and its description."""
    measured = simulate(model(actuator, "measured", dict(rig)), times, {command: values})[output]
    noise = NOISE * np.random.default_rng(1).standard_normal(len(times))
    noise += hum * np.sin(2.0 * np.pi * 50.0 * times + 1.0)
    rows = np.column_stack([times, values, measured + np.ptp(measured) * noise])
    np.savetxt(folder / f"{actuator}.csv", rows, delimiter=",", header="t,u,y", comments="")
    unit = "s" if command == "pulse_width" else "V"
    path = folder / f"{actuator}.toml"
    path.write_text(
        f"actuator = '{actuator}'\nvariant = 'measured'\n\n[uncertainty]\n{uncertain}\n"
        f"[[logs]]\nfile = '{actuator}.csv'\ntime = {{ column = 't', unit = 's' }}\n"
        f"inputs.{command} = {{ column = 'u', unit = '{unit}' }}\n"
        f"outputs.{output} = {{ column = 'y', unit = 'rad' }}\n",
        encoding="utf-8",
    )
    return path


def whole_process(path: Path, cache: Path) -> tuple[float, float]:
    """Seconds and MiB of ``servo-models diagnose`` as a user runs it."""
    environment = {**os.environ, "SERVO_MODELS_CACHE": str(cache)}
    order = [sys.executable, "-c", COMMAND, "diagnose", str(path), "--format", "json"]
    begin = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", PEAK, *order],
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    )
    code, peak = done.stdout.split()
    if code not in ("0", "1"):
        raise SystemExit(f"diagnose ended with {code}: {done.stderr}")
    return time.perf_counter() - begin, float(peak)


def seconds(path: Path, jobs: int = 2, left_out: tuple[str, ...] = ()) -> float:
    begin = time.perf_counter()
    diagnose(path, jobs=jobs, left_out=left_out)
    return time.perf_counter() - begin


def processor_time(path: Path, left_out: tuple[str, ...] = ()) -> float:
    """Seconds of one processor, so that what runs beside does not count."""
    begin = time.process_time()
    diagnose(path, jobs=1, left_out=left_out)
    return time.process_time() - begin


def compared_cases(folder: Path) -> dict[str, Path]:
    """Descriptions of the cases that two codes are compared by, by their titles."""
    cases: dict[str, Path] = {}
    order = [sys.executable, "-m", "servo_models.withheld.generator", str(folder / "withheld")]
    order += ["--cases", str(WITHHELD), "--seed", str(SEED)]
    subprocess.run(order, check=True, capture_output=True)
    for k, path in enumerate(sorted((folder / "withheld" / "cases").iterdir())):
        cases[f"withheld, {('easy', 'hard', 'poor')[k % 3]}"] = path / "description.toml"
    for title, hum in (("one effect", 0.0), ("unknown cause", HUM)):
        made = folder / title.replace(" ", "_")
        made.mkdir()
        cases[f"SG90, 60 s, {title}"] = sg90(made, hum=hum)
    cases |= {title: made(folder / made.__name__) for title, made in LONG.items()}
    for title, name in REAL.items() if LOGS.is_dir() else ():
        text = (HERE / "examples/real_logs/diagnosis" / f"{name}.toml").read_text(encoding="utf-8")
        cases[title] = folder / f"{name}.toml"
        cases[title].write_text(text.replace("../logs", LOGS.as_posix()), encoding="utf-8")
    return cases


def processor_seconds(
    code: Path, path: Path, cache: Path, longest: float
) -> tuple[float, float, str]:
    """Processor seconds, peak memory [MiB] and verdict of a diagnosis by the code in a folder.

    The seconds are infinite where it has not ended after the longest time [s].
    """
    environment = {
        **os.environ,
        "PYTHONPATH": str(code),
        "SERVO_MODELS_CACHE": str(cache),
        "OPENBLAS_NUM_THREADS": "1",
    }
    try:
        done = subprocess.run(
            [sys.executable, "-c", TIMED, str(path)],
            cwd=path.parent,  # Python would import from the folder in which this was started
            env=environment,
            check=True,
            capture_output=True,
            text=True,
            timeout=longest,
        )
    except subprocess.TimeoutExpired:
        return math.inf, math.nan, "no end"
    spent, peak, verdict = done.stdout.split(maxsplit=2)
    return float(spent), float(peak), verdict.strip()


def compare(other: Path, wanted: str, turns: int, longest: float) -> None:
    """Print ratios of this code to the other one, for cases whose title holds ``wanted``.

    Each code diagnoses a case ``turns`` times, after a first time that compiles, and ends a
    diagnosis after the longest time [s].
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        print(f"{'case':26} {'before':>9} {'now':>9} {'ratio':>6} {'memory':>14}  verdict")
        for title, path in compared_cases(folder).items():
            if wanted not in title:
                continue
            codes = {"before": other, "now": HERE}
            runs = {  # of the first one, which compiles
                which: [processor_seconds(code, path, folder / which, longest)]
                for which, code in codes.items()
            }
            ended = {
                which: codes[which] for which, ((spent, *_),) in runs.items() if spent < math.inf
            }
            for _ in range(turns):
                for which, code in ended.items():
                    runs[which].append(processor_seconds(code, path, folder / which, longest))
            (old, old_peak, said), (new, peak, says) = map(min, runs.values())
            verdict = says if says == said else f"{said}, now {says}"
            memory = f"{old_peak:.0f} -> {peak:.0f} MiB"
            took = [f"{it:.2f} s" if it < math.inf else f"> {longest:g} s" for it in (old, new)]
            ratio = f"{new / old:.2f}" if max(old, new) < math.inf else ""
            print(
                f"{title:26} {took[0]:>9} {took[1]:>9} {ratio:>6} {memory:>14}  {verdict}",
                flush=True,
            )


def repeated(path: Path, count: int) -> Path:
    """The description with its log so many times."""
    head, log = path.read_text("utf-8").split("[[logs]]")
    every = "".join(f"[[logs]]\nname = 'log {k}'{log}" for k in range(count))
    path.write_text(head + every, encoding="utf-8")
    return path


def picture(file: Path) -> None:
    """Draw how the cost of the SG90's log grows with its length, with the number of logs and with
    the catalogue."""
    import matplotlib.pyplot as plt

    shares = (0.25, 0.5, 0.75, 1.0)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        names = [it.name for it in candidates(model("sg90", "measured"), ())]
        names.remove("drive_saturation")
        processor_time(sg90(folder, 5.0))  # compiles
        length = [processor_time(sg90(folder, 60.0 * share)) for share in shares]
        logs = [processor_time(repeated(sg90(folder, 15.0), count)) for count in range(1, 5)]
        path = sg90(folder)
        effects = [
            processor_time(path, tuple(names[int(share * len(names)) :])) for share in shares
        ]
    _, axes = plt.subplots(figsize=(5.0, 3.2), layout="constrained")
    axes.plot(shares, length, "o-", label="length of the log, of 60 s")
    axes.plot(shares, logs, "^:", label="number of logs of 15 s, of 4")
    axes.plot(shares, effects, "s--", label=f"effects of the catalogue, of {len(names) + 1}")
    axes.set(xlabel="share", ylabel="time of one processor [s]", xlim=(0.0, 1.05), ylim=(0.0, None))
    axes.legend()
    plt.savefig(file)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--against", type=Path, metavar="FOLDER", help="with another commit")
    parser.add_argument("--only", default="", metavar="WORD", help="of the cases compared")
    parser.add_argument("--turns", type=int, default=3, metavar="N", help="runs of each code")
    parser.add_argument("--timeout", type=float, default=300.0, metavar="SECONDS", help="of a run")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="growth, as a picture")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    if given.against:
        compare(given.against.resolve(), given.only, given.turns, given.timeout)
    elif given.picture:
        picture(given.picture)
    else:
        everything()


def everything() -> None:
    """Print what this code takes."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        logs = {
            "SG90, 60 s at 200 Hz": sg90(folder),
            "torque motor, 1 s at 10 kHz": torque_motor(folder),
        }
        print(f"{'whole process':30} {'cold':>8} {'warm':>8} {'memory':>10}")
        for title, path in logs.items():
            cache = folder / f"cache_{path.stem}"
            cold, _ = whole_process(path, cache)
            warm, peak = whole_process(path, cache)
            print(f"{title:30} {cold:6.1f} s {warm:6.1f} s {peak:6.0f} MiB")
        made = {"sg90": sg90, "torque_motor": torque_motor}
        print(f"\n{'whole process, warm':30} {'one':>8} {'two':>8}  {'unknown':>8}")
        for title, path in logs.items():
            cache, spent = folder / f"cache_{path.stem}", []
            for second, hum in ((False, 0.0), (True, 0.0), (False, HUM)):
                made[path.stem](folder, second=second, hum=hum)
                spent.append(whole_process(path, cache)[0])
            print(f"{title:30}" + "".join(f"{it:7.1f} s" for it in spent))
        print("\nlog length, over that above      1/4     1/2       1       2")
        for title, path in logs.items():
            whole = 60.0 if path.stem == "sg90" else 1.0
            spent = [seconds(made[path.stem](folder, share * whole)) for share in (0.25, 0.5, 1, 2)]
            print(f"{title:30}" + "".join(f"{it:6.1f} s" for it in spent))
        print("\neffects in the catalogue         1/4     1/2     3/4     all")
        for title, path in logs.items():
            made[path.stem](folder)
            names = [it.name for it in candidates(model(path.stem, "measured"), ())]
            cause = "drive_saturation" if path.stem == "sg90" else "coulomb_friction"
            names.remove(cause)
            spent = [
                seconds(path, left_out=tuple(names[int(share * len(names)) :]))
                for share in (0.25, 0.5, 0.75, 1.0)
            ]
            print(f"{title:30}" + "".join(f"{it:6.1f} s" for it in spent))
        print("\njobs                               1       2   ratio")
        for title, path in logs.items():
            one, two = seconds(path, jobs=1), seconds(path, jobs=2)
            print(f"{title:30}{one:6.1f} s{two:6.1f} s  {one / two:.2f}")


if __name__ == "__main__":
    main()

# Result against commit f5e93ae: processor seconds of one process, beside other work; CPython 3.11,
# numba 0.68, a C compiler.  Of the last three the code before was measured on another day.
#
# case                          before       now  ratio         memory
# SG90, 60 s, one effect        6.78 s    7.17 s   1.06 346 -> 310 MiB
# SG90, 60 s, unknown cause    27.01 s   12.89 s   0.48 565 -> 441 MiB
# EMPS                          60.5 s    20.1 s   0.33
# SO-101, wrist roll             425 s     118 s   0.28
# SG90, 52 real steps            716 s      42 s   0.06
#
# Withheld cases, means of 50 a tier (python -m studies golden --cases, seed 20263010):
# easy 4.0 and 2.1 s, hard 5.7 and 2.5 s, poor 4.6 and 2.0 s.
#
# Growth, of 1/4 to all of 60 s: 1.9, 3.4, 5.1, 6.4 s; of 1 to 4 logs of 15 s: 1.8, 3.4, 4.8, 6.5 s.
