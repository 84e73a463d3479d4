"""How a record began, of which little is known: late, ringing, still creeping, from where the voltage had turned."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from flexdesign.dynamics.axis_model import CAME_FROM, AxisDynamics
from flexdesign.dynamics.axis_parameters import TRIGGER
from flexdesign.effects import creep
from flexdesign.evidence.case import Case
from flexdesign.evidence.caught import fitted_in_line
from flexdesign.evidence.noise import Whitening
from flexdesign.evidence.screening import Candidate, Moves
from flexdesign.evidence.selection import PLAIN_CHANCE, SURE, forward
from flexdesign.evidence.stand import Stand
from flexdesign.evidence.trial import Step
from flexdesign.model import Observation, Parameter
from flexdesign.runs import FrequencyResponse, Run
from flexdesign.stage_model import AxisModel

Array = NDArray[np.float64]
#: How little is known, one sigma: samples that a record was late, share of the largest command where the voltage had
#: turned, share of the stroke that the mode swings by, and that slow states still move.
LATE, TURNED, SWINGS, SLOW = 0.3, 0.4, 0.1, 0.01
#: Slow states that may still relax as a record begins have these time constants [s].
RELAXING = (0.1, 0.4, 1.6, 6.4, 25.6)
#: Before the first fit, delays are tried up to this one [s], at so many periods of the mode from each other.
LATEST, IN_TIME = 0.012, 0.125
#: And natural frequencies this far away, relative, at such steps: from farther than a resonance is wide, slopes lead
#: nowhere. A payload or a loose part may have changed it by so much.
OUT_OF_TUNE, IN_TUNE = 0.24, 0.03
#: What moves slowly in all records promises at least this share of what amounts of their own made up for.
PROMISED = 0.3


def known_of_start(parameter: Parameter, runs: Sequence[Run], volts: float) -> tuple[float, float] | None:
    """Return what is known of a number of one run: about how late it began, and where the voltage had turned."""
    run, _, number = parameter.name.rpartition(":")
    if number == TRIGGER:
        return 0.0, LATE * next(each.period for each in runs if each.name == run)
    if number in CAME_FROM:
        return CAME_FROM[number] * volts, TURNED * volts
    return None


@dataclass(frozen=True)
class Beginning:
    """What adds to a record because of how it began: an offset, a mode that rings, and slow states if `is_slow`."""

    axis: AxisModel
    stroke: float
    is_slow: bool = True

    def __call__(self, observation: Observation) -> tuple[Array, Array]:
        """Return the columns, samples by k, and how large each may be [response]; a frequency response has none."""
        if isinstance(observation, FrequencyResponse):
            return np.zeros((len(observation.measured()), 0)), np.zeros(0)
        run = cast(Run, observation)
        t = run.time - run.time[0]
        w = 2 * math.pi * self.axis.natural_frequency
        ringing = np.exp(-self.axis.damping_ratio * w * t)
        slow = [(tau, SLOW * self.stroke) for tau in RELAXING if self.is_slow] + self.creeping
        relaxing = [np.exp(-t / tau) for tau, _ in slow]
        columns = np.column_stack([np.ones_like(t), ringing * np.cos(w * t), ringing * np.sin(w * t), *relaxing])
        swings = SWINGS * self.stroke
        return columns, np.array([math.inf, swings, swings, *(size for _, size in slow)])

    @property
    def creeping(self) -> list[tuple[float, float]]:
        """Time constants [s] of creep that the axis is known to have, and how far each may still have to go."""
        values = self.axis.effects.get("creep")
        if values is None or creep.EFFECT.is_null(values):
            return []
        return [(tau, values["per_decade"] * self.stroke) for tau in creep.time_constants(values["t0"])]


def begins_otherwise(before: AxisDynamics, after: AxisDynamics) -> bool:
    """Tell whether records may begin in more ways with another model."""
    return "creep" in after.axis.effects and "creep" not in before.axis.effects


def begun_like(case: Case, model: AxisDynamics, noise: Whitening | None = None, *, is_slow: bool = True) -> Case:
    """Return the case with records that begin as the numbers of a model allow, and perhaps with other noise."""
    ways = Beginning(model.axis, model.stroke, is_slow)
    identify, validate = (suite.with_shapes(ways, noise) for suite in (case.identify, case.validate))
    return replace(case, identify=identify, validate=validate)


def at_rest(
    case: Case, stand: Stand, candidates: Sequence[Candidate], moves: Moves | None, noise: Whitening | None = None
) -> tuple[Case, Stand, Step] | None:
    """Return the case with records that begin at rest, the stand there, and what to add, if likelier; else None.

    States that relax slowly, in each record by an amount of its own, make up for what moves slowly in all of them, such
    as a drift. That is the likelier cause if it explains as much: amounts that happen to agree cost their freedom.
    """
    model = cast(AxisDynamics, stand.model)
    if "creep" in stand.names:
        return None
    still = begun_like(case, model, noise, is_slow=False)
    calm = fitted_in_line(still, model, stand.effects)  # lest what frees a run that is caught be taken for a cause
    scale = max(stand.scale, 1.0)
    if calm is None or calm.seen_cost - stand.seen_cost < SURE * PLAIN_CHANCE * scale:
        return None  # nothing moves slowly
    saved = sum(a.freedom - b.freedom for a, b in ((case.identify, still.identify), (case.validate, still.validate)))
    step = forward(still, calm, candidates, moves, promising=PROMISED * (calm.cost - stand.cost - saved * scale))
    if step.chosen is None:
        return None
    more = (step.chosen.stand.total - stand.total) / scale
    return (still, calm, step) if more < saved else None


def in_time(case: Case, dynamics: AxisDynamics) -> AxisDynamics:
    """Return the model with all runs as late as the data ask for, if that is more than slopes would find.

    From half a period of the mode on, a fit that begins without delay goes the wrong way.
    """
    if not math.isinf(case.believed):
        return dynamics

    def late_by(late: float) -> AxisDynamics:
        return dynamics.replace({f"{run}:{TRIGGER}": late for run in dynamics.apart})

    step = IN_TIME / dynamics.first.natural_frequency
    costs = {late: _cost(case, late_by(late)) for late in np.arange(0.0, LATEST, step).tolist()}
    best = min(costs, key=lambda late: costs[late])
    return late_by(best) if best > step else dynamics


def in_tune(case: Case, dynamics: AxisDynamics) -> AxisDynamics:
    """Return the model with the natural frequency that the data ask for, if that is farther than slopes would find."""
    designed = dynamics.first.natural_frequency

    def tuned(factor: float) -> AxisDynamics:
        return dynamics.replace({"natural_frequency": factor * designed})

    factors = (1 + np.arange(-OUT_OF_TUNE, OUT_OF_TUNE + IN_TUNE / 2, IN_TUNE)).tolist()
    costs = {factor: _cost(case, tuned(factor)) for factor in factors}
    best = min(costs, key=lambda factor: costs[factor])
    return tuned(best) if abs(best - 1) > 1.5 * IN_TUNE else dynamics


def _cost(case: Case, model: AxisDynamics) -> float:
    """Return what a model leaves of the runs that are fitted, nothing of it fitted but what may add to a record."""
    where = case.coordinates(model, (), case.identify)
    problem = case.problem(case.identify, model, where)
    left = problem.residuals(where.start)
    return math.inf if left is None else float(sum(e @ e for e in left))
