"""Readers of measured files: what somebody else's library wrote comes back, faults have a place."""

from __future__ import annotations

import io
import json
import struct
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st

from servo_models.data.description import read_description
from servo_models.data.readers import read_columns
from servo_models.errors import UserError
from tests.support.descriptions import HEAD, LOG, TABLE
from tests.support.files import ROWS, complaint, file


def test_parquet_with_whole_numbers_and_flags(tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    frame = pl.DataFrame({"t": [0, 1], "on": [True, False], "u": [0.5, None], "why": ["a", "b"]})
    frame.write_parquet(path)
    columns = read_columns(path)
    assert list(columns.numbers("on")) == [1.0, 0.0]
    assert "row 2, column 'u' is empty" in complaint(path, "u")
    assert "row 1, column 'why': 'a' is not a number" in complaint(path, "why")


RECORDS = [
    {"t": 0, "pose": {"q": [1.5, -2]}, "on": True},
    {"t": 0.1, "pose": {"q": [1.25, -3]}, "on": False},
]


@pytest.mark.parametrize(
    ("document", "table"),
    [
        (RECORDS, None),
        ({"rig": "a", "gains": [1, 2, 3], "run": {"entries": RECORDS}}, "run.entries"),
    ],
)
def test_json_records(tmp_path: Path, document: Any, table: str | None) -> None:
    path = file(tmp_path, json.dumps(document), "log.json")
    for named in {None, table}:
        columns = read_columns(path, named)
        assert columns.names == ("t", "pose.q[0]", "pose.q[1]", "on")
        assert list(columns.numbers("pose.q[1]")) == [-2.0, -3.0]
        assert list(columns.numbers("on")) == [1.0, 0.0]


@settings(deadline=None, max_examples=40)
@given(rows=ROWS)
def test_json_lists(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, float]]
) -> None:
    times, values = zip(*rows)
    document = {"rig": "a", "data": {"t": times, "u": values}}
    path = file(tmp_path_factory.getbasetemp(), json.dumps(document), "log.json")
    assert np.array_equal(read_columns(path).numbers("data.u"), values)


MEASURED: dict[str, Any] = {
    "t": np.arange(4.0)[:, None] / 3.0,
    "flag": np.array([[0, 1, 1, 0]], dtype=np.uint8),
    "both": np.arange(8.0).reshape(4, 2),
    "gain": 3.0,
    "who": "a name",
    "run": {"angle": np.array([0.1, 0.2, 0.3, 0.4])},
}


@pytest.mark.parametrize("options", [{}, {"do_compression": True}])
def test_mat_5(tmp_path: Path, options: dict[str, bool]) -> None:
    path = tmp_path / "log.mat"
    scipy.io.savemat(path, MEASURED, **options)
    check_matlab(path)


