"""Damage every kind of file that is read, and give it to the readers and commands.

    python tests/fuzz/inputs.py [--count 5000] [--seed 0] [--keep]

A case is a folder with a valid input (a log of any format or a robot's recording with its
description, sweeps, tables of elements, a parameter file, a table of inputs) of which one file is
damaged: bytes, text, values and types, columns, joints and clocks, or the kind of file.  A forked
process reads it.  Counted are

* tracebacks, and ends by a signal;
* logs that are called usable by a description without a command;
* hangs: more than 10 s of processor time, or 60 s on the clock, before the input is read;
* memory: more than 1 GB;
* sentences that do not name a file of the case, the place and the cure.

An input that is still valid is read, and not worked on; ``check`` and ``simulate`` run through.
``tests/data/test_hostile_inputs.py`` runs a share.  Exit code 1: anything was counted.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import importlib
import io
import json
import logging
import os
import pickle
import random
import re
import resource
import shutil
import signal
import struct
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
from tests.support import bags, dataflash, lerobot

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

EXAMPLES = Path(__file__).parents[2] / "examples"
PROCESSOR_SECONDS = 10
CLOCK_SECONDS = 60  # other work on the machine may slow a case down this much
WORK_SECONDS = 20  # what ``check`` may do with an input that it has accepted, before it is stopped
LARGEST = 1_000_000_000  # bytes of memory
ADDRESSES = 6_000_000_000
"""Bytes of addresses that a case may reserve: above it would harm the machine."""

REFUSED, ACCEPTED, STOPPED, CRASHED = 2, 0, 7, 3
"""Exit codes of a case: a sentence, no complaint, stopped while at work, a traceback."""
ROWS = 60

Columns = dict[str, Any]


def _columns() -> Columns:
    """A log of an SG90 in plain numbers."""
    times = np.round(0.02 * np.arange(ROWS), 3)
    command = np.where(np.arange(ROWS) > 10, 1600.0, 1500.0)
    angle = 9.0 * (1.0 - np.exp(-np.maximum(times - 0.25, 0.0) / 0.05))
    angle += 0.1 * np.random.default_rng(1).standard_normal(ROWS)
    return {"t": times, "command": command, "angle": np.round(angle, 3)}


def _csv(columns: Columns) -> bytes:
    rows = "\n".join(",".join(map(str, row)) for row in zip(*map(list, columns.values())))
    return (",".join(columns) + f"\n{rows}\n").encode("utf-8", "replace")


def _tsv(columns: Columns) -> bytes:
    return _csv(columns).replace(b",", b"\t").replace(b".", b",")


def _json(columns: Columns) -> bytes:
    rows = zip(*map(list, columns.values()))
    return json.dumps([dict(zip(columns, row)) for row in rows], default=str).encode()


def _json_lists(columns: Columns) -> bytes:
    lists = {name: list(values) for name, values in columns.items()}
    return json.dumps({"rig": "a", "data": lists}, default=str).encode()


def _parquet(columns: Columns) -> bytes:
    import polars as pl

    stream = io.BytesIO()
    pl.DataFrame([pl.Series(n, list(v), strict=False) for n, v in columns.items()]).write_parquet(
        stream
    )
    return stream.getvalue()


def _mat(columns: Columns) -> bytes:
    import scipy.io

    stream = io.BytesIO()
    scipy.io.savemat(stream, {name: np.array(values) for name, values in columns.items()})
    return stream.getvalue()


def _mat_73(columns: Columns) -> bytes:
    import h5py

    stream = io.BytesIO()
    with h5py.File(stream, "w", userblock_size=512) as file:
        for name, values in columns.items():
            file[name] = np.atleast_2d(np.array(values))
    return b"MATLAB 7.3 MAT-file".ljust(512) + stream.getvalue()[512:]


def _ulog(columns: Columns) -> bytes:
    """As the PX4 User Guide says, ULog File Format."""

    def message(kind: bytes, content: bytes) -> bytes:
        return struct.pack("<H", len(content)) + kind + content

    head = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + message(b"B", bytes(40))
    _, *others = columns
    fields = "".join(f"double {name};" for name in others)
    head += message(b"F", f"rig:uint64_t timestamp;{fields}".encode())
    head += message(b"A", struct.pack("<BH", 0, 0) + b"rig")
    for time_, *values in zip(*map(list, columns.values())):
        stamp = int(1e6 * float(time_)) % 2**64
        head += message(
            b"D", struct.pack(f"<HQ{len(values)}d", 0, stamp, *(float(v) for v in values))
        )
    return head


def _mcap(columns: Columns) -> bytes:
    from mcap.writer import Writer

    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start()
    channel = writer.register_channel(topic="rig", message_encoding="json", schema_id=0)
    for i, row in enumerate(zip(*map(list, columns.values()))):
        data = json.dumps(dict(zip(columns, row)), default=str).encode()
        writer.add_message(channel, log_time=20_000_000 * i, data=data, publish_time=0)
    writer.finish()
    return stream.getvalue()


def _mcap_ros(columns: Columns) -> bytes:
    from mcap_ros2.writer import Writer

    stream = io.BytesIO()
    writer = Writer(stream)
    fields = "\n".join(f"float64 {name}" for name in columns)
    schema = writer.register_msgdef("rig_msgs/msg/Rig", fields)
    for i, row in enumerate(zip(*map(list, columns.values()))):
        message = {name: float(value) for name, value in zip(columns, row)}
        writer.write_message("rig", schema, message, log_time=20_000_000 * i, publish_time=0)
    writer.finish()
    return stream.getvalue()


def _dataflash(columns: Columns) -> bytes:
    times, command, angle = (np.array(list(values), float) for values in columns.values())
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.bin"
        return dataflash.flight_log(path, times, {1: (angle, command)}).read_bytes()


def _mdf(columns: Columns) -> bytes:
    import asammdf

    logging.getLogger("asammdf").disabled = True
    stream = io.BytesIO()
    (_, times), *others = ((name, np.array(list(values))) for name, values in columns.items())
    file = asammdf.MDF()
    signals = [asammdf.Signal(values, times, name=name) for name, values in others]
    file.append(signals, acq_name="rig", common_timebase=True)
    file.save(stream)
    return stream.getvalue()


Files = dict[str, bytes]


def _data_set(columns: Columns) -> Files:
    """A LeRobot data set with a joint, called like the last column, and two episodes."""
    action, state = (np.array(list(values), float) for values in list(columns.values())[-2:])
    names = {key: [list(columns)[-1]] for key in ("action", "observation.state")}
    with tempfile.TemporaryDirectory() as folder:
        episodes = [(action[:, None], state[:, None])] * 2
        return _files_in(lerobot.data_set(Path(folder) / "log", episodes, names=names))


def _bag(storage: str, columns: Columns) -> Files:
    """A bag of ROS 2 with a joint, called like the last column, and its command, in ms."""
    name = list(columns)[-1]
    times, *values = (list(values) for values in columns.values())
    stamps = [bags.ns(float(time_)) for time_ in times]
    topics = {
        topic: [
            (stamp, bags.joint_state(bags.EPOCH + stamp, [name], [1e-3 * float(value)]))
            for stamp, value in zip(stamps, own)
        ]
        for topic, own in zip(("/command", "/joint_states"), values)
    }
    with tempfile.TemporaryDirectory() as folder:
        return _files_in(bags.bag(Path(folder) / "log", topics, storage))


def _files_in(folder: Path) -> Files:
    """The files of a folder, by their places as seen from beside it."""
    files = (file for file in sorted(folder.rglob("*")) if file.is_file())
    return {file.relative_to(folder.parent).as_posix(): file.read_bytes() for file in files}


FORMATS: dict[str, tuple[str, Callable[[Columns], bytes]]] = {
    "CSV": ("log.csv", _csv),
    "TSV": ("log.tsv", _tsv),
    "JSON records": ("log.json", _json),
    "JSON lists": ("log.json", _json_lists),
    "Parquet": ("log.parquet", _parquet),
    "MAT v5": ("log.mat", _mat),
    "MAT v7.3": ("log.mat", _mat_73),
    "ULog": ("log.ulg", _ulog),
    "MCAP, JSON": ("log.mcap", _mcap),
    "MCAP, ROS 2": ("log.mcap", _mcap_ros),
    "DataFlash": ("log.bin", _dataflash),
    "MDF4": ("log.mf4", _mdf),
}
ROBOTS: dict[str, Callable[[Columns], Files]] = {
    "LeRobot": _data_set,
    "bag, MCAP": functools.partial(_bag, "mcap"),
    "bag, sqlite3": functools.partial(_bag, "sqlite3"),
}
DESCRIPTION = """actuator = "sg90"
variant = "measured"
free = ["motor_gain", "motor_time_constant"]
[parameters]
motor_gain = 460.0
[parameters.transport_delay]
time = "15 ms"
[uncertainty]
motor_time_constant = "10 %"
amplifier_gain = 0.3
[bounds]
motor_gain = [100.0, 1000.0]
[[logs]]
name = "step"
file = "FILE"
window = ["0 s", "1.1 s"]
held_out = { from = "0.9 s", to = "1 s" }
settle = "0.1 s"
[logs.time]
column = "t"
unit = "s"
[logs.inputs]
pulse_width = { column = "command", unit = "us", scale = 1.0, offset = 0.0, shift = "1 ms" }
[logs.outputs.angle]
column = "angle"
unit = "deg"
sign = 1
[logs.constants]
"backlash.half_width" = "0 deg"
"""
PARAMETERS = """actuator = "sg90"
variant = "measured"
method = "by hand"
date = 2026-01-31
servo_models = "0.1.0"
warnings = ["motor_gain: roughly"]
[logs]
"step.csv" = "sha256:00"
[parameters.motor_gain]
value = 450.0
unit = "rad/(s.V)"
standard_error = 3.0
origin = "estimated"
[parameters.transport_delay.time]
value = 12.0
unit = "ms"
[figures.held_out_rms]
value = 0.01
unit = "deg"
"""
OF_BAGS = {
    '"t"\nunit = "s"': '"header_stamp"\nunit = "ns"\ntable = "/joint_states"',
    '"command", unit = "us"': '"position.angle", table = "/command", unit = "ms"',
    '"angle"': '"position.angle"',
}
NAMES = {
    "JSON lists": {'"t"': '"data.t"', '"command"': '"data.command"', '"angle"': '"data.angle"'},
    "ULog": {'"t"\nunit = "s"': '"timestamp"\nunit = "us"'},
    "DataFlash": {
        '"t"\nunit = "s"': '"TimeUS"\nunit = "us"\ntable = "CSRV[1]"',
        '"command"': '"PosCmd"',
        '"angle"': '"Pos"',
    },
    "MDF4": {'"t"': '"time [s]"'},
    "LeRobot": {
        '"t"': '"timestamp"',
        '"command"': '"action[0]"',
        '"angle"': '"observation.state[0]"',
    },
    "bag, MCAP": OF_BAGS,
    "bag, sqlite3": OF_BAGS,
}
"""What stands behind ``column =`` in place of what ``DESCRIPTION`` has, by the kind of input."""


class Base(NamedTuple):
    """A valid input: its files, the one that a reader is given, and the ways to read it."""

    kind: str
    files: dict[str, bytes]
    main: str
    ways: tuple[tuple[str, ...], ...]
    write: Callable[[Columns], Files] | None = None


READ = ("read", "FILE")
ELEMENTS = ("identify", "FILE")
DESCRIBED = (READ, READ, READ, ("check", "FILE"), ("identify", "FILE"), ("diagnose", "FILE"))


def bases() -> list[Base]:
    """Every kind of valid input."""
    found = []
    for kind in (*FORMATS, *ROBOTS):
        name = FORMATS[kind][0] if kind in FORMATS else "log"
        write = ROBOTS.get(kind) or functools.partial(_one, *FORMATS[kind])
        text = DESCRIPTION.replace("FILE", name)
        for own, inside in NAMES.get(kind, {}).items():
            text = text.replace(f"column = {own}", f"column = {inside}")
        begin = ("check", name, "--init")
        ways = (*DESCRIBED, (*begin, "--actuator", "sg90") if kind in FORMATS else begin)
        files = {**write(_columns()), "rig.toml": text.encode()}
        found.append(Base(kind, files, "rig.toml", ways, write))
    found.append(Base("description", dict(found[0].files), "rig.toml", DESCRIBED))
    for example in ("servo_bench", "torque_motor", "two_csv_files"):
        folder = EXAMPLES / example
        files = {f.name: f.read_bytes() for f in sorted(folder.glob("*.*")) if f.suffix != ".py"}
        files.pop("README.md")
        ways = (READ, ELEMENTS, ELEMENTS) if example == "servo_bench" else DESCRIBED
        found.append(Base(example, files, "description.toml", ways))
    commands = (
        ("read parameters", "FILE"),
        ("explain", "--params", "FILE"),
        ("simulate", "--params", "FILE", "--stop", "0.1"),
        ("figures", "--params", "FILE"),
        ("build", "--params", "FILE", "--out", "fmus"),
        ("validate", "--params", "FILE"),
    )
    found.append(Base("parameters", {"own.toml": PARAMETERS.encode()}, "own.toml", commands))
    for name, write in (("in.csv", _csv), ("in.parquet", _parquet)):
        table = {"time": 0.01 * np.arange(ROWS), "pulse_width [us]": _columns()["command"]}
        ways = (("simulate", "sg90", "--inputs", "FILE"),)
        one = functools.partial(_one, name, write)
        found.append(Base(f"inputs, {name}", one(table), name, ways, one))
    return found


def _one(name: str, write: Callable[[Columns], bytes], columns: Columns) -> Files:
    return {name: write(columns)}


def _write(files: Files, folder: Path) -> None:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


# Damage

TEXTS = (
    *("", " ", "nan", "inf", "-inf", "1e400", "-1e308", "1e-320", "9" * 5000, "1_0", "0x10"),
    *("0", "-1", "1e12", "1 9**9**9**9", "1 m" + "**9" * 30, "1 " + "(" * 50, "3 deg/0", "1 kg"),
    *("a\0b", "x" * 5000, "\x1b[31mred\x1b[0m", "\u202eabc", "=1+1", "@x", "..", "/", "/dev/zero"),
    *(
        "/proc/self/mem",
        "~",
        "a/b/c",
        "x" * 300 + ".csv",
        "\udcff",
        "é",
        "\uff11",
        "NaN",
        "1,5",
        "µs",
    ),
    *("1 %", "-5 %", "1e999 s", "1 degC", "1 dB", "1 %%", "°", "ns", "h", "year"),
)
NUMBERS = (
    *(0, -1, 1, 2**31, 2**63, 2**64, 10**30, 10**400, 1e308, -1e308, 1e-320, 5e-324),
    *(float("nan"), float("inf"), float("-inf"), 1e12, 1e19, 0.5, -0.0),
)
KINDS: tuple[Any, ...] = ([], {}, [[]], [{}], {"": ""}, True, False, [1, "a"], [None], {"a": {}})


def nasty(rng: random.Random) -> Any:
    """A value that nobody expects."""
    kind = rng.randrange(4)
    if kind == 0:
        return rng.choice(TEXTS)
    if kind == 1:
        return rng.choice(NUMBERS)
    if kind == 2:
        return rng.choice(KINDS)
    value: Any = rng.choice((1, "a", []))
    for _ in range(rng.choice((2, 20, 90))):
        value = [value] if rng.random() < 0.5 else {"a": value}
    return value


def damage_bytes(content: bytes, rng: random.Random) -> bytes:
    """Change bytes, whatever they mean."""
    size = len(content)
    begin, length = rng.randrange(size + 1), rng.choice((1, 4, 16, 200, 3000))
    end = min(begin + length, size)
    kind = rng.randrange(12)
    if kind == 0:
        return content[:begin]
    if kind == 1:
        return content[begin:]
    if kind == 2:
        return content[:begin] + content[end:]
    if kind == 3:
        return content[:end] + content[begin:end] * rng.choice((1, 9)) + content[end:]
    if kind == 4:
        return content[:begin] + rng.randbytes(length) + content[begin:]
    if kind == 5:
        return content[:begin] + bytes(end - begin) + content[end:]
    if kind == 6:
        return content[:begin] + b"\xff" * (end - begin) + content[end:]
    if kind == 7:
        return rng.choice((b"", b"\n", b"\0" * 1000, b"\xef\xbb\xbf", b"#", rng.randbytes(2000)))
    if kind == 8:
        text = content.decode("utf-8", "replace")
        return text.encode(rng.choice(("utf-16", "utf-32", "utf-8-sig")), "replace")
    changed = bytearray(content)
    for _ in range(rng.choice((1, 3, 20))):
        if changed:
            changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def damage_text(content: bytes, rng: random.Random) -> bytes:
    """Change words, numbers and lines of a text."""
    text = content.decode("utf-8", "replace")
    lines = text.split("\n")
    one, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(6)
    if kind == 0:
        lines[one], lines[other] = lines[other], lines[one]
    elif kind == 1:
        lines[one:one] = [lines[other]] * rng.choice((1, 2, 500))
    elif kind == 2:
        del lines[one]
    else:
        pattern = rng.choice((r"[-+]?\d+\.?\d*", r"\w+", r'"[^"\n]*"', r"[\[\]{}=,.\"]"))
        places = list(re.finditer(pattern, text))
        if places:
            place = rng.choice(places)
            new = rng.choice((*TEXTS, "[" * 3000, '"', "[[", "'''", "{", *map(repr, NUMBERS)))
            return (text[: place.start()] + new + text[place.end() :]).encode("utf-8", "replace")
    return "\n".join(lines).encode("utf-8", "replace")


def _nodes(tree: Any) -> list[tuple[Any, Any]]:
    """Every inner value as its parent and its key."""
    inner = tree.items() if isinstance(tree, dict) else enumerate(tree)
    found = [(tree, key) for key, _ in inner]
    for _, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
        if isinstance(value, (dict, list)):
            found += _nodes(value)
    return found


def damage_tree(tree: Any, rng: random.Random) -> Any:
    """Change, remove, rename or exchange values of a tree."""
    if rng.random() < 0.03:
        return nasty(rng)
    named = [(parent, key) for parent, key in _nodes(tree) if key in ("file", "actuator", "unit")]
    if named and rng.random() < 0.2:
        parent, key = rng.choice(named)
        parent[key] = nasty(rng)
        return tree
    for _ in range(rng.choice((1, 1, 2))):
        nodes = _nodes(tree)
        if not nodes:
            return tree
        (parent, key), (other, second) = rng.choice(nodes), rng.choice(nodes)
        kind = rng.randrange(6)
        if kind == 0:
            del parent[key]
        elif kind == 1 and isinstance(parent, dict):
            name = rng.choice((*TEXTS, "file", "time", "logs", "column", "unit", "table", "params"))
            parent[name] = parent.pop(key)
        elif kind == 2 and not isinstance(parent[key], (dict, list)):
            parent[key], other[second] = (
                json.loads(json.dumps(other[second], default=str)),
                (parent[key]),
            )
        else:
            parent[key] = nasty(rng)
    return tree


def damage_toml(content: bytes, rng: random.Random) -> bytes:
    """Change the tables of a TOML file."""
    import tomli_w

    tree = damage_tree(tomllib.loads(content.decode()), rng)
    with contextlib.suppress(Exception):  # what TOML cannot say
        return tomli_w.dumps(tree).encode()
    return damage_text(content, rng)


def damage_columns(columns: Columns, rng: random.Random) -> Columns:
    """Change clocks, values, types and names of columns."""
    columns = {name: list(values) for name, values in columns.items()}
    name = rng.choice(list(columns))
    values = columns[name]
    row = rng.randrange(len(values))
    kind = rng.randrange(14)
    scale = rng.choice((1e-9, 1e-3, 1e3, 1e6, 1e9, 1e300, -1.0, 0.0))
    if kind == 0:
        columns[name] = [scale * float(value) for value in values]
    elif kind == 1:
        columns[name] = [
            v + (i >= row) * rng.choice((1e5, 1e12, -5.0)) for i, v in enumerate(values)
        ]
    elif kind == 2:
        columns[name] = [1_700_000_000_000_000_000 + int(2e7 * i) for i in range(len(values))]
    elif kind == 3:
        values[row] = rng.choice(NUMBERS)
    elif kind == 4:
        values[row] = rng.choice(TEXTS)
    elif kind == 5:
        values[row] = None
    elif kind == 6:
        columns[name] = rng.choice(
            ([True] * len(values), ["a"] * len(values), [[1.0]] * len(values))
        )
    elif kind == 7:
        columns[name] = [{"a": 1}] * len(values)
    elif kind == 8:
        columns = {key: column[: rng.choice((0, 1, 2, 15))] for key, column in columns.items()}
    elif kind == 9:
        columns = {(rng.choice(TEXTS) if key == name else key): v for key, v in columns.items()}
    elif kind == 10:
        keys = list(columns)
        rng.shuffle(keys)
        columns = dict(zip(keys, columns.values()))
    elif kind == 11:
        columns[name] = values[::-1]
    elif kind == 12:
        del columns[name]
    else:
        columns[name] = [rng.choice(NUMBERS) for _ in values]
    return columns


def damage_kind(path: Path, rng: random.Random) -> None:
    """Put something that is no regular file, or a huge one, in a file's place."""
    content = path.read_bytes()
    path.unlink()
    kind = rng.randrange(7)
    if kind == 0:
        os.mkfifo(path)
    elif kind == 1:
        path.symlink_to(rng.choice(("/dev/zero", "/dev/null", "/dev/full", "nowhere", path.name)))
    elif kind == 2:
        path.mkdir()
    elif kind == 3:
        with path.open("wb") as stream:
            stream.write(content)
            stream.truncate(rng.choice((5, 300)) * 10**9)
    elif kind == 4:
        path.write_bytes(b"[" * 100_000 if rng.random() < 0.5 else b'{"a":' * 50_000)
    elif kind == 5:
        path.write_bytes(_bomb())
    # else it is missing


