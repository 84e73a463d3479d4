"""Selection on sums of random columns: right effects, right pairs, nothing in noise, and when it ends."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from flexdesign.core.model import parameter_of
from flexdesign.core.parallel_map import shared_pool
from flexdesign.diagnosis.effect_selection.estimation_setup import evaluate_design
from flexdesign.estimation.criterion import INDISTINGUISHABLE, LARGE, LEVEL, SHARE
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.model_selection import fitted_model, stepwise_selection
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel, fit_model, with_effects
from flexdesign.estimation.model_selection.forward_selection import (
    FINALISTS,
    GROSS_MISFIT,
    fit_roughly,
    forward,
    screen,
)
from flexdesign.estimation.model_selection.model_comparison import Step, compare, difference
from flexdesign.estimation.model_selection.score_test import Candidate, Screening
from flexdesign.estimation.model_selection.stepwise_selection import (
    backward,
    confusable,
    select,
)
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process
from tests.estimation.sums import (
    EFFECTS,
    HELD,
    NAMES,
    SIGMA,
    N,
    Sum,
    as_sum,
    calibrated_stand,
    candidate,
    column,
    columns,
    effects,
    fit_with,
    least,
    linear,
    offset,
    recorded,
    stage,
    strength,
    task,
)
from tests.estimation.toys import Array, Run, parameter

# --- forward --------------------------------------------------------------------------------------------------------


def test_the_right_one_of_six_is_added_and_nothing_after_it() -> None:
    about = task({"d": 0.3})
    before = calibrated_stand(about)
    step = forward(about, before, effects())
    assert step.chosen is not None and step.chosen.names == ("d",)
    assert step.alike == ()
    after = step.chosen.fit
    # 180 values with noise 0.1 tell a strength to 0.1 / root of 180; four times that.
    assert after.solution.problem.where.values(after.solution.x)["d"] == pytest.approx(
        0.3, abs=4 * SIGMA / math.sqrt(180)
    )
    assert forward(about, after, effects()).chosen is None


def test_gains_are_falls_of_the_cost() -> None:
    """By linear algebra, of the runs that were fitted; what validation runs leave is close to noise afterwards."""
    about = task({"d": 0.3})
    before = calibrated_stand(about)
    step = forward(about, before, effects())
    assert step.chosen is not None
    observed, noise = [record.observation for record in about.identify.records], ColouredNoise(Process.white(SIGMA))
    owns = [f"{name}:own" for name in NAMES]
    right = np.concatenate([run.measured() / SIGMA for run in observed])
    model = stage()
    with_it = candidate("d").add(model)
    assert isinstance(with_it, Sum)
    costs = [
        least(columns(model, observed, ["p", "q", *owns], noise), right),  # type: ignore[arg-type]
        least(columns(with_it, observed, ["p", "q", *owns, "d"], noise), right),  # type: ignore[arg-type]
    ]
    assert step.chosen.gain == pytest.approx(costs[0] - costs[1], rel=1e-3)
    kept = 2 * N
    # Six numbers were fitted elsewhere, two offsets and two own ones here; chi-squared to four standard errors.
    assert abs(step.chosen.fit.validation_chi2 - kept) < 4 * math.sqrt(2 * kept) + 10
    assert before.validation_chi2 - step.chosen.fit.validation_chi2 == pytest.approx(0.3**2 / SIGMA**2 * kept, rel=0.3)
    assert difference(about.validate, before.model, step.chosen.fit.model, {}) == pytest.approx(0.3, rel=0.2)
    assert step.chosen.error == pytest.approx(SIGMA, rel=0.3)


def test_trials_side_by_side_are_those_one_after_another() -> None:
    about = task({"a": 0.5, "c": 0.2})
    with shared_pool(2) as each:
        together = forward(dataclasses.replace(about, each=each), calibrated_stand(about), effects())
    alone = forward(about, calibrated_stand(about), effects())
    assert len(alone.trials) > 2
    assert [(t.names, t.fit.cost, t.reason) for t in together.trials] == [
        (t.names, t.fit.cost, t.reason) for t in alone.trials
    ]


def test_two_effects_are_found_one_after_the_other() -> None:
    about = task({"b": 0.3, "e": -0.2})
    fit, found = calibrated_stand(about), list[str]()
    while (step := forward(about, fit, effects())).chosen is not None:
        fit, found = step.chosen.fit, [*found, *step.chosen.names]
    assert sorted(found) == ["b", "e"]


def test_a_pair_that_shows_only_together_is_found() -> None:
    """Two effects that nearly cancel: what either explains alone is small, and of the wrong sign for one."""
    one, two = candidate("a", {"g": 3.0, "h": 0.5}), candidate("b", {"g": -3.0, "h": 0.5})
    about = task({"h": 0.15})
    step = forward(about, calibrated_stand(about), effects(a=one, b=two))
    assert step.chosen is not None and set(step.chosen.names) == {"a", "b"}
    values = step.chosen.fit.solution.problem.where.values(step.chosen.fit.solution.x)
    assert [values["a"], values["b"]] == pytest.approx([0.15, 0.15], abs=0.06)  # sigma of each is 0.015


def test_of_similar_effects_the_better_one_is_taken_next_to_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pairs are proposed by their score: here only one with an effect that resembles the right one."""
    proposed = Screening.pairs

    def with_the_similar_one(screening: Screening, most: int) -> list[Any]:
        found = proposed(screening, 100)
        return [pair for pair in found if {pair[1].candidate.name, pair[2].candidate.name} == {"d", "e"}]

    monkeypatch.setattr(Screening, "pairs", with_the_similar_one)
    about = task({"b": 0.5, "e": -0.5})
    similar = candidate("d", {"b": 1.0, "d": 0.3}, signed=True)
    step = forward(about, calibrated_stand(about), effects(d=similar))
    assert step.chosen is not None and set(step.chosen.names) == {"b", "e"}
    tried = {frozenset(trial.names): trial.fit.cost for trial in step.trials}
    assert tried[frozenset("be")] < tried[frozenset("de")]


