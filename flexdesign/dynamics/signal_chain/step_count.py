"""Into how many steps a sample is divided, run by run: found once, and kept while a fit moves the numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from threading import Lock

from flexdesign import effects
from flexdesign.core.model import Block, Observation
from flexdesign.dynamics.stage_model import AxisModel

#: With steps of more than this many time constants a Runge-Kutta method of order 4 is unstable.
RUNGE_KUTTA_LIMIT = 2.785


def stable_steps(axis: AxisModel, period: float) -> int:
    """Return the number of steps in a sample with which the fastest relaxation of a force is stable."""
    times = [
        time
        for name, values in axis.effects.items()
        for face in effects.find(name).faces
        if isinstance(face, Block) and face.flow and face.relaxing
        for time, _ in face.relaxing(values)
    ]
    return math.ceil(period / (RUNGE_KUTTA_LIMIT * min(times))) if times else 1


class Steps:
    """The number of steps in a sample for each run, found when it is first asked for; safe among threads.

    Parameters
    ----------
    at, delay
        The numbers with which it is found; by default those of the first model that has these steps.
    """

    def __init__(self, at: AxisModel | None = None, delay: float = 0.0) -> None:
        self.at, self.delay = at, delay
        self._found: dict[Observation, int] = {}
        self._locks: dict[Observation, Lock] = {}

    def of(self, run: Observation, find: Callable[[], int]) -> int:
        """Return the number for a run; `find` is called the first time, and others that ask for it meanwhile wait."""
        with self._locks.setdefault(run, Lock()):
            if run not in self._found:
                self._found[run] = find()
            return self._found[run]
