"""The report of an identification: it says what was found, and stands alone."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from matplotlib.figure import Figure
from msgspec import structs
from scipy.signal import lfilter

from servo_models.analysis.figures import figures
from servo_models.analysis.linearise import linearise
from servo_models.analysis.simulate import simulate
from servo_models.analysis.sine_test import hold
from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.data.log import Channel, Log
from servo_models.data.parameters import read_parameters
from servo_models.identification.fit import fit
from servo_models.identification.identify import Outcome, identify
from servo_models.identification.measured_response import Record, empirical
from servo_models.identification.result import HELD_OUT, Identification
from servo_models.identification.sections import beside, identification_report, with_figures
from servo_models.report import html
from servo_models.report.curves import envelope
from servo_models.report.numbers import MINUS, TIMES
from servo_models.report.result import Report
from servo_models.units import factor
from tests.support.html_page import Page, unpictured
from tests.support.logs import changed, measured

STEP = 2e-4
SPAN = 1.0
TRUE = model("torque_motor", "identified", {"end_stops.half_range": 0.0})
NOMINAL = changed(TRUE, {"torque_constant": 6.0, "inductance": 27.0})
FREE = ("torque_constant", "inductance", "transport_delay.time")
DESCRIPTION = """
actuator = "torque_motor"
variant = "identified"
free = ["torque_constant"]
[parameters]
torque_constant = 5.0
end_stops.half_range = 0.0
[[logs]]
file = "bench.csv"
time = { column = "t", unit = "s" }
inputs.voltage = { column = "u", unit = "V" }
outputs.angle = { column = "angle", unit = "deg" }
held_out = { from = "0.6 s", to = "1 s" }
"""
HOSTILE = "<script>alert('x')</script> $x_"
RAISED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def _log(name: str, voltage: Callable[[Array], Array], held_out: Callable[[Array], Array]) -> Log:
    times = np.arange(round(SPAN / STEP)) * STEP
    return measured(
        TRUE,
        times,
        {"voltage": voltage(times)},
        {"angle": np.radians(0.02)},
        len(name),
        name=name,
        path=Path("bench") / f"{name}.csv",
        sha256=name.encode().hex().ljust(64, "0"),
        channels={"angle": Channel("angle", "angle_deg", "deg", math.radians(1.0))},
        held_out=held_out(times),
    )


def _chirp(times: Array) -> Array:
    return 15.0 * np.sin(2.0 * np.pi * (2.0 + 150.0 * times / SPAN) * times)


def _steps(times: Array) -> Array:
    return 10.0 * np.sign(np.sin(2.0 * np.pi * 5.0 * times + 0.1))


@pytest.fixture(scope="module")
def found() -> Identification:
    logs = [
        _log("sweep", _chirp, lambda t: np.zeros(len(t), dtype=bool)),
        _log("steps", _steps, lambda t: t > 0.6),
    ]
    return fit(NOMINAL, logs, FREE, {"torque_constant": 1.5})


@pytest.fixture(scope="module")
def text(found: Identification) -> str:
    return _page(found)


def _report(found: Identification) -> Report:
    report = identification_report(found, {"angle": math.radians(0.02)})
    return replace(report, date="2026-01-31")


def _page(found: Identification) -> str:
    return html.page(_report(found))


def _words(found: Identification) -> str:
    return html.page(unpictured(_report(found)))


def _number(text: str) -> float:
    """Read a number as the report prints it."""
    plain = text.replace(MINUS, "-").replace(f"{TIMES}10", "e").translate(RAISED)
    return float(plain)


def _held_out_rms(found: Identification, responses: list[dict[str, Array]]) -> float:
    """Pooled RMS [deg] from the arrays themselves."""
    errors = [
        np.degrees(response["angle"] - log.outputs["angle"])[log.held_out]
        for response, log in zip(responses, found.logs)
    ]
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


def test_page_is_whole_and_stands_alone(text: str) -> None:
    page = Page(text)
    page.assert_stands_alone()
    assert page.count("svg") == page.count("figcaption") == 1 + 2 + 2 + 1 + 1
    assert page.count("table") == page.count("caption") == 2
    assert "2026-01-31" in page.text


@pytest.mark.thorough
def test_same_arguments_give_the_same_bytes(found: Identification, text: str) -> None:
    assert _page(found) == text


def test_every_estimate_is_in_the_table_in_its_display_unit(
    found: Identification, text: str
) -> None:
    rows = {row[0]: row for row in Page(text).rows if len(row) == 6}
    for free, value, error in zip(found.free, found.values, found.standard_errors):
        _, nominal, prior, estimate, _, _ = rows[free.name]
        shown, _, spread, unit = estimate.split()
        scale = factor(unit, found.fitted.plant.parameters[free.name].param.unit)
        assert _number(shown) * scale == pytest.approx(value, abs=0.1 * error)
        assert _number(spread) * scale == pytest.approx(error, rel=0.05)
        assert _number(nominal.split()[0]) * scale == pytest.approx(free.nominal, rel=1e-3)
        assert (prior == "") == (free.prior is None)
        assert any(f"{free.name}: {estimate}" in piece for piece in Page(text).text)  # a card
    assert rows["transport_delay.time"][3].endswith(" ms")
    assert _number(rows["torque_constant"][2].split()[0]) == 1.5


def test_verdict_is_the_held_out_error_before_and_after(found: Identification, text: str) -> None:
    sentence = re.search(r"<h1>.*?</h1>", text, flags=re.S)
    assert sentence
    shown = re.search(r"angle (\S+) → (\S+) deg RMS", sentence[0])
    assert shown
    before, after = map(_number, shown.groups())
    assert before == pytest.approx(_held_out_rms(found, list(found.before)), rel=1e-3)
    assert after == pytest.approx(_held_out_rms(found, list(found.after)), rel=1e-3)
    assert after == pytest.approx(np.degrees(found.rms("angle", HELD_OUT)), rel=1e-3)
    assert "noise floor 0.02 deg" in text


def test_logs_and_their_hashes_are_named(found: Identification, text: str) -> None:
    for log in found.logs:
        assert log.path.name in text
        assert log.sha256 in text
    assert found.method in text


def test_what_is_doubtful_is_flagged_and_warned_of(found: Identification) -> None:
    doubtful = replace(
        found,
        values=np.array([found.free[0].low, *found.values[1:]]),
        standard_errors=np.array([np.nan, np.inf, found.values[2]]),
        warnings=["'inductance' is <b>doubtful</b>; fix it"],
    )
    page = Page(_words(doubtful))
    verdicts = {row[0]: row[4] for row in page.rows if len(row) == 6}
    assert "low bound" in verdicts["torque_constant"]
    assert "not determined" in verdicts["inductance"]
    assert "not determined" in verdicts["transport_delay.time"]
    assert "Warning: 'inductance' is <b>doubtful</b>; fix it." in page.text
    assert page.count("b") == 0
    assert "Read the warnings below before using the values." in page.text
    assert any("3 of 3 doubtful" in piece for piece in page.text)


@pytest.mark.thorough
def test_a_fit_without_held_out_data_says_so(found: Identification) -> None:
    logs = [replace(log, held_out=np.zeros(len(log.times), dtype=bool)) for log in found.logs]
    rows = [structs.replace(row, part="fit") for row in found.accuracy]
    text = _page(replace(found, logs=logs, accuracy=rows))
    assert "nothing held out" in text
    assert "no samples of angle were, so the error on new data is unknown" in text


@pytest.mark.thorough
def test_a_model_that_got_worse_fails(found: Identification) -> None:
    worse = [
        structs.replace(row, before=row.after, after=2.0 * row.after) for row in found.accuracy
    ]
    assert '<header class="pass">' in _words(replace(found, warnings=[]))
    assert '<header class="fail">' in _words(replace(found, accuracy=worse, warnings=[]))


@pytest.mark.thorough
def test_hostile_names_stay_text(found: Identification) -> None:
    channel = Channel("angle", "1", HOSTILE, 1.0)
    first = replace(found.logs[0], name=HOSTILE, channels={"angle": channel})
    rows = [structs.replace(row, log=HOSTILE) for row in found.accuracy[:1]]
    page = Page(
        _page(replace(found, logs=[first, found.logs[1]], accuracy=[*rows, *found.accuracy[1:]]))
    )
    page.assert_stands_alone()
    assert any(HOSTILE in piece for piece in page.text)


@pytest.mark.long
def test_long_logs_make_no_large_page(found: Identification) -> None:
    """Ten logs of 30 000 samples, noise throughout, which no drawing can simplify."""
    random = np.random.default_rng(5)
    n, count = 30_000, 10
    first = found.logs[0]
    logs = [
        replace(
            first,
            name=f"log {i}",
            times=np.arange(n) * 1e-3,
            inputs={"voltage": random.standard_normal(n)},
            outputs={"angle": random.standard_normal(n)},
            held_out=np.arange(n) % 6_000 > 4_000,
        )
        for i in range(count)
    ]
    responses = [{"angle": random.standard_normal(n)} for _ in range(count)]
    rows = [structs.replace(found.accuracy[0], log=log.name) for log in logs]
    long = replace(found, logs=logs, before=responses, after=responses, accuracy=rows)
    text = _page(long)
    assert len(text.encode()) < 2_000_000
    assert "2 more are in the table" in text
    assert "No measured response of angle over voltage" in text


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """A log of a motor in steps, rounded to 0.01 deg: the floor is 0.01 deg / sqrt(12)."""
    folder = tmp_path_factory.mktemp("bench")
    log = _log("bench", _steps, lambda t: t > 0.6)
    clean = simulate(TRUE, log.times, log.inputs)["angle"]
    rounded = np.round(np.degrees(clean), 2)
    rows = zip(log.times, log.inputs["voltage"], rounded)
    lines = "\n".join(f"{t:.4f},{u:g},{y:.2f}" for t, u, y in rows)
    (folder / "bench.csv").write_text(f"t,u,angle\n{lines}\n", encoding="utf-8")
    (folder / "bench.toml").write_text(DESCRIPTION, encoding="utf-8")
    return identify(folder / "bench.toml")


def _written(outcome: Outcome, folder: Path) -> Page:
    outcome.write_report(folder / "fit.html", "2026-01-31")
    return Page((folder / "fit.html").read_text("utf-8"))


def test_identify_puts_floors_figures_and_versions_on_its_page(
    outcome: Outcome, tmp_path: Path
) -> None:
    page = _written(outcome, tmp_path)
    text = " ".join(page.text)
    floor = re.search(r"noise floor (\S+) deg", text)
    assert floor
    assert _number(floor[1]) == pytest.approx(0.01 / math.sqrt(12.0), rel=0.1)
    assert {"2026-01-31", "Python", "numba", "scipy", "Figures of merit"} <= set(page.text)
    bandwidth = next(row for row in page.rows if row[0] == "bandwidth (-3 dB)")
    hertz = np.array([float(bandwidth[1].split()[0])])
    gain = np.abs(linearise(TRUE).response(hertz, "voltage", "angle"))
    static = np.abs(linearise(TRUE).response(np.array([1e-4]), "voltage", "angle"))
    assert gain / static == pytest.approx(math.sqrt(0.5), rel=0.02)


def test_a_model_without_figures_of_merit_says_why(found: Identification) -> None:
    """Beyond its bounds the standard step cannot be simulated."""
    broken = changed(found.fitted, {"stiffness": math.nan})
    report = with_figures(identification_report(found), broken)
    (section,) = (section for section in report.sections if section.title == "Figures of merit")
    assert section.items[0].startswith("None of the fitted model: ")


def test_an_identification_offers_what_every_result_does(outcome: Outcome, tmp_path: Path) -> None:
    assert repr(outcome).startswith("<Outcome of Identification of torque_motor")
    table = outcome.tables()["Estimated parameters"]
    found = outcome.result
    assert table["estimate [N.m/A]"].to_list() == pytest.approx(found.values.tolist())
    errors = table["estimate [N.m/A] standard error"].to_list()
    assert errors == pytest.approx(found.standard_errors.tolist())
    document = json.loads(outcome.to_json())
    assert document["parameter_set"]["parameters"]["torque_constant"]["value"] == found.values[0]
    axes = Figure().subplots()
    assert outcome.plot(axes) is axes
    measured = next(line for line in axes.lines if line.get_label() == "measured")
    highest = np.degrees(found.logs[0].outputs["angle"].max())
    assert np.max(measured.get_ydata()) == pytest.approx(highest)
    assert "deg RMS" in outcome._repr_html_()
    outcome.write_parameters(tmp_path / "fit.toml")
    assert read_parameters(tmp_path / "fit.toml").settings()["torque_constant"] == found.values[0]


def test_a_warning_is_about_the_values_of_its_variant() -> None:
    """Values found by identification are not those that the warning is about."""
    printed = model("sg90", "linear")
    fitted = replace(printed, provenance="this identification")
    assert any("slower than a real SG90" in text for text in figures(printed).report().remarks)
    assert not any("slower" in text for text in figures(fitted).report().remarks)


def test_two_ways_to_the_response_of_the_fitted_model_agree(found: Identification) -> None:
    """Cross spectra of its simulated sweep against its state space; both end in one picture."""
    log = found.logs[0]
    response = np.asarray(found.after[0]["angle"])
    seen = empirical([Record(log.times, log.inputs["voltage"], response, response)], STEP)
    assert seen is not None
    inside = (seen.hertz > 20.0) & (seen.hertz < 140.0)
    line = linearise(found.fitted).response(seen.hertz, "voltage", "angle")
    line = line * hold(2.0 * np.pi * seen.hertz, STEP)
    assert inside.sum() >= 5
    assert np.abs(seen.measured / line - 1.0)[inside].max() < 0.1


def test_measured_frequency_response_of_a_known_filter() -> None:
    """y[k] = a y[k-1] + (1 - a) u[k-1] + noise; its response is known exactly."""
    random = np.random.default_rng(2)
    n, step, a = 40_000, 1e-3, 0.8
    given = random.standard_normal(n)
    clean = lfilter([0.0, 1.0 - a], [1.0, -a], given)
    record = Record(np.arange(n) * step, given, clean + 0.05 * random.standard_normal(n), clean)
    seen = empirical([record], step)
    assert seen is not None
    z = np.exp(2j * np.pi * seen.hertz * step)
    exact = (1.0 - a) / (z - a)
    assert len(seen.hertz) > 10
    assert np.abs(seen.simulated / exact - 1.0).max() < 0.1
    assert np.abs(seen.measured / exact - 1.0).max() < 0.4  # 20 % of noise in 9 windows
    assert np.median(np.abs(seen.measured / exact - 1.0)) < 0.1


def test_noise_has_no_frequency_response() -> None:
    random = np.random.default_rng(3)
    times = np.arange(5_000) * 1e-2
    points = 0
    for _ in range(20):
        seen = empirical([Record(times, *random.standard_normal((3, 5_000)))], 1e-2)
        points += 0 if seen is None else len(seen.hertz)
    assert points <= 4  # of some 20 x 500 frequencies, each by chance in 1 of 100 000


def test_records_of_other_steps_are_pooled_and_short_ones_left_out() -> None:
    random = np.random.default_rng(4)
    slow, fast = np.arange(8_000) * 2e-2, np.arange(16_000) * 1e-2
    u, v = np.repeat(random.standard_normal(2_000), 4), np.repeat(random.standard_normal(2_000), 8)
    pair = [Record(slow, u, 2.0 * u, 2.0 * u), Record(fast, v, 2.0 * v, 2.0 * v)]
    seen = empirical([*pair, Record(slow[:50], u[:50], -u[:50], u[:50])], 2e-2)
    assert seen is not None
    low = seen.hertz < 2.0
    assert np.abs(seen.measured[low] - 2.0).max() < 0.05
    assert empirical([Record(slow[:100], u[:100], u[:100], u[:100])], 2e-2) is None


def test_hold_is_the_fundamental_of_a_staircase() -> None:
    fine, points, step = 200, 16, 1e-2
    hertz = 1.0 / (points * step)
    sine = np.exp(2j * np.pi * np.arange(points) / points)
    stairs = np.repeat(sine, fine)
    phase = np.exp(-2j * np.pi * (np.arange(points * fine) + 0.5) / (points * fine))
    assert hold(np.array([2.0 * np.pi * hertz]), step)[0] == pytest.approx(
        np.mean(stairs * phase), abs=1e-4
    )


@given(st.floats(-1e3, 1e3), st.floats(-math.pi, math.pi))
def test_a_phase_stays_within_half_a_turn_of_its_reference(reference: float, angle: float) -> None:
    shown = float(beside(np.array([reference]), np.array([np.exp(1j * angle)]))[0])
    assert abs(shown - reference) <= 180.0 + 1e-6
    assert math.cos(math.radians(shown) - angle) == pytest.approx(1.0, abs=1e-9)


@given(arrays(float, st.integers(2, 3_000), elements=st.floats(-1e6, 1e6)), st.integers(2, 200))
def test_a_decimated_curve_keeps_extremes_ends_and_order(values: Array, buckets: int) -> None:
    times = np.arange(len(values), dtype=float)
    kept_times, kept = envelope(times, values, buckets)
    assert len(kept) <= 2 * buckets + 2
    assert np.all(np.diff(kept_times) > 0.0)
    assert np.array_equal(values[kept_times.astype(int)], kept)
    assert (kept.min(), kept.max()) == (values.min(), values.max())
    assert (kept_times[0], kept_times[-1]) == (times[0], times[-1])
