"""The best dimensions: an optimiser on the formulas, corrected by finite elements until these agree.

Formulas are cheap and a few percent off, finite elements expensive and accurate. What is optimised is therefore the
formulas' quantities times what finite elements found over formulas at the last optimum, which is exact there and nearly
so around it (output space mapping: Bandler et al. 2004, IEEE Transactions on Microwave Theory and Techniques 52,
337-361). Within a round sequential quadratic programming (Kraft 1988, as implemented by scipy) starts from the best of
a sample.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model import Quantity, by_key
from flexdesign.workflows.sweeps import evaluators
from flexdesign.workflows.sweeps.fem_evaluators import by_elements, fast_solid, strength_and_modes
from flexdesign.workflows.sweeps.pareto import Aim, Limit
from flexdesign.workflows.sweeps.plan import SweepPlan
from flexdesign.workflows.sweeps.results import key_of, value_by_name
from flexdesign.workflows.sweeps.sampling import Case, Factor, cases

Found = Mapping[str, Quantity]
Progress = Callable[[str], None]
_Memory = dict[bytes, tuple[float, Array]]
#: Points of a sample, and how many of them are followed; steps of one search, and the step of its differences.
SAMPLED, FOLLOWED, STEPS, DIFFERENCE = 64, 6, 100, 1e-6
#: A limit is kept that is broken by no more than this share of it.
SLACK = 1e-6
#: Rounds of finite elements, and the change of the aim that needs no further one.
ROUNDS, SETTLED = 4, 2e-3
#: Within this share of its width from an end of its range a dimension stands at that end.
AT_END = 1e-4
#: What a design costs that cannot be built.
UNBUILDABLE = 1e3


@dataclass(frozen=True)
class Round:
    """An optimum of the corrected formulas, and what finite elements say of it.

    Parameters
    ----------
    values
        What varied, by key: SI numbers, or texts.
    formulas, predicted, elements
        Quantities by key: of the formulas, of the formulas as corrected before this round, and of finite elements;
        None where these were not asked.
    """

    values: Mapping[str, float | str]
    formulas: Found
    predicted: Found
    elements: Found | None


@dataclass(frozen=True)
class Optimum:
    """The end of an optimisation.

    Parameters
    ----------
    plan
        What was asked.
    rounds
        One optimum after the other.
    converged_searches
        How many searches of the last round ended at its optimum, of how many.
    broken
        Limits that the optimum breaks: nothing was found that keeps them all.
    further
        Stress, safety and frequency by finite elements, if they were asked.
    """

    plan: SweepPlan
    rounds: Sequence[Round]
    converged_searches: tuple[int, int]
    broken: tuple[Limit, ...]
    further: Sequence[Quantity] = ()

    def end_of(self, factor: Factor) -> str:
        """Return at which end of its range something stands, "lower" or "upper"; nothing within it."""
        if factor.ends is None:
            return ""
        low, high = factor.ends
        share = (float(self.last.values[factor.key]) - low) / (high - low)
        return "lower" if share <= AT_END else "upper" if share >= 1 - AT_END else ""

    @property
    def last(self) -> Round:
        """The last round."""
        return self.rounds[-1]

    @property
    def found(self) -> Found:
        """What the optimum gives, by finite elements if they were asked."""
        return self.last.formulas if self.last.elements is None else self.last.elements


def optimise(plan: SweepPlan, *, check: bool = True, progress: Progress = lambda _: None) -> Optimum:
    """Find the dimensions that serve an aim best within its limits.

    Parameters
    ----------
    plan
        Ranges of what varies, limits, and one aim.
    check
        Whether finite elements check the optimum and correct the formulas.
    progress
        Receives the progress as text.

    Raises
    ------
    InputError
        If there is no aim or several, nothing has a range, or no point of a sample can be built.
    """
    if len(plan.aims) != 1:
        remedy = "an optimum has one aim; write the others as limits, or run the sweep for the front of several"
        raise InputError(plan.file, "aim", f"{len(plan.aims)} aims", remedy)
    if not any(factor.ends for factor in plan.factors):
        raise InputError(plan.file, "vary", None, 'has no range; write { from = "1 mm", to = "2 mm" }')
    _refuse_unknown(plan)
    correction: dict[str, float] = {}
    rounds: list[Round] = []
    solid = fast_solid(plan.mesh)
    with threadpool_limits(1):
        for number in range(1, ROUNDS + 1):
            progress(f"round {number}: optimising the formulas")
            best, converged_searches = _search(plan, correction)
            formulas = _by_formulas(plan, best.values)
            predicted = _correct(formulas, correction)
            elements = None
            if check:
                progress(f"round {number}: checking the optimum by finite elements")
                elements = by_key(by_elements(evaluators.version_of(plan, Case(best.values)), plan.mesh, solid))
            rounds.append(Round(best.values, formulas, predicted, elements))
            if elements is None or _is_confirmed(plan, predicted, elements):
                break
            correction = {key: elements[key].value / q.value for key, q in formulas.items() if key in elements}
    found_there = rounds[-1].formulas if elements is None else elements
    broken = tuple(limit for limit in plan.limits if _violation(limit, found_there) > (SETTLED if check else SLACK))
    further: Sequence[Quantity] = ()
    if elements is not None:
        progress("stress, safety and frequency of the optimum")
        with threadpool_limits(1):
            optimum = evaluators.version_of(plan, Case(best.values))
            further = strength_and_modes(optimum, plan.mesh, list(elements.values()))
    return Optimum(plan, rounds, converged_searches, broken, further)


def _refuse_unknown(plan: SweepPlan) -> None:
    """Refuse what the formulas do not give for the design itself."""
    known = list(_by_formulas(plan, {}))
    named = {"aim": plan.aims[0].quantity} | {f"limits.{limit.quantity}": limit.quantity for limit in plan.limits}
    for place, quantity in named.items():
        if (key := key_of(quantity)) not in known:
            raise InputError(plan.file, place, quantity, f"is no quantity of the formulas{suggest(key, known)}")


def _is_confirmed(plan: SweepPlan, predicted: Found, elements: Found) -> bool:
    """Tell whether finite elements find what the corrected formulas promised, of aim and limits."""
    named = {key_of(plan.aims[0].quantity), *(key_of(limit.quantity) for limit in plan.limits)}
    pairs = [(predicted[key].value, elements[key].value) for key in named if key in predicted and key in elements]
    return all(abs(predicted_gain - true) <= SETTLED * abs(true) for predicted_gain, true in pairs)


# --- one round --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Point:
    """Where a search ended: what varies, its cost, and by how much it breaks its limits."""

    values: Mapping[str, float | str]
    cost: float
    violation: float

    @property
    def rank(self) -> tuple[float, float]:
        """Designs that keep their limits come first, the cheapest of them in front."""
        return (0.0, self.cost) if self.violation <= SLACK else (self.violation, self.cost)


def _search(plan: SweepPlan, correction: Mapping[str, float]) -> tuple[_Point, tuple[int, int]]:
    """Return the best point of all choices, and how many searches ended there."""
    minima: list[_Point] = []
    for choice in _choices(plan.factors):
        minima += _search_choice(plan, choice, correction)
    if not minima:
        raise InputError(plan.file, "vary", None, "holds no design that can be built; move the ranges")
    best = min(minima, key=lambda point: point.rank)
    near = [p for p in minima if abs(p.cost - best.cost) <= SETTLED * abs(best.cost)]
    return best, (sum(p.violation <= best.violation + SLACK for p in near), len(minima))


def _choices(factors: Sequence[Factor]) -> Iterator[dict[str, float | str]]:
    """Yield every combination of what has no range."""
    lists = [factor for factor in factors if factor.ends is None]
    for values in itertools.product(*(factor.values for factor in lists)):
        yield dict(zip((factor.key for factor in lists), values, strict=True))


def _search_choice(plan: SweepPlan, choice: Mapping[str, float | str], correction: Mapping[str, float]) -> list[_Point]:
    """Return where searches end that begin at the best of a sample, for one combination of choices."""
    from scipy.optimize import minimize

    ranged = [factor for factor in plan.factors if factor.ends]
    aim = plan.aims[0]

    def values(x: Array) -> dict[str, float | str]:
        return {**choice, **{f.key: f.at(float(share)) for f, share in zip(ranged, np.clip(x, 0, 1), strict=True)}}

    def found(x: Array) -> Found | None:
        try:
            return _correct(_by_formulas(plan, values(x)), correction)
        except (InputError, ArithmeticError, ValueError):
            return None

    def point(x: Array) -> _Point | None:
        there = found(x)
        if there is None or not math.isfinite(_cost(aim, there)):
            return None
        return _Point(values(x), _cost(aim, there), max((_violation(c, there) for c in plan.limits), default=0.0))

    sample = [np.array(x) for x in _unit_sample(len(ranged), plan.seed)]
    tried = [(made, x) for x in sample if (made := point(x)) is not None]
    tried.sort(key=lambda pair: pair[0].rank)
    minima = []
    for made, x in tried[:FOLLOWED]:
        scale = abs(made.cost) or 1.0
        memory: _Memory = {}

        def both(at: Array, scale: float = scale, memory: _Memory = memory) -> tuple[float, Array]:
            if (key := at.tobytes()) not in memory:
                there = found(at)
                margins = np.full(len(plan.limits), -1.0)
                if there is not None:
                    margins = np.array([-_violation(limit, there, signed=True) for limit in plan.limits])
                memory[key] = (UNBUILDABLE if there is None else _cost(aim, there) / scale, margins)
            return memory[key]

        constraints: list[dict[str, Any]] = [{"type": "ineq", "fun": lambda at, both=both: both(at)[1]}]
        solution = minimize(
            lambda at, both=both: both(at)[0],
            x,
            method="SLSQP",
            bounds=[(0.0, 1.0)] * len(ranged),
            constraints=constraints if plan.limits else [],
            options={"maxiter": STEPS, "ftol": 1e-9, "eps": DIFFERENCE},
        )
        last = point(np.asarray(solution.x))
        minima.append(min((p for p in (last, made) if p is not None), key=lambda p: p.rank))
    return minima


def _unit_sample(dimensions: int, seed: int) -> Iterator[list[float]]:
    factors = [Factor(str(i), (), (0.0, 1.0), si="1") for i in range(dimensions)]
    for case in cases(factors, "sobol", SAMPLED, seed):
        yield [float(share) for share in case.values.values()]


# --- a design ---------------------------------------------------------------------------------------------------


def _by_formulas(plan: SweepPlan, values: Mapping[str, float | str]) -> Found:
    model = evaluators.MODELS.get(plan.evaluator, evaluators.MODELS["analytic"])
    return by_key(evaluators.by_formulas(evaluators.version_of(plan, Case(values)), model))


def _correct(found: Found, correction: Mapping[str, float]) -> Found:
    return {key: replace(q, value=q.value * correction.get(key, 1.0)) for key, q in found.items()}


def _value(quantity: str, found: Found) -> float:
    there = found.get(key_of(quantity))
    return math.nan if there is None else value_by_name(quantity, there.value)


def _cost(aim: Aim, found: Found) -> float:
    return -_value(aim.quantity, found) if aim.is_largest else _value(aim.quantity, found)


def _violation(limit: Limit, found: Found, *, signed: bool = False) -> float:
    """Return by what share of its bound a limit is broken; negative, if `signed`, by what share it is kept."""
    key = key_of(limit.quantity)
    if key not in found:
        return math.inf
    bound = limit.bound(found[key].si)
    beyond = (_value(limit.quantity, found) - bound) * (1 if limit.is_upper else -1) / (abs(bound) or 1.0)
    return beyond if signed else max(beyond, 0.0)
