"""Planar rigid bodies joined by springs: stiffness and mass matrix, and what follows at the ports.

Every body has two motions of its centroid and a rotation; every flexure is a spring of three stiffnesses at its middle,
those of an Euler-Bernoulli beam: EA/l along it, 12 EI/l^3 across it, EI/l turning (of a notch the integrals of beam
theory over its profile). With B the parting of a flexure's ends per motion of the bodies and S its stiffness, the
energies of Lagrange's equations are quadratic::

    V = u^T K u / 2,   K = sum B^T S B;        T = v^T M v / 2,   M = diag(m, m, J) of each body

A flexure's own mass goes half to each of its bodies, at the end where it joins it. What bodies, roots and shear give
way is left out; it is in the compliance model.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg

from flexdesign.core.arrays import Array
from flexdesign.core.model import Elastic, Linkage, Member, Quantity
from flexdesign.design.materials import Material
from flexdesign.design.part import Port
from flexdesign.design.sketch import Drawing, polygons
from flexdesign.effects.hinge_compliance import beam

SOURCE = "rigid bodies and beams, Lagrange's equations"
#: Frequencies that differ by less than this, relative, are one.
SAME_FREQUENCY = 1e-6


@dataclass(frozen=True)
class RigidBody:
    """A body: its name, centroid [m], mass [kg] and moment of inertia about the centroid [kg m^2]."""

    name: str
    centre: tuple[float, float]
    mass: float
    inertia: float


@dataclass(frozen=True)
class Spring:
    """A flexure: the bodies at its start and end, its middle and axis, and its stiffness along, across and turning."""

    name: str
    kind: str
    bodies: tuple[str, str]
    centre: tuple[float, float]
    axis: tuple[float, float]
    stiffness: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class RigidBodies:
    """Bodies, the springs between them, and their ports.

    Parameters
    ----------
    bodies, springs
        All of them; those in `held` are the ground.
    ports, carriers
        Ports, and by name the body of each.
    held
        Bodies that do not move.
    """

    bodies: Sequence[RigidBody]
    springs: Sequence[Spring]
    ports: Sequence[Port]
    carriers: Mapping[str, str]
    held: Sequence[str]

    @cached_property
    def _place(self) -> dict[str, int]:
        free = [body.name for body in self.bodies if body.name not in self.held]
        return {name: 3 * number for number, name in enumerate(free)}

    @cached_property
    def _centres(self) -> dict[str, tuple[float, float]]:
        return {body.name: body.centre for body in self.bodies}

    def _motion(self, body: str, point: Sequence[float]) -> Array:
        """Return motion in x and y and rotation at a point of a body per unit of all coordinates, shape (3, n)."""
        rows = np.zeros((3, 3 * len(self._place)))
        if body in self._place:
            dx, dy = point[0] - self._centres[body][0], point[1] - self._centres[body][1]
            at = self._place[body]
            rows[:, at : at + 3] = [[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]]
        return rows

    @cached_property
    def partings(self) -> dict[str, Array]:
        """B of each spring by its name: along it, across it to the left, turning; shape (3, n)."""
        found = {}
        for spring in self.springs:
            first, second = spring.bodies
            ax, ay = spring.axis
            turned = np.array([[ax, ay, 0.0], [-ay, ax, 0.0], [0.0, 0.0, 1.0]])
            found[spring.name] = turned @ (self._motion(second, spring.centre) - self._motion(first, spring.centre))
        return found

    @cached_property
    def stiffness(self) -> Array:
        """K, in N/m, N and N m."""
        pieces = [self.partings[s.name].T @ np.diag(s.stiffness) @ self.partings[s.name] for s in self.springs]
        return np.asarray(sum(pieces))

    @cached_property
    def mass(self) -> Array:
        """M, in kg and kg m^2."""
        free = [body for body in self.bodies if body.name in self._place]
        return np.diag([value for body in free for value in (body.mass, body.mass, body.inertia)])

    def load(self, role: str) -> Array:
        """Return the generalised forces of a unit actuator force, or of a unit force along the output's normal."""
        total = np.zeros(len(self.stiffness))
        for port in self.ports:
            if port.role == role:
                way = -1.0 if role == "input" else 1.0
                motion = self._motion(self.carriers[port.name], port.point)
                total += way * (port.normal[0] * motion[0] + port.normal[1] * motion[1])
        return total

    @cached_property
    def port_compliance(self) -> Array:
        """Compliance between actuator and output, 2 by 2 [m/N]."""
        loads = np.column_stack([self.load("input"), self.load("output")])
        return np.asarray(loads.T @ scipy.linalg.solve(self.stiffness, loads, assume_a="pos"))

    def modes(self, actuator: float = 0.0) -> tuple[Array, Array]:
        """Return natural frequencies [Hz], ascending, and their shapes of unit modal mass in columns.

        `actuator` is the stiffness of a spring between the inputs [N/m].
        """
        extension = self.load("input")
        values, shapes = scipy.linalg.eigh(self.stiffness + actuator * np.outer(extension, extension), self.mass)
        return np.sqrt(np.maximum(values, 0.0)) / (2 * math.pi), shapes

    def shares(self) -> dict[str, dict[str, float]]:
        """Return what the compliances consist of [m/N], by the stiffness's key and piece, such as ``hinge bending``."""
        loads = {"K_in_output_free": self.load("input"), "K_out_input_free": self.load("output")}
        (c11, c12), _ = self.port_compliance
        loads["K_out_input_held"] = loads["K_out_input_free"] - c12 / c11 * loads["K_in_output_free"]
        found = {}
        for key, load in loads.items():
            motion = scipy.linalg.solve(self.stiffness, load, assume_a="pos")
            pieces: dict[str, float] = defaultdict(float)
            for spring in self.springs:
                energies = np.array(spring.stiffness) * (self.partings[spring.name] @ motion) ** 2
                pieces[f"{spring.kind} axial"] += float(energies[0])
                pieces[f"{spring.kind} bending"] += float(energies[1:].sum())
            found[key] = dict(pieces)
        return found

    def quantities(self, actuator: float | None = None, output_load: float | None = None) -> list[Quantity]:
        """Return stiffnesses, amplification, frequencies and masses as FEM states them.

        Parameters
        ----------
        actuator
            Stiffness of the actuator with its seats [N/m].
        output_load
            Stiffness that the output pushes against, for one more row of K_in and amplification [N/m].
        """
        (c11, c12), (_, c22) = self.port_compliance
        held = c22 - c12**2 / c11
        found = [
            Quantity("K_in", 1 / c11, "N/m", "N/mm", "output free", SOURCE),
            Quantity("lambda", c12 / c11, "1", "", "output free", SOURCE),
            Quantity("K_out", 1 / c22, "N/m", "N/mm", "input free", SOURCE),
        ]
        if held > 1e-9 * c22:
            found.append(Quantity("K_out", 1 / held, "N/m", "N/mm", "input held", SOURCE))
        if actuator is not None:
            left = c22 - c12**2 / (c11 + 1 / actuator)
            found.append(Quantity("K_out", 1 / left, "N/m", "N/mm", "actuator installed", SOURCE))
        for boundary, spring in (("input free", 0.0), ("actuator installed", actuator)):
            if spring is not None:
                found += self._vibrations(boundary, spring)
        return found

    def _vibrations(self, boundary: str, actuator: float) -> list[Quantity]:
        """Return frequencies and the output's modal mass, modes of one frequency taken together.

        Of such modes only their sums over the frequency do not depend on how the shapes are chosen.
        """
        c12 = self.port_compliance[0, 1]
        frequencies, shapes = self.modes(actuator)
        travel, extension = self.load("output") @ shapes, self.load("input") @ shapes
        starts = np.flatnonzero(np.append(True, np.diff(frequencies) > SAME_FREQUENCY * frequencies[1:]))
        apart, squared = frequencies[starts], np.add.reduceat(travel**2, starts)
        main = int(np.argmax(squared / apart**2))
        found = [
            Quantity("first_frequency", float(frequencies[0]), "Hz", "Hz", boundary, SOURCE),
            Quantity("output_frequency", float(apart[main]), "Hz", "Hz", boundary, SOURCE),
            Quantity("output_mass", float(1 / squared[main]), "kg", "g", boundary, SOURCE),
        ]
        if actuator:
            driven = np.add.reduceat(extension * travel, starts) / apart**2 * math.copysign(1.0, c12)
            found.append(
                Quantity("drive_frequency", float(apart[int(np.argmax(driven))]), "Hz", "Hz", boundary, SOURCE)
            )
        return found


