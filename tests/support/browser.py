"""The Chromium of the system, driven by playwright; tests are skipped where there is none."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from servo_models.report.html import page
from servo_models.report.live import Live, LiveModel
from servo_models.report.result import Report
from servo_models.report.sections import Section

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

NAMES = ("chromium", "chromium-browser", "google-chrome")


@contextmanager
def chromium() -> Iterator[Browser]:
    """Give a browser without a window."""
    path = next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        pytest.skip(f"none of {', '.join(NAMES)} is installed")
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as driver:
        # a container has no user namespaces for its sandbox
        browser = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


def written(path: Path, models: tuple[LiveModel, ...], other: str = "what if") -> Path:
    """Write a report with nothing but a panel."""
    live = Live("Measured and simulated", "Move a parameter.", models, other)
    report = Report("A rig", "A sentence", None, sections=(Section("Measured", live=live),))
    path.write_text(page(report), encoding="utf-8")
    return path


@contextmanager
def opened(browser: Browser, path: Path, width: int = 1280, height: int = 1000) -> Iterator[Page]:
    """Give a page that has drawn its panel; nothing it does may fail, ask or be asked for."""
    wrong: list[str] = []
    note: Callable[[object], None] = lambda it: wrong.append(str(it))  # noqa: E731
    shown = browser.new_page(viewport={"width": width, "height": height})
    shown.on("pageerror", note)
    shown.on("dialog", note)
    shown.on("console", lambda it: wrong.append(it.text))
    shown.on("request", lambda it: it.url.startswith("file:") or wrong.append(it.url))
    shown.goto(path.as_uri())
    ready(shown)
    yield shown
    shown.close()
    assert not wrong


def ready(page: Page) -> None:
    """Wait until the panel is drawn; the page allows no text to be evaluated, so it is asked."""
    for _ in range(200):
        if page.evaluate("document.querySelector('.live')?.panel?.now?.length > 1"):
            return
        page.wait_for_timeout(50)
    raise AssertionError("the panel was not drawn within 10 s")
