"""Quadratic tetrahedra for linear elasticity: stiffness, mass, and the fields that follow from displacements.

The degrees of freedom are scikit-fem's. Its general forms evaluate basis functions in every element; on tetrahedra with
straight edges the gradients of the barycentric coordinates are constant, so that one reference tensor serves them all:

    K_e[a i, b j] = V (lam d_i N_a d_j N_b + mu d_j N_a d_i N_b + mu delta_ij d_k N_a d_k N_b),   averaged over e
    M_e[a i, b j] = rho V delta_ij N_a N_b

which is the same integral, exact, six times sooner. A crystal has 21 constants instead of two:

    K_e[a i, b j] = V C_ikjl d_k N_a d_l N_b.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from flexdesign.design.materials import Material
from flexdesign.fem.meshing.mesh import TaggedMesh
from flexdesign.fem.solving.solver import elimination_order

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Corner pairs whose midpoints are the nodes 4 to 9, in the order of scikit-fem's ElementTetP2.
EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
#: Pairs of an element's nodes, shape (2, 55): what is symmetric is integrated once.
PAIRS = np.stack(np.triu_indices(10))


@dataclass(frozen=True)
class Elasticity:
    """The discretised body.

    Parameters
    ----------
    mesh
        Its tetrahedra.
    material
        What it is made of.
    """

    mesh: TaggedMesh
    material: Material

    @cached_property
    def basis(self) -> Any:
        """The scikit-fem basis of vector-valued quadratic tetrahedra."""
        from skfem import Basis, ElementTetP2, ElementVector, MeshTet

        mesh = MeshTet(
            np.ascontiguousarray(self.mesh.points.T),
            np.ascontiguousarray(self.mesh.tets.T),
            sort_t=False,
            validate=False,
        )
        return Basis(mesh, ElementVector(ElementTetP2()), quadrature=(np.full((3, 1), 0.25), np.array([1 / 6])))

    @cached_property
    def nodes(self) -> IntArray:
        """Node numbers of each element, corners then edge midpoints, shape (m, 10); node n has dofs 3n, 3n+1, 3n+2."""
        return (self._scikit_nodes // 3).astype(np.int64)

    @cached_property
    def _scikit_nodes(self) -> IntArray:
        return np.asarray(self.basis.element_dofs[0::3].T)

    @cached_property
    def positions(self) -> FloatArray:
        """Positions of the nodes, shape (n, 3) [m]."""
        corners = self.mesh.points[self.mesh.tets]
        places = np.empty((self.n_dofs // 3, 3))
        places[self.nodes[:, :4]] = corners
        places[self.nodes[:, 4:]] = corners[:, EDGES].mean(axis=2)
        return places

    @property
    def n_dofs(self) -> int:
        """Number of degrees of freedom, those held included."""
        return int(self.basis.N)

    @cached_property
    def barycentric_gradients(self) -> tuple[FloatArray, FloatArray]:
        """Gradients of the barycentric coordinates (m, 4, 3) [1/m] and volumes (m,) [m^3]."""
        corners = self.mesh.points[self.mesh.tets]
        jacobian = corners[:, 1:] - corners[:, :1]
        inverse = np.linalg.inv(jacobian)  # column k is the gradient of coordinate k + 1
        rest = inverse.transpose(0, 2, 1)
        return np.concatenate([-rest.sum(axis=1, keepdims=True), rest], axis=1), np.linalg.det(jacobian) / 6

    def on_mesh(self, mesh: TaggedMesh, material: Material) -> Elasticity:
        """Return a body on a mesh that differs in its points alone; numbers of nodes and places of entries stay."""
        other = Elasticity(mesh, material)
        for name in ("basis", "_scikit_nodes", "nodes", "vertex_nodes", "_edge_nodes", "_node_pairs",
                     "elimination_order"):  # fmt: skip
            vars(other)[name] = getattr(self, name)
        return other

    def stiffness(self, *, zeros: bool = False) -> sp.csr_matrix:
        """Return the stiffness matrix's upper triangle, held dofs included [N/m].

        With `zeros` entries that happen to be zero stay, so that moved bodies have them in the same places.
        """
        gradients, volumes = self.barycentric_gradients
        products = np.einsum("eki,elj,e->klije", gradients, gradients, volumes, optimize=True)
        pairs = (_stiffness_tensor() @ products.reshape(16, -1)).reshape(-1, 3, 3, len(volumes))
        local = self._isotropic(pairs) if self.material.crystal is None else self._anisotropic(pairs)
        return self.assemble(local, zeros=zeros)

    def assemble(self, local: FloatArray, *, zeros: bool = False) -> sp.csr_matrix:
        """Return the upper triangle of a symmetric matrix, held dofs included.

        `local` holds what each element gives to each pair of `PAIRS`: component i of its first node in the row, j of
        its second in the column, shape (55, 3, 3, m); `zeros` as `stiffness` takes it.
        """
        turned, places, columns, starts = self._node_pairs
        blocks = np.empty((len(columns), 3, 3))
        for i, j in itertools.product(range(3), repeat=2):
            entries = np.where(turned, local[:, j, i], local[:, i, j])
            blocks[:, i, j] = np.bincount(places, weights=entries.ravel())
        for i, j in ((1, 0), (2, 0), (2, 1)):
            blocks[starts[:-1], i, j] = 0.0  # of a node with itself, which comes first in its row
        matrix = sp.bsr_matrix((blocks, columns, starts), shape=(self.n_dofs, self.n_dofs)).tocsr()
        if zeros:
            return sp.triu(matrix, format="csr")
        matrix.eliminate_zeros()
        return matrix

    def _isotropic(self, pairs: FloatArray) -> FloatArray:
        """Contract the integrals of d_i N_a d_j N_b, shape (55, 3, 3, m), with two constants."""
        lam, mu = self.material.lame
        local = lam * pairs + mu * pairs.transpose(0, 2, 1, 3)
        trace = mu * np.einsum("piie->pe", pairs)
        for i in range(3):
            local[:, i, i] += trace
        return np.asarray(local)

    def _anisotropic(self, pairs: FloatArray) -> FloatArray:
        """Contract them with the whole elastic tensor: rows i j, columns k l of C_ikjl."""
        rows = self.material.tensor.transpose(0, 2, 1, 3).reshape(9, 9)
        return np.asarray((rows @ pairs.reshape(len(pairs), 9, -1)).reshape(pairs.shape))

    def mass(self) -> sp.csr_matrix:
        """Return the consistent mass matrix's upper triangle, held dofs included [kg]."""
        _, volumes = self.barycentric_gradients
        _, places, columns, starts = self._node_pairs
        entries = self.material.density * np.outer(_mass_tensor(), volumes)
        of_nodes = sp.csr_matrix((np.bincount(places, weights=entries.ravel()), columns, starts))
        return sp.kron(of_nodes, np.eye(3), format="csr")

    @cached_property
    def _node_pairs(self) -> tuple[NDArray[np.bool_], IntArray, IntArray, IntArray]:
        """Where the pairs of an element's nodes go in matrices between nodes, upper triangle.

        Whether a pair of `PAIRS` has its larger node first (55, m), its place among all pairs, flat, and these pairs'
        columns and row starts.
        """
        first, second = self.nodes[:, PAIRS].transpose(1, 2, 0)
        count = self.n_dofs // 3
        keys = np.minimum(first, second) * np.int64(count) + np.maximum(first, second)
        found, places = np.unique(keys, return_inverse=True)
        starts = np.searchsorted(found, np.arange(count + 1) * np.int64(count))
        return first > second, places.reshape(-1), found % count, starts

    @cached_property
    def elimination_order(self) -> IntArray | None:
        """The order in which a factorization should eliminate the nodes, shape (n,); None if the solver finds its own.

        It is found on nodes, a third of the unknowns, and once for all that is held on the same mesh.
        """
        _, _, columns, starts = self._node_pairs
        return elimination_order(sp.csr_matrix((np.ones(len(columns)), columns, starts)))

    def strain(
        self, displacement: FloatArray, barycentric: FloatArray, elements: IntArray | slice = slice(None)
    ) -> FloatArray:
        """Return the strain tensor in every element, or in some, at the given places.

        Parameters
        ----------
        displacement
            Nodal displacements, shape (n, 3) [m].
        barycentric
            Barycentric coordinates of the places, shape (q, 4).
        elements
            Which elements.

        Returns
        -------
        ndarray
            Shape (m, q, 3, 3).
        """
        gradients = self.barycentric_gradients[0][elements]
        shape = np.einsum("qak,eki->eqai", shape_derivatives(barycentric), gradients, optimize=True)
        slope = np.einsum("eqai,eaj->eqij", shape, displacement[self.nodes[elements]], optimize=True)
        return np.asarray((slope + slope.transpose(0, 1, 3, 2)) / 2)

    def stress(
        self, displacement: FloatArray, barycentric: FloatArray, elements: IntArray | slice = slice(None)
    ) -> FloatArray:
        """Return the stress tensor [Pa] where `strain` returns the strain, shape (m, q, 3, 3)."""
        return self._stress(self.strain(displacement, barycentric, elements))

    def _stress(self, strain: FloatArray) -> FloatArray:
        """Return the stress [Pa] that belongs to a strain, both (m, q, 3, 3)."""
        if self.material.crystal is not None:
            return np.asarray(np.einsum("ijkl,eqkl->eqij", self.material.tensor, strain, optimize=True))
        lam, mu = self.material.lame
        trace = np.trace(strain, axis1=2, axis2=3)
        return 2 * mu * strain + lam * trace[..., None, None] * np.eye(3)

    def strain_energy(self, displacement: FloatArray) -> float:
        """Return half the integral of stress times strain [J], from the stresses at the integration points."""
        points, weights = stress_points()
        _, volumes = self.barycentric_gradients
        strain = self.strain(displacement, points)
        density = np.einsum("eqij,eqij->eq", self._stress(strain), strain)
        return float(volumes @ density @ weights / 2)

    def surface_nodes(self, facets: IntArray) -> IntArray:
        """Return the six nodes, corners then edge midpoints, of each boundary facet, shape (k, 6)."""
        corners = self.vertex_nodes[facets]
        lookup = self._edge_nodes
        n = np.int64(self.n_dofs)
        sides = [np.sort(corners[:, pair], axis=1) for pair in ((0, 1), (1, 2), (0, 2))]
        middles = [lookup[1][np.searchsorted(lookup[0], side[:, 0] * n + side[:, 1])] for side in sides]
        return np.column_stack([corners, *middles])

    @cached_property
    def vertex_nodes(self) -> IntArray:
        """Node number of each mesh vertex, shape (v,)."""
        table = np.full(len(self.mesh.points), -1, dtype=np.int64)
        table[self.mesh.tets] = self.nodes[:, :4]
        return table

    @cached_property
    def _edge_nodes(self) -> tuple[IntArray, IntArray]:
        ends = np.sort(self.nodes[:, EDGES].reshape(-1, 2), axis=1)
        keys, first = np.unique(ends[:, 0] * np.int64(self.n_dofs) + ends[:, 1], return_index=True)
        return keys, self.nodes[:, 4:].reshape(-1)[first]


