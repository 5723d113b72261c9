"""Validate FMUs that are wrong, broken or hostile: none may pass, and none may do harm.

Each is made from a good FMU by one change, and goes through ``servo-models validate`` in a
process of its own.  Counted are

* crashes of the command: a traceback, an exit code that is none of its own, or no end;
* false passes: exit code 0 for an FMU that is not as good as the good one;
* false alarms: an FMU with a harmless change that does not pass;
* left behind: files or processes outside of what the command was given.

Run ``python tests/fuzz/fmus.py --count 200``; ``tests/validation/test_hostile_fmus.py`` runs a
share.
"""

from __future__ import annotations

import argparse
import collections
import io
import os
import random
import re
import struct
import subprocess
import sys
import tempfile
import textwrap
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

XML = "modelDescription.xml"
LIMIT_SECONDS = 8  # for an FMU: given as --timeout; good ones take less than one second
NO_END_SECONDS = 400  # for the command, which by then does not end
PASSED, FAILED, COULD_NOT_RUN = 0, 1, 2
NO_REFERENCES = '''
"""A joint with play that follows its goal; validated without the catalogue's references."""
from typing import Annotated
from servo_models.core.plant import Actuator, Plant, State, Variant, Wire, place
from servo_models.core.block import Param, block
from servo_models.effects.backlash import backlash
from servo_models.effects.lag import lag

@block("speed", "moving")
def follow(
    goal: float,
    enabled: float,
    angle: float,
    time_constant: Annotated[float, Param("s", "lag", default=0.02, low=0.01, high=10.0)],
    dead: Annotated[float, Param("rad", "dead zone", default=0.0, low=0.0, high=1.0)],
) -> tuple[float, float]:
    """The speed is the error over the time constant, while the joint is enabled."""
    error = goal - angle
    if abs(error) < dead:
        error = 0.0
    if abs(error) > 0.1:
        return enabled * error / time_constant, 1.0
    return enabled * error / time_constant, 0.0

@block("reading", "rate")
def sensor(angle: float, speed: float) -> tuple[float, float]:
    """What is read."""
    return angle, speed

ACTUATOR = Actuator(
    name="joint", title="A joint", about="", source="",
    plant=Plant(
        inputs=(
            Wire("goal", "rad", "goal", low=-4.0, high=4.0),
            Wire("enabled", "1", "on", rest=1.0, low=0.0, high=1.0, flag=True),
        ),
        wires=(
            Wire("reading", "rad", "angle as read"),
            Wire("rate", "rad/s", "rate as read", scale=50.0),
            Wire("moving", "1", "it is under way", flag=True),
        ),
        constants={"internal_step": Param("s", "step", default=1e-3, low=1e-6, high=1e-2)},
        chain=(
            place("goal_lag", lag, "goal"),
            follow,
            sensor,
            place("play", backlash, "reading", "rate"),
        ),
        states=(State(Wire("angle", "rad", "angle"), "speed"),),
        outputs=("reading", "rate", "moving"),
    ),
    variants=(Variant("plain", "", {}, ""),),
    stop_time=2.0, step_size=0.01, step=("goal", 1.0),
)
'''

Entries = dict[str, bytes]


class Case(NamedTuple):
    """One FMU: its name, whether it must pass, and what writes it to a path."""

    name: str
    harmless: bool
    write: Callable[[Path], None]


class Outcome(NamedTuple):
    """What became of it: the exit code, None for no end, the last line, what was left."""

    case: Case
    code: int | None
    said: str
    left: tuple[str, ...]
    seconds: float

    @property
    def crashed(self) -> bool:
        return self.code not in (PASSED, FAILED, COULD_NOT_RUN) or "Traceback" in self.said

    @property
    def false_pass(self) -> bool:
        return self.code == PASSED and not self.case.harmless

    @property
    def false_alarm(self) -> bool:
        return self.code != PASSED and self.case.harmless

    @property
    def sound(self) -> bool:
        return not (self.crashed or self.false_pass or self.false_alarm or self.left)


# What the code of a slave does, and where.

