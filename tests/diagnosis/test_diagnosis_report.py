"""The report of a diagnosis: it says what was found, and stands alone.

The rig is the torque motor with a delay; figures that are looked for on the page are worked
out here, from the rig or from the arrays of the diagnosis.
"""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure
from mcap.reader import make_reader

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.data.description import Description
from servo_models.data.log import Channel
from servo_models.data.schema import Section
from servo_models.diagnosis import summary
from servo_models.diagnosis.calibration import MOST_PROBABILITY, calibrated
from servo_models.diagnosis.confirm import Confirmation
from servo_models.diagnosis.diagnose import diagnose
from servo_models.diagnosis.ranking import NOTHING_ERRORS, probabilities, ranked_effects
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.sections.tables import intervals
from servo_models.diagnosis.stretches import HeldOut, UnseenOutput
from servo_models.diagnosis.verdict import (
    EFFECT,
    EFFECTS,
    NO_GAP,
    NOT_IDENTIFIABLE,
    OUTSIDE,
    PARAMETERS,
)
from servo_models.identification.resolution import Blur
from servo_models.identification.result import Accuracy
from servo_models.identification.simulation import prepared
from servo_models.report import html
from servo_models.report.curves import draw_legend
from servo_models.report.numbers import ERROR, MINUS, prefix
from servo_models.report.style import drawing
from tests.support.html_page import Page, unpictured
from tests.support.logs import measured
from tests.support.schemas import check_schema

STEP = 2.5e-4
DELAY = 1.1e-3
NOISE = math.radians(0.02)
DEGREE = math.radians(1.0)
FIXED = {"end_stops.half_range": 0.0}
COLUMNS = ("effect", "on", "why", "moves outputs", "what it is")
HOSTILE = "<script>alert('x')</script> $x_"
NUMBER = r"(\d[\d.]*)"


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    """A torque constant that is 10 % larger, and a delay of 1.1 ms."""
    nominal = model("torque_motor", "measured", FIXED)
    constant = 1.1 * nominal.values["torque_constant"]
    rig = model(
        "torque_motor",
        "measured",
        {**FIXED, "torque_constant": constant, "transport_delay.time": DELAY},
    )
    voltage = _voltage()
    n = len(voltage)
    times = np.arange(n, dtype=np.float64) * STEP
    log = measured(
        rig,
        times,
        {"voltage": voltage},
        {"angle": NOISE},
        seed=4,
        name="bench",
        path=Path("bench.csv"),
        sha256="0123456789abcdef" * 4,
        channels={"angle": Channel("angle", "angle_deg", "deg", DEGREE)},
    )
    relative = nominal.actuator.variant("measured").uncertainty
    known = {name: abs(part * nominal.values[name]) for name, part in relative.items()}
    path = Path("bench.toml")
    return diagnose(Description(path, Section(path, "", {}), nominal, {}, known, (log,)), jobs=1)


def _voltage() -> Array:
    """Steps of several sizes, then a slow triangle and a sweep."""
    steps = np.repeat([0.0, 10.0, 0.0, -20.0, 0.0, 28.0, -28.0, 0.0], 100)
    t = STEP * np.arange(600)
    triangle = 15.0 * np.interp(t / t[-1], [0.0, 0.25, 0.75, 1.0], [0.0, 1.0, -1.0, 0.0])
    sweep = 15.0 * np.sin(2.0 * np.pi * (5.0 * t + 500.0 * t**2))
    return np.concatenate([steps, triangle, sweep])


@pytest.fixture(scope="module")
def unsure(found: Diagnosis) -> Diagnosis:
    """As if the two best effects could not be told apart."""
    rivals = tuple(found.selection.of_size(1)[:2])
    members = tuple(name for one in rivals for name in one.effects)
    ranking = tuple(replace(one, in_set=one.name in members) for one in found.ranking)
    verdict = replace(found.verdict, kind=EFFECT, members=members, rivals=rivals)
    return replace(found, verdict=verdict, ranking=ranking)


