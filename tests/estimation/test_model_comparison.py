"""Whether an effect is added: why it is refused, discrepancies of the model, critical values, pairs."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any
from zlib import crc32

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2

from flexdesign.estimation.criterion import LEVEL, SHARE, explained_share, large_share
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.least_squares.levenberg_marquardt import linearise
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import fit_model
from flexdesign.estimation.model_selection.forward_selection import GROSS_MISFIT, forward
from flexdesign.estimation.model_selection.model_comparison import (
    Step,
    best_of,
    compare,
    difference,
    is_determined,
    rank,
    relevant_ends,
)
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process
from tests.estimation.sums import (
    EFFECTS,
    HELD,
    NAMES,
    SIGMA,
    N,
    as_sum,
    calibrated_stand,
    candidate,
    column,
    effects,
    fit_with,
    linear,
    offset,
    recorded,
    stage,
    strength,
    task,
)
from tests.estimation.toys import Array, Run, parameter


def reasons(step: Step) -> dict[tuple[str, ...], str]:
    return {trial.names: trial.reason for trial in step.trials}


# --- why effects are refused ------------------------------------------------------------------------------------------


def test_a_value_at_the_end_of_what_is_plausible_is_refused() -> None:
    about = task({"d": 0.3})
    step = forward(about, calibrated_stand(about), effects(d=candidate("d", between=(0.0, 0.2))))
    assert step.chosen is None
    assert reasons(step)["d",] == "d at the end of what is plausible"


def test_what_does_not_help_on_runs_kept_apart_is_refused() -> None:
    about = task({"d": 0.3}, held={"d": -0.3})
    step = forward(about, calibrated_stand(about), effects())
    assert step.chosen is None
    assert reasons(step)["d",] == "does not help on the validation runs"


def test_what_does_not_show_by_its_trace_is_refused() -> None:
    """What a periodic disturbance explains counts only if its line is there, whatever else it does to the model."""
    about = task({"d": 0.3})

    def asked(trace: str) -> str:
        shown = candidate("d", trace=lambda _, run: column(run, trace)[:, None])
        return reasons(forward(about, calibrated_stand(about), effects(d=shown)))["d",]

    assert asked("d") == ""
    assert asked("another") == "shows no line at its frequency"


def test_what_moves_less_than_the_tolerance_is_refused() -> None:
    about = task({"d": 0.3}, tolerance=0.5)
    step = forward(about, calibrated_stand(about), effects())
    assert step.chosen is None
    assert reasons(step)["d",] == "moves the prediction by less than the tolerance"


def test_what_only_lets_a_number_stay_where_it_was_known_to_be_is_refused() -> None:
    """The gain is 2 and was known to be 1: an effect that is the gain over again explains no data."""
    about = task({}, p=(1.0, 0.1))
    before = calibrated_stand(about)
    assert before.solution.problem.where.values(before.solution.x)["p"] == pytest.approx(2.0, abs=0.1)
    assert before.cost - before.fitted_chi2 > 80
    step = forward(about, before, effects(d=candidate("d", {"p": 1.0, "d": 0.05})))
    assert step.chosen is None or "d" not in step.chosen.names


def test_what_explains_a_small_share_is_refused() -> None:
    """On the validation runs: 0.3 squared of what d and an unknown column, normal to all else, leave together."""
    for unknown, is_small in ((2.0, True), (0.5, False)):
        kept = []
        for run in recorded({"d": 0.3}, 0, HELD):
            others = np.column_stack([np.ones(N), *(column(run, name) for name in ("own", "p", "q", *EFFECTS))])
            more = column(run, "unknown") - others @ np.linalg.lstsq(others, column(run, "unknown"))[0]
            kept.append(dataclasses.replace(run, data=run.data + unknown * more / np.std(more)))
        about = dataclasses.replace(
            task({"d": 0.3}), validate=Dataset(kept, ColouredNoise(Process.white(SIGMA)), offset), noise_rms=SIGMA
        )
        step = forward(about, calibrated_stand(about), effects())
        share = 0.3**2 / (0.3**2 + unknown**2)
        assert (share < SHARE) is is_small
        trial = next(trial for trial in step.trials if trial.names == ("d",))
        assert trial.share == pytest.approx(share, rel=0.5)  # d is fitted, its columns are random, and two offsets
        assert (step.chosen is None) is is_small
        assert trial.reason.startswith("explains less than") is is_small


def test_a_strength_that_another_number_can_take_the_place_of_is_refused() -> None:
    """Two numbers whose columns differ by a hundredth: their sum is known to 0.008, each of them to about 0.8."""

    def entangled(apart: float) -> Candidate:
        twin = linear("d.more", {"d": 1.0, "other": apart})
        alone = candidate("d", signed=True)
        return dataclasses.replace(
            alone,
            add=lambda model: alone.add(model).plus(twin, parameter("d.more", 0.0, -9.0, 9.0)),  # type: ignore[attr-defined]
            free=("d", "d.more"),
            trials=({"d": 0.1, "d.more": 0.0},),
        )

    about = task({"d": 0.3})
    before = calibrated_stand(about)
    refused, accepted = (forward(about, before, effects(d=entangled(apart))) for apart in (0.01, 3.0))
    assert refused.chosen is None
    assert reasons(refused)["d",] == "d is not determined: its null is less than 1.96 standard errors away"
    assert accepted.chosen is not None and accepted.chosen.names == ("d",)


@pytest.mark.parametrize(("truth", "is_one"), [(0.0, False), (0.3, True)])
def test_a_limit_is_determined_where_its_interval_excludes_none_at_all(truth: float, is_one: bool) -> None:
    """One over a limit times a column: the limit may be infinite, its reciprocal is known to 0.1 over root of 180."""

    def shape(v: Mapping[str, float], run: Any) -> Array:
        return np.asarray(column(run, "d") / v["limit"])

    limit = parameter("limit", 20.0, 1.0, 1e3, scale="inverse", null=math.inf)
    effect = Candidate("d", lambda model: as_sum(model).plus(shape, limit), "limit", ("limit",), ({"limit": 20.0},))
    about = task({"d": truth})
    made = fit_model(about, effect.add(stage()), (effect,))
    assert made is not None and is_determined(made, effect) is is_one


def test_an_effect_that_only_helps_a_fit_that_is_caught_is_refused() -> None:
    """One of the model's own numbers is far from its best, which the fit with an effect finds that looks like it."""
    about = task({}, tolerance=0.05)
    caught = fit_model(dataclasses.replace(about, free=()), stage().replace({"p": 1.0}))
    assert caught is not None and caught.scale > GROSS_MISFIT
    step = forward(about, caught, effects(e=candidate("e", {"p": 0.5, "e": 1.0}, signed=True)))
    assert step.chosen is None and step.trials
    best = max(step.trials, key=lambda trial: trial.gain)
    assert best.gain > 100 * best.critical_gain
    assert difference(about.validate, caught.model, best.fit.model, {}) > 0.05
    assert best.reason == "itself moves the prediction by less than the tolerance" and not best.is_small


