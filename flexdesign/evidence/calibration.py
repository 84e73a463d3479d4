"""Calibration: the numbers of the model itself, fitted from several starts; or left as they are."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from flexdesign.evidence.case import Case
from flexdesign.evidence.marquardt import Solution, solve
from flexdesign.evidence.stand import Stand, judged, solved
from flexdesign.model import Model

#: Starts of the calibration end where a step lowers the cost by less than this share; the best is then refined.
CALIBRATION_SHARE = 1e-4
#: A first start that leaves less than this times the noise needs no others; others find Jacobians so often,
#: and agree if their costs differ by no more than this share.
GOOD, FOLLOWED, AGREED = 1.5, 8, 0.01
#: Points of a sample from which the best become starts of the calibration.
SAMPLED = 16


def evaluated(case: Case, model: Model) -> Stand | None:
    """Return the fit of a model whose own numbers stay; only its initial conditions are fitted.

    Its Jacobian holds the free numbers all the same, so that a screening there knows what they can imitate.
    """
    beginning = solved(replace(case, free=()), model, (), {}, share=CALIBRATION_SHARE, exact=False)
    if beginning is None:
        return None
    here = beginning.problem.at(beginning.x)
    where = case.coordinates(here, case.free, beginning.problem.suite)
    solution = solve(case.problem(beginning.problem.suite, here, where), where.start, most=0)
    return None if solution is None else judged(case, solution, (), CALIBRATION_SHARE)


def calibrated(case: Case, model: Model, starts: int = 4, seed: int = 0) -> tuple[Stand | None, int]:
    """Fit the model as it is from several starts; return the best, and how many ended there.

    The first start is the model's own values; the others are the best of a sample of what is plausible or known. The
    search ends early when two agree.
    """
    first = solved(case, model, (), {}, share=CALIBRATION_SHARE, exact=False)
    found = [] if first is None else [first]
    # Where the first leaves hardly more than noise no other minimum can be deeper by much.
    if first is None or first.cost >= GOOD * case.identify.samples:
        for values in _sampled(case, model, starts - 1, seed):
            case.progress(f"calibrating: start {len(found) + 1}")
            made = solved(case, model, (), values, share=CALIBRATION_SHARE, most=FOLLOWED, exact=False)
            if made is not None:
                found.append(made)
                if _agreed(found) > 1:
                    break
    best = min(found, key=lambda solution: solution.cost, default=None)
    return None if best is None else judged(case, best, (), CALIBRATION_SHARE), _agreed(found)


def _agreed(found: Sequence[Solution]) -> int:
    least = min((solution.cost for solution in found), default=0.0)
    return sum(solution.cost <= (1 + AGREED) * least for solution in found)


def _sampled(case: Case, model: Model, count: int, seed: int) -> Iterator[dict[str, float]]:
    """Yield values of the free numbers, the best of a sample."""
    from scipy.stats.qmc import Sobol

    where = case.coordinates(model, case.free, case.identify)
    shared = [j for j, parameter in enumerate(where.parameters) if not parameter.run]
    problem = case.problem(case.identify, model, where)
    low, high = where.sampled()
    tried = []
    for unit in Sobol(len(shared), rng=np.random.default_rng(seed)).random(SAMPLED):
        x = where.start.copy()
        x[shared] = low[shared] + unit * (high - low)[shared]
        tried.append((problem.cost(x, problem.residuals(x)), x))
    tried.sort(key=lambda pair: pair[0])
    for cost, x in tried[:count]:
        if math.isfinite(cost):
            yield where.values(x)
