"""The panel of a report in a real browser: it shows what Python computes, and asks nobody."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from servo_models.analysis.live import live_model
from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.js_text import js_model
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.log import Channel, Log, Start
from servo_models.identification.live import live_logs
from servo_models.identification.simulation import prepared
from servo_models.report.live import Live, LiveModel, scripts
from tests.support.browser import chromium, opened, ready, written
from tests.support.logs import measured

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

SERVO = model("sg90")
TRUTH = {"backlash.half_width": 0.02, "motor_time_constant": 0.05}
SETS = {"re-tuned": {"motor_time_constant": 0.047}, "diagnosed": TRUTH}
TIMES = np.arange(0.0, 4.0, 0.01)
PULSES = {"pulse_width": 1.5e-3 + 3e-4 * np.sign(np.sin(4.0 * TIMES)) * np.sin(0.7 * TIMES)}
NOISE = 2e-3
PANEL = "document.querySelector('.live').panel"
HOSTILE = "</script><img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as found:
        yield found


def recorded(**more: Any) -> Log:
    rig = replace(SERVO, values={**SERVO.values, **TRUTH})
    return measured(rig, TIMES, PULSES, {"angle": NOISE}, **more)


def panel_of(log: Log, chosen: Model = SERVO) -> tuple[LiveModel, ...]:
    return live_logs(
        chosen, [log], SETS, {"motor_time_constant": 1e-3}, {"backlash"}, {"angle": NOISE}
    )


def shown(page: Page) -> Array:
    """The curve that is drawn, in SI."""
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => setTimeout(done)))")
    return np.array(page.evaluate(f"Array.from({PANEL}.now)"))


def computed(log: Log, values: Mapping[str, float]) -> Array:
    return prepared(SERVO, log).outputs(values)[:, 0]


def click(page: Page, button: str) -> None:
    page.get_by_role("button", name=button, exact=True).click()


BEGINNINGS = {
    "at rest": {},
    "settled": {"settle": 0.5},
    "in motion": {"start": Start({"angle": 0.1, "rate": 0.5}, {}, False)},
    "fitted": {
        "settle": 0.3,
        "start": Start({"angle": 0.0, "rate": 0.0}, {"pulse_width": 1.5e-3}, True),
    },
    "read after its command": {"channels": {"angle": Channel("angle", "", "", after_command=3e-3)}},
    "with a constant": {"constants": {"load_torque": 0.01, "motor_gain": 40.0}},
}


@pytest.mark.thorough
@pytest.mark.parametrize("how", BEGINNINGS)
def test_each_set_is_what_python_computes(browser: Browser, tmp_path: Path, how: str) -> None:
    log = recorded(**BEGINNINGS[how])
    with opened(browser, written(tmp_path / "page.html", panel_of(log))) as page:
        for name, values in {"nominal": {}, **SETS}.items():
            click(page, name)
            np.testing.assert_allclose(shown(page), computed(log, values), rtol=0, atol=1e-12)


def test_a_slider_moves_the_curve_to_what_python_computes(browser: Browser, tmp_path: Path) -> None:
    log = recorded()
    with opened(browser, written(tmp_path / "page.html", panel_of(log), "what if")) as page:
        assert page.locator(".live-badge").text_content() == "diagnosed"
        page.get_by_role("slider", name="half width").fill("700")
        values = page.evaluate(f"Array.from({PANEL}.values)")
        moved = dict(zip(SERVO.values, values))
        assert moved["backlash.half_width"] != TRUTH["backlash.half_width"]
        now = shown(page)
        np.testing.assert_allclose(now, computed(log, moved), rtol=0, atol=1e-12)
        assert page.locator(".live-badge").text_content() == "what if"
        error = float(np.degrees(np.sqrt(np.mean((now - log.outputs["angle"]) ** 2))))
        said = re.search(
            r"error ([\d.e-]+) deg RMS", page.locator(".live-score").text_content() or ""
        )
        assert said
        assert float(said[1]) == pytest.approx(error, rel=5e-3)


@pytest.mark.thorough
def test_a_typed_value_and_a_switch_do_the_same(browser: Browser, tmp_path: Path) -> None:
    log = recorded()
    with opened(browser, written(tmp_path / "page.html", panel_of(log))) as page:
        typed = page.get_by_role("spinbutton", name="half width")
        typed.fill("3")  # deg
        typed.press("Enter")
        wide = {**TRUTH, "backlash.half_width": np.radians(3.0)}
        np.testing.assert_allclose(shown(page), computed(log, wide), rtol=0, atol=1e-9)
        page.get_by_role("checkbox", name="backlash").first.uncheck()
        without = {**TRUTH, "backlash.half_width": 0.0}
        np.testing.assert_allclose(shown(page), computed(log, without), rtol=0, atol=1e-12)


@pytest.mark.thorough
def test_the_score_is_that_of_what_is_shown(browser: Browser, tmp_path: Path) -> None:
    log = recorded()
    with opened(browser, written(tmp_path / "page.html", panel_of(log))) as page:
        before = page.locator(".live-score").text_content()
        box = page.locator(".live-chart .u-over").first.bounding_box()
        assert box
        page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 20)
        page.mouse.down()
        page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 20, steps=4)
        page.mouse.up()
        shown(page)
        low, high = page.evaluate(f"[{PANEL}.above.scales.x.min, {PANEL}.above.scales.x.max]")
        assert 0.5 < low < 1.5 < high < 2.5
        within = (low <= TIMES) & (high >= TIMES)
        errors = (computed(log, TRUTH) - log.outputs["angle"])[within]
        after = page.locator(".live-score").text_content() or ""
        assert after != before
        assert "in what is shown" in after
        said = re.search(r"error ([\d.e-]+) deg RMS", after)
        assert said
        assert float(said[1]) == pytest.approx(
            float(np.degrees(np.sqrt(np.mean(errors**2)))), rel=5e-3
        )
        click(page, "whole log")
        shown(page)
        assert page.locator(".live-score").text_content() == before


def test_nothing_is_wider_than_a_phone(browser: Browser, tmp_path: Path) -> None:
    with opened(browser, written(tmp_path / "page.html", panel_of(recorded())), 390, 800) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        for part in page.locator(".live button, .live input, .live select").all():
            box = part.bounding_box()
            assert box is None or box["x"] + box["width"] <= 390


@pytest.mark.thorough
def test_hostile_names_are_text(browser: Browser, tmp_path: Path) -> None:
    """They come from logs and files of others; a script of theirs would ask, fail or write."""
    (found,) = panel_of(recorded(name=HOSTILE))
    path = written(tmp_path / "page.html", (replace(found, name=HOSTILE), found), HOSTILE)
    with opened(browser, path) as page:
        assert page.locator("img").count() == 0
        page.get_by_role("slider").first.fill("300")
        shown(page)
        assert page.locator(".live-badge").text_content() == HOSTILE
        assert HOSTILE in page.locator("select").first.locator("option").all_text_contents()


def test_a_script_that_is_not_ours_does_not_run(browser: Browser, tmp_path: Path) -> None:
    path = written(tmp_path / "page.html", panel_of(recorded()))
    text = path.read_text("utf-8").replace(
        "</main>", "</main><script>globalThis.came = 1;</script>"
    )
    path.write_text(text, encoding="utf-8")
    page = browser.new_page()
    page.goto(path.as_uri())
    ready(page)
    assert page.evaluate("globalThis.came") is None
    page.close()


@pytest.mark.thorough
def test_a_model_without_a_log_is_driven(browser: Browser, tmp_path: Path) -> None:
    chosen = model("torque_motor")
    with opened(browser, written(tmp_path / "page.html", (live_model(chosen),))) as page:
        name, size = chosen.actuator.step
        stamps = np.array(page.evaluate(f"Array.from({PANEL}.run.times)"))
        steps = np.where(
            stamps >= 0.05 * chosen.stop_time, size, float(chosen.plant.wire[name].rest)
        )
        expected = simulate(chosen, stamps, {name: steps})[chosen.plant.outputs[0]]
        np.testing.assert_allclose(shown(page), expected, rtol=0, atol=1e-15)


@pytest.mark.thorough
def test_values_that_cannot_be_simulated_are_said(browser: Browser, tmp_path: Path) -> None:
    with opened(browser, written(tmp_path / "page.html", panel_of(recorded()))) as page:
        page.evaluate(
            f"{PANEL}.values[{PANEL}.model.place.get('motor_gain')] = NaN, {PANEL}.update()"
        )
        shown(page)
        assert "cannot be simulated" in (page.locator(".live-score").text_content() or "")


def test_a_set_that_cannot_be_simulated_leaves_the_page_whole() -> None:
    """Values that a fit found on other logs; no start can be fitted with them on this one."""
    log = recorded(**BEGINNINGS["fitted"])
    away = {"internal_step": SERVO.values["internal_step"], "motor_gain": math.nan}
    (found,) = live_logs(SERVO, [log], {"away": away}, {}, set(), {})
    (run,) = found.runs
    assert {value for _, value in run.placed[1]} == {0.0}  # as stated


def test_variants_of_the_same_equations_share_a_script() -> None:
    """With its own figures put in, it is the program of each."""
    models = [model("dc_motor", variant) for variant in ("direct", "geared")]
    panel = Live("", "", tuple(live_model(it) for it in models))
    (script,) = (it for it in scripts((panel,)) if "servoModels" in it[:20000] and "advance" in it)
    heading, body = re.fullmatch(r"for .* of (.*?)\) \(globalThis.* = (.*);", script, re.S).groups()  # type: ignore[union-attr]
    for place, figures in json.loads(heading):
        whole = re.sub(r"figures\[(\d+)\]", lambda m: repr(figures[int(m[1])]), body)  # noqa: B023
        assert bare(whole) == bare(js_model(models[place].flat))


def bare(program: str) -> str:
    """A program but for names of variables, blanks and where a list of variables is cut."""
    named = re.sub(r"\bv_\w+|\$\d+", "V", program)
    return re.sub(r"\s", "", named).replace(";letV=0", ",V=0")
