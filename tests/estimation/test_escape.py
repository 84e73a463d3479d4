"""How often fits of a play operator miss the global minimum, which differential evolution finds."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from flexdesign.estimation.model_selection.fitted_model import escape, fit_model
from tests.estimation.play_problems import SEEDS, problem
from tests.estimation.toys import Array

#: A minimum is missed if chi^2 is larger by this.
MISSED = 2.0


@cache
def ends(sigma: float) -> Array:
    """Chi^2 less that of the global minimum, after one fit and after `escape`; and the threshold over the best one.

    Seeds by these three.
    """
    found = []
    for seed in range(SEEDS):
        about = problem(seed, sigma)
        least, threshold = about.least(seed)
        once = fit_model(about.task, about.model, (about.effect,))
        assert once is not None
        last = escape(about.task, once)
        reached = last.solution.problem.where.values(last.solution.x)["r"]
        found.append([once.cost - least, last.cost - least, reached / threshold])
    return np.array(found)


@pytest.mark.parametrize("sigma", [0.05, 0.01])
def test_fits_that_escape_miss_one_global_minimum_in_five_at_most(sigma: float) -> None:
    """Of these twenty none is missed with noise of a tenth of the effect, and three with a fiftieth.

    One fit from the same start misses a third to a half of them.
    """
    found = ends(sigma)
    assert found[:, :2].min() > -1e-3  # no fit is better than the reference
    once, escaped = (found[:, :2] > MISSED).sum(axis=0)
    assert once >= SEEDS / 3  # else the problems are too easy to tell anything
    assert escaped <= SEEDS / 5
    assert escaped < once


@pytest.mark.parametrize("sigma", [0.05, 0.01])
def test_a_miss_leaves_the_threshold_near_its_best(sigma: float) -> None:
    """A fit in a local minimum is in the one beside the global minimum, less than a tenth away."""
    assert np.all(np.abs(np.log(ends(sigma)[:, 2])) < math.log(1.1))
