"""How a model stands beside the runs: fitted to those that a fit may see, judged on those kept apart."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexdesign.evidence.autoregressive import colour
from flexdesign.evidence.case import Case
from flexdesign.evidence.local_minima import Refine, grid_initial_states, outlier_runs
from flexdesign.evidence.marquardt import SHARE, Columns, Solution, solve
from flexdesign.evidence.screening import Candidate
from flexdesign.evidence.suite import Record, Suite
from flexdesign.model import Model

Array = NDArray[np.float64]
#: Where a run kept apart began is found when a step lowers the cost by less than this share.
HELD_SHARE = 1e-5
#: A model misses the runs by far where it leaves this many times the mean square of the noise.
GROSS = 30.0
#: A fit begins again with each threshold times these, so often while that lowers chi^2 by more than this.
#: It is carried to the end where a rough fit comes as close as this to the best.
FACTORS, ROUNDS, IMPROVED, CLOSE = (1.1, 0.9), 6, 2.0, 1.05


@dataclass(frozen=True, eq=False)
class Stand:
    """A model with some effects, fitted and judged.

    Parameters
    ----------
    effects
        What was added, in this order.
    solution
        The fit to the runs that it may see.
    model
        The fitted model; where each held-out run began is fitted as well.
    held_cost
        Sum of squares of the held-out runs, whitened.
    predictions, remainders
        Of every run, by name: prediction with the run's own offset, and measured less that; n values, SI.
    """

    effects: tuple[Candidate, ...]
    solution: Solution
    model: Model
    held_cost: float
    remainders: Mapping[str, Array]

    @property
    def cost(self) -> float:
        """Sum of squares of what the fit saw, whitened, and of what was known."""
        return self.solution.cost

    @property
    def seen_cost(self) -> float:
        """Sum of squares of what the fit saw, whitened, and of how oddly runs began; not of the model's own numbers."""
        problem = self.solution.problem
        of_runs = {parameter.name for parameter in problem.where.parameters if parameter.run}
        odd = problem.before(self.solution.x)[[name in of_runs for name in problem.where.known]]
        return float(sum(part @ part for part in self.solution.residuals) + odd @ odd)

    @property
    def scale(self) -> float:
        """Mean square of what the fit leaves, whitened: one where only noise is left."""
        return self.cost / self.solution.problem.suite.samples

    @cached_property
    def discrepancy(self) -> float:
        """Factor by which evidence is discounted: reduced chi^2 times the number of samples that count as one.

        One where only white noise is left. What no model explains is taken as coloured noise.
        """
        pairs = zip(self.solution.problem.suite.records, self.solution.residuals, strict=True)
        parts = [part[: len(record.measured)] for record, part in pairs]
        weighted = sum(float(part @ part) * colour(part).inflation for part in parts)
        return max(weighted / self.solution.problem.suite.samples, 1.0)

    @property
    def is_white(self) -> bool:
        """Whether no residual of the fitted runs is correlated from one sample to the next."""
        pairs = zip(self.solution.problem.suite.records, self.solution.residuals, strict=True)
        return all(colour(part[: len(record.measured)]).is_white for record, part in pairs)

    @property
    def nuisance_dof(self) -> float:
        """Effective degrees of freedom of the initial conditions that enter linearly."""
        records = self.solution.problem.suite.records
        return float(sum(np.sum(record.basis[: len(record.measured)] ** 2) for record in records))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(effect.name for effect in self.effects)

    def rms(self, runs: Sequence[str], scales: Mapping[str, Array] | None = None) -> float:
        """Return the root mean square of what is left of some runs [response].

        Parameters
        ----------
        runs
            Names of observations.
        scales
            By name what values are multiplied with, where they are not alike; see `Case.scales`.
        """
        left = np.concatenate([self._scaled(name, scales or {}) for name in runs])
        return float(np.sqrt(np.nanmean(left**2)))

    def _scaled(self, name: str, scales: Mapping[str, Array]) -> Array:
        return self.remainders[name] * scales[name] if name in scales else self.remainders[name]

    @property
    def total(self) -> float:
        """What candidates are ranked by: cost of all runs, and the price of the numbers (Schwarz 1978)."""
        free = {name for effect in self.effects for name in effect.free}
        # One that differs from run to run counts once more for each run.
        numbers = sum(p.name.rpartition(":")[2] in free for p in self.solution.problem.where.parameters)
        price = numbers * math.log(self.solution.problem.suite.samples)
        return self.cost + self.held_cost + price * self.discrepancy

    def at_bound(self) -> list[str]:
        """Return the numbers of effects that the fit pushes to the end of what is plausible."""
        where, free = self.solution.problem.where, {name for effect in self.effects for name in effect.free}
        found = []
        for j, parameter in enumerate(where.parameters):
            if parameter.name not in free:
                continue
            value = where.values(self.solution.x)[parameter.name]
            ends = [end for end in (where.lower[j], where.upper[j]) if math.isfinite(end)]
            if parameter.null != value and any(math.isclose(self.solution.x[j], e, rel_tol=1e-6) for e in ends):
                found.append(parameter.name)
        return found


