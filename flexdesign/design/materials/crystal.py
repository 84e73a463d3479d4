"""Cubic crystals: an elastic tensor that depends on how the part lies in the crystal.

In crystal axes m the stiffness of a cubic crystal is that of an isotropic body and one term more, which alone knows the
axes (Nye 1985, Physical Properties of Crystals, ch. VIII). With a_im, the direction cosines of the part's axis i,

    C_ijkl = c12 d_ij d_kl + c44 (d_ik d_jl + d_il d_jk) + (c11 - c12 - 2 c44) sum_m a_im a_jm a_km a_lm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Vector = tuple[float, float, float]

#: Voigt's pairs of indices, in order: xx, yy, zz, yz, xz, xy.
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
#: How a part cut from a (001) wafer lies in the crystal: its axes x, y, z as crystal directions.
WAFER = {
    "<100>": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "<110>": ((1.0, 1.0, 0.0), (-1.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
}


@dataclass(frozen=True)
class Crystal:
    """A cubic crystal and how a part lies in it.

    Parameters
    ----------
    c11, c12, c44
        Elastic stiffnesses [Pa].
    axes
        The part's axes x, y, z as orthogonal directions of the crystal, of any length.
    """

    c11: float
    c12: float
    c44: float
    axes: tuple[Vector, Vector, Vector] = WAFER["<100>"]

    @property
    def anisotropy(self) -> float:
        """Zener's ratio 2 c44 / (c11 - c12); 1 for an isotropic body."""
        return 2 * self.c44 / (self.c11 - self.c12)

    @property
    def cosines(self) -> FloatArray:
        """Direction cosines a_im of the part's axes i in the crystal's axes m, shape (3, 3)."""
        axes = np.array(self.axes)
        return np.asarray(axes / np.linalg.norm(axes, axis=1, keepdims=True))

    @property
    def tensor(self) -> FloatArray:
        """The stiffness C_ijkl in the part's axes, shape (3, 3, 3, 3) [Pa]."""
        a = self.cosines
        cubic = self.c11 - self.c12 - 2 * self.c44
        return isotropic(self.c12, self.c44) + cubic * np.einsum("im,jm,km,lm->ijkl", a, a, a, a)

    def along(self, direction: Vector) -> float:
        """Return Young's modulus [Pa] along a direction of the crystal (Nye 1985, ch. VIII, sec. 5)."""
        n = np.array(direction) / np.linalg.norm(direction)
        s11 = (self.c11 + self.c12) / ((self.c11 - self.c12) * (self.c11 + 2 * self.c12))
        excess = 1 / (self.c11 - self.c12) - 0.5 / self.c44  # s11 - s12 - s44 / 2, zero for an isotropic body
        mixed = n[0] ** 2 * n[1] ** 2 + n[1] ** 2 * n[2] ** 2 + n[2] ** 2 * n[0] ** 2
        return float(1 / (s11 - 2 * excess * mixed))


def isotropic(lam: float, mu: float) -> FloatArray:
    """Return lam d_ij d_kl + mu (d_ik d_jl + d_il d_jk) [Pa], shape (3, 3, 3, 3)."""
    unit = np.eye(3)
    shear = np.einsum("ik,jl->ijkl", unit, unit) + np.einsum("il,jk->ijkl", unit, unit)
    return np.asarray(lam * np.einsum("ij,kl->ijkl", unit, unit) + mu * shear)


def matrix(tensor: FloatArray) -> FloatArray:
    """Return a stiffness tensor as Voigt's 6 by 6 matrix, for strains with the shear angles gamma = 2 eps."""
    return np.array([[tensor[i, j, k, l] for k, l in VOIGT] for i, j in VOIGT])


def engineering(tensor: FloatArray, pull: FloatArray, across: FloatArray) -> tuple[float, float, float]:
    """Return E and nu under tension along `pull`, contracting along `across`, and G of the two; unit vectors.

    They follow from the compliance s = C^-1: E = 1/s_pppp, nu = -s_ppaa E, G = 1/(4 s_papa).
    """
    third = np.cross(pull, across)
    frame = np.array([pull, across, third])
    turned = np.einsum("ai,bj,ck,dl,ijkl->abcd", frame, frame, frame, frame, tensor, optimize=True)
    compliance = np.linalg.inv(matrix(turned))
    young = 1 / compliance[0, 0]
    return float(young), float(-compliance[0, 1] * young), float(1 / compliance[5, 5])
