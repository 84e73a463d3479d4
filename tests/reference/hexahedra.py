"""The sharp-rooted bridge amplifier by extruded, graded 27-node hexahedra: a reference for `flexdesign.fem`.

It shares nothing with the program's own finite elements but the dimensions. The plan, x against y, is cut by
hand into parallelograms, and these by lines that crowd towards the hinge roots, where the stress is singular;
the width is cut into layers that crowd towards the free face. Every hexahedron is thus an affine prism, and
the stiffness matrix an exact sum of Kronecker products of plan matrices with matrices along the width.

The part is symmetric in x = 0 and z = 0: a quarter is solved, and forces on the whole part are shared out.

Regenerate ``converged.toml`` (a few minutes, 8 GB)::

    python -m tests.reference.hexahedra
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, eigsh, splu
from scipy.spatial import cKDTree

Array = np.ndarray[Any, Any]
Selector = Callable[[Array, Array], Array]

COMMAND = "python -m tests.reference.hexahedra"
RECORD = Path(__file__).with_name("converged.toml")
TOLERANCE = 2e-3
DESIGNS = ("bridge_amplifier", "lin2019_amplifier_xy")
UNITS = {
    "K_in_output_free": "N/m",
    "lambda_output_free": "1",
    "K_out_input_free": "N/m",
    "K_out_input_held": "N/m",
    "C11": "m/N",
    "C12": "m/N",
    "C22": "m/N",
}


class Bridge(Protocol):
    """What the reference reads of the part `BridgeAmplifier`; lengths in metres."""

    arm_span: float
    arm_offset: float
    arm_thickness: float
    hinge_length: float
    hinge_thickness: float
    width: float
    rod_length: float
    rod_thickness: float
    input_block_height: float
    output_block_height: float
    ground_block_height: float
    fillet_radius: float
    outer_hinge: tuple[float, float]
    inner_hinge: tuple[float, float]
    rod_face: float
    input_block: tuple[float, float]

    def _outside(self, block_height: float) -> list[tuple[float, float]]: ...

    def _inside(self) -> list[tuple[float, float]]: ...


@dataclass(frozen=True)
class Reference:
    """Port compliances of a whole amplifier, both input blocks pushed and the ground face clamped.

    Parameters
    ----------
    C11
        Extension between the input faces per actuator force [m/N].
    C12
        Output displacement along y per actuator force [m/N]; equally, extension per output force.
    C22
        Output displacement per output force, inputs free [m/N].
    frequencies
        Lowest natural frequencies of the modes symmetric in x = 0 and z = 0, inputs free [Hz]; empty without
        a density.
    reciprocity
        Relative difference of C12 and C21, which measures the error of the equation solver.
    refinement, n_dof, seconds
        Level of the mesh, its unknowns and the time taken.
    """

    C11: float
    C12: float
    C22: float
    frequencies: tuple[float, ...]
    reciprocity: float
    refinement: int
    n_dof: int
    seconds: float

    @property
    def K_in_output_free(self) -> float:
        """Actuator force per extension, output free [N/m]."""
        return 1 / self.C11

    @property
    def lambda_output_free(self) -> float:
        """Output displacement per extension, signed along +y."""
        return self.C12 / self.C11

    @property
    def K_out_input_free(self) -> float:
        """Output force per displacement, inputs free [N/m]."""
        return 1 / self.C22

    @property
    def K_out_input_held(self) -> float:
        """Output force per displacement, the extension held at zero [N/m]."""
        return 1 / (self.C22 - self.C12**2 / self.C11)


# --- meshes -------------------------------------------------------------------------------------------------


def graded(start: float, end: float, at_start: float, at_end: float, growth: float, largest: float) -> Array:
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


def joined(*pieces: Array) -> Array:
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
    """A plane mesh of nine-node parallelograms.

    Parameters
    ----------
    nodes
        Shape (n, 2).
    quads
        Node numbers, shape (m, 9): three along y for each of three along x.
    """

    nodes: Array
    quads: Array

    @classmethod
    def of(cls, patches: Iterable[tuple[Array, Array, float]]) -> Plan:
        """Build a mesh of patches: the lines x of each, its lines y at the first x, and its slope dy/dx."""
        nodes, quads, first = [], [], 0
        for x, y, slope in patches:
            gx, gy = np.meshgrid(with_middles(x), with_middles(y), indexing="ij")
            nodes.append(np.column_stack([gx.ravel(), (gy + slope * (gx - x[0])).ravel()]))
            number = first + np.arange(gx.size).reshape(gx.shape)
            i, j = triples(x.size - 1), triples(y.size - 1)
            quads.append(number[i[:, None, :, None], j[None, :, None, :]].reshape(-1, 9))
            first += gx.size
        points = np.concatenate(nodes)
        twins = cKDTree(points).query_pairs(1e-9 * np.ptp(points), output_type="ndarray")
        links = sp.coo_array((np.ones(len(twins)), twins.T), shape=(first, first))
        _, label = sp.csgraph.connected_components(links, directed=False)
        _, representative = np.unique(label, return_index=True)
        return cls(points[representative], label[np.concatenate(quads)])

    def edges(self) -> tuple[Array, Array]:
        """Return the two edge vectors of each parallelogram."""
        corner = self.nodes[self.quads[:, 0]]
        return self.nodes[self.quads[:, 6]] - corner, self.nodes[self.quads[:, 2]] - corner

    def area(self) -> float:
        """Return the area of the mesh."""
        a, b = self.edges()
        return float(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())

    def average(self, chosen: Selector) -> Array:
        """Return the weights of the mean of nodal values over the boundary where `chosen(x, y)` holds."""
        sides = self.quads[:, [[0, 1, 2], [6, 7, 8], [0, 3, 6], [2, 5, 8]]].reshape(-1, 3)
        sides = sides[chosen(*self.nodes.T)[sides].all(axis=1)]
        length = np.linalg.norm(self.nodes[sides[:, 2]] - self.nodes[sides[:, 0]], axis=1)
        weights = np.zeros(len(self.nodes))
        np.add.at(weights, sides, length[:, None] * np.array([1.0, 4.0, 1.0]) / 6)
        return np.asarray(weights / weights.sum())


# --- matrices -----------------------------------------------------------------------------------------------


def _along_a_line() -> tuple[Array, Array, Array]:
    """Integrals of NN, NN' and N'N' of the three quadratic shape functions over [0, 1]."""
    p, w = np.polynomial.legendre.leggauss(3)
    s, w = (p + 1) / 2, w / 2
    value = np.array([2 * (s - 0.5) * (s - 1), 4 * s * (1 - s), 2 * s * (s - 0.5)])
    slope = np.array([4 * s - 3, 4 - 8 * s, 4 * s - 1])
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
        e, nu = youngs_modulus, poissons_ratio
        self._lame = e * nu / ((1 + nu) * (1 - 2 * nu)), e / (2 * (1 + nu))
        self._factor: _Factor | None = None

    def _plan_integrals(self) -> Array:
        """Integrals of d_k N_a d_n N_b per quad: d_0 = d/dx, d_1 = d/dy, d_2 = 1; shape (3, 3, m, 9, 9)."""
        m, c, s = _along_a_line()
        reference = np.empty((3, 3, 9, 9))  # derivatives along the first edge, along the second, none
        for k, n, along_first, along_second in (
            (0, 0, s, m), (1, 1, m, s), (2, 2, m, m), (0, 1, c.T, c), (2, 0, c, m), (2, 1, m, c),
        ):  # fmt: skip
            reference[k, n] = np.kron(along_first, along_second)
            reference[n, k] = reference[k, n].T
        a, b = self.plan.edges()
        determinant = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        turn = np.zeros((len(a), 3, 3))
        turn[:, 0, 0], turn[:, 0, 1] = b[:, 1] / determinant, -a[:, 1] / determinant
        turn[:, 1, 0], turn[:, 1, 1] = -b[:, 0] / determinant, a[:, 0] / determinant
        turn[:, 2, 2] = 1.0
        return np.einsum("m,mkp,mlq,pqab->klmab", np.abs(determinant), turn, turn, reference, optimize=True)

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