def test_a_change_of_the_prediction_that_is_no_improvement_is_not_relevant() -> None:
    """In the runs kept apart the effect is 1.9 times as large: it changes them by 0.13 and improves them by 0.03."""
    tolerance = 0.1
    about = task({"d": 0.07}, tolerance=tolerance)
    louder = Candidate(
        "loud",
        lambda model: stage().plus(
            lambda v, run: v["loud"] * (1.9 if run.name in HELD else 1.0) * column(run, "d"), strength("loud")
        ),
        "loud", ("loud",), ({"loud": 0.1},), signed=True,
    )  # fmt: skip
    before = calibrated_stand(about)
    alone = forward(about, before, [louder])
    (trial,) = alone.trials
    assert difference(about.validate, before.model, trial.fit.model, {}) > tolerance
    assert alone.chosen is None and trial.reason == "moves the prediction by less than the tolerance" and trial.is_small


def test_what_is_explained_as_well_by_an_effect_that_hardly_moves_anything_needs_no_other() -> None:
    about = task({"d": 1.0})
    step = forward(about, calibrated_stand(about), effects(d=candidate("d"), f=candidate("f", {"d": 0.9, "f": 0.1})))
    first, second = step.trials
    assert reasons(step) == {("d",): "", ("f",): ""} and first.names == ("d",)
    assert best_of(about, [first, second]) is first
    small = {"reason": "moves the prediction by less than the tolerance", "is_small": True}
    assert best_of(about, [dataclasses.replace(first, **small), second]) is None
    assert best_of(about, [first, dataclasses.replace(second, **small)]) is first


