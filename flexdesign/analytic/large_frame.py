"""Large displacements of a mechanism of rigid bodies and members, in the plane: the elastica of its leaves.

A hinge is cut into pieces, each a beam with the compliance C of its length; every other member is one piece. Between
its ends a, b a piece parts by d, and by psi, seen in the frame that turns with the mean of both ends' rotations::

    d = R(phi)^T (p_b - p_a) - (l, 0),    psi = theta_b - theta_a,    phi = phi_0 + (theta_a + theta_b) / 2

With f its forces, B the derivatives of (d, psi) and F the loads, equilibrium is (d, psi) = C f and sum B^T f = F: exact
for rotations of any size in the limit of many pieces (J. C. Simo, Comput. Methods Appl. Mech. Eng. 49 (1985), 55-70,
with one point of integration), and C may be singular: leaves that do not stretch are one without axial compliance.
Newton's method solves it, the load being put on in steps.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.analytic.compliance import ComplianceModel
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.model import Elastic, Member
from flexdesign.effects.hinge_compliance import beam

IntArray = NDArray[np.int64]
#: Pieces of a hinge: with this number, the elastica of a parallelogram is met to 0.03 % at half its length.
PIECES = 12
#: Newton's method ends at this residual, relative to what acts; it gives up after these numbers of iterations or
#: halvings.
PRECISION, ITERATIONS, HALVINGS = 1e-9, 25, 6
#: Steps in which a load is put on without a state to begin from.
STEPS = 4
J = np.array([[0.0, -1.0], [1.0, 0.0]])


@dataclass(frozen=True, eq=False)
class State:
    """Motions of the nodes (n, 3) [m, rad] and forces of the pieces (m, 3) [N, N m] in equilibrium."""

    motions: Array
    forces: Array


class LargeFrame:
    """A mechanism cut into pieces.

    Parameters
    ----------
    model
        Of linkage, ports and effects.
    pieces
        Of each hinge.
    """

    def __init__(self, model: ComplianceModel, pieces: int = PIECES) -> None:
        linkage = model.linkage
        held = [linkage.ports[port.name] for port in model.ports if port.role == "ground"]
        places: dict[str, tuple[float, float]] = {n: (p[0], p[1]) for n, p in linkage.nodes.items()}
        rows: list[tuple[str, Array, str, Array, float, Array]] = []
        for member in model.members:
            rows += _cut(model, member, pieces, places)
        self.free = [node for node in places if node not in held]
        index = {node: i for i, node in enumerate(self.free)}
        self._ends = np.array([[index.get(a, -1), index.get(b, -1)] for a, _, b, _, _, _ in rows])
        self._at = np.array([[places[a], places[b]] for a, _, b, _, _, _ in rows])
        self._arms = np.array([[at_a, at_b] for _, at_a, _, at_b, _, _ in rows]) - self._at
        self._angle = np.array([angle for *_, angle, _ in rows])
        self._compliance = np.array([c for *_, c in rows])
        parted = (self._at + self._arms)[:, 1] - (self._at + self._arms)[:, 0]
        self._rest = np.einsum("mji,mj->mi", _rotations(self._angle), parted)
        output = next(port for port in model.ports if port.role == "output")
        self._output = index[linkage.ports[output.name]]
        lever = np.array(output.point[:2]) - np.array(places[linkage.ports[output.name]])
        self._lever = lever

    def solve(self, load: Sequence[float], begin: State | None = None) -> State:
        """Return the state under a load that keeps its direction, at the point of the output port.

        Parameters
        ----------
        load
            Force along x and y [N] and moment about z [N m].
        begin
            A state near it, from which the search begins.

        Raises
        ------
        InputError
            If there is no equilibrium near the states on the way.
        """
        whole = np.array(load, dtype=float)
        if begin is not None and (found := self._newton(begin, whole)) is not None:
            return found
        state = State(np.zeros((len(self.free), 3)), np.zeros((len(self._ends), 3)))
        reached, step = 0.0, 1.0 / STEPS
        while reached < 1:
            share = min(reached + step, 1.0)
            if (found := self._newton(state, share * whole)) is not None:
                state, reached = found, share
            elif (step := step / 2) < 1 / STEPS / 2**HALVINGS:
                remedy = "no equilibrium was found: the load is beyond what the mechanism carries; take a smaller one"
                raise InputError("design", "F_x, F_y, M_z", ", ".join(f"{x:.4g}" for x in whole), remedy)
        return state

    def fits(self, state: State) -> bool:
        """Return whether a state has the numbers of pieces and nodes of this mechanism."""
        return (len(state.motions), len(state.forces)) == (len(self.free), len(self._ends))

    def output(self, state: State) -> Array:
        """Return how far the output port's point moved along x and y [m], and its rotation [rad]."""
        x, y, angle = state.motions[self._output]
        return np.array([*(np.array([x, y]) + _rotation(angle) @ self._lever - self._lever), angle])

    def _newton(self, begin: State, load: Array) -> State | None:
        motions, forces = begin.motions.copy(), begin.forces.copy()
        m = forces.size
        scale = max(float(np.abs(load).max()), 1e-9)
        length = float(np.abs(self._rest).max())
        for _ in range(ITERATIONS):
            residual, system = self._system(motions, forces, load)
            size = max(
                float(np.abs(residual[:m]).max()) / length, float(np.abs(residual[m:]).max()) / scale
            )  # motions per length, forces per load
            if size < PRECISION:
                return State(motions, forces)
            weight = np.sqrt(np.abs(system).max(axis=1))
            weight = 1 / np.where(weight > 0, weight, 1.0)
            try:
                step = weight * np.linalg.solve(weight[:, None] * system * weight, -weight * residual)
            except np.linalg.LinAlgError:
                return None
            if not np.isfinite(step).all():
                return None
            forces = forces + step[:m].reshape(-1, 3)
            motions = motions + step[m:].reshape(-1, 3)
            if np.abs(motions[:, 2]).max(initial=0.0) > 2 * math.pi:
                return None
        return None

    def _system(self, motions: Array, forces: Array, load: Array) -> tuple[Array, Array]:
        """Return the residual (3 m + 3 n,) and the symmetric matrix of its derivatives."""
        count, free = len(self._ends), len(self.free)
        padded = np.vstack([motions, np.zeros(3)])[self._ends]  # (m, 2, 3); -1 is what is held
        theta = padded[..., 2]
        frame = np.swapaxes(_rotations(self._angle + theta.mean(axis=1)), 1, 2)  # R^T
        arms = np.einsum("mkij,mkj->mki", _rotations(theta), self._arms)
        ends = self._at + padded[..., :2] + arms
        parted = np.einsum("mij,mj->mi", frame, ends[:, 1] - ends[:, 0])  # R^T (p_b - p_a)
        gradients = np.einsum("mij,mkj->mki", frame, arms @ J.T)  # R^T J arm
        local = np.einsum("mij,mkj->mki", frame, arms)
        b = np.zeros((count, 3, 6))
        b[:, :2, 0:2], b[:, :2, 3:5] = -frame, frame
        turned = parted @ J.T
        b[:, :2, 2], b[:, :2, 5] = -gradients[:, 0] - turned / 2, gradients[:, 1] - turned / 2
        b[:, 2, 2], b[:, 2, 5] = -1.0, 1.0
        first = np.concatenate([parted - self._rest, (theta[:, 1] - theta[:, 0])[:, None]], axis=1)
        first -= np.einsum("mij,mj->mi", self._compliance, forces)
        pull = forces[:, :2]
        g = np.zeros((count, 6, 6))
        mixed = -0.5 * np.einsum("mi,ij,mjk->mk", pull, J, frame)
        for angle in (2, 5):
            g[:, angle, 0:2] = g[:, 0:2, angle] = -mixed
            g[:, angle, 3:5] = g[:, 3:5, angle] = mixed
        js = gradients @ J.T
        g[:, 2, 2] = np.einsum("mi,mi->m", pull, local[:, 0] + js[:, 0] - parted / 4)
        g[:, 5, 5] = np.einsum("mi,mi->m", pull, -local[:, 1] - js[:, 1] - parted / 4)
        g[:, 2, 5] = g[:, 5, 2] = np.einsum("mi,mi->m", pull, (js[:, 0] - js[:, 1]) / 2 - parted / 4)
        m3, size = 3 * count, 3 * (count + free)
        system, residual = np.zeros((size + 3, size + 3)), np.zeros(size + 3)  # what is held comes last
        dofs = m3 + 3 * np.where(self._ends < 0, free, self._ends)[..., None] + np.arange(3)
        dofs = dofs.reshape(count, 6)
        rows = np.arange(m3).reshape(count, 3)
        np.add.at(system, (rows[:, :, None], rows[:, None, :]), -self._compliance)
        np.add.at(system, (rows[:, :, None], dofs[:, None, :]), b)
        np.add.at(system, (dofs[:, :, None], rows[:, None, :]), np.swapaxes(b, 1, 2))
        np.add.at(system, (dofs[:, :, None], dofs[:, None, :]), g)
        residual[:m3] = first.ravel()
        np.add.at(residual, dofs, np.einsum("mij,mi->mj", b, forces))
        self._subtract_load(motions, load, m3, residual, system)
        return residual[:size], system[:size, :size]

    def _subtract_load(self, motions: Array, load: Array, m3: int, residual: Array, system: Array) -> None:
        """Subtract the load at the output's point, which moves on its lever as the body turns."""
        at = m3 + 3 * self._output
        lever = _rotation(motions[self._output, 2]) @ self._lever
        residual[at : at + 2] -= load[:2]
        residual[at + 2] -= load[2] + lever[0] * load[1] - lever[1] * load[0]
        system[at + 2, at + 2] += lever @ load[:2]


