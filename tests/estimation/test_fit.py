"""Fits of formulas whose answer is known: what is recovered, how often intervals hold it, and what is refused."""

from __future__ import annotations

import dataclasses
import math
import threading
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from scipy.optimize import curve_fit
from scipy.stats import norm
from scipy.stats import t as student

from flexdesign.core.errors import InputError
from flexdesign.core.model import Observation
from flexdesign.estimation import Fit, fit
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.least_squares.multistart import multistart
from flexdesign.estimation.least_squares.residual_function import Problem, coordinates
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process
from tests.estimation.toys import OSCILLATION, TRUTH, Array, Run, Toy, ar1, oscillation, parameter, run

T = np.linspace(0, 3, 400)


def noisy(toy: Toy, truth: Mapping[str, float], sigma: float, seed: int = 1, t: Array = T, name: str = "run") -> Run:
    return run(toy, truth, t, sigma * np.random.default_rng(seed).standard_normal(len(t)), name)


def sigma(found: Fit, name: str) -> float:
    """The standard deviation of a value that is determined."""
    deviation = found[name].sigma
    assert deviation is not None
    return deviation


def offset(observation: Observation) -> tuple[Array, Array]:
    return np.ones((len(observation.measured()), 1)), np.array([math.inf])


def without(values: Array, *columns: Array) -> Array:
    """What no amounts of some columns explain."""
    matrix = np.column_stack(columns)
    return np.asarray(values - matrix @ np.linalg.lstsq(matrix, values)[0])


# --- recovery -----------------------------------------------------------------------------------------------------


def test_parameters_are_recovered_without_noise() -> None:
    """Differences move the response by 1e-3, so that the minimum is exact to rounding over that."""
    found = fit(OSCILLATION, [run(OSCILLATION, TRUTH, T, 0.7)], list(TRUTH))
    assert found.values == pytest.approx(TRUTH, rel=1e-9)
    assert found.rms[0] < 1e-6 * np.std(oscillation(TRUTH, T))
    assert found.model.predict(Run("again", T, None)) == pytest.approx(oscillation(TRUTH, T), abs=1e-8)


@pytest.mark.parametrize("constants", [{"k": 0.02, "m": 40.0}, {"k": 3e-3, "m": 0.9}])
def test_decay_constants_decades_apart_are_recovered(constants: dict[str, float]) -> None:
    """Started an order of magnitude off; sampled as its logarithm so that every decade gets its share."""
    formula = lambda v, t: v["p"] * np.exp(-v["k"] * t) + np.exp(-v["m"] * t)  # noqa: E731
    toy = Toy(
        formula,
        (
            parameter("p", 1.0, 0.1, 10.0),
            parameter("k", 0.3, 1e-3, 0.5, scale="log"),
            parameter("m", 3.0, 0.6, 1e3, scale="log"),
        ),
    )
    times = np.geomspace(1e-3, 1e3, 300)
    truth = {"p": 2.0, **constants}
    found = fit(toy, [noisy(toy, truth, 1e-3, t=times)], list(truth))
    for name, number in truth.items():
        assert abs(found.values[name] - number) < 4 * sigma(found, name)  # 4 sigma: once in 16 000
        assert sigma(found, name) < 0.01 * number


def test_several_runs_have_offsets_of_their_own() -> None:
    runs = [run(OSCILLATION, TRUTH, T, offset, f"run {offset}") for offset in (-3.0, 0.0, 5.0)]
    found = fit(OSCILLATION, runs, list(TRUTH))
    assert found.values == pytest.approx(TRUTH, rel=1e-9)
    assert max(found.rms) < 1e-6


def test_gaps_are_left_out() -> None:
    observed = run(OSCILLATION, TRUTH, T, 0.5)
    observed.data[::7] = np.nan
    found = fit(OSCILLATION, [observed], list(TRUTH))
    assert found.values == pytest.approx(TRUTH, rel=1e-8)


