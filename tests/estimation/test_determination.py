"""Numbers of an effect that the runs do not determine are held where the catalogue has them."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flexdesign.estimation.model_selection import stepwise_selection
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.estimation.model_selection.stepwise_selection import (
    drop_undetermined,
    hold_undetermined,
)
from flexdesign.estimation.uncertainty.identifiability import Estimate
from tests.estimation.sums import Sum, as_sum, candidate, column, fit_with, strength, task
from tests.estimation.toys import Array, parameter

#: The noise is 0.1, of 180 values: an amount of a column is known to 0.0075, its 95 % interval is 0.03 wide.
STRENGTH = 0.3


def effect(share: float, default: float, low: float, high: float) -> Candidate:
    """A column whose strength counts, and some share of another one that a second number scales."""

    def shape(v: Any, run: Any) -> Array:
        return np.asarray(v["d"] * (column(run, "d") + share * v["d.more"] * column(run, "other")))

    more = parameter("d.more", default, low, high)

    def add(model: Any) -> Sum:
        return as_sum(model).plus(shape, strength("d"), more)

    return Candidate("d", add, "d", ("d", "d.more"), ({"d": 0.1, "d.more": default},), signed=True)


def fit(added: Candidate, **truth: float) -> tuple[EstimationTask, FittedModel]:
    about = task({"d": STRENGTH, **truth})
    return about, fit_with(about, [added])


def number(of: FittedModel, name: str) -> float:
    return next(p.start or 0.0 for p in of.model.parameters() if p.name == name)


def test_a_number_known_to_no_half_of_its_range_is_held() -> None:
    """Of 0.3 times a share of a column each unit moves the prediction by 0.3 shares: known to 0.03 over 0.3 shares."""
    for share, is_held in ((0.05, True), (5.0, False)):  # intervals of 2 and 0.02, in a range of 2
        added = effect(share, 0.5, 0.0, 2.0)
        about, found = fit(added, other=STRENGTH * share * 0.7)
        held, names = hold_undetermined(about, found)
        assert names == (("d.more",) if is_held else ())
        assert (held is not found) is is_held
        assert number(held, "d.more") == (0.5 if is_held else pytest.approx(0.7, abs=0.03))
        if is_held:
            assert [each.free for each in held.effects] == [("d",)]
            assert "d.more" not in held.solution.problem.where.names
            assert held.cost - found.cost < 10
            assert number(held, "d") == pytest.approx(STRENGTH, abs=0.03)


@pytest.mark.parametrize(("truth", "named"), [(STRENGTH, ("d",)), (0.0, ())])
def test_an_effect_whose_interval_holds_its_null_is_dropped(truth: float, named: tuple[str, ...]) -> None:
    about = task({"d": truth} if truth else {})
    assert drop_undetermined(about, fit_with(about, [candidate("d")])).names == named


@pytest.mark.parametrize("exceeds_noise", [False, True])
def test_what_differs_from_run_to_run_may_have_any_mean_where_the_residual_is_noise(
    exceeds_noise: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stepwise_selection, "parameter_of", lambda *_: strength("d"))
    fit: Any = SimpleNamespace(
        deviations=lambda name: [f"2-run:{name}"],
        exceeds_noise=exceeds_noise,
        model=None,
        mean_over_runs=lambda _: (0.01, 0.21),
    )
    assert stepwise_selection._excludes_null(fit, "d") is not exceeds_noise


@pytest.mark.parametrize(
    ("interval", "is_shown"), [((2e3, 5e4), True), ((2e3, 1e6), False), ((2e3, 1e6 * (1 - 1e-12)), False)]
)
def test_a_limit_that_may_be_as_far_as_is_plausible_is_not_shown(
    interval: tuple[float, float], is_shown: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A limit of infinity is none; the plausible range ends before."""
    limit = parameter("limit", None, 1.0, 1e6, scale="inverse", null=math.inf)
    monkeypatch.setattr(stepwise_selection, "parameter_of", lambda *_: limit)
    monkeypatch.setattr(stepwise_selection, "intervals", lambda *_: [Estimate(limit, 1e4, 1e3, interval, True)])
    fit: Any = SimpleNamespace(deviations=lambda _: [], model=None, solution=None)
    assert stepwise_selection._excludes_null(fit, "limit") is is_shown


def test_a_number_that_may_be_zero_stays_zero_where_the_catalogue_has_it_so() -> None:
    """However narrow its interval is in its range."""
    for truth, is_held in ((0.0, True), (0.5, False)):
        about, found = fit(effect(1.0, 0.0, -100.0, 100.0), other=STRENGTH * truth)
        held, names = hold_undetermined(about, found)
        assert names == (("d.more",) if is_held else ())
        assert (number(held, "d.more") == 0.0) is is_held


def test_a_default_that_contradicts_the_runs_is_not_held() -> None:
    """An interval of 2 in a range of 3; the catalogue has the truth, or six standard deviations less."""
    for default, names in ((2.8, ("d.more",)), (0.0, ())):
        about, found = fit(effect(0.05, default, 0.0, 3.0), other=STRENGTH * 0.05 * 2.8)
        held, named = hold_undetermined(about, found)
        assert named == names and (held is found) is not bool(names)


def test_a_default_that_predicts_worse_leaves_the_fitted_value(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a number without an interval: here any default counts as worse."""
    about, found = fit(effect(0.05, 0.5, 0.0, 2.0), other=STRENGTH * 0.05 * 0.7)
    monkeypatch.setattr(stepwise_selection, "is_worse", lambda *_: True)
    held, names = hold_undetermined(about, found)
    assert names == ("d.more",) and "d.more" not in held.solution.problem.where.names
    assert number(held, "d.more") == pytest.approx(number(found, "d.more")) and number(held, "d.more") != 0.5


def test_a_strength_is_never_held() -> None:
    """Whether it is there at all was decided when the effect was added."""
    about = task({})
    alone = candidate("d")
    found = fit_with(about, [alone])
    assert hold_undetermined(about, found) == (found, ())