def _rotation(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def _rotations(angles: Array) -> Array:
    """Return rotation matrices (..., 2, 2)."""
    c, s = np.cos(angles), np.sin(angles)
    return np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)


def _cut(
    model: ComplianceModel, member: Member, pieces: int, places: dict[str, tuple[float, float]]
) -> list[tuple[str, Array, str, Array, float, Array]]:
    """Return the pieces of a member: nodes and points of the ends, angle, compliance; new nodes go into `places`."""
    start, end = np.array(member.start[:2]), np.array(member.end[:2])
    angle = math.atan2(*(end - start)[::-1])
    if member.kind != "hinge":
        return [(member.nodes[0], start, member.nodes[1], end, angle, model.member_compliance(member))]
    parts, roots = _pieces(model, member, pieces)
    rows = []
    points = [start + share * (end - start) for share in np.linspace(0, 1, pieces + 1)]
    names = [f"{member.name}|{i}" for i in range(pieces + 1)]
    if not roots.any():
        names[0], names[-1] = member.nodes
    for name, point in zip(names, points, strict=True):
        places.setdefault(name, (float(point[0]), float(point[1])))
    if roots.any():
        ends = ((member.nodes[0], start, names[0], start), (names[-1], end, member.nodes[1], end))
        rows = [(*each, angle, roots) for each in ends]
    for i, compliance in enumerate(parts):
        rows.append((names[i], points[i], names[i + 1], points[i + 1], angle, compliance))
    return rows


