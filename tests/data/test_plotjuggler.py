"""Files for PlotJuggler, as the library of the format and an XML parser read them."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from xml.etree import ElementTree

import jsonschema
import numpy as np
import pytest
from mcap.reader import make_reader

from servo_models.data.plotjuggler import Topic, write_layout, write_mcap
from servo_models.errors import UserError

TIMES = 0.01 * np.arange(50) + 3.0
ANGLE = Topic(
    "run 1/angle",
    "deg",
    TIMES,
    {"measured": np.sin(TIMES), "with effect": np.cos(TIMES)},
    {"left": np.cos(TIMES) - np.sin(TIMES)},
)
FLAG = Topic("run 2/<flag>", "", TIMES[:3], {"measured": np.array([0.0, 1.0, 1e300])}, {})
TOPICS = [ANGLE, FLAG]


def test_every_sample_is_a_message_in_json_that_keeps_to_its_schema(tmp_path: Path) -> None:
    write_mcap(tmp_path / "run.mcap", TOPICS)
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        found = list(reader.iter_messages())
    assert summary
    assert {it.message_encoding for it in summary.channels.values()} == {"json"}
    assert {it.encoding for it in summary.schemas.values()} == {"jsonschema"}
    for topic in TOPICS:
        mine = [it for it in found if it[1].topic == topic.name]
        rows = [json.loads(message.data) for _, _, message in mine]
        for (schema, channel, message), row in zip(mine, rows):
            assert schema
            jsonschema.validate(row, json.loads(schema.data))
            assert channel.metadata == {"unit": topic.unit}
            assert message.log_time == message.publish_time
        stamps = np.array([message.log_time for _, _, message in mine])
        np.testing.assert_allclose(1e-9 * stamps, topic.times, rtol=0.0, atol=1e-9)
        signals = {**topic.above, **topic.below}
        assert rows == [dict(zip(signals, row)) for row in zip(*signals.values())]


def test_a_layout_opens_its_file_and_has_every_series_in_its_place(tmp_path: Path) -> None:
    write_layout(tmp_path / "run.xml", "run.mcap", TOPICS)
    root = ElementTree.parse(tmp_path / "run.xml").getroot()
    assert root.tag == "root"
    (window,) = root.findall("tabbed_widget")
    assert window.attrib == {"name": "Main Window", "parent": "main_window"}
    for tab, topic in zip(window.findall("Tab"), TOPICS, strict=True):
        (split,) = tab.findall("Container/DockSplitter")
        areas = split.findall("DockArea")
        shares = [float(size) for size in split.attrib["sizes"].split(";")]
        assert split.attrib["orientation"] == "-"  # one below the other
        assert len(areas) == len(shares) == int(split.attrib["count"])
        assert sum(shares) == pytest.approx(1.0)
        drawn = [[it.attrib["name"] for it in area.findall("plot/curve")] for area in areas]
        both = (topic.above, topic.below)
        assert drawn == [[f"{topic.name}/{name}" for name in signals] for signals in both]
        assert [plot.attrib["mode"] for plot in split.iter("plot")] == ["TimeSeries"] * 2
    (file,) = root.findall("previouslyLoaded_Datafiles/fileInfo")
    (plugin,) = file.findall("plugin")
    (settings,) = plugin.findall("parameters")
    assert (file.attrib["filename"], plugin.attrib["ID"]) == ("run.mcap", "DataLoad MCAP")
    assert settings.attrib["selected_topics"].split(";") == [topic.name for topic in TOPICS]


def test_a_library_that_is_missing_is_named_with_its_cure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    with pytest.raises(UserError, match=r"'mcap' is not installed: pip install .*\[mcap\]"):
        write_mcap(tmp_path / "run.mcap", TOPICS)
    assert not (tmp_path / "run.mcap").exists()