@pytest.fixture(scope="module")
def text(found: Diagnosis) -> str:
    return _page(found)


@pytest.mark.parametrize(
    ("blur", "said"),
    [
        (("voltage", "row", 1e-3), "commands that changed between rows"),
        (("voltage", "step", 0.02), "the steps of 0.02 V of 'voltage'"),
        (("time", "stamp", 3e-3), "rows that are stamped late, in log '{log}' by up to 3 ms"),
    ],
)
@pytest.mark.parametrize("share", [0.2, 0.5, 3.0])
def test_what_a_column_may_be_blamed_for_is_said_with_its_figure(
    found: Diagnosis, blur: tuple[str, str, float], said: str, share: float
) -> None:
    """From a quarter of what is left on, in one form on the screen, in JSON and in the report."""
    (log,), left = found.logs, found.gap.rms["after"]
    moves = {output: share * left for output in log.outputs}
    blamed = replace(found, blurs=(Blur(log.name, *blur, moves),))
    text = f"f {left:.3g} noise floors left, up to {min(share, 1.0) * left:.2g} may come from "
    text += said.format(log=log.name)
    for page in (str(blamed), blamed.document()["sentence"], _page(blamed).replace("&#39;", "'")):
        assert (text in " ".join(page.split())) == (share > 0.25)


def _page(found: Diagnosis) -> str:
    return html.page(found.report("2026-01-31"))


def _words(found: Diagnosis) -> str:
    return html.page(unpictured(found.report("2026-01-31")))


def _cells(page: Page, first: str) -> list[list[str]]:
    """Rows that begin with a cell."""
    return [row for row in page.rows if row[0] == first]


def _number(text: str) -> float:
    return float(text.replace(MINUS, "-"))


def _quantity(text: str) -> tuple[float, float, str]:
    value, error, unit = text.replace(ERROR, " ").split()
    return _number(value), _number(error), unit


def _heading(text: str) -> str:
    heading = re.search(r"<h1>(.*?)</h1>", text, flags=re.S)
    assert heading
    return re.sub(r"<.*?>", "", heading[1])


def test_page_is_whole_and_stands_alone(found: Diagnosis, text: str) -> None:
    page = Page(text)
    page.assert_stands_alone()
    assert page.count("svg") == page.count("figcaption")
    assert "2026-01-31" in page.text
    assert len(text.encode()) < 1_500_000
    assert page.count("figure") == page.count("figcaption")
    sections = (
        "measured-and-simulated",
        "errors",
        "where-it-lies",
        "effects",
        "ruled-out",
        "parameters",
        "provenance",
    )
    assert [name for name in page.values("id") if name in sections] == list(sections)


def test_the_answer_is_told_before_anything_else(found: Diagnosis, text: str) -> None:
    """Cause with its size, what was, what is left, what to do: above the first picture."""
    page = Page(f"{text.partition('</header>')[0]}</header></body></html>")
    top = " ".join("".join(page.text).split())
    for said in ("transport_delay on 'voltage'", "before", "left"):
        assert said in top
    (size,) = re.findall(rf"acts {NUMBER} {ERROR} {NUMBER} ms late", top)
    assert float(size[0]) == pytest.approx(1e3 * DELAY, abs=4.0 * float(size[1]))
    assert "--out PARAMS.toml" in top
    details = text.index('<details class="section">')
    assert text.count("<section") == 1 < text.count("<svg", 0, details)
    assert "<section" not in text[details:]


def test_the_terminal_tells_what_the_page_tells(found: Diagnosis, text: str) -> None:
    said, page = str(found), Page(text)
    for title in found.tables():
        assert title in " ".join(page.text)
    for row in found.report().tables[0].texts:
        assert row[0] in said
    assert repr(found).startswith("<Diagnosis of bench: effect, transport_delay, ")


def test_a_diagnosis_is_drawn_on_axes_of_the_user(found: Diagnosis) -> None:
    axes = Figure().subplots()
    assert found.plot(axes) is axes
    measured = np.degrees(found.logs[0].outputs["angle"])
    drawn = next(line for line in axes.lines if line.get_label() == "measured")
    assert np.isclose(np.max(drawn.get_ydata()), measured.max())


