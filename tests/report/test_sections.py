"""One model of a report, and what its renderers make of it."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from servo_models.report import html
from servo_models.report.numbers import Quantity, number, percent, plain
from servo_models.report.result import Report, Result, data_sheet, document_of, report_of
from servo_models.report.sections import Card, Mark, Picture, Section, Table
from tests.support.html_page import Page

TABLE = Table(
    "Errors",
    ("output", "before", "after", "size", "judgement"),
    (
        ("position", Quantity(1.25, "deg"), Quantity(0.5, "deg", interval=(0.4, 0.6)), 3, ""),
        ("<b>", Quantity(-2e-6, "deg"), None, Quantity(0.1234, "A", 0.0021), Mark("good", True)),
    ),
)


def drawn(axes: Sequence[Axes]) -> None:
    axes[0].plot([0.0, 1.0], [0.0, 2.0])


REPORT = Report(
    "A motor",
    "Backlash explains the gap",
    True,
    cards=(Card("cause", "backlash\n0.5 deg", None, "Evidence"),),
    remarks=("Mind <the> gap.",),
    sections=(
        Section(
            "Evidence", "How it is read.", tables=(TABLE,), pictures=(Picture("A line", drawn),)
        ),
        Section("Empty", "Nothing to see."),
        Section("Origin", facts=(("log", "a.csv"),), folded=True),
    ),
)


class Kept(Result):
    pass


report_of.register(Kept, lambda kept, date="": REPORT)
document_of.register(Kept, lambda kept: {"size": math.inf})


def test_numbers_in_print_are_the_numbers() -> None:
    for value in (0.0, 1.0, -1.5, 1234.0, 99_999.0, 2.5e-7, -3.25e12, 0.001):
        assert math.isclose(float(plain(number(value, 6))), value, rel_tol=1e-5)
    assert number(None) == number(math.nan)


def test_a_quantity_has_the_digits_that_its_error_allows() -> None:
    assert plain(str(Quantity(0.123456, "A", 0.0021))) == "0.1235 +- 0.0021 A"
    assert plain(str(Quantity(3.0, "1"))) == "3"
    assert plain(Quantity(1.0, "deg", interval=(0.5, 2.0)).bare) == "1 (0.5 to 2)"


def test_shares_near_none_and_all_say_so() -> None:
    assert [percent(it) for it in (0.0, 0.001, 0.5, 0.999, 1.0)] == [
        "0 %",
        "< 1 %",
        "50 %",
        "> 99 %",
        "100 %",
    ]


def test_a_unit_that_a_column_shares_is_in_its_heading() -> None:
    assert TABLE.headings == ("output", "before [deg]", "after [deg]", "size", "judgement")
    assert TABLE.texts[0][1] == "1.25"
    assert TABLE.texts[1][3].endswith(" A")


def test_a_table_becomes_a_frame_of_numbers() -> None:
    frame = TABLE.frame()
    assert frame["before [deg]"].to_list() == [1.25, -2e-6]
    assert frame["after [deg] low"].to_list()[0] == 0.4
    assert frame["size unit"].to_list() == ["1", "A"]
    assert frame["size standard error"].to_list() == [None, 0.0021]
    assert frame["judgement"].to_list() == ["", "good"]


def test_a_terminal_has_the_answer_first_in_ascii() -> None:
    said = str(REPORT)
    words = ("A motor", "Backlash", "cause", "Mind", "Errors", "position")
    order = [said.index(it) for it in words]
    assert order == sorted(order)
    assert said.isascii()
    assert "-2e-06" in said or "-2e-6" in said
    assert "Empty" not in said
    assert "a.csv" not in said


def test_a_page_escapes_texts_and_folds_details() -> None:
    text = html.page(REPORT)
    page = Page(text)
    assert "&lt;b&gt;" in text
    assert "Mind &lt;the&gt; gap." in text
    assert '<div id="origin">' in text.partition('<details class="section">')[2]
    assert 'href="#evidence"' in text
    assert "Empty" not in text
    page.assert_stands_alone()
    assert html.page(REPORT) == text


def test_nothing_on_a_page_is_out_of_its_flow() -> None:
    """Headings that were hidden that way made a page of tables wider than a phone."""
    assert not re.search(r"position:\s*(absolute|fixed)", html.page(REPORT))


def test_no_line_of_a_page_ends_inside_an_option() -> None:
    card = Card("do next", "<b>: servo-models build --params A.toml --no-x --")
    text = html.page(replace(REPORT, cards=(card,)))
    assert "&lt;b&gt;: servo-models build " in text
    assert re.findall(r'<span class="option">(.*?)</span>', text) == ["--params", "--no-x"]
    assert re.search(r"\.option {[^}]*white-space: nowrap", text)


def test_a_result_shows_itself() -> None:
    kept = Kept()
    assert repr(kept) == "<Kept of A motor: Backlash explains the gap>"
    assert "<svg" in kept._repr_html_()
    assert "var(--" not in kept._repr_html_()
    assert '"size": null' in kept.to_json()
    assert list(kept.tables()) == ["Errors"]
    assert isinstance(kept.tables()["Errors"], pl.DataFrame)


def test_a_data_sheet_shows_itself_with_all_it_says() -> None:
    texts = ["Acts on <b>.\n\n    return 0.0"]
    sheet = data_sheet("backlash", texts, [replace(TABLE, title=name) for name in ("one", "two")])
    assert repr(sheet) == "<Report of backlash>"
    shown = sheet._repr_html_()
    Page(shown)
    assert shown.count("<caption>") == 2
    assert "Acts on &lt;b&gt;.\n\n    return 0.0" in shown
    assert repr(REPORT) == "<Report of A motor: Backlash explains the gap>"
    assert REPORT._repr_html_() == Kept()._repr_html_()
    assert "the gap." not in REPORT._repr_html_()


def test_a_result_draws_on_axes_of_the_user() -> None:
    axes = Figure().subplots()
    assert Kept().plot(axes) is axes
    assert list(axes.lines[0].get_ydata()) == [0.0, 2.0]
    assert Kept().plot().lines


def test_a_result_is_written_whole(tmp_path: Path) -> None:
    Kept().write_report(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text("utf-8") == html.page(REPORT)


def test_hostile_headings_stay_text_in_the_style_of_a_page() -> None:
    heading = '"} </style><script>alert(1)</script> \\'
    table = Table("A table", ("a", heading, "c", "d"), (("1", "2", "3", "4"),))
    text = html.page(replace(REPORT, sections=(Section("Of headings", tables=(table,)),)))
    Page(text).assert_stands_alone()
    assert "<script>" not in text
    style = text.partition("<style>")[2].partition("</style>")[0]
    assert r'--label: "\"} \3c /style>' in style