def fitted(
    case: Case,
    model: Model,
    effects: tuple[Candidate, ...],
    start: Mapping[str, float],
    *,
    old: Columns | None = None,
    most: int = 20,
    share: float = SHARE,
    exact: bool = True,
) -> Stand | None:
    """Fit a model that has some effects, and judge it on the runs kept apart; None where it cannot be simulated.

    Parameters are those of `solved`.
    """
    solution = solved(case, model, effects, start, old=old, most=most, share=share, exact=exact)
    if solution is None:
        return None
    stand = judged(case, solution, effects, share)
    if stand is None or stand.scale > GROSS:
        return stand
    return begun_elsewhere(case, stand, outlier_runs(solution.problem.suite, solution.residuals), share)


def begun_elsewhere(case: Case, stand: Stand, runs: Sequence[str], share: float = SHARE) -> Stand:
    """Return a fit begun again with some runs in other initial states; the fit itself if that is no better."""
    solution = stand.solution
    suite = solution.problem.suite
    moved = grid_initial_states(suite, stand.model, runs, case.each, _alone(case, suite)) if runs else stand.model
    if moved is stand.model:
        return stand
    again = solved(case, moved, stand.effects, {}, old=solution.columns(), share=share)
    made = None if again is None or again.cost >= solution.cost else judged(case, again, stand.effects, share)
    return stand if made is None else made


def _alone(case: Case, suite: Suite) -> Refine:
    """Return what fits the initial state of one run while all other numbers stay."""

    def refine(model: Model, record: Record) -> tuple[float, dict[str, float]]:
        alone = suite.part([record.observation.name])
        where = case.coordinates(model, (), alone)
        found = solve(case.problem(alone, model, where), where.start, most=6, share=1e-3, exact=False)
        return (math.inf, {}) if found is None else (found.misfit, where.values(found.x))

    return refine


def escape(case: Case, stand: Stand) -> Stand:
    """Return the best of fits begun again near one that may be in a local minimum: initial states, then thresholds."""
    stand = begun_elsewhere(case, stand, case.identify.names)
    for name in (name for effect in stand.effects for name in effect.hidden):
        for _ in range(ROUNDS):
            case.progress(f"fitting with other values of {name}")
            better = next((made for factor in FACTORS if (made := _begun_beside(case, stand, name, factor))), None)
            if better is None:
                break
            stand = better
    return stand


def _begun_beside(case: Case, stand: Stand, name: str, factor: float) -> Stand | None:
    """Return the fit that begins with a number times a factor, first roughly; None if it is no better."""
    value = stand.solution.problem.where.values(stand.solution.x)[name]
    rough = solved(
        case,
        case.coarse(stand.model.replace({name: factor * value})),
        stand.effects,
        {},
        most=4,
        share=1e-3,
        exact=False,
    )
    if rough is None or rough.cost > CLOSE * stand.cost:
        return None
    made = fitted(case, case.fine(rough.problem.at(rough.x)), stand.effects, {}, old=rough.columns())
    return made if made is not None and made.cost < stand.cost - IMPROVED * stand.discrepancy else None


def solved(
    case: Case,
    model: Model,
    effects: tuple[Candidate, ...],
    start: Mapping[str, float],
    *,
    old: Columns | None = None,
    most: int = 20,
    share: float = SHARE,
    exact: bool = True,
) -> Solution | None:
    """Fit a model that has some effects; None where it cannot be simulated.

    Parameters
    ----------
    start
        Values from which it begins, where they are not those of the model.
    old, most, share, exact
        See `flexdesign.evidence.marquardt.solve`; the share is at least that of the case.
    """
    begun = model.replace(start)
    case = case.prepared(case, begun)
    free = [*case.free, *(name for effect in effects for name in effect.free)]
    where = case.coordinates(begun, free, case.identify)
    problem = case.problem(case.identify, begun, where)
    old = old if old and _suits(old, case.identify) else None
    return solve(problem, where.start, most=most, share=max(share, case.fitting.share), old=old, exact=exact)


def _suits(old: Columns, suite: Suite) -> bool:
    """Tell whether a Jacobian found before has the rows of a suite, whose initial conditions may have become others."""
    rows = [record.rows for record in suite.records]
    return all(c is None or len(c) == n for parts in old.values() for c, n in zip(parts, rows, strict=True))


def judged(case: Case, solution: Solution, effects: tuple[Candidate, ...], share: float = SHARE) -> Stand | None:
    """Judge a fit on the runs kept apart: where each began is found, and what is left of all."""
    model, held, share = solution.problem.at(solution.x), 0.0, max(share, case.fitting.share)
    case = replace(case.prepared(case, model), identify=solution.problem.suite)
    if case.validate.records:
        where = case.coordinates(model, (), case.validate)
        # What is known of these numbers comes from nowhere else, so that their slopes are not asked for again.
        problem = case.problem(case.validate, model, where)
        beginning = solve(problem, where.start, share=max(share, HELD_SHARE), exact=False)
        if beginning is None:
            return None
        beginning = _with_outliers_elsewhere(case, beginning, solution, share)
        model, held = beginning.problem.at(beginning.x), beginning.cost
    records = [(suite, record) for suite in (case.identify, case.validate) for record in suite.records]
    left = case.each(lambda pair: pair[0].remainder(pair[1], np.asarray(model.predict(pair[1].observation))), records)
    names = [record.observation.name for _, record in records]
    return Stand(effects, solution, model, held, dict(zip(names, left, strict=True)))


