"""The fit that calibration, comparison of effects and diagnosis share: weighted nonlinear least squares, honestly."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.errors import InputError
from flexdesign.evidence.coordinates import coordinates
from flexdesign.evidence.covariance import Spread, spread
from flexdesign.evidence.noise import Noise, White, Whitening
from flexdesign.evidence.profile import Profile, profile, quadratic
from flexdesign.evidence.residuals import Map, Residuals, records
from flexdesign.evidence.search import Minimum, Starts, polish, search
from flexdesign.evidence.sharing import sharing
from flexdesign.evidence.verdict import Estimate, correlation, estimates
from flexdesign.model import Model, Observation

Array = NDArray[np.float64]
#: How often a fit begins again when a profile meets a better point, and how often prior and data are balanced.
AGAIN, BALANCED = 3, 6


@dataclass(frozen=True, eq=False)
class Match:
    """How well the fitted model matches one observation.

    Parameters
    ----------
    name
        Name of the observation.
    residual
        Measured less predicted less offset, SI, shaped as measured; NaN at gaps.
    offset
        The offset of each channel, SI; zeros if none was taken out.
    rms
        Root mean square of the residual, SI.
    error
        The same over the largest range that a channel covers; a ratio.
    r2
        Share of the measured variance that the model explains.
    sigma
        Standard deviation of what the model leaves, the fit's degrees of freedom counted; SI.
    inflation
        How many samples count as one because neighbours are correlated; 1 if the residual is white.
    """

    name: str
    residual: NDArray[Any]
    offset: tuple[float, ...]
    rms: float
    error: float
    r2: float
    sigma: float
    inflation: float


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model and what the data say about its parameters.

    Parameters
    ----------
    model
        The model with the best values, those among them that the data do not determine.
    estimates
        The verdict on each free parameter, in the order asked for.
    correlation
        Of the free parameters' coordinates, in that order. Parameters in an open direction have no correlation.
    matches
        How well each observation is matched.
    cost
        Sum of squares of whitened residuals and of what was known.
    reduced
        Reduced chi^2; None where the noise was not given.
    dof
        Degrees of freedom behind the intervals, correlated samples counted as fewer; infinite where the noise was
        given and explains the residual.
    starts
        How the starts ended.
    evaluations, failures
        Number of simulations, and of those that gave no numbers.
    """

    model: Model
    estimates: tuple[Estimate, ...]
    correlation: Array
    matches: tuple[Match, ...]
    cost: float
    reduced: float | None
    dof: float
    starts: Starts
    evaluations: int
    failures: int

    def __getitem__(self, name: str) -> Estimate:
        """Return the verdict on one parameter.

        Raises
        ------
        KeyError
            If the parameter was not free.
        """
        return {estimate.name: estimate for estimate in self.estimates}[name]

    @property
    def values(self) -> dict[str, float]:
        """The determined values, SI."""
        return {e.name: e.value for e in self.estimates if e.value is not None}

    @property
    def sigmas(self) -> dict[str, float]:
        """The standard deviations of the determined values, SI."""
        return {e.name: e.sigma for e in self.estimates if e.sigma is not None}

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the parameters that the data do not determine."""
        return tuple(e.name for e in self.estimates if not e.determined)

    def table(self) -> list[tuple[str, str, str, str]]:
        """Return a row for each parameter: name, value with unit, 95 % interval with unit, remark."""
        return [(e.name, e.value_text, e.interval_text, e.reason) for e in self.estimates]


def fit(
    model: Model,
    observations: Sequence[Observation],
    free: Sequence[str],
    *,
    known: Mapping[str, tuple[float, float]] | None = None,
    noise: Noise = None,
    offsets: bool | Collection[str] = True,
    starts: int = 8,
    seed: int = 0,
    threads: int | None = None,
    profiles: bool = True,
    reveal: Mapping[str, str] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Fit:
    """Fit free parameters of a model to what was measured, and say which of them the data determine.

    The offsets are linear and are eliminated exactly (Golub and Pereyra 1973), so that the parameters carry their
    uncertainty. What was known before enters as further residuals. A model that fails at some values (numbers that
    are not finite, an ArithmeticError) is taken to fit infinitely badly there.

    Parameters
    ----------
    model
        Its parameters' `start` are the present values.
    observations
        What was measured, for identification.
    free
        Names of the parameters to be fitted.
    known
        Values known before with their standard deviations, SI, Gaussian; those of parameters that are not free are
        passed over.
    noise
        The noise of the observations, SI. Unknown by default: white, alike in all observations, its level taken from
        the residual.
    offsets
        Whether each channel of each observation has an unknown constant added to it; or the names of the observations
        where it has.
    starts
        How many starts may be followed.
    seed
        Of the sample of starts.
    threads
        How many simulations run at a time; two by default, if there are two processors.
    profiles
        Whether intervals are checked by profile likelihood, at the price of about five simulations per parameter where
        they prove right.
    reveal
        The experiment that would show a parameter, by its name, for the reasons given.
    progress
        Told what is being done. An exception raised here, or Ctrl-C, ends the fit.

    Raises
    ------
    InputError
        If names, noise, observations or numbers of samples do not fit together, or the model fails everywhere.
    """
    if starts < 1:
        raise InputError("fit", "starts", starts, "a fit needs at least one start")
    where = coordinates(model, free, known or {})
    whitening = _whitening(noise)
    residuals = Residuals(model, records(observations, whitening, offsets), where, whitening)
    if residuals.samples <= len(free) + residuals.offsets:
        asked = f"{len(free)} parameters and {residuals.offsets} offsets need more samples than that"
        raise InputError("fit", "observations", f"{residuals.samples} samples", asked)
    with sharing(_counted(threads)) as each:
        best, ended, minima = search(residuals, starts, seed, each, progress)
        best, found = _balanced(residuals, best, each, noise is not None)
        progress("checking the intervals")
        intervals = _intervals(residuals, best, found, each, profiles)
        for _ in range(AGAIN):
            better = next((i.better for i in intervals if i and i.better is not None), None)
            if better is None:
                break
            progress("a better point was met: fitting again")
            best, found = _balanced(residuals, polish(residuals, better, each=each), each, noise is not None)
            ended = Starts(ended.asked, ended.polished, 0)
            intervals = _intervals(residuals, best, found, each, profiles)
    return Fit(
        model=model.replace(where.values(best.x)),
        estimates=estimates(residuals, best, found, intervals, minima, reveal or {}),
        correlation=correlation(found.covariance),
        matches=_matches(residuals, best.x, found),
        cost=best.cost,
        reduced=None if noise is None else found.reduced,
        dof=found.dof,
        starts=ended,
        evaluations=residuals.evaluations,
        failures=residuals.failures,
    )


def _balanced(residuals: Residuals, minimum: Minimum, each: Map, noise_is_known: bool) -> tuple[Minimum, Spread]:
    """Return the minimum to full accuracy and its spread, what was known balanced against what the data leave.

    Earlier knowledge is weighed against the scatter of the data. Where that shows only in the residual, or where
    correlated samples count as fewer, the weight follows from the fit itself, so that both are found in turn.
    """
    for _ in range(BALANCED):
        minimum = polish(residuals, minimum.x, each=each, tolerance=1e-10, central=True)
        jacobian = residuals.jacobian(minimum.x, minimum.steps, each=each, central=True)
        found = spread(residuals, minimum.x, jacobian, noise_is_known)
        if not residuals.where.known or not found.variance:
            break
        before = residuals.scale
        counted = float(np.mean(found.inflation))
        residuals.scale *= math.sqrt(found.variance * counted)
        if abs(residuals.scale / before - 1) < 0.02:
            residuals.scale = before
            break
    return minimum, found


def _intervals(
    residuals: Residuals, minimum: Minimum, found: Spread, each: Map, profiles: bool
) -> list[Profile | None]:
    """Return the interval of every coordinate, None for those in an open direction."""
    # A coordinate that shows in no small step may show in a large one: a limit that the runs stay far below.
    shut = [j for j in range(len(minimum.x)) if not found.is_open(j) or (profiles and not found.company(j))]
    check = profile if profiles else quadratic
    checked = dict(zip(shut, each(lambda j: check(residuals, minimum, found, j), shut), strict=True))
    return [checked.get(j) for j in range(len(minimum.x))]


def _matches(residuals: Residuals, x: Array, found: Spread) -> tuple[Match, ...]:
    made = []
    differences = residuals.raw(x)
    assert differences is not None  # the minimum was reached, so that the model answers there
    for record, difference, inflation, taken in zip(
        residuals.records, differences, found.inflation, found.taken, strict=True
    ):
        offset = record.offsets(residuals.noise.whiten(record.observation, difference))
        residual = np.where(record.present, difference - offset, np.nan)
        measured = np.where(record.present, record.measured, np.nan)
        energy, count = float(np.nansum(residual**2)), int(record.present.sum())
        variance = float(np.nansum((measured - np.nanmean(measured, axis=0)) ** 2))
        rms, reach = math.sqrt(energy / count), float(np.max(np.nanmax(measured, axis=0) - np.nanmin(measured, axis=0)))
        made.append(
            Match(
                name=record.observation.name,
                residual=record.restored(residual),
                offset=tuple(float(o) for o in offset),
                rms=rms,
                error=rms / reach if reach else math.nan,
                r2=1 - energy / variance if variance else math.nan,
                sigma=math.sqrt(energy / max(count - taken, 0.1 * count)),
                inflation=inflation,
            )
        )
    return tuple(made)


def _whitening(noise: Noise) -> Whitening:
    if noise is None:
        return White(1.0)
    return White(noise) if isinstance(noise, (int, float, Mapping)) else noise


def _counted(threads: int | None) -> int:
    """Return the number of threads; by default two, where there are as many processors."""
    count = min(2, os.cpu_count() or 1) if threads is None else threads
    if count < 1:
        raise InputError("fit", "threads", threads, "a fit needs at least one thread")
    return count