@functools.cache
def _bomb() -> bytes:
    """A Parquet file of less than 1 MB that unpacks to gigabytes."""
    import polars as pl

    stream = io.BytesIO()
    frame = pl.DataFrame({f"c{i}": pl.zeros(2_000_000, eager=True) for i in range(3)})
    frame.write_parquet(stream, compression="zstd")
    return stream.getvalue()


def damage(base: Base, folder: Path, rng: random.Random) -> str:
    """Write a case; return what was damaged."""
    _write(base.files, folder)
    data = [name for name in base.files if name != base.main]
    name = rng.choice(data) if data and base.kind != "description" else base.main
    if rng.random() < 0.15:
        name = base.main
    path = folder / name
    content = base.files[name]
    is_text = path.suffix in (".toml", ".csv", ".tsv", ".json", ".yaml")
    way = rng.random()
    if way < 0.04:
        damage_kind(path, rng)
    elif way < 0.3 or not (is_text or base.write):
        path.write_bytes(damage_bytes(content, rng))
    elif path.suffix == ".toml" and way < 0.8:
        path.write_bytes(damage_toml(content, rng))
    elif path.suffix == ".json" and way < 0.6:
        text = json.dumps(damage_tree(json.loads(content), rng))
        path.write_bytes(text.encode("utf-8", "replace"))
    elif base.write and name != "rig.toml" and (way < 0.8 or not is_text):
        with contextlib.suppress(Exception):  # what the format cannot hold: stays valid
            columns = _columns() if data else _table_of(base)
            _write(base.write(damage_columns(columns, rng)), folder)
    else:
        path.write_bytes(damage_text(content, rng))
    return name


