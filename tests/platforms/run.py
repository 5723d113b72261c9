"""Step native FMUs built for Windows and for Linux on ARM on this Linux machine, and compare.

    python tests/platforms/run.py [--host examples/c_host/host.c] [ACTUATOR ...]

Each FMU and a host in C are built by zig for Linux (x86-64 and ARM) and for Windows, and stepped
here, by wine and by qemu: at the values of its variant, with each effect in turn and with all of
them.  Told is the largest difference from Linux x86-64, as a share of the largest value of that
output.  It is not zero: each platform has an exp and a sin of its own.

Needs ``pip install ".[native]"`` and, on Debian, ``apt-get install wine64 qemu-user
libc6-arm64-cross``.
"""

from __future__ import annotations

import argparse
import csv
import math
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from fmu_src.native.archive import NATIVE, headers, native_entries
from servo_models.catalogue import actuators, model
from servo_models.core.compilers import TARGETS, Target, zig
from servo_models.core.simulate import Model
from servo_models.files import cache_folder
from tests.support.sources import ROOT

ARM_LIBRARIES = "/usr/aarch64-linux-gnu"
RUNNERS = {
    "linux-x86_64": [[]],
    "linux-aarch64": [["qemu-aarch64", "-L", ARM_LIBRARIES]],
    "windows-x86_64": [["wine64"], ["wine"]],
}
SECONDS = 600  # for one run; the first of wine makes its folder

Columns = dict[str, list[float]]


def runner(target: Target) -> list[str] | None:
    """What runs a program of a platform here; None if nothing does."""
    for words in RUNNERS[target.name]:
        if not words or (shutil.which(words[0]) and (len(words) == 1 or Path(words[-1]).is_dir())):
            return words
    return None


def build_all(chosen: Model, host: Path, target: Target, folder: Path) -> list[str]:
    """Put host, library and description into a folder; return the words that run them."""
    made_by = zig()
    if made_by is None:
        raise SystemExit('no ziglang: pip install ".[native]"')
    entries = native_entries(chosen, NATIVE, made_by, [target])
    (binary,) = (name for name in entries if name.startswith("binaries/"))
    library = f"library{target.suffix}"
    (folder / library).write_bytes(entries[binary])
    (folder / "modelDescription.xml").write_bytes(entries["modelDescription.xml"])
    program = "host.exe" if target.suffix == ".dll" else "host"
    # without contraction, since the host computes its communication steps
    flags = ["-target", target.zig_triple, "-O2", "-s", "-ffp-contract=off", f"-I{headers()}"]
    words = [*flags, str(host), "-o", program]
    words += [] if target.suffix == ".dll" else ["-ldl", "-lm"]
    caches = {
        "ZIG_GLOBAL_CACHE_DIR": str(cache_folder() / "zig"),
        "ZIG_LOCAL_CACHE_DIR": str(folder / "zig"),
    }
    subprocess.run([*made_by.command, *words], cwd=folder, env=os.environ | caches, check=True)
    return [f"./{program}", "modelDescription.xml", f"./{library}"]


def cases(chosen: Model) -> dict[str, dict[str, float]]:
    """Values to set, by what is tried: nothing, each effect at a visible value, and all."""
    names = {parameter.text: parameter for parameter in chosen.plant.parameters.values()}
    each = {
        effect: {names[switch].name: names[switch].param.typical for switch in switches}
        for effect, switches in chosen.flat.switches.items()
    }
    every = {name: value for values in each.values() for name, value in values.items()}
    return {"no effect": {}, **each, "all effects": every}


def run(words: list[str], chosen: Model, values: Mapping[str, float], folder: Path) -> Columns:
    """Step an FMU through its default experiment; return what the host prints."""
    environment = {**os.environ, "WINEPREFIX": str(folder.parent / "wine"), "WINEDEBUG": "-all"}
    numbers = [repr(chosen.stop_time), repr(chosen.step_size)]
    starts = [f"{name}={value!r}" for name, value in values.items()]
    printed, told = folder / "printed.csv", folder / "told.txt"
    with printed.open("w") as out, told.open("w") as err:  # wine's servers keep a pipe open
        done = subprocess.run(
            [*words, *numbers, *starts],
            cwd=folder,
            env=environment,
            timeout=SECONDS,
            stdout=out,
            stderr=err,
            check=False,
        )
    if done.returncode:
        raise SystemExit(f"{words[0]} ended with {done.returncode}: {told.read_text()[-1000:]}")
    head, *rows = csv.reader(printed.read_text().splitlines())
    assert len(rows) == round(chosen.stop_time / chosen.step_size) + 1
    return {name: [float(row[i]) for row in rows] for i, name in enumerate(head)}


def difference(found: Columns, wanted: Columns) -> tuple[float, str]:
    """Return the largest difference as a share of the largest value, and of which output."""
    assert found.keys() == wanted.keys()
    assert found["time"] == wanted["time"]
    shares = []
    for name, values in wanted.items():
        assert all(map(math.isfinite, [*values, *found[name]]))
        scale = max(map(abs, values)) or 1.0
        shares.append((max(abs(a - b) for a, b in zip(found[name], values)) / scale, name))
    return max(shares)


def compare(name: str, host: Path, folder: Path) -> None:
    """Run one actuator's FMU on every platform, and print how far each is from the first."""
    chosen = model(name)
    wanted: dict[str, Columns] = {}
    for target in TARGETS:
        if target.name not in RUNNERS:
            print(f"{name:13} {target.name:15} not run: nothing runs it here")
            continue
        words = runner(target)
        if words is None:
            print(f"{name:13} {target.name:15} not run: no {RUNNERS[target.name][0][0]}")
            continue
        place = folder / f"{name}-{target.name}"
        place.mkdir()
        program = [*words, *build_all(chosen, host, target, place)]
        found = {case: run(program, chosen, set_, place) for case, set_ in cases(chosen).items()}
        if not wanted:
            wanted = found
            print(f"{name:13} {target.name:15} {len(found)} runs, with which others are compared")
            continue
        shares = {case: (*difference(found[case], wanted[case]), case) for case in wanted}
        worst = max(shares.values())
        equal = sum(share == 0.0 for share, *_ in shares.values())
        told = (
            "every number equal"
            if worst[0] == 0.0
            else (
                f"{equal} equal; no effect {shares['no effect'][0]:.1e},"
                f" all effects {shares['all effects'][0]:.1e}, largest {worst[0]:.1e}"
                f" ({worst[1]}, {worst[2]})"
            )
        )
        print(f"{name:13} {target.name:15} {len(found)} runs, {told}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("actuators", nargs="*", default=list(actuators()), metavar="ACTUATOR")
    parser.add_argument("--host", type=Path, default=ROOT / "examples" / "c_host" / "host.c")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for name in given.actuators:
            compare(name, given.host.resolve(), Path(folder))
        if shutil.which("wineserver"):
            prefix = {"WINEPREFIX": str(Path(folder) / "wine")}
            subprocess.run(["wineserver", "-k"], env=os.environ | prefix, check=False)


if __name__ == "__main__":
    main()
