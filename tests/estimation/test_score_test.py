"""Screening beside fits that are written out: what is promised, what chance makes, phases, and what can be imitated."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from scipy.stats import binom, chi2

from flexdesign.estimation.criterion import LARGE, LEVEL, significant_deviation
from flexdesign.estimation.least_squares.dataset import SIMULATION_ROUNDING, Dataset
from flexdesign.estimation.least_squares.levenberg_marquardt import Solution, linearise, solve
from flexdesign.estimation.least_squares.residual_function import Problem, coordinates
from flexdesign.estimation.model_selection.score_test import (
    Candidate,
    Screening,
    score_of_columns,
)
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process, Whitening
from tests.estimation.sums import (
    NAMES,
    N,
    Shape,
    Sum,
    as_sum,
    base,
    candidate,
    column,
    columns,
    least,
    offset,
    strength,
)
from tests.estimation.toys import Array, Run, parameter

SLOW = Process.from_coefficients(np.array([1.0, -0.9]), 0.3)


def runs(data: Callable[[Run], Array], names: Sequence[str] = NAMES, n: int = N) -> list[Run]:
    blank = [Run(name, np.arange(n) / n, np.zeros(n)) for name in names]
    return [dataclasses.replace(run, data=data(run)) for run in blank]


def data_of(observed: Sequence[Run], of: Whitening) -> Array:
    return np.concatenate([of.whiten(run, run.data[:, None])[:, 0] for run in observed])


def solution(model: Sum, observed: Sequence[Run], of: Whitening, **known: tuple[float, float]) -> Solution:
    """A fit that begins where linear algebra ends, so that no tolerance of a search is left in it."""
    names = [p.name for p in model.parameters()]
    matrix, right = columns(model, observed, names, of), data_of(observed, of)
    rows = [[0.0] * len(observed) + [float(n == name) / sigma for n in names] for name, (_, sigma) in known.items()]
    matrix = np.vstack([matrix, *rows]) if rows else matrix
    right = np.append(right, [middle / sigma for middle, sigma in known.values()])
    best = np.asarray(np.linalg.lstsq(matrix, right)[0][len(observed) :], dtype=np.float64)
    begun = model.replace(dict(zip(names, best, strict=True)))
    found = solve(Problem(Dataset(observed, of, offset), begun, coordinates(begun, names, known)), best)
    assert found is not None
    return found


# --- what is tried --------------------------------------------------------------------------------------------------


def bump(v: Mapping[str, float], run: Any) -> Array:
    """A strength times a bell in time."""
    return np.asarray(v["x"] * np.exp(-(((run.t - v["middle"]) / v["width"]) ** 2)))


@pytest.mark.parametrize("hidden", [(i, j) for i in range(5) for j in range(4)])
def test_the_best_point_of_a_grid_in_two_numbers_is_found(hidden: tuple[int, int]) -> None:
    middles, widths = (0.1, 0.3, 0.5, 0.7, 0.9), (0.1, 0.15, 0.2, 0.3)
    numbers = (strength("x"), parameter("middle", 0.5, 0.0, 1.0), parameter("width", 0.2, 0.01, 1.0))
    trials = tuple({"x": 0.01, "middle": m, "width": w} for m in middles for w in widths)
    wanted = Candidate("x", lambda model: as_sum(model).plus(bump, *numbers), "x", ("x", "middle", "width"), trials)
    truth = {"x": 1.0, "middle": middles[hidden[0]], "width": widths[hidden[1]]}
    observed = runs(lambda run: bump(truth, run))
    screening = Screening(solution(base("p"), observed, ColouredNoise(Process.white(0.1))), [wanted])
    assert [d.values for d in screening.directions] == list(trials)
    (best,) = screening.best()
    assert {**best[0].values, "x": 1.0} == truth
    assert [d.predicted_reduction for d in best] == sorted((d.predicted_reduction for d in best), reverse=True)
    assert wanted.hidden == ("middle", "width")


@pytest.mark.parametrize("power", [1, 2])
def test_a_large_move_is_made_smaller(power: int) -> None:
    """Base numbers imitate most of it, by a strength or by its square: to first order they must still do so."""

    def large(v: Mapping[str, float], run: Any) -> Array:
        return np.asarray(v["x"] ** power * (50 * column(run, "p") + 5 * column(run, "x")))

    wanted = Candidate("x", lambda model: as_sum(model).plus(large, strength("x")), "x", ("x",), ({"x": 1.0},))
    observed = runs(lambda run: column(run, "x"))
    (found,) = Screening(solution(base("p"), observed, ColouredNoise(Process.white(1.0))), [wanted]).directions
    whole = np.concatenate([run - run.mean() for run in (large({"x": 1.0}, run) for run in observed)])
    rows = len(whole) + len(NAMES)  # an offset of each run is a row of its own
    scale = significant_deviation() / math.sqrt(np.sum(whole**2) / rows)
    assert found.values["x"] == pytest.approx(scale, rel=1e-9)
    assert np.sum(found.move**2) == pytest.approx(scale ** (2 * power) * np.sum(whole**2), rel=1e-9)
    if power == 1:  # then the promise does not hang on the trial
        small = dataclasses.replace(wanted, trials=({"x": 1e-3},))
        (alone,) = Screening(solution(base("p"), observed, ColouredNoise(Process.white(1.0))), [small]).directions
        assert found.predicted_reduction == pytest.approx(alone.predicted_reduction, rel=1e-9)
        assert found.start["x"] == pytest.approx(alone.start["x"], rel=1e-9)


# --- promises -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("of", [ColouredNoise(Process.white(0.3)), ColouredNoise(SLOW)], ids=["white", "slow"])
def test_a_promise_is_the_fall_of_the_cost(of: Whitening) -> None:
    """Where all is linear the score statistic is exact, whatever the trial's strength."""
    rng = np.random.default_rng(0)
    model = base("p", "q")
    observed = runs(lambda run: 2 * column(run, "p") + 0.3 * column(run, "x") + 0.3 * rng.standard_normal(N))
    found = [candidate("x", trial=0.02), candidate("y", {"x": 0.5, "p": 2.0, "y": 1.0}, trial=5.0, signed=True)]
    screening = Screening(solution(model, observed, of), found)
    before = columns(model, observed, ["p", "q"], of)
    right = data_of(observed, of)
    for effect in found:
        (direction,) = [d for d in screening.directions if d.candidate is effect]
        with_it = columns(as_sum(effect.add(model)), observed, ["p", "q", effect.name], of)
        fall = least(before, right) - least(with_it, right)
        best_step = np.linalg.lstsq(with_it, right)[0][-1]
        assert direction.predicted_reduction == pytest.approx(fall, rel=1e-3)  # slopes by forward differences
        assert direction.start[effect.name] == pytest.approx(best_step, rel=1e-3)