def test_nothing_is_found_in_noise() -> None:
    """One screening in a thousand may name something by chance, so that of 25 cases none should."""
    for seed in range(25):
        about = task({}, seed)
        assert forward(about, calibrated_stand(about), effects()).chosen is None


def test_of_two_that_explain_alike_the_one_with_fewer_numbers_is_added() -> None:
    """The price of a number is the logarithm of the number of values (Schwarz 1978); the other one is told."""
    twin = candidate("e", {"d": 1.0}, signed=True)
    loose = dataclasses.replace(
        twin,
        add=lambda model: twin.add(model).plus(lambda v, run: v["e.more"] * column(run, "more"), strength("e.more")),  # type: ignore[attr-defined]
        free=("e", "e.more"),
        trials=({"e": 0.1, "e.more": 0.0},),
    )
    about = task({"d": 0.3})
    step = forward(about, calibrated_stand(about), effects(e=loose))
    assert step.chosen is not None and step.chosen.names == ("d",)
    assert [trial.names for trial in step.alike] == [("e",)]
    sparse_model = step.alike[0].fit
    assert sparse_model.cost <= step.chosen.fit.cost + INDISTINGUISHABLE * sparse_model.discrepancy
    price = (sparse_model.bic(2.0) - sparse_model.cost - sparse_model.validation_chi2) - (
        step.chosen.fit.bic(2.0) - step.chosen.fit.cost - step.chosen.fit.validation_chi2
    )
    assert price == pytest.approx(2.0 * math.log(3 * N))


# --- successive halving ---------------------------------------------------------------------------------------------


def bell(v: Mapping[str, float], run: Any) -> Array:
    """A strength times a bell in time."""
    return np.asarray(v["n"] * np.exp(-(((run.t - v["middle"]) / 0.05) ** 2)))


#: What truly is there, and where the catalogue tries it.
BELL, TRIED = {"n": 2.0, "middle": 0.5}, 0.44


def of_bell(**more: Any) -> Candidate:
    """The bell, which is tried beside its middle: its score is a small part of what it explains."""
    middle = parameter("middle", TRIED, 0.0, 1.0)
    trials = ({"n": 0.1, "middle": TRIED},)
    add = lambda model: as_sum(model).plus(bell, strength("n"), middle)  # noqa: E731
    return Candidate("n", add, "n", ("n", "middle"), trials, signed=True, **more)


def of_shape(name: str, shape: Any) -> Candidate:
    """A strength times something of a run."""
    added = lambda v, run: v[name] * shape(run)  # noqa: E731
    return Candidate(name, lambda m: as_sum(m).plus(added, strength(name)), name, (name,), ({name: 0.1},), signed=True)