def _table_of(base: Base) -> Columns:
    return {"time": 0.01 * np.arange(ROWS), "pulse_width [us]": _columns()["command"]}


# Reading

PLACE = re.compile(
    r"row \d|line \d|column|at end of document|key|table|logs|sweeps|elements|', [^:]+:"
)
WHOLE = re.compile(
    r"damaged|cannot read|no known format|is empty|has no|holds no|no text in UTF-8|too large"
    r"|would take|no rows|no regular|no file|samples to use|no TOML|is no |deep|ends within"
    r"|is a folder|does not tell"
)
CURE = re.compile(
    r"[;:,] (?:or )?(?:write|give|add|set|remove|correct|save|record|name|use|choose|take|keep|sort"
    r"|leave|fill|did you|known|must|cut|show|look|raise|split|begin|allow|check|fix|map|trust|in "
    r"|its name may|it is a|it needs|separate|a sweep needs|at least|move|put|the log|the file|read"
    r"|reduce|repair|copy|there is|--|say)|needed|[Gg]ive |choose|instead"
)


def is_good(sentence: str, folder: Path, files: list[str]) -> str:
    """What a sentence lacks: file, place or cure; empty if nothing."""
    lacks = []
    if not any(name in sentence for name in files) and str(folder) not in sentence:
        lacks.append("file")
    if not (PLACE.search(sentence) or WHOLE.search(sentence)):
        lacks.append("place")
    if not CURE.search(sentence):
        lacks.append("cure")
    return " and ".join(lacks)


