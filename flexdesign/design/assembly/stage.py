"""A stage as parts between rigid bodies: what is bonded to what, and who drives which axis.

A body is a few boxes, stiff compared with the parts, and moves as a whole; the parts bend. Each bonded port of a part
sits on one body; the ports that an actuator pushes are bonded to nothing. Bodies that are fixed are the frame.

Frame of the stage: the table moves along x, y and z. A part keeps its own frame, and a placement says where that lies.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.errors import InputError
from flexdesign.core.model import Parameter, Quantity
from flexdesign.core.model.linkage import Vector
from flexdesign.design.materials import Material
from flexdesign.design.part import Piece, Port

FloatArray = NDArray[np.float64]


def cross(a: Vector, b: Vector) -> Vector:
    """Return the cross product; NumPy's takes thirty times as long for two vectors, and a stage has hundreds.

    >>> cross((1.0, 0.0, 0.0), (0.0, 2.0, 0.0))
    (0.0, 0.0, 2.0)
    """
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@dataclass(frozen=True)
class Placement:
    """Where a part's frame lies in the stage's: x_stage = origin + rotation x_part.

    Parameters
    ----------
    origin
        Of the part's frame [m].
    rotation
        Rows of a rotation matrix: the part's axes are its columns.
    """

    origin: Vector = (0.0, 0.0, 0.0)
    rotation: tuple[Vector, Vector, Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

    @classmethod
    def of_axes(cls, origin: Vector, x: Vector, y: Vector) -> Placement:
        """Return the placement at which the part's x and y axes point this way in the stage.

        Examples
        --------
        >>> Placement.of_axes((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)).outside(np.array([1.0, 2.0, 3.0]))
        array([-2.,  1.,  3.])
        """
        first, second, third = ((float(a), float(b), float(c)) for a, b, c in zip(x, y, cross(x, y), strict=True))
        return cls(origin, (first, second, third))

    @cached_property
    def matrix(self) -> FloatArray:
        """The rotation, shape (3, 3)."""
        return np.array(self.rotation)

    def outside(self, places: FloatArray) -> FloatArray:
        """Return places of the part's frame (..., 3) [m] in the stage's."""
        return np.asarray(np.array(self.origin) + places @ self.matrix.T)

    def to_part_frame(self, places: FloatArray) -> FloatArray:
        """Return places of the stage's frame (..., 3) [m] in the part's."""
        return np.asarray((places - np.array(self.origin)) @ self.matrix)


@dataclass(frozen=True)
class Box:
    """A cuboid along the stage's axes, by its centre and size [m]."""

    centre: Vector
    size: Vector

    @property
    def volume(self) -> float:
        """[m^3]."""
        return math.prod(self.size)


@dataclass(frozen=True)
class Body:
    """Boxes that move as one; `fixed` ones do not move."""

    name: str
    boxes: tuple[Box, ...]
    fixed: bool = False

    @property
    def volume(self) -> float:
        """[m^3]; the boxes do not overlap."""
        return sum(box.volume for box in self.boxes)

    @property
    def centre(self) -> FloatArray:
        """Centre of volume, shape (3,) [m]."""
        moments = sum((box.volume * np.array(box.centre) for box in self.boxes), np.zeros(3))
        return np.asarray(moments / self.volume)

    def inertia(self, density: float) -> FloatArray:
        """Return the mass matrix of translation and rotation about the centre, shape (6, 6) [kg, kg m^2]."""
        matrix = np.zeros((6, 6))
        matrix[:3, :3] = density * self.volume * np.eye(3)
        for box in self.boxes:
            mass, arm, squares = density * box.volume, np.array(box.centre) - self.centre, np.square(box.size)
            own = mass / 12 * np.diag(squares.sum() - squares)
            matrix[3:, 3:] += own + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        return matrix


@dataclass(frozen=True)
class Element:
    """A part at its place, and the bodies that its ports are bonded to, by port."""

    name: str
    part: Piece
    placement: Placement
    bonds: Mapping[str, str]

    def port(self, name: str) -> Port:
        """Return one of the part's ports, in the part's frame."""
        return next(port for port in self.part.ports() if port.name == name)


