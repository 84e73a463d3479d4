"""Modal axes of a stage with as many inputs as outputs: its frequency response, its strongest modes, and coordinates.

A mode answers one combination of the inputs, psi^T u, with one shape phi of the outputs: its residue has rank one
(Ewins, Modal Testing, 2nd ed. 2000, section 4.4). As many modes as outputs make coordinates; all that the frequency
response contains in addition is linear here and is taken out before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
#: Where the search for damping ratio and delay [s] begins; the unit of the delay in it.
DAMPING, DELAY, UNIT = 0.015, 1e-4, 1e-4
#: Lines to each side of one whose response is sought: well within the width of a mode.
NEIGHBOURS = 6


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of rank one, as many as there are inputs and outputs.

    Parameters
    ----------
    frequencies, damping_ratios
        Natural frequencies [Hz] and damping ratios, n values each.
    gains
        Static responses along the shapes [m/V], n values.
    shapes
        Phi, outputs x n, columns of unit length.
    drives
        Psi, inputs x n, columns of unit length: a mode sees psi^T u.
    delay
        Common to all of them [s].
    purity
        First singular value of each residue as a share of the root of the sum of squares of all; one at rank one.
    """

    frequencies: Array
    damping_ratios: Array
    gains: Array
    shapes: Array
    drives: Array
    delay: float
    purity: Array

    def response(self, frequency: Array) -> Complex:
        """Return the frequency response of the modes together [m/V], lines x outputs x inputs."""
        each = _resonances(frequency, self.frequencies, self.damping_ratios, self.delay) * self.gains
        return np.asarray(np.einsum("km,im,jm->kij", each, self.shapes, self.drives))

    def inputs(self, u: Array) -> Array:
        """Return what each mode sees of inputs [V]: n x samples from inputs x samples."""
        return np.asarray(self.drives.T @ u)

    def coordinates(self, y: Array) -> Array:
        """Return modal coordinates of outputs [m]: n x samples from outputs x samples."""
        return np.asarray(np.linalg.solve(self.shapes, y))

    def outputs(self, coordinates: Array) -> Array:
        """Return outputs from modal coordinates [m]; the inverse of `coordinates`."""
        return np.asarray(self.shapes @ coordinates)


def frequency_response(u: Array, y: Array, lines: int) -> Complex:
    """Return the response of outputs per input [m/V], lines + 1 x outputs x inputs; the first line, at rest, is zero.

    Each line is the middle of a parabola through its neighbours in a band of `NEIGHBOURS` to both sides, least squares
    over all records (the local polynomial method: Pintelon and Schoukens, System Identification, 2nd ed. 2012, section
    7.2.2). A line by itself would take from each record what only this record has.

    Parameters
    ----------
    u, y
        Records of one period: samples x inputs x records and samples x outputs x records. Each counts by the size of
        its own input, so that small levels weigh as much as large ones.
    lines
        Excited ones, from the first on.
    """
    size = np.sqrt(np.mean(u**2, axis=(0, 1)))
    inputs, outputs = (np.fft.rfft(values / size, axis=0)[: lines + 1].transpose(0, 2, 1) for values in (u, y))
    response = np.zeros((lines + 1, outputs.shape[2], inputs.shape[2]), dtype=np.complex128)
    for line in range(1, lines + 1):
        near = np.arange(max(line - NEIGHBOURS, 1), min(line + NEIGHBOURS, lines) + 1)
        away = ((near - line) / NEIGHBOURS)[:, None, None]
        held = np.concatenate([inputs[near], away * inputs[near], away**2 * inputs[near]], axis=2)
        wanted = outputs[near].reshape(-1, outputs.shape[2])
        found = np.linalg.lstsq(held.reshape(len(wanted), -1), wanted, rcond=None)[0]
        response[line] = found[: inputs.shape[2]].T
    return response


def apply_response(response: Complex, u: Array) -> Array:
    """Return what a linear response makes of one period [m], samples x outputs from samples x inputs.

    Lines beyond those of the response stay empty.
    """
    spectrum = np.zeros((len(u) // 2 + 1, response.shape[1]), dtype=np.complex128)
    spectrum[: len(response)] = np.einsum("kij,kj->ki", response, np.fft.rfft(u, axis=0)[: len(response)])
    return np.asarray(np.fft.irfft(spectrum, len(u), axis=0))


def fit(frequency: Array, response: Complex, starts: Sequence[float]) -> Modes:
    """Return the modes of a band of a frequency response, by variable projection.

    Modes outside the band stand in it as a constant and as one over the square of the frequency (Ewins, section 4.5).
    Residues are real, as for proportional damping; of each the part of rank one is kept.

    Parameters
    ----------
    frequency, response
        The lines of the band [Hz], and lines x outputs x inputs [m/V].
    starts
        About where the modes are [Hz], as many as there are outputs.
    """
    n, lines = len(starts), np.asarray(frequency)
    seen = response.reshape(len(lines), -1)
    wanted = np.concatenate([seen.real, seen.imag]) / np.sqrt(np.mean(np.abs(seen) ** 2))

    def columns(x: Array) -> Array:
        late = np.exp(-2j * np.pi * lines * UNIT * x[-1])
        outside = np.column_stack([late, late * (lines[0] / lines) ** 2])
        held = np.hstack([_resonances(lines, np.exp(x[:n]), np.exp(x[n:-1]), UNIT * x[-1]), outside])
        return np.concatenate([held.real, held.imag])

    def residual(x: Array) -> Array:
        held = columns(x)
        return np.asarray(wanted - held @ np.linalg.lstsq(held, wanted, rcond=None)[0]).ravel()

    start = np.concatenate([np.log(starts), np.full(n, np.log(DAMPING)), [DELAY / UNIT]])
    x = least_squares(residual, start, x_scale="jac").x
    scale = np.sqrt(np.mean(np.abs(seen) ** 2))
    residues = scale * np.linalg.lstsq(columns(x), wanted, rcond=None)[0][:n].reshape(n, *response.shape[1:])
    shapes, sizes, drives = np.linalg.svd(residues)
    return Modes(
        frequencies=np.exp(x[:n]),
        damping_ratios=np.exp(x[n:-1]),
        gains=sizes[:, 0],
        shapes=shapes[:, :, 0].T,
        drives=drives[:, 0, :].T,
        delay=float(UNIT * x[-1]),
        purity=sizes[:, 0] / np.sqrt(np.sum(sizes**2, axis=1)),
    )


def _resonances(frequency: Array, natural: Array, damping: Array, delay: float) -> Complex:
    """Return the responses of modes with static response one, lines x modes."""
    f = frequency[:, None]
    late = np.exp(-2j * np.pi * f * delay)
    return np.asarray(late * natural**2 / (natural**2 - f**2 + 2j * damping * natural * f))
