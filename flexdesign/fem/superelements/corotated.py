"""Large displacements of a stage: bodies that move as they will, and parts that deform little in a corotated frame.

A body's motion is the displacement of its centre and a rotation matrix R_b. A part is seen from a frame that goes
along, its origin the mean of its ports' points and its rotation R the mean of its bodies' (the orthogonal matrix
nearest to it): in that frame a port's point has moved by, and its face turned by,

    d = R^T (x - x_0) - (X - X_0),     theta = log(R^T R_b),

small both, which are the amplitudes of `second_order` (Felippa and Haugen, 2005, Computer Methods in Applied Mechanics
and Engineering 194, on the co-rotational description). With omega the spin of the frame and phi_b those of the bodies,
all seen from it, p = R^T (x - x_0), Q_b = R^T R_b and S their mean,

    delta d = R^T (delta x - delta x_0) - omega x p,     delta theta = T(theta) (phi_b - omega),
    (tr S - S) omega = mean_b (tr Q_b - Q_b) phi_b,

T being the inverse of the tangent map of rotations. By virtual work the forces on the bodies are the exact gradient of
the strain energy. Equilibrium is found by Newton's method, what is out of balance at the start being taken away in
steps where need be; its tangent holds what stresses add as parts turn, made symmetric, which it is in equilibrium.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexdesign.design.assembly import Assembly, Element
from flexdesign.fem.superelements.second_order import SecondOrder

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Newton's method ends with the step after the residual has fallen to this share of the load: rounding alone leaves
#: 5e-8, as hinges hardly stretch. After this number of steps the load is halved, down to this share.
TOLERANCE, MOST_STEPS, SMALLEST_SHARE = 1e-6, 15, 1e-3

#: Cross products with the unit vectors as matrices (3, 3, 3).
_CROSS = np.cross(np.eye(3)[:, None], np.eye(3)).swapaxes(-1, -2)


class NoEquilibrium(ArithmeticError):
    """There is none that is stable, the stage buckling before, or none that Newton's method finds."""


