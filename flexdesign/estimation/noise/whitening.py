"""Noise models: what turns the residual of an observation into independent numbers of variance one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.errors import InputError
from flexdesign.core.model import Observation
from flexdesign.estimation.noise.autoregressive import Process

Array = NDArray[np.float64]


class Whitening(Protocol):
    """What turns noise into independent numbers of variance one."""

    def whiten(self, observation: Observation, residual: Array) -> Array:
        """Return the whitened residual.

        Parameters
        ----------
        observation
            Where the residual comes from.
        residual
            Samples by columns, SI, gaps as zeros; the result has the same shape and is linear in it.
        """


@dataclass(frozen=True)
class White:
    """White noise alike in all observations, by its standard deviation in SI."""

    sigma: float

    def whiten(self, _: Observation, residual: Array) -> Array:
        """Return the residual over the standard deviation."""
        return residual / self.sigma


@dataclass(frozen=True)
class ColouredNoise:
    """Coloured noise, by the autoregressive process of all observations, or of each by its name."""

    processes: Process | Mapping[str, Process]

    def process(self, name: str) -> Process:
        """Return the process of an observation.

        Raises
        ------
        InputError
            If that of this observation is not given.
        """
        if isinstance(self.processes, Process):
            return self.processes
        if name not in self.processes:
            raise InputError("fit", f"noise.{name}", None, "give the process of this observation's noise")
        return self.processes[name]

    def whiten(self, observation: Observation, residual: Array) -> Array:
        """Return the whitened residual, zero at gaps: values of the observation that are not finite.

        After a gap the process starts anew, its past unknown.

        Raises
        ------
        InputError
            If the noise of this observation is not given, or residual and measured samples do not match.
        """
        process = self.process(observation.name)
        present = np.isfinite(np.asarray(observation.measured()))
        if len(present) != len(residual):
            remedy = f"the residual has {len(residual)} samples, measured are {len(present)}"
            raise InputError("fit", observation.name, None, remedy)
        whitened = np.zeros(residual.shape)
        for first, last in stretches(present):
            whitened[first:last] = process.whiten(residual[first:last])
        return whitened


def stretches(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return where flags are up: the first index of each stretch and the index after its last.

    >>> stretches(np.array([True, True, False, True]))
    [(0, 2), (3, 4)]
    """
    if flags.all():
        return [(0, len(flags))] if len(flags) else []
    edges = np.flatnonzero(np.diff(flags.astype(np.int8), prepend=0, append=0)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))