@pytest.mark.parametrize("away", [0.0, 0.2, 20.0])
def test_a_promise_does_not_count_what_the_model_explains_by_itself(away: float) -> None:
    """A search may end far from the minimum. What the parameters of the model would explain there is of no effect."""
    rng, of = np.random.default_rng(5), ColouredNoise(Process.white(0.3))
    model, effect = base("p", "q"), candidate("x", {"x": 0.3, "p": 2.0}, signed=True)
    observed = runs(lambda run: 2 * column(run, "p") + 0.3 * column(run, "x") + 0.3 * rng.standard_normal(N))
    at_minimum = solution(model, observed, of)
    there = linearise(at_minimum.problem, at_minimum.x + away)
    assert there is not None
    before, right = columns(model, observed, ["p", "q"], of), data_of(observed, of)
    both = columns(as_sum(effect.add(model)), observed, ["p", "q", "x"], of)
    fall = least(before, right) - least(both, right)
    assert (there.cost > at_minimum.cost + 100) is (away > 0)
    (direction,) = Screening(there, [effect]).directions
    assert direction.predicted_reduction == pytest.approx(fall, rel=2e-3)
    score = score_of_columns(there, [column(run, "x")[:, None] for run in observed])
    assert score == pytest.approx(
        score_of_columns(at_minimum, [column(run, "x")[:, None] for run in observed]), rel=1e-3
    )