@dataclass(frozen=True, eq=False)
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
        Energy of each element, by its name; equal elements share one.
    """

    def __init__(self, assembly: Assembly, parts: Mapping[str, SecondOrder]) -> None:
        self.assembly = assembly
        self._body = {body.name: i for i, body in enumerate(assembly.free_bodies)}
        self._actuator = {name: i for i, name in enumerate(assembly.driven)}
        self.size = 6 * len(self._body) + len(self._actuator)
        order = sorted(assembly.elements, key=lambda element: id(parts[element.name]))
        kinds = itertools.groupby(order, lambda element: id(parts[element.name]))
        self._kinds = [self._kind(list(elements), parts) for _, elements in kinds]

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
        """Return the stable state in which all forces and moments are balanced.

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
        state, dead = start or self.rest, np.zeros(self.size)
        if loads is not None:
            dead[: loads.size] = loads.ravel()
        softness, rounding = self._softness
        first = dead - self.forces_and_tangent(state, actuators)[0]
        applied = dead - self.forces_and_tangent(self.rest, actuators)[0]
        tolerance = TOLERANCE * np.abs(softness * [first, applied]).max() + 10 * rounding
        share, step = 0.0, 1.0
        while share < 1.0:
            aim = min(share + step, 1.0)
            found = self._balance(state, actuators, dead - (1.0 - aim) * first, tolerance)
            if found is not None:
                state, share = found, aim
            elif (step := step / 2) < SMALLEST_SHARE:
                remedy = "the stage buckles there, or the load is larger than its parts bear"
                raise NoEquilibrium(f"no stable equilibrium beyond {share:.3g} of the load was found: {remedy}")
        return state

    def _balance(
        self, state: State, actuators: Mapping[str, float], dead: FloatArray, tolerance: float
    ) -> State | None:
        """Return the equilibrium that Newton's method goes to, or None if it goes to none or to an unstable one."""
        softness, _ = self._softness
        for _ in range(MOST_STEPS):
            forces, tangent = self.forces_and_tangent(state, actuators)
            residual, alike = softness * (dead - forces), softness[:, None] * tangent * softness
            try:
                state = self.displace(state, softness * scipy.linalg.solve(alike, residual, assume_a="sym"))
            except (np.linalg.LinAlgError, ValueError):  # singular, or no longer finite
                return None
            if np.abs(residual).max() <= tolerance:
                return state if _is_positive(alike) else None
        return None

    def forces_and_tangent(self, state: State, actuators: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """Return forces and moments that hold the bodies against parts and actuators, (size,), and their tangent."""
        total, tangent = np.zeros(self.size + 1), np.zeros((self.size + 1, self.size + 1))
        for kind in self._kinds:
            seen = kind.corotate(*self._body_motions(kind, state))
            push = np.array([actuators.get(name, 0.0) for name in kind.names])
            stress = kind.law.forces(seen.amplitudes) - np.multiply.outer(push, kind.law.extension)
            forces, stiffness = seen.pulled_back(stress, kind.law.tangent(seen.amplitudes))
            np.add.at(total, kind.places, forces)
            np.add.at(tangent, (kind.places[:, :, None], kind.places[:, None, :]), stiffness)
        return total[:-1], tangent[:-1, :-1]

    def extension(self, state: State, element: str) -> float:
        """Return how far an element's inputs have parted [m]."""
        kind = next(kind for kind in self._kinds if element in kind.names)
        amplitudes = kind.corotate(*self._body_motions(kind, state)).amplitudes[kind.names.index(element)]
        return float(kind.law.extension @ amplitudes)

    def energy(self, state: State) -> float:
        """Return the strain energy [J]."""
        kinds = self._kinds
        return sum(
            float(kind.law.energy(kind.corotate(*self._body_motions(kind, state)).amplitudes).sum()) for kind in kinds
        )

    def displace(self, state: State, step: FloatArray) -> State:
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
    def _softness(self) -> tuple[FloatArray, float]:
        """Makes forces and moments alike: the root of how far each unknown gives way to a unit load of its own.

        And what rounding leaves of forces at rest, made alike.
        """
        forces, tangent = self.forces_and_tangent(self.rest, {})
        softness = np.sqrt(np.diag(np.linalg.inv(tangent)))
        return softness, float(np.abs(softness * forces).max())

    def _body_motions(self, kind: _Kind, state: State) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return a kind's displacements (m, n, 3) and rotations (m, n, 3, 3) of bodies, and `pushed` (m, 0 or 1).

        All that is fixed is one body more, the last.
        """
        displacements = np.concatenate([state.displacements, np.zeros((1, 3))])
        rotations = np.concatenate([state.rotations, np.eye(3)[None]])
        return displacements[kind.bodies], rotations[kind.bodies], state.pushed[kind.actuators]

    def _kind(self, elements: list[Element], parts: Mapping[str, SecondOrder]) -> _Kind:
        ports = [port for port in elements[0].part.ports() if port.role != "input"]
        points = np.array([port.point for port in ports])
        bonds = [[self.assembly.body(element.bonds[port.name]) for port in ports] for element in elements]
        bodies = np.array([[self._body.get(body.name, len(self._body)) for body in row] for row in bonds])
        driven = [[self._actuator[element.name]] if element.name in self._actuator else [] for element in elements]
        actuators = np.array(driven, dtype=np.int64)
        # Unknowns of each element; the fixed bodies' go to the last place, which is thrown away.
        of_bodies = np.where(bodies[:, :, None] < len(self._body), 6 * bodies[:, :, None] + np.arange(6), self.size)
        centres = np.array([[body.centre for body in row] for row in bonds])
        return _Kind(
            names=[element.name for element in elements],
            law=parts[elements[0].name],
            bodies=bodies,
            actuators=actuators,
            places=np.hstack([of_bodies.reshape(len(elements), -1), 6 * len(self._body) + actuators]),
            centres=centres,
            arms=np.array([element.placement.outside(points) for element in elements]) - centres,
            rotations=np.array([element.placement.matrix for element in elements]),
            spread=points - points.mean(axis=0),
        )


@dataclass(frozen=True, eq=False)
class _Kind:
    """Elements that are one part, m in number with n ports each, at rest.

    Their bodies (m, n) and, if driven, actuators (m, 1), their places among the unknowns (m, 6 n or 6 n + 1), centres
    of the bodies and the arms from there to the ports (m, n, 3) [m], the parts' rotations (m, 3, 3), and the ports'
    points from their mean in the part's frame (n, 3) [m].
    """

    names: list[str]
    law: SecondOrder
    bodies: IntArray
    actuators: IntArray
    places: IntArray
    centres: FloatArray
    arms: FloatArray
    rotations: FloatArray
    spread: FloatArray

    def corotate(self, displacements: FloatArray, rotations: FloatArray, pushed: FloatArray) -> _Corotated:
        """Return corotated parts: bodies' displacements and rotations as `_body_motions` returns them."""
        (m, n), own = self.bodies.shape, self.rotations[:, None]
        arms = np.einsum("mnij,mnj->mni", rotations, self.arms)
        points = self.centres + displacements + arms  # from the bodies' centres before the motion
        frame = (_nearest(rotations.mean(axis=1)) @ self.rotations)[:, None]
        inward = frame.swapaxes(-1, -2)
        local = ((points - points.mean(axis=1, keepdims=True))[:, :, None] @ frame)[:, :, 0]
        turned = inward @ rotations @ own
        angles = Rotation.from_matrix(turned.reshape(-1, 3, 3)).as_rotvec().reshape(m, n, 3)
        # Of displacements and spins of the bodies: motions and spins of the ports, and the spin of the frame.
        translations, spins = np.zeros((2, m, n, 3, 6 * n))
        for i in range(n):
            at, about = slice(6 * i, 6 * i + 3), slice(6 * i + 3, 6 * i + 6)
            translations[:, i, :, at] = spins[:, i, :, about] = inward[:, 0]
            translations[:, i, :, about] = -inward[:, 0] @ _cross(arms[:, i])
        whole = np.linalg.solve(_less(turned.mean(axis=1)), (_less(turned) @ spins).mean(axis=1))
        way = translations - translations.mean(axis=1, keepdims=True) + _cross(local) @ whole[:, None]
        turn = _of_angles(angles) @ (spins - whole[:, None])
        extra = pushed.shape[1]
        jacobian = np.zeros((m, 6 * n + extra, 6 * n + extra))
        jacobian[:, : 6 * n, : 6 * n] = np.concatenate([way, turn], axis=2).reshape(m, 6 * n, 6 * n)
        jacobian[:, 6 * n :, 6 * n :] = np.eye(extra)
        bodies = np.concatenate([local - self.spread, angles], axis=2).reshape(m, 6 * n)
        return _Corotated(np.hstack([bodies, pushed]), jacobian, (translations, spins, way, whole), arms, frame)


@dataclass(frozen=True, eq=False)
class _Corotated:
    """Parts in their corotated frames: amplitudes (m, k), their derivatives by the unknowns (m, k, k).

    `variations` are motions and spins of the ports, their motions less the frame's (m, n, 3, 6 n), and the frame's spin
    (m, 3, 6 n), all in the frame (m, 1, 3, 3); `arms` those of the ports outside (m, n, 3).
    """

    amplitudes: FloatArray
    jacobian: FloatArray
    variations: tuple[FloatArray, FloatArray, FloatArray, FloatArray]
    arms: FloatArray
    frame: FloatArray

    def pulled_back(self, stress: FloatArray, stiffness: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return forces (m, k) and tangents (m, k, k) by the unknowns, from those by the amplitudes."""
        turned = self.jacobian.swapaxes(1, 2)
        forces = (turned @ stress[:, :, None])[:, :, 0]
        tangent = turned @ stiffness @ self.jacobian
        count = self.variations[0].shape[-1]
        tangent[:, :count, :count] += self._geometric(forces[:, :count].reshape(*self.arms.shape[:2], 6))
        return forces, tangent

    def _geometric(self, forces: FloatArray) -> FloatArray:
        """Return what forces and moments on the bodies (m, n, 6) add to the tangent as the parts turn, symmetric."""
        translations, spins, way, whole = self.variations
        moments = forces[..., 3:] - np.cross(self.arms, forces[..., :3])
        push, twist = (_cross((each[:, :, None] @ self.frame)[:, :, 0]) for each in (forces[..., :3], moments))
        swung = self.frame.swapaxes(-1, -2) @ _cross(forces[..., :3]) @ _cross(self.arms) @ self.frame
        moved, spun, turned = translations.swapaxes(-1, -2), spins.swapaxes(-1, -2), whole.swapaxes(-1, -2)[:, None]
        about_frame = (moved @ push + spun @ twist) @ whole[:, None]
        turning = (turned @ push @ way - about_frame + spun @ swung @ spins).sum(axis=1)
        return (turning + turning.swapaxes(1, 2)) / 2


def _is_positive(matrix: FloatArray) -> bool:
    """Tell whether a symmetric matrix is positive definite."""
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True


def _nearest(matrices: FloatArray) -> FloatArray:
    """Return the rotations nearest to matrices (..., 3, 3)."""
    left, _, right = np.linalg.svd(matrices)
    return np.asarray(left @ right)


def _cross(vectors: FloatArray) -> FloatArray:
    """Return the matrices (..., 3, 3) of the cross product with vectors (..., 3) from the left."""
    return np.tensordot(vectors, _CROSS, axes=1)


def _less(matrices: FloatArray) -> FloatArray:
    """Return tr A - A, which takes a to twice the axial vector of the skew part of (a x) A."""
    return np.asarray(np.trace(matrices, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - matrices)


def _of_angles(angles: FloatArray) -> FloatArray:
    """Return T of rotation vectors (..., 3): 1 - (theta x) / 2 + (1 / 12 + theta^2 / 720 + ...) (theta x)^2.

    The series is that of (1 - theta/2 cot(theta/2)) / theta^2; the terms left out are 1e-9 at 1 rad.
    """
    square, cross = np.sum(angles**2, axis=-1)[..., None, None], _cross(angles)
    factor = np.polynomial.polynomial.polyval(square, [1 / 12, 1 / 720, 1 / 30240, 1 / 1209600, 1 / 47900160])
    return np.asarray(np.eye(3) - cross / 2 + factor * cross @ cross)
