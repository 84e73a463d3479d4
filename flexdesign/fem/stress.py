"""Von Mises stress at the nodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexdesign.fem.elasticity import EDGES, Elasticity

FloatArray = NDArray[np.float64]


#: Barycentric coordinates of a tetrahedron's ten nodes.
NODES = np.vstack([np.eye(4), np.eye(4)[EDGES].mean(axis=1)])


def von_mises(stress: FloatArray) -> FloatArray:
    """Return the von Mises stress of stress tensors (..., 3, 3)."""
    deviator = stress - np.trace(stress, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) / 3
    return np.asarray(np.sqrt(1.5 * np.einsum("...ij,...ij->...", deviator, deviator)))


def nodal_von_mises(body: Elasticity, displacement: FloatArray) -> FloatArray:
    """Return the von Mises stress of the stress averaged at each node over its elements, shape (n,) [Pa]."""
    stress = body.stress(displacement, NODES)
    total = np.zeros((body.n_dofs // 3, 3, 3))
    np.add.at(total, body.nodes, stress)
    count = np.bincount(body.nodes.ravel(), minlength=len(total))
    return von_mises(total / count[:, None, None])