def test_what_was_known_of_a_number_limits_what_it_can_imitate() -> None:
    """An effect that is the gain over again: the harder the gain is held, the more of it is the effect's own."""
    rng = np.random.default_rng(1)
    observed = runs(lambda run: 1.5 * column(run, "p") + 0.1 * rng.standard_normal(N))
    twin, of = candidate("twin", {"p": 1.0}), ColouredNoise(Process.white(0.1))
    assert not Screening(solution(base("p"), observed, of), [twin]).directions
    held = solution(base("p"), observed, of, p=(1.0, 0.01))
    (direction,) = Screening(held, [twin]).directions
    # With it the gain goes back to its prior, and what that cost is what is promised.
    free = solution(base("p"), observed, of)
    assert direction.predicted_reduction == pytest.approx(held.cost - free.cost, rel=1e-3)


def test_a_pair_promises_what_both_together_bring() -> None:
    rng = np.random.default_rng(2)
    model, of = base("p"), ColouredNoise(Process.white(0.5))
    observed = runs(lambda run: column(run, "x") - 0.5 * column(run, "y") + 0.5 * rng.standard_normal(N))
    pair = [candidate("x", signed=True), candidate("y", {"x": 1.0, "y": 1.0}, signed=True)]
    ((predicted_gain, a, b),) = Screening(solution(model, observed, of), pair).pairs()
    assert {a.candidate.name, b.candidate.name} == {"x", "y"}
    both = as_sum(pair[1].add(pair[0].add(model)))
    right = data_of(observed, of)
    fall = least(columns(model, observed, ["p"], of), right) - least(
        columns(both, observed, ["p", "x", "y"], of), right
    )
    assert predicted_gain == pytest.approx(fall, rel=1e-3)


def test_a_strength_of_the_wrong_sign_promises_nothing() -> None:
    observed, of = runs(lambda run: -column(run, "x")), ColouredNoise(Process.white(0.1))
    one = Screening(solution(base("p"), observed, of), [candidate("x")])
    assert one.directions[0].predicted_reduction == 0
    assert one.best() == []
    either = Screening(solution(base("p"), observed, of), [candidate("x", signed=True)])
    assert either.directions[0].start["x"] == pytest.approx(-1.0, rel=1e-3)
    assert [[d.candidate.name for d in ds] for ds in either.best()] == [["x"]]


@pytest.mark.parametrize(("size", "is_far"), [(0.95 * LARGE, False), (1.05 * LARGE, True), (-0.05, True)])
def test_a_strength_beyond_twice_its_plausible_range_promises_nothing(size: float, is_far: bool) -> None:
    observed = runs(lambda run: size * column(run, "x"))
    found = Screening(
        solution(base("p"), observed, ColouredNoise(Process.white(0.01))), [candidate("x", between=(0.0, 1.0))]
    )
    (direction,) = found.directions
    assert direction.values["x"] * direction.best_step == pytest.approx(size, rel=1e-3)
    assert (direction.predicted_reduction == 0) is is_far


def test_an_effect_with_a_threshold_is_found_by_its_grid() -> None:
    """A limit at infinity has no slope. Of the limits that are tried the one next to the truth promises most."""

    def clipped(v: Mapping[str, float], run: Any) -> Array:
        ramp = 3 * run.t
        return np.minimum(ramp, v["cap"]) - ramp

    number = parameter("cap", math.inf, 0.1, 10.0, null=math.inf, scale="inverse")
    cap = Candidate(
        "cap",
        lambda model: as_sum(model).plus(clipped, number),
        "cap",
        ("cap",),
        tuple({"cap": c} for c in (0.5, 1.0, 1.5, 2.0, 2.5)),
        has_own_trials=True,
    )
    model = Sum().plus(lambda v, run: v["k"] * run.t, strength("k", 3.0))
    observed = runs(lambda run: np.minimum(3 * run.t, 1.6))
    screening = Screening(solution(model, observed, ColouredNoise(Process.white(0.01))), [cap, candidate("x")])
    best = screening.best()[0]
    assert best[0].candidate is cap
    assert best[0].start == {"cap": 1.5}
    assert [d.predicted_reduction for d in best] == sorted((d.predicted_reduction for d in best), reverse=True)