def test_mat_73(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "log.mat"
    with h5py.File(path, "w", userblock_size=512) as file_:
        for name, value in {**MEASURED, "run/angle": MEASURED["run"]["angle"]}.items():
            if name == "who":
                codes = np.array([[ord(c)] for c in "a name"], dtype=np.uint16)
                file_.create_dataset(name, data=codes).attrs["MATLAB_class"] = np.bytes_("char")
            elif name != "run":
                file_[name] = np.atleast_2d(value).T
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64")
    check_matlab(path)


def check_matlab(path: Path) -> None:
    columns = read_columns(path)
    assert set(columns.names) == {"t", "flag", "both(:,1)", "both(:,2)", "run.angle"}
    assert np.array_equal(columns.numbers("t"), np.arange(4.0) / 3.0)
    assert np.array_equal(columns.numbers("flag"), [0.0, 1.0, 1.0, 0.0])
    assert np.array_equal(columns.numbers("both(:,2)"), [1.0, 3.0, 5.0, 7.0])
    assert np.array_equal(columns.numbers("run.angle"), [0.1, 0.2, 0.3, 0.4])
    assert "did you mean 'flag'" in complaint(path, "flags")


def test_mat_faults(tmp_path: Path) -> None:
    path = tmp_path / "log.mat"
    scipy.io.savemat(path, {"who": "a name", "gain": 1.0})
    assert "no vector" in complaint(path)
    scipy.io.savemat(path, {"wide": np.array([[0.0, 1.0, 2.0], [3.0, np.nan, 5.0]])})
    assert list(read_columns(path).numbers("wide(1,:)")) == [0.0, 1.0, 2.0]
    assert "row 2, column 'wide(2,:)'" in complaint(path, "wide(2,:)")
    for content in (b"junk", b"MATLAB 7.3 MAT-file and then nothing", path.read_bytes()[:200]):
        assert "damaged" in complaint(file(tmp_path, content, "bad.mat"))


def ulog(topics: Mapping[tuple[str, int], Sequence[tuple[int, float, float]]]) -> bytes:
    """A ULog file byte by byte, as its specification says; fields x and y[1] of each topic."""

    def message(kind: bytes, content: bytes) -> bytes:
        return struct.pack("<H", len(content)) + kind + content

    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0), message(b"B", bytes(40))]
    for name in {name for name, _ in topics}:
        parts.append(message(b"F", f"{name}:uint64_t timestamp;float x;float[2] y;".encode()))
    for number, (name, instance) in enumerate(topics):
        parts.append(message(b"A", struct.pack("<BH", instance, number) + name.encode()))
    for number, rows in enumerate(topics.values()):
        for time, x, y in rows:
            parts.append(message(b"D", struct.pack("<HQfff", number, time, x, 0.0, y)))
    return b"".join(parts)


def ends_of_messages(content: bytes) -> list[int]:
    """Where a ULog file may end: behind a size of 2 bytes, a kind, and as many bytes."""
    ends = [16]
    while ends[-1] < len(content):
        ends.append(ends[-1] + 3 + struct.unpack_from("<H", content, ends[-1])[0])
    return ends


def test_ulog(tmp_path: Path) -> None:
    pytest.importorskip("pyulog")
    topics = {
        ("motors", 0): [(1000, 0.5, 1.5), (2000, 0.25, 2.5)],
        ("gyro", 0): [(900, 4.0, 1.0)],
        ("gyro", 1): [(950, 8.0, float("nan"))],
    }
    path = file(tmp_path, ulog(topics), "flight.ulg")
    every = read_columns(path)
    assert list(every.numbers("motors.y[1]")) == [1.5, 2.5]
    motors = read_columns(path, "motors")
    assert motors.names == ("timestamp", "x", "y[0]", "y[1]")
    assert list(motors.numbers("timestamp")) == [1000.0, 2000.0]
    assert list(read_columns(path, "gyro.1").numbers("x")) == [8.0]
    message = complaint(path, "y[1]", table="gyro.1")
    assert "table 'gyro.1', row 1, column 'y[1]': 'nan' is not finite" in message
    assert "did you mean 'motors'" in complaint(path, table="motor")
    whole = path.read_bytes()
    for content in (b"ULog?", whole[:100], whole[:19] + b"\xff" + whole[20:60] + b"?" * 40):
        assert "damaged" in complaint(file(tmp_path, content, "bad.ulg"))
    for kept in range(len(whole) - 60, len(whole)):
        cut = file(tmp_path, whole[:kept], "cut.ulg")
        if kept in ends_of_messages(whole):
            read_columns(cut)
        else:
            assert "cut.ulg' ends within a message: copy it again" in complaint(cut)