LONG = ("identify", "diagnose", "validate", "build")
"""Commands that are not judged beyond their reading."""


class Read(BaseException):
    """An input was accepted; what comes then is long and not judged."""


def perform(words: tuple[str, ...], folder: Path, limited: bool = True) -> int:
    """Read a case as a command or reader would; run in a process of its own."""
    from servo_models.cli import main
    from servo_models.data import description
    from servo_models.data import parameters as parameter_set
    from servo_models.errors import UserError

    if words[0] in ("read", "read parameters"):
        try:
            _read(words[0], folder / words[1])
        except UserError as error:
            print(f"servo-models: {error}", file=sys.stderr)
            return REFUSED
        return ACCEPTED
    readers = ((description, "read_description"), (parameter_set, "read_parameters"))
    for module, name in readers if limited else ():
        setattr(module, name, _then_working(getattr(module, name), words[0]))
    return main(words)


def _then_working(read: Callable[..., Any], command: str) -> Callable[..., Any]:
    """A reader after which the limits are those of work, or which ends the case."""

    def read_and_go_on(*arguments: Any, **options: Any) -> Any:
        found = read(*arguments, **options)
        if command in LONG and getattr(found, "logs", True):  # elements are read later, and soon
            raise Read
        signal.alarm(0)
        signal.signal(signal.SIGPROF, _stop)
        signal.setitimer(signal.ITIMER_PROF, WORK_SECONDS)
        return found

    return read_and_go_on


