"""Large displacements of a stage: bodies that move as they will, and parts that deform little seen from beside them.

A body's motion is the displacement of its centre and a rotation matrix R_b. A part is seen from a frame that goes
along, its origin the mean of its ports' points and its rotation R the mean of its bodies' (the orthogonal matrix
nearest to it): in that frame a port's point has moved by, and its face turned by,

    d = R^T (x - x_0) - (X - X_0),     theta = axial(R^T R_b),

small both, which are the amplitudes of `second_order` (Felippa and Haugen, 2005, Computer Methods in Applied Mechanics
and Engineering 194, on the co-rotational description). Forces on the bodies follow from virtual work with

    delta d = R^T (delta x - delta x_0 - delta phi x (x - x_0)),     delta theta = R^T (delta phi_b - delta phi),

delta phi being the mean of the bodies' spins; both hold but for products of theta with the part's own large rotations
and deformations, of third order. Equilibrium is found by Newton's method; its tangent leaves out what stresses add as
parts turn.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexdesign.assembly import Assembly, Element
from flexdesign.fem.second_order import SecondOrder

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Newton's method ends with the step after the residual has fallen to this share of the load, or after so many steps:
#: rounding alone leaves 5e-8, as hinges hardly stretch.
TOLERANCE, MOST_STEPS = 1e-6, 60


class NoEquilibrium(ArithmeticError):
    """Newton's method found none: the load is too large, or the stage has buckled."""


@dataclass(frozen=True)
class State:
    """Where the bodies are: displacements of their centres (b, 3) [m] and rotations (b, 3, 3).

    `pushed` is what actuators' forces add to the extensions that the ports' motions cause, by driven element [m].
    """

    displacements: FloatArray
    rotations: FloatArray
    pushed: FloatArray