@pytest.mark.parametrize(("error", "is_one"), [(0.7, False), (0.35, True), (0.05, True)])
def test_a_strength_of_a_log_scale_is_determined_where_its_interval_is_smaller_than_itself(
    error: float, is_one: bool
) -> None:
    """Its null is infinitely far away: 1.96 times its relative deviation must be less than one."""
    size = SIGMA / math.sqrt(3 * N) / error  # of 180 values a strength of one is then known to this error
    shape = lambda v, run: size * v["d"] * column(run, "d")  # noqa: E731
    number = parameter("d", 1.0, 1e-3, 1e3, scale="log", null=0.0)
    effect = Candidate("d", lambda model: as_sum(model).plus(shape, number), "d", ("d",), ({"d": 1.0},))
    about = task({})
    made = fit_model(about, effect.add(stage()), (effect,))
    assert made is not None
    at_one = np.where(np.array(made.solution.problem.where.names) == "d", 0.0, made.solution.x)
    there = linearise(made.solution.problem, at_one)
    assert there is not None and is_determined(dataclasses.replace(made, solution=there), effect) is is_one


# --- model discrepancy ------------------------------------------------------------------------------------------------

LONG, RHO, SIZE = 500, 0.9, 0.5


def wandering(seed: int, name: str, rho: float) -> Array:
    """A series in which each value remembers a share of the one before, of variance one (independent of the fit)."""
    null_errors = np.random.default_rng([seed, crc32(name.encode())]).standard_normal(LONG + 200)
    return np.asarray(lfilter([math.sqrt(1 - rho**2)], [1.0, -rho], null_errors)[200:])


def slow_effect(name: str = "s") -> Candidate:
    """An effect that is slow itself, as most in a catalogue are."""
    added = lambda v, run: v[name] * wandering(99, run.name + name, RHO)  # noqa: E731
    return Candidate(name, lambda m: as_sum(m).plus(added, strength(name)), name, (name,), ({name: 0.1},), signed=True)


def imperfect(seed: int, rho: float, effect: float = 0.0) -> EstimationTask:
    """Runs with noise of size SIGMA, beside a discrepancy of SIZE that no effect describes."""

    def dataset(names: Sequence[str]) -> Dataset:
        made = []
        for name in names:
            run = Run(name, np.arange(LONG) / LONG, np.zeros(LONG))
            data = SIZE * wandering(seed, name, rho) + effect * wandering(99, name + "s", RHO)
            noise = SIGMA * np.random.default_rng([seed, 7, crc32(name.encode())]).standard_normal(LONG)
            made.append(dataclasses.replace(run, data=data + noise + 2.0 * column(run, "p")))
        return Dataset(made, ColouredNoise(Process.white(SIGMA)), offset)

    return EstimationTask(dataset(NAMES), dataset(HELD), ("p", "q"), lambda _: {}, lambda _: stage(), 1e-3)


@pytest.mark.parametrize("rho", [0.0, 0.6, RHO])
def test_discrepancy_is_its_variance_times_the_samples_that_count_as_one(rho: float) -> None:
    """Bartlett's sum of squared autocorrelations of a first-order process, (1 + r^2) / (1 - r^2), diluted by noise.

    The mean of 20 cases of three runs. Of 500 values the lowest frequencies are found too weak, so that it is low.
    """
    found = [calibrated_stand(imperfect(seed, rho)).discrepancy for seed in range(20)]
    whole, colour = SIZE**2 + SIGMA**2, SIZE**2 / (SIZE**2 + SIGMA**2)
    counted = 1 + 2 * colour**2 * rho**2 / (1 - rho**2)
    assert np.mean(found) == pytest.approx(whole / SIGMA**2 * counted, rel=0.2)


def test_white_noise_alone_is_no_discrepancy() -> None:
    """Nor is a white misfit coloured: it counts by its size alone, in nine cases of ten and in the median."""
    for truth in ({}, {"d": 0.3}):
        found = [calibrated_stand(task(truth, seed)) for seed in range(10)]
        ratios = sorted(fit.discrepancy / max(fit.scale, 1.0) for fit in found)
        assert ratios[:8] == pytest.approx([1.0] * 8, rel=0.01) and ratios[-1] < 1.3
    assert calibrated_stand(task({})).discrepancy < 1 + 4 * math.sqrt(2 / (3 * N))


