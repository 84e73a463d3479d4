"""Nodal forces of loads that are spread over a body or its surface.

They do the work of the load on every displacement that the elements can have, f_a = int N_a b dV and int N_a t dA
(Zienkiewicz, Taylor and Zhu, The Finite Element Method: Its Basis and Fundamentals, 7th ed., section 2.3).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from flexdesign.fem.solving.elasticity import Elasticity, quadrature, shape_functions

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
#: Values at places of shape (..., 3) [m].
Field = Callable[[FloatArray], FloatArray]

#: Loads that vary like the square of the place are integrated exactly, others with an error that falls faster than
#: that of the elements.
DEGREE = 5


def body_force(body: Elasticity, density: Field) -> FloatArray:
    """Return the nodal forces (n_dofs,) [N] of a force per volume.

    Parameters
    ----------
    body
        What it acts on.
    density
        Force per volume [N/m^3], shape (..., 3), at places of shape (..., 3) [m].

    Examples
    --------
    A tetrahedron with three edges of 1 m along the axes, of 1/6 m^3 of steel:

    >>> from flexdesign.fem.meshing.mesh import TaggedMesh, boundary
    >>> from flexdesign.design.materials import Material
    >>> tets = np.array([[0, 1, 2, 3]])
    >>> mesh = TaggedMesh(np.vstack([np.zeros(3), np.eye(3)]), tets, boundary(tets), np.zeros(4, int))
    >>> body = Elasticity(mesh, Material("steel", 210e9, 0.3, 7850.0, None))
    >>> weight = body_force(body, lambda x: np.broadcast_to([0.0, 0.0, -7850 * 9.81], x.shape))
    >>> float(weight[2::3].sum())
    -12834.75
    """
    barycentric, weights = quadrature(4, DEGREE)
    _, volumes = body.barycentric_gradients
    places = np.einsum("qk,eki->eqi", barycentric, body.positions[body.nodes[:, :4]])
    forces = np.einsum(
        "e,q,qa,eqi->eai", volumes, weights, shape_functions(barycentric), density(places), optimize=True
    )
    return _gather(body, body.nodes, forces)


def traction(body: Elasticity, facets: IntArray, stress: Field) -> FloatArray:
    """Return the nodal forces (n_dofs,) [N] of a force per area on part of the surface.

    Parameters
    ----------
    body
        What it acts on.
    facets
        Corners of the boundary facets that bear it, shape (k, 3).
    stress
        Force per area [Pa], shape (..., 3), at places of shape (..., 3) [m].
    """
    return _on_facets(body, facets, lambda places, _: stress(places))


def pressure(body: Elasticity, facets: IntArray, value: float) -> FloatArray:
    """Return the nodal forces (n_dofs,) [N] of a pressure, which pushes against the outward normal.

    Parameters
    ----------
    body
        What it acts on.
    facets
        Corners of the boundary facets that bear it, seen from outside counter-clockwise, shape (k, 3).
    value
        The pressure [Pa]; negative where it pulls.
    """
    return _on_facets(body, facets, lambda places, normals: np.broadcast_to(-value * normals[:, None], places.shape))


def _on_facets(
    body: Elasticity, facets: IntArray, stress: Callable[[FloatArray, FloatArray], FloatArray]
) -> FloatArray:
    nodes = body.surface_nodes(facets)
    a, b, c = (body.positions[nodes[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    doubled = np.linalg.norm(across, axis=1)
    barycentric, weights = quadrature(3, DEGREE)
    places = np.einsum("qk,kfi->fqi", barycentric, np.stack([a, b, c]))
    values = stress(places, across / doubled[:, None])
    forces = np.einsum("f,q,qa,fqi->fai", doubled / 2, weights, shape_functions(barycentric), values, optimize=True)
    return _gather(body, nodes, forces)


def _gather(body: Elasticity, nodes: IntArray, forces: FloatArray) -> FloatArray:
    dofs = 3 * nodes[:, :, None] + np.arange(3)
    return np.asarray(np.bincount(dofs.ravel(), weights=forces.ravel(), minlength=body.n_dofs), dtype=float)