class CorotatedStage:
    """A stage of superelements known to second order, between bodies that move without limit.

    Parameters
    ----------
    assembly
        What is bonded to what.
    parts
        Energy of each element, by its name.
    """

    def __init__(self, assembly: Assembly, parts: Mapping[str, SecondOrder]) -> None:
        self.assembly = assembly
        self._body = {body.name: i for i, body in enumerate(assembly.free_bodies)}
        self._actuator = {name: i for i, name in enumerate(assembly.driven)}
        self._members = [_Member(element, parts[element.name], assembly) for element in assembly.elements]
        self.size = 6 * len(self._body) + len(self._actuator)

    @property
    def rest(self) -> State:
        """The undeformed stage."""
        count = len(self._body)
        return State(np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1)), np.zeros(len(self._actuator)))

    def drive(self, axis: str, force: float) -> dict[str, float]:
        """Return the forces [N] of an axis' actuators, by element, if each pushes or pulls with this one."""
        return {name: sign * force for name, sign in self.assembly.axes[axis].drives.items()}

    def equilibrium(
        self, actuators: Mapping[str, float], loads: FloatArray | None = None, start: State | None = None
    ) -> State:
        """Return the state in which all forces and moments are balanced.

        Parameters
        ----------
        actuators
            Forces with which actuators part their inputs [N], by element.
        loads
            Force [N] and moment [N m] about the centre of each moving body, in the stage's frame, shape (b, 6).
        start
            Where to begin; at rest if None.

        Raises
        ------
        NoEquilibrium
            If none is found.
        """
        state = start or self.rest
        dead = np.zeros(self.size)
        if loads is not None:
            dead[: loads.size] = loads.ravel()
        scale = float(np.abs(self._softness * (dead - self.forces_and_tangent(self.rest, actuators)[0])).max()) or 1.0
        for _ in range(MOST_STEPS):
            forces, tangent = self.forces_and_tangent(state, actuators)
            residual = dead - forces
            if not np.all(np.isfinite(residual)):
                break
            state = self.moved(state, scipy.linalg.solve(tangent, residual, assume_a="sym"))
            if np.abs(self._softness * residual).max() <= TOLERANCE * scale:
                return state
        raise NoEquilibrium("no equilibrium was found; take smaller steps, or a smaller load")

    def forces_and_tangent(self, state: State, actuators: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """Return the forces and moments that hold the bodies against parts and actuators, and their tangent.

        The tangent leaves out what stresses add as parts turn.
        """
        total, tangent = np.zeros(self.size), np.zeros((self.size, self.size))
        for member in self._members:
            amplitudes, jacobian, places = self._seen(member, state)
            push = actuators.get(member.name, 0.0) * member.law.extension
            total[places] += jacobian.T @ (member.law.forces(amplitudes) - push)
            tangent[np.ix_(places, places)] += jacobian.T @ member.law.tangent(amplitudes) @ jacobian
        return total, tangent

    def extension(self, state: State, element: str) -> float:
        """Return how far an element's inputs have parted [m]."""
        member = next(member for member in self._members if member.name == element)
        return float(member.law.extension @ self._seen(member, state)[0])

    def energy(self, state: State) -> float:
        """Return the strain energy [J]."""
        return sum(member.law.energy(self._seen(member, state)[0]) for member in self._members)

    def moved(self, state: State, step: FloatArray) -> State:
        """Return the state after small displacements and spins of the bodies, and extensions, shape (size,)."""
        count = len(self._body)
        bodies = step[: 6 * count].reshape(count, 6)
        turned = Rotation.from_rotvec(bodies[:, 3:]).as_matrix() @ state.rotations
        return State(state.displacements + bodies[:, :3], turned, state.pushed + step[6 * count :])

    def motion(self, state: State, body: str, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return displacement (3,) [m] and rotation vector (3,) [rad] of a point fixed to a body."""
        index, arm = self._body[body], point - self.assembly.body(body).centre
        rotation = state.rotations[index]
        turned = Rotation.from_matrix(rotation).as_rotvec()
        return state.displacements[index] + rotation @ arm - arm, turned

    def table(self, state: State) -> tuple[FloatArray, FloatArray]:
        """Return displacement and rotation of the table at its point."""
        return self.motion(state, self.assembly.table, np.array(self.assembly.point))

    @cached_property
    def _softness(self) -> FloatArray:
        """Makes forces and moments alike: the root of how far each unknown gives way to a unit load of its own."""
        tangent = self.forces_and_tangent(self.rest, {})[1]
        return np.asarray(np.sqrt(np.diag(np.linalg.inv(tangent))))

    def _seen(self, member: _Member, state: State) -> tuple[FloatArray, FloatArray, IntArray]:
        """Return a part's amplitudes, their derivatives by the unknowns it depends on, and which these are."""
        moves = [self._of_body(bond.body, state) for bond in member.bonds]
        arms = [rotation @ bond.arm for (_, rotation), bond in zip(moves, member.bonds, strict=True)]
        # Points after the motion, from the bodies' centres before it.
        points = np.array([b.centre + u + arm for b, (u, _), arm in zip(member.bonds, moves, arms, strict=True)])
        frame = _nearest(np.mean([rotation for _, rotation in moves], axis=0)) @ member.rotation
        spread = points - points.mean(axis=0)
        count, k = len(moves), len(member.law.stiffness)
        amplitudes, jacobian = np.zeros(k), np.zeros((k, 6 * count + member.driven))
        for i, (_, rotation) in enumerate(moves):
            at = slice(6 * i, 6 * i + 6)
            turned = frame.T @ rotation @ member.rotation
            amplitudes[at] = np.concatenate([frame.T @ spread[i] - member.spread[i], _axial(turned)])
            for j in range(count):
                own = 1.0 if i == j else 0.0
                shift = (own - 1 / count) * np.eye(3)
                spin = -own * _cross(arms[i]) + _cross(arms[j]) / count + _cross(spread[i]) / count
                jacobian[6 * i : 6 * i + 3, 6 * j : 6 * j + 3] = frame.T @ shift
                jacobian[6 * i : 6 * i + 3, 6 * j + 3 : 6 * j + 6] = frame.T @ spin
                jacobian[6 * i + 3 : 6 * i + 6, 6 * j + 3 : 6 * j + 6] = (own - 1 / count) * frame.T
        if member.driven:
            amplitudes[-1] = state.pushed[self._actuator[member.name]]
            jacobian[-1, -1] = 1.0
        free = [i for i, bond in enumerate(member.bonds) if bond.body in self._body]
        columns = [6 * i + np.arange(6) for i in free]
        places = [6 * self._body[member.bonds[i].body] + np.arange(6) for i in free]
        if member.driven:
            columns.append(np.array([6 * count]))
            places.append(np.array([6 * len(self._body) + self._actuator[member.name]]))
        return amplitudes, jacobian[:, np.concatenate(columns)], np.concatenate(places)

    def _of_body(self, name: str, state: State) -> tuple[FloatArray, FloatArray]:
        if name not in self._body:
            return np.zeros(3), np.eye(3)
        return state.displacements[self._body[name]], state.rotations[self._body[name]]


@dataclass(frozen=True)
class _Bond:
    """A port on a body: the body's centre (3,) and the arm from there to the port's point (3,), at rest [m]."""

    body: str
    centre: FloatArray
    arm: FloatArray


class _Member:
    """An element at rest, as `CorotatedStage` sees it."""

    def __init__(self, element: Element, law: SecondOrder, assembly: Assembly) -> None:
        self.name, self.law, self.rotation = element.name, law, element.placement.matrix
        ports = [port for port in element.part.ports() if port.role != "input"]
        places = np.array([port.point for port in ports])
        self.spread = places - places.mean(axis=0)
        self.driven = len(law.stiffness) - 6 * len(ports)
        self.bonds = []
        for port, place in zip(ports, element.placement.outside(places), strict=True):
            body = assembly.body(element.bonds[port.name])
            self.bonds.append(_Bond(body.name, body.centre, place - body.centre))


def _nearest(matrix: FloatArray) -> FloatArray:
    """Return the rotation nearest to a matrix."""
    left, _, right = np.linalg.svd(matrix)
    return np.asarray(left @ right)


def _cross(vector: FloatArray) -> FloatArray:
    """Return the matrix of the cross product with a vector from the left."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _axial(matrix: FloatArray) -> FloatArray:
    """Return the axial vector of a matrix' skew part: of a small rotation the rotation vector."""
    return np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]]) / 2