def test_correlated_samples_are_no_proofs() -> None:
    """A slow effect fits a slow discrepancy by chance, far beyond white noise; over the discrepancy it is chi-squared.

    The median of which is 0.455; of 60 cases none is accepted, and few pass the check of evidence alone.
    """
    ratios, tempting = [], 0
    for seed in range(60):
        about, effect = imperfect(seed, RHO), slow_effect()
        before = calibrated_stand(about)
        after = fit_model(about, effect.add(before.model), (effect,))
        assert after is not None
        score = float(chi2.isf(LEVEL, 1))
        trial = compare(about, before, after, ("s",), score)
        assert trial.reason
        assert trial.critical_gain == pytest.approx(score * after.discrepancy)
        ratios.append(trial.gain / after.discrepancy)
        tempting += trial.gain > score * max(after.scale, 1.0)
    assert tempting > 10  # if samples counted one by one
    assert 0.2 < np.median(ratios) < 1.2  # 60 of them tell a median to 0.14; if samples counted it would be above four
    assert sum(ratio > chi2.isf(LEVEL, 1) for ratio in ratios) <= 1


def test_a_large_effect_is_found_beside_a_discrepancy() -> None:
    for seed in range(10):
        about = imperfect(seed, RHO, effect=2.0)
        step = forward(about, calibrated_stand(about), [slow_effect(), slow_effect("t")])
        assert step.chosen is not None and step.chosen.names == ("s",)


def test_intervals_are_wider_beside_a_discrepancy() -> None:
    """Two standard deviations count, of a discrepancy that makes each four times as large as white noise would."""
    about, effect = imperfect(3, RHO), slow_effect()
    after = fit_model(about, effect.add(calibrated_stand(about).model), (effect,))
    assert after is not None
    j = after.solution.problem.where.names.index("s")
    sigma = math.sqrt(float(after.solution.covariance[j, j]) * after.discrepancy)
    assert after.discrepancy > 4**2 * max(1.0, 0.1 * after.scale)
    for times, is_one in ((1.9, False), (2.1, True), (-2.1, True)):
        x = after.solution.x.copy()
        x[j] = times * sigma
        moved = dataclasses.replace(after, solution=dataclasses.replace(after.solution, x=x))
        vars(moved)["discrepancy"] = after.discrepancy
        assert is_determined(moved, effect) is is_one


# --- critical values --------------------------------------------------------------------------------------------------


def test_freedom_of_further_initial_conditions_is_no_evidence() -> None:
    """With the effect come five columns for each run, which explain what chance gives: as much as there are."""
    about, more = task({}), 5

    def shapes(observation: Any) -> tuple[Array, Array]:
        free = np.random.default_rng(len(observation.name)).standard_normal((N, more))
        return np.column_stack([np.ones(N), free]), np.full(1 + more, math.inf)

    def prepared(of: EstimationTask, model: Any) -> EstimationTask:
        if "d" not in {p.name for p in model.parameters()}:
            return of
        return dataclasses.replace(of, identify=of.identify.with_shapes(shapes, None))

    about = dataclasses.replace(about, prepared=prepared)
    before, effect = calibrated_stand(about), candidate("d", signed=True)
    after = fit_model(about, effect.add(before.model), (effect,))
    assert after is not None
    trial = compare(about, before, after, ("d",), 20.0)
    fall = before.fitted_chi2 - after.fitted_chi2
    assert fall == pytest.approx(3 * more, abs=4 * math.sqrt(2 * 3 * more))
    assert trial.gain == pytest.approx(fall - 3 * more, abs=1e-6)


# --- pairs ------------------------------------------------------------------------------------------------------------


def trial_of(names: tuple[str, ...], total: float, error: float) -> Any:
    """What is asked of a trial when the best is chosen."""
    fit = SimpleNamespace(bic=lambda discrepancy: total, discrepancy=1.0, exceeds_noise=False)
    return SimpleNamespace(names=names, fit=fit, error=error, critical_gain=20.0, reason="", is_small=False)


