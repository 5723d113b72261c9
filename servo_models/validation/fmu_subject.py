"""An FMU under validation: unpacked within limits, run in a process of its own.

The process guards against faults, not against malice: the code of an FMU runs with the rights of
whoever runs it.  Before that nothing of the file is believed: names, sizes and the description are
judged as the archive is unpacked.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
import queue
import secrets
import shutil
import signal
import stat
import subprocess
import sys
import threading
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any
from xml.parsers import expat

import numpy as np

from servo_models.core.catalogue import of_catalogue
from servo_models.core.plant import Actuator
from servo_models.core.simulate import Model, model
from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.files import scratch_folder
from servo_models.validation import bare_host

LONGEST_REASON = 300
"""Characters that are told of what an FMU says."""


@dataclass(frozen=True)
class Limits:
    """What one FMU may take.

    Attributes:
        seconds: for one comparison, wall-clock time.
        megabytes: of address space; not kept on Windows and macOS.
        unpacked_megabytes: of all its files.
    """

    seconds: float = 120.0
    megabytes: float = 1024.0
    unpacked_megabytes: float = 256.0


LIMITS = Limits()
"""Ours take a tenth of each."""


class FmuError(UserError):
    """An FMU stopped, or its process did; the text names the FMU and the reason."""


class Subject:
    """An unpacked FMU, and the model that it says it is.

    The model description names the actuator and holds every parameter's start value; the
    variant is the one that differs from these in the fewest parameters.

    Attributes:
        path: of the FMU.
        name: file name.
        folder: with its files.
        model: with the start values as parameters.
        over: why it cannot be run, or cannot any more; "" while it can.
    """

    def __init__(
        self, path: str | Path, own: Actuator | None = None, limits: Limits = LIMITS
    ) -> None:
        """Unpack and read an FMU, of the actuator ``own`` if that is not in the catalogue.

        Raises:
            UserError: no such file, no FMU, one too large, or one of an unknown actuator.
        """
        from fmpy import read_model_description

        self.path = Path(path)
        self.name = self.path.name
        self.limits = limits
        self._host: _HostProcess | None = None
        self._started = 0
        self.over = ""
        if not os.path.isfile(self.path):
            raise UserError(f"no FMU '{path}': build it with servo-models build")
        try:
            self.folder = _unpack(self.path, limits.unpacked_megabytes)
        except Exception as error:  # zip and XML errors of many kinds
            raise self._unreadable(error) from error
        try:
            self._description: Any = read_model_description(str(self.folder))
            self._reference = {v.name: v.valueReference for v in self._description.modelVariables}
            self._starts = {
                v.name: float(v.start)
                for v in self._description.modelVariables
                if v.causality == "parameter"
            }
        except Exception as error:  # fmpy raises many kinds
            self.close()
            raise self._unreadable(error) from error
        try:
            self.model = self._named_model(own)
        except UserError as error:
            self.close()
            raise UserError(f"FMU '{path}': {error}") from error
        self.over = self._obstacle()

    def close(self) -> None:
        """End the process and remove the unpacked files."""
        if self._host:
            self._host.close()
        _remove(self.folder)

    def run(self, chosen: Model, times: Array, inputs: Array) -> Array:
        """Return what ``chosen.run`` returns, with the FMU at the parameters of ``chosen``.

        Raises:
            FmuError: it stops, or its process does.
        """
        with self.instance(chosen.values, float(times[0]), inputs[0]) as one:
            return one.drive(times, inputs)

    @contextmanager
    def instance(
        self, values: Mapping[str, float], start: float, inputs: Array
    ) -> Iterator[Instance]:
        """Yield a new instance that has left initialisation; free it afterwards."""
        self._check()
        self._started += 1
        one = Instance(self, self._started, values, start, inputs)
        try:
            yield one
        except BaseException:
            with suppress(FmuError):  # the first failure is the one to tell
                one.free()
            raise
        one.free()

    def call(self, *request: Any) -> Any:
        """Return the answer of the FMU's process to a request; see ``bare_host.Session``.

        Raises:
            FmuError: with the reason.
        """
        self._check()
        try:
            return self._running().call(*request)
        except _DeadHostError as error:
            self.over = str(error)
            raise FmuError(f"FMU '{self.name}' {self.over}") from error
        except _RefusedError as error:
            raise FmuError(f"FMU '{self.name}' {self.clean(str(error))}") from error

    def _check(self) -> None:
        if self.over:
            raise FmuError(f"FMU '{self.name}' {self.over}")

    def _running(self) -> _HostProcess:
        if self._host is None:
            self._host = _HostProcess(self.folder, self.limits)
            try:
                self._host.call("open", self._about(), self.limits.seconds, self.limits.megabytes)
            except _RefusedError as error:
                self.over = self.clean(str(error))
                raise
        return self._host

    def clean(self, said: str) -> str:
        """Return the words of an FMU as one short line."""
        return _one_line(said.replace(str(self.folder), ""))

    def _obstacle(self) -> str:
        """Why it cannot be run, by its description."""
        plant = self.model.plant
        wanted = {wire.name for wire in plant.inputs} | {*plant.outputs, *plant.parameters}
        found = {v.name for v in self._description.modelVariables if v.causality != "independent"}
        if unlike := sorted(wanted ^ found):
            names = ", ".join(repr(name[:60]) for name in unlike[:3])
            more = f" and {len(unlike) - 3} more" if len(unlike) > 3 else ""
            return (
                f"has not the variables of actuator '{self.model.actuator.name}'"
                f" ({names}{more}): build it again with this version"
            )
        interface = self._description.coSimulation
        if interface is None or not interface.modelIdentifier.isidentifier():
            return "names no library for co-simulation"
        return ""

    def references(self, values: Mapping[str, float]) -> list[tuple[int, float]]:
        """Return values by value reference."""
        return [(self._reference[name], float(value)) for name, value in values.items()]

    def _about(self) -> dict[str, Any]:
        """What ``bare_host.Fmu`` has to know."""
        plant = self.model.plant
        return {
            "fmi": self._description.fmiVersion,
            "folder": str(self.folder),
            "guid": self._description.guid,
            "identifier": self._description.coSimulation.modelIdentifier,
            "inputs": [self._reference[wire.name] for wire in plant.inputs],
            "outputs": [self._reference[name] for name in plant.outputs],
            "flags": [plant.wire[name].flag for name in plant.outputs],
        }

    def _unreadable(self, error: Exception) -> UserError:
        cause = _one_line(str(error)) or type(error).__name__
        return UserError(
            f"cannot read FMU '{self.path}' ({cause}): build it again with servo-models build"
        )

    def _named_model(self, own: Actuator | None) -> Model:
        """Find the variant and the parameters by the start values."""
        name = self._description.modelName
        found = own if own and own.name == name else of_catalogue(name)
        differing = {
            variant.name: sum(
                value != self._starts.get(name)
                for name, value in found.values(variant.name).items()
            )
            + len(self._starts.keys() - found.plant_of(variant.name).parameters.keys())
            for variant in found.variants
        }
        variant = min(differing, key=lambda name: differing[name])
        known = found.plant_of(variant).parameters
        return model(found, variant, {n: v for n, v in self._starts.items() if n in known})


class Instance:
    """One instance of an FMU, stepped like ``Model.run`` does.

    ``step`` and ``outputs`` take and give SI floats in the order of the plant.  Every method
    raises ``FmuError`` where the FMU fails.
    """

    def __init__(
        self,
        subject: Subject,
        number: int,
        values: Mapping[str, float],
        start: float,
        inputs: Array,
    ) -> None:
        self._subject = subject
        self._number = number
        self._width = len(subject.model.plant.outputs)
        subject.call("start", number, subject.references(values), start, _plain(inputs))

    def step(self, time: float, size: float, inputs: Array) -> None:
        """Hold the inputs and advance by ``size`` [s]."""
        self._call("step", time, size, _plain(inputs))

    def outputs(self) -> list[float]:
        """Return the outputs."""
        row: list[float] = self._numbers((self._width,), "outputs").tolist()
        return row

    def drive(self, times: Array, inputs: Array, first: int = 0) -> Array:
        """Step from row ``first``, where it is, to the end; return the rows from there on."""
        shape = (len(times) - first, self._width)
        return self._numbers(shape, "drive", _plain(times), _plain(inputs), first)

    def saved(self) -> bytes:
        """Return the complete state as bytes."""
        try:
            return base64.b64decode(self._call("saved"))
        except (ValueError, TypeError):
            raise FmuError(f"FMU '{self._subject.name}' gives no saved state") from None

    def restore(self, saved: bytes) -> None:
        """Go back to a state from ``saved``, also that of another instance."""
        self._call("restore", base64.b64encode(saved).decode())

    def free(self) -> None:
        """End the instance."""
        self._subject.call("free", self._number)

    def _numbers(self, shape: tuple[int, ...], name: str, *args: Any) -> Array:
        answer = self._call(name, *args)
        try:
            numbers = np.array(answer, dtype=float)
        except (ValueError, TypeError):
            numbers = np.empty(0)
        if numbers.shape != shape:
            raise FmuError(f"FMU '{self._subject.name}' gives other outputs than it was asked for")
        return numbers

    def _call(self, name: str, *args: Any) -> Any:
        return self._subject.call("instance", self._number, name, *args)


def _one_line(said: str) -> str:
    """Words of unknown origin in print: short, and without what a terminal would obey."""
    text = " ".join(said.split())
    text = "".join(letter if letter.isprintable() else "?" for letter in text)
    return text if len(text) <= LONGEST_REASON else f"{text[:LONGEST_REASON]}..."


def _plain(values: Array) -> Any:
    return np.asarray(values, dtype=float).tolist()


LARGEST_ANSWER = 1 << 28
"""Characters that are read of one answer; a row of ten outputs has 200."""
PASSED_ON = ("PATH", "LANG", "LC_ALL", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "SYSTEMROOT")
"""Variables of the environment that the process gets."""
TEMPORARY = ("HOME", "TMPDIR", "TEMP", "TMP")
"""Those that name folders to write to: here the one in which the process runs."""
GRACE = 5.0
"""Seconds for a process to end that has closed its pipe."""


class _RefusedError(Exception):
    """The FMU refused a call, with its reason."""


class _DeadHostError(Exception):
    """The process is gone; the text says how, and is true from now on."""


class _HostProcess:
    """A running ``bare_host`` for one unpacked FMU; its methods are called by name."""

    def __init__(self, folder: Path, limits: Limits) -> None:
        """Start the process in ``folder``."""
        self.seconds = limits.seconds
        self.died = ""
        self.exchange: threading.Thread | None = None
        environment = {name: os.environ[name] for name in PASSED_ON if name in os.environ}
        environment |= dict.fromkeys(TEMPORARY, str(folder))
        self.process = subprocess.Popen(
            [sys.executable, "-I", "-S", bare_host.__file__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            encoding="utf-8",
            errors="replace",
            cwd=folder,
            env=environment,
            start_new_session=True,
        )

    def call(self, *request: Any) -> Any:
        """Return the result of a request, a method of ``bare_host.Session`` and its arguments.

        Raises:
            _RefusedError: by the FMU.
            _DeadHostError: the process ended, or did not answer in time and was ended.
        """
        if self.died:
            raise _DeadHostError(self.died)
        number = secrets.token_hex(8)  # the slave may write to the pipe by chance
        line = self._exchanged(json.dumps([number, request]))
        try:
            content = json.loads(line)
            if content["number"] != number:
                raise ValueError(number)
            reason = content.get("refused")
            result = content["result"] if reason is None else None
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            self._end("gives an answer that is none")
            raise _DeadHostError(self.died) from error
        if reason is not None:
            raise _RefusedError(str(reason))
        return result

    def close(self) -> None:
        """End the process and what it has started."""
        self._end("is closed")

    def _exchanged(self, request: str) -> str:
        """Send a line and return the next one; the process has ended where that takes too long."""
        answers: queue.SimpleQueue[str] = queue.SimpleQueue()

        def exchange() -> None:
            assert self.process.stdin is not None
            assert self.process.stdout is not None
            try:
                self.process.stdin.write(request + "\n")
                self.process.stdin.flush()
                answers.put(self.process.stdout.readline(LARGEST_ANSWER))
            except (OSError, ValueError):  # the other end of a pipe is gone
                answers.put("")

        # A daemon: what the slave has started may hold the pipe open for ever.
        self.exchange = threading.Thread(target=exchange, daemon=True)
        self.exchange.start()
        try:
            line = answers.get(timeout=self.seconds)
        except queue.Empty:
            self._end(f"does not answer within {self.seconds:g} s")
            raise _DeadHostError(self.died) from None
        if not line:
            self._end(self._last_word())
            raise _DeadHostError(self.died)
        return line

    def _last_word(self) -> str:
        """How a process ended whose pipe is closed."""
        try:
            code = self.process.wait(GRACE)
        except subprocess.TimeoutExpired:
            return "closes the pipe to its host"
        if code >= 0:
            return f"ends the process with exit code {code}"
        return f"ends the process by signal {-code} ({signal.strsignal(-code)})"

    def _end(self, why: str) -> None:
        if self.died:
            return
        self.died = why
        if sys.platform == "win32":
            self.process.kill()
        else:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self.process.pid, signal.SIGKILL)  # with what it has started
        self.process.wait()
        if self.exchange:
            self.exchange.join(GRACE)
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe and not (self.exchange and self.exchange.is_alive()):
                with contextlib.suppress(OSError):  # what was not sent yet goes nowhere
                    pipe.close()


DESCRIPTION = "modelDescription.xml"
MOST_FILES = 10_000
LARGEST_DESCRIPTION = 4_000_000
"""Bytes of XML; one with 200 variables has 60 000."""
DEEPEST = 20
"""Elements within each other in a description; FMI 2.0 needs 5."""
MOST_ELEMENTS = 100_000
LONGEST_NAME = 1000
"""Characters of a variable's name; judging one takes time by the square of its length."""
PIECE = 1 << 20
"""Bytes that are unpacked at a time."""
COMPRESSION = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""FMI 2.0.4, section 2.3."""


def _unpack(path: Path, megabytes: float) -> Path:
    """Return a new temporary folder with the files of an FMU; nothing is left after an error.

    Args:
        path: of the FMU.
        megabytes: that its files may have together.

    Raises:
        UserError: no zip, a name that leads elsewhere, too much, or a description that has
            more than elements and text.
    """
    limit = int(megabytes * 2**20)
    if (packed := path.stat().st_size) > limit:
        raise UserError(_too_large(packed, limit))
    folder = scratch_folder()
    try:
        with zipfile.ZipFile(path) as archive:
            _extract(archive, folder, limit)
        _check_description(folder / DESCRIPTION)
    except BaseException:
        _remove(folder)
        raise
    return folder


def _remove(folder: Path) -> None:
    """Remove a folder, also one whose files its owner may not write."""
    shutil.rmtree(folder, ignore_errors=True)
    if folder.exists():
        for place, _, _ in os.walk(folder):
            with contextlib.suppress(OSError):
                os.chmod(place, stat.S_IRWXU)
        shutil.rmtree(folder, ignore_errors=True)


def _extract(archive: zipfile.ZipFile, folder: Path, left: int) -> None:
    entries = archive.infolist()
    _check_names(entries)
    if (told := sum(entry.file_size for entry in entries)) > left:
        raise UserError(_too_large(told, left))
    limit = left
    for entry in entries:
        target = folder / entry.filename
        if entry.is_dir():
            target.mkdir(parents=True, exist_ok=True)
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        with archive.open(entry) as read, target.open("xb") as write:
            while piece := read.read(PIECE):  # the size that the archive tells may be wrong
                left -= len(piece)
                if left < 0:
                    raise UserError(_too_large(limit - left, limit))
                write.write(piece)


def _check_names(entries: list[zipfile.ZipInfo]) -> None:
    if len(entries) > MOST_FILES:
        raise UserError(f"it has {len(entries)} files, more than {MOST_FILES}: no FMU needs that")
    names: set[str] = set()
    for entry in entries:
        name = entry.filename
        parts = PurePosixPath(name).parts
        shown = repr(name[:80])
        if not parts or name.startswith("/") or ".." in parts or "\\" in name or ":" in name:
            raise UserError(f"its file {shown} would be written outside its folder")
        if not name.isprintable() or len(name) > 200:
            raise UserError(f"its file {shown} has no name of an FMU's file")
        if stat.S_IFMT(entry.external_attr >> 16) not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise UserError(f"its file {shown} is a link or a device, which an FMU has not")
        if entry.flag_bits & 1 or entry.compress_type not in COMPRESSION:
            raise UserError(f"its file {shown} is packed in a way that FMI does not know")
        if "/".join(parts).casefold() in names:
            raise UserError(f"its file {shown} is there twice")
        names.add("/".join(parts).casefold())


def _too_large(size: int, limit: int) -> str:
    return (
        f"unpacked it has {size / 2**20:.0f} MB or more, the limit is {limit / 2**20:.0f} MB;"
        " raise it with --unpacked if you trust the file"
    )


def _check_description(path: Path) -> None:
    """Refuse what makes reading XML costly before anybody builds a tree of it."""
    if not path.is_file():
        raise UserError(f"it has no {DESCRIPTION}")
    if path.stat().st_size > LARGEST_DESCRIPTION:
        raise UserError(f"{DESCRIPTION} has {path.stat().st_size} bytes, which no description has")
    depth = elements = 0

    def begin(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth, elements
        depth += 1
        elements += 1
        if len(attributes.get("name", "")) > LONGEST_NAME:
            raise UserError(f"{DESCRIPTION} has a name of more than {LONGEST_NAME} characters")
        if depth > DEEPEST or elements > MOST_ELEMENTS:
            raise UserError(f"{DESCRIPTION} has more or deeper elements than a description")

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1

    def doctype(*_: object) -> None:
        raise UserError(f"{DESCRIPTION} has a DOCTYPE, which FMI does not know")

    parser = expat.ParserCreate()
    parser.StartElementHandler = begin
    parser.EndElementHandler = end
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(path.read_bytes(), True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise UserError(f"{DESCRIPTION} is no XML: {error}") from error