@dataclass(frozen=True)
class Axis:
    """A direction in which the table is driven.

    Parameters
    ----------
    direction
        Unit vector.
    drives
        By element, how its actuator takes part: +1 where it extends as the table moves along the direction, -1 where it
        shortens.
    """

    direction: Vector
    drives: Mapping[str, float]


@dataclass(frozen=True)
class Assembly:
    """A whole stage.

    Parameters
    ----------
    bodies, elements
        What it consists of.
    table
        Name of the body that is positioned.
    point
        The point whose motion is reported [m].
    axes
        How it is driven, by axis.

    Raises
    ------
    InputError
        If a part's port is bonded to nothing, or to something that is not there, or two elements share a name.
    """

    bodies: tuple[Body, ...]
    elements: tuple[Element, ...]
    table: str
    point: Vector
    axes: Mapping[str, Axis] = field(default_factory=dict)

    def __post_init__(self) -> None:
        names = [body.name for body in self.bodies]
        for kind, each in (("bodies", names), ("elements", [element.name for element in self.elements])):
            if len(set(each)) < len(each):
                twice = next(name for name in each if each.count(name) > 1)
                raise InputError("stage", kind, twice, "this name is given twice")
        for element in self.elements:
            for port in element.part.ports():
                if port.role != "input" and element.bonds.get(port.name) not in names:
                    where = f"elements.{element.name}.bonds.{port.name}"
                    raise InputError("stage", where, element.bonds.get(port.name), "name the body that it sits on")
        for name, axis in self.axes.items():
            for driven in axis.drives:
                self.element(driven, f"axes.{name}")
        self.body(self.table)

    def body(self, name: str) -> Body:
        """Return a body by its name."""
        for body in self.bodies:
            if body.name == name:
                return body
        raise InputError("stage", "bodies", name, "there is no such body")

    def element(self, name: str, field: str = "elements") -> Element:
        """Return an element by its name."""
        for element in self.elements:
            if element.name == name:
                return element
        raise InputError("stage", field, name, "there is no such element")

    @property
    def free_bodies(self) -> tuple[Body, ...]:
        """The bodies that move."""
        return tuple(body for body in self.bodies if not body.fixed)

    @property
    def driven(self) -> tuple[str, ...]:
        """Names of the elements with an actuator."""
        parts = {id(element.part): element.part for element in self.elements}
        pushed = {number for number, part in parts.items() if any(port.role == "input" for port in part.ports())}
        return tuple(element.name for element in self.elements if id(element.part) in pushed)

    def kinds(self) -> list[tuple[Piece, tuple[Element, ...]]]:
        """Return equal parts, each with the elements that are one."""
        parts = {id(element.part): element.part for element in self.elements}
        texts = {number: repr(part) for number, part in parts.items()}  # parts are dataclasses of dimensions
        key = lambda element: texts[id(element.part)]  # noqa: E731
        found = [tuple(group) for _, group in itertools.groupby(sorted(self.elements, key=key), key)]
        return [(group[0].part, group) for group in found]


class Stage(Protocol):
    """A parametric stage: what the engine asks of it. `dimensions` are the fields that a design must give."""

    dimensions: ClassVar[tuple[Parameter, ...]]

    def assembly(self) -> Assembly:
        """Return parts and bodies, at their places."""

    def solid(self) -> Any:
        """Return the whole stage as one CAD shape, frame included, in millimetres."""

    def formulas(
        self, material: Material, actuator_stiffness: float | None, output_load: float | None
    ) -> Mapping[str, Sequence[Quantity]]:
        """Return the quantities of each analytic model by the model's name; each one's source names its equation."""

    def springs(self, material: Material) -> Mapping[str, Sequence[tuple[str, int, Quantity, str]]]:
        """Return by axis what the table's motion bends: name, count, share of the stiffness [N/m], and source."""

    def arms(self) -> Mapping[tuple[str, str], float]:
        """Return the lengths [m] of the arms that tilt, by the axis they draw aside and the one that is driven."""