def test_a_single_start_gets_stuck_where_several_do_not() -> None:
    """A tone of many periods: the cost has a minimum for every period more or less, all but one of them false."""
    tone = Toy(
        lambda v, t: v["a"] * np.sin(2 * np.pi * v["f"] * t),
        (parameter("a", 1.0, 0.1, 10.0), parameter("f", 2.0, 0.5, 8.0, si="Hz", unit="Hz")),
    )
    observed = noisy(tone, {"a": 2.0, "f": 5.3}, 0.1)
    stuck = fit(tone, [observed], ["a", "f"], starts=1)
    assert abs(stuck.model.values()["f"] - 5.3) > 1.0  # type: ignore[attr-defined]
    assert stuck.starts.is_unconfirmed and "nothing confirms" in str(stuck.starts)
    found = fit(tone, [observed], ["a", "f"])
    assert found["f"].value == pytest.approx(5.3, abs=4 * sigma(found, "f"))
    assert found.rms[0] ** 2 < 0.1 * stuck.rms[0] ** 2
    assert found.starts.converged >= 2 and not found.starts.is_unconfirmed
    assert f"{found.starts.converged} of {found.starts.refined} starts" in str(found.starts)


def test_a_better_point_met_while_checking_intervals_is_taken() -> None:
    """3.8 (x^2 - 1)^2 + (x - 1)^2 / 4 has a minimum of 1 near -1, where a fit gets stuck, and one of 0 at 1.

    The hill between them is low enough for the profile to walk over, beneath noise of variance one that is orthogonal
    to the model.
    """
    rng = np.random.default_rng(0)
    one, other, *_ = np.linalg.qr(np.column_stack([np.ones(40), rng.standard_normal((40, 2))]))[0].T[1:]
    noise = without(rng.standard_normal(40), np.ones(40), one, other)
    noise *= math.sqrt(38 / (noise @ noise))
    wells = Toy(
        lambda v, t: math.sqrt(3.8) * (v["x"] ** 2 - 1) * one + v["x"] / 2 * other, (parameter("x", -1.2, -5.0, 5.0),)
    )
    observed = [Run("two wells", T[:40], 0.5 * other + noise)]
    problem = Problem(
        Dataset(observed, ColouredNoise(Process.white(1.0)), offset), wells, coordinates(wells, ["x"], {})
    )
    (stuck,) = multistart(problem, 1, lambda _: None)[2]
    found = fit(wells, observed, ["x"], starts=1)
    assert stuck == pytest.approx([-1.0], abs=0.1)
    assert found.model.values()["x"] == pytest.approx(1.0, abs=1e-5)  # type: ignore[attr-defined]
    assert found.starts.is_unconfirmed


# --- intervals ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("correlated", [0.0, 0.9], ids=["white", "AR(1) 0.9"])
def test_intervals_hold_the_truth_as_often_as_they_say(correlated: float) -> None:
    """200 replicas. If 95 % is right, one parameter falls outside 90 to 99.5 % once in 800 times (binomial)."""
    replicas = 200
    held = dict.fromkeys(TRUTH, 0)
    for seed in range(replicas):
        noise = ar1(np.random.default_rng(seed), len(T), 0.2, correlated)
        found = fit(OSCILLATION, [run(OSCILLATION, TRUTH, T, noise)], list(TRUTH), starts=1)
        for estimate in found.estimates:
            assert estimate.determined and estimate.interval is not None
            held[estimate.name] += estimate.interval[0] <= TRUTH[estimate.name] <= estimate.interval[1]
    shares = np.array(list(held.values())) / replicas
    assert np.all(shares >= 0.90) and np.all(shares <= 0.995), held


def test_classical_intervals_would_not_hold_it_under_coloured_noise() -> None:
    """The check of the check: a slow parameter under AR(1) noise, whose classical interval is sqrt(19) too narrow.

    (1 + 0.9) / (1 - 0.9) = 19 samples count as one for what changes slowly; for the variance of the residual
    (1 + 0.81) / (1 - 0.81) = 9.5 do. Both are estimated from 4000 samples, to about a tenth.
    """
    ramp = Toy(lambda v, t: v["slope"] * t, (parameter("slope", 1.0, -10.0, 10.0),))
    t = np.linspace(0, 3, 4000)
    found = fit(ramp, [run(ramp, {"slope": 2.0}, t, ar1(np.random.default_rng(3), len(t), 0.1, 0.9))], ["slope"])
    classical = found.rms[0] / math.sqrt(np.sum((t - t.mean()) ** 2))
    assert sigma(found, "slope") / classical == pytest.approx(math.sqrt(19), rel=0.15)
    assert found.inflation[0] == pytest.approx(9.5, rel=0.25)
    low, high = found["slope"].interval or (0, 0)
    quantile = student.ppf(0.975, len(t) / found.inflation[0] - 2)
    assert high - low == pytest.approx(2 * quantile * sigma(found, "slope"), rel=1e-6)


