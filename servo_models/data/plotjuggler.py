"""Signals for PlotJuggler: an MCAP file, and a layout that opens it with every signal in its place.

PlotJuggler reads messages in JSON of a channel that has a schema, and names a series by topic and
key.  A layout names the files it shows, with the settings of their reader, so that it opens both.
Source: PlotJuggler 3, ``dataload_mcap.cpp``, ``nlohmann_parsers.cpp``, ``plot_docker.cpp`` and
``MainWindow::loadLayoutFromFile``; MCAP specification, well-known encodings.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import msgspec

from servo_models.core.types import Array
from servo_models.errors import extra
from servo_models.report.style import colour

LIBRARY = "mcap.writer"
LAYOUT = ".xml"
NS_PER_SECOND = 1e9
READER = "DataLoad MCAP"
READ = {"use_timestamp": 0, "use_mcap_log_time": 1, "clamp_large_arrays": 1, "max_array_size": 500}
COLOURS = ("muted", "orange", "green", "blue", "purple")


@dataclass(frozen=True, eq=False)
class Topic:
    """Signals of one clock.

    Attributes:
        name: name of the topic, without a semicolon, which separates topics in a layout.
        unit: unit of all signals, "" for none.
        times: [s], shape (n,), not below 0.
        above: signals by name, each of shape (n,), that are drawn together.
        below: the same that are drawn below them.
    """

    name: str
    unit: str
    times: Array
    above: Mapping[str, Array]
    below: Mapping[str, Array]


def write_mcap(path: Path, topics: Sequence[Topic]) -> None:
    """Write signals as messages in JSON, one a sample of a topic.

    Raises:
        UserError: the library is not installed.

    Example:
        ``write_mcap(Path("run.mcap"), [Topic("run/angle", "deg", times, {"measured": y}, {})])``
    """
    library = extra("mcap", LIBRARY)
    with path.open("wb") as file:
        writer = library.Writer(file)
        writer.start(library="servo-models")
        for topic in topics:
            signals = {**topic.above, **topic.below}
            schema = {
                "type": "object",
                "properties": {
                    name: {"type": "number", "description": topic.unit} for name in signals
                },
            }
            number = writer.register_schema(topic.name, "jsonschema", msgspec.json.encode(schema))
            about = {"unit": topic.unit}
            channel = writer.register_channel(topic.name, "json", number, about)
            rows = zip(*(values.tolist() for values in signals.values()))
            for time, row in zip(topic.times.tolist(), rows):
                stamp = round(NS_PER_SECOND * time)
                data = msgspec.json.encode(dict(zip(signals, row)))
                writer.add_message(channel, stamp, data, stamp)
        writer.finish()


def write_layout(path: Path, mcap: str, topics: Sequence[Topic]) -> None:
    """Write a layout for the MCAP file of that name in the same folder, a tab a topic."""
    root = ElementTree.Element("root")
    window = _child(root, "tabbed_widget", name="Main Window", parent="main_window")
    for topic in topics:
        tab = _child(window, "Tab", tab_name=topic.name, containers=1)
        container = _child(tab, "Container")
        split = _child(container, "DockSplitter", orientation="-", count=2, sizes="0.6;0.4")
        unit = f" [{topic.unit}]" if topic.unit else ""
        tints = itertools.cycle(COLOURS)
        for signals in (topic.above, topic.below):
            area = _child(split, "DockArea", name=f"{', '.join(signals)}{unit}")
            plot = _child(area, "plot", mode="TimeSeries", style="Lines")
            for name in signals:
                _child(plot, "curve", name=f"{topic.name}/{name}", color=colour(next(tints)))
    _child(window, "currentTabIndex", index=0)
    _child(root, "use_relative_time_offset", enabled=0)
    files = _child(root, "previouslyLoaded_Datafiles")
    plugin = _child(_child(files, "fileInfo", filename=mcap, prefix=""), "plugin", ID=READER)
    _child(plugin, "parameters", selected_topics=";".join(it.name for it in topics), **READ)
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, "UTF-8", xml_declaration=True)


def _child(parent: ElementTree.Element, tag: str, /, **attributes: object) -> ElementTree.Element:
    return ElementTree.SubElement(parent, tag, {k: str(v) for k, v in attributes.items()})
