"""What large displacements do to a condensed part, to second order.

Green's strain of a displacement u is e(u) + h(u) with e linear and h = (grad u)^T grad u / 2 quadratic. Amplitudes c
are rigid motions of each bonded port's face and, where an actuator pushes, the extension it causes. As a face turns by
the rotation vector theta, places r from its port's point go along an arc, by theta x r + theta x (theta x r) / 2; the
inside follows by u = sum c_i u_i + sum c_j c_k w_jk. With stresses sigma = C e the strain energy is

    U = c^T K c / 2 + sum_ijk B_ijk c_i c_j c_k + ...,     B_ijk = int sigma_i : (h(u_j, u_k) + e(w_jk)) dV.

A leaf spring that bends shortens by 0.6 d^2 / L in this way. What w gives is work of the ports' forces alone, but no
trifle: without it the stubs of a hinge would seem to lengthen as they turn. Of fourth order, the energy after the
interior has adjusted is taken for a complete square: the same energy is

    U = s^T K s / 2,     s = c + K^+ B(c, c),

so that a part that is free to shorten does so without stress, and one that is not stiffens.

Large rotations of the part as a whole are seen from a frame that goes along (`corotated`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexdesign.design.materials import Material
from flexdesign.fem.solving.elasticity import shape_derivatives, stress_points
from flexdesign.fem.solving.port_shapes import Motions, rigid_motions
from flexdesign.fem.superelements.superelement import Interior, Superelement

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SecondOrder:
    """A condensed part's energy to third order. Methods take amplitudes of many equal parts at once.

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

    def energy(self, amplitudes: FloatArray) -> FloatArray:
        """Return U [J] of amplitudes, shapes (...) and (..., k)."""
        strained = self.strained(amplitudes)
        spring = self.actuator * (amplitudes @ self.extension) ** 2
        return np.asarray(np.einsum("...i,ij,...j", strained, self.stiffness, strained) + spring) / 2

    def forces(self, amplitudes: FloatArray) -> FloatArray:
        """Return dU/dc, shape (..., k)."""
        stress = self.strained(amplitudes) @ self.stiffness
        spring = self.actuator * np.multiply.outer(amplitudes @ self.extension, self.extension)
        return np.asarray(np.einsum("...i,...ij->...j", stress, self._derivative(amplitudes)) + spring)

    def tangent(self, amplitudes: FloatArray) -> FloatArray:
        """Return d^2 U/dc^2, shape (..., k, k)."""
        slope, stress = self._derivative(amplitudes), self.strained(amplitudes) @ self.stiffness
        bent = np.tensordot(stress, self._shift, axes=1)
        spring = self.actuator * np.outer(self.extension, self.extension)
        return np.asarray(slope.swapaxes(-1, -2) @ self.stiffness @ slope + 2 * bent + spring)

    def strained(self, amplitudes: FloatArray) -> FloatArray:
        """Return s, the amplitudes that would cost as much if displacements were small, shape (..., k)."""
        return np.asarray(amplitudes + np.einsum("ijk,...j,...k->...i", self._shift, amplitudes, amplitudes))

    def _derivative(self, amplitudes: FloatArray) -> FloatArray:
        shift = np.tensordot(amplitudes, self._shift, axes=(-1, 2))
        return np.asarray(np.eye(len(self.stiffness)) + 2 * shift)

    @cached_property
    def _shift(self) -> FloatArray:
        """K^+ B, shape (k, k, k); K has been made free of units, so that rigid motions stand out from all others."""
        scale = 1 / np.sqrt(np.diag(self.stiffness))
        inverse = scipy.linalg.pinvh(scale[:, None] * self.stiffness * scale, rtol=1e-3)
        return np.asarray(np.tensordot(scale[:, None] * inverse * scale, self.tensor, axes=1))


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
    """Integrate a superelement's energy to third order, over its fundamental domain and all its images.

    Raises
    ------
    ValueError
        If the superelement does not know its inside.
    """
    if part.interior is None:
        raise ValueError("a part without its interior has no large displacements: condense it again")
    basis = amplitudes(part)
    forces = basis.T @ part.stiffness
    tensor = _of_domain(part.interior, part.material, basis)
    for reflection in part.interior.reflections:
        turned = np.linalg.lstsq(basis, reflection @ basis, rcond=None)[0]
        tensor = tensor + np.einsum("ijk,ia,jb,kc->abc", tensor, turned, turned, turned, optimize=True)
    return SecondOrder(
        forces @ basis, tensor + np.tensordot(forces, _arcs(part, basis), axes=1), part.extension @ basis
    )


def _arcs(part: Superelement, basis: FloatArray) -> FloatArray:
    """Return w, the superelement's amplitudes by pairs of c, shape (n + m, k, k); an actuator feels nothing of it."""
    arcs = np.zeros((*basis.shape, basis.shape[1]))
    for index, shapes in enumerate(part.shapes):
        turns = slice(6 * index + 3, 6 * index + 6)
        arc = shapes.coordinates(_arc(np.array(shapes.port.point)))
        arcs[part.rows(shapes.port.name), turns, turns] = arc.reshape(-1, 3, 3)
    if np.any(part.extension):
        arcs -= np.multiply.outer(basis[:, -1], np.tensordot(part.extension, arcs, axes=1))
    return arcs


def _arc(point: FloatArray) -> Motions:
    """Return the motions e_j x (e_k x r) / 2 of pairs of rotations about a point, the mean of both orders."""

    def motions(places: FloatArray) -> FloatArray:
        once = rigid_motions(places, point)[..., 3:].swapaxes(1, 2)
        twice = np.moveaxis(np.cross(np.eye(3)[:, None], once[:, None]), 3, 1)
        return np.asarray((twice + twice.swapaxes(2, 3)).reshape(len(places), 3, 9) / 4)

    return motions


def _of_domain(inside: Interior, material: Material, basis: FloatArray) -> FloatArray:
    """Return what h gives to B in the fundamental domain alone."""
    body = inside.body
    fields = (inside.vectors @ basis).reshape(-1, 3, basis.shape[1])
    points, weights = stress_points()
    gradients, volumes = body.barycentric_gradients
    derivatives = shape_derivatives(points)
    count = basis.shape[1]
    tensor = np.zeros((count, count, count))
    for chunk in np.array_split(np.arange(len(volumes)), max(1, len(volumes) // 500)):
        shape = np.einsum("qak,eki->eqai", derivatives, gradients[chunk], optimize=True)
        # d u_c / d x_i of each amplitude, shape (e, q, component, direction, k)
        grad = np.einsum("eqai,eacn->eqcin", shape, fields[body.nodes[chunk]], optimize=True)
        stress = _stress(material, grad)
        share = np.einsum("e,q->eq", volumes[chunk], weights)
        stiffening = np.einsum("eqabn,eqcaj->nebqcj", share[:, :, None, None, None] * stress, grad, optimize=True)
        tensor += np.einsum("nebqcj,eqcbk->njk", stiffening, grad, optimize=True) / 2
    return tensor


def _stress(material: Material, grad: FloatArray) -> FloatArray:
    strain = (grad + grad.swapaxes(2, 3)) / 2
    if material.crystal is not None:
        return np.asarray(np.einsum("abcd,eqcdn->eqabn", material.tensor, strain, optimize=True))
    lam, mu = material.lame
    trace = np.einsum("eqaan->eqn", strain)
    return 2 * mu * strain + lam * trace[:, :, None, None] * np.eye(3)[:, :, None]