def test_white_noise_gives_the_classical_covariance() -> None:
    """Against scipy's curve_fit with the offset as a parameter more; both differentiate numerically."""
    observed = noisy(OSCILLATION, TRUTH, 0.1, seed=2)  # 3 of 100 white residuals look coloured by chance; not this
    names = list(TRUTH)
    found = fit(OSCILLATION, [observed], names, starts=1)
    assert found.inflation[0] == 1.0

    def formula(t: Array, *p: float) -> Array:
        return oscillation(dict(zip(names, p[:-1], strict=True)), t) + p[-1]

    best, covariance = curve_fit(formula, T, observed.data, [*TRUTH.values(), 0.0])
    deviations = np.sqrt(np.diag(covariance))
    assert list(found.values.values()) == pytest.approx(best[:-1], abs=1e-3 * float(deviations.min()))
    assert [sigma(found, name) for name in names] == pytest.approx(deviations[:-1], rel=1e-3)
    quantile = student.ppf(0.975, len(T) - len(best))
    assert found["a"].interval == pytest.approx(
        (best[0] - quantile * deviations[0], best[0] + quantile * deviations[0]), rel=1e-4
    )
    low, high = np.exp(np.log(best[2]) + quantile * deviations[2] / best[2] * np.array([-1, 1]))  # zeta moves as log
    assert found["zeta"].interval == pytest.approx((low, high), rel=1e-3)
    # Coordinates are monotonic in the values, so that correlations agree to first order.
    assert found.correlation == pytest.approx((covariance / np.outer(deviations, deviations))[:-1, :-1], abs=2e-3)


# --- refusals -----------------------------------------------------------------------------------------------------

PAIR = (
    parameter("gain", 1.0, 0.1, 10.0, si="m/V", unit="um/V"),
    parameter("a", 1.0, 0.1, 10.0, si="m/V", unit="um/V"),
    parameter("drift", 0.0, -2.0, 2.0),
)
COMBINED = {
    "product": lambda a, b: a * b,
    "ratio": lambda a, b: a / b,
    "sum": lambda a, b: a + b,
    "difference": lambda a, b: a - b,
}


@pytest.mark.parametrize("scale", ["linear", "log"])
@pytest.mark.parametrize("relation", list(COMBINED))
def test_entangled_parameters_are_refused_and_their_relation_named(relation: str, scale: Any) -> None:
    every = tuple(dataclasses.replace(p, scale=scale) for p in PAIR[:2])
    combine = COMBINED[relation]
    toy = Toy(lambda v, t: combine(v["gain"], v["a"]) * np.sin(5 * t) + v["drift"] * t, (*every, PAIR[2]))
    observed = noisy(toy, {"gain": 3.0, "a": 0.7, "drift": 0.3}, 0.05)
    found = fit(toy, [observed], ["gain", "a", "drift"])
    assert found.undetermined == ("gain", "a") and found.values.keys() == {"drift"}
    assert found["gain"].reason == f"gain and a: only their {relation} shows in these runs"
    assert found["a"].reason == f"a and gain: only their {relation} shows in these runs"
    assert found["gain"].interval is None
    assert found["drift"].value == pytest.approx(0.3, abs=4 * sigma(found, "drift"))
    fitted = found.model.values()  # type: ignore[attr-defined]
    assert combine(fitted["gain"], fitted["a"]) == pytest.approx(combine(3.0, 0.7), rel=0.02)  # noise: 0.05 / 14 of 2.1


