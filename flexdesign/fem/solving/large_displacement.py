"""Large displacements of quadratic tetrahedra: total Lagrangian, Saint Venant-Kirchhoff material.

Everything is written in the undeformed body (Bonet and Wood, Nonlinear Continuum Mechanics for Finite Element Analysis,
2nd ed., sections 5.3 and 9.4). With G_a the gradient of the shape function of node a, and a sum over integration points
of weight w,

    H = u_a G_a^T,   F = 1 + H,   E = (H + H^T + H^T H) / 2,   S = lam tr(E) 1 + 2 mu E,
    f_a = w F S G_a,
    K_ab = w [ (G_a . S G_b) 1 + lam p_a p_b^T + mu ((G_a . G_b) F F^T + p_b p_a^T) ],   p_a = F G_a.

Strains in flexures are small and rotations are not: for that the material is as good as any. Green's strain E is
written in H, as (F^T F - 1) / 2 would lose the digits of what is small compared with 1. The four integration points
that are exact for small displacements serve here too.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numba import njit
from numpy.typing import NDArray

from flexdesign.fem.solving.elasticity import PAIRS, Elasticity, shape_derivatives, stress_points

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class LargeDisplacement:
    """The discretised body with some degrees of freedom held.

    Parameters
    ----------
    body
        Its elements; the material must be isotropic.
    free
        The degrees of freedom that are not held.

    Raises
    ------
    ValueError
        If the material is a crystal.
    """

    def __init__(self, body: Elasticity, free: IntArray) -> None:
        if body.material.crystal is not None:
            raise ValueError(f"{body.material.name} is a crystal; large displacements are for isotropic materials")
        self.body, self.free = body, free
        points, self._weights = stress_points()
        self._slopes = shape_derivatives(points)

    def forces(self, displacement: FloatArray) -> FloatArray:
        """Return the internal forces on all degrees of freedom under displacements (n_dofs,) [m]; (n_dofs,) [N]."""
        return self._evaluate(displacement, with_tangent=False)[0]

    def forces_and_tangent(self, displacement: FloatArray) -> tuple[FloatArray, sp.csr_matrix]:
        """Return the internal forces and the upper triangle of the tangent between free degrees of freedom [N/m]."""
        forces, local = self._evaluate(displacement, with_tangent=True)
        tangent = self.body.assemble(local.transpose(1, 2, 3, 0))
        return forces, tangent[self.free][:, self.free].tocsr()

    def energy(self, displacement: FloatArray) -> float:
        """Return the strain energy under displacements (n_dofs,) [J]."""
        gradients, volumes = self.body.barycentric_gradients
        lam, mu = self.body.material.lame
        displacements = displacement.reshape(-1, 3)[self.body.nodes]
        shape = np.einsum("qak,eki->eqai", self._slopes, gradients, optimize=True)
        gradient = np.einsum("eaj,eqai->eqji", displacements, shape, optimize=True)
        strain = 0.5 * (
            gradient + gradient.swapaxes(2, 3) + np.einsum("eqki,eqkj->eqij", gradient, gradient, optimize=True)
        )
        trace = np.trace(strain, axis1=2, axis2=3)
        density = 0.5 * lam * trace**2 + mu * np.einsum("eqij,eqij->eq", strain, strain)
        return float(volumes @ density @ self._weights)

    def _evaluate(self, displacement: FloatArray, *, with_tangent: bool) -> tuple[FloatArray, FloatArray]:
        gradients, volumes = self.body.barycentric_gradients
        nodes = self.body.nodes
        forces = np.zeros((len(nodes), 30))
        local = np.zeros((len(nodes) if with_tangent else 0, PAIRS.shape[1], 3, 3))
        displacements = np.ascontiguousarray(displacement.reshape(-1, 3)[nodes])
        lam, mu = self.body.material.lame
        _elements(gradients, volumes, self._slopes, self._weights, lam, mu, displacements, forces, local)
        total = np.bincount(self._dofs.ravel(), weights=forces.ravel(), minlength=self.body.n_dofs)
        return np.asarray(total, dtype=float), local

    @cached_property
    def _dofs(self) -> IntArray:
        return (3 * self.body.nodes[:, :, None] + np.arange(3)).reshape(-1, 30)


@njit(cache=True, nogil=True, error_model="numpy")
def _elements(
    gradients: FloatArray,
    volumes: FloatArray,
    derivatives: FloatArray,
    weights: FloatArray,
    lam: float,
    mu: float,
    displacements: FloatArray,
    forces: FloatArray,
    local: FloatArray,
) -> None:
    """Fill in each element's internal forces (m, 30) and, if asked for, its tangent by pairs of nodes (m, 55, 3, 3)."""
    g, p, s = np.zeros((10, 3)), np.zeros((10, 3)), np.zeros((10, 3))
    h, f, e, stress, left = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    for element in range(len(volumes)):
        for q in range(len(weights)):
            w = weights[q] * volumes[element]
            for a in range(10):
                for i in range(3):
                    g[a, i] = 0.0
                    for k in range(4):
                        g[a, i] += derivatives[q, a, k] * gradients[element, k, i]
            for i in range(3):
                for j in range(3):
                    h[i, j] = 0.0
                    for a in range(10):
                        h[i, j] += displacements[element, a, i] * g[a, j]
                    f[i, j] = h[i, j] + (i == j)
            for i in range(3):
                for j in range(3):
                    quadratic = h[0, i] * h[0, j] + h[1, i] * h[1, j] + h[2, i] * h[2, j]
                    e[i, j] = 0.5 * (h[i, j] + h[j, i] + quadratic)
                    left[i, j] = f[i, 0] * f[j, 0] + f[i, 1] * f[j, 1] + f[i, 2] * f[j, 2]
            trace = e[0, 0] + e[1, 1] + e[2, 2]
            for i in range(3):
                for j in range(3):
                    stress[i, j] = 2.0 * mu * e[i, j] + (lam * trace if i == j else 0.0)
            for a in range(10):
                for i in range(3):
                    p[a, i] = f[i, 0] * g[a, 0] + f[i, 1] * g[a, 1] + f[i, 2] * g[a, 2]
                    s[a, i] = stress[i, 0] * g[a, 0] + stress[i, 1] * g[a, 1] + stress[i, 2] * g[a, 2]
                for i in range(3):
                    forces[element, 3 * a + i] += w * (f[i, 0] * s[a, 0] + f[i, 1] * s[a, 1] + f[i, 2] * s[a, 2])
            if len(local) > 0:
                _tangent(local[element], w, lam, mu, g, p, s, left)


@njit(cache=True, nogil=True, error_model="numpy")
def _tangent(
    blocks: FloatArray,
    w: float,
    lam: float,
    mu: float,
    g: FloatArray,
    p: FloatArray,
    s: FloatArray,
    left: FloatArray,
) -> None:
    """Add what an integration point gives to the tangent between each pair of an element's nodes."""
    pair = 0
    for a in range(10):
        for b in range(a, 10):
            geometric = g[b, 0] * s[a, 0] + g[b, 1] * s[a, 1] + g[b, 2] * s[a, 2]
            straight = g[a, 0] * g[b, 0] + g[a, 1] * g[b, 1] + g[a, 2] * g[b, 2]
            for i in range(3):
                for j in range(3):
                    value = lam * p[a, i] * p[b, j] + mu * (straight * left[i, j] + p[b, i] * p[a, j])
                    if i == j:
                        value += geometric
                    blocks[pair, i, j] += w * value
            pair += 1