def test_trials_are_ranked_at_one_discrepancy() -> None:
    """A trial that explains more is not behind because its residual drifts and its own discrepancy is large."""

    def made(cost: float, discrepancy: float) -> Any:
        return SimpleNamespace(fit=SimpleNamespace(bic=lambda c: cost + 3 * math.log(N) * c, discrepancy=discrepancy))

    drifting, rough = made(2.48e6, 77_000.0), made(3.36e6, 3_600.0)
    assert drifting.fit.bic(77_000.0) > rough.fit.bic(3_600.0)  # each at its own: the other way round
    assert rank([rough, drifting]) == [drifting, rough]


def test_a_pair_must_beat_the_best_single_on_both_kinds_of_runs() -> None:
    about, single = dataclasses.replace(task({}), noise_rms=1.0), trial_of(("a",), 1000.0, 3.0)
    # Mean squares above the floor: 8 with the single one; a third of it is 2.7.
    for total, error, wins in ((970.0, 1.9, True), (970.0, 1.95, False), (990.0, 1.5, False), (970.0, 3.1, False)):
        pair = trial_of(("a", "b"), total, error)
        assert (explained_share(3.0, error, about.noise_rms) >= large_share()) is (error <= 1.91)
        assert best_of(about, [single, pair]) is (pair if wins else single)
    assert best_of(about, [pair]) is pair
    none = dataclasses.replace(about, validate=Dataset([], ColouredNoise(Process.white(SIGMA)), offset))
    assert best_of(none, [single, trial_of(("a", "b"), 970.0, 3.1)]).names == ("a", "b")  # type: ignore[union-attr]


def test_a_second_effect_that_only_the_fitted_runs_show_comes_with_no_first() -> None:
    """Both act on the runs that were fitted, and only one on those kept apart: it is added alone."""
    both = {"d": 0.4, "e": 0.25}
    for held, names in ((both, {"d", "e"}), ({"d": 0.4}, {"d"})):
        about = task(both, held=held)
        step = forward(about, calibrated_stand(about), effects())
        assert ("d", "e") in reasons(step) or ("e", "d") in reasons(step)
        assert step.chosen is not None and {*step.chosen.names} == names


def test_a_discrepancy_divides_what_the_runs_say_and_no_prior() -> None:
    """What a model lacks makes a misfit coloured noise; how well its parameters were known beforehand it leaves."""
    own = 2.0 - 5 * 0.1  # the runs hold p = 2
    fit = calibrated_stand(task({}, p=(own, 0.1)))
    prior = (fit.solution.problem.where.values(fit.solution.x)["p"] - own) / 0.1
    assert prior == pytest.approx(5.0, abs=0.5)
    assert fit.bic(7.0) - fit.bic(1.0) == pytest.approx(6 * prior**2, rel=1e-6)


# --- ends of ranges ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("tolerance", "rest", "relevant"), [(0.5, 0.0, []), (0.1, 0.0, ["d.more"]), (0.1, 0.5, ["d.more"]), (0.1, 1.2, [])]
)
def test_an_end_is_relevant_where_its_number_moves_a_prediction(
    tolerance: float, rest: float, relevant: list[str]
) -> None:
    """A factor e on half a strength of 0.2 to 0.3 moves the prediction by 0.17 to 0.26; the strength may end nowhere.

    That is less than a twentieth, in squares, of what the fit leaves where 1.2 of another column remain.
    """

    def shape(v: Any, run: Any) -> Array:
        return np.asarray(v["d"] * (column(run, "d") + v["d.more"] * column(run, "other")))

    more = parameter("d.more", 1.0, 0.5, 5e6, scale="log")
    added = Candidate("d", lambda m: as_sum(m).plus(shape, strength("d"), more), "d", ("d", "d.more"), ({"d": 0.1},))
    about = task({"d": 0.3, "rest": rest}, tolerance=tolerance)
    found = fit_with(about, [added])
    assert found.at_bound() == ["d.more"]
    assert relevant_ends(about, found) == relevant
    narrow = dataclasses.replace(added, add=lambda m: as_sum(m).plus(shape, strength("d", 0.1, 0.0, 0.2), more))
    assert "d" in relevant_ends(about, fit_with(about, [narrow]))
