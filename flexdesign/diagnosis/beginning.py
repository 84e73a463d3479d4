"""How a record began, of which little is known: late, ringing, still creeping, from where the voltage had turned."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from flexdesign.dynamics.axis_model import CAME_FROM, TRIGGER, AxisDynamics
from flexdesign.effects import creep
from flexdesign.evidence.noise import Whitening
from flexdesign.evidence.stand import Case
from flexdesign.evidence.suite import Problem
from flexdesign.model import Observation, Parameter
from flexdesign.runs import Run
from flexdesign.stage_model import AxisModel

Array = NDArray[np.float64]
#: How little is known, one sigma: samples that a record was late, share of the largest command where the voltage had
#: turned, share of the stroke that the mode swings by, and that slow states still move.
LATE, TURNED, SWINGS, SLOW = 0.3, 0.4, 0.1, 0.01
#: Slow states that may still relax as a record begins have these time constants [s].
RELAXING = (0.1, 0.4, 1.6, 6.4, 25.6)
#: Before the first fit, delays are tried up to this one [s], at so many periods of the mode from each other.
LATEST, IN_TIME = 0.012, 0.125


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
    """What adds to a record because of how it began: an offset, a mode that rings, slow states that relax."""

    axis: AxisModel
    stroke: float

    def __call__(self, observation: Observation) -> tuple[Array, Array]:
        """Return the columns, samples by k, and how large each may be [response]."""
        run = cast(Run, observation)
        t = run.time - run.time[0]
        w = 2 * math.pi * self.axis.natural_frequency
        ringing = np.exp(-self.axis.damping_ratio * w * t)
        slow = [(tau, SLOW * self.stroke) for tau in RELAXING] + self.creeping
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


def begun_like(case: Case, model: AxisDynamics, noise: Whitening | None = None) -> Case:
    """Return the case with records that begin as the numbers of a model allow, and perhaps with other noise."""
    ways = Beginning(model.axis, model.stroke)
    identify, validate = (suite.with_shapes(ways, noise) for suite in (case.identify, case.validate))
    return replace(case, identify=identify, validate=validate)


def in_time(case: Case, dynamics: AxisDynamics) -> AxisDynamics:
    """Return the model with all runs as late as the data ask for, if that is more than slopes would find.

    From half a period of the mode on, a fit that begins without delay goes the wrong way.
    """
    if not math.isinf(case.believed):
        return dynamics

    def cost(late: float) -> float:
        model = dynamics.replace({f"{run}:{TRIGGER}": late for run in dynamics.apart})
        where = case.coordinates(model, (), case.identify)
        problem = Problem(case.identify, model, where, case.each)
        return math.inf if (left := problem.residuals(where.start)) is None else float(sum(e @ e for e in left))

    step = IN_TIME / dynamics.first.natural_frequency
    costs = {late: cost(late) for late in np.arange(0.0, LATEST, step).tolist()}
    best = min(costs, key=lambda late: costs[late])
    return dynamics.replace({f"{run}:{TRIGGER}": best for run in dynamics.apart}) if best > step else dynamics