def _stop(*_: object) -> None:
    os._exit(STOPPED)


def _read(what: str, path: Path) -> None:
    from servo_models.data.description import read_description
    from servo_models.data.parameters import read_parameters
    from servo_models.identification.transfer.sweeps import read_sweeps

    if what == "read parameters":
        read_parameters(path)
        return
    found = read_description(path)
    read_sweeps(found.document, path.parent, found.actuator.plant_of(found.variant))


class Outcome(NamedTuple):
    """How a case ended; ``fault`` is empty where all is well."""

    code: int
    said: str
    seconds: float
    memory: int
    fault: str


def run(words: tuple[str, ...], folder: Path, base: Base) -> Outcome:
    """Run a case in a forked process, with limits, and judge it."""
    sink = folder / "..said"
    begin = time.monotonic()
    child = os.fork()
    if not child:
        _child(tuple(base.main if word == "FILE" else word for word in words), folder, sink)
    _, status, used = os.wait4(child, 0)
    seconds = used.ru_utime + used.ru_stime
    said = sink.read_text("utf-8", "replace")
    code = os.waitstatus_to_exitcode(status)
    memory = 1024 * used.ru_maxrss
    fault = ""
    if "Traceback (most recent" in said or "panicked at" in said or code == CRASHED:
        fault = "traceback"
    elif code in (-signal.SIGPROF, -signal.SIGALRM):
        fault = f"hang of {time.monotonic() - begin:.0f} s"
    elif code < 0:
        fault = f"signal {-code}"
    elif memory > LARGEST:
        fault = "memory"
    elif code == REFUSED:
        folders = {f"'{Path(name).parts[0]}'" for name in base.files}
        lacks = is_good(_sentence(said), folder, [*base.files, *folders])
        fault = lacks and f"sentence without {lacks}"
    elif "logs are usable" in said and not _commands(folder / base.main):
        fault = "called usable"
    return Outcome(code, said, seconds, memory, fault)


