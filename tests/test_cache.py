"""A damaged cache heals, leftovers of killed processes go, writes are whole."""

from __future__ import annotations

import importlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from servo_models import files
from servo_models.files import SEAL, cache_folder, cached, write_whole

FUZZ = Path(__file__).parent / "fuzz" / "kills.py"
CONTENT = {"text.py": b"a text", "below/code.bin": bytes(range(256))}


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty cache of its own."""
    monkeypatch.setenv("SERVO_MODELS_CACHE", str(tmp_path / "cache"))
    cache_folder.cache_clear()
    yield tmp_path / "cache"
    cache_folder.cache_clear()


def fill(folder: Path) -> None:
    for name, content in CONTENT.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)


def found(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in CONTENT}


def test_an_entry_is_made_once(cache: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made: list[Path] = []

    def make(folder: Path) -> None:
        made.append(folder)
        fill(folder)

    assert cached("entry", make) == cached("entry", make) == cache / "entry"
    assert len(made) == 1
    assert found(cache / "entry") == CONTENT
    assert capsys.readouterr().err == ""


damages = st.one_of(
    st.tuples(st.just("flip"), st.sampled_from([*CONTENT, SEAL]), st.integers(0, 255)),
    st.tuples(st.just("cut"), st.sampled_from([*CONTENT, SEAL]), st.integers(0, 255)),
    st.tuples(st.just("remove"), st.sampled_from([*CONTENT, SEAL]), st.just(0)),
    st.tuples(st.just("add"), st.sampled_from(["new", "below/new"]), st.just(0)),
    st.tuples(st.just("nest"), st.just(SEAL), st.just(0)),
    st.tuples(st.just("a file"), st.just(SEAL), st.just(0)),
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(damages)
def test_a_damaged_entry_is_made_again(
    cache: Path, capsys: pytest.CaptureFixture[str], damage: tuple[str, str, int]
) -> None:
    kind, name, where = damage
    folder = cached("entry", fill)
    capsys.readouterr()
    file = folder / name
    if kind == "flip":
        content = bytearray(file.read_bytes())
        content[where % len(content)] ^= 1
        file.write_bytes(content)
    elif kind == "cut":
        file.write_bytes(file.read_bytes()[: where % len(file.read_bytes())])
    elif kind == "remove":
        file.unlink()
    elif kind == "add":
        file.write_bytes(b"foreign")
    elif kind == "nest":
        file.write_text("[" * 100_000)
    else:
        files.shutil.rmtree(folder)
        folder.write_text("no folder")
    assert found(cached("entry", fill)) == CONTENT
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert [path.name for path in cache.iterdir()] == ["entry"]


def test_an_entry_copied_over_another_is_made_again(
    cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def other(folder: Path) -> None:
        (folder / "text.py").write_bytes(b"another text")

    first, second = cached("entry", fill), cached("other", other)
    files.shutil.rmtree(first)
    files.shutil.copytree(second, first)
    assert found(cached("entry", fill)) == CONTENT
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_cache_that_cannot_be_written_is_one_temporary_folder_that_goes(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    text = (
        "from servo_models.files import cache_folder, cached\n"
        "a = cached('one', lambda folder: (folder / 'x').write_text('x'))\n"
        "b = cached('two', lambda folder: (folder / 'x').write_text('x'))\n"
        "print(cache_folder(), a.parent == b.parent == cache_folder())\n"
    )
    environment = {**os.environ, "SERVO_MODELS_CACHE": str(tmp_path / "file" / "cache")}
    environment["TMPDIR"] = str(tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", text], env=environment, capture_output=True, text=True, check=True
    )
    folder, one = done.stdout.split()
    assert one == "True"
    assert tmp_path in Path(folder).parents
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file"]


posix_only = pytest.mark.skipif(os.name == "nt", reason="no modes of files on Windows")


@posix_only
@pytest.mark.parametrize("mode", [0o770, 0o777, 0o1777])
def test_nothing_is_loaded_from_a_cache_that_others_may_write(
    cache: Path, capsys: pytest.CaptureFixture[str], mode: int
) -> None:
    """A library planted there, with a seal that fits, would run as part of the process."""
    planted = cached("entry", fill)
    cache.chmod(mode)
    cache_folder.cache_clear()
    made = [cached("entry", fill), cached("other", fill)]
    assert found(made[0]) == CONTENT
    assert all(folder.is_relative_to(cache_folder()) for folder in made)
    assert not cache_folder().is_relative_to(cache)
    assert planted.exists()
    (line,) = capsys.readouterr().err.splitlines()
    assert f"'{cache}' may be written by others" in line


@posix_only
def test_nor_from_one_of_somebody_else(
    cache: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    cached("entry", fill)
    cache_folder.cache_clear()
    me = os.geteuid()
    monkeypatch.setattr("os.geteuid", lambda: me + 1)
    assert not cache_folder().is_relative_to(cache)
    assert f"'{cache}' is not yours" in capsys.readouterr().err


@posix_only
def test_nor_an_entry_that_others_may_write(
    cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cached("entry", fill).chmod(0o777)
    made = cached("entry", fill)
    assert made == cache / "entry"
    assert made.stat().st_mode & 0o022 == 0
    assert "is made again" in capsys.readouterr().err


@posix_only
def test_a_new_cache_is_for_nobody_else(cache: Path) -> None:
    before = os.umask(0o002)
    try:
        assert cache_folder() == cache
    finally:
        os.umask(before)
    assert cache.stat().st_mode & 0o077 == 0


KILLED = """
import os, signal, sys
from pathlib import Path
from servo_models import files
calls = 0
def killing(function):
    def called(*args, **kwargs):
        global calls
        calls += 1
        if calls == int(sys.argv[2]):
            os.kill(os.getpid(), signal.SIGKILL)
        return function(*args, **kwargs)
    return called
