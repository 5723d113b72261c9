"""The zoo has curves of the sets whose licence allows it alone, and its files can be used."""

from __future__ import annotations

import math

import pytest

from servo_models.data.parameters import read_parameters
from studies.zoo import CURVES, LIVE, PAGE, PARAMETERS, index, thinned
from tests.support.document import ROOT
from tests.support.noisy_motor import motor_log

ZOO = ROOT / "docs" / "zoo"
LICENSED = {"so101_rotation", "so101_wrist_roll", "xl330", "odrive_comp", "odrive_nocomp"}
ENTRIES = sorted(path.parent.name for path in ZOO.glob(f"*/{PAGE}"))
MOST_BYTES = 400_000  # of a page


def test_curves_are_those_of_sets_whose_licence_allows_it() -> None:
    shown = {path.parent.name for name in (CURVES, LIVE) for path in ZOO.rglob(name)}
    assert shown
    assert shown <= LICENSED
    assert all(path.stat().st_size < MOST_BYTES for path in ZOO.rglob(LIVE))


def test_a_page_holds_at_most_every_other_row() -> None:
    log = motor_log()
    assert len(thinned(log.at(slice(0, 101))).times) == 51
    assert len(thinned(log).times) <= min(700, len(log.times) / 2 + 1)


@pytest.mark.parametrize("name", ENTRIES)
def test_an_entry_gives_the_errors_of_its_parameters(name: str) -> None:
    told, page = read_parameters(ZOO / name / PARAMETERS), (ZOO / name / PAGE).read_text("utf-8")
    told.model()  # every value is inside its bounds
    for one in told.estimates:
        if one.origin == "diagnosed" and one.standard_error:
            error = f" {one.standard_error:.2g} |" if math.isfinite(one.standard_error) else ""
            (row,) = (line for line in page.splitlines() if line.startswith(f"| `{one.name}` |"))
            assert f"| {one.value:.4g} |{error}" in row


def test_the_index_lists_the_entries() -> None:
    assert (ZOO / PAGE).read_text("utf-8") == "\n".join(index(ZOO))