def decoys(count: int) -> list[Candidate]:
    """The bell, each with something of its own that is not there."""
    unit = {**BELL, "n": 1.0}
    return [
        of_shape(f"x{k}", lambda run, name=f"x{k}": bell(unit, run) + 0.3 * column(run, name)) for k in range(count)
    ]


def with_bell(**more: Any) -> EstimationTask:
    about = task({})

    def dataset(names: Sequence[str]) -> Dataset:
        made = [dataclasses.replace(run, data=run.data + bell(BELL, run)) for run in recorded({}, 0, names)]
        return Dataset(made, ColouredNoise(Process.white(SIGMA)), offset)

    return dataclasses.replace(about, identify=dataset(NAMES), validate=dataset(HELD), **more)


def told(said: Sequence[str], words: str) -> list[str]:
    return [each.removeprefix(words).strip() for each in said if each.startswith(words)]


def test_a_candidate_whose_score_understates_it_is_found() -> None:
    """It is last of thirteen by its score, and first after a few steps; few of them are fitted to the end."""
    said, every = list[str](), [of_bell(), *decoys(12)]
    about = with_bell(progress=said.append)
    before = calibrated_stand(about)
    ranked = [directions[0] for directions in Screening(before.solution, every).best()]
    assert len(ranked) == 13 and ranked[-1].candidate.name == "n"
    assert ranked[-1].predicted_reduction < 0.4 * ranked[0].predicted_reduction
    step = forward(about, before, every)
    assert step.chosen is not None and step.chosen.names == ("n",) and not step.chosen.fit.exceeds_noise
    values = step.chosen.fit.solution.problem.where.values(step.chosen.fit.solution.x)
    # Known to the noise over the root of the sum of squares of its derivative, which is 0.0007; four times that.
    assert values["middle"] == pytest.approx(BELL["middle"], abs=0.003)
    assert {*told(said, "trying")} >= {candidate.name for candidate in every}
    assert len(told(said, "fitting roughly with")) == 2 * FINALISTS + FINALISTS
    assert len(step.trials) == FINALISTS
    # In the order of the catalogue, or another, the same is found.
    for others in (every[::-1], [*every[6:], *every[:6]]):
        again = forward(about, before, others)
        assert [trial.names for trial in again.trials] == [trial.names for trial in step.trials]


def test_pairs_take_no_place_of_single_effects_with_good_scores() -> None:
    """The best scores among the quick fits that went astray are those of single effects."""
    said = list[str]()
    about = with_bell(progress=said.append)
    before = calibrated_stand(about)
    _, entries = screen(about, before, decoys(12))
    singles = sorted((e for e in entries if len(e.start.names) == 1), key=lambda e: -e.start.predicted_reduction)
    best, rest = singles[:FINALISTS], singles[FINALISTS:]
    pair = dataclasses.replace(best[0].start, directions=(*best[0].start.directions, *rest[0].start.directions))
    fit_roughly(about, before, [*rest, *best, dataclasses.replace(best[0], start=pair)])
    assert {entry.start.names[0] for entry in best} <= {*told(said, "fitting roughly with")}


def test_what_promises_too_little_is_not_fitted() -> None:
    """Half of what would be accepted: of the effects in noise hardly any is tried, and what is absent never is."""
    said = list[str]()
    about = dataclasses.replace(task({"d": 0.3}), progress=said.append)
    before = calibrated_stand(about)
    screening = Screening(before.solution, effects())
    enough = max(screening.critical_value(LEVEL), SHARE * before.excess) / LARGE
    promising = [
        directions[0].candidate.name for directions in screening.best() if directions[0].predicted_reduction > enough
    ]
    forward(about, before, effects())
    assert [name for name in told(said, "trying") if " and " not in name] == promising
    assert "d" in promising and len(promising) < len(EFFECTS)