def test_what_base_numbers_imitate_gives_no_direction() -> None:
    """Nor does what an offset imitates, what has no influence, and what fails."""
    observed = runs(lambda run: column(run, "p"))

    def bad(v: Mapping[str, float], run: Any) -> Array:
        raise ZeroDivisionError

    def constant(v: Mapping[str, float], run: Any) -> Array:
        return np.full(len(run.t), v["constant"])

    def wild(v: Mapping[str, float], run: Any) -> Array:
        return np.where(run.t > 0.5, np.nan, v["wild"])

    def of(name: str, shape: Shape) -> Candidate:
        return Candidate(
            name, lambda model: as_sum(model).plus(shape, strength(name)), name, (name,), ({name: 1.0},), signed=True
        )

    every = [
        candidate("mixture", {"p": 1.0, "q": -2.0}),
        candidate("nearly", {"p": 1.0, "x": 0.1 * math.sqrt(SIMULATION_ROUNDING)}),
        candidate("idle", {"x": 0.0}),
        of("constant", constant),
        of("bad", bad),
        of("wild", wild),
        candidate("hardly", {"p": 1.0, "x": 10 * math.sqrt(SIMULATION_ROUNDING)}),
    ]
    screening = Screening(solution(base("p", "q"), observed, ColouredNoise(Process.white(0.1))), every)
    assert [d.candidate.name for d in screening.directions] == ["hardly"]


# --- a sinusoid -----------------------------------------------------------------------------------------------------


def hum(frequency: float = 5.0) -> Candidate:
    def shape(v: Mapping[str, float], run: Any) -> Array:
        phase = v[f"{run.name}:hum.phase"]
        return v["hum.size"] * np.sin(2 * math.pi * v["hum.frequency"] * run.t + phase)

    numbers = [strength("hum.size", 0.0, 0.0, 10.0), parameter("hum.frequency", frequency, 1.0, 20.0)]
    phases = [parameter(f"{n}:hum.phase", 0.0, -math.pi, math.pi, si="rad", unit="rad", run=n) for n in NAMES]
    trials = tuple({"hum.size": 0.1, "hum.frequency": f} for f in (frequency, 7.0))
    return Candidate(
        "hum",
        lambda model: as_sum(model).plus(shape, *numbers, *phases),
        "hum.size",
        ("hum.size", "hum.frequency"),
        trials,
        "hum.phase",
    )


def test_a_sinusoid_has_a_phase_in_each_run() -> None:
    """The fall is that of a sine and a cosine in each run; less what as many columns do by chance."""
    rng, phases = np.random.default_rng(3), dict(zip(NAMES, (0.3, 2.5, -2.0), strict=True))
    observed = runs(
        lambda run: column(run, "p") + 0.5 * np.sin(10 * math.pi * run.t + phases[run.name]) + rng.normal(0, 0.1, N)
    )
    of = ColouredNoise(Process.white(0.1))
    screening = Screening(solution(base("p"), observed, of), [hum()])
    best = screening.best()[0][0]
    before = columns(base("p"), observed, ["p"], of)
    waves = []
    for i in range(len(observed)):
        for wave in (np.sin, np.cos):
            parts = [wave(10 * math.pi * run.t) / 0.1 * (k == i) for k, run in enumerate(observed)]
            waves.append(np.concatenate(parts))
    right = data_of(observed, of)
    fall = least(before, right) - least(np.column_stack([before, *waves]), right)
    assert best.columns == 6
    assert best.predicted_reduction == pytest.approx(fall - (chi2.isf(LEVEL, 6) - chi2.isf(LEVEL, 1)), rel=1e-3)
    # A phase is known to sigma / size * root of 2 / N, which is 0.037; four times that.
    assert {n: best.start[f"{n}:hum.phase"] for n in NAMES} == pytest.approx(phases, abs=0.15)
    assert best.start["hum.frequency"] == 5.0
    assert best.start["hum.size"] == pytest.approx(0.5, abs=4 * 0.1 * math.sqrt(2 / (3 * N)))


# --- chance ---------------------------------------------------------------------------------------------------------


def catalogue(seed: int, count: int, shared: float, signed: bool | None = None) -> list[Candidate]:
    """Effects that have a column in common; unless it is said, every other one can have one sign only."""
    return [
        candidate(
            f"{seed}.{i}", {f"{seed}": shared, f"{seed}.{i}": 1.0}, signed=i % 2 == 0 if signed is None else signed
        )
        for i in range(count)
    ]