def test_tables_are_frames_of_numbers(found: Diagnosis) -> None:
    frame = found.tables()["Gap, RMS on blocks that a fit left out"]
    assert frame["before [deg]"].to_list() == [np.degrees(found.gaps[0].rms["before"])]
    effects = found.tables()["Effects, most likely first"]
    assert effects["effect"].to_list() == [effect.name for effect in found.ranking]


def test_fitted_models_stand_with_those_of_as_many_effects(found: Diagnosis) -> None:
    one, *others = found.selection.of_size(1)[:3]
    first, second, third = (it.effects[0] for it in (one, *others))
    further = [replace(one, effects=(first, second)), replace(one, effects=(first, second, third))]
    tried = [*found.selection.tried, *further]
    tables = replace(found, selection=replace(found.selection, tried=tried)).tables()
    assert tables["Pairs of effects"]["effects"].to_list() == [f"{first} and {second}"]
    more = tables["More effects together"]["effects"].to_list()
    assert more == [f"{first}, {second} and {third}"]


def test_verdict_names_the_effect(text: str) -> None:
    assert _heading(text).startswith("transport_delay on")
    assert "explains the gap" in _heading(text)


def test_gap_is_that_of_the_arrays(found: Diagnosis, text: str) -> None:
    """Nominal error from a simulation of the model itself; the rest from held-out errors."""
    log = found.logs[0]
    nominal = simulate(found.model, log.times, log.inputs)["angle"]
    wanted = [
        np.degrees(np.sqrt(np.mean((nominal - log.outputs["angle"]) ** 2))),
        *(
            np.degrees(found.floors["angle"]) * np.sqrt(np.mean(one.evidence.unseen**2))
            for one in (found.selection.retuned, found.selection.taken)
        ),
    ]
    page = Page(text)
    row = next(row for row in _cells(page, "angle") if " to " in row[1])
    assert "before [deg]" in page.rows[page.rows.index(row) - 1]
    for cell, value, stage in zip(row[1:], wanted, ("before", "retuned", "after")):
        shown = re.fullmatch(rf"{NUMBER} \({NUMBER} to {NUMBER}\)", cell)
        assert shown
        error, low, high = map(float, shown.groups())
        assert error == pytest.approx(value, rel=6e-3)
        assert low <= error <= high
        assert low * DEGREE == pytest.approx(found.gaps[0].intervals[stage][0], rel=6e-3)
    assert float(row[4]) == pytest.approx(0.02, rel=0.1)  # the noise that was added


def test_every_dimension_that_divides_the_gap_has_one_picture(found: Diagnosis, text: str) -> None:
    """A single output makes one part of its kind: a table tells that, and no picture."""
    pictured = Counter(re.findall(r"<figcaption><strong>By (.*?)\.</strong>", text))
    tabled = Counter(re.findall(r"<caption>By (.*?)</caption>", text))
    parts = {one.dimension: len(one.bins) for one in found.localisation}
    assert parts["signal"] == 1
    assert pictured == Counter(name for name, count in parts.items() if count > 1)
    assert tabled == Counter(parts.keys())
    assert {"time", "frequency", "speed", "position"} <= pictured.keys()
    drawn = re.findall(r'<svg[^>]* aria-label="By (.*?)"', text)
    assert Counter(drawn) == pictured


def test_a_whole_is_100_percent(found: Diagnosis, text: str) -> None:
    """To two digits, all of it would be a power of ten."""
    (table,) = (t for t in found.report().tables if t.title == "By signal")
    assert table.texts[0][1] == "100"
    assert table.headings[1] == "share before [%]"
    assert not re.search("\u00d710[^ ]* %", text)


def test_what_is_left_and_no_noise_is_told(found: Diagnosis) -> None:
    left = replace(found, verdict=replace(found.verdict, kind="effect", rest=27.3))
    assert "27.3 noise floors of what is left are no noise" in _words(left)