def _commands(path: Path) -> bool:
    """Whether a description has a column for a command."""
    logs = tomllib.loads(path.read_text("utf-8"))["logs"]
    return any(run.get("inputs") for log in logs for run in (log, *log.get("repeat", ())))


def _sentence(said: str) -> str:
    lines = [line for line in said.splitlines() if line.startswith("servo-models:")]
    return lines[-1] if lines else said


def _child(words: tuple[str, ...], folder: Path, sink: Path) -> None:
    code = CRASHED
    try:
        handle = os.open(sink, os.O_CREAT | os.O_WRONLY | os.O_TRUNC)
        os.dup2(handle, 1)
        os.dup2(handle, 2)
        os.chdir(folder)
        resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
        signal.setitimer(signal.ITIMER_PROF, PROCESSOR_SECONDS)
        signal.alarm(CLOCK_SECONDS)
        code = perform(words, folder)
    except Read:
        code = ACCEPTED
    except BaseException:
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def warm(known: list[Base], folder: Path) -> None:
    """Load what cases need, so that no case pays for it.

    A process of its own reads every valid input, and tells what it has loaded: threads, which it
    has by then, must not begin before a fork.
    """
    for name in _in_process(functools.partial(_modules_of, known, folder), folder / "modules"):
        with contextlib.suppress(Exception):  # what is no module to import
            importlib.import_module(name)
    from servo_models.catalogue import actuator
    from servo_models.units import exponents

    for unit in ("1", "V", "deg", "ms", "rad", "rad/s", "s", "us"):
        exponents(unit)
    actuator("sg90")