# --- the amplifier ------------------------------------------------------------------------------------------


def mesh(part: Bridge, refinement: int) -> tuple[Plan, Array]:
    """Return the plan of the right half of an amplifier and the planes that layer its half width z >= 0."""
    if part.fillet_radius != 0:
        raise ValueError("the reference is for sharp hinge roots: fillet_radius must be 0")
    if refinement < 1:
        raise ValueError("refinement starts at 1")
    (xi, yi), (xo, yo) = part.inner_hinge, part.outer_hinge
    half, t, a = part.hinge_length / 2, part.hinge_thickness / 2, part.arm_thickness / 2
    height, (block_in, block_out) = part.input_block_height / 2, part.input_block
    growth = 3 / (refinement + 1.5)
    finer = growth / 1.2
    root = 2 * t / 15 * finer**3.7  # a root's error goes with its size^1.09, all else with about growth^4
    foot, leaf_size, bulk = 4 * root, half * finer, 2 * a * finer

    def cut(start: float, end: float, at_start: float, at_end: float, largest: float = bulk) -> Array:
        return graded(start, end, at_start, at_end, growth, largest)

    leaf = cut(-t, t, root, root)
    x_leaf = cut(-half, half, root, root, leaf_size)
    x_arm = cut(xi + half, xo - half, root, root)
    y_arm = joined(cut(-a, -t, bulk, root), leaf, cut(t, a, root, bulk))
    arm_slope = -part.arm_offset / (x_arm[-1] - x_arm[0])
    x_block = cut(0.0, xi - half, bulk, root)
    rods = part.rod_length > 0
    x_rod = cut(part.rod_face, part.rod_face + part.rod_thickness, root, foot if rods else bulk)

    patches: list[tuple[Array, Array, float]] = []
    for side, block_height in ((1, part.output_block_height), (-1, part.ground_block_height)):

        def add(x: Array, centre: float, offsets: Array, slope: float = 0.0, side: int = side) -> None:
            patches.append((x, side * (centre + offsets), side * slope))

        y_block = joined(leaf, cut(t, block_height - a, root, bulk))
        base = part._inside()[0][1] - yi  # the block's face towards the actuator
        if base < -1.0001 * t:
            y_block = joined(cut(base, -t, bulk, root), y_block)
        add(x_block, yi, y_block)
        add(xi + x_leaf, yi, leaf)
        add(x_arm, yi, y_arm, arm_slope)
        add(xo + x_leaf, yo, leaf)
        if rods:
            add(x_rod, yo, joined(cut(height - yo, -t, foot, root), leaf, cut(t, a, root, bulk)))
    if rods:
        x = joined(cut(block_in, x_rod[0], bulk, root), x_rod, cut(x_rod[-1], block_out, foot, bulk))
        patches.append((x, cut(-height, height, foot, foot), 0.0))
    else:
        x = cut(part.rod_face, block_out, root, bulk)
        upper = yo + joined(leaf, cut(t, a, root, bulk))
        patches.append((x, joined(-upper[::-1], cut(-(yo - t), yo - t, root, root), upper), 0.0))
    plan = Plan.of(patches)
    _check_area(part, plan)
    layers = graded(0.0, part.width / 2, part.width, t * finer, 1.25 * growth, part.width / 3)
    return plan, layers