DEEDS = {
    "leaves by sys.exit": "sys.exit(0)",
    "leaves by os._exit(0)": "import os; os._exit(0)",
    "leaves by os._exit(3)": "import os; os._exit(3)",
    "raises RuntimeError": "raise RuntimeError('no [bold]wish[/] %s %n \\x1b[31m')",
    "raises a long text": "raise RuntimeError('x' * 5_000_000)",
    "raises KeyboardInterrupt": "raise KeyboardInterrupt",
    "raises SystemExit": "raise SystemExit('bye')",
    "raises BaseException": "raise BaseException",
    "loops": "while True: pass",
    "sleeps": "import time; time.sleep(1e6)",
    "reads address 0": "ctypes.string_at(0)",
    "aborts": "import os; os.abort()",
    "kills itself": "import os; os.kill(os.getpid(), 9)",
    "stops itself": "import os, signal; os.kill(os.getpid(), signal.SIGSTOP)",
    "takes all memory at once": "bytearray(1 << 40)",
    "takes all memory in pieces": "hoard = []\nwhile True: hoard.append(bytearray(1 << 24))",
    "floods its output": "while True: print('x' * 100_000, flush=True)",
    "floods the file descriptors": (
        "import os\nwhile True:\n    for number in range(1, 8):\n"
        "        try: os.write(number, b'x' * 1000)\n        except OSError: pass"
    ),
    "closes the file descriptors": "import os; os.closerange(0, 64)",
    "says that all is well": (
        "import os\nfor number in range(1, 8):\n"
        "    try: os.write(number, b'{\"result\": null}\\n' * 99)\n    except OSError: pass"
    ),
    "answers in place of its host": (
        "import pickle\npickle.dump = lambda content, file: file.write(pickle.dumps((False, None)))"
    ),
    "answers in texts in place of its host": (
        "import pickle\npickle.dump = lambda content, file: file.write("
        "pickle.dumps((False, [['nan']])))"
    ),
    "recurs for ever": "(lambda f: f(f))(lambda f: f(f))",
    "has children": "import os, time\nfor _ in range(5): os.fork()\ntime.sleep(1e6)",
    "leaves a child and goes": "import os, time; os.fork() and os._exit(0); time.sleep(1e6)",
    "writes a large file": (
        "with open('large', 'wb') as file:\n    while True: file.write(bytes(1 << 24))"
    ),
    "imports what is not there": "import numpy_that_is_not_there",
    "needs numpy": "import numpy",
    "is no Python": "def (",
}
PLACES = {
    "when imported": None,
    "when instantiated": "__init__",
    "when set up": "setup_experiment",
    "when initialised": "exit_initialization_mode",
    "when set": "set_real",
    "when read": "get_real",
    "at a step": "do_step",
    "when saved": "_get_fmu_state",
    "when restored": "_set_fmu_state",
    "when terminated": "terminate",
}
# Slaves whose numbers are wrong: code behind the slave's own.

WRONG = {
    "an output scaled by 1.001": (
        "get_real",
        "return [v * 1.001 if r == 2 else v for r, v in zip(vrs, out)]",
    ),
    "an output off by 1e-6": (
        "get_real",
        "return [v + 1e-6 if r == 2 else v for r, v in zip(vrs, out)]",
    ),
    "outputs swapped": (
        "get_real",
        "return [self.values[5 - r] if r in (2, 3) else v for r, v in zip(vrs, out)]",
    ),
    "an output negated": ("get_real", "return [-v if r == 2 else v for r, v in zip(vrs, out)]"),
    "outputs NaN": (
        "get_real",
        "return [float('nan') if 2 <= r <= 3 else v for r, v in zip(vrs, out)]",
    ),
    "outputs infinite": (
        "get_real",
        "return [float('inf') if 2 <= r <= 3 else v for r, v in zip(vrs, out)]",
    ),
    "one NaN late": ("get_real", "return [float('nan') if self.time > 0.15 else v for v in out]"),
    "outputs of single precision": (
        "get_real",
        "import struct; return [struct.unpack('f', struct.pack('f', v))[0] for v in out]",
    ),
    "outputs of noise 1e-9": (
        "get_real",
        "import random; return [v + 1e-9 * random.random() for v in out]",
    ),
    "outputs all 0": ("get_real", "return [0.0 for _ in out]"),
    "outputs cut off": ("get_real", "return out[:1]"),
    "outputs as texts": ("get_real", "return [str(v) for v in out]"),
    "outputs None": ("get_real", "return None"),
    "an output delayed by a step": (
        "get_real",
        "old, self.old = getattr(self, 'old', out), out; return (out, old)[len(out) == len(old)]",
    ),
    "an output that freezes": (
        "get_real",
        "self.kept = getattr(self, 'kept', out) if self.time > 0.1 else out; return self.kept",
    ),
    "a flag inverted": ("get_boolean", "return [not v for v in out]"),
    "a flag never set": ("get_boolean", "return [False for v in out]"),
    "a step that fails in silence": ("do_step", "return self.time < 0.1"),
    "a step that does nothing": ("do_step", "self.x = [0.0] * len(self.x); return True"),
    "a time that runs double": (
        "do_step",
        "self.advance(self.x, current_time, step_size); return True",
    ),
    "a state that is not restored": ("_set_fmu_state", "self.x = [0.0] * len(self.x)"),
    "a state that is restored in part": ("_set_fmu_state", "self.x = [v * 1.0001 for v in self.x]"),
    "a coarse internal step": ("exit_initialization_mode", "self.values[5] = 9e-3; self.retune()"),
    "a parameter that is ignored": (
        "exit_initialization_mode",
        "self.values[6] = 0.03; self.retune()",
    ),
    "an effect that is always on": (
        "exit_initialization_mode",
        "self.values[9] = 0.01; self.retune()",
    ),
    "an effect that is never on": (
        "exit_initialization_mode",
        "self.values[8] = 0.0; self.retune()",
    ),
}
SHARED = (
    "\nServo.x = property(lambda self: Servo.all_x, lambda self, x: setattr(Servo, 'all_x', x))\n"
)

