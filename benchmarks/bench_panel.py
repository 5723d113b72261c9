"""From a slider to the painted curve in Chromium: milliseconds, by rows of the log and actuator.

Run: ``python -m benchmarks.bench_panel``; it needs Chromium and playwright (extra ``test``).
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, sync_playwright

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.files import scratch
from servo_models.identification.live import live_logs
from servo_models.report.html import page as html
from servo_models.report.live import Live
from servo_models.report.result import Report
from servo_models.report.sections import Section
from tests.support.logs import log_of

CASES = [(name, rows) for rows in (4_000, 20_000) for name in ("sg90", "smart_servo")]
STEP = 5e-3  # s
MOVES = 80
MOVED = """
async (moves) => {
    const { panel } = document.querySelector(".live");
    const range = panel.controls.querySelector("input[type=range]"), spent = [];
    const painted = () => new Promise((done) => requestAnimationFrame(() => {
        const { port1, port2 } = new MessageChannel();
        port1.onmessage = done;
        port2.postMessage(0);
    }));
    for (let k = 0; k < moves; k++) {
        const begin = performance.now();
        range.value = 100 + (800 * (k % 40)) / 40;
        range.dispatchEvent(new Event("input"));
        await painted();
        spent.push(performance.now() - begin);
        await new Promise((done) => setTimeout(done, 20));
    }
    return spent;
}
"""
FIRST = "performance.getEntriesByName('first-contentful-paint')[0].startTime"


def report(name: str, rows: int) -> str:
    """A page with a panel of three curves: measured, nominal, simulated."""
    chosen = model(name)
    times = STEP * np.arange(rows)
    main, output = chosen.plant.inputs[0], chosen.plant.outputs[0]
    size = 0.4 * np.sign(np.sin(2.0 * times)) * np.abs(np.sin(0.37 * times))
    inputs = {main.name: float(main.rest) + main.scale * size}
    floor = 3e-3 * chosen.plant.wire[output].scale
    noise = floor * np.random.default_rng(1).standard_normal(rows)
    log = log_of(times, inputs, {output: simulate(chosen, times, inputs)[output] + noise})
    first, *_ = list(chosen.values)[1:]
    sets = {"fitted": {first: 1.1 * chosen.values[first]}}
    models = live_logs(chosen, [log], sets, {}, {first}, {output: floor})
    section = Section("Measured", live=Live("Measured", "Move it.", models))
    return html(Report("A log", "A sentence", None, sections=(section,)))


def timed(page: Page, name: str, rows: int, folder: Path) -> str:
    path = folder / "page.html"
    path.write_text(report(name, rows), encoding="utf-8")
    page.goto(path.as_uri())
    page.wait_for_timeout(2500)
    spent, first = np.array(page.evaluate(MOVED, MOVES)), page.evaluate(FIRST)
    figures = f"{np.median(spent):9.1f}{spent.max():9.1f}{first:13.0f}"
    return f"{name:14}{rows:8}{figures}{path.stat().st_size / 1e6:9.2f}"


def main() -> None:
    """Print a row a case."""
    print(f"{'actuator':14}{'rows':>8}{'median':>9}{'worst':>9}{'first paint':>13}{'MB':>9}")
    with sync_playwright() as driver, scratch() as folder:
        browser = driver.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        for name, rows in CASES:
            page = browser.new_page(viewport={"width": 1280, "height": 1000})
            print(timed(page, name, rows, folder), flush=True)
            page.close()
        browser.close()


if __name__ == "__main__":
    main()

# Result: two cores without a GPU, Chromium 156; milliseconds from the event to the frame after it.
#
# actuator          rows   median    worst  first paint       MB
# sg90              4000     17.6     38.4          108     0.25
# smart_servo       4000     19.3     38.4          104     0.25
# sg90             20000     37.3     55.4          124     0.54
# smart_servo      20000     37.8     61.6          100     0.51