def tested(case: Case, stand: Stand) -> Stand:
    """Return a fit with its residuals on the test runs, whose initial conditions are fitted; itself without them."""
    if case.test is None:
        return stand
    made = judged(replace(case, validate=case.test), stand.solution, stand.effects)
    return stand if made is None else replace(stand, remainders={**made.remainders, **stand.remainders})


def _with_outliers_elsewhere(case: Case, begun: Solution, solution: Solution, share: float) -> Solution:
    """Return the initial conditions of validation runs, sought anew for those that fit worse than the fitted runs."""
    usual = solution.cost / solution.problem.suite.samples
    odd = outlier_runs(case.validate, begun.residuals, usual) if usual < GROSS else []
    model = begun.problem.at(begun.x)
    suite = case.validate
    moved = grid_initial_states(suite, model, odd, case.each, _alone(case, suite)) if odd else model
    if moved is model:
        return begun
    where = case.coordinates(moved, (), case.validate)
    problem = case.problem(case.validate, moved, where)
    anew = solve(problem, where.start, share=max(share, HELD_SHARE), exact=False)
    return begun if anew is None or anew.cost > begun.cost else anew


def refitted(case: Case, stand: Stand, base: Model, effects: tuple[Candidate, ...]) -> Stand | None:
    """Fit the model with some of a stand's effects, from the values that it has."""
    model = base
    for effect in effects:
        model = effect.add(model)
    present = {parameter.name: parameter.start for parameter in stand.model.parameters()}
    dropped = {name for effect in stand.effects if effect not in effects for name in effect.free}
    names = {parameter.name for parameter in model.parameters()} - dropped
    values = {name: value for name, value in present.items() if name in names and value is not None}
    return fitted(case, model, effects, values)


def like(model: Model, stand: Stand) -> Model:
    """Return a model at the values of a stand that has its numbers."""
    values = {parameter.name: parameter.start for parameter in stand.model.parameters()}
    return model.replace({p.name: start for p in model.parameters() if (start := values.get(p.name)) is not None})


def finished(case: Case, stand: Stand) -> Stand:
    """Return a stand with values that do not hang on how exactly the model is simulated.

    N samples of noise s leave an error of s / root N in a value; a prediction that is off by a small share of the noise
    everywhere moves it by as much. The slopes of the fit serve: they need not be so exact.
    """
    model, old = case.finest(stand.model), stand.solution.columns()
    made = None if model is stand.model else fitted(case, model, stand.effects, {}, old=old, most=2, exact=False)
    return stand if made is None else made


def moved(suite: Suite, before: Model, after: Model, weights: Mapping[str, Array] | None = None) -> float:
    """Return by how much two models differ in what they predict of new runs, rms [response]; offsets are free.

    New runs begin where the old ones did, but in time: a delay that every run has is not the runs' own. Observations
    with weights, see `Case`, count on their own: the larger of both differences is returned.
    """
    weights = weights or {}
    weighted = [record for record in suite.records if record.observation.name in weights]
    plain = [record for record in suite.records if record.observation.name not in weights]
    return max(_moved(records, before, after, weights) for records in (plain, weighted) if records)


def _moved(records: Sequence[Record], before: Model, after: Model, weights: Mapping[str, Array]) -> float:
    squares, count = 0.0, 0
    models = [model.replace(_in_time(model)) for model in (before, after)]
    for record in records:
        first, second = (np.asarray(model.predict(record.observation)) for model in models)
        difference = free_part(record, (second - first), weights)
        squares, count = squares + float(np.sum(difference**2)), count + len(difference)
    return math.sqrt(squares / count)


def at_null(model: Model, effect: Candidate) -> Model:
    """Return a model in which an effect does nothing, in no run; all other numbers stay."""
    null = next(p.null for p in model.parameters() if p.name == effect.strength)
    assert null is not None  # that is what makes it the strength
    deviations = {p.name: 0.0 for p in model.parameters() if p.run and p.name.endswith(f":{effect.strength}")}
    return model.replace({effect.strength: null, **deviations})


def free_part(record: Record, difference: Array, weights: Mapping[str, Array]) -> Array:
    """Return what of a difference is no offset, where there are values; or these with their weights."""
    weight = weights.get(record.observation.name)
    if weight is not None:
        return np.asarray((difference * weight)[record.present])
    there = difference[record.present]
    return np.asarray(there - np.mean(there))


def _in_time(model: Model) -> dict[str, float]:
    return {p.name: p.null for p in model.parameters() if p.run and p.null is not None}