def test_mcap_in_json(tmp_path: Path) -> None:
    writer_ = pytest.importorskip("mcap.writer")
    stream = io.BytesIO()
    writer = writer_.Writer(stream)
    writer.start()
    channels = {
        topic: writer.register_channel(topic=topic, message_encoding=encoding, schema_id=0)
        for topic, encoding in (("/drive", "json"), ("/read", "json"), ("/seen", "protobuf"))
    }
    begin = 1_700_000_000_123_456_789
    for i in range(3):
        data = json.dumps({"u": i / 3, "state": {"on": i > 0}}).encode()
        time = begin + 1_000_000 * i
        writer.add_message(channels["/drive"], log_time=time, data=data, publish_time=time + 7)
    writer.add_message(channels["/read"], log_time=begin + 1, data=b'{"x": 1}', publish_time=begin)
    writer.add_message(channels["/seen"], log_time=begin, data=b"\x08\x01", publish_time=begin)
    writer.finish()
    path = file(tmp_path, stream.getvalue(), "run.mcap")
    drive = read_columns(path, "/drive")
    assert drive.names == ("log_time", "publish_time", "u", "state.on")
    assert list(drive.numbers("log_time")) == [0.0, 1e6, 2e6]
    assert list(drive.numbers("publish_time")) == [7.0, 1e6 + 7, 2e6 + 7]
    assert list(drive.numbers("u")) == [0.0, 1 / 3, 2 / 3]
    assert list(drive.numbers("state.on")) == [0.0, 1.0, 1.0]
    assert list(read_columns(path).numbers("/read.log_time")) == [1.0]
    assert "'protobuf'" in complaint(path, table="/seen")
    assert "no table '/drives'" in complaint(path, table="/drives")
    for end in (10, 200):
        assert "damaged" in complaint(file(tmp_path, stream.getvalue()[:end], "bad.mcap"))


ROS_2_SCHEMA = (
    "Stamp stamp\nfloat64[] position\nfloat32[2] gain\nbool on\n"
    + "=" * 80
    + "\nMSG: rig_msgs/Stamp\nint32 sec\nuint32 nanosec"
)


def mcap_of_ros_2() -> bytes:
    ros2 = pytest.importorskip("mcap_ros2.writer")
    stream = io.BytesIO()
    writer = ros2.Writer(stream)
    schema = writer.register_msgdef("rig_msgs/msg/Joint", ROS_2_SCHEMA)
    for i in range(2):
        message = {
            "stamp": {"sec": i, "nanosec": 5},
            "position": [0.1 * i, 1 / 3],
            "gain": [0.5, 2.0],
            "on": True,
        }
        writer.write_message("/joint", schema, message, log_time=1_000 * i, publish_time=0)
    writer.finish()
    return stream.getvalue()


def test_mcap_of_ros_2(tmp_path: Path) -> None:
    columns = read_columns(file(tmp_path, mcap_of_ros_2(), "run.mcap"))
    assert columns.names[2:] == (
        "stamp.sec",
        "stamp.nanosec",
        "position[0]",
        "position[1]",
        "gain[0]",
        "gain[1]",
        "on",
    )
    assert list(columns.numbers("stamp.sec")) == [0.0, 1.0]
    assert list(columns.numbers("position[1]")) == [1 / 3, 1 / 3]
    assert list(columns.numbers("gain[0]")) == [0.5, 0.5]