def test_two_entangled_pairs_are_told_apart() -> None:
    """The null space is spanned by any mixture of both; only the pairs are facts."""
    names = "pqrs"
    toy = Toy(
        lambda v, t: v["p"] * v["q"] * np.sin(5 * t) + v["r"] * v["s"] * t**2,
        tuple(parameter(name, 1.5, 0.1, 10.0, scale="log") for name in names),
    )
    found = fit(toy, [noisy(toy, {}, 0.05)], list(names))
    pairs = [estimate.reason.partition(":")[0] for estimate in found.estimates]
    assert pairs == ["p and q", "q and p", "r and s", "s and r"]


def test_what_is_known_breaks_an_entanglement() -> None:
    """The product shows: with one factor known to a tenth the other follows to a tenth; the first learns nothing."""
    toy = Toy(lambda v, t: v["gain"] * v["a"] * np.sin(5 * t), PAIR[:2])
    observed = noisy(toy, {"gain": 2.0, "a": 0.7}, 0.05)
    found = fit(toy, [observed], ["gain", "a"], known={"a": (0.7, 0.07)})
    assert found.undetermined == ("a",)
    assert "add nothing to the prior, 700 ± 70 mm/V" in found["a"].reason
    ends = np.array([1.0, -1.0]) * norm.ppf(0.975) * 0.1
    assert found["gain"].interval == pytest.approx(1.4 / 0.7 / (1 + ends), rel=0.02)  # noise and search: 1 % each


def test_what_is_known_is_combined_by_its_weight() -> None:
    """A height of 400 samples ± 0.2, so 1 ± 0.01, and the prior, 1.03 ± 0.01: the middle, ± 0.01 / sqrt(2)."""
    sign = np.resize([1.0, -1.0], len(T))
    height = Toy(lambda v, t: v["x"] * sign, (parameter("x", 0.0, -10.0, 10.0),))
    noise = without(np.random.default_rng(0).standard_normal(len(T)), np.ones(len(T)), sign)
    noise *= 0.2 * math.sqrt((len(T) - 2) / (noise @ noise))
    found = fit(height, [Run("height", T, sign + noise)], ["x"], known={"x": (1.03, 0.01)})
    assert found["x"].value == pytest.approx(1.015, abs=2e-4)  # the balance is struck to 2 %
    assert sigma(found, "x") == pytest.approx(0.01 / math.sqrt(2), rel=0.01)


@pytest.mark.parametrize("seed", range(3))
def test_similar_exponentials_get_no_numbers(seed: int) -> None:
    """Rates 1 and 1.3 under 2 % noise: Lanczos (1956, Applied Analysis, IV.23) shows how many pairs fit alike."""
    truth = {"A": 1.0, "k": 1.0, "B": 1.0, "m": 1.3}
    toy = Toy(
        lambda v, t: v["A"] * np.exp(-v["k"] * t) + v["B"] * np.exp(-v["m"] * t),
        tuple(parameter(name, start, 0.01, 10.0, scale="log") for name, start in truth.items()),
    )
    found = fit(toy, [noisy(toy, truth, 0.02, seed)], list(truth), starts=4)
    assert len(found.undetermined) >= 3
    for estimate in found.estimates:  # what is stated nevertheless is true
        if estimate.interval:
            assert estimate.interval[0] <= truth[estimate.name] <= estimate.interval[1], estimate
    assert found.rms[0] == pytest.approx(0.02, rel=4 / math.sqrt(2 * len(T)))  # yet the curve is matched


def test_values_that_may_be_exchanged_are_refused() -> None:
    toy = Toy(
        lambda v, t: np.exp(-v["k"] * t) + np.exp(-v["m"] * t),
        (parameter("k", 1.0, 0.1, 30.0, scale="log"), parameter("m", 9.0, 0.1, 30.0, scale="log")),
    )
    found = fit(toy, [noisy(toy, {"k": 0.5, "m": 6.0}, 0.01)], ["k", "m"])
    assert found.undetermined == ("k", "m")
    assert found["k"].reason.endswith("fit alike")


def test_a_value_at_its_bound_is_no_number() -> None:
    narrow = Toy(oscillation, tuple(_narrowed(p, "a", (0.1, 1.7)) for p in OSCILLATION.every))
    found = fit(narrow, [noisy(OSCILLATION, TRUTH, 0.1)], list(TRUTH))
    assert found.undetermined == ("a",) and found["a"].interval is not None
    assert found["a"].interval[1] == pytest.approx(1.7)
    assert "at least" in found["a"].reason and "upper end of what is plausible, 1.700 m" in found["a"].reason


