"""The page of ``explore`` in a real browser, from a CSV that is dropped to files that are saved."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from servo_models.catalogue import model
from servo_models.data.description import read_description
from servo_models.data.parameters import read_parameters
from servo_models.errors import UserError
from servo_models.identification.live import explored
from servo_models.identification.simulation import prepared
from servo_models.report.html import page as html
from tests.conftest import Run
from tests.support.browser import chromium, opened
from tests.support.sources import ROOT

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

PANEL = "document.querySelector('.live').panel"
LOG = ROOT / "examples" / "two_csv_files" / "steps.csv"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as found:
        yield found


@pytest.fixture(scope="module")
def servo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "explore.html"
    path.write_text(html(explored("sg90")), encoding="utf-8")
    return path


def drop(page: Page, path: Path) -> str:
    """Choose a file; what the page complains of."""
    page.locator("input[type=file]").set_input_files(path)
    page.wait_for_timeout(300)
    return page.locator(".live-alert").text_content() or ""


def choose(page: Page, signal: str, column: str, unit: str) -> None:
    page.get_by_label(f"column of {signal}", exact=True).select_option(label=column)
    page.get_by_label(f"unit of {signal}", exact=True).select_option(label=unit)


def saved(page: Page, button: str, folder: Path) -> Path:
    with page.expect_download() as found:
        page.get_by_role("button", name=button).click()
    path = folder / found.value.suggested_filename
    found.value.save_as(path)
    return path


def test_a_dropped_csv_becomes_a_description_and_parameters(
    browser: Browser, servo: Path, tmp_path: Path
) -> None:
    (tmp_path / "steps.csv").write_bytes(LOG.read_bytes())
    with opened(browser, servo) as page:
        assert drop(page, tmp_path / "steps.csv") == ""
        choose(page, "time", "time_ms", "ms")
        choose(page, "pulse_width", "pulse_us", "us")
        choose(page, "angle", "angle_deg", "deg")
        page.get_by_role("button", name="show", exact=True).click()
        page.wait_for_timeout(300)
        described = read_description(saved(page, "save steps.toml", tmp_path))
        (log,) = described.logs
        measured = np.array(page.evaluate(f"Array.from({PANEL}.measured)"))
        np.testing.assert_allclose(measured, log.outputs["angle"], rtol=1e-12)
        page.get_by_role("spinbutton", name="time").first.fill("15")
        page.get_by_role("spinbutton", name="time").first.press("Enter")
        page.wait_for_timeout(200)
        now = np.array(page.evaluate(f"Array.from({PANEL}.now)"))
        moved = read_parameters(saved(page, "save parameters", tmp_path))
    assert [(it.name, it.value) for it in moved.estimates] == [("transport_delay.time", 0.015)]
    settled = replace(log, settle=model("sg90").stop_time, start=None)
    run = prepared(moved.model(), settled)
    np.testing.assert_allclose(now, run.outputs({})[:, 0], rtol=0, atol=1e-9)


BAD = {
    "empty": (b"", "fewer than two rows"),
    "words": (b"a,b\nc,d\ne,f\ng,h\n", "no two columns of numbers"),
    "a picture": (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\n\0\0", "text"),
    "a million columns": (b"\n".join([b",".join([b"1"] * 1_000_000)] * 3), "1000000 columns"),
}


@pytest.mark.thorough
@pytest.mark.parametrize("kind", BAD)
def test_what_is_no_log_gets_one_sentence(
    browser: Browser, servo: Path, tmp_path: Path, kind: str
) -> None:
    content, said = BAD[kind]
    (tmp_path / "bad.csv").write_bytes(content)
    with opened(browser, servo) as page:
        assert said in drop(page, tmp_path / "bad.csv")


@pytest.mark.thorough
def test_a_file_of_a_gigabyte_is_not_read(browser: Browser, servo: Path, tmp_path: Path) -> None:
    with (tmp_path / "huge.csv").open("wb") as file:
        file.truncate(10**9)
    with opened(browser, servo) as page:
        assert re.search("1000 MB.*cut it", drop(page, tmp_path / "huge.csv"))


@pytest.mark.thorough
def test_columns_without_names_commas_and_a_time_that_does_not_rise(
    browser: Browser, servo: Path, tmp_path: Path
) -> None:
    rows = [(0.01 * k, 1500 + 300 * (k > 20), 0.5 * k) for k in range(60)]
    text = "\n".join(";".join(f"{it:.4f}".replace(".", ",") for it in row) for row in rows)
    (tmp_path / "german.csv").write_text(text)
    with opened(browser, servo) as page:
        assert drop(page, tmp_path / "german.csv") == ""
        choose(page, "pulse_width", "column 2", "us")
        choose(page, "angle", "column 3", "deg")
        click = page.get_by_role("button", name="show", exact=True).click
        click()
        assert "choose the column of the time" in (page.locator(".live-alert").text_content() or "")
        choose(page, "time", "column 2", "s")
        click()
        assert "does not rise in row 2 ('column 2')" in (
            page.locator(".live-alert").text_content() or ""
        )
        choose(page, "time", "column 1", "s")
        click()
        page.wait_for_timeout(300)
        times = np.array(page.evaluate(f"Array.from({PANEL}.run.times)"))
        np.testing.assert_allclose(times, [row[0] for row in rows], atol=1e-12)


@pytest.mark.thorough
def test_hostile_columns_are_text(browser: Browser, servo: Path, tmp_path: Path) -> None:
    name = "<img src=x onerror=alert(1)>"
    rows = "\n".join(f"{k},{k},{k}" for k in range(9))
    (tmp_path / "bad.csv").write_text(f"{name},b,c\n{rows}\n")
    with opened(browser, servo) as page:
        assert drop(page, tmp_path / "bad.csv") == ""
        assert name in page.get_by_label("column of time").locator("option").all_text_contents()
        assert page.locator("img").count() == 0


def test_a_log_comes_with_what_is_guessed_of_it() -> None:
    (panel,) = explored(str(LOG)).panels
    (run,) = panel.models[0].runs
    assert panel.models[0].actuator == "sg90"
    assert set(run.measured) == {"angle"}
    assert "guessed" in panel.description[1]


@pytest.mark.parametrize(
    ("what", "said"), [("sg91", "unknown"), ("nothing.toml", "nothing.toml"), ("no.csv", "no.csv")]
)
def test_a_wrong_name_is_one_sentence(what: str, said: str) -> None:
    with pytest.raises(UserError, match=said):
        explored(what)


def test_the_command_writes_a_page(run: Run, tmp_path: Path) -> None:
    code, out, _ = run("explore", "backlash", "--no-show", "--out", tmp_path / "it.html")
    assert code == 0
    assert "it.html" in out
    assert (tmp_path / "it.html").read_text("utf-8").startswith("<!DOCTYPE html>")
    code, _, err = run("explore", "backlash", "--no-show", "--out", tmp_path / "it.txt")
    assert (code, ".html" in err) == (2, True)
