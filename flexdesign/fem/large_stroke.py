"""What large displacements do to a part over its stroke: stiffness and amplification that change along the way.

A stage model knows three numbers of it. With y the output motion, the actuator in place, and d the motion that its
drive would cause in a linear part,

    y + q y^2 + c y^3 = d (1 + s d),

where q and c are quadratic and cubic stiffness over the linear one (effects `quadratic_stiffness`, `stress_stiffening`)
and s is the slope of the amplification (`stroke_dependent_amplification`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from flexdesign.core.model import Quantity
from flexdesign.design.materials import Material
from flexdesign.design.part import Part
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.mesh import TaggedMesh
from flexdesign.fem.solving.load_path import StrokePath, stroke_path
from flexdesign.fem.solving.statics import PortCompliance

#: Nothing is sought beyond this multiple of the force of linear theory.
FARTHEST = 3.0
#: Fraction of full drive from which progress is reported: the first step is tiny.
REPORTED_FROM = 0.01
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class LargeStroke:
    """A part pushed by its actuator, from rest to full drive and a little beyond.

    Parameters
    ----------
    path
        Motions and tangents at each force.
    actuator
        Stiffness of the actuator in place [N/m].
    free_stroke
        Extension of the free actuator at full voltage [m].
    """

    path: StrokePath
    actuator: float
    free_stroke: float

    @property
    def drive(self) -> FloatArray:
        """Share of the full voltage at each force: what the free actuator would have to extend by, over its stroke."""
        return (self.path.force / self.actuator + self.path.extension) / self.free_stroke

    @property
    def output_stiffness(self) -> FloatArray:
        """Output force per motion with the actuator in place, tangents at each force [N/m]."""
        c11 = 1 / self.path.input_stiffness
        c12, c22 = self.path.amplification * c11, 1 / self.path.output_stiffness
        return np.asarray(1 / (c22 - c12**2 / (c11 + 1 / self.actuator)))

    @property
    def linear_stroke(self) -> float:
        """Output motion at full drive as linear theory has it on this mesh [m]."""
        c11 = 1 / self.path.input_stiffness[0]
        return float(self.free_stroke * self.path.amplification[0] * c11 / (c11 + 1 / self.actuator))

    @property
    def full_stroke(self) -> float:
        """Output motion at full drive on this mesh [m], between the steps by cubics with the tangents at their ends."""
        path = self.path
        per_force = (1 / self.actuator + 1 / path.input_stiffness) / self.free_stroke  # drive
        rates = path.amplification / path.input_stiffness / per_force
        return float(CubicHermiteSpline(self.drive, path.output, rates)(1.0))

    def stroke(self, linear: Quantity) -> Quantity:
        """Return the output motion at full drive, freed from the linear part of this mesh's error.

        The linear stroke, which is extrapolated over several meshes, is multiplied by what large displacements make of
        it on this one. That ratio has an error, too: the change, times the relative error of the linear stroke here.

        Parameters
        ----------
        linear
            The linear stroke with its discretisation error.
        """
        ratio, here = self.full_stroke / self.linear_stroke, self.linear_stroke / linear.value - 1
        own = abs(linear.half_width or 0.0)
        sigma = math.hypot(ratio * own, (ratio - 1) * max(abs(here * linear.value), own))
        source = f"{linear.source}, times the effect of large displacements on the coarsest mesh".removeprefix(", ")
        return Quantity("stroke", ratio * linear.value, "m", "um", "output free, large displacements", source, sigma)

    def stiffening(self) -> tuple[float, float]:
        """Return q [1/m] and c [1/m^2]: least squares through the tangents 1 + 2 q y + 3 c y^2."""
        y, k = self.path.output[1:], self.output_stiffness
        (q, c), *_ = np.linalg.lstsq(np.column_stack([2 * y, 3 * y**2]), k[1:] / k[0] - 1, rcond=None)
        return float(q), float(c)

    def slope(self) -> float:
        """Return s [1/m]: least squares through the motions."""
        q, c = self.stiffening()
        y, d = self.path.output[1:], self.linear_stroke * self.drive[1:]
        return float((y + q * y**2 + c * y**3 - d) @ d**2 / (d**2 @ d**2))

    def effects(self) -> dict[str, Mapping[str, float]]:
        """Return the effects of the catalogue that represent it, with their values in SI."""
        q, c = self.stiffening()
        return {
            "quadratic_stiffness": {"quadratic": q},
            "stress_stiffening": {"cubic": c},
            "stroke_dependent_amplification": {"slope": self.slope()},
        }

    def quantities(self) -> list[Quantity]:
        """Return how much stiffnesses and amplification change from rest to full drive, on this mesh."""
        path, source = self.path, "FEM, large displacements, coarsest mesh"

        def change(tangents: FloatArray) -> float:
            return float(np.interp(1.0, self.drive, tangents) / tangents[0] - 1)

        return [
            Quantity("K_in_change", change(path.input_stiffness), "1", "%", "full drive, output free", source),
            Quantity("lambda_change", change(path.amplification), "1", "%", "full drive, output free", source),
            Quantity("K_out_change", change(self.output_stiffness), "1", "%", "full drive, actuator installed", source),
        ]


def follow(
    part: Part,
    material: Material,
    domain: Domain,
    mesh: TaggedMesh,
    linear: PortCompliance,
    actuator: float,
    free_stroke: float,
    steps: int,
    progress: Callable[[str], None] = lambda _: None,
) -> LargeStroke:
    """Push a part to full drive in steps of force.

    Parameters
    ----------
    part, material, domain, mesh
        What is pushed.
    linear
        Its compliance at rest.
    actuator, free_stroke
        Stiffness of the actuator in place [N/m], and its free extension at full voltage [m].
    steps
        Steps to the force that linear theory has at full drive; a part that stiffens takes more.
    progress
        Receives a text about the progress.

    Raises
    ------
    ArithmeticError
        If the part buckles on the way, or full drive is not reached.
    """
    full = linear.actuator_force(free_stroke, actuator)
    forces = [full * k / steps for k in range(1, int(FARTHEST * steps) + 1)]
    began = perf_counter()

    def enough(force: float, extension: float) -> bool:
        share = (force / actuator + extension) / free_stroke
        if REPORTED_FROM < share < 1:
            left = (perf_counter() - began) * (1 / share - 1)
            progress(f"{100 * share:.0f} % of full drive reached, {left:.0f} s left")
        return share >= 1

    progress(f"pushing to full drive in about {steps} steps")
    found = LargeStroke(stroke_path(part, material, domain, mesh, forces, enough=enough), actuator, free_stroke)
    if found.drive[-1] < 1.0:
        raise ArithmeticError(f"{FARTHEST:g} times the force of linear theory does not reach full drive")
    return found
