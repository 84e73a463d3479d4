"""The Bouc-Wen benchmark of nonlinear system identification, solved tightly: a mass on a hysteretic spring.

    m y'' + c y' + k y + z = u
    z' = alpha y' - beta (gamma |y'| |z|^(nu-1) z + delta y' |z|^nu)

Defined in J.P. Noël and M. Schoukens, *Hysteretic benchmark with a dynamic nonlinearity*, Workshop on Nonlinear System
Identification Benchmarks, Brussels 2016, pp. 7-14; data: 4TU.ResearchData, doi 10.4121/12967592, and
https://www.nonlinearbenchmark.org/benchmarks/bouc-wen. Its authors sample at 750 Hz and integrate by Newmark's rule at
15 kHz; their excitation is a random-phase multisine from 5 to 150 Hz of 50 N rms with 8192 points a period. Here the
force is a straight line between samples, or held, and the solution is as tight as that of `chains`, which finds the
moments at which y' and z change sign.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tests.reference import chains
from tests.reference.chains import BoucWen, Chain, Floats, Mode

RATE = 750.0  # Hz


@dataclass(frozen=True)
class Oscillator:
    """The benchmark's parameters: m [kg], c [N s/m], k and alpha [N/m], beta [1/m for nu = 1], the others numbers."""

    m: float = 2.0
    c: float = 10.0
    k: float = 5e4
    alpha: float = 5e4
    beta: float = 1e3
    gamma: float = 0.8
    delta: float = -1.1
    nu: float = 1.0

    @property
    def stiffness(self) -> float:
        """Stiffness of small motions [N/m]."""
        return self.k + self.alpha

    @property
    def share(self) -> float:
        """Hysteretic part of the stiffness of small motions."""
        return self.alpha / self.stiffness

    def chain(self) -> Chain:
        """Return the same as a chain whose command is the force [N]; its spring's displacement is z / k."""
        w0 = (self.k / self.m) ** 0.5
        scale = self.beta * self.k ** (self.nu - 1)
        spring = BoucWen(self.alpha / self.k, scale * self.gamma, scale * self.delta, self.nu)
        return Chain(gain=1 / self.k, modes=(Mode(w0, self.c / (2 * self.m * w0)),), spring=spring)


@dataclass(frozen=True)
class Response:
    """Position y [m] and hysteretic force z [N] at the samples."""

    position: Floats
    hysteretic_force: Floats


def solve(
    oscillator: Oscillator,
    force: Floats,
    period: float = 1 / RATE,
    between: Literal["hold", "linear"] = "linear",
    *,
    rtol: float = 1e-12,
) -> Response:
    """Solve from rest under the sampled force [N]; at t = 0 it may jump."""
    stroke = float(np.abs(force).max(initial=0.0)) / oscillator.k or 1e-3
    found = chains.solve(oscillator.chain(), force, period, between, stroke=stroke, rtol=rtol)
    return Response(found.position, oscillator.k * found.spring)


def multisine(
    rng: np.random.Generator,
    rms: float = 50.0,
    band: tuple[float, float] = (5.0, 150.0),
    rate: float = RATE,
    points: int = 8192,
) -> Floats:
    """Return one period of a random-phase multisine: every line of the band [Hz] with the same amplitude.

    >>> force = multisine(np.random.default_rng(1))
    >>> len(force), round(float(np.sqrt(np.mean(force**2))), 6)
    (8192, 50.0)
    """
    lines = np.fft.rfftfreq(points, 1 / rate)
    inside = (lines >= band[0]) & (lines <= band[1])
    spectrum = inside * np.exp(2j * np.pi * rng.random(len(lines)))
    force = np.fft.irfft(spectrum, points)
    return np.asarray(rms * force / np.sqrt(np.mean(force**2)))
