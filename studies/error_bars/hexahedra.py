"""Elastic extrusions by graded 27-node hexahedra: a reference that shares nothing with `flexdesign.fem`.

A plan, x against y, is put together of patches of nine-node quadrilaterals whose lines crowd where stresses are
singular or steep; the width is cut into layers. Every hexahedron is thus a prism, straight along the width, and the
stiffness matrix a sum of Kronecker products of plan matrices with matrices along the width.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, eigsh, splu
from scipy.spatial import cKDTree

Array = np.ndarray[Any, Any]
Selector = Callable[[Array, Array], Array]

#: Points of Gauss along each side of a quadrilateral: exact for parallelograms, and to spare for curved sides.
POINTS = 4


def graded_lines(start: float, end: float, at_start: float, at_end: float, growth: float, largest: float) -> Array:
    """Return lines from `start` to `end`, spaced `at_start` and `at_end` at the ends and wider from there.

    Parameters
    ----------
    start, end
        First and last line; `end` may not lie below `start`.
    at_start, at_end
        Spacing wanted at either end.
    growth
        Increase of the spacing per distance from an end.
    largest
        Largest spacing.
    """
    length = end - start
    near = np.geomspace(1e-6 * length, length, 4000)
    s = np.unique(np.concatenate(([0.0], near, length - near)).clip(0.0, length))
    spacing = np.minimum(np.minimum(at_start + growth * s, at_end + growth * (length - s)), largest)
    count = np.concatenate(([0.0], np.cumsum(np.diff(s) * (1 / spacing[1:] + 1 / spacing[:-1]) / 2)))
    n = max(1, int(np.ceil(count[-1] - 1e-9)))
    lines = start + np.interp(np.linspace(0.0, count[-1], n + 1), count, s)
    lines[[0, -1]] = start, end
    return np.asarray(lines)


def join_lines(*pieces: Array) -> Array:
    """Join lines that end where the next ones start."""
    return np.concatenate([pieces[0], *(piece[1:] for piece in pieces[1:])])


def with_middles(lines: Array) -> Array:
    """Insert the middle between each two lines."""
    both = np.empty(2 * lines.size - 1)
    both[::2], both[1::2] = lines, (lines[1:] + lines[:-1]) / 2
    return both


def triples(n: int) -> Array:
    """Return the node numbers of `n` quadratic elements in a row, shape (n, 3)."""
    return 2 * np.arange(n)[:, None] + np.arange(3)


@dataclass(frozen=True)
class Plan:
    """A plane mesh of nine-node quadrilaterals, their sides straight or curved.

    Parameters
    ----------
    nodes
        Shape (n, 2) [m].
    quads
        Node numbers, shape (m, 9): three along the second direction for each of three along the first.
    """

    nodes: Array
    quads: Array

    @classmethod
    def of(cls, patches: Iterable[Array]) -> Plan:
        """Build a mesh of patches, each a grid of nodes, middles included, shape (2 i + 1, 2 j + 1, 2) [m]."""
        nodes, quads, first = [], [], 0
        for grid in patches:
            rows, columns = grid.shape[:2]
            nodes.append(grid.reshape(-1, 2))
            number = first + np.arange(rows * columns).reshape(rows, columns)
            i, j = triples(rows // 2), triples(columns // 2)
            quads.append(number[i[:, None, :, None], j[None, :, None, :]].reshape(-1, 9))
            first += rows * columns
        points = np.concatenate(nodes)
        twins = cKDTree(points).query_pairs(1e-9 * np.ptp(points), output_type="ndarray")
        links = sp.coo_array((np.ones(len(twins)), twins.T), shape=(first, first))
        _, label = sp.csgraph.connected_components(links, directed=False)
        _, representative = np.unique(label, return_index=True)
        return cls(points[representative], label[np.concatenate(quads)])

    def gradients(self) -> tuple[Array, Array, Array]:
        """Return at the points of Gauss the shape functions, their gradients, and the area each point represents.

        Returns
        -------
        values, gradients, areas
            Shapes (g, 9), (m, g, 9, 2) [1/m] and (m, g) [m^2], negative where a quadrilateral is inside out.
        """
        values, derivatives, weights = _on_the_square()
        jacobian = np.einsum("mak,gal->mgkl", self.nodes[self.quads], derivatives)
        (a, b), (c, d) = jacobian[..., 0, :].transpose(2, 0, 1), jacobian[..., 1, :].transpose(2, 0, 1)
        determinant = a * d - b * c
        inverse = np.stack([np.stack([d, -b], axis=-1), np.stack([-c, a], axis=-1)], axis=-2)
        inverse /= determinant[..., None, None]
        return values, np.einsum("gal,mglk->mgak", derivatives, inverse), determinant * weights

    def area(self) -> float:
        """Return the area of the mesh [m^2]."""
        return float(np.abs(self.gradients()[2]).sum())

    def average(self, chosen: Selector) -> Array:
        """Return the weights of the mean of nodal values over the straight sides where `chosen(x, y)` holds."""
        sides = self.quads[:, [[0, 1, 2], [6, 7, 8], [0, 3, 6], [2, 5, 8]]].reshape(-1, 3)
        sides = sides[chosen(*self.nodes.T)[sides].all(axis=1)]
        length = np.linalg.norm(self.nodes[sides[:, 2]] - self.nodes[sides[:, 0]], axis=1)
        weights = np.zeros(len(self.nodes))
        np.add.at(weights, sides, length[:, None] * np.array([1.0, 4.0, 1.0]) / 6)
        return np.asarray(weights / weights.sum())


def sheared_patch(x: Array, y: Array, slope: float = 0.0) -> Array:
    """Return a patch of lines x, and lines y at the first x that rise by `slope`."""
    gx, gy = np.meshgrid(with_middles(x), with_middles(y), indexing="ij")
    return np.stack([gx, gy + slope * (gx - x[0])], axis=-1)


def ruled_patch(first: Array, last: Array, fractions: Array) -> Array:
    """Return a patch that leads straight from the nodes of one side, (n, 2), to those of the opposite one.

    `fractions` from 0 to 1 says where its lines between them lie, shape (k,), their middles left out.
    """
    along = with_middles(fractions)[:, None, None]
    return np.asarray((1 - along) * first + along * last)


# --- matrices -----------------------------------------------------------------------------------------------


def _on_the_line(count: int) -> tuple[Array, Array, Array]:
    """Values and derivatives (3, g) of the quadratic shape functions at points of Gauss on [0, 1], and weights."""
    p, w = np.polynomial.legendre.leggauss(count)
    s = (p + 1) / 2
    value = np.array([2 * (s - 0.5) * (s - 1), 4 * s * (1 - s), 2 * s * (s - 0.5)])
    return value, np.array([4 * s - 3, 4 - 8 * s, 4 * s - 1]), w / 2


def _on_the_square() -> tuple[Array, Array, Array]:
    """Values (g, 9), derivatives (g, 9, 2) and weights (g,) of the nine shape functions at points of Gauss."""
    value, slope, weight = _on_the_line(POINTS)
    along, across = np.kron(slope, value).T, np.kron(value, slope).T
    return np.kron(value, value).T, np.stack([along, across], axis=-1), np.kron(weight, weight)


def _along_a_line() -> tuple[Array, Array, Array]:
    """Integrals of NN, NN' and N'N' of the three quadratic shape functions over [0, 1]."""
    value, slope, w = _on_the_line(3)
    return value * w @ value.T, value * w @ slope.T, slope * w @ slope.T


