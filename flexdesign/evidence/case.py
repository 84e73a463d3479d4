"""What a diagnosis is about: runs that a fit may see, runs kept apart, and what was known before."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexdesign.evidence.coordinates import Coordinates, coordinate, coordinates
from flexdesign.evidence.marquardt import SHARE
from flexdesign.evidence.residuals import MOVED, Map
from flexdesign.evidence.suite import Problem, Suite
from flexdesign.model import Model

if TYPE_CHECKING:
    from flexdesign.evidence.stand import Stand

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Fitting:
    """How fits are made.

    Parameters
    ----------
    share, last
        None goes on where a step promises to lower the cost by less than this share; and that of the last one, whose
        numbers are told.
    moved
        How far a finite difference should move the data, relative.
    sparing
        Whether simulations are saved that hardly change what is found: what effects do is not asked again at a stand
        nearby.
    """

    share: float = SHARE
    last: float = SHARE
    moved: float = MOVED
    sparing: bool = False


@dataclass(frozen=True, eq=False)
class Case:
    """What a diagnosis is about.

    Parameters
    ----------
    identify, validate
        Runs that a fit may see, and runs kept apart.
    free
        Names of the numbers of the model itself that are fitted.
    known
        Returns what was known of a model's numbers: value and standard deviation, SI, by name.
    tolerance
        What an effect must at least move a held-out prediction, rms [response].
    coarse, fine, finest
        Make a model that predicts less exactly and faster, for screening; one that predicts exactly; and one whose
        errors are small beside those of values that many samples determine, which are far below the noise.
    sloping
        Makes a model whose slopes serve in the place of a model's own, and may be had sooner.
    each
        Maps simulations, over threads perhaps; and whole fits that map theirs by it, see `flexdesign.evidence.sharing`.
    progress
        Told what is being done.
    designed
        Values of the free numbers before anything was fitted, SI.
    floor
        Rms noise of what judges [response]; zero where it is unknown.
    test
        Runs that neither fit nor choice has seen; None if there are none.
    prepared
        Returns the case with the initial conditions that the effects of a model have.
    believed
        How many standard deviations from what is known of it a number of one run may be.
    drawn
        Yields errors that readings of the runs in `identify` may have at a stand, by run [response], where these are no
        Gaussian noise; nothing where they are.
    weights
        By the name of an observation what a value of it counts, beside `tolerance`, when it is asked how far an effect
        moves a prediction; one where it is not there.
    scales
        By the name of an observation whose values are not equally noisy what these are multiplied with before their
        root mean square is stated: typical noise over their own.
    judging
        Names of the observations whose error is stated; by default those kept apart, or all if there are none.
    fitting
        How fits are made.
    """

    identify: Suite
    validate: Suite
    free: tuple[str, ...]
    known: Callable[[Model], Mapping[str, tuple[float, float]]]
    tolerance: float
    coarse: Callable[[Model], Model] = lambda model: model
    fine: Callable[[Model], Model] = lambda model: model
    finest: Callable[[Model], Model] = lambda model: model
    sloping: Callable[[Model], Model] = lambda model: model
    each: Map = map
    progress: Callable[[str], None] = lambda _: None
    designed: Mapping[str, float] = field(default_factory=dict)
    floor: float = 0.0
    test: Suite | None = None
    prepared: Callable[[Case, Model], Case] = lambda case, _: case
    believed: float = math.inf
    drawn: Callable[[Stand], Iterable[Mapping[str, Array]]] = lambda _: ()
    weights: Mapping[str, Array] = field(default_factory=dict)
    scales: Mapping[str, Array] = field(default_factory=dict)
    judging: tuple[str, ...] = ()
    fitting: Fitting = Fitting()

    @property
    def at_last(self) -> Case:
        """The case as the last fit is made."""
        return replace(self, fitting=replace(self.fitting, share=self.fitting.last))

    def problem(self, suite: Suite, model: Model, where: Coordinates) -> Problem:
        """Return a model with free numbers, to be laid beside a suite."""
        return Problem(suite, model, where, self.each, self.fitting.moved, self.sloping)

    def coordinates(self, model: Model, free: Sequence[str], suite: Suite) -> Coordinates:
        """Return free numbers and those of each run as coordinates."""
        runs = {record.observation.name for record in suite.records}
        own = [parameter.name for parameter in model.parameters() if parameter.run in runs]
        names = [*free, *own]
        if not names:  # frequency responses have no numbers of their own
            return Coordinates((), {}, np.zeros(0), np.zeros(0), np.zeros(0))
        known = {name: about for name, about in self.known(model).items() if name in names}
        return _near(coordinates(model, names, known), self.believed)


def _near(where: Coordinates, believed: float) -> Coordinates:
    """Return coordinates with numbers of one run no more than so many standard deviations from what is known."""
    lower, upper = where.lower.copy(), where.upper.copy()
    for j, parameter in enumerate(where.parameters):
        if parameter.run and parameter.name in where.known:
            middle, sigma = where.known[parameter.name]
            lower[j] = max(lower[j], coordinate(parameter, middle - believed * sigma))
            upper[j] = min(upper[j], coordinate(parameter, middle + believed * sigma))
    return replace(where, lower=lower, upper=upper, start=np.clip(where.start, lower, upper))
