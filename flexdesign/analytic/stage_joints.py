"""Parts between the bodies of a stage: how each parts as the bodies move, which no effect changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.arrays import Array
from flexdesign.design.assembly import Assembly, Element
from flexdesign.design.part import Port

#: Length [m] that makes rotations comparable with motions, and forces with moments.
ARM = 0.01


@dataclass(frozen=True, eq=False)
class Joint:
    """A part between two bodies: B, how its second port parts from the first, (6, k), and the unknowns it is of.

    The parting is in the part's frame, at the second port. `bodies` are what it is bonded to, first what counts as
    held; `outwards` is the normal of the port that moves, in the part's frame, shape (3,).
    """

    element: Element
    bodies: tuple[str, str]
    outwards: Array
    is_driven: bool
    places: list[int]
    parting: Array


@dataclass(frozen=True, eq=False)
class Joints:
    """All parts of an assembly, the unknowns of its bodies, and how the table's point moves by them, (3, size)."""

    each: tuple[Joint, ...]
    places: dict[str, list[int]]
    size: int
    table: Array

    @classmethod
    def of(cls, assembly: Assembly, *, turns: bool) -> Joints:
        """Return the parts of an assembly; without `turns` the table and what carries amplifiers do not turn."""
        ports = {id(each.part): tuple(each.part.ports()) for each in assembly.elements}
        driven = {id_ for id_, its in ports.items() if any(port.role == "input" for port in its)}
        carrying = {body for e in assembly.elements if id(e.part) in driven for body in e.bonds.values()}
        straight = set() if turns else carrying | {assembly.table}
        places, size = {}, 0
        for body in assembly.free_bodies:
            count = 3 if body.name in straight else 6
            places[body.name] = list(range(size, size + count))
            size += count
        centres = {body.name: body.centre for body in assembly.bodies}

        def motion(body: str, point: Array) -> Array:
            """Return how a point of a body moves and turns by its unknowns, shape (6, k)."""
            return _arm_motion(point - centres[body])[:, : len(places.get(body, ()))]

        joints = []
        for element in assembly.elements:
            first, second = ends(element, ports[id(element.part)])
            point = element.placement.outside(np.array(second.point))
            one, other = (element.bonds[port.name] for port in (first, second))
            its = [*places.get(one, ()), *places.get(other, ())]
            parted = np.hstack([-motion(one, point), motion(other, point)]).reshape(2, 3, len(its))
            parting = (element.placement.matrix.T @ parted).reshape(6, len(its))
            outwards = np.array(second.normal)
            joints.append(Joint(element, (one, other), outwards, id(element.part) in driven, its, parting))
        table = np.zeros((3, size))
        table[:, places[assembly.table]] = motion(assembly.table, np.array(assembly.point))[:3]
        return cls(tuple(joints), places, size, table)

    @cached_property
    def _padded(self) -> tuple[Array, NDArray[np.intp]]:
        """All partings as one array (parts, 6, 12), and where their products belong in a matrix of one row more."""
        partings, places = np.zeros((len(self.each), 6, 12)), np.full((len(self.each), 12), self.size)
        for parting, its, joint in zip(partings, places, self.each, strict=True):
            parting[:, : len(joint.places)], its[: len(joint.places)] = joint.parting, joint.places
        return partings, (places[:, :, None] * (self.size + 1) + places[:, None, :]).ravel()

    def assemble(self, stiffnesses: Sequence[Array]) -> Array:
        """Return the sum of B^T C^+ B over the parts, shape (size, size)."""
        (partings, places), rows = self._padded, self.size + 1
        products = np.swapaxes(partings, 1, 2) @ np.array(stiffnesses) @ partings
        total = np.asarray(np.bincount(places, products.ravel(), rows**2), dtype=float)
        return total.reshape(rows, rows)[:-1, :-1]


def ends(element: Element, ports: Sequence[Port]) -> tuple[Port, Port]:
    """Return the port that counts as held, and the one that moves relative to it; `ports` are those of its part."""
    bonded = [port for port in ports if port.name in element.bonds]
    first, second = sorted(bonded, key=lambda port: port.role == "output")
    return first, second


def _arm_motion(arm: Array) -> Array:
    """Return the motion at the end of an arm per motion of a body, 6 by 6, rotations in units of 1 / `ARM`."""
    x, y, z = arm / ARM
    whole = np.eye(6)
    whole[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return whole