def test_every_effect_is_on_the_page_once_named_or_ruled_out(found: Diagnosis, text: str) -> None:
    page = Page(text)
    wire = {name: found.model.plant.main_wire(name) for name in found.selection.detectability}
    reasons = summary.ruled_out(found)
    for name in found.selection.detectability:
        rows = [
            row for row in _cells(page, name) if len(row) == len(COLUMNS) and row[1] == wire[name]
        ]
        assert [row[2] for row in rows] == ([reasons[name]] if name in reasons else [])
    named = {*found.verdict.members, *found.selection.taken.effects}
    assert named | set(reasons) == set(found.selection.detectability)


@pytest.mark.thorough
def test_the_set_is_marked_in_the_evidence(unsure: Diagnosis) -> None:
    page = Page(_words(unsure))
    marked = {row[0] for row in page.rows if "in the set" in row}
    assert len(marked) == 2
    assert marked == set(unsure.verdict.members)
    assert "cannot be told apart from" in _heading(page.source)


def test_model_weights_are_shown_for_the_kind_of_explanation_that_was_taken(
    found: Diagnosis, text: str
) -> None:
    """Among pairs of which none was taken they would mean nothing."""
    rows = {row[0]: row[2] for row in Page(text).rows if row[-1] == "converged"}
    alone = [one.effects[0] for one in found.selection.of_size(1) if one.converged]
    assert sum(float(rows[name]) for name in alone) == pytest.approx(1.0, abs=0.01 * len(alone))
    assert all(not weight for name, weight in rows.items() if " and " in name)


def test_outside_the_catalogue_effects_are_ranked_and_no_probability_is_told(
    found: Diagnosis,
) -> None:
    verdict = replace(found.verdict, kind=OUTSIDE)
    outside = replace(found, verdict=verdict, ranking=ranked_effects(found.selection, verdict, {}))
    told = json.loads(outside.to_json())
    check_schema(told)
    assert found.document()["effects"][0]["probability"] > 0.9
    assert all(one["probability"] is None for one in told["effects"])
    assert told["effects"][0]["model_weight"] > 0.9
    page = _words(outside)
    ranks = "effects none of which explains all"
    assert all(ranks in text for text in (told["sentence"], page, str(outside)))
    (title,) = (name for name in outside.tables() if name.startswith("Effects, nearest"))
    columns = outside.tables()[title].columns
    assert "probability" not in columns
    assert "model weight" in columns


def _known_to(found: Diagnosis, name: str, error: float, far: float = 3.0) -> Diagnosis:
    """As if a parameter had this standard error, and were far from ``far`` prior deviations."""
    taken = found.selection.taken
    wide = replace(taken, settings=replace(taken.settings, far_deviations=far))
    names = np.array([free.name for free in taken.problem.free])
    errors = np.where(names == name, error, taken.spread.standard_errors)
    vars(wide)["spread"] = replace(taken.spread, standard_errors=errors)
    selection = replace(found.selection, taken=wide)
    ranking = ranked_effects(selection, found.verdict, found.probabilities)
    return replace(found, selection=selection, ranking=ranking)


@pytest.mark.parametrize(
    ("errors_from_nothing", "bound"),
    [(0.99 * NOTHING_ERRORS, ""), (math.nan, " (on its low bound)")],
)
def test_an_effect_whose_size_is_not_determined_is_not_asserted(
    found: Diagnosis, errors_from_nothing: float, bound: str
) -> None:
    """Its size within two standard errors of nothing, or on a bound, where it has none."""
    size = found.selection.taken.values["transport_delay.time"]
    doubted = _known_to(found, "transport_delay.time", size / errors_from_nothing)
    assert found.doubted == ()
    assert doubted.doubted == ("transport_delay",)
    why = f"do not determine the size of transport_delay{bound}"
    assert summary.headline(doubted).endswith(why)
    assert "explains" not in summary.headline(doubted)
    told = probabilities(doubted.selection, found.verdict, ())["transport_delay"]
    assert told < calibrated(found.verdict.weights, EFFECT)["transport_delay"] <= MOST_PROBABILITY


