"""The incremental PID of Lin et al. (2019), eq (33), as a transfer function and as a kernel for the simulator.

Eq (33) prints the change of the command from sample to sample::

    dP[k] = Kp (e[k] - e[k-1]) + Kp T/Ti e[k] + Kp Td/T (e[k] - 2 e[k-1] + e[k-2])

Three settings go beyond it, and are off by default: weights of the set point in the proportional and in the
derivative part, and a first-order filter of the derivative part (Astrom and Hagglund, Advanced PID Control, 2006,
chapter 3). What a limit cuts off the command is taken back one sample later (back-calculation with a
tracking time of one sample, same chapter), so that the integral part does not wind up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.model import Controller
from flexdesign.core.model.effect import Values

#: What the kernel remembers.
STATES = ("output", "last_proportional_error", "last_derivative_error", "last_derivative_error_but_one", "bend")


class Realised(NamedTuple):
    """A PID as x[k+1] = a x[k] + b_r r[k] + b_y y[k], u[k] = c x[k] + d_r r[k] + d_y y[k]."""

    a: Array
    b_reference: Array
    b_reading: Array
    c: Array
    d_reference: float
    d_reading: float


@dataclass(frozen=True)
class PID:
    """Gains of eq (33).

    Parameters
    ----------
    kp
        Proportional gain [command per reading].
    ti
        Integral time [s]; infinity for no integral part.
    td
        Derivative time [s]; 0 for no derivative part.
    proportional_weight, derivative_weight
        Share of the reference in the error that the proportional and the derivative part see; 1 in eq (33), 0 where
        they act on the reading alone.
    derivative_filter
        Time constant of a first-order filter of the derivative part [s]; 0 in eq (33).

    Raises
    ------
    InputError
        If a number is not finite (`ti` may be), the integral time is zero, or a filter time is negative.

    >>> PID(kp=0.01355, ti=3.988e-3, td=0.997e-3).terms(1e-3)
    (0.01355, 0.0033976..., 0.01350935)
    """

    kp: float
    ti: float = math.inf
    td: float = 0.0
    proportional_weight: float = 1.0
    derivative_weight: float = 1.0
    derivative_filter: float = 0.0

    def __post_init__(self) -> None:
        for name in ("kp", "td", "proportional_weight", "derivative_weight", "derivative_filter"):
            if not math.isfinite(getattr(self, name)):
                raise InputError("controller", name, getattr(self, name), "must be a finite number")
        if math.isnan(self.ti) or self.ti == 0:
            raise InputError("controller", "ti", f"{self.ti:g} s", "must not be zero; infinity switches it off")
        if self.derivative_filter < 0:
            raise InputError("controller", "derivative_filter", f"{self.derivative_filter:g} s", "must be zero or more")

    def scaled(self, factor: float) -> PID:
        """Return the controller with all its gains multiplied by `factor`."""
        return replace(self, kp=self.kp * factor)

    def terms(self, period: float) -> tuple[float, float, float]:
        """Return Kp, Kp T/Ti and Kp Td/T: what each part of eq (33) is multiplied by."""
        return self.kp, self.kp * period / self.ti, self.kp * self.td / period

    def transfer_function(self, period: float) -> Any:
        """Return the transfer function from error to command, as python-control's discrete `TransferFunction`.

        The weights of the set point have no part in it: it is what the loop sees.

        Parameters
        ----------
        period
            Sampling period T [s].
        """
        import control as ct

        p, i, d = self.terms(period)
        keep = self._filter_pole(period)
        # With q = 1/z: p + i / (1 - q) + d (1 - keep) (1 - q) / (1 - keep q), over one denominator.
        numerator = np.polyadd(
            np.convolve([-p, p + i] if i else [p], [-keep, 1.0]),
            d * (1 - keep) * np.convolve([-1.0, 1.0], [-1.0, 1.0] if i else [1.0]),
        )
        denominator = np.convolve([-1.0, 1.0] if i else [1.0], [-keep, 1.0])
        # In q, highest power first, and of equal length: reversed, the same numbers are polynomials in z.
        length = max(len(numerator), len(denominator))
        up, down = (np.pad(poly, (length - len(poly), 0))[::-1] for poly in (numerator, denominator))
        return ct.tf(up, down, period)

    def realised(self, period: float) -> Realised:
        """Return the controller in state space, with reference and reading apart.

        States: sum of the errors (if there is an integral part), last derivative error, filtered difference.

        Parameters
        ----------
        period
            Sampling period T [s].
        """
        p, i, d = self.terms(period)
        keep = self._filter_pole(period)
        # Error-sum s, last derivative error m, filtered difference f: f' = keep f + (1 - keep) (e_d - m).
        a = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, -(1 - keep), keep]])
        b_reference = np.array([1.0, self.derivative_weight, (1 - keep) * self.derivative_weight])
        b_reading = -np.array([1.0, 1.0, 1 - keep])
        c = np.array([i, -d * (1 - keep), d * keep])
        d_reference = p * self.proportional_weight + i + d * (1 - keep) * self.derivative_weight
        d_reading = -(p + i + d * (1 - keep))
        used = [row for row, is_used in enumerate((i != 0, d != 0, d != 0 and keep > 0)) if is_used]
        return Realised(a[np.ix_(used, used)], b_reference[used], b_reading[used], c[used], d_reference, d_reading)

    def _filter_pole(self, period: float) -> float:
        return math.exp(-period / self.derivative_filter) if self.derivative_filter > 0 else 0.0


def controller(pid: PID, name: str = "PID") -> Controller:
    """Return the PID as the simulator takes it.

    Parameters
    ----------
    pid
        Its settings.
    name
        Its name in tables.
    """
    values = {
        "kp": pid.kp,
        "ti": pid.ti,
        "td": pid.td,
        "proportional_weight": pid.proportional_weight,
        "derivative_weight": pid.derivative_weight,
        "derivative_filter": pid.derivative_filter,
    }
    return Controller(name=name, values=values, tick=tick, constants=constants, states=STATES)


def constants(values: Values, period: float) -> tuple[float, ...]:
    """Return what `tick` needs: the factors of eq (33), the weights, the filter's pole, and the anti-windup's share."""
    pid = PID(**values)
    p, i, d = pid.terms(period)
    # Without an integral part nothing winds up, and what is taken back would stay off for good.
    take_back = 1.0 if i else 0.0
    return p, i, d, pid.proportional_weight, pid.derivative_weight, pid._filter_pole(period), take_back


def tick(reference: float, reading: float, excess: float, state: Array, constants: Array) -> float:
    """Return the next command; see `flexdesign.core.model.Controller`."""
    proportional_error = constants[3] * reference - reading
    derivative_error = constants[4] * reference - reading
    bend = derivative_error - 2.0 * state[2] + state[3]
    bend = constants[5] * state[4] + (1.0 - constants[5]) * bend
    output = state[0] - constants[6] * excess
    output += constants[0] * (proportional_error - state[1])
    output += constants[1] * (reference - reading)
    output += constants[2] * bend
    state[0] = output
    state[1] = proportional_error
    state[3] = state[2]
    state[2] = derivative_error
    state[4] = bend
    return output