def stress_points() -> tuple[FloatArray, FloatArray]:
    """Barycentric points (4, 4) and weights (4,) at which products of linear fields integrate exactly."""
    inner, outer = (5 - np.sqrt(5)) / 20, (5 + 3 * np.sqrt(5)) / 20
    return np.full((4, 4), inner) + np.eye(4) * (outer - inner), np.full(4, 0.25)


def quadrature(corners: int, degree: int) -> tuple[FloatArray, FloatArray]:
    """Return a rule of scikit-fem's that is exact to a degree, on a simplex with 3 or 4 corners.

    Barycentric points, shape (q, corners), and weights (q,) of sum one.
    """
    from skfem.quadrature import get_quadrature
    from skfem.refdom import RefTet, RefTri

    points, weights = get_quadrature(RefTet if corners == 4 else RefTri, degree)
    return np.column_stack([1 - points.sum(axis=0), points.T]), weights / weights.sum()


def shape_functions(barycentric: FloatArray) -> FloatArray:
    """N_a, corners then edge midpoints, at places in tetrahedra (q, 4) or on triangles (q, 3): (q, 10) or (q, 6)."""
    ends = EDGES[EDGES.max(axis=1) < barycentric.shape[1]]
    middles = 4 * barycentric[:, ends[:, 0]] * barycentric[:, ends[:, 1]]
    return np.hstack([barycentric * (2 * barycentric - 1), middles])


def shape_derivatives(barycentric: FloatArray) -> FloatArray:
    """dN_a / dL_k at places (q, 4): shape (q, 10, 4)."""
    count = len(barycentric)
    result = np.zeros((count, 10, 4))
    for k in range(4):
        result[:, k, k] = 4 * barycentric[:, k] - 1
    for a, (i, j) in enumerate(EDGES, start=4):
        result[:, a, i] = 4 * barycentric[:, j]
        result[:, a, j] = 4 * barycentric[:, i]
    return result


def _stiffness_tensor() -> FloatArray:
    """Mean of dN_a/dL_k dN_b/dL_l over a tetrahedron for the pairs a, b of `PAIRS`, shape (55, 16)."""
    points, weights = quadrature(4, 4)
    gradients = shape_derivatives(points)
    return np.einsum("q,qak,qbl->abkl", weights, gradients, gradients)[*PAIRS].reshape(-1, 16)


def _mass_tensor() -> FloatArray:
    """Mean of N_a N_b over a tetrahedron for the pairs a, b of `PAIRS`, shape (55,)."""
    points, weights = quadrature(4, 4)
    values = shape_functions(points)
    return np.asarray(np.einsum("q,qa,qb->ab", weights, values, values)[*PAIRS])