@pytest.mark.parametrize("errors", [0.0, 2.9, 3.1, math.nan])
def test_a_sentence_states_what_exceeds_three_standard_errors(
    found: Diagnosis, errors: float
) -> None:
    """A size as it is, a re-tuned value as it moved: below, the table alone has it; on a bound,
    where it has no error, each says so."""
    values = {it.name: it for it in found.found}
    with np.errstate(divide="ignore"):
        size = np.float64(values["transport_delay.time"].value) / errors
        constant = values["torque_constant"]
        moved = np.float64(constant.value - constant.nominal) / errors
    stated, bound = not errors < 3.0, "(on its"

    sized = _known_to(found, "transport_delay.time", size)
    (cause,) = (card.text for card in sized.report().cards if card.title == "cause")
    assert ("acts 1.0" in cause) is stated
    assert ("size unknown" in cause) is not stated
    (row,) = (it for it in sized.document()["effects"] if it["name"] == "transport_delay")
    (told,) = (one for one in row["parameters"] if one["name"] == "transport_delay.time")
    sizes = next(iter(sized.tables()["Effects, most likely first"]["size"]))
    assert "time 1." in sizes
    for text in (cause, sizes, f"({told['doubt']}"):
        assert (bound in text) is math.isnan(errors)

    tuned = _known_to(found, "torque_constant", moved, far=0.01)
    warned = "; ".join(summary.warnings(tuned))
    said = summary.surprises(tuned)
    assert any(text.startswith("'torque_constant' is ") for text in said) is stated
    assert ("'torque_constant' by +" in warned) is stated
    assert any(bound in text for text in said) is math.isnan(errors)
    assert ("'torque_constant' is on its" in warned) is math.isnan(errors)
    parameters = replace(tuned, verdict=replace(found.verdict, kind=PARAMETERS))
    most = [card.text for card in parameters.report().cards if card.title == "re-tuned most"]
    assert ("torque_constant" in "".join(most)) is stated
    assert (bound in "".join(most)) is math.isnan(errors)


def test_effects_are_not_asserted_where_what_is_held_out_gets_worse(found: Diagnosis) -> None:
    worse = replace(found, held_out=(_held_out(3.0, 2.0, 5.0, worse=True),))
    assert worse.doubted == ("transport_delay",)
    assert "log 'other', held out, gets worse" in summary.headline(worse)
    surely, less = (
        probabilities(found.selection, found.verdict, it) for it in ((), ("transport_delay",))
    )
    assert less["transport_delay"] < surely["transport_delay"]


@pytest.mark.parametrize(
    ("errors", "asserted", "used"),
    [
        ([], True, True),
        ([(9.0, 8.0, 7.1)], True, True),
        ([(9.0, 8.0, 7.3)], False, False),
        ([(9.0, 8.0, 7.1), (9.0, 8.0, 7.9)], False, False),  # together by less than a tenth
        ([(9.0, math.nan, 8.5), (9.0, 8.0, 4.0)], True, True),
        ([(9.0, 8.0, math.nan)], False, False),
        ([(5.0, 7.0, 4.8)], True, False),  # no better than the model as it was
        ([(1.5, 2.5, 1.5)], True, True),  # noise
    ],
)
def test_an_effect_that_helps_little_where_it_is_held_out_is_possible(
    found: Diagnosis, errors: list[tuple[float, float, float]], asserted: bool, used: bool
) -> None:
    told = replace(found, held_out=tuple(_held_out(*each) for each in errors))
    text = summary.headline(told)
    assert ("explains the gap" in text) == asserted == (told.doubted == ())
    assert ("is possible, but against parameters alone" in text) == (not asserted)
    words = _words(told)
    assert ("Use the diagnosed model" in words) == used


