"""How a port's face may deform: displacements that are polynomials over the face.

With s and t the distances of a place from the port's point along two directions in the face, in units of the face's
size, the shapes are

    e_i s^a t^b,   a + b <= degree,   i = x, y, z.

Degree 1 holds the six motions of a rigid face and three strains, degree 2 its bending besides. A superelement knows its
part by these shapes alone, so that two parts which meet in a port move alike there, warping included.

The shapes of a face are mapped on those of another, or rigid motions on shapes, by values at places enough to
distinguish them: polynomials of a degree stay such under rotation and reflection, so that the map is exact.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexdesign.design.part import Port

FloatArray = NDArray[np.float64]
#: Displacements (n, 3, k) [m] of k motions at places (n, 3) [m].
Motions = Callable[[FloatArray], FloatArray]

#: What a map between polynomials may leave, relative; rounding leaves 1e-14.
LEFT_OVER = 1e-9


@dataclass(frozen=True)
class PortShapes:
    """Polynomial displacements of one port's face.

    Parameters
    ----------
    port
        Whose face it is.
    size
        Unit of s and t [m], about half the face's extent: with it all shapes are of order one.
    degree
        Highest degree of the polynomials, 1 at least.
    """

    port: Port
    size: float
    degree: int

    @property
    def count(self) -> int:
        """Number of shapes: three for each monomial."""
        return 3 * len(self._powers)

    def at(self, places: FloatArray) -> FloatArray:
        """Return the displacements of all shapes, shape (n, 3, count), at places on the face, shape (n, 3) [m]."""
        s, t = self._tangents @ (places - np.array(self.port.point)).T / self.size
        monomials = np.stack([s**a * t**b for a, b in self._powers], axis=1)
        return np.asarray(np.einsum("nk,ij->nikj", monomials, np.eye(3)).reshape(len(places), 3, self.count))

    def coordinates(self, motions: Motions) -> FloatArray:
        """Return the shapes' amplitudes of motions that are polynomials of this degree on the face, shape (count, k).

        Raises
        ------
        ValueError
            If they are not.
        """
        wanted = motions(self._samples)
        values = wanted.reshape(-1, wanted.shape[-1])
        basis = self.at(self._samples).reshape(-1, self.count)
        found = np.linalg.lstsq(basis, values, rcond=None)[0]
        if np.abs(basis @ found - values).max() > LEFT_OVER * max(np.abs(values).max(), 1e-300):
            raise ValueError(f"{self.port.name}: not a polynomial of degree {self.degree} on this face")
        return np.asarray(found)

    @cached_property
    def rigid(self) -> FloatArray:
        """The shapes' amplitudes of the face's six rigid motions about the port's point, shape (count, 6)."""
        return self.coordinates(lambda places: rigid_motions(places, np.array(self.port.point)))

    @property
    def _powers(self) -> list[tuple[int, int]]:
        return [(a, order - a) for order in range(self.degree + 1) for a in range(order, -1, -1)]

    @cached_property
    def _tangents(self) -> FloatArray:
        """Two unit vectors in the face, shape (2, 3); coordinate axes where the normal is one."""
        normal = np.array(self.port.normal)
        first = np.eye(3)[np.argmin(np.abs(normal))]
        first = first - (first @ normal) * normal
        first /= np.linalg.norm(first)
        return np.stack([first, np.cross(normal, first)])

    @cached_property
    def _samples(self) -> FloatArray:
        grid = np.linspace(-1.0, 1.0, self.degree + 2) * self.size
        pairs = np.array(list(itertools.product(grid, grid)))
        return np.asarray(np.array(self.port.point) + pairs @ self._tangents)


def rigid_motions(places: FloatArray, point: FloatArray) -> FloatArray:
    """Return the displacements of three unit translations and three unit rotations about a point.

    Parameters
    ----------
    places
        Shape (..., 3) [m].
    point
        Shape (3,) [m].

    Returns
    -------
    ndarray
        Shape (..., 3, 6).
    """
    arms = places - point
    motions = np.zeros((*arms.shape[:-1], 3, 6))
    for axis, unit in enumerate(np.eye(3)):
        motions[..., axis] = unit
        motions[..., 3 + axis] = np.cross(unit, arms)
    return motions
