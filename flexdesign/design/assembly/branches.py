"""Branches of a stage: hinges and bars strung from body to body, and whole branches turned about the z axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flexdesign.core.model.linkage import Vector
from flexdesign.design.assembly.stage import Body, Box, Element, Placement, cross


@dataclass(frozen=True)
class Leaf:
    """A leaf hinge in a string of pieces, and the axis it bends about."""

    piece: Any
    axis: Vector

    @property
    def length(self) -> float:
        """[m]."""
        return float(2 * self.piece.reach)


@dataclass(frozen=True)
class Bar:
    """A stout length [m] between hinges, and its section: its size along the other two axes."""

    length: float
    section: Vector


@dataclass
class Branch:
    """What lies on one side of the table; bodies named here are the branch's own, unless they are table or frame."""

    bodies: list[Body] = field(default_factory=list)
    elements: list[Element] = field(default_factory=list)
    frame: list[Box] = field(default_factory=list)

    def __iadd__(self, other: Branch) -> Branch:
        self.bodies += other.bodies
        self.elements += other.elements
        self.frame += other.frame
        return self

    def put(
        self, name: str, piece: Any, origin: Vector, x: Vector, y: Vector, output: str, ground: str = "frame"
    ) -> None:
        """Add an amplifier whose axes x and y point this way."""
        bonds = {"output": output, "ground": ground}
        self.elements.append(Element(name, piece, Placement.of_axes(origin, x, y), bonds))

    def turned(self, quarter: int, side: str) -> Branch:
        """Return the branch a number of quarter turns about z on, its own names beginning with its side."""

        def named(name: str) -> str:
            return name if name in ("table", "frame") else f"{side}_{name}"

        def place(old: Placement) -> Placement:
            rotation = tuple(zip(*(turn(tuple(column), quarter) for column in old.matrix.T.tolist()), strict=True))
            return Placement(turn(old.origin, quarter), rotation)  # type: ignore[arg-type]

        bodies = [Body(named(b.name), tuple(turned_box(box, quarter) for box in b.boxes)) for b in self.bodies]
        elements = [
            Element(named(e.name), e.part, place(e.placement), {port: named(b) for port, b in e.bonds.items()})
            for e in self.elements
        ]
        return Branch(bodies, elements, [turned_box(box, quarter) for box in self.frame])


def strung(name: str, start: Vector, direction: Vector, pieces: Sequence[Leaf | Bar], first: str, last: str) -> Branch:
    """Return hinges and bars strung from one body to another, along a direction."""
    branch, at, along = Branch(), np.array(start), np.array(direction)
    bars = [f"{name}_{i}" for i, piece in enumerate(pieces) if isinstance(piece, Bar)]
    ends = iter([first, *bars, last])
    before = next(ends)
    for index, piece in enumerate(pieces):
        centre = at + along * piece.length / 2
        middle: Vector = tuple(centre.tolist())
        if isinstance(piece, Bar):
            size = np.array(piece.section) + np.abs(along) * piece.length
            branch.bodies.append(Body(f"{name}_{index}", (Box(middle, tuple(size.tolist())),)))
        else:
            after = next(ends)
            place = Placement.of_axes(middle, direction, cross(piece.axis, direction))
            branch.elements.append(Element(f"{name}_leaf_{index}", piece.piece, place, {"start": before, "end": after}))
            before = after
        at = at + along * piece.length
    return branch


def turn(vector: Vector, quarter: int) -> Vector:
    """Return a vector after a number of quarter turns about z."""
    x, y, z = vector
    for _ in range(quarter):
        x, y = -y, x
    return x, y, z


def turned_box(box: Box, quarter: int) -> Box:
    """Return a box after a number of quarter turns about z."""
    a, b, c = box.size
    return Box(turn(box.centre, quarter), (b, a, c) if quarter % 2 else (a, b, c))


def centred(size: float, middle: float = 0.0) -> tuple[float, float]:
    """Return the bounds of an interval by its length and middle."""
    return middle - size / 2, middle + size / 2


def spanning(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Box:
    """Return the box between bounds."""
    centre = ((x[0] + x[1]) / 2, (y[0] + y[1]) / 2, (z[0] + z[1]) / 2)
    return Box(centre, (x[1] - x[0], y[1] - y[0], z[1] - z[0]))