def test_effects_that_help_little_where_they_are_held_out_are_not_told_as_sure(
    found: Diagnosis,
) -> None:
    one = found.selection.of_size(1)[0]
    pairs = [replace(one, effects=("transport_delay", it)) for it in ("backlash", "sensor_lag")]
    members = ("transport_delay", "backlash", "sensor_lag")
    verdict = replace(found.verdict, kind=NOT_IDENTIFIABLE, members=members, rivals=tuple(pairs))
    sure, less = (
        summary.headline(replace(found, verdict=verdict, held_out=(_held_out(9.0, 8.0, after),)))
        for after in (4.0, 7.9)
    )
    assert sure.startswith("It is transport_delay on 'voltage', and")
    assert less.startswith("These logs cannot tell which effect it is, if any: transport_delay, ")


def _held_out(before: float, retuned: float, after: float, worse: bool = False) -> HeldOut:
    angle = UnseenOutput("rad", before * NOISE, retuned * NOISE, after * NOISE)
    return HeldOut("other", 100, before, retuned, after, worse, {"angle": angle})


def test_a_load_and_a_friction_are_told_as_such(found: Diagnosis) -> None:
    """Not as a flat list: in the sentence, in the report and structured in the document."""
    one = found.selection.of_size(1)[0]
    names = [
        (load, friction)
        for load in ("constant_load", "gravity_load")
        for friction in ("coulomb_friction", "stribeck_friction", "load_friction")
    ]
    models = [replace(one, effects=each) for each in names]
    flat = tuple(dict.fromkeys(name for each in names for name in each))
    choice = (
        "a load (constant_load or gravity_load) and"
        " a friction (coulomb_friction, stribeck_friction or load_friction)"
    )
    for kind in (EFFECTS, NOT_IDENTIFIABLE):
        verdict = replace(found.verdict, kind=kind, rivals=tuple(models), members=flat)
        taken = replace(found.selection.taken, effects=names[0])
        selection = replace(found.selection, taken=taken, tried=models)
        two = replace(found, selection=selection, verdict=verdict, written=())
        told = json.loads(two.to_json())
        check_schema(told)
        assert choice in told["sentence"]
        assert choice in _words(two)
        (slots,) = told["confidence_set"]["alternatives"]
        assert [slot["family"] for slot in slots] == ["load", "friction"]
        assert [len(slot["effects"]) for slot in slots] == [2, 3]
        assert sum(it["model_weight"] for it in told["confidence_set"]["models"]) <= 1.0 + 1e-9


def test_intervals_compare_with_the_best(found: Diagnosis) -> None:
    """One that is worse by the same factor in every block is so in every draw."""
    best = found.selection.of_size(1)[0]
    twice = replace(best, evidence=replace(best.evidence, unseen=2.0 * best.evidence.unseen))
    same, worse = intervals([best, twice])
    assert same == pytest.approx((best.evidence.rms, best.evidence.rms))
    assert worse == pytest.approx((2.0 * best.evidence.rms, 2.0 * best.evidence.rms))


def test_parameters_are_in_their_display_units(found: Diagnosis, text: str) -> None:
    page = Page(text)
    (size,) = [row for row in _cells(page, "transport_delay.time") if len(row) == 6]
    value, error, unit = _quantity(size[3])
    assert unit == "ms"
    assert abs(value - 1.1) < 4.0 * error
    (moved,) = [row for row in _cells(page, "torque_constant") if len(row) == 6]
    value, error, _ = _quantity(moved[3])
    nominal = _number(moved[1].split()[0])
    assert nominal == pytest.approx(found.model.values["torque_constant"], rel=1e-4)
    assert abs(value - 1.1 * nominal) < 4.0 * error


@pytest.mark.thorough
def test_next_experiment_is_told_and_drawn(unsure: Diagnosis) -> None:
    planned = unsure.next_experiments
    page = Page(_page(unsure))
    page.assert_stands_alone()
    assert planned
    for step in (step for one in planned for step in one.instructions):
        assert step in page.text
    drawn = " ".join(page.values("aria-label"))
    assert " or ".join(one.effects[0] for one in unsure.verdict.rivals) in drawn
    assert planned[0].text.partition(". ")[0] in page.source.partition("</header>")[0]
    told = replace(unsure, written=())
    assert not any("next-experiment" in name for name in Page(_words(told)).values("id"))


