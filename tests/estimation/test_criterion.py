"""The criterion: in which order an effect is refused, and which of several is preferred."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from scipy.stats import chi2, norm

from flexdesign.diagnosis import verdict
from flexdesign.estimation import criterion
from flexdesign.estimation.criterion import Evidence
from flexdesign.estimation.least_squares.levenberg_marquardt import linearise
from flexdesign.estimation.model_selection.model_comparison import Trial, best_of
from tests.estimation.sums import candidate, fit_with, task

#: What passes every check.
ENOUGH = Evidence(
    gain=100.0, needed=20.0, helps=True, share=0.5, change=2e-9, own_change=2e-9, tolerance=1e-9, at_bound=(), open=()
)


def test_effects_are_refused_for_the_first_check_that_fails() -> None:
    checks: list[tuple[dict[str, Any], str]] = [
        ({"open": ("a",)}, "a is not determined: its null is less than 1.96 standard errors away"),
        ({"at_bound": ("a", "b")}, "a and b at the end of what is plausible"),
        ({"own_change": 0.5e-9}, "itself moves the prediction by less than the tolerance"),
        ({"change": 0.5e-9}, "moves the prediction by less than the tolerance"),
        ({"share": 0.049}, "explains less than 5 % of what is unexplained"),
        ({"helps": False}, "does not help on the validation runs"),
        ({"trace": 19.9}, "shows no line at its frequency"),
        ({"gain": 19.9}, "no more than chance gives"),
    ]
    evidence = ENOUGH
    assert evidence.refusal == "" and not evidence.is_small
    for failing, words in checks:
        evidence = replace(evidence, **failing)
        assert evidence.refusal == words
        assert evidence.is_small is words.startswith("moves")


def test_the_interval_is_one_of_95_percent() -> None:
    assert pytest.approx(norm.ppf(0.975), abs=1e-3) == criterion.HALF_WIDTH
    half_widths = (criterion.HALF_WIDTH * sigma for sigma in (0.5, 0.52))
    assert [criterion.excludes(1.0, 0.0, half_width) for half_width in half_widths] == [True, False]


def test_each_further_number_raises_the_critical_value_by_its_quantile() -> None:
    more = chi2.isf(criterion.LEVEL, 3) - chi2.isf(criterion.LEVEL, 1)
    assert criterion.critical_value(20.0, 3) == pytest.approx(20.0 + more)


def trial(
    name: str, bic: float, error: float, exceeds_noise: bool = True, reason: str = "", ends: Sequence[str] = ()
) -> Trial:
    effects = [SimpleNamespace(strength=f"{name}.strength")]
    fit: Any = SimpleNamespace(
        bic=lambda _: bic, discrepancy=1.0, exceeds_noise=exceeds_noise, effects=effects, at_bound=lambda: ends
    )
    return Trial((name,), fit, 100.0, 0.5, error, 20.0, 20.0, reason)


def best(*trials: Trial) -> str:
    about: Any = SimpleNamespace(validate=SimpleNamespace(records=(1,)), noise_rms=0.0)
    found = best_of(about, trials)
    assert found is not None
    return found.names[0]


def test_of_approximations_that_fit_alike_the_one_that_predicts_best_is_preferred() -> None:
    assert best(trial("a", 100.0, 11.5), trial("b", 109.0, 10.2)) == "b"
    assert best(trial("a", 100.0, 11.5), trial("b", 109.0, 11.3)) == "a"  # by less than 5 % of the mean square
    assert best(trial("a", 100.0, 11.5), trial("b", 111.0, 10.2)) == "a"  # BIC tells them apart
    assert best(trial("a", 100.0, 11.5), trial("b", 109.0, 10.2, reason="no more than chance gives")) == "a"
    assert best(trial("a", 100.0, 11.5, exceeds_noise=False), trial("b", 109.0, 10.2)) == "a"  # a is adequate


def test_of_approximations_that_fit_alike_one_at_the_end_of_what_is_plausible_comes_last() -> None:
    at_end = trial("a", 100.0, 11.5, ends=["a.strength"])
    assert best(at_end, trial("b", 109.0, 11.3)) == "b"
    assert best(at_end, trial("b", 109.0, 11.3, ends=["b.strength"])) == "a"
    assert best(at_end, trial("b", 111.0, 11.9)) == "a"  # BIC tells them apart, and it predicts worse
    assert best(trial("a", 100.0, 11.5), trial("b", 109.0, 10.2, ends=["b.strength"])) == "a"


def test_an_approximation_at_the_end_of_what_is_plausible_comes_after_one_that_predicts_as_well() -> None:
    """BIC tells both apart; errors that differ by less than 5 % of the mean square do not."""
    ended = trial("a", 100.0, 10.0, ends=["a.strength"])
    assert best(ended, trial("b", 500.0, 10.2)) == "b"
    assert best(ended, trial("b", 500.0, 10.3)) == "a"
    assert best(ended, trial("b", 500.0, 10.2, ends=["b.strength"])) == "a"


def test_stated_values_lie_in_their_intervals_where_a_fit_ended_early() -> None:
    """An amount of a column is known to 0.0075; the fit stopped half a unit away."""
    about = task({"d": 0.3})
    fit = fit_with(about, [candidate("d", signed=True)])
    where, x = fit.solution.problem.where, fit.solution.x.copy()
    x[where.names.index("d")] += 0.5
    early = linearise(fit.solution.problem, x)
    assert early is not None
    stated = verdict.values_of(replace(fit, solution=early))["d"]
    assert stated.interval[0] < stated.value < stated.interval[1]
    assert stated.value == pytest.approx(0.3, abs=0.03)
