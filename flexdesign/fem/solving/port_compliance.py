"""Ports on a mesh: how a force enters a face, and what its displacement is.

A port carries six generalised forces F (three forces [N], three moments about its point [N m]) and the six motions q
that do work on them. With the rigid motions R(x) of the face, the traction and the motion are

    t(x) = R(x) G^-1 F,    q = G^-1 int R^T u dA,    G = int R^T R dA

over the whole face: a uniform traction for a force, and the area average of the displacement for a translation. The
face stays free to deform, unlike under a rigid stamp.

A port of the whole part meets the fundamental domain in a half or a quarter, or not at all; each symmetry class keeps
the motions that fit it.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.design.part import Port, SymmetryPlane
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.surface import triangle_areas
from flexdesign.fem.solving.elasticity import Elasticity, quadrature, shape_functions
from flexdesign.fem.solving.port_shapes import rigid_motions

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: The motions of a port, in order.
MOTIONS = ("x", "y", "z", "rx", "ry", "rz")


def parity(axis: int) -> NDArray[np.int64]:
    """Return +1 or -1 for each of the six motions under reflection in the plane normal to `axis`.

    A force along the normal changes its sign; a moment, being axial, keeps its sign along the normal alone.
    """
    signs = np.array([1, 1, 1, -1, -1, -1])
    signs[axis] = -1
    signs[3 + axis] = 1
    return signs


@dataclass(frozen=True)
class SymmetryClass:
    """Fields that are even (+1) or odd (-1) in each symmetry plane."""

    planes: tuple[SymmetryPlane, ...]
    signs: tuple[int, ...]

    @property
    def name(self) -> str:
        """For instance ``even in x, odd in z``; ``whole part`` without symmetry."""
        pieces = [f"{'even' if s > 0 else 'odd'} in {p.axis}" for p, s in zip(self.planes, self.signs, strict=True)]
        return ", ".join(pieces) or "whole part"

    @property
    def is_symmetric(self) -> bool:
        """Whether it is the class of fully symmetric fields."""
        return all(sign > 0 for sign in self.signs)

    def held_components(self, plane: int) -> list[int]:
        """Return the displacement components that vanish on a plane: the normal if even, the others if odd."""
        normal = self.planes[plane].index
        return [normal] if self.signs[plane] > 0 else [i for i in range(3) if i != normal]


def classes(domain: Domain) -> tuple[SymmetryClass, ...]:
    """Return all symmetry classes of a domain, the fully symmetric one first."""
    signs = itertools.product((1, -1), repeat=len(domain.planes))
    return tuple(SymmetryClass(domain.planes, s) for s in signs)


@dataclass(frozen=True)
class PortSpace:
    """The moving ports of the whole part and their loads on the fundamental domain.

    Parameters
    ----------
    ports
        Ports of the whole part that can move, in the order of the rows of the compliance, six rows each.
    retained
        Names of those that lie in the domain.
    loads
        For each kept port the nodal forces of its six unit loads that fall on the domain, shape (n_dofs, 6).
    planes
        Symmetry planes that bound the domain.
    """

    ports: tuple[Port, ...]
    retained: tuple[str, ...]
    loads: dict[str, FloatArray]
    planes: tuple[SymmetryPlane, ...]

    @property
    def size(self) -> int:
        """Number of rows of the compliance of the whole part."""
        return 6 * len(self.ports)

    def rows(self, name: str) -> slice:
        """Return the rows of one port."""
        index = [port.name for port in self.ports].index(name)
        return slice(6 * index, 6 * index + 6)

    def retained_rows(self, name: str) -> slice:
        """Return the places of one kept port among the motions of those that lie in the domain."""
        index = self.retained.index(name)
        return slice(6 * index, 6 * index + 6)

    def of_role(self, role: str) -> NDArray[np.bool_]:
        """Tell which kept motions belong to ports of a role, shape (6 * kept,)."""
        roles = {port.name: port.role for port in self.ports}
        return np.repeat([roles[name] == role for name in self.retained], 6)

    def along(self, role: str, sign: float) -> FloatArray:
        """Return the vector that adds up motions along (+1) or against (-1) the outward normals of a role's ports."""
        vector = np.zeros(self.size)
        for port in self.ports:
            if port.role == role:
                vector[self.rows(port.name)][:3] = sign * np.array(port.normal)
        return vector

    @property
    def extension(self) -> FloatArray:
        """What the actuator feels: motions of the input ports against their outward normals, added up."""
        return self.along("input", -1.0)

    @property
    def output(self) -> FloatArray:
        """Motion of the output along its outward normal."""
        return self.along("output", 1.0)

    def projection(self, cls: SymmetryClass) -> FloatArray:
        """Return P with q_whole = P^T q_domain for one class, (6 * kept, size); rows that do not fit are zero."""
        matrix = np.zeros((6 * len(self.retained), self.size))
        for index, name in enumerate(self.retained):
            fits = np.ones(6, dtype=bool)
            for plane, sign in zip(self.planes, cls.signs, strict=True):
                if name not in plane.swaps.values():
                    fits &= parity(plane.index) == sign
            for image, signs in self._images(name, cls):
                matrix[6 * index : 6 * index + 6, self.rows(image)] += np.diag(signs * fits)
        return matrix

    def _images(self, name: str, cls: SymmetryClass) -> list[tuple[str, IntArray]]:
        images = [(name, np.ones(6, dtype=np.int64))]
        for plane, sign in zip(self.planes, cls.signs, strict=True):
            back = {source: left for left, source in plane.swaps.items()}
            images += [(back[n], s * sign * parity(plane.index)) for n, s in images if n in back]
        return images

    @property
    def halves(self) -> FloatArray:
        """What of a load on the whole part each class gets, for each kept motion: halved where a port has an image."""
        return np.repeat([0.5 ** self.swaps(name) for name in self.retained], 6)

    def swaps(self, name: str) -> int:
        """Return in how many planes the kept port has a mirror image of another name."""
        return sum(name in plane.swaps.values() for plane in self.planes)


def port_space(body: Elasticity, domain: Domain, ports: Sequence[Port]) -> PortSpace:
    """Find the moving ports on the mesh and integrate their loads."""
    moving = tuple(port for port in ports if port.role != "ground")
    retained = tuple(port.name for port in moving if port.name in domain.ports)
    loads = {port.name: _loads(body, domain, port) for port in moving if port.name in retained}
    return PortSpace(moving, retained, loads, domain.planes)


def _loads(body: Elasticity, domain: Domain, port: Port) -> FloatArray:
    """Nodal forces of the six unit loads: int N R dA G^-1, with G over the whole face."""
    nodes = body.surface_nodes(body.mesh.on_face(domain.ports[port.name]))
    corners = body.positions[nodes[:, :3]]
    areas = triangle_areas(corners)
    barycentric, weights = quadrature(3, 4)
    places = np.einsum("qk,fki->fqi", barycentric, corners)
    rigid = rigid_motions(places, np.array(port.point))  # (f, q, 3, 6)
    shape = shape_functions(barycentric)  # (q, 6)
    forces = np.einsum("f,q,qa,fqim->faim", areas, weights, shape, rigid, optimize=True)
    nodal = np.zeros((body.n_dofs // 3, 3, 6))
    np.add.at(nodal, nodes, forces)
    gram = np.einsum("f,q,fqim,fqin->mn", areas, weights, rigid, rigid, optimize=True)
    for plane in domain.planes:
        if port.name not in plane.swaps.values():
            signs = parity(plane.index)
            gram = gram + gram * np.outer(signs, signs)
    return np.asarray(nodal.reshape(-1, 6) @ np.linalg.inv(gram))