def _modules_of(known: list[Base], folder: Path) -> list[str]:
    sys.stdout = sys.stderr = io.StringIO()
    for number, base in enumerate(known):
        place = folder / str(number)
        place.mkdir()
        _write(base.files, place)
        for way in dict.fromkeys(base.ways):
            if way[0] not in LONG or base.kind == "servo_bench":
                words = tuple(base.main if word == "FILE" else word for word in way)
                os.chdir(place)
                _perform_valid(words, place)
    return list(sys.modules)


def _perform_valid(words: tuple[str, ...], folder: Path) -> None:
    code = perform(words, folder, limited=False)
    if code not in (ACCEPTED, 1):
        raise RuntimeError(f"valid input refused: {words}: {sys.stderr.getvalue()}")


class Tally(NamedTuple):
    """What was counted."""

    cases: Counter[str]
    outcomes: Counter[str]
    faults: list[tuple[int, str, str, Outcome]]
    longest: float
    largest: int


def fuzz(count: int, seed: int = 0, keep: bool = False, begin: int = 0) -> Tally:
    """Run ``count`` cases; each is told by the seed and its number."""
    with tempfile.TemporaryDirectory(prefix="damaged inputs ") as scratch:
        valid = Path(scratch) / "valid"
        valid.mkdir()
        known = _in_process(bases, valid / "bases")
        warm(known, valid)
        cases: Counter[str] = Counter()
        outcomes: Counter[str] = Counter()
        faults, longest, largest = [], 0.0, 0
        for number in range(begin, begin + count):
            rng = random.Random(1_000_003 * seed + number)
            base = known[number % len(known)]
            folder = Path(scratch) / "case"
            folder.mkdir()
            damaged = _in_process(functools.partial(damage, base, folder, rng), folder / "..what")
            words = rng.choice(base.ways)
            outcome = run(words, folder, base)
            cases[base.kind] += 1
            ends = {REFUSED: "refused", STOPPED: "still at work", CRASHED: "crashed"}
            outcomes[ends.get(outcome.code, "accepted" if outcome.code >= 0 else "killed")] += 1
            longest, largest = max(longest, outcome.seconds), max(largest, outcome.memory)
            if outcome.fault:
                what = f"{base.kind}, '{damaged}' damaged, {' '.join(words)}"
                faults.append((number, what, outcome.fault, outcome))
                print(f"{number}: {what}: {outcome.fault}", flush=True)
                print("   ", outcome.said.strip()[-500:], flush=True)
                if keep:
                    shutil.copytree(folder, f"fault-{number}", symlinks=True)
            shutil.rmtree(folder)
    return Tally(cases, outcomes, faults, longest, largest)


