"""The errors that a refit lowers: what a law is given at its time steps."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from servo_models.simulators import simulator
from servo_models.simulators.refit import Fit
from servo_models.simulators.servo import Run

PARTS = 20  # of a time step


@given(
    step=st.sampled_from([1e-4, 2e-3, 0.1]),
    gaps=st.lists(st.integers(1, 3 * PARTS), min_size=1, max_size=20),
)
def test_a_goal_acts_from_its_row_on(step: float, gaps: list[int]) -> None:
    """Counted in whole parts of a time step, where nothing is rounded."""
    rows = np.cumsum([0, *gaps])
    goal = np.arange(float(len(rows)))
    run = Run("", step / PARTS * rows, goal, goal, goal, np.ones(len(rows), dtype=bool))
    (played,) = Fit(simulator("mujoco"), [run], step, inertia=1.0).goals
    assert played.tolist() == [goal[rows <= PARTS * k][-1] for k in range(len(played))]