def test_what_the_fmu_leaves_is_told(found: Diagnosis) -> None:
    rows = (Accuracy("bench", "angle", "fit", 2000, 0.2 * DEGREE, 0.0301 * DEGREE, 99.9, DEGREE),)
    equal = Page(_words(replace(found, confirmation=Confirmation(rows, 0.0))))
    assert _cells(equal, "bench")[0][4:6] == ["0.2", "0.0301"]
    assert any("RMS after [deg]" in row for row in equal.rows)
    assert any("same bits" in piece for piece in equal.text)
    off = Page(_words(replace(found, confirmation=Confirmation(rows, 2e-9))))
    assert not any("same bits" in piece for piece in off.text)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("kind", "judged", "begins"),
    [
        (NO_GAP, "pass", "No gap"),
        (PARAMETERS, "open", "Re-tuned parameters"),
        (OUTSIDE, "fail", "Outside the catalogue"),
        (NOT_IDENTIFIABLE, "fail", "These logs cannot tell"),
    ],
)
def test_every_verdict_has_a_page(found: Diagnosis, kind: str, judged: str, begins: str) -> None:
    selection = found.selection
    if kind in (NO_GAP, PARAMETERS):
        selection = replace(selection, taken=selection.retuned, tried=[])
    other = replace(
        found,
        selection=selection,
        verdict=replace(found.verdict, kind=kind, weights={}),
        ranking=tuple(replace(one, taken=False, in_set=False) for one in found.ranking),
    )
    text = _page(other)
    Page(text).assert_stands_alone()
    assert f'<header class="{judged}">' in text
    assert begins.lower() in _heading(text).lower()


@pytest.mark.thorough
def test_a_model_without_uncertainties_is_not_called_retuned(found: Diagnosis) -> None:
    bare = replace(found.selection.retuned.problem, free=())
    alone = replace(found.selection.retuned, problem=bare)
    alone = replace(alone, evidence=replace(alone.evidence, vector=np.empty(0)))
    before = replace(found.selection.before, vector=np.empty(0))
    selection = replace(found.selection, before=before, retuned=alone)
    text = _page(replace(found, selection=selection, moved=()))
    page = Page(text)
    page.assert_stands_alone()
    assert "re-tuned" not in page.text
    assert any("a wrong value looks like an effect" in piece for piece in page.text)


def test_small_errors_are_told_with_a_prefix(found: Diagnosis) -> None:
    """0.0000123 m reads 12.3 um; one in degrees keeps its unit."""
    for size, wanted in ((12.3e-6, (1e6, "um")), (4.7e-3, (1e3, "mm")), (0.54, (1.0, "m"))):
        assert prefix(size, "m") == wanted
    assert prefix(1e-6, "deg") == (1.0, "deg")


@pytest.mark.thorough
def test_errors_are_in_the_unit_of_the_signal_whatever_that_of_the_log(found: Diagnosis) -> None:
    """Codes of 180 deg in the file are no unit in which a person reads an error."""
    (log,) = found.logs
    codes = replace(log, channels={"angle": Channel("angle", "angle", "180 deg", math.pi)})
    told = replace(found, logs=(codes,))
    assert _page(told).count("180 deg") == 0
    assert told.tables()["The nominal model"].equals(found.tables()["The nominal model"])


@pytest.mark.thorough
def test_a_log_that_is_held_out_is_shown_where_it_is_worst(found: Diagnosis) -> None:
    """No fit has seen it; its worst sample is told all the same."""
    log = found.logs[0]
    checked = replace(log, name="later", held_out=np.ones(len(log.times), dtype=bool))
    problems = [
        replace(one.problem, logs=(log, checked))
        for one in (found.selection.retuned, found.selection.taken)
    ]
    selection = replace(
        found.selection,
        retuned=replace(found.selection.retuned, problem=problems[0]),
        taken=replace(found.selection.taken, problem=problems[1]),
    )
    text = _page(replace(found, logs=(log, checked), selection=selection))
    nominal = simulate(found.model, log.times, log.inputs)["angle"]
    worst = log.times[np.argmax(np.abs(nominal - log.outputs["angle"]))]
    assert len(re.findall(rf"is worst before: \S+ deg at {worst:.5g} s", text)) == 2