def of_drawing(drawing: Drawing, linkage: Linkage, material: Material) -> RigidBodies:
    """Return the rigid bodies of a sketch, all of them, and its flexures as springs."""
    per_area = material.density * drawing.thickness
    members = {member.name: member for member in linkage.members if member.name in drawing.flexures}
    bodies = []
    for body in drawing.bodies.values():
        area, centre, polar = polygons.area_moments(body.corners)
        mass, inertia = per_area * area, per_area * polar
        for flexure, point, _ in drawing.attached.get(body.name, []):
            half = per_area * polygons.area_moments(flexure.corners)[0] / 2
            mass, inertia = mass + half, inertia + half * float((point - centre) @ (point - centre))
        bodies.append(RigidBody(body.name, (float(centre[0]), float(centre[1])), mass, inertia))
    elastic = Elastic(material.youngs_modulus, material.poissons_ratio, 0.0)
    springs = [_spring(members[name], flexure.bodies, elastic) for name, flexure in drawing.flexures.items()]
    return RigidBodies(bodies, springs, drawing.ports, drawing.carriers, drawing.carried_by("ground"))


def _spring(member: Member, bodies: tuple[str, str], elastic: Elastic) -> Spring:
    (x, y, _), (ax, ay, _) = member.centre, member.axis
    compliance = (beam.stretch(member, elastic), beam.sway(member, elastic), beam.rotation(member, elastic))
    return Spring(member.name, member.kind, bodies, (x, y), (ax, ay), tuple(1 / value for value in compliance))  # type: ignore[arg-type]


