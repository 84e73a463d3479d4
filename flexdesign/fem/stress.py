"""Von Mises stress, and what a peak at a sharp root is worth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.fem.elasticity import Elasticity

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class PeakStress:
    """The largest von Mises stress and where it is.

    Parameters
    ----------
    value
        [Pa].
    place
        Position in the fundamental domain, shape (3,) [m].
    """

    value: float
    place: FloatArray


def von_mises(stress: FloatArray) -> FloatArray:
    """Return the von Mises stress of stress tensors (..., 3, 3)."""
    deviator = stress - np.trace(stress, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) / 3
    return np.asarray(np.sqrt(1.5 * np.einsum("...ij,...ij->...", deviator, deviator)))


def nodal_von_mises(body: Elasticity, displacement: FloatArray) -> FloatArray:
    """Return the von Mises stress of the stress averaged at each mesh vertex over its elements, shape (n,) [Pa]."""
    stress = body.stress(displacement, np.eye(4))
    total = np.zeros((len(body.mesh.points), 3, 3))
    np.add.at(total, body.mesh.tets, stress)
    count = np.bincount(body.mesh.tets.ravel(), minlength=len(total))
    return von_mises(total / count[:, None, None])


def peak(body: Elasticity, displacement: FloatArray) -> PeakStress:
    """Return the largest vertex-averaged von Mises stress."""
    values = nodal_von_mises(body, displacement)
    return PeakStress(float(values.max()), body.mesh.points[int(values.argmax())])