@pytest.mark.parametrize("every", [13, pytest.param(1, marks=pytest.mark.thorough)])
def test_any_byte_of_a_schema_may_be_off(
    every: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The file is read or refused by its name, and the library prints nothing of its own."""
    whole = mcap_of_ros_2()
    begin = whole.rindex(ROS_2_SCHEMA.encode())
    refused = []
    for place in range(begin - 40, begin + len(ROS_2_SCHEMA), every):  # with its name and encoding
        for byte in (0x00, ord("="), ord("A"), 0xFF):
            bad = file(tmp_path, whole[:place] + bytes([byte]) + whole[place + 1 :], "bad.mcap")
            try:
                read_columns(bad)
            except UserError as error:
                refused.append(str(error))
    assert {*refused} == {f"'{tmp_path / 'bad.mcap'}' is damaged or no MCAP file: write it again"}
    assert len(refused) * every > len(ROS_2_SCHEMA)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("name", "extra", "library"),
    [
        ("log.ulg", "ulog", "pyulog"),
        ("log.mat", "mat73", "h5py"),
        ("log.mcap", "mcap", "mcap.reader"),
    ],
)
def test_a_missing_extra_says_how_to_install_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, extra: str, library: str
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    path = file(tmp_path, b"MATLAB 7.3 MAT-file", name)
    with pytest.raises(UserError, match=rf"pip install 'servo-models\[{extra}\]'"):
        read_columns(path)


def test_a_missing_file_and_another_kind(tmp_path: Path) -> None:
    assert "cannot read" in complaint(tmp_path / "absent.csv")
    assert ".mcap" in complaint(file(tmp_path, "t\n0\n", "log.xlsx"))
    assert "no table 'x'" in complaint(file(tmp_path, "t\n0\n"), table="x")


@pytest.mark.parametrize("mark", [".", ","])
@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("header", [None, "time,s", "# made by hand"])
@settings(deadline=None, max_examples=30)
@given(rows=ROWS)
def test_every_dialect_gives_the_numbers_back(
    tmp_path_factory: pytest.TempPathFactory,
    mark: str,
    separator: str,
    header: str | None,
    rows: list[tuple[float, float]],
) -> None:
    if mark == separator:
        return
    lines = [separator.join(repr(cell).replace(".", mark) for cell in row) for row in rows]
    if header:
        lines.insert(0, header.replace(",", separator))
    columns = read_columns(file(tmp_path_factory.getbasetemp(), "\r\n".join(lines)))
    assert np.array_equal(np.column_stack([columns.numbers(1), columns.numbers(2)]), rows)
    assert columns.names == (("time", "s") if header == "time,s" else ("1", "2"))
    assert columns.first_row == (2 if header else 1)


@pytest.mark.parametrize(
    ("content", "names", "first_row"),
    [
        ("\ufefft,u\n0,1\n", ("t", "u"), 2),
        ('"t [s]";"u, raw"\n"0";"1"\n', ("t [s]", "u, raw"), 2),
        ('t,note,u\n0,"stuck, again",1\n', ("t", "note", "u"), 2),
        ("# rig 3\n\n# 2 supplies\nt,u\n0,1\n", ("t", "u"), 5),
        ("t\n0\n1\n", ("t",), 2),
        ("0;ok;1\n1;ok;2\n", ("1", "2", "3"), 1),
        ("t;ok;7\n1;ok;2\n", ("t", "ok", "7"), 2),
        ("t\tu\n", None, None),
    ],
)
def test_headers_are_found(
    tmp_path: Path, content: str, names: Sequence[str] | None, first_row: int | None
) -> None:
    path = file(tmp_path, content)
    if names is None:
        assert "no rows" in complaint(path)
    else:
        columns = read_columns(path)
        assert (columns.names, columns.first_row) == (names, first_row)


def test_the_header_that_numpy_writes_in_a_comment_is_one(tmp_path: Path) -> None:
    path, values = tmp_path / "log.txt", np.array([[0.0, 1.5], [0.1, 1 / 3]])
    np.savetxt(path, values, delimiter=",", header="t,u", fmt="%.17g")
    columns = read_columns(path)
    assert columns.names == ("t", "u")
    assert np.array_equal(columns.numbers("u"), values[:, 1])


def test_a_header_of_numbers_can_be_told(tmp_path: Path) -> None:
    path = file(tmp_path, "1,2\n5,6\n")
    assert list(read_columns(path).numbers(2)) == [2.0, 6.0]
    assert list(read_columns(path, header=True).numbers("2")) == [6.0]
    assert "row 1, column '1': 't' is not a number" in complaint(
        file(tmp_path, "t,u\n0,1\n"), header=False
    )


def test_only_the_columns_asked_for_need_be_clean(tmp_path: Path) -> None:
    columns = read_columns(file(tmp_path, "t,note,u,gap\n0,start,1,\n1,nan,2,3\n"))
    assert list(columns.numbers("u")) == [1.0, 2.0]
    assert list(columns.numbers("gap", slice(1, None))) == [3.0]


@settings(deadline=None, max_examples=40)
@given(data=st.data(), count=st.integers(2, 20), comments=st.integers(0, 3))
def test_a_bad_cell_is_found_in_the_row_that_an_editor_shows(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, count: int, comments: int
) -> None:
    row = data.draw(st.integers(0, count - 1))
    bad = data.draw(st.sampled_from(["", "volt", "NaN", "1e", "--1", "1_000", "1,2"]))
    lines = ["# a comment"] * comments + ["t;u"] + [f"{i};1,5" for i in range(count)]
    lines[comments + 1 + row] = f"{row};{bad}" if bad != "1,2" else f"{row};1,2,3"
    shown = next(i for i, line in enumerate(lines, start=1) if line.startswith(f"{row};"))
    message = complaint(file(tmp_path_factory.getbasetemp(), "\n".join(lines)), "u")
    assert f"row {shown}, column 'u'" in message


EPISODE = [
    {
        "timestamp": 0.005 * k,
        "observation": {"state": [0.1 * k, 2.0, 3.0, float(k)], "load": {"left": k, "right": -k}},
        "action": [float(k % 3), 0.0],
    }
    for k in range(20)
]
LINES = "\n".join(map(json.dumps, EPISODE)) + "\n"


@pytest.mark.parametrize(
    ("content", "name"),
    [
        (json.dumps(EPISODE), "log.json"),
        (LINES, "log.jsonl"),
        (LINES.replace("\n", "\r\n"), "log.ndjson"),
        ("\N{BYTE ORDER MARK}" + LINES, "log.JSONL"),
        (LINES, "log.json"),
        (json.dumps({"fps": 200, "frames": EPISODE}), "log.json"),
    ],
)
def test_columns_are_dotted_and_items_of_lists_have_their_index(
    tmp_path: Path, content: str, name: str
) -> None:
    columns = read_columns(file(tmp_path, content, name))
    assert columns.names == (
        "timestamp",
        *(f"observation.state[{k}]" for k in range(4)),
        "observation.load.left",
        "observation.load.right",
        "action[0]",
        "action[1]",
    )
    for written in ("observation.state[3]", "observation.state.3"):
        assert list(columns.numbers(written)) == [float(k) for k in range(20)]
    assert list(columns.numbers("observation.load.right")) == [-float(k) for k in range(20)]


def test_a_description_names_them_either_way(tmp_path: Path) -> None:
    (tmp_path / "log.jsonl").write_text(LINES)
    path = tmp_path / "rig.toml"
    nested = LOG.replace("log.csv", "log.jsonl").replace('"time_ms", unit = "ms"', '"timestamp"')
    nested = nested.replace('"u"', '"action.0"').replace("angle_deg", "observation.state[0]")
    path.write_text(HEAD + nested)
    (log,) = read_description(path).logs
    assert list(log.inputs["voltage"]) == [u for _, u, _ in TABLE]
    assert np.rad2deg(log.outputs["angle"]) == pytest.approx([angle for *_, angle in TABLE])


@pytest.mark.parametrize("dotted", ["q.1", "q[1]"])
def test_a_name_that_stands_there_comes_first(tmp_path: Path, dotted: str) -> None:
    records = [{"q.1": 1.0, "q": [5.0, 6.0]}]
    columns = read_columns(file(tmp_path, json.dumps(records), "log.json"))
    assert list(columns.numbers(dotted)) == [{"q.1": 1.0, "q[1]": 6.0}[dotted]]


def test_lists_of_lists_are_columns_too(tmp_path: Path) -> None:
    document: dict[str, Any] = {"t": [0, 1, 2], "joints": {"q": [[1, 2], [3, 4], None]}}
    columns = read_columns(file(tmp_path, json.dumps(document), "log.json"))
    assert columns.names == ("t", "joints.q[0]", "joints.q[1]")
    assert list(columns.numbers("joints.q.1", slice(0, 2))) == [2.0, 4.0]
    rows = file(tmp_path, "[0, 1.5]\n[1, 2.5]\n", "rows.jsonl")
    assert list(read_columns(rows).numbers("[1]")) == [1.5, 2.5]


JSON = st.recursive(
    st.none() | st.booleans() | st.floats(allow_nan=False) | st.text(max_size=3),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3)
    ),
    max_leaves=6,
)


@pytest.mark.thorough
@settings(deadline=None, max_examples=60)
@given(st.lists(st.dictionaries(st.text(min_size=1, max_size=3), JSON, min_size=1), min_size=1))
def test_lines_are_read_as_a_list_of_the_same_records(
    tmp_path_factory: pytest.TempPathFactory, records: list[dict[str, Any]]
) -> None:
    folder = tmp_path_factory.getbasetemp()
    whole = file(folder, json.dumps(records), "whole.json")
    lines = file(folder, "\n".join(map(json.dumps, records)), "lines.jsonl")
    try:
        expected = read_columns(whole)
    except Exception as error:
        with pytest.raises(type(error)):
            read_columns(lines)
        return
    found = read_columns(lines)
    assert found.names == expected.names
    assert all(a.equals(b, null_equal=True) for a, b in zip(found.cells, expected.cells))


FAULTS: dict[str, list[tuple[str | bytes, str | int, list[str]]]] = {
    "log.csv": [
        ("", 1, ["is empty"]),
        ("# only words\n", 1, ["is empty"]),
        ("t,u\n0,1\n\n1,2\n", 1, ["row 3 is empty"]),
        ("t,u\n0,1\n1\n", 1, ["row 3 has 1 cells, the header 2"]),
        ("0;1\n1;2;3\n", 1, ["row 2 has 3 cells, the first row 2"]),
        ("t,u\n0,\n", "u", ["row 2, column 'u' is empty"]),
        ("#a\nt;u\n0;1\n0;1,2,3\n", "u", ["row 4, column 'u'", "'1,2,3' is not a number"]),
        ("t,u\n0,inf\n", "u", ["row 2, column 'u'", "'inf' is not finite"]),
        ("0,1\n1,NaN\n", 2, ["row 2, column '2'", "not finite"]),
        ("time,volt\n0,1\n", "volts", ["no column 'volts'", "did you mean 'volt'"]),
        ("t,u\n0,1\n", 3, ["no column 3", "1 to 2"]),
        ("t,u\n0,1\n", 0, ["no column 0"]),
        ("t,u,u\n0,1,2\n", "u", ["two columns 'u'", "number"]),
        (b"t,u\n0,1\n1,\xb0\n", 1, ["row 3", "0xb0", "UTF-8"]),
    ],
    "log.json": [
        ('[{"t": 0},\n {"t": }]', "t", ["row 2: no JSON"]),
        ('{"rig": "a"}', "t", ["no records"]),
        ("[]", 1, ["no rows"]),
        ('[{"t": 0, "u": 1}, {"t": 1}]', "u", ["row 2, column 'u' is empty"]),
        ('[{"t": 0}, {"t": "late"}]', "t", ["row 2, column 't': 'late' is not a number"]),
        ('[{"t": 0}, {"t": NaN}]', "t", ["row 2, column 't': 'nan' is not finite"]),
        ('[{"t": 1%s}]' % ("0" * 400), "t", ["row 1, column 't': 'inf' is not finite"]),
        (b"\xff\xfe\x00", "t", ["damaged"]),
    ],
    "log.jsonl": [
        ('{"t": 0}\n{"t": }\n', "t", ["row 2: no JSON"]),
        ('{"t": 0}\n\n{"t": 1}\n', "t", ["row 2 is empty"]),
        ('{"t": 0}\n{"t": "late"}\n', "t", ["row 2, column 't': 'late' is not a number"]),
        ('{"t": 0}\n{"u": 1}\n', "t", ["row 2, column 't' is empty"]),
        ("", 1, ["no rows"]),
        ("1\n2\n", 1, ["row 1: no record"]),
        ("[" * 100_000, "t", ["nested too deeply"]),
    ],
}
"""What stands in a file, the column that is read, and the words that tell the fault."""


@pytest.mark.parametrize(
    ("name", "content", "column", "said"),
    [(name, *fault) for name, faults in FAULTS.items() for fault in faults],
)
def test_a_fault_of_a_file_is_named(
    tmp_path: Path, name: str, content: str | bytes, column: str | int, said: list[str]
) -> None:
    message = complaint(file(tmp_path, content, name), column)
    for words in said:
        assert words in message