def test_a_pair_competes_only_where_a_single_effect_leaves_more_than_noise() -> None:
    """Both halves of a bell promise more than any single effect; the bell itself leaves nothing for them."""
    left, right = (
        of_shape(name, lambda run, is_left=is_left: bell({**BELL, "n": 1.0}, run) * ((run.t < 0.5) == is_left))
        for name, is_left in (("left", True), ("right", False))
    )
    about = with_bell()
    before = calibrated_stand(about)
    every = [left, right, of_bell()]
    screening = Screening(before.solution, every)
    ((predicted_gain, *pair),) = screening.pairs(1)
    assert {direction.candidate.name for direction in pair} == {"left", "right"}
    assert predicted_gain > screening.best()[0][0].predicted_reduction + screening.critical_value(LEVEL)
    alone = forward(about, before, every)
    assert alone.chosen is not None and alone.chosen.names == ("n",)
    assert all(len(trial.names) == 1 for trial in alone.trials)
    both = forward(about, before, every[:2])
    assert both.chosen is not None and {*both.chosen.names} == {"left", "right"}
    assert any(trial.names in (("left",), ("right",)) and trial.fit.exceeds_noise for trial in both.trials)


def led_astray() -> tuple[Sum, Candidate, EstimationTask]:
    """A tone of 5.3 periods, and an effect that looks like that tone less another one of 7 periods.

    A calibration that ended near 7 leaves a residual in which the effect seems to have the wrong sign.
    """

    def tone(f: float, run: Any) -> Array:
        return np.asarray(np.sin(2 * math.pi * f * run.t))

    def of_effect(v: Mapping[str, float], run: Any) -> Array:
        return np.asarray(v["e"] * (column(run, "g") - tone(5.3, run) + tone(7.0, run)))

    size, f = parameter("size", 1.0, 0.1, 3.0), parameter("f", 5.0, 4.0, 8.0)
    model = Sum().plus(lambda v, run: v["size"] * tone(v["f"], run), size, f)
    effect = Candidate(
        "e", lambda m: as_sum(m).plus(of_effect, strength("e", 0.0, 0.0, 9.0)), "e", ("e",), ({"e": 0.1},)
    )
    truth = as_sum(effect.add(model)).replace({"size": 1.5, "f": 5.3, "e": 0.5})
    rng = np.random.default_rng(0)

    def dataset(names: Sequence[str]) -> Dataset:
        blank = [Run(name, np.arange(N) / N, None) for name in names]
        made = [dataclasses.replace(r, data=truth.predict(r) + SIGMA * rng.standard_normal(N)) for r in blank]
        return Dataset(made, ColouredNoise(Process.white(SIGMA)), offset)

    return (
        model,
        effect,
        EstimationTask(dataset(NAMES), dataset(HELD), ("size", "f"), lambda _: {}, lambda _: model, 1e-3),
    )


def test_a_fit_from_the_design_finds_what_calibration_hides() -> None:
    model, effect, about = led_astray()
    nominal, astray = evaluate_design(about, model), fit_model(about, model.replace({"f": 7.0}))
    assert nominal is not None and astray is not None
    assert min(nominal.scale, astray.scale) > GROSS_MISFIT
    assert forward(about, astray, [effect]).trials == ()
    step = forward(about, astray, [effect], (nominal,))
    assert step.chosen is not None and step.chosen.names == ("e",)
    found = step.chosen.fit
    values = found.solution.problem.where.values(found.solution.x)
    assert not found.exceeds_noise
    assert [values["f"], values["e"]] == pytest.approx([5.3, 0.5], abs=0.03)
    # Evidence is counted from the fit that is in place, and not from the design.
    assert step.chosen.gain == pytest.approx(astray.fitted_chi2 - found.fitted_chi2, rel=1e-9)
    # A selection asks the design at its first step alone.
    steps, stands = select(about, astray, [effect], 1, expansion_points=(nominal,))
    assert [s.names for s in stands] == [("e",)] and len(steps) == 1


# --- what cannot be told apart --------------------------------------------------------------------------------------


def steps_of(about: EstimationTask, every: Sequence[Candidate]) -> list[Step]:
    """All additions, as a search makes them."""
    steps = [forward(about, calibrated_stand(about), every)]
    while (chosen := steps[-1].chosen) is not None:
        steps.append(forward(about, chosen.fit, every))
    return steps


def final(steps: Sequence[Step]) -> FittedModel:
    return next(step.chosen.fit for step in reversed(steps) if step.chosen is not None)


def test_effects_that_do_as_well_are_one_answer() -> None:
    """Twins of d, each with a thousandth of something of its own; a group is no larger than the last round."""
    twins = [candidate(name, {"d": 1.0, f"{name} alone": 1e-3}, signed=True) for name in ("w", "x", "y", "z")]
    about = task({"d": 0.3})
    for count in (1, 4):
        steps = steps_of(about, [*effects(), *twins[:count]])
        ((first, *others),) = confusable(about, final(steps), steps)
        assert first == steps[0].chosen.names[0] and {first, *others} <= {"d", "w", "x", "y", "z"}  # type: ignore[union-attr]
        assert len(others) == min(count, FINALISTS - 1)