def _in_process(make: Callable[[], Any], path: Path) -> Any:
    """What ``make`` returns in a process of its own, whose threads end with it."""
    child = os.fork()
    if not child:
        try:
            path.write_bytes(pickle.dumps(make()))
        except BaseException:
            traceback.print_exc(file=sys.__stderr__)
        sys.stdout.flush()
        os._exit(0)
    os.waitpid(child, 0)
    found = pickle.loads(path.read_bytes())
    path.unlink()
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=5000)
    parser.add_argument("--begin", type=int, default=0, help="number of the first case")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", action="store_true", help="keep faulty cases in this folder")
    given = parser.parse_args()
    tally = fuzz(given.count, given.seed, given.keep, given.begin)
    for kind, cases in tally.cases.items():
        print(f"{kind:20s} {cases}")
    print(f"{given.count} cases: ", end="")
    print(", ".join(f"{number} {name}" for name, number in tally.outcomes.items()))
    kinds = Counter(re.sub(r" of \d+ s", "", fault) for _, _, fault, _ in tally.faults)
    print(f"faults: {dict(kinds) or 'none'}")
    print(f"longest {tally.longest:.1f} s of processor time, largest {tally.largest / 1e6:.0f} MB")
    return 1 if tally.faults else 0


if __name__ == "__main__":
    sys.exit(main())