# Descriptions that are wrong; a text and its replacement.

DESCRIPTIONS: dict[str, tuple[str, str]] = {
    "a renamed output": ('name="reading"', 'name="angles"'),
    "a renamed input": ('name="goal"', 'name="goals"'),
    "a renamed parameter": ('name="time_constant"', 'name="time_const"'),
    "a renamed effect": ('name="play.half_width"', 'name="slack.half_width"'),
    "a name in capitals": ('name="reading"', 'name="Reading"'),
    "a name with a line break": ('name="reading"', 'name="read&#10;ing"'),
    "an endless name": ('name="reading"', f'name="{"r" * 100_000}"'),
    "a wrong GUID": ('guid="{', 'guid="{0'),
    "no GUID": (r'guid="[^"]*"', ""),
    "an empty GUID": (r'guid="[^"]*"', 'guid=""'),
    "a wrong unit": ('unit="rad"', 'unit="deg"'),
    "a wrong bound": ('max="4.0"', 'max="400.0"'),
    "a start value of text": ('start="0.02"', 'start="soon"'),
    "a start value NaN": ('start="0.02"', 'start="nan"'),
    "a start value outside": ('start="0.02"', 'start="1e300"'),
    "no start value": ('start="0.02"', ""),
    "another start value, the GUID as it was": ('start="0.02"', 'start="0.05"'),
    "a value reference of another": ('valueReference="2"', 'valueReference="3"'),
    "a value reference of 2^32": ('valueReference="2"', 'valueReference="4294967298"'),
    "a value reference that is negative": ('valueReference="2"', 'valueReference="-1"'),
    "a value reference of text": ('valueReference="2"', 'valueReference="two"'),
    "an output that is an input": ('causality="output"', 'causality="input"'),
    "an output that is local": ('causality="output"', 'causality="local"'),
    "an unknown actuator": ('modelName="joint"', 'modelName="joints"'),
    "an actuator that is a path": ('modelName="joint"', 'modelName="/etc/../nowhere.py"'),
    "an actuator of the catalogue": ('modelName="joint"', 'modelName="sg90"'),
    "an actuator with escapes": ('modelName="joint"', 'modelName="[red]&#9;joint[/]"'),
    "no actuator": ('modelName="joint"', ""),
    "a library that is a path": ('modelIdentifier="joint"', 'modelIdentifier="../../joint"'),
    "a library of another name": ('modelIdentifier="joint"', 'modelIdentifier="joints"'),
    "no library": ('modelIdentifier="joint"', ""),
    "another FMI version": ('fmiVersion="2.0"', 'fmiVersion="3.0"'),
    "an FMI version that is none": ('fmiVersion="2.0"', 'fmiVersion="2"'),
    "model exchange": ("CoSimulation", "ModelExchange"),
    "no variables": (r"(?s)<ModelVariables>.*</ModelVariables>", "<ModelVariables/>"),
    "no structure": (r"(?s)<ModelStructure>.*</ModelStructure>", ""),
    "no initial unknowns": (r"(?s)<InitialUnknowns>.*</InitialUnknowns>", ""),
    "a dependency that is missing": ('dependencies="1 2"', 'dependencies="1"'),
    "elements that FMI does not know": ("<ModelVariables>", "<Hello/><ModelVariables>"),
    "a real as a Boolean": ('<Real unit="rad/s"', '<Boolean unit="rad/s"'),
    "a saved state that it denies": ('canSerializeFMUstate="true"', 'canSerializeFMUstate="false"'),
    "a wrong factor of a unit": ("<DisplayUnit", '<DisplayUnit name="x" factor="2"/><DisplayUnit'),
    "XML that ends early": (r"(?s)</ModelVariables>.*", ""),
    "XML that is none": (r"(?s).*", "hello"),
    "no XML at all": (r"(?s).*", ""),
    "entities that explode": (
        r"\?>",
        '?><!DOCTYPE f [<!ENTITY a "aaaaaaaaaa">'
        + "".join(f'<!ENTITY {c} "{f"&{b};" * 10}">' for b, c in zip("abcdefgh", "bcdefghi"))
        + "]>",
    ),
    "entities from a file": (r"\?>", '?><!DOCTYPE f [<!ENTITY x SYSTEM "file:///etc/passwd">]>'),
    "a DTD from the net": (r"\?>", '?><!DOCTYPE f SYSTEM "http://127.0.0.1:9/x.dtd">'),
    "elements nested deeply": (
        "<ModelVariables>",
        "<a>" * 100_000 + "</a>" * 100_000 + "<ModelVariables>",
    ),
    "very many elements": ("<ModelVariables>", "<a/>" * 800_000 + "<ModelVariables>"),
    "a huge comment": ("<ModelVariables>", f"<!--{'x' * 30_000_000}--><ModelVariables>"),
    "a huge attribute": ('description="', f'description="{"x" * 30_000_000}'),
    "an encoding that is wrong": ("encoding='UTF-8'", "encoding='UTF-16'"),
    "an encoding that is unknown": ("encoding='UTF-8'", "encoding='EBCDIC-XYZ'"),
    "a NUL": ("<ModelVariables>", "\0<ModelVariables>"),
}
"""The first text is a pattern."""

