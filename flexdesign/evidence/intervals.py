"""Intervals of fitted parameters: from the covariance, checked and corrected by the profile likelihood."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from flexdesign.evidence.identifiability import Estimate, estimates
from flexdesign.evidence.marquardt import MINIMUM, Solution, polish, solve
from flexdesign.evidence.profile_likelihood import Profile, profile, quadratic
from flexdesign.evidence.uncertainty import Uncertainty, uncertainty

Array = NDArray[np.float64]
#: How often profiles are made; again where the first met a better point.
PASSES = 2
#: The middle of an interval is found to this many standard deviations.
CENTRED = 0.05


def intervals(
    solution: Solution,
    names: Sequence[str],
    *,
    known_variance: float | None = 1.0,
    profiles: bool = True,
    reveal: Mapping[str, str] | None = None,
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
    known_variance
        Of the whitened residual where the noise is given; None where it is unknown.
    profiles
        Whether the ends are checked by the profile likelihood.
    reveal
        The experiment that would show a parameter, by its name, for the reasons given.
    """
    places = [solution.problem.where.names.index(name) for name in names]
    for _ in range(PASSES):
        accuracy = CENTRED**2 * uncertainty(solution, known_variance).variance
        solution = polish(solution, accuracy + solution.problem.suite.floor)
        found = uncertainty(solution, known_variance)
        checked = profiles_of(solution, found, places, profiles)
        if (better := better_point(checked.values())) is None:
            break
        solution = solve(solution.problem.anew(), better, MINIMUM) or solution
    return estimates(solution, found, checked, reveal=reveal)


def profiles_of(
    solution: Solution, found: Uncertainty, places: Sequence[int], check: bool = True
) -> dict[int, Profile | None]:
    """Return the intervals of some coordinates, each end checked by a profile or not; None in the null space."""
    # A coordinate that shows in no small step may show in a large one: a limit that the runs stay far below.
    shown = [j for j in places if not found.in_null_space(j) or (check and not found.confounded_with(j))]
    make = profile if check else quadratic
    made = dict(zip(shown, solution.problem.each(lambda j: make(solution, found, j), shown), strict=True))
    return {j: made.get(j) for j in places}


def better_point(profiles: Iterable[Profile | None]) -> Array | None:
    """Return a point that fits better than the minimum that the profiles began at, if one was met."""
    return next((each.better for each in profiles if each is not None and each.better is not None), None)