def test_a_strength_that_is_not_told_from_zero_has_an_upper_limit() -> None:
    toy = Toy(
        lambda v, t: v["g"] * np.sin(5 * t) + v["s"] * t**2,
        (parameter("g", 1.0, 0.1, 10.0), parameter("s", 0.0, 0.0, 10.0, null=0.0)),
    )
    noise = 0.05 * np.random.default_rng(0).standard_normal(len(T))
    found = fit(toy, [run(toy, {"g": 2.0}, T, noise)], ["g", "s"])
    assert found.undetermined == ("s",)
    assert "at most" in found["s"].reason and "do not distinguish it from 0" in found["s"].reason
    low, high = found["s"].interval or (math.nan, math.nan)
    assert low == 0 and 0 < high < 0.01  # ± 0.05 over 400 samples of a parabola up to 9


def test_a_limit_that_the_runs_stay_below_has_a_lower_limit() -> None:
    """A bandwidth far above the sampling: its reciprocal has no slope at zero, yet a low bandwidth would show."""
    toy = Toy(
        lambda v, t: v["g"] * np.where(t > 0, -np.expm1(-np.where(t > 0, t, 1.0) * v["w"]), 0.0),
        (
            parameter("g", 1.0, 0.1, 10.0),
            parameter("w", 10.0, 1.0, math.inf, null=math.inf, scale="inverse", si="Hz", unit="Hz"),
        ),
    )
    found = fit(toy, [noisy(toy, {"g": 2.0, "w": 1e5}, 0.05)], ["g", "w"])
    assert found.undetermined == ("w",) and found["w"].interval is not None
    assert found["w"].interval[1] == math.inf and 10 < found["w"].interval[0] < 1e5
    assert found["w"].reason.startswith("at least") and found["w"].reason.endswith("do not distinguish it from inf Hz")
    slow = fit(toy, [noisy(toy, {"g": 2.0, "w": 5.0}, 0.05)], ["g", "w"])
    assert slow["w"].value == pytest.approx(5.0, abs=4 * sigma(slow, "w"))


def test_a_parameter_without_influence_is_refused() -> None:
    idle = Toy(oscillation, (*OSCILLATION.every, parameter("idle", 1.0, 0.0, 2.0)))
    found = fit(idle, [noisy(OSCILLATION, TRUTH, 0.1)], [*TRUTH, "idle"])
    assert found.undetermined == ("idle",) and found["idle"].reason == "does not show in these runs"
    assert found["idle"].value_text == found["idle"].interval_text == ""


def _narrowed(p: Any, name: str, plausible: tuple[float, float]) -> Any:
    return dataclasses.replace(p, plausible=plausible) if p.name == name else p


# --- behaviour ----------------------------------------------------------------------------------------------------


def test_the_same_data_give_the_same_result() -> None:
    observed = [noisy(OSCILLATION, TRUTH, 0.3)]
    first, second = (fit(OSCILLATION, observed, list(TRUTH)) for _ in range(2))
    assert first.estimates == second.estimates and first.values == second.values
    assert first.evaluations == second.evaluations


@pytest.mark.parametrize("failure", ["exception", "nan", "overflow", "refusal"])
def test_a_model_that_fails_at_some_values_is_survived(failure: str) -> None:
    failed = []

    def formula(v: Mapping[str, float], t: Array) -> Array:
        if v["f"] > 3.4:
            failed.append(v["f"])
            if failure == "exception":
                raise FloatingPointError("diverged")
            if failure == "refusal":
                raise InputError("toy", "f", v["f"], "is too fast")
            return np.full(len(t), np.nan) if failure == "nan" else np.exp(1e3 * np.ones(len(t)))
        return oscillation(v, t)

    found = fit(Toy(formula, OSCILLATION.every), [noisy(OSCILLATION, TRUTH, 0.1)], list(TRUTH))
    assert failed
    for name, number in TRUTH.items():
        assert found.values[name] == pytest.approx(number, abs=4 * sigma(found, name))