def test_what_did_as_well_beside_a_gross_misfit_may_not_do_so_in_the_end() -> None:
    """While the large effect is missing one that is nearly d is as good as d; beside it, it is not."""
    about = task({"d": 1.0, "b": 2.0})
    nearly = candidate("e", {"d": 1.0, "e": 0.3}, signed=True)
    twin = candidate("f", {"d": 1.0, "f": 1e-3}, signed=True)
    every = [candidate(name, signed=True) for name in ("b", "d")]
    # The search as it may go: d first, with all that does as well there.
    before = calibrated_stand(about)
    stands = {effect.name: fit_model(about, effect.add(before.model), (effect,)) for effect in (every[1], nearly, twin)}
    trials = {n: compare(about, before, made, (n,), 20.0) for n, made in stands.items() if made is not None}
    first = Step(trials["d"], tuple(trials.values()))
    assert [trial.names for trial in first.alike] == [("e",), ("f",)]
    second = forward(about, trials["d"].fit, every)
    assert second.chosen is not None and second.chosen.names == ("b",)
    assert confusable(about, trials["d"].fit, [first]) == (("d", "e", "f"),)
    assert confusable(about, second.chosen.fit, [first, second]) == (("d", "f"),)


# --- back, and anew -------------------------------------------------------------------------------------------------


def test_an_effect_that_others_made_superfluous_is_dropped() -> None:
    """`a` came first, as a mixture of both; with `b` and `c` in the model nothing is left for it to explain."""
    mixture = candidate("a", {"b": 1.0, "c": 1.0, "a": 0.5}, signed=True)
    about, every = task({"b": 0.3, "c": 0.2}), effects(a=mixture)
    fit = fit_with(about, every[:3])
    left = backward(about, fit, fit.names)
    assert left.names == ("b", "c")
    assert left.cost - fit.cost < 15  # chi-squared of one number
    assert {p.name for p in left.model.parameters()}.isdisjoint({"a"})


def test_effects_that_are_needed_stay() -> None:
    about, every = task({"b": 0.3, "c": 0.2}), effects()
    fit = fit_with(about, every[1:3])
    assert backward(about, fit, fit.names) is fit


def refits(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, ...]]:
    """Note the effects of each fit that is made again without one."""
    asked, refit = list[tuple[str, ...]](), stepwise_selection.refit

    def noted(about: EstimationTask, fit: FittedModel, rest: tuple[Candidate, ...]) -> FittedModel | None:
        asked.append(tuple(effect.name for effect in rest))
        return refit(about, fit, rest)

    monkeypatch.setattr(stepwise_selection, "refit", noted)
    return asked


def test_only_doubtful_effects_are_tested(monkeypatch: pytest.MonkeyPatch) -> None:
    mixture = candidate("a", {"b": 1.0, "c": 1.0, "a": 0.5}, signed=True)
    about = task({"b": 0.3, "c": 0.2})
    fit, asked = fit_with(about, effects(a=mixture)[:3]), refits(monkeypatch)
    assert backward(about, fit, ()) is fit and not asked
    assert backward(about, fit, ("b", "c")).names != ("b", "c")
    assert all("a" in names for names in asked)
    asked.clear()
    assert backward(about, fit, ("a",)).names == ("b", "c")
    assert asked == [("b", "c")]


