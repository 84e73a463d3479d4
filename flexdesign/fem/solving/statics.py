"""Static response: all unit loads on one factorization, and the compliance between the ports.

Every stiffness and amplification of a part follows from its compliance between ports, boundary by boundary
(`PortCompliance`); the solves check themselves (`Checks`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from flexdesign.design.part import Port
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.solving.elasticity import Elasticity
from flexdesign.fem.solving.port_compliance import PortSpace, SymmetryClass
from flexdesign.fem.solving.port_shapes import rigid_motions
from flexdesign.fem.solving.solver import Factor, factorize, times

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


#: What the checks of a solve may leave; direct solvers leave 1e-8.
LARGEST_ERROR = 1e-6
#: In long thin leaves forces cancel, and rounding alone leaves more: this multiple of one product per row.
ROUNDINGS = 10.0


@dataclass(frozen=True)
class PortCompliance:
    """Motions of the moving ports under unit loads on them, the ground held.

    Parameters
    ----------
    matrix
        Six rows and columns for each port, SI.
    extension, output
        What the actuator feels and what moves the table, as vectors over the rows.
    """

    matrix: FloatArray
    extension: FloatArray
    output: FloatArray

    @property
    def output_rows(self) -> slice:
        """The six rows of the output port."""
        first = 6 * (int(np.flatnonzero(self.output)[0]) // 6)
        return slice(first, first + 6)

    @property
    def has_input(self) -> bool:
        """Whether there are inputs, which an actuator can part."""
        return bool(np.any(self.extension))

    @property
    def c11(self) -> float:
        """Actuator extension per actuator force, output free [m/N]."""
        return float(self.extension @ self.matrix @ self.extension)

    @property
    def c12(self) -> float:
        """Output motion per actuator force, which by reciprocity is extension per output force [m/N]."""
        return float(self.output @ self.matrix @ self.extension)

    @property
    def c22(self) -> float:
        """Output motion per output force, input free [m/N]."""
        return float(self.output @ self.matrix @ self.output)

    @property
    def input_stiffness(self) -> float:
        """Actuator force per extension, output free [N/m]."""
        return 1 / self.c11

    @property
    def amplification(self) -> float:
        """Output motion per extension, output free, signed along the output's outward normal."""
        return self.c12 / self.c11

    def output_stiffness(self, actuator: float) -> float:
        """Return output force per output motion with a spring of stiffness `actuator` [N/m] between the inputs.

        0 leaves the input free, infinity holds it.
        """
        if actuator == 0:
            return 1 / self.c22
        return 1 / (self.c22 - self.c12**2 / (self.c11 + 1 / actuator))

    def loaded(self, load: float) -> tuple[float, float]:
        """Return input stiffness [N/m] and amplification with the output pushing against a stiffness `load` [N/m]."""
        yielding = 1 + load * self.c22
        extension = self.c11 - load * self.c12**2 / yielding
        return 1 / extension, self.c12 / yielding / extension

    def stroke(self, free_stroke: float, actuator: float) -> float:
        """Return the output motion [m] when an actuator of this free stroke [m] and stiffness [N/m] is energised."""
        return self.c12 * self.actuator_force(free_stroke, actuator)

    def actuator_force(self, free_stroke: float, actuator: float) -> float:
        """Return the force [N] the energised actuator exerts, output free: F = s / (C11 + 1/k)."""
        return free_stroke / (self.c11 + 1 / actuator) if actuator else 0.0

    def blocked_force(self, free_stroke: float, actuator: float) -> float:
        """Return the force [N] with which the energised stage pushes a stop that holds its output at rest.

        Along the output's outward normal; the stop pushes back with the opposite of it.
        """
        return self.stroke(free_stroke, actuator) * self.output_stiffness(actuator)


