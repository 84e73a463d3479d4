"""Into how many steps a sample is divided, run by run: found once, and kept while a fit moves the numbers."""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock

from flexdesign.core.model import Observation
from flexdesign.dynamics.stage_model import AxisModel


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
