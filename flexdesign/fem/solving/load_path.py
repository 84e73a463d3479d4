"""Equilibrium under a growing load, displacements large: Newton's method from one load level to the next.

At each level the tangent is factorized once more, so that the stiffness there, and the start for the next level, are
exact derivatives and no differences.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.design.materials import Material
from flexdesign.design.part import Part
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.mesh import TaggedMesh
from flexdesign.fem.solving import port_compliance, statics
from flexdesign.fem.solving.elasticity import Elasticity
from flexdesign.fem.solving.large_displacement import LargeDisplacement
from flexdesign.fem.solving.solver import NotPositiveDefinite, factorize

FloatArray = NDArray[np.float64]

#: A level is solved when a correction is this small, relative to the largest displacement.
CONVERGED = 1e-7
#: A step is given up after this number of iterations, or growth of the residual; then it is halved,
#: down to this share of what was asked for.
MOST_ITERATIONS, GROWN, SMALLEST_STEP = 15, 100.0, 1e-3


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """The body at one load level.

    Parameters
    ----------
    level
        Multiple of the load.
    displacement
        Of all degrees of freedom, shape (n_dofs,) [m].
    rates
        Their derivatives with respect to each probing load at this level, shape (n_dofs, k) [m/N]; the first is the
        load of the path.
    iterations
        Newton steps that it took.
    residual
        Out-of-balance force before the last correction, over the largest load of the path.
    """

    level: float
    displacement: FloatArray
    rates: FloatArray
    iterations: int
    residual: float


def load_path(
    model: LargeDisplacement,
    loads: FloatArray,
    levels: Sequence[float],
) -> Iterator[Equilibrium]:
    """Yield equilibria under multiples of a dead load, one after the other.

    Parameters
    ----------
    model
        The body.
    loads
        Nodal forces, shape (n_dofs, k) [N]: the load of the path, then others whose rates are wanted.
    levels
        Multiples of the first load, each reached from the one before.

    Raises
    ------
    ArithmeticError
        If a level is not reached: the body buckles before it.
    """
    walk = _LoadPath(model, loads, max(map(abs, levels)))
    for level in levels:
        yield walk.to(level)
    walk.factor.free()


class _LoadPath:
    """Where a load path has got to: an equilibrium, and the tangent's factor there."""

    def __init__(self, model: LargeDisplacement, loads: FloatArray, largest: float) -> None:
        self.model, self.loads = model, loads
        self.scale = float(np.linalg.norm(loads[model.free, 0])) * largest
        self.level, self.displacement = 0.0, np.zeros(len(loads))
        self.factor = factorize(model.forces_and_tangent(self.displacement)[1])
        self.rates = self._rates()

    def to(self, level: float) -> Equilibrium:
        """Go to a level, in smaller steps where a larger one fails."""
        step, iterations = level - self.level, 0
        smallest = SMALLEST_STEP * abs(step)
        while self.level != level:
            step = np.copysign(min(abs(step), abs(level - self.level)), step)
            aim = level if step == level - self.level else self.level + step
            reached, done = self._step(aim)
            iterations += reached
            if not done:
                step *= 0.5
                if abs(step) < smallest:
                    remedy = "it buckles there, or is loaded beyond what an elastic body bears"
                    raise ArithmeticError(f"no equilibrium beyond {self.level:.4g} times the load: {remedy}")
        return Equilibrium(level, self.displacement.copy(), self.rates.copy(), iterations, self.residual)

    def _step(self, aim: float) -> tuple[int, bool]:
        """Try one step; return how many iterations it took, and whether it arrived. If not, nothing has changed."""
        free, model = self.model.free, self.model
        displacement = self.displacement + (aim - self.level) * self.rates[:, 0]
        factor, worst = None, np.inf
        for iteration in range(1, MOST_ITERATIONS + 1):
            forces, tangent = model.forces_and_tangent(displacement)
            left = aim * self.loads[free, 0] - forces[free]
            residual = float(np.linalg.norm(left)) / self.scale
            if factor is not None:
                factor.free()
            if not residual < GROWN * worst:  # false for NaN
                return iteration, False
            worst = min(worst, residual)
            try:
                factor = factorize(tangent)
            except NotPositiveDefinite:
                return iteration, False
            correction = factor.solve(left)
            displacement[free] += correction
            if np.abs(correction).max() < CONVERGED * np.abs(displacement).max():  # Newton's next error is its square
                self.factor.free()
                self.level, self.displacement, self.factor = aim, displacement, factor
                self.rates, self.residual = self._rates(), residual
                return iteration, True
        return MOST_ITERATIONS, False

    def _rates(self) -> FloatArray:
        rates, free = np.zeros(self.loads.shape), self.model.free
        rates[free] = self.factor.solve(self.loads[free])
        return rates


@dataclass(frozen=True)
class StrokePath:
    """What a part does as its actuator pushes further, output free; each array has a value for each force.

    Parameters
    ----------
    force
        Actuator force, the first one zero [N].
    extension, output
        Motion at the input and of the output [m].
    input_stiffness, output_stiffness
        Tangents there: actuator force per extension, output free; output force per motion, actuator force kept [N/m].
    amplification
        Tangent there: output motion per extension.
    """

    force: FloatArray
    extension: FloatArray
    output: FloatArray
    input_stiffness: FloatArray
    output_stiffness: FloatArray
    amplification: FloatArray


def stroke_path(
    part: Part,
    material: Material,
    domain: Domain,
    mesh: TaggedMesh,
    forces: Sequence[float],
    *,
    enough: Callable[[float, float], bool] = lambda force, extension: False,
) -> StrokePath:
    """Push with the actuator in steps and return motions and tangents on the way.

    Parameters
    ----------
    part, material, domain, mesh
        What is pushed.
    forces
        Actuator forces [N], growing in size, none of them zero.
    enough
        Tells from force [N] and extension [m], after each step, whether to stop there.

    Raises
    ------
    ArithmeticError
        If a force is not reached.
    """
    body = Elasticity(mesh, material)
    held = [domain.ports[port.name] for port in part.ports() if port.role == "ground" and port.name in domain.ports]
    space, cls = port_compliance.port_space(body, domain, part.ports()), port_compliance.classes(domain)[0]
    shares = space.halves[:, None] * (space.projection(cls) @ np.column_stack([space.extension, space.output]))
    loads = np.hstack([space.loads[name] for name in space.retained]) @ shares
    free = statics.free_dofs(body, domain, cls, held)
    work = 2 ** len(domain.planes) * loads
    rows = []
    path = load_path(LargeDisplacement(body, free), loads, [1e-6 * forces[0], *forces])
    for point in path:
        extension, output = work.T @ point.displacement
        (c11, _), (c12, c22) = work.T @ point.rates
        rows.append((point.level, extension, output, 1 / c11, 1 / c22, c12 / c11))
        if enough(point.level, extension):
            break
    rows[0] = (0.0, 0.0, 0.0, *rows[0][3:])
    return StrokePath(*np.array(rows).T)