def _check_area(part: Bridge, plan: Plan) -> None:
    """Raise if the mesh does not fill the contour of the part, which then has changed its shape."""
    upper, lower = (part._outside(block) for block in (part.output_block_height, part.ground_block_height))
    area = 0.0
    for sign, above, below in ((1, upper, lower), (-1, part._inside(), part._inside())):
        corners = above + [(x, -y) for x, y in reversed(below)]
        x, y = np.array([(0.0, corners[0][1]), *corners, (0.0, corners[-1][1])]).T
        area += sign * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2
    if abs(plan.area() / area - 1) > 1e-9:
        raise ValueError(f"the part covers {area:.9g} m^2 and the mesh {plan.area():.9g} m^2: has its contour changed?")


def solve(
    part: Bridge,
    youngs_modulus: float,
    poissons_ratio: float,
    *,
    refinement: int,
    density: float | None = None,
    modes: int = 3,
) -> Reference:
    """Solve an amplifier on one mesh.

    Parameters
    ----------
    part
        The amplifier; its hinge roots must be sharp.
    youngs_modulus, poissons_ratio
        E [Pa] and nu.
    refinement
        Level of the mesh, from 1.
    density
        With a density [kg/m^3] the lowest natural frequencies are found too.
    modes
        How many of them.

    Raises
    ------
    ValueError
        If the roots are rounded, or the part is not of the shape meshed here.
    """
    began = time.perf_counter()
    plan, layers = mesh(part, refinement)
    size = float(np.ptp(plan.nodes))
    near = 1e-9 * size
    bottom, top = plan.nodes[:, 1].min(), plan.nodes[:, 1].max()

    def fixed(nodes: Array, z: Array) -> Array:
        held = np.zeros((len(nodes), 3, z.size), dtype=bool)
        held[nodes[:, 0] < near, 0] = True
        held[:, 2, 0] = True
        held[nodes[:, 1] < bottom + near] = True
        return held

    body = Body(plan, layers, youngs_modulus, poissons_ratio, fixed)
    x_face, y_face = part.input_block[0], part.input_block_height / 2
    if part.rod_length == 0:  # the face ends at the hinges
        y_face = part.outer_hinge[1] - part.hinge_thickness / 2
    pushed = body.average(lambda x, y: (abs(x - x_face) < near) & (abs(y) < y_face + near), 0)
    output = body.average(lambda x, y: y > top - near, 1)
    # unit forces on the whole part: the quarter has half an input face and a quarter of the output face
    moved = body.solve(np.column_stack([pushed / 2, output / 4]))
    C11, C21 = 2 * pushed @ moved
    C12, C22 = output @ moved
    frequencies = body.frequencies(density, modes) if density is not None else ()
    body.release()
    return Reference(
        C11=float(C11),
        C12=float(C12),
        C22=float(C22),
        frequencies=frequencies,
        reciprocity=float(abs(C21 / C12 - 1)),
        refinement=refinement,
        n_dof=body.free.size,
        seconds=time.perf_counter() - began,
    )


