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

from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.solving.elasticity import Elasticity
from flexdesign.fem.solving.port_compliance import PortSpace, SymmetryClass
from flexdesign.fem.solving.solver import Factor, factorize, times

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


#: What the checks of a solve may leave; direct solvers leave 1e-8.
LARGEST_ERROR = 1e-6
#: In long thin leaves forces cancel, and rounding alone leaves more: so many times what one product per row would.
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
    """The factorized equations of one symmetry class."""

    cls: SymmetryClass
    free: IntArray
    factor: Factor
    stiffness: sp.csr_matrix

    def solve(self, forces: FloatArray) -> FloatArray:
        """Return displacements of all dofs under nodal forces (n_dofs, k); held dofs stay at rest."""
        displacements = np.zeros_like(forces)
        displacements[self.free] = self.factor.solve(forces[self.free])
        return displacements


def class_system(
    body: Elasticity,
    domain: Domain,
    cls: SymmetryClass,
    stiffness: sp.csr_matrix,
    ground: Sequence[int],
    factor: Factor | None = None,
) -> ClassSystem:
    """Hold the ground faces and what the class holds on its planes, and factorize the rest.

    The `factor` of a matrix with entries in the same places is made this one's, which saves the search for an order.
    """
    free = free_dofs(body, domain, cls, ground)
    reduced = stiffness[free][:, free].tocsr()
    if factor is not None and factor.renew(reduced):
        return ClassSystem(cls, free, factor, reduced)
    return ClassSystem(cls, free, factorize(reduced), reduced)


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
    loads = np.hstack([space.loads[name] for name in space.kept])
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
    loads = np.hstack([space.loads[name] for name in space.kept]) @ shares
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
    residual, applied = (internal - loads)[system.free], np.linalg.norm(loads[system.free], axis=0)
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