@dataclass(frozen=True)
class Checks:
    """How well a set of solves keeps what must hold exactly; relative errors.

    Parameters
    ----------
    reciprocity
        Largest asymmetry of the compliance.
    balance
        Applied force plus the reactions at ground and symmetry planes.
    energy
        Work of the loads against the strain energy integrated from the stresses.
    residual
        Of the linear system.
    rounding
        What rounding of the products of diagonal and displacements makes of the residual.
    """

    reciprocity: float
    balance: float
    energy: float
    residual: float
    rounding: float = 0.0

    def require(self) -> None:
        """Stop if a solve does not keep what must hold.

        Raises
        ------
        ArithmeticError
            If an error is larger than rounding explains; the answers must not be used.
        """
        allowed = max(LARGEST_ERROR, ROUNDINGS * self.rounding)
        for name in ("reciprocity", "balance", "energy", "residual"):
            error = getattr(self, name)
            if not error <= allowed:  # false for NaN
                raise ArithmeticError(f"the solution fails its {name} check: relative error {error:.1e}")

    def worst(self, other: Checks) -> Checks:
        """Return the larger of each."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return Checks(*(float(np.maximum(a, b)) for a, b in pairs))  # NaN wins


@dataclass(frozen=True)
class ClassSystem:
    """The factorized equations of one symmetry class.

    Parameters
    ----------
    cls
        The class.
    free
        Degrees of freedom that move by themselves.
    factor, stiffness
        Of the unknowns: the free degrees of freedom, then six motions of each rigid port.
    size
        Number of all degrees of freedom.
    tied
        Displacements of all degrees of freedom by the unknowns, shape (n_dofs, unknowns); None without rigid ports.
    """

    cls: SymmetryClass
    free: IntArray
    factor: Factor
    stiffness: sp.csr_matrix
    size: int
    tied: sp.csr_matrix | None = None

    def solve(self, forces: FloatArray) -> FloatArray:
        """Return displacements of all dofs under nodal forces (n_dofs, k); held dofs stay at rest."""
        return self.spread(self.factor.solve(self.gather(forces)))

    def gather(self, forces: FloatArray) -> FloatArray:
        """Return what nodal forces (n_dofs, ...) do to the unknowns."""
        return forces[self.free] if self.tied is None else np.asarray(self.tied.T @ forces)

    def spread(self, unknowns: FloatArray) -> FloatArray:
        """Return displacements of all dofs, shape (n_dofs, ...)."""
        if self.tied is not None:
            return np.asarray(self.tied @ unknowns)
        displacements = np.zeros((self.size, *unknowns.shape[1:]))
        displacements[self.free] = unknowns
        return displacements

    def as_forces(self, reach: float) -> FloatArray:
        """Return the factors that make what acts on the unknowns forces, shape (unknowns, 1).

        Moments on rigid ports are divided by the `reach` of the body [m]: norms over all unknowns then do not depend on
        its size.
        """
        factors = np.ones((self.stiffness.shape[0], 1))
        if self.tied is not None:
            factors[len(self.free) :].reshape(-1, 6)[:, 3:] /= reach
        return factors

    def condense(self, matrix: sp.csr_matrix) -> sp.csr_matrix:
        """Return a matrix of all dofs, upper triangle, as the unknowns see it."""
        return _condense(matrix, self.free, self.tied)


def class_system(
    body: Elasticity,
    domain: Domain,
    cls: SymmetryClass,
    stiffness: sp.csr_matrix,
    ground: Sequence[int],
    factor: Factor | None = None,
    rigid: Sequence[Port] = (),
) -> ClassSystem:
    """Hold the ground faces and what the class holds on its planes, and factorize the rest.

    The faces of `rigid` ports move as one body each. The `factor` of a matrix with entries in the same places is made
    this one's, which saves the search for an order.
    """
    free = free_dofs(body, domain, cls, ground)
    tied = None
    if rigid:
        free, tied = _tie(body, domain, free, rigid)
    reduced = _condense(stiffness, free, tied)
    if factor is None or not factor.renew(reduced):
        factor = factorize(reduced, _order(body, free, reduced.shape[0]))
    return ClassSystem(cls, free, factor, reduced, body.n_dofs, tied)


def _order(body: Elasticity, free: IntArray, count: int) -> IntArray | None:
    """Return the unknowns in the order of their nodes' elimination, motions of rigid ports last, shape (count,)."""
    nodes = body.elimination_order
    if nodes is None:
        return None
    number = np.full(body.n_dofs, -1)
    number[free] = np.arange(len(free))
    ordered = number[(3 * nodes[:, None] + np.arange(3)).ravel()]
    return np.concatenate([ordered[ordered >= 0], np.arange(len(free), count)])