def _last_two(
    part: Bridge,
    youngs_modulus: float,
    poissons_ratio: float,
    tolerance: float,
    density: float | None = None,
    finest: int = 4,
) -> tuple[Reference, Reference]:
    """Refine until K_in settles; return the results on the finest mesh and on the one before."""
    before = solve(part, youngs_modulus, poissons_ratio, refinement=1, density=density)
    for refinement in range(2, finest + 1):
        after = solve(part, youngs_modulus, poissons_ratio, refinement=refinement, density=density)
        change = abs(after.K_in_output_free / before.K_in_output_free - 1)
        if change < tolerance:
            return after, before
        before = after
    raise RuntimeError(f"K_in still moves by {change:.2g} at refinement {finest}; allow a larger tolerance")


def converged(
    part: Bridge,
    youngs_modulus: float,
    poissons_ratio: float,
    tolerance: float = TOLERANCE,
    *,
    density: float | None = None,
    finest: int = 4,
) -> tuple[Reference, float]:
    """Refine until K_in moves by less than `tolerance` from one mesh to the next.

    Parameters
    ----------
    part, youngs_modulus, poissons_ratio, density
        As in `solve`.
    tolerance
        Relative change of K_in that ends the refinement.
    finest
        Last level tried; level 4 wants about 16 GB.

    Returns
    -------
    The result on the finest mesh, and the last relative change of K_in.

    Raises
    ------
    RuntimeError
        If K_in has not settled at level `finest`.
    """
    after, before = _last_two(part, youngs_modulus, poissons_ratio, tolerance, density, finest)
    return after, abs(after.K_in_output_free / before.K_in_output_free - 1)


# --- the record ---------------------------------------------------------------------------------------------


HEAD = f"""\
# The sharp-rooted bridge amplifiers: ground face clamped, the actuator pushing both input blocks apart.
# Written by the command below; do not edit. last_change is the relative change from the mesh before; it falls
# about fourfold from mesh to mesh. C11: extension per actuator force; C12: output per actuator force; C22:
# output per output force. Frequencies: modes symmetric in x = 0 and z = 0, inputs and output free.
command = "{COMMAND}"
method = "27-node hexahedra graded to the hinge roots, refined until K_in moves by less than {TOLERANCE:.1%}"

"""


def record(name: str, after: Reference, before: Reference) -> str:
    """Return the TOML tables of one design: each number, its unit, and its change from the mesh before."""
    lines = [f"[{name}]", f"refinement = {after.refinement}"]
    lines += [f"n_dof = {after.n_dof}", f"n_dof_before = {before.n_dof}"]
    numbers = [(key, getattr(after, key), getattr(before, key), unit) for key, unit in UNITS.items()]
    pairs = zip(after.frequencies, before.frequencies, strict=True)
    numbers += [(f"frequency_{i}", new, old, "Hz") for i, (new, old) in enumerate(pairs, 1)]
    for key, new, old, unit in numbers:
        lines.append(f'{key} = {{ value = {new:.7g}, unit = "{unit}", last_change = {new / old - 1:.2e} }}')
    return "\n".join(lines) + "\n"


def main() -> None:
    """Solve both designs until converged, and write the record."""
    from flexdesign import design

    tables = []
    for name in DESIGNS:
        read = design.read(design.find(name))
        metal = read.material
        part: Any = read.part()
        after, before = _last_two(part, metal.youngs_modulus, metal.poissons_ratio, TOLERANCE, metal.density)
        tables.append(record(name, after, before))
        print(f"{tables[-1]}solved in {before.seconds:.0f} s and {after.seconds:.0f} s\n", flush=True)
    RECORD.write_text(HEAD + "\n".join(tables), encoding="utf-8")


if __name__ == "__main__":
    main()