files._to_disk = killing(files._to_disk)
Path.replace, Path.rename = killing(Path.replace), killing(Path.rename)
def make(folder):
    (folder / "a").write_text("new"); (folder / "b").write_text("new")
if sys.argv[3] == "file":
    files.write_whole(Path(sys.argv[1]) / "out.txt", b"new")
else:
    files.cached("entry", make)
"""


@pytest.mark.thorough
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL here")
@pytest.mark.parametrize("what", ["file", "entry"])
def test_a_killed_write_leaves_nothing_half(cache: Path, what: str) -> None:
    """Killed at every moment of a write in turn; the next one finds old or new, and cleans up."""
    cache.mkdir(parents=True)
    for moment in range(1, 20):
        if what == "file":
            (cache / "out.txt").write_text("old")
        words = [sys.executable, "-c", KILLED, str(cache), str(moment), what]
        done = subprocess.run(words, check=False, env=os.environ)
        if done.returncode == 0:
            break
        assert done.returncode == -signal.SIGKILL
        if what == "file":
            assert (cache / "out.txt").read_text() in ("old", "new")
            write_whole(cache / "out.txt", b"newer")
            assert [path.name for path in cache.iterdir()] == ["out.txt"]
        else:
            cache_folder.cache_clear()
            entry = cached("entry", fill)
            assert (entry / SEAL).exists()
            assert [path.name for path in cache.iterdir()] == ["entry"]
            files.shutil.rmtree(entry)
    assert moment > 3


WRITING = """
import sys, time
from pathlib import Path
from servo_models import files
def wait(part):
    part.write_text("half")
    print(part.parent.name, flush=True)
    time.sleep(60)
files.write_with(Path(sys.argv[1]) / "slow.txt", wait)
"""


def test_what_a_live_process_is_writing_stays(cache: Path) -> None:
    """It is known by its lock: in another container its process would have no number here."""
    words = [sys.executable, "-c", WRITING, str(cache)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as other:
        try:
            assert other.stdout
            part = cache / other.stdout.readline().strip()
            write_whole(cache / "out.txt", b"new")
            assert (part / "slow.txt").read_text() == "half"
        finally:
            other.kill()
    assert part.exists()
    write_whole(cache / "out.txt", b"newer")
    assert [path.name for path in cache.iterdir()] == ["out.txt"]


@pytest.mark.parametrize(
    "name",
    [
        ".part-2024-01-backup",
        ".part-otherhost-1-abc",
        ".servo-models-backup.part",
        ".servo-models-x1_k09ab.part.zip",
        "my.servo-models-x1_k09ab.part",
    ],
)
def test_what_others_have_named_stays(cache: Path, name: str) -> None:
    """Also years later, and also where nobody holds a lock."""
    foreign = cache / name
    foreign.mkdir(parents=True)
    (foreign / "precious").write_text("kept")
    os.utime(foreign, (0, 0))
    write_whole(cache / "out.txt", b"new")
    assert (foreign / "precious").read_text() == "kept"


@pytest.mark.skipif(os.name == "nt", reason="links need a privilege there")
def test_a_link_with_the_name_of_a_leftover_leads_nowhere(cache: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    cache.mkdir(parents=True)
    (cache / ".servo-models-x1_k09ab.part").symlink_to(tmp_path / "elsewhere")
    write_whole(cache / "out.txt", b"new")
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_the_end_of_a_file_is_not_ctrl_c(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from servo_models.cli import main

    explain = importlib.import_module("servo_models.analysis.explain")

    def broken(*_: object) -> None:
        raise EOFError("Ran out of input")

    monkeypatch.setattr(explain, "explain", broken)
    assert main(["explain", "sg90"]) == 2
    err = capsys.readouterr().err
    assert "interrupted" not in err
    assert "EOFError: Ran out of input" in err


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="reaps the orphans of killed processes")
def test_a_share_of_the_kills() -> None:
    command = [sys.executable, str(FUZZ), "--kills", "3", "--caches", "0", "--only", "check"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "check: 3 of 3 killed" in done.stdout