def _pieces(model: ComplianceModel, member: Member, count: int) -> tuple[list[Array], Array]:
    """Return the compliance of each piece of a hinge, and of a root at either end, 3 by 3 at their centres.

    The pieces have together what the hinge has: its stretch, rotation and shear evenly, and bending so along it that
    rotation and sway are those of the hinge, by c_0 + c_2 (2 s / l)^2.
    """
    rootless = {name: own for name, own in model.effects.items() if name != "root_flexibility"}
    bare = model.having(rootless)
    whole, inner = model.member_compliance(member), bare.member_compliance(member)
    elastic = Elastic(bare.base["modulus"] * model.youngs_modulus, model.poissons_ratio, bare.base["constraint"])
    length, turning = member.length, float(inner[2, 2])
    share = rootless.get("hinge_shear", {}).get("share", 0.0)  # of sway and shear; bent pieces sway without it
    shear = share * beam.shear(member, elastic)
    sway = float(inner[1, 1]) - shear + (1 - share) * beam.sway(member, elastic)
    c0_c2 = np.linalg.solve([[1.0, 1 / 3], [1 / 3, 1 / 5]], [turning / length, 4 * sway / length**3])
    edges, piece, found = np.linspace(-1, 1, count + 1), length / count, []
    for low, high in itertools.pairwise(edges.tolist()):
        bent = float(c0_c2[0] + c0_c2[1] * (high**3 - low**3) / (3 * (high - low))) * piece
        found.append(np.diag([float(inner[0, 0]) / count, bent * piece**2 / 12 + shear / count, bent]))
    rest = whole - inner
    turned = float(rest[2, 2]) / 2
    across = max(float(rest[1, 1]) / 2 - (length / 2) ** 2 * turned, 0.0)
    return found, np.diag([float(rest[0, 0]) / 2, across, turned])


def displacement(model: ComplianceModel, load: Sequence[float], near: State | None = None) -> tuple[Array, State]:
    """Return how the output's point moves under a load, (3,) [m, m, rad], and the state; `near` is one near it.

    Raises
    ------
    InputError
        As `LargeFrame.solve`.
    """
    frame = LargeFrame(model)
    state = frame.solve(load, near if near is not None and frame.fits(near) else None)
    return frame.output(state), state
