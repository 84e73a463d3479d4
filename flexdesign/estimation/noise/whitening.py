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
            Samples by channels, SI, gaps as zeros; the result has the same shape and is linear in it.
        """


#: Noise as `fit` takes it; None where it is unknown: white, alike in all observations, estimated from the residual.
Noise = None | float | Mapping[str, float | Array] | Whitening


@dataclass(frozen=True)
class White:
    """White noise, by its standard deviation in SI.

    That is one number for all observations, or by the observation's name a number or an array that broadcasts to
    samples by channels.
    """

    sigma: float | Mapping[str, float | Array]

    def whiten(self, observation: Observation, residual: Array) -> Array:
        """Return the residual over the standard deviation.

        Raises
        ------
        InputError
            If the noise of this observation is not given, or is not above zero.
        """
        sigma = self.sigma.get(observation.name) if isinstance(self.sigma, Mapping) else self.sigma
        if sigma is None or not np.all(np.asarray(sigma) > 0):
            remedy = "give the standard deviation of its noise, above zero"
            raise InputError("fit", f"noise.{observation.name}", sigma, remedy)
        return np.asarray(residual / np.asarray(sigma, dtype=float))


@dataclass(frozen=True)
class Scaled:
    """Noise that is a multiple of other noise."""

    noise: Whitening
    factor: float

    def whiten(self, observation: Observation, residual: Array) -> Array:
        """Return the whitened residual."""
        return self.noise.whiten(observation, residual) / self.factor


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

        Of an observation with one channel, the residual may have any number of columns. After a gap the process starts
        anew, its past unknown.

        Raises
        ------
        InputError
            If the noise of this observation is not given, or residual and measured samples do not match.
        """
        process = self.process(observation.name)
        measured = np.asarray(observation.measured())
        present = np.isfinite(measured.reshape(len(measured), -1))
        if len(present) != len(residual) or present.shape[1] not in (1, residual.shape[1]):
            remedy = f"the residual is shaped {residual.shape}, measured are {present.shape}; give samples by channels"
            raise InputError("fit", observation.name, None, remedy)
        whitened = np.zeros(residual.shape)
        for channel, there in enumerate(present.T):
            columns = slice(channel, channel + 1) if present.shape[1] > 1 else slice(None)
            for first, last in stretches(there):
                whitened[first:last, columns] = process.whiten(residual[first:last, columns])
        return whitened


def stretches(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return where flags are up: the first index of each stretch and the index after its last.

    >>> stretches(np.array([True, True, False, True]))
    [(0, 2), (3, 4)]
    """
    edges = np.flatnonzero(np.diff(flags.astype(np.int8), prepend=0, append=0)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))