def coupling(axes: Mapping[str, RigidBodies]) -> dict[tuple[str, str], float]:
    """Return how far each axis's output moves per extension of each axis's actuator, all else free.

    Parameters
    ----------
    axes
        The same bodies and springs, with the ports of one axis each, by its name.
    """
    found = {}
    for driven, model in axes.items():
        push = model.load("input")
        motion = scipy.linalg.solve(model.stiffness, push, assume_a="pos")
        for observed, other in axes.items():
            found[driven, observed] = float(other.load("output") @ motion / (push @ motion))
    return found


def pivots_suffice(linkage: Linkage, ports: Sequence[Port]) -> bool:
    """Tell whether a linkage moves at input and output if its hinges only rotate, and no rigid constraint is redundant.

    Long leaves in parallel do not: as pivots in their middles they would hold the body that they guide. Nor does a leaf
    that drives a lever from a straight guide: one pivot in its middle locks what bends at both its ends.
    """
    held = [linkage.ports[port.name] for port in ports if port.role == "ground"]
    free = [node for node in linkage.nodes if node not in held]
    place = {node: 3 * number for number, node in enumerate(free)}
    size = max(math.dist(a, b) for a in linkage.nodes.values() for b in linkage.nodes.values())

    def carried(node: str, x: float, y: float) -> Array:
        """Return the motion of a point in x and y, and its rotation, per motion of all nodes, shape (3, n)."""
        motion = np.zeros((3, 3 * len(free)))
        if node in place:
            dx, dy = (x - linkage.nodes[node][0]) / size, (y - linkage.nodes[node][1]) / size
            motion[:, place[node] : place[node] + 3] = [[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]]
        return motion

    rows: list[Array] = []
    for member in linkage.members:
        (ax, ay, _), (cx, cy, _) = member.axis, member.centre
        turned = np.array([[ax, ay, 0.0], [-ay, ax, 0.0], [0.0, 0.0, 1.0]])
        row = turned @ (carried(member.nodes[1], cx, cy) - carried(member.nodes[0], cx, cy))
        rows += {"hinge": [row[0], row[1]], "rod": [row[0], row[2]]}.get(member.kind, [*row])
    _, values, shapes = np.linalg.svd(np.array(rows))
    if len(rows) >= 3 * len(free) or not values[-1] > 1e-9 * values[0]:
        return False
    for role in ("input", "output"):
        moved = np.zeros(3 * len(free))
        for port in ports:
            if port.role == role:
                moved += np.array([*port.normal[:2], 0.0]) @ carried(linkage.ports[port.name], *port.point[:2])
        if not np.linalg.norm(shapes[len(rows) :] @ moved) > 1e-9 * np.linalg.norm(moved):
            return False
    return True