@pytest.mark.parametrize("level", [0.01, LEVEL])
@pytest.mark.parametrize("signed", [True, False, None])
def test_the_largest_score_exceeds_its_critical_value_as_often_as_asked(signed: bool | None, level: float) -> None:
    """With 40 000 draws of noise, the scores by a projection of their own; the mean over 16 seeds of the threshold.

    A threshold of n draws has a level p uncertain by the root of p / n; four times that over 16 of them, with the draws
    of the test, is the tolerance. The cosines between effects are 0.96: if they were taken as independent, the level
    would be half as large.
    """
    of, found = ColouredNoise(Process.white(1.0)), catalogue(0, 12, 5.0, signed)
    observed = runs(lambda run: np.zeros(N))
    screening = Screening(solution(base("p"), observed, of), found)
    moves = np.array([d.move for d in screening.directions])
    jacobian = np.concatenate([part.matrix for part in screening.solution.jacobian])
    projected_norm2 = moves - (jacobian @ np.linalg.lstsq(jacobian, moves.T)[0]).T
    projected_norm2 /= np.linalg.norm(projected_norm2, axis=1, keepdims=True)
    scores = np.random.default_rng(9).standard_normal((40_000, projected_norm2.shape[1])) @ projected_norm2.T
    one_sided = np.array([not d.candidate.signed for d in screening.directions])
    largest = (np.where(one_sided, np.maximum(scores, 0), scores) ** 2).max(axis=1)
    share = np.mean([np.mean(largest > screening.critical_value(level, seed=seed)) for seed in range(16)])
    of_threshold, of_draws = level / math.sqrt(16 * 10), math.sqrt(level / 40_000)
    assert share == pytest.approx(level, abs=4 * math.hypot(of_threshold, of_draws))


def test_chance_holds_for_whole_screenings() -> None:
    """Of 500 records of noise, each with a catalogue of its own, as many as a binomial with 0.01 allows.

    Its ends at 1 in 1000 are none and 13, which rules out a threshold that is too low; one too high is for the test
    before to find. The threshold of a single effect lets more through.
    """
    rng, of, larger, alone = np.random.default_rng(4), ColouredNoise(Process.white(1.0)), 0, 0
    for seed in range(500):
        observed = runs(lambda run: rng.standard_normal(N), NAMES[:1])
        screening = Screening(solution(base("p"), observed, of), catalogue(seed, 6, 2.0))
        most = max((d.predicted_reduction for d in screening.directions), default=0.0)
        larger += most > screening.critical_value(0.01, seed)
        alone += most > chi2.isf(0.01, 1)
    assert binom.ppf(1e-3, 500, 0.01) <= larger <= binom.ppf(1 - 1e-3, 500, 0.01)
    assert alone > binom.ppf(1 - 1e-3, 500, 0.01)


def test_without_effects_chance_is_that_of_one() -> None:
    screening = Screening(
        solution(base("p"), runs(lambda run: column(run, "p")), ColouredNoise(Process.white(1.0))), []
    )
    assert screening.critical_value(0.01) == pytest.approx(chi2.isf(0.01, 1))
    assert screening.best() == []
    assert screening.pairs() == []


def test_the_score_of_columns_is_by_how_much_a_linear_fit_with_them_falls() -> None:
    """Each record has amounts of its own; a record without columns has none."""
    noise = ColouredNoise({name: SLOW for name in NAMES})
    observed = runs(lambda run: column(run, "data") + 0.5 * column(run, "added"))
    found = solution(base("p", "q"), observed, noise)
    added: list[Array | None] = [np.column_stack([column(r, "added"), column(r, "more")]) for r in observed]
    added[1] = None
    matrix = columns(base("p", "q"), observed, ["p", "q"], noise)
    more = np.zeros((len(matrix), 4))
    more[:N, :2] = noise.whiten(observed[0], np.asarray(added[0]))
    more[2 * N :, 2:] = noise.whiten(observed[2], np.asarray(added[2]))
    data = data_of(observed, noise)
    fall = least(matrix, data) - least(np.hstack([matrix, more]), data)
    assert score_of_columns(found, added) == pytest.approx(fall, rel=1e-6)
    assert score_of_columns(found, [None] * 3) == 0.0