MISSING = {
    "no pythonfmu in it": r"resources/pythonfmu/.*",
    "no fmi2slave in it": r"resources/pythonfmu/fmi2slave\.py",
    "no slave": r"resources/joint_.*\.py",
    "no name of the slave": r"resources/slavemodule\.txt",
    "no library of this system": r"binaries/.*",
    "no resources": r"resources/.*",
    "no description": XML,
    "nothing": r".*",
}
LIBRARIES = {
    "a library that is a text": lambda good: b"hello",
    "a library that is empty": lambda good: b"",
    "a library cut off": lambda good: good[: len(good) // 2],
    "a library with a damaged header": lambda good: good[:16] + b"\xff" * 48 + good[64:],
    "a library of Windows": lambda good: b"MZ" + bytes(1000),
    "a library without functions": lambda good: good.replace(b"fmi2", b"fmi9"),
    "a library without steps": lambda good: good.replace(b"fmi2DoStep", b"fmi2DoStop"),
    "a library with damaged code": lambda good: good[:0x9000] + b"\xcc" * 0x8000 + good[0x11000:],
}


def cases(good: Path, seed: int = 1) -> Iterator[Case]:
    """Yield every case there is: the harmless first, then the others in random order."""
    with zipfile.ZipFile(good) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    yield from _harmless(good, entries)
    every = [
        *_deeds(entries),
        *_wrong(entries),
        *_described(entries),
        *_missing(entries),
        *_archives(good, entries),
    ]
    random.Random(seed).shuffle(every)
    yield from every


def _slave(entries: Entries) -> str:
    return next(n for n in entries if re.fullmatch(r"resources/joint_\w+\.py", n))


def _written(name: str, entries: Entries, harmless: bool = False, **how: int) -> Case:
    def write(path: Path) -> None:
        with zipfile.ZipFile(path, "w", how.get("compression", zipfile.ZIP_DEFLATED)) as archive:
            for entry, content in entries.items():
                archive.writestr(entry, content)

    return Case(name, harmless, write)


def _behind(entries: Entries, code: str) -> Entries:
    name = _slave(entries)
    return {**entries, name: entries[name] + code.encode()}


def _deeds(entries: Entries) -> Iterator[Case]:
    for deed, code in DEEDS.items():
        for place, method in PLACES.items():
            name = f"{deed} {place}"
            if deed == "is no Python" and method:
                continue
            text = f"\n{code}\n"
            if method:
                text = (
                    f"\n_as_it_was = Servo.{method}\ndef _hostile(self, *args, **names):\n"
                    + textwrap.indent(code, "    ")
                    + "\n    return _as_it_was(self, *args, **names)\n"
                    + f"Servo.{method} = _hostile\n"
                )
            yield _written(name, _behind(entries, text))


def _wrong(entries: Entries) -> Iterator[Case]:
    for name, (method, code) in WRONG.items():
        names = {"do_step": "current_time, step_size", "_set_fmu_state": "state"}
        arguments = names.get(method, "" if method.startswith("exit") else "vrs")
        text = (
            f"\n_as_it_was = Servo.{method}\ndef _wrong(self, {arguments}):\n"
            f"    out = _as_it_was(self, {arguments})\n    {code}\nServo.{method} = _wrong\n"
        )
        yield _written(name, _behind(entries, text))
    yield _written("instances that share their state", _behind(entries, SHARED))
    slave = _slave(entries)
    for name, old, new in (
        ("a wrong Runge-Kutta weight", rb"dt / 6\.0", b"dt / 6.001"),
        ("a wrong half step", rb"half = 0\.5 \*", b"half = 0.5001 *"),
        ("a wrong law", rb"(error\w*) = (?=\w+ - )", rb"\1 = 1e-7 + "),
    ):
        changed, count = re.subn(old, new, entries[slave])
        assert count, name
        yield _written(name, {**entries, slave: changed})


def _described(entries: Entries) -> Iterator[Case]:
    text = entries[XML].decode()
    for name, (old, new) in DESCRIPTIONS.items():
        changed, count = re.subn(old, lambda _, new=new: new, text, count=1)
        assert count, name
        yield _written(name, {**entries, XML: changed.encode()})
    twice = text.replace('name="rate"', 'name="reading"')
    yield _written("two variables of one name", {**entries, XML: twice.encode()})


def _missing(entries: Entries) -> Iterator[Case]:
    for name, pattern in MISSING.items():
        kept = {n: content for n, content in entries.items() if not re.fullmatch(pattern, n)}
        assert len(kept) < len(entries), name
        yield _written(name, kept)
    for name, spoil in LIBRARIES.items():
        spoilt = {n: spoil(c) if n.startswith("binaries/") else c for n, c in entries.items()}
        yield _written(name, spoilt)
    for name, said in (
        ("a slave that is a path", b"../../../../tmp/slave"),
        ("a slave that is of the standard library", b"antigravity"),
        ("a slave with a NUL", b"joint\0"),
        ("a slave with a name of 1 MB", b"x" * 1_000_000),
    ):
        yield _written(name, {**entries, "resources/slavemodule.txt": said})


def _archives(good: Path, entries: Entries) -> Iterator[Case]:
    whole = good.read_bytes()
    token = f"servo-models-slip-{os.getpid()}"
    for name, entry in (
        ("a file above its folder", f"../{token}"),
        ("a file far above its folder", f"{'../' * 12}tmp/{token}"),
        ("a file above, from below", f"resources/../../{token}"),
        ("an absolute file", f"/tmp/{token}"),
        ("a file on a drive", f"C:/{token}"),
        ("a file behind backslashes", f"..\\{token}"),
        ("a file with an escape in its name", f"re\x1b[31m{token}"),
        ("a file with a very long name", "x" * 5000),
        ("a file with a very long path", "x/" * 3000 + "x"),
    ):
        yield _written(name, {**entries, entry: b"hello"})
    for name, mode, target in (
        ("a link to a file", 0o120777, b"/etc/passwd"),
        ("a link to a folder", 0o120777, b"/tmp"),
        ("a device", 0o020666, b""),
        ("a pipe", 0o010666, b""),
    ):
        yield Case(name, False, _with_special(entries, mode, target, token))
    bomb = {f"resources/{k}": bytes(1 << 26) for k in range(8)}
    yield Case("a bomb of 512 MB", False, lambda path: _zip(path, {**entries, **bomb}))
    yield Case("a bomb that lies about its size", False, _lying_bomb(entries))
    many = {f"resources/{k}.txt": b"" for k in range(20_000)}
    yield Case("20 000 files", False, lambda path: _zip(path, {**entries, **many}))
    yield _written("bzip2", entries, compression=zipfile.ZIP_BZIP2)
    yield _written("LZMA", entries, compression=zipfile.ZIP_LZMA)
    yield Case("a description that is there twice", False, _twice(entries))
    yield _written("a folder where a file is", {**entries, f"{XML}/x": b"hello"})
    for name, content in (
        ("a file cut off", whole[: len(whole) // 2]),
        ("a file without its directory", whole[:-22]),
        ("an empty file", b""),
        ("zeros", bytes(100_000)),
        ("a text", b"hello"),
        ("damaged contents", whole[:5000] + bytes(3000) + whole[8000:]),
        ("a damaged directory", whole[:-300] + bytes(200) + whole[-100:]),
        ("encrypted files", _encrypted(whole)),
        ("a wrong check sum", whole.replace(whole[14:18], b"\1\2\3\4")),
    ):
        yield Case(name, False, lambda path, content=content: _put(path, content))


def _harmless(good: Path, entries: Entries) -> Iterator[Case]:
    text = entries[XML].decode()
    whole = good.read_bytes()
    yield Case("as it was built", True, lambda path: _put(path, whole))
    yield _written("packed again", entries, harmless=True)
    yield _written("not compressed", entries, harmless=True, compression=zipfile.ZIP_STORED)
    yield _written("in another order", dict(reversed(entries.items())), harmless=True)
    extra = {"documentation/index.html": b"<p>hello", "extra/org.example/x.txt": b"hello"}
    yield _written("with documents", {**entries, **extra}, harmless=True)
    yield Case("behind other bytes", True, lambda path: _put(path, b"#!/bin/sh\n" + whole))
    flat = re.sub(r">\s+<", "><", text)
    yield _written("without indents", {**entries, XML: flat.encode()}, harmless=True)
    comment = text.replace("<ModelVariables>", "<!-- hello --><ModelVariables>")
    yield _written("with a comment", {**entries, XML: comment.encode()}, harmless=True)
    wide = text.replace("UTF-8", "UTF-16")
    yield _written("in UTF-16", {**entries, XML: wide.encode("utf-16")}, harmless=True)
    linux = {n: c for n, c in entries.items() if "win64" not in n}
    if sys.platform == "linux":
        yield _written("for Linux only", linux, harmless=True)
    yield _written("that says a word", _behind(entries, "\nprint('hello')\n"), harmless=True)


def _put(path: Path, content: bytes) -> None:
    path.write_bytes(content)


def _zip(path: Path, entries: Entries) -> None:
    _written("", entries).write(path)


def _with_special(entries: Entries, mode: int, target: bytes, token: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with zipfile.ZipFile(path, "w") as archive:
            for entry, content in entries.items():
                archive.writestr(entry, content)
            info = zipfile.ZipInfo("resources/link")
            info.create_system, info.external_attr = 3, mode << 16
            archive.writestr(info, target)
            archive.writestr(f"resources/link/{token}", b"hello")

    return write


def _twice(entries: Entries) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with zipfile.ZipFile(path, "w") as archive:
            for entry, content in entries.items():
                archive.writestr(entry, content)
            info = zipfile.ZipInfo(XML.upper())
            archive.writestr(info, entries[XML])

    return write


def _lying_bomb(entries: Entries) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        held = io.BytesIO()
        with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
            for entry, content in entries.items():
                archive.writestr(entry, content)
            archive.writestr("resources/bomb", bytes(400 << 20))
        size = struct.pack("<I", 400 << 20)
        path.write_bytes(held.getvalue().replace(size, struct.pack("<I", 1000)))

    return write


def _encrypted(whole: bytes) -> bytes:
    """Every entry marked as encrypted, in its header and in the directory."""
    changed = bytearray(whole)
    for mark, at in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        for found in re.finditer(re.escape(mark), whole):
            changed[found.start() + at] |= 1
    return bytes(changed)


# Running them.


def made_good(folder: Path) -> tuple[Path, Path]:
    """Write the actuator and build its FMU; return both paths."""
    from servo_models.build import build
    from servo_models.catalogue import model

    source = folder / "joint.py"
    source.write_text(NO_REFERENCES)
    return source, build(model(str(source)), folder / "joint.fmu")


def judge(case: Case, source: Path, home: Path) -> Outcome:
    """Validate one FMU in a folder of its own and look at what is left."""
    with tempfile.TemporaryDirectory(dir=home) as name:
        ground = Path(name)
        temporary, place = ground / "tmp", ground / "a" / "b"
        temporary.mkdir()
        place.mkdir(parents=True)
        fmu = place / "it.fmu"
        case.write(fmu)
        before = _seen(ground)
        command = [sys.executable, "-m", "servo_models", "validate", str(fmu)]
        command += ["--actuator", str(source), "--timeout", str(LIMIT_SECONDS)]
        environment = {**os.environ, "TMPDIR": str(temporary), "COLUMNS": "200"}
        environment.setdefault("SERVO_MODELS_CACHE", str(home / "cache"))
        began = time.monotonic()
        code, said = _ended(command, place, environment)
        seconds = time.monotonic() - began
        left = [str(path) for path in sorted(_seen(ground) - before)]
        left += [str(path) for path in Path("/tmp").glob(f"servo-models-slip-{os.getpid()}*")]
        left += _running_in(ground)
    return Outcome(case, code, said, tuple(left), seconds)


def _ended(command: list[str], place: Path, environment: dict[str, str]) -> tuple[int | None, str]:
    try:
        done = subprocess.run(
            command,
            cwd=place,
            env=environment,
            capture_output=True,
            timeout=NO_END_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return None, "no end"
    return done.returncode, (done.stdout + done.stderr).decode(errors="replace")


def _seen(folder: Path) -> set[Path]:
    return set(folder.rglob("*"))


def _running_in(folder: Path) -> list[str]:
    """Processes whose working folder lies there, where the system tells."""
    found = []
    for link in Path("/proc").glob("[0-9]*/cwd"):
        try:
            if str(folder) in os.readlink(link):
                found.append(f"process {link.parent.name}")
        except OSError:  # it has ended, or is not ours
            continue
    return found


def main() -> int:
    """Run the cases; return 0 if all are sound."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", metavar="TEXT", default="", help="cases whose names have it")
    chosen = parser.parse_args()
    outcomes = []
    with tempfile.TemporaryDirectory(prefix="hostile-") as name:
        home = Path(name)
        source, good = made_good(home)
        every = [case for case in cases(good, chosen.seed) if chosen.only in case.name]
        for case in every[: chosen.count]:
            outcome = judge(case, source, home)
            outcomes.append(outcome)
            word = "sound" if outcome.sound else "NOT SOUND"
            last = _reason(outcome.said)
            print(f"{word:9} {outcome.seconds:5.1f} s  exit {outcome.code}  {case.name}: {last}")
            sys.stdout.flush()
            if outcome.left:
                print("          left:", *outcome.left)
    print()
    for what, count in figures(outcomes).items():
        print(f"{what:32} {count}")
    return 0 if all(outcome.sound for outcome in outcomes) else 1


def figures(outcomes: list[Outcome]) -> dict[str, int]:
    """Count what the bars are about."""
    codes = collections.Counter(o.code for o in outcomes if not o.case.harmless)
    return {
        "FMUs": len(outcomes),
        "of them harmless": sum(o.case.harmless for o in outcomes),
        "crashes or hangs of the command": sum(o.crashed for o in outcomes),
        "false passes": sum(o.false_pass for o in outcomes),
        "false alarms": sum(o.false_alarm for o in outcomes),
        "left files or processes behind": sum(bool(o.left) for o in outcomes),
        "failed rows (exit code 1)": codes[FAILED],
        "refused as unreadable (2)": codes[COULD_NOT_RUN],
        "longest [s]": round(max((o.seconds for o in outcomes), default=0.0)),
    }


def _reason(said: str) -> str:
    lines = [line for line in said.splitlines() if line.strip()]
    failed = [line for line in lines if line.startswith("FAIL ")]
    return re.sub(r"\s+", " ", (failed or lines or [""])[-1])[-160:]


if __name__ == "__main__":
    sys.exit(main())