def test_the_last_effect_is_never_tested(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether one is needed at all was decided when it was added."""
    about = task({})
    fit, asked = fit_with(about, effects()[:1]), refits(monkeypatch)
    assert backward(about, fit, ("a",)) is fit and not asked


def test_a_selection_doubts_what_was_there_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was added alone has just been found to be needed; of a pair each may make up for the other."""
    about, every = task({"b": 0.3, "e": -0.2}), effects()
    asked = refits(monkeypatch)
    _, (alone,) = select(about, fit_with(about, every[1:2]), every, 2)
    assert alone.names == ("b", "e") and asked == [("e",)]
    asked.clear()
    step = forward(about, calibrated_stand(about), every)
    assert step.chosen is not None and {*step.chosen.names} == {"b", "e"}
    select(about, calibrated_stand(about), every, 2)
    assert sorted(asked) == [("b",), ("e",)]


def test_a_selection_drops_what_later_effects_made_superfluous() -> None:
    mixture = candidate("a", {"b": 0.6, "c": 0.4, "a": 0.1}, signed=True)
    about = task({"b": 0.6, "c": 0.4})
    steps, stands = select(about, calibrated_stand(about), effects(a=mixture)[:3], 3)
    assert {*stands[-1].names} == {"b", "c"} and not stands[-1].exceeds_noise
    assert steps[-1].chosen is None


def test_a_selection_stops_at_its_largest_number_of_effects() -> None:
    about, every = task({"b": 0.5, "c": 0.4, "e": 0.45}), effects()
    begun = fit_with(about, every[1:2])
    assert select(about, begun, every, 1) == ([], [])
    assert {*select(about, begun, every, 3)[1][-1].names} == {"b", "c", "e"}


def test_a_selection_stops_where_an_addition_made_itself_superfluous(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two effects without a truth, which a step adds all the same: without this it would do so for ever."""
    about, every = task({"b": 0.3}), effects()
    fit, before = fit_with(about, every[1:2]), calibrated_stand(about)
    idle = fit_with(about, [every[1], every[3], every[4]])
    trial = dataclasses.replace(compare(about, fit, idle, ("d", "e"), 20.0), reason="")
    monkeypatch.setattr(stepwise_selection, "forward", lambda *_: Step(trial, (trial,)))
    steps, stands = select(about, fit, every, 5)
    assert len(steps) == 1 and stands == []
    # One that is needed stays beside what is not.
    needed = dataclasses.replace(compare(about, before, idle, ("b", "d", "e"), 20.0), reason="")
    monkeypatch.setattr(stepwise_selection, "forward", lambda *_: Step(needed, (needed,)))
    assert [made.names for made in select(about, before, every, 1)[1]] == [("b",)]


def test_a_number_of_the_model_that_is_an_effect_goes_where_another_takes_its_place() -> None:
    """A bandwidth is a number of the model whether it acts or not; what replaces it must do without it."""

    def with_number(_: Any = None) -> Any:
        return stage().plus(linear("b"), strength("b"))

    number = Candidate("b", lambda model: model, "b", ("b",), ({"b": 0.1},), signed=True)
    other = candidate("e", {"b": 0.5, "e": 1.0}, signed=True)
    about = dataclasses.replace(task({"b": 0.3}), bare=with_number)
    before, fit, alone = (
        fit_model(about, with_effects(with_number(), added), tuple(added)) for added in ([], [number], [other])
    )
    assert before is not None and fit is not None and alone is not None
    trials = [compare(about, before, made, made.names, 20.0) for made in (fit, alone)]
    assert not any(trial.reason for trial in trials)
    assert confusable(about, fit, [Step(trials[0], tuple(trials))]) == ()
    made = fitted_model.fit_in_place(about, fit, "b", other, trials[1].fit.model)
    assert made is not None and made.cost == pytest.approx(alone.cost, rel=1e-4) and made.cost > fit.cost + 100


def test_a_selection_goes_on_from_confirmed_steps() -> None:
    """A fit with the same effects, whose strengths differ from run to run now, takes the place of the confirmed one."""
    about, every = task({"b": 0.3, "e": -0.2}), effects()
    before, known = calibrated_stand(about), fit_with(about, every[1:2])
    first = forward(about, before, every[1:2])
    steps, fits = select(about, before, every, 2, confirmed=([first], [known]))
    assert [fit.names for fit in fits] == [("b",), ("b", "e")] and fits[0] is known and steps[0] is first
    by_run = dataclasses.replace(known, model=known.model)
    _, fits = select(about, before, [], 2, confirmed=([first], [known]), vary=lambda _: by_run)
    assert fits == [by_run]
    assert select(about, before, [], 2, confirmed=([first], [known]))[1] == [known]


def test_of_an_effect_that_is_there_twice_the_first_stays() -> None:
    """Whichever is dropped: what is named is the first one, with the numbers of the one that the runs need."""
    about, every = task({"b": 0.3, "e": -0.2}), effects()
    first, second = candidate("m", {"e": 1.0}, signed=True), candidate("m.2", {"e": 1.0}, signed=True, after="m")
    both = fit_with(about, [every[1], first, second])
    start, names = stepwise_selection.refit(about, both, (every[1], second)), ("b", "m")
    assert start is not None and start.names == names
    assert start.cost == pytest.approx(fit_with(about, [every[1], first]).cost, rel=1e-5)
    kept, values = fitted_model._renumber(both, (every[1], second))
    assert [effect.name for effect in kept] == [*names]
    assert values == {"m": parameter_of(both.model, "m.2").start}
    # Of three the last goes, and the second has the values of the third.
    third = candidate("m.3", {"e": 1.0}, signed=True, after="m.2")
    kept, values = fitted_model._renumber(fit_with(about, [first, second, third]), (second, third))
    assert [effect.name for effect in kept] == ["m", "m.2"] and [*values] == ["m", "m.2"]
    # Nothing changes where the last one is dropped.
    assert fitted_model._renumber(both, (every[1], first)) == ((every[1], first), {})


def test_effects_that_need_each_other_are_added_and_others_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    """A third effect in the noise, added without being asked for evidence, is dropped again."""
    about, every = task({"b": 0.3, "e": -0.3}), effects()
    before = calibrated_stand(about)

    def blind(task: EstimationTask, fit: FittedModel, candidates: Sequence[Candidate]) -> Step:
        """What is tried: in this order, whether it has evidence or not."""
        effect = next(each for each in (every[0], every[1], every[4]) if each.name not in fit.names)
        return Step(None, (compare(task, fit, fit_with(about, [*fit.effects, effect]), (effect.name,), 10.0),))

    monkeypatch.setattr(stepwise_selection, "forward", blind)
    step = stepwise_selection.add_together(about, before, every, 3)
    assert step is not None and step.chosen is not None
    assert {*step.chosen.names} == {*step.chosen.fit.names} == {"b", "e"} and not step.chosen.reason
    assert step.chosen.fit.cost == pytest.approx(fit_with(about, [every[1], every[4]]).cost, rel=1e-4)
    # Of two effects that are tried, of which one has evidence, none are added together.
    assert stepwise_selection.add_together(about, before, every, 2) is None
    assert stepwise_selection.add_together(about, step.chosen.fit, every, 3) is None  # nothing but noise remains


def test_a_fit_in_a_local_minimum_begins_again_with_the_threshold_on_either_side() -> None:
    """A ramp with a ripple: the ramp is found at any wave number, the ripple only within a tenth of its own."""

    def rippled(v: Mapping[str, float], run: Any) -> Array:
        return np.asarray(v["d"] * (20.0 * run.t + 0.3 * np.cos(50.0 * v["waves"] * run.t)))

    waves = parameter("waves", 0.87, 0.1, 5.0, scale="log")
    trials = tuple({"d": 0.1, "waves": value} for value in (0.6, 0.87))
    effect = Candidate(
        "d", lambda model: as_sum(model).plus(rippled, strength("d"), waves), "d", ("d", "waves"), trials, signed=True
    )
    truth = {"d": 1.0, "waves": 1.0}

    def measured(runs: Sequence[Run]) -> list[Run]:
        return [dataclasses.replace(run, data=run.data + rippled(truth, run)) for run in runs]

    noise = ColouredNoise(Process.white(SIGMA))
    identify, kept = (Dataset(measured(recorded({}, 0, names)), noise, offset) for names in (NAMES, HELD))
    about = EstimationTask(identify, kept, ("p", "q"), lambda _: {}, lambda _: stage(), 1e-3)
    before = calibrated_stand(about)
    alone = fit_model(about, effect.add(before.model).replace({"d": 1.0, "waves": 0.87}), (effect,))
    assert alone is not None and alone.scale > 1.5
    # Another effect would make up for the ripple: where it is not needed it is not tried.
    other = Candidate(
        "r",
        lambda model: as_sum(model).plus(lambda v, run: v["r"] * np.cos(50.0 * run.t), strength("r")),
        "r", ("r",), ({"r": 0.1},), signed=True,
    )  # fmt: skip
    for offered in ([effect], [effect, other]):
        _, (fit, *more) = select(about, before, offered, 3)
        assert fit.names == ("d",) and not more
        assert fit.scale < 1.2
        assert fit.solution.problem.where.values(fit.solution.x)["waves"] == pytest.approx(1.0, abs=2e-3)
