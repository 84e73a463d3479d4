"""Superelements put together: statics and vibrations of a stage from those of its parts.

A rigid body b moves its ports' faces along: their shape amplitudes are q = T_b u_b, with u_b the three translations of
the body's centre and its three rotations. So each element's matrices come down to the motions of its bodies and its own
internal amplitudes,

    K = sum_e T_e^T K_e T_e,     M = sum_e T_e^T M_e T_e + sum_b M_b,

a few hundred unknowns for a stage whose parts have millions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexdesign.design.assembly import Assembly, Element
from flexdesign.fem.solving.port_shapes import rigid_motions
from flexdesign.fem.superelements.superelement import Superelement

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class StageMode:
    """A natural vibration: frequency [Hz] and amplitudes of all unknowns for unit modal mass."""

    frequency: float
    amplitudes: FloatArray


class AssembledStage:
    """A stage's equations, small and dense.

    Parameters
    ----------
    assembly
        What is bonded to what.
    parts
        The superelement of each element, by the element's name; all of one material.
    density
        Of the bodies [kg/m^3].
    """

    def __init__(self, assembly: Assembly, parts: Mapping[str, Superelement], density: float) -> None:
        self.assembly, self.parts, self.density = assembly, parts, density
        self._first = {body.name: 6 * i for i, body in enumerate(assembly.free_bodies)}
        self._inner: dict[str, int] = {}
        size = 6 * len(self._first)
        for element in assembly.elements:
            self._inner[element.name] = size
            size += parts[element.name].internal
        self.size = size

    @cached_property
    def stiffness(self) -> FloatArray:
        """Shape (size, size); actuators not installed."""
        return self._summed({element.name: self.parts[element.name].stiffness for element in self.assembly.elements})

    @cached_property
    def mass(self) -> FloatArray:
        """Shape (size, size)."""
        whole = self._summed({element.name: self.parts[element.name].mass for element in self.assembly.elements})
        for body in self.assembly.free_bodies:
            at = slice(self._first[body.name], self._first[body.name] + 6)
            whole[at, at] += body.inertia(self.density)
        return whole

    def extension(self, element: str, offset: FloatArray | None = None) -> FloatArray:
        """Return what an element's actuator feels, over all unknowns, shape (size,).

        `offset` is by how much its line of action lies off the ports' points, in the part's frame, shape (3,) [m].
        """
        places, onto = self.connection(element)
        part, row = self.parts[element], np.zeros(self.size)
        felt = part.extension
        if offset is not None:
            for port in self.assembly.element(element).part.ports():
                if port.role == "input":
                    felt = felt + np.cross(offset, -np.array(port.normal)) @ part.averages[port.name][3:]
        row[places] = felt @ onto
        return row

    def motion(self, body: str, point: FloatArray) -> FloatArray:
        """Return how a point that is fixed to a body moves, translations and rotations, shape (6, size)."""
        rows = np.zeros((6, self.size))
        start = self._first[body]
        arm = rigid_motions(point, self.assembly.body(body).centre)
        rows[:3, start : start + 6] = arm
        rows[3:, start + 3 : start + 6] = np.eye(3)
        return rows

    @property
    def table(self) -> FloatArray:
        """How the table's point moves, shape (6, size)."""
        return self.motion(self.assembly.table, np.array(self.assembly.point))

    def drive(self, axis: str) -> FloatArray:
        """Return the loads of an axis' actuators, each with a force of one newton, shape (size,)."""
        drives = self.assembly.axes[axis].drives
        return np.asarray(sum((sign * self.extension(name) for name, sign in drives.items()), np.zeros(self.size)))

    def with_input_springs(self, actuator: float) -> FloatArray:
        """Return the stiffness with a spring [N/m] between the inputs of every element that has some."""
        rows = [self.extension(name) for name in self.assembly.driven]
        return np.asarray(
            self.stiffness + actuator * sum((np.outer(e, e) for e in rows), np.zeros_like(self.stiffness))
        )

    def modes(self, count: int, actuator: float = 0.0) -> list[StageMode]:
        """Return the lowest modes, with an actuator of this stiffness [N/m] between all inputs."""
        squares, vectors = scipy.linalg.eigh(
            self.with_input_springs(actuator), self.mass, subset_by_index=[0, count - 1]
        )
        return [
            StageMode(float(np.sqrt(max(square, 0.0)) / (2 * np.pi)), vector)
            for square, vector in zip(squares, vectors.T, strict=True)
        ]

    def connection(self, name: str) -> tuple[IntArray, FloatArray]:
        """Return which unknowns move an element, and its amplitudes by them: shapes (k,) and (n + m, k)."""
        element, part = self.assembly.element(name), self.parts[name]
        inner = self._inner[name] + np.arange(part.internal)
        bodies = sorted({body for body in element.bonds.values() if body in self._first})
        places = np.concatenate([*(self._first[body] + np.arange(6) for body in bodies), inner]).astype(np.int64)
        onto = np.zeros((len(part.stiffness), len(places)))
        for shapes in part.shapes:
            body = element.bonds[shapes.port.name]
            if body in self._first:
                start = 6 * bodies.index(body)
                onto[part.rows(shapes.port.name), start : start + 6] = self._carried(element, shapes.port.name, body)
        onto[part.size :, 6 * len(bodies) :] = np.eye(part.internal)
        return places, onto

    def _carried(self, element: Element, port: str, body: str) -> FloatArray:
        """Return T_b, the amplitudes of a port's shapes from the motions of its body, shape (count, 6)."""
        placement, centre = element.placement, self.assembly.body(body).centre

        def motions(places: FloatArray) -> FloatArray:
            motions_ = rigid_motions(placement.outside(places), centre)
            return np.asarray(np.einsum("ji,njk->nik", placement.matrix, motions_))

        return self.parts[element.name].of(port).coordinates(motions)

    def _summed(self, matrices: Mapping[str, FloatArray]) -> FloatArray:
        whole = np.zeros((self.size, self.size))
        for name, matrix in matrices.items():
            places, onto = self.connection(name)
            whole[np.ix_(places, places)] += onto.T @ matrix @ onto
        return (whole + whole.T) / 2