def _tie(body: Elasticity, domain: Domain, free: IntArray, rigid: Sequence[Port]) -> tuple[IntArray, sp.csr_matrix]:
    """Return what stays free, and the displacements of all dofs by it and by six motions of each rigid port.

    Raises
    ------
    ValueError
        If the domain is cut by symmetry planes: a rigid face of the whole moves by less than six motions there.
    """
    if domain.planes:
        raise ValueError("rigid ports are not cut by symmetry planes; mesh the whole part")
    on_faces = [dofs_on(body, [domain.ports[port.name]], range(3)) for port in rigid]
    free = np.setdiff1d(free, np.concatenate(on_faces))
    ones = sp.csr_matrix((np.ones(len(free)), (free, np.arange(len(free)))), shape=(body.n_dofs, len(free)))
    motions = []
    for port, dofs in zip(rigid, on_faces, strict=True):
        values = rigid_motions(body.positions[dofs[::3] // 3], np.array(port.point)).reshape(-1, 6)
        rows, columns = np.repeat(dofs, 6), np.tile(np.arange(6), len(dofs))
        motions.append(sp.csr_matrix((values.ravel(), (rows, columns)), shape=(body.n_dofs, 6)))
    return free, sp.hstack([ones, *motions]).tocsr()


def _condense(matrix: sp.csr_matrix, free: IntArray, tied: sp.csr_matrix | None) -> sp.csr_matrix:
    if tied is None:
        return matrix[free][:, free].tocsr()
    whole = matrix + sp.triu(matrix, k=1).T
    return sp.triu(tied.T @ whole @ tied).tocsr()


def free_dofs(body: Elasticity, domain: Domain, cls: SymmetryClass, ground: Sequence[int]) -> IntArray:
    """Return the degrees of freedom that neither the ground faces nor a class hold on its planes."""
    held = [dofs_on(body, ground, range(3))]
    for index in range(len(domain.planes)):
        held.append(dofs_on(body, domain.plane_faces[index], cls.held_components(index)))
    return np.setdiff1d(np.arange(body.n_dofs), np.concatenate(held))


def class_compliance(
    body: Elasticity, system: ClassSystem, stiffness: sp.csr_matrix, space: PortSpace
) -> tuple[FloatArray, Checks, FloatArray, FloatArray]:
    """Solve one class for the port loads that fit it.

    Returns
    -------
    compliance
        Its share of the compliance of the whole part, shape (size, size).
    checks
        Reciprocity, balance, energy, residual of these solves.
    displacements
        Nodal displacements for unit load on each kept port motion that fits, shape (n_dofs, 6 * kept); zero otherwise.
    projection
        The class's P of `PortSpace.projection`.
    """
    projection = space.projection(system.cls)
    fitting = np.any(projection != 0, axis=1)
    loads = np.hstack([space.loads[name] for name in space.retained])
    displacements = np.zeros_like(loads)
    if not fitting.any():
        return np.zeros((space.size, space.size)), Checks(0, 0, 0, 0), displacements, projection
    displacements[:, fitting] = system.solve(loads[:, fitting])
    gram = loads.T @ displacements
    gram = np.where(np.outer(fitting, fitting), gram, 0.0) * 2 ** len(space.planes)
    whole = projection.T @ (space.halves[:, None] * gram * space.halves[None, :]) @ projection
    used = np.flatnonzero(fitting)
    checks = _checks(body, system, stiffness, loads[:, used], displacements[:, used])
    return whole, checks, displacements, projection


def drive_compliance(
    body: Elasticity, system: ClassSystem, stiffness: sp.csr_matrix, space: PortSpace
) -> tuple[PortCompliance, Checks]:
    """Solve the symmetric class for actuator and output force alone, which is all that input and output ask for.

    With e and o the extension's and the output's vectors over the whole part's ports, the domain carries the loads
    f = L H P e; the whole part's compliance is that of the domain times the number of its images.

    Returns
    -------
    compliance
        Over two rows: extension and output.
    checks
        Of these solves.
    """
    shares = space.halves[:, None] * (space.projection(system.cls) @ np.column_stack([space.extension, space.output]))
    loads = np.hstack([space.loads[name] for name in space.retained]) @ shares
    displacements = system.solve(loads)
    matrix = loads.T @ displacements * 2 ** len(space.planes)
    checks = _checks(body, system, stiffness, loads, displacements)
    return PortCompliance(matrix, np.array([1.0, 0.0]), np.array([0.0, 1.0])), checks


def _checks(
    body: Elasticity, system: ClassSystem, stiffness: sp.csr_matrix, loads: FloatArray, displacements: FloatArray
) -> Checks:
    gram = loads.T @ displacements
    scale = np.sqrt(np.outer(np.diag(gram), np.diag(gram)))
    internal = times(stiffness, displacements)
    reactions = internal - loads
    reactions[system.free] = 0.0
    total = (loads + reactions).reshape(-1, 3, loads.shape[1])
    moments = np.cross(body.positions[:, :, None], total, axis=1).sum(axis=0)
    size = np.abs(reactions).sum(axis=0)
    reach = np.ptp(body.positions, axis=0).max()
    balance = max(np.abs(total.sum(axis=0) / size).max(), np.abs(moments / (size * reach)).max())
    work = np.diag(gram)
    energy = [2 * body.strain_energy(u.reshape(-1, 3)) for u in displacements.T]
    as_forces = system.as_forces(float(reach))
    applied = np.linalg.norm(as_forces * system.gather(loads), axis=0)
    residual = as_forces * (system.gather(internal) - system.gather(loads))
    products = (stiffness.diagonal()[:, None] * displacements)[system.free]
    return Checks(
        reciprocity=float(np.abs((gram - gram.T) / scale).max()),
        balance=float(balance),
        energy=float(np.abs(np.array(energy) / work - 1).max()),
        residual=float((np.linalg.norm(residual, axis=0) / applied).max()),
        rounding=float(np.finfo(float).eps * (np.linalg.norm(products, axis=0) / applied).max()),
    )


def dofs_on(body: Elasticity, faces: Sequence[int], components: Sequence[int]) -> IntArray:
    """Return the degrees of freedom of some components of the nodes on CAD faces, node by node."""
    nodes = np.unique(body.surface_nodes(body.mesh.on_face(*faces)))
    return (3 * nodes[:, None] + np.array(list(components))).ravel()
