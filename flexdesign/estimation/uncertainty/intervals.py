"""Intervals of fitted parameters: from the covariance, checked and corrected by the profile likelihood."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

from flexdesign.estimation.least_squares.levenberg_marquardt import Solution, refine_minimum, solve
from flexdesign.estimation.uncertainty.covariance import Uncertainty, uncertainty
from flexdesign.estimation.uncertainty.identifiability import Estimate, estimates
from flexdesign.estimation.uncertainty.profile_likelihood import Profile, profile, quadratic

#: By place of the coordinate; None in the null space.
Profiles = dict[int, Profile | None]


def intervals(
    solution: Solution,
    names: Sequence[str],
) -> tuple[Estimate, ...]:
    """Return what a fit says about some of its parameters: value, standard deviation, 95 % interval, identifiability.

    The residual counts as it is: where it is coloured or larger than the noise, as where physics is missing, intervals
    are wider; where it is white and as large as the given noise they are the classical ones. Two predictions of all
    records per parameter check the ends; more are made where these prove wrong. The fit is polished before, and
    repeated where a better point is met on the way: the values are those of the best point.

    Parameters
    ----------
    solution
        The fit. Its Jacobian may be approximate: it gives the covariance and the first guess of each end.
    names
        Of parameters; the others are nuisance parameters.
    """
    places = [solution.problem.where.names.index(name) for name in names]
    solution, found, made, _ = check_intervals(solution, places, _refine)
    return estimates(solution, found, made)


def better_fit(solution: Solution, names: Sequence[str]) -> Solution | None:
    """Return the fit to which a better point leads that the profile of some parameters meets; None if none is met."""
    places = [solution.problem.where.names.index(name) for name in names]
    best, _, _, is_better = check_intervals(solution, places, _refine)
    return best if is_better else None


@lru_cache(maxsize=4)
def _refine(near: Solution) -> tuple[Solution, Uncertainty]:
    """Return a fit whose numbers are right to 0.05 standard deviations, and its uncertainty."""
    accuracy = 0.05**2 * uncertainty(near).variance
    polished = refine_minimum(near, accuracy + near.problem.dataset.floor)
    return polished, uncertainty(polished)


def check_intervals(
    solution: Solution,
    places: Sequence[int],
    refine: Callable[[Solution], tuple[Solution, Uncertainty]],
    check: bool = True,
) -> tuple[Solution, Uncertainty, Profiles, bool]:
    """Return a fit, its uncertainty, the intervals of some coordinates, and whether a better fit was met on the way.

    From a better point that a profile meets the fit is repeated, twice at most.

    Parameters
    ----------
    solution, places
        The fit, and the coordinates.
    refine
        Converges a fit, and finds its uncertainty.
    check
        Whether ends are checked by a profile.
    """
    for refits in range(3):
        solution, found = refine(solution)
        made = profiles_of(solution, found, places, check)
        better = next((p.better for p in made.values() if p is not None and p.better is not None), None)
        if better is None or refits == 2:
            break
        solution = solve(solution.problem.fresh(), better) or solution
    return solution, found, made, refits > 0


def profiles_of(solution: Solution, found: Uncertainty, places: Sequence[int], check: bool = True) -> Profiles:
    """Return the intervals of some coordinates, each end checked by a profile or not; None in the null space."""
    # A coordinate that shows in no small step may show in a large one: a limit that the runs stay far below.
    chosen = [j for j in places if not found.in_null_space(j) or (check and not found.confounded_with(j))]
    make = profile if check else quadratic
    made = dict(zip(chosen, solution.problem.each(lambda j: make(solution, found, j), chosen), strict=True))
    return {j: made.get(j) for j in places}
