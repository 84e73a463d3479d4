"""An extruded mechanism as a plane problem: quadratic triangles in plane stress, with the ports of the part.

A plate of thickness w that is free at both ends of the extrusion is in plane stress if leaves are narrow compared with
w; with sigma_zz = sigma_xz = sigma_yz = 0 the elastic tensor loses the directions out of the plane (static
condensation; a: xx, yy, xy, and b: zz, yz, xz),

    D = C_aa - C_ab C_bb^-1 C_ba,        w int eps(v) : D eps(u) dA = F . v.

Wide leaves are stiffer than that by up to 1 / (1 - nu^2), as their curvature cannot be anticlastic (`hinges.width`);
that is left to a correction (`multifidelity.correction`), as it is a smooth function of the dimensions.

Ports meet the section in lines. As in three dimensions (`ports`) a force enters with the uniform traction that belongs
to it, and the motion is the average over the face:

    t(x) = R(x) G^-1 F,    G = int R^T R ds,    R = [1 0 -(y - y_0); 0 1 x - x_0].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from flexdesign.design.materials import Material
from flexdesign.design.part import Port
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.planar import Triangulation
from flexdesign.fem.solving.solver import factorize, times
from flexdesign.fem.solving.statics import Checks, PortCompliance

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Gauss points on a piece of the outline, in shares of its length, and their weights: exact to degree 5.
PLACES = np.array([0.5 - np.sqrt(0.15), 0.5, 0.5 + np.sqrt(0.15)])
WEIGHTS = np.array([5, 8, 5]) / 18


@dataclass(frozen=True)
class Plate:
    """The discretised section of a fundamental domain.

    Parameters
    ----------
    domain
        The domain, an extrusion.
    plan
        Triangles of its section.
    material
        What it is made of.
    """

    domain: Domain
    plan: Triangulation
    material: Material

    @cached_property
    def basis(self) -> Any:
        """The scikit-fem basis of vector-valued quadratic triangles."""
        from skfem import Basis, ElementTriP2, ElementVector, MeshTri

        points, triangles = (np.ascontiguousarray(array.T) for array in (self.plan.points, self.plan.triangles))
        return Basis(MeshTri(points, triangles, validate=False), ElementVector(ElementTriP2()), intorder=2)

    @property
    def _directions(self) -> list[int]:
        """The two axes of the section, then that of the extrusion."""
        assert self.domain.section is not None
        return [(self.domain.section.axis + turn) % 3 for turn in (1, 2, 3)]

    @property
    def width(self) -> float:
        """Of the whole part along the extrusion [m]."""
        section, axis = self.domain.section, self._directions[2]
        assert section is not None
        images = sum(plane.index == axis for plane in self.domain.planes)
        return (section.high - section.low) * 2**images

    def stiffness(self) -> sp.csr_matrix:
        """Return the stiffness matrix, held dofs included [N/m]."""
        from skfem import BilinearForm

        d = self.width * plane_stress(self.material, self._directions)

        entries = [(i, j) for i in range(3) for j in range(3) if d[i, j]]

        @BilinearForm
        def form(u: Any, v: Any, _: Any) -> Any:
            of_u, of_v = _voigt(u), _voigt(v)
            return sum(d[i, j] * of_v[i] * of_u[j] for i, j in entries)

        return form.assemble(self.basis).tocsr()

    def nodes_on(self, face: int) -> IntArray:
        """Return the three nodes, ends then middle, of the pieces of the outline on a CAD face, shape (k, 3).

        Node n has the dofs that `dofs` lists in its row.
        """
        mesh, sides = self.basis.mesh, np.sort(self.plan.sides[self.plan.owners == face], axis=1)
        count = np.int64(mesh.p.shape[1])
        keys = mesh.facets.min(axis=0) * count + mesh.facets.max(axis=0)
        order = np.argsort(keys)
        found = order[np.searchsorted(keys[order], sides[:, 0] * count + sides[:, 1])]
        return np.column_stack([sides, count + found])

    @cached_property
    def dofs(self) -> IntArray:
        """The two degrees of freedom of each node, vertices then midpoints of edges, shape (n, 2)."""
        return np.concatenate([self.basis.nodal_dofs.T, self.basis.facet_dofs.T]).astype(np.int64)

    def load(self, port: Port) -> FloatArray:
        """Nodal forces of a unit force along the outward normal of a port, where it acts on the domain."""
        first, second, axis = self._directions
        nodes = self.nodes_on(self.domain.ports[port.name])
        a, b = self.plan.points[nodes[:, 0]], self.plan.points[nodes[:, 1]]
        lengths = np.linalg.norm(b - a, axis=1)
        arms = a[:, None] + PLACES[:, None] * (b - a)[:, None] - np.array(port.point)[[first, second]]  # (k, q, 2)
        rigid = np.zeros((*arms.shape, 3))
        rigid[..., 0, 0] = rigid[..., 1, 1] = 1.0
        rigid[..., 0, 2], rigid[..., 1, 2] = -arms[..., 1], arms[..., 0]
        gram = np.einsum("k,q,kqim,kqin->mn", lengths, WEIGHTS, rigid, rigid)
        for plane in self.domain.planes:
            if plane.index != axis and port.name not in plane.swaps.values():
                signs = np.array([-1.0 if plane.index == way else 1.0 for way in (first, second)] + [-1.0])
                gram = gram + gram * np.outer(signs, signs)
        force = np.append(np.array(port.normal)[[first, second]], 0.0)
        traction = rigid @ np.linalg.solve(gram, force)  # (k, q, 2)
        shape = np.column_stack([(1 - PLACES) * (1 - 2 * PLACES), PLACES * (2 * PLACES - 1), 4 * PLACES * (1 - PLACES)])
        shares = np.einsum("k,q,qa,kqi->kai", lengths, WEIGHTS, shape, traction)
        forces = np.zeros(self.basis.N)
        np.add.at(forces, self.dofs[nodes], shares)
        return forces

    def free(self, ports: Sequence[Port]) -> IntArray:
        """Return the dofs that neither the ground nor the symmetric class holds."""
        held = [
            self.dofs[self.nodes_on(self.domain.ports[port.name])].ravel()
            for port in ports
            if port.role == "ground" and port.name in self.domain.ports
        ]
        for plane, faces in zip(self.domain.planes, self.domain.plane_faces, strict=True):
            if plane.index in self._directions[:2]:
                normal = self._directions.index(plane.index)
                held += [self.dofs[self.nodes_on(face), normal].ravel() for face in faces]
        return np.setdiff1d(np.arange(self.basis.N), np.concatenate(held))

    def compliance(self, ports: Sequence[Port]) -> PortCompliance:
        """Return extension and output motion of the whole part under unit actuator and output force.

        Raises
        ------
        ArithmeticError
            If reciprocity or the residual shows that the solution must not be used.
        """
        free, stiffness = self.free(ports), self.stiffness()
        loads = np.column_stack([self._driven(ports, "input", -1.0), self._driven(ports, "output", 1.0)])[free]
        upper = sp.triu(stiffness[free][:, free], format="csr")
        factor = factorize(upper)
        displacements = factor.solve(loads)
        factor.free()
        gram = loads.T @ displacements
        residual = np.linalg.norm(times(upper, displacements) - loads, axis=0) / np.linalg.norm(loads, axis=0)
        scale = np.sqrt(np.outer(np.diag(gram), np.diag(gram)))
        Checks(float((np.abs(gram - gram.T) / scale).max()), 0.0, 0.0, float(residual.max())).require()
        images = 2 ** sum(plane.index != self._directions[2] for plane in self.domain.planes)
        return PortCompliance(images * gram, np.array([1.0, 0.0]), np.array([0.0, 1.0]))

    def _driven(self, ports: Sequence[Port], role: str, sign: float) -> FloatArray:
        driven = [port for port in ports if port.role == role and port.name in self.domain.ports]
        return np.asarray(sign * sum((self.load(port) for port in driven), np.zeros(self.basis.N)))


def plane_stress(material: Material, directions: Sequence[int]) -> FloatArray:
    """Return the D of the module's formula for xx, yy, xy strains (2 eps_xy), shape (3, 3) [Pa]."""
    x, y, z = directions
    pairs = [(x, x), (y, y), (x, y), (z, z), (y, z), (x, z)]
    c = np.array([[material.tensor[(*one, *two)] for two in pairs] for one in pairs])
    return np.asarray(c[:3, :3] - c[:3, 3:] @ np.linalg.solve(c[3:, 3:], c[3:, :3]))


def _voigt(field: Any) -> tuple[Any, Any, Any]:
    """Return the strains xx, yy and 2 xy of a displacement field."""
    slope = field.grad
    return slope[0][0], slope[1][1], slope[0][1] + slope[1][0]
