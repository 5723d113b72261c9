"""What has to hold before a release: ``python tests/release.py OUT``, some twenty minutes.

It builds wheel and sdist twice and compares their bytes, installs the wheel in empty environments,
with every Python at hand and the newest versions of all dependencies, with the oldest Python and
the lowest ones, runs ``smoke.py`` there, resolves all extras, and writes ``OUT``: the files to
publish, ``sbom.json`` (CycloneDX), and ``constraints.txt``, the versions that were tried.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from importlib.metadata import distributions
from pathlib import Path
from zipfile import ZipFile

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
PYTHONS = ("3.10", "3.11", "3.12", "3.13")
EXTRAS = "logs,survey,cluster,native,benchmark,test"
FORBIDDEN = re.compile(r"\b(AGPL|GPL)|GNU (Affero )?General Public", re.IGNORECASE)
"""Licences that whoever builds on this package could not take over; the LGPL is no such."""
TOOLS = ("build", "twine", "cyclonedx-bom")


def run(*words: str | Path, **environment: str) -> str:
    """Run a command and return what it prints.

    Raises:
        SystemExit: it fails.
    """
    known = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        words, cwd=ROOT, env=known | environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"{' '.join(map(str, words))}\n{done.stdout}{done.stderr}")
    return done.stdout


def runs(python: str) -> bool:
    """Whether there is such an interpreter; some managers of versions leave a name for each."""
    found = shutil.which(python)
    return found is not None and subprocess.run((found, "-c", ""), check=False).returncode == 0


def environment(python: str | Path, folder: Path, *packages: str | Path) -> Path:
    """Make an environment with packages; return its interpreter."""
    run(python, "-m", "venv", folder)
    interpreter = folder / "bin" / "python"
    run(interpreter, "-m", "pip", "install", "--quiet", "--no-compile", *packages)
    return interpreter


def built(tools: Path, folder: Path, commit: str) -> list[Path]:
    """Build wheel and sdist of the files of a commit, nothing else, and return them."""
    source, out = folder / "source", folder / "dist"
    run("git", "clone", "--quiet", ROOT, source)
    run("git", "-C", source, "checkout", "--quiet", commit)
    epoch = run("git", "-C", source, "log", "-1", "--format=%ct").strip()
    run(tools, "-m", "build", "--outdir", out, source, SOURCE_DATE_EPOCH=epoch)
    return sorted(out.iterdir())


def lowest() -> list[str]:
    """The lowest version that is allowed of every dependency, as requirements."""
    lines = (ROOT / "pyproject.toml").read_text("utf-8").split("dependencies = [")[1].split("]")[0]
    found = re.findall(r'"([^=<>]+)[=>]=([0-9.]+)[^;"]*(;[^"]*)?"', lines)
    return [f"{name}=={version}{marker}" for name, version, marker in found]


def licences() -> None:
    """End with a message where a dependency has a licence that cannot be passed on.

    It looks at the environment that runs it, so ``main`` starts it in one.
    """
    for one in distributions():
        said = one.metadata.get_all("Classifier", [])
        terms = one.metadata.get("License-Expression") or "; ".join(
            it.rpartition(" :: ")[2] for it in said if it.startswith("License")
        )
        if FORBIDDEN.search(terms.replace("LGPL", "").replace("Lesser General Public", "")):
            raise SystemExit(f"{one.name}: {terms}")


def main(out: Path) -> None:
    """Check everything, and fill ``out``."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        tools = environment(sys.executable, folder / "tools", *TOOLS)
        commit = run("git", "rev-parse", "HEAD").strip()
        files, again = (built(tools, folder / name, commit) for name in "ab")
        wheel = next(it for it in files if it.suffix == ".whl")
        if wheel.read_bytes() != again[files.index(wheel)].read_bytes():
            raise SystemExit(f"{wheel.name}: two builds of one commit differ")
        print(f"{wheel.name}: the same {wheel.stat().st_size} bytes twice")
        names = {
            it.partition("/")[0] for it in ZipFile(wheel).namelist() if ".dist-info/" not in it
        }
        if names != {"servo_models", "fmu_src"}:
            raise SystemExit(f"{wheel.name}: it has the names {sorted(names)}")
        print(run(tools, "-m", "twine", "check", "--strict", *files).strip())
        at_hand = [it for it in PYTHONS if runs(f"python{it}")]
        tried = [(it, ()) for it in at_hand] + [(it, tuple(lowest())) for it in at_hand[:1]]
        newest = Path()
        for number, (version, pins) in enumerate(tried):
            python = environment(f"python{version}", folder / f"venv{number}", wheel, *pins)
            run(python, HERE / "smoke.py")
            newest = newest if pins else python
            print(f"smoke test passed: Python {version}, {'lowest' if pins else 'newest'} versions")
        print(run(newest, HERE / "release.py", "--licences").strip())
        resolve = ("-m", "pip", "install", "--quiet", "--dry-run", f"{wheel}[{EXTRAS}]")
        run(newest, *resolve)
        print(f"extras resolve: {EXTRAS}")
        out.mkdir(parents=True, exist_ok=True)
        for file in files:
            shutil.copy(file, out)
        sbom = ("cyclonedx_py", "environment", "--of", "JSON", "-o", str(out / "sbom.json"))
        run(tools, "-m", *sbom, newest)
        frozen = run(newest, "-m", "pip", "freeze", "--exclude", "servo-models")
        (out / "constraints.txt").write_text(frozen, "utf-8")
    print(f"wrote {', '.join(sorted(it.name for it in out.iterdir()))} to {out}")


if __name__ == "__main__":
    if sys.argv[1:] == ["--licences"]:
        licences()
        print("all licences can be passed on")
    else:
        main(Path(sys.argv[1]))
