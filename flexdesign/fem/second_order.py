"""What large displacements do to a condensed part, to second order.

Green's strain of a displacement u is e(u) + h(u) with e linear and h = (grad u)^T grad u / 2 quadratic. With stresses
sigma = C e the strain energy of amplitudes c (u = sum c_i u_i) is

    U = c^T K c / 2 + sum_ijk B_ijk c_i c_j c_k + ...,     B_ijk = int sigma_i : h(u_j, u_k) dV.

A leaf spring that bends shortens by 0.6 d^2 / L in this way. Of fourth order, what is left once the inside has adjusted
is taken for a complete square: the same energy is

    U = s^T K s / 2,     s = c + K^+ B(c, c),

so that a part that is free to shorten does so without stress, and one that is not stiffens.

Amplitudes c are rigid motions of each bonded port's face and, where an actuator pushes, the extension it causes. Large
rotations of the part as a whole are none of theirs: they are seen from a frame that goes along (`corotated`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexdesign.fem.elasticity import shape_derivatives, stress_points
from flexdesign.fem.superelement import Superelement

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class SecondOrder:
    """A condensed part's energy to third order.

    Parameters
    ----------
    stiffness
        K, shape (k, k).
    tensor
        B, symmetric in its last two indices, shape (k, k, k).
    extension
        What an actuator feels of the amplitudes, shape (k,).
    actuator
        Stiffness of a spring along that [N/m], 0 for none.
    """

    stiffness: FloatArray
    tensor: FloatArray
    extension: FloatArray
    actuator: float = 0.0

    def energy(self, amplitudes: FloatArray) -> float:
        """Return U [J] of amplitudes, shape (k,)."""
        strained = self._strained(amplitudes)
        spring = self.actuator * (self.extension @ amplitudes) ** 2
        return float(strained @ self.stiffness @ strained + spring) / 2

    def forces(self, amplitudes: FloatArray) -> FloatArray:
        """Return dU/dc, shape (k,)."""
        elastic = self._slope(amplitudes).T @ self.stiffness @ self._strained(amplitudes)
        return np.asarray(elastic + self.actuator * (self.extension @ amplitudes) * self.extension)

    def tangent(self, amplitudes: FloatArray) -> FloatArray:
        """Return d^2 U/dc^2, shape (k, k)."""
        slope, stress = self._slope(amplitudes), self.stiffness @ self._strained(amplitudes)
        bent = np.einsum("i,ij,jkl->kl", stress, self._inverse, self.tensor, optimize=True)
        spring = self.actuator * np.outer(self.extension, self.extension)
        return np.asarray(slope.T @ self.stiffness @ slope + 2 * bent + spring)

    def _slope(self, amplitudes: FloatArray) -> FloatArray:
        return np.asarray(np.eye(len(amplitudes)) + 2 * self._inverse @ (self.tensor @ amplitudes))

    def _strained(self, amplitudes: FloatArray) -> FloatArray:
        return np.asarray(amplitudes + self._inverse @ (self.tensor @ amplitudes @ amplitudes))

    @cached_property
    def _inverse(self) -> FloatArray:
        return np.asarray(scipy.linalg.pinvh(self.stiffness, rtol=1e-10))


def amplitudes(part: Superelement) -> FloatArray:
    """Return the amplitudes of a superelement by those c of this module, shape (n + m, k).

    Six rigid motions of each bonded port, about its point and in the part's frame, in the order of its ports; then, if
    an actuator pushes, a unit extension by it with the ports held.
    """
    columns = []
    for shapes in part.shapes:
        block = np.zeros((len(part.stiffness), 6))
        block[part.rows(shapes.port.name)] = shapes.rigid
        columns.append(block)
    if np.any(part.extension):
        pushed = np.zeros(len(part.stiffness))
        inner = slice(part.size, None)
        pushed[inner] = np.linalg.solve(part.stiffness[inner, inner], part.extension[inner])
        columns.append(pushed[:, None] / (part.extension @ pushed))
    return np.hstack(columns)


def of(part: Superelement) -> SecondOrder:
    """Integrate a superelement's energy to third order, over its fundamental domain and all its images."""
    basis = amplitudes(part)
    tensor = _of_domain(part, basis)
    for reflection in part.inside.reflections:
        turned = np.linalg.lstsq(basis, reflection @ basis, rcond=None)[0]
        tensor = tensor + np.einsum("ijk,ia,jb,kc->abc", tensor, turned, turned, turned, optimize=True)
    return SecondOrder(basis.T @ part.stiffness @ basis, tensor, part.extension @ basis)


def _of_domain(part: Superelement, basis: FloatArray) -> FloatArray:
    """Return B of the fundamental domain alone."""
    body = part.inside.body
    fields = (part.inside.vectors @ basis).reshape(-1, 3, basis.shape[1])
    points, weights = stress_points()
    gradients, volumes = body.barycentric_gradients
    slopes = shape_derivatives(points)
    count = basis.shape[1]
    tensor = np.zeros((count, count, count))
    for chunk in np.array_split(np.arange(len(volumes)), max(1, len(volumes) // 500)):
        shape = np.einsum("qak,eki->eqai", slopes, gradients[chunk], optimize=True)
        # d u_c / d x_i of each amplitude, shape (e, q, component, direction, k)
        grad = np.einsum("eqai,eacn->eqcin", shape, fields[body.nodes[chunk]], optimize=True)
        stress = _stress(part, grad)
        share = np.einsum("e,q->eq", volumes[chunk], weights)
        moved = np.einsum("eqabn,eqcaj->nebqcj", share[:, :, None, None, None] * stress, grad, optimize=True)
        tensor += np.einsum("nebqcj,eqcbk->njk", moved, grad, optimize=True) / 2
    return tensor


def _stress(part: Superelement, grad: FloatArray) -> FloatArray:
    material = part.inside.body.material
    strain = (grad + grad.swapaxes(2, 3)) / 2
    if material.crystal is not None:
        return np.asarray(np.einsum("abcd,eqcdn->eqabn", material.tensor, strain, optimize=True))
    lam, mu = material.lame
    trace = np.einsum("eqaan->eqn", strain)
    return 2 * mu * strain + lam * trace[:, :, None, None] * np.eye(3)[:, :, None]
