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
from flexdesign.core.model import Linkage, Member
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
    at_place = _at_out_of_plane if out_of_plane else _at
    free = [node for node in linkage.nodes if node not in held]
    place = {node: 3 * number for number, node in enumerate(free)}
    forces, unknowns = 3 * len(linkage.members), 3 * len(free)
    parting = np.zeros((forces, unknowns))
    system = np.zeros((forces + unknowns, forces + unknowns))
    for row, member in zip(range(0, forces, 3), linkage.members, strict=True):
        for node, way in zip(member.nodes, (-1, 1), strict=True):
            if node in place:
                at = slice(place[node], place[node] + 3)
                parting[row : row + 3, at] += way * at_place(member.centre, member, linkage.nodes[node])
        system[row : row + 3, row : row + 3] = -compliances[member.name]
    system[:forces, forces:], system[forces:, :forces] = parting, parting.T
    for member in linkage.members if tensions else ():
        across = np.zeros(unknowns)
        for node, end, way in zip(member.nodes, (member.start, member.end), (-1, 1), strict=True):
            if node in place:
                carried = _at(end, member, linkage.nodes[node])
                across[place[node] : place[node] + 3] += way * carried[1]
        system[forces:, forces:] += (tensions or {})[member.name] / member.length * np.outer(across, across)
    right = np.zeros((forces + unknowns, len(loads)))
    for column, load in enumerate(loads):
        for node, force in load.items():
            if node in place:
                right[forces + place[node] : forces + place[node] + 3, column] += force
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


def _at(point: Vector, member: Member, node: Vector) -> Array:
    """Return the motion of a rigid body at a point, along a member, across and turning, per motion of its node."""
    (x, y, _), (ax, ay, _) = point, member.axis
    dx, dy = x - node[0], y - node[1]
    carried = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
    turned = np.array([[ax, ay, 0.0], [-ay, ax, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turned @ carried)


def _at_out_of_plane(point: Vector, member: Member, node: Vector) -> Array:
    """Return the motion of a rigid body at a point along z, about a member and about the line across it."""
    (x, y, _), (ax, ay, _) = point, member.axis
    dx, dy = x - node[0], y - node[1]
    return np.array([[1.0, dy, -dx], [0.0, ax, ay], [0.0, -ay, ax]])


def transfer_force(node: Vector, point: Vector, force: Sequence[float]) -> Array:
    """Return a force in the plane at a point as force and moment at a node."""
    fx, fy = force
    dx, dy = point[0] - node[0], point[1] - node[1]
    return np.array([fx, fy, dx * fy - dy * fx])