def test_a_model_that_fails_everywhere_is_said() -> None:
    hopeless = Toy(lambda v, t: np.full(len(t), np.nan), OSCILLATION.every)
    with pytest.raises(InputError, match="cannot be simulated"):
        fit(hopeless, [noisy(OSCILLATION, TRUTH, 0.1)], list(TRUTH))


def test_ctrl_c_passes_through_and_leaves_no_thread() -> None:
    calls = iter(range(40))

    def formula(v: Mapping[str, float], t: Array) -> Array:
        if next(calls, None) is None:
            raise KeyboardInterrupt
        return oscillation(v, t)

    before = threading.active_count()
    with pytest.raises(KeyboardInterrupt):
        fit(Toy(formula, OSCILLATION.every), [noisy(OSCILLATION, TRUTH, 0.1)], list(TRUTH))
    assert threading.active_count() == before


def test_progress_is_told() -> None:
    said: list[str] = []
    fit(OSCILLATION, [noisy(OSCILLATION, TRUTH, 0.1)], list(TRUTH), starts=2, progress=said.append)
    assert said[0].startswith("start 1 of 2") and said[-1] == "checking the intervals"


def test_estimates_carry_units() -> None:
    every = tuple(
        dataclasses.replace(p, plausible=(1e-7, 1e-5), start=1e-6) if p.name == "a" else p for p in OSCILLATION.every
    )
    micro = Toy(oscillation, every)
    found = fit(micro, [noisy(micro, {**TRUTH, "a": 2e-6}, 0.1e-6)], list(TRUTH))
    value, interval = found["a"].value_text, found["a"].interval_text
    assert value.endswith(" um") and found["a"].reason == ""
    assert float(value.split()[0]) == pytest.approx(found.values["a"] * 1e6, rel=1e-3)
    low, high = (float(end) for end in interval.removesuffix(" um").split(" to "))
    assert low < 2.0 < high


# --- bad input ----------------------------------------------------------------------------------------------------

GOOD = noisy(OSCILLATION, TRUTH, 0.1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"free": ["a", "zetta"]}, "did you mean zeta"),
        ({"free": []}, "one or more parameters"),
        ({"free": ["a", "a"]}, "each once"),
        ({"known": {"b": (1.0, 1.0)}}, "not a parameter"),
        ({"known": {"a": (1.0, 0.0)}}, "above zero"),
        ({"starts": 0}, "at least one start"),
        ({"observations": []}, "needs something that was measured"),
        ({"observations": [GOOD, GOOD]}, "given twice"),
        ({"observations": [dataclasses.replace(GOOD, role="validate")]}, "kept for validation"),
        ({"observations": [Run("run", T, np.full(len(T), np.nan))]}, "holds no finite value"),
        ({"observations": [Run("run", T, np.zeros(7))]}, "measured are (7,)"),
        ({"observations": [noisy(OSCILLATION, TRUTH, 0.1, t=T[:5])]}, "more samples"),
    ],
)
def test_bad_input_is_refused(arguments: dict[str, Any], message: str) -> None:
    chosen = {"observations": [GOOD], "free": list(TRUTH), **arguments}
    with pytest.raises(InputError) as refused:
        fit(OSCILLATION, chosen.pop("observations"), chosen.pop("free"), **chosen)
    assert message in str(refused.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scale": "log", "plausible": (-1.0, 1.0)}, "needs a range above zero"),
        ({"plausible": (1.0, 1.0)}, "range of a free parameter is empty"),
        ({"plausible": (-math.inf, math.inf), "start": None}, "needs a start"),
    ],
)
def test_a_parameter_that_cannot_be_moved_is_refused(change: dict[str, Any], message: str) -> None:
    every = (dataclasses.replace(OSCILLATION.every[0], **change), *OSCILLATION.every[1:])
    with pytest.raises(InputError, match=message):
        fit(Toy(oscillation, every), [GOOD], list(TRUTH))


def test_ranges_without_end_are_searched_about_the_present_value() -> None:
    endless = tuple(
        dataclasses.replace(p, plausible=(0.0, math.inf) if p.scale == "log" else (-math.inf, math.inf))
        for p in OSCILLATION.every
    )
    found = fit(Toy(oscillation, endless), [GOOD], list(TRUTH))
    assert found.values == pytest.approx(TRUTH, rel=0.05)
