"""Rigid bodies joined by members that give way, in the plane: forces and motions together, so that rigid members do.

Every node is a rigid body with two motions and a rotation; every member passes a force on from its start to its end and
lets them part by its compliance times that force, both taken at its centre. With B the parting per motion of the nodes,
C the compliances, f the members' forces and F the loads::

    [ -C   B ] [ f ]   [ 0 ]
    [ B^T  0 ] [ u ] = [ F ]

C may be singular (a hinge that only rotates, a rigid arm) and need not be symmetric (the paper's input rod, whose tip
bends under the hinge's moment and turns nothing).

Out of its plane a flat mechanism answers apart from what it does in it, by the same equations: every node then has a
motion along z and rotations about x and y, every member parts along z, about itself, and about the line across.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.model import Linkage
from flexdesign.core.model.linkage import Vector


class Mechanism(ValueError):
    """A frame that can move without any member giving way."""


@dataclass(frozen=True)
class FrameSolution:
    """How a frame answers to a load.

    Parameters
    ----------
    motions
        By the node: motion in x and y [m] and rotation [rad].
    forces
        By the member: what its start passes on to its end, at its centre: along, across [N] and moment [N m].
    """

    motions: Mapping[str, Array]
    forces: Mapping[str, Array]


def solve(
    linkage: Linkage,
    compliances: Mapping[str, Array],
    held: Sequence[str],
    loads: Sequence[Mapping[str, Array]],
    tensions: Mapping[str, float] | None = None,
    *,
    out_of_plane: bool = False,
) -> list[FrameSolution]:
    """Return how a frame answers to each of several loads.

    Parameters
    ----------
    linkage
        Nodes and members; z is left out.
    compliances
        Of each member by its name, 3 by 3: along it, across it to the left, turning to the left.
    held
        Nodes that do not move.
    loads
        Each by the node: force in x and y [N] and moment [N m] at the node.
    tensions
        Along members that are loaded already [N]: what is pulled straightens, what is pressed gives way, by N / L
        across a member of length L.
    out_of_plane
        Whether motions are along z and about x and y, loads force along z and moments about x and y, and compliances
        those along z, about the member and about the line across it.

    Raises
    ------
    Mechanism
        If something can move freely.
    """
    parted, place = parting(linkage, held, out_of_plane=out_of_plane)
    forces, unknowns = parted.shape
    system = np.zeros((forces + unknowns, forces + unknowns))
    each = np.arange(len(linkage.members))
    blocks = system[:forces, :forces].reshape(len(each), 3, len(each), 3)
    blocks[each, :, each] = -np.array([compliances[member.name] for member in linkage.members]).reshape(-1, 3, 3)
    system[:forces, forces:], system[forces:, :forces] = parted, parted.T
    if tensions:
        across = _partings(linkage, place, ends=True)[:, 1]
        pulls = np.array([tensions[member.name] / member.length for member in linkage.members])
        system[forces:, forces:] = across.T @ (pulls[:, None] * across)
    right = np.zeros((forces + unknowns, len(loads)))
    right[forces:] = load_columns(loads, place, unknowns)
    found = _solve_scaled(system, right)
    passed, displacements, still = found[:forces], found[forces:], np.zeros(3)
    return [
        FrameSolution(
            {
                node: displacements[place[node] : place[node] + 3, column] if node in place else still
                for node in linkage.nodes
            },
            {
                m.name: passed[row : row + 3, column]
                for row, m in zip(range(0, forces, 3), linkage.members, strict=True)
            },
        )
        for column in range(len(loads))
    ]


def parting(linkage: Linkage, held: Sequence[str], *, out_of_plane: bool = False) -> tuple[Array, dict[str, int]]:
    """Return B, how members part per motion of the nodes, three rows each, and where each node begins."""
    place = {node: 3 * number for number, node in enumerate(node for node in linkage.nodes if node not in held)}
    found = _partings(linkage, place, out_of_plane=out_of_plane)
    return found.reshape(3 * len(linkage.members), 3 * len(place)), place


def load_columns(loads: Sequence[Mapping[str, Array]], place: Mapping[str, int], unknowns: int) -> Array:
    """Return loads as columns, one row for each unknown; what acts on a node that is held moves nothing."""
    columns = np.zeros((unknowns, len(loads)))
    for column, load in enumerate(loads):
        for node, force in load.items():
            if node in place:
                columns[place[node] : place[node] + 3, column] += force
    return columns


def displace(linkage: Linkage, motions: Mapping[str, Array]) -> Linkage:
    """Return a linkage whose bodies have moved: its nodes, and the ends of its members with them."""

    def to(point: Vector, node: str) -> Vector:
        (x, y, z), (nx, ny, _), (ux, uy, angle) = point, linkage.nodes[node], motions[node]
        dx, dy = x - nx, y - ny
        c, s = math.cos(angle), math.sin(angle)
        return (nx + ux + c * dx - s * dy, ny + uy + s * dx + c * dy, z)

    nodes = {node: to(point, node) for node, point in linkage.nodes.items()}
    members = tuple(
        replace(member, start=to(member.start, member.nodes[0]), end=to(member.end, member.nodes[1]))
        for member in linkage.members
    )
    return Linkage(nodes, members, linkage.ports)


def _solve_scaled(system: Array, right: Array) -> Array:
    """Return the solution; rows and columns are scaled, as forces and motions differ by many powers of ten."""
    scale = np.sqrt(np.abs(system).max(axis=1))
    scale = 1 / np.where(scale > 0, scale, 1.0)
    scaled = scale[:, None] * system * scale
    try:
        solution = scale[:, None] * np.linalg.solve(scaled, scale[:, None] * right)
    except np.linalg.LinAlgError as error:
        raise Mechanism("the members leave something free to move, or hold it twice without giving way") from error
    if not np.isfinite(solution).all():
        raise Mechanism("the members leave something free to move")
    return np.asarray(solution)


def _partings(linkage: Linkage, place: Mapping[str, int], *, out_of_plane: bool = False, ends: bool = False) -> Array:
    """Return how members part, shape (members, 3, unknowns): at their centres, or their ends from one another."""
    members = linkage.members
    found = np.zeros((len(members), 3, len(place), 3))
    sides = [np.reshape([getattr(member, side)[:2] for member in members], (-1, 2)) for side in ("start", "end")]
    centres, along = (sides[0] + sides[1]) / 2, sides[1] - sides[0]
    axes = along / np.array([[member.length] for member in members])
    for side, way in enumerate((-1.0, 1.0)):
        nodes = np.reshape([linkage.nodes[member.nodes[side]][:2] for member in members], (-1, 2))
        arms = (sides[side] if ends else centres) - nodes
        numbers = np.array([place.get(m.nodes[side], -3) // 3 for m in members], dtype=int)
        moving = np.flatnonzero(numbers >= 0)
        carried = (_carried_out_of_plane if out_of_plane else _carried)(arms[moving], axes[moving])
        found[moving, :, numbers[moving]] += way * carried
    return found.reshape(len(members), 3, 3 * len(place))


def _carried(arms: Array, axes: Array) -> Array:
    """Return motions along members, across and turning, per motion of the node that carries them, (n, 3, 3)."""
    (dx, dy), (ax, ay), none, one = arms.T, axes.T, np.zeros(len(arms)), np.ones(len(arms))
    rows = [[ax, ay, ay * dx - ax * dy], [-ay, ax, ay * dy + ax * dx], [none, none, one]]
    return np.moveaxis(np.array(rows), 2, 0)


def _carried_out_of_plane(arms: Array, axes: Array) -> Array:
    """Return motions along z, about members and about the lines across them, per motion of the node, (n, 3, 3)."""
    (dx, dy), (ax, ay), none, one = arms.T, axes.T, np.zeros(len(arms)), np.ones(len(arms))
    return np.moveaxis(np.array([[one, dy, -dx], [none, ax, ay], [none, -ay, ax]]), 2, 0)


def transfer_force(node: Vector, point: Vector, force: Sequence[float]) -> Array:
    """Return a force in the plane at a point as force and moment at a node."""
    fx, fy = force
    dx, dy = point[0] - node[0], point[1] - node[1]
    return np.array([fx, fy, dx * fy - dy * fx])