class Body:
    """An elastic extrusion of a plan along z; unknowns are numbered by plan node, then component, then z.

    Parameters
    ----------
    plan
        The plane mesh.
    z
        Planes between the layers, increasing.
    youngs_modulus, poissons_ratio
        E and nu.
    fixed
        Whether each unknown is held at zero, shape (plan nodes, 3, z nodes).
    """

    def __init__(
        self,
        plan: Plan,
        z: Array,
        youngs_modulus: float,
        poissons_ratio: float,
        fixed: Callable[[Array, Array], Array],
    ) -> None:
        self.plan, self.z = plan, with_middles(z)
        self.shape = (len(plan.nodes), 3, self.z.size)
        held = np.broadcast_to(fixed(plan.nodes, self.z), self.shape)
        self.free = np.flatnonzero(~held.ravel())
        e, nu = self._moduli = youngs_modulus, poissons_ratio
        self._lame = e * nu / ((1 + nu) * (1 - 2 * nu)), e / (2 * (1 + nu))
        self._factor: _Factor | None = None

    def _plan_integrals(self) -> Array:
        """Integrals of d_k N_a d_n N_b per quad: d_0 = d/dx, d_1 = d/dy, d_2 = 1; shape (3, 3, m, 9, 9)."""
        values, derivatives, areas = self.plan.gradients()
        operators = np.concatenate(
            [derivatives, np.broadcast_to(values[..., None], (*derivatives.shape[:3], 1))], axis=3
        )
        return np.einsum("mg,mgak,mgbn->knmab", np.abs(areas), operators, operators, optimize=True)

    def _plan_matrix(self, element: Array) -> sp.csr_array:
        """Assemble element matrices of shape (m, 9, 3, 9, 3)."""
        dof = (3 * self.plan.quads[:, :, None] + np.arange(3)).reshape(-1, 27)
        rows, columns = np.repeat(dof, 27, axis=1).ravel(), np.tile(dof, (1, 27)).ravel()
        n = 3 * self.shape[0]
        matrix = sp.coo_array((element.reshape(-1), (rows, columns)), shape=(n, n)).tocsr()
        matrix.eliminate_zeros()
        return matrix

    def _line_matrices(self) -> tuple[sp.csr_array, sp.csr_array, sp.csr_array]:
        """Integrals of NN, NN' and N'N' along z."""
        h, nodes = np.diff(self.z[::2]), triples((self.z.size - 1) // 2)
        rows, columns = np.repeat(nodes, 3, axis=1).ravel(), np.tile(nodes, (1, 3)).ravel()
        m, c, s = (
            sp.coo_array((np.outer(scale, unit).ravel(), (rows, columns)), shape=(self.z.size,) * 2).tocsr()
            for scale, unit in zip((h, np.ones_like(h), 1 / h), _along_a_line(), strict=True)
        )
        return m, c, s

    def stiffness(self) -> sp.csr_array:
        """Return the upper triangle of the stiffness matrix of the free unknowns."""
        lame, mu = self._lame
        one = np.eye(3)
        elasticity = lame * np.einsum("ik,jl->ikjl", one, one)
        elasticity += mu * (np.einsum("ij,kl->ikjl", one, one) + np.einsum("il,jk->ikjl", one, one))
        integrals = self._plan_integrals()

        def term(k: slice, n: slice) -> sp.csr_array:
            d, g = elasticity[:, k, :, n], integrals[k, n]
            return self._plan_matrix(np.einsum("ikjl,klmab->maibj", d, g, optimize=True))

        plane, across = slice(0, 2), slice(2, 3)
        m, c, s = self._line_matrices()
        mixed = term(plane, across)
        terms = (
            (term(plane, plane), m), (mixed, c), (mixed.T.tocsr(), c.T.tocsr()), (term(across, across), s),
        )  # fmt: skip
        nz, rows = self.z.size, 3 * self.shape[0]
        slabs, step = [], max(1, 8_000_000 // (nz * 4 * 60))  # bounded memory: a slab of rows at a time
        for top in range(0, rows, step):
            bottom = min(top + step, rows)
            slab = sum(sp.kron(a[top:bottom], line, format="csr") for a, line in terms)
            above, below = np.searchsorted(self.free, (top * nz, bottom * nz))
            kept = slab[self.free[above:below] - top * nz][:, self.free]
            slabs.append(sp.triu(kept, k=above, format="csr"))
        matrix = sp.vstack(slabs, format="csr")
        matrix.sort_indices()
        return matrix

    def solve(self, loads: Array) -> Array:
        """Return the displacements under `loads`, both of shape (all unknowns, cases)."""
        if self._factor is None:
            self._factor = _Factor(self.stiffness())
        moved = np.zeros_like(loads)
        moved[self.free] = self._factor.solve(loads[self.free])
        return moved

    def section_forces(self, moved: Array, x: float, centre: tuple[float, float], reach: float) -> Array:
        """Return the forces on a section x = const, along x and y, and their moment about a point of the plan.

        They are the nodal forces of the elements right of the section on its nodes, so that they balance what acts on
        the body exactly.

        Parameters
        ----------
        moved
            Displacements, shape (all unknowns,).
        x
            Where the section is, a line between elements [m].
        centre, reach
            The point [m], and how far from it along y the section goes [m].
        """
        nodes, quads = self.plan.nodes, self.plan.quads
        near = 1e-9 * float(np.ptp(nodes))
        on = (abs(nodes[:, 0] - x) < near) & (abs(nodes[:, 1] - centre[1]) < reach + near)
        beside = (on[quads].sum(axis=1) == 3) & (nodes[quads].mean(axis=1)[:, 0] > x)
        used, numbers = np.unique(quads[beside], return_inverse=True)
        plan = Plan(nodes[used], numbers.reshape(-1, 9))
        piece = Body(plan, self.z[::2], *self._moduli, lambda at, z: np.zeros((len(at), 3, z.size), dtype=bool))
        upper = piece.stiffness()
        field = moved.reshape(self.shape)[used].ravel()
        force = (upper @ field + sp.triu(upper, k=1).T @ field).reshape(piece.shape).sum(axis=2)[on[used]]
        away = nodes[used][on[used]] - np.array(centre)
        moment = away[:, 0] @ force[:, 1] - away[:, 1] @ force[:, 0]
        return np.array([*force[:, :2].sum(axis=0), moment])

    def release(self) -> None:
        """Forget the factor of the stiffness matrix."""
        if self._factor is not None:
            self._factor.release()
            self._factor = None

    def average(self, chosen: Selector, component: int) -> Array:
        """Return the weights of a displacement component's mean over the faces where `chosen(x, y)` holds."""
        m = self._line_matrices()[0]
        along_z = m.sum(axis=0) / m.sum()
        weights = np.zeros(self.shape)
        weights[:, component, :] = self.plan.average(chosen)[:, None] * along_z
        return weights.ravel()

    def frequencies(self, density: float, count: int) -> tuple[float, ...]:
        """Return the lowest natural frequencies [Hz]."""
        integrals = self._plan_integrals()[2, 2]
        plan_mass = self._plan_matrix(density * np.einsum("mab,ij->maibj", integrals, np.eye(3)))
        line_mass = self._line_matrices()[0]
        n = self.free.size

        def spread(u: Array) -> Array:
            whole = np.zeros(int(np.prod(self.shape)))
            whole[self.free] = u.ravel()
            return whole

        def mass(u: Array) -> Array:
            heavy = plan_mass @ (spread(u).reshape(-1, self.z.size) @ line_mass)
            return np.asarray(heavy.ravel()[self.free])

        def inverse(f: Array) -> Array:
            return self.solve(spread(f)[:, None])[self.free, 0]

        M, compliance = (LinearOperator((n, n), matvec=f, dtype=float) for f in (mass, inverse))
        options = {
            "v0": np.random.default_rng(0).standard_normal(n), "ncv": 2 * count + 4, "tol": 1e-7,
            "return_eigenvectors": False,
        }  # fmt: skip
        # given the inverse, eigsh asks its first argument, the stiffness, only for its shape and type
        squares = eigsh(compliance, count, M=M, sigma=0.0, OPinv=compliance, **options)
        return tuple(float(f) for f in np.sort(np.sqrt(squares)) / (2 * np.pi))


class _Factor:
    """The factor of a positive definite matrix given by its upper triangle."""

    def __init__(self, upper: sp.csr_array) -> None:
        try:
            from pypardiso import PyPardisoSolver
        except ImportError:
            self._pardiso, whole = None, upper + sp.triu(upper, k=1).T
            self._superlu = splu(whole.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
            return
        self._pardiso, self._matrix = PyPardisoSolver(mtype=2), sp.csr_matrix(upper)
        self._pardiso._check_A(self._matrix)
        self._pardiso.set_phase(12)
        self._pardiso._call_pardiso(self._matrix, np.zeros((upper.shape[0], 1)))

    def solve(self, loads: Array) -> Array:
        """Return the displacements under one load per column."""
        if self._pardiso is None:
            return np.asarray(self._superlu.solve(loads))
        self._pardiso.set_phase(33)
        return np.asarray(self._pardiso._call_pardiso(self._matrix, np.asfortranarray(loads)))

    def release(self) -> None:
        """Give its memory back."""
        if self._pardiso is not None:
            self._pardiso.free_memory(everything=True)