@pytest.mark.thorough
def test_hostile_names_stay_text(found: Diagnosis) -> None:
    log = replace(
        found.logs[0],
        name=HOSTILE,
        channels={"angle": Channel("angle", "1", HOSTILE, DEGREE)},
    )
    audits = tuple(replace(one, log=log) for one in found.audits)
    gaps = tuple(replace(gap, worst=(HOSTILE, 0.1)) for gap in found.gaps)
    page = Page(_page(replace(found, logs=(log,), audits=audits, gaps=gaps)))
    page.assert_stands_alone()
    assert any(HOSTILE in piece for piece in page.text)


def test_logs_and_their_hashes_are_named(found: Diagnosis, text: str) -> None:
    assert found.logs[0].sha256 in text
    assert "bench.csv" in text
    assert "Python" in Page(text).text


@pytest.mark.parametrize(
    "names",
    [
        ("measured", "nominal", "re-tuned", "with effects"),
        ("parameters alone", "drive_saturation", "gain_error"),
        ("constant load and sensor nonlinearity", "constant load and command offset"),
    ],
)
def test_names_of_curves_stay_inside_the_picture(names: tuple[str, ...]) -> None:
    with drawing(rows=2, height=3.6) as (figure, (command, axes)):
        for name in names:
            axes.plot([0.0, 1.0], [0.0, 1.0], label=name)
        draw_legend(axes, len(names))
        figure.draw_without_rendering()
        legend = axes.get_legend()
        assert legend
        inside, whole = legend.get_window_extent(), figure.bbox
        assert whole.x0 <= inside.x0 < inside.x1 <= whole.x1
        assert inside.y1 <= command.get_window_extent().y0 + 3.0


@pytest.mark.thorough
def test_a_parameter_that_the_logs_do_not_determine_has_a_bar_of_the_whole_width(
    found: Diagnosis, recwarn: pytest.WarningsRecorder
) -> None:
    unknown = tuple(replace(one, standard_error=math.inf) for one in found.moved)
    text = _page(replace(found, moved=unknown))
    assert "How far nominal parameters moved" in text
    assert not [it for it in recwarn if "overflow" in str(it.message)]


def test_signals_are_those_of_the_logs_and_of_simulations(found: Diagnosis) -> None:
    table = found.signals()
    (log,) = found.logs
    measured, *simulated, left = table.columns[2:]
    np.testing.assert_allclose(
        table[measured], np.degrees(log.outputs["angle"]), rtol=1e-12, atol=1e-15
    )
    np.testing.assert_allclose(table["time [s]"], log.stamps)
    run = prepared(found.fitted, log)
    np.testing.assert_allclose(table[simulated[-1]], np.degrees(run.outputs({})[:, 0]), atol=1e-4)
    np.testing.assert_allclose(table[left], table[simulated[-1]] - table[measured], atol=1e-12)


def test_signals_for_plotjuggler_are_those_of_the_table(found: Diagnosis, tmp_path: Path) -> None:
    found.write_signals(tmp_path / "signals.mcap")
    table, (log,) = found.signals(), found.logs
    with (tmp_path / "signals.mcap").open("rb") as file:
        rows = [(m.log_time, json.loads(m.data)) for _, _, m in make_reader(file).iter_messages()]
    for name in rows[0][1]:
        np.testing.assert_array_equal([row[name] for _, row in rows], table[f"angle {name} [deg]"])
    np.testing.assert_allclose([1e-9 * time for time, _ in rows], log.stamps, atol=1e-9)
    drawn = ElementTree.parse(tmp_path / "signals.xml").iter("curve")
    assert [it.attrib["name"] for it in drawn] == [
        f"{log.name}/angle/{name}" for name in rows[0][1]
    ]
