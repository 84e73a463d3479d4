"""Effective modal masses: the participating mass of each mode under base excitation.

With r the unit translation of all nodes along an axis, held ones included, and phi a mode of unit modal mass,

    m = (phi . M r)^2

is the mass that a rigidly mounted oscillator of the mode's frequency must have to load the ground as the mode does
(Clough and Penzien, Dynamics of Structures, 3rd ed., section 26.3). Over all modes the masses along an axis add up to
the mass of the part, less what the held nodes carry of it on a mesh.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from flexdesign.fem.solving.port_compliance import SymmetryClass, parity
from flexdesign.fem.solving.solver import times

FloatArray = NDArray[np.float64]
Three = tuple[float, float, float]


def translated_mass(mass: sp.csr_matrix) -> FloatArray:
    """Return M r for unit translations along x, y, z, shape (n_dofs, 3) [kg], of a mass matrix's upper triangle."""
    translations = np.tile(np.eye(3), (mass.shape[0] // 3, 1))
    return times(mass, translations)


def of_mode(shape: FloatArray, moving_mass: FloatArray, cls: SymmetryClass) -> Three:
    """Return the effective masses of a mode along x, y, z [kg].

    Parameters
    ----------
    shape
        Displacements of the domain's nodes for unit modal mass of the whole part, shape (n, 3) [1/sqrt(kg)].
    moving_mass
        From `translated_mass`, of the domain.
    cls
        The mode's symmetry class; a translation that does not fit it stirs no mode of it: the images cancel.
    """
    fits = np.ones(3, dtype=bool)
    for plane, sign in zip(cls.planes, cls.signs, strict=True):
        fits &= parity(plane.index)[:3] == sign
    parts = 2 ** len(cls.planes) * (shape.ravel() @ moving_mass)
    x, y, z = np.where(fits, parts**2, 0.0).tolist()
    return x, y, z
