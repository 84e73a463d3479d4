"""Three-dimensional FEM of one design among many: a coarse mesh morphed from a neighbour's, its error known from there.

On two coarse meshes A and B (B the finer) each design has three numbers p: C11, lambda and C22 - C12^2 / C11, from
which all quantities of input and output follow. At an anchor, a design that is solved on three fine meshes as well,
the limit p* and with it the error of B is known,

    g = ln(p* / p_B).

As the neighbours' meshes are the anchor's triangles moved (`fem.morphing`), g changes smoothly and little from design
to design, and p* = p_B exp(g). How far it may have changed is seen from the step between the two coarse meshes, which
is known everywhere, and from the distance d, the root of the sum of squared relative differences of the dimensions:
with r = ln(p_B / p_A), the half-width of a design's error is

    sigma = root(sigma_anchor^2 + max |r - r_anchor|^2 + (DRIFT d)^2),

the largest step over the three numbers, as they share their hinges. Where sigma exceeds the accuracy, or no mesh can be
morphed, the design becomes an anchor itself. Between several anchors g and r are weighted by the inverse square of the
distance (Shepard 1968).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity
from flexdesign.design.design import Design
from flexdesign.design.part import Part
from flexdesign.design.study import MeshSettings, OutputSettings
from flexdesign.fem import convergence
from flexdesign.fem.meshing import morphing, resolution_gate
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.extruded import stack_prisms
from flexdesign.fem.meshing.mesh import MeshError, TaggedMesh
from flexdesign.fem.meshing.methods import Extruded
from flexdesign.fem.meshing.morphing import Pattern
from flexdesign.fem.multifidelity import extrusion
from flexdesign.fem.multifidelity.further import MORPHED, AdditionalQuantities, Known
from flexdesign.fem.quantities import of_compliance
from flexdesign.fem.solving import port_compliance, statics
from flexdesign.fem.solving.elasticity import Elasticity
from flexdesign.fem.solving.solver import Factor, NotEnoughMemory
from flexdesign.fem.solving.statics import PortCompliance

FloatArray = NDArray[np.float64]

#: Coarseness of the meshes B and A; finer pairs where the first cannot be had, as fillets ask for.
PAIRS = ((2.46, 3.32), (1.82, 2.46), (1.35, 1.82))
#: Coarseness of an anchor's meshes, coarse to fine; with an accuracy below `FINE` one more, finer.
ANCHORING, FINE = (1.82, 1.35, 1.0), 3e-3
FINEST = 1 / 1.35
#: On how many of an anchor's meshes modes are found, coarse to fine: they converge sooner, and the last takes longest.
WITH_MODES = 2
#: By how much the error of the coarse mesh may change with the distance, in addition to what the steps show: measured
#: on the sample of `studies.benchmarks.sweep_evaluators`.
DRIFT = 0.015


@dataclass
class Coarse:
    """A coarse mesh that moves from design to design.

    Parameters
    ----------
    coarseness
        As `Extruded` takes it.
    pattern
        Its triangles.
    body
        The discretised body of the first design.
    factor
        Of the latest matrix; it knows the order of elimination.
    """

    coarseness: float
    pattern: Pattern
    body: Elasticity
    factor: Factor | None = None

    @classmethod
    def of(cls, design: Design, method: Extruded, coarseness: float) -> Coarse:
        """Mesh anew; raise MeshError if that cannot be done."""
        plan = method.plan(coarseness)
        mesh = stack_prisms(plan, method.section, method.heights(coarseness))
        pattern = Pattern(method.section, method.planar_size(coarseness), plan)
        return cls(coarseness, pattern, Elasticity(mesh, design.material))

    def morph(self, method: Extruded) -> TaggedMesh:
        """Return the mesh moved to another design; raise MeshError if it cannot be used there."""
        plan = self.pattern.morph(method.section, method.planar_size(self.coarseness))
        layers = len(self.body.mesh.points) // len(self.pattern.plan.points) - 1
        return morphing.morph(self.body.mesh, plan, method.section, method.heights(self.coarseness, layers))

    def numbers(self, design: Design, part: Part, domain: Domain, method: Extruded) -> FloatArray:
        """Return the three numbers of a design, on the mesh moved to it; raise MeshError if it cannot be used."""
        mesh = self.morph(method)
        resolution_gate.check(mesh, domain, part.linkage().of_kind("hinge"))
        body = self.body.on_mesh(mesh, design.material)
        known, self.factor = self.factor, None  # lost if what follows fails
        compliance, self.factor = solve(part, domain, body, known)
        return three(compliance)


@dataclass
class Anchor:
    """A design whose limit is known.

    Parameters
    ----------
    place
        Its `extrusion.coordinates`.
    step, gap
        r and g of the module's formulas, for each of the three numbers.
    error
        Half-width of the limit, relative, for each.
    additional
        The same of what is asked besides.
    """

    place: dict[str, float]
    step: FloatArray
    gap: FloatArray
    error: FloatArray
    additional: Known = field(default_factory=Known)


@dataclass
class Family:
    """Designs that share their meshes' triangles.

    Parameters
    ----------
    crystal
        Elastic constants of the crystal they are cut from, or None.
    meshes
        B and A.
    anchors
        Those of them whose limit is known.
    """

    crystal: list[object] | None
    meshes: tuple[Coarse, Coarse]
    anchors: list[Anchor] = field(default_factory=list)

    def weights(self, place: dict[str, float]) -> FloatArray:
        """Return the anchors' weights at a place, of sum one."""
        apart = np.array([extrusion.distance(anchor.place, place) for anchor in self.anchors])
        if apart.min() < 1e-12:
            return np.asarray(np.eye(len(apart))[apart.argmin()])
        return np.asarray(apart**-2.0 / (apart**-2.0).sum())


class FastSolid:
    """An evaluator of designs that keeps what it learns: meshes, orders of elimination, and errors.

    Parameters
    ----------
    accuracy
        Relative error asked of stiffnesses and amplification, as estimated.
    mesh
        How meshes are graded; its method, levels and accuracy are of no account here.
    output
        What happens at the output; of no account besides its load unless modes are asked for.
    modes
        How many modes of each symmetry class are sought; with any, all quantities of `quantities.of_solution` come
        along: frequencies, coupling, motions of the table, stress of the hinges. That takes several times as long.
    anchors
        Designs that are made anchors at once. Without them the first design that is evaluated becomes the first. With
        the same anchors evaluators in several processes answer alike to what the accuracy leaves open.
    """

    def __init__(
        self,
        accuracy: float = 0.01,
        mesh: MeshSettings | None = None,
        output: OutputSettings | None = None,
        modes: int = 0,
        anchors: Sequence[Design] = (),
    ) -> None:
        self.accuracy, self.mesh, self.output = accuracy, mesh or MeshSettings(), output or OutputSettings()
        self.further = AdditionalQuantities(modes, self.output) if modes else None
        self.families: list[Family] = []
        for design in anchors:
            self.anchor(design)

    def evaluate(self, design: Design) -> list[Quantity]:
        """Return the quantities of `quantities.of_compliance`; their sigma is the estimated half-width of the error.

        Raises
        ------
        InputError
            If the design cannot be built, meshed or solved.
        """
        part, domain = extrusion.of_design(design)
        method = extrusion.method(part, domain, self.mesh)
        place, crystal = extrusion.coordinates(design), _crystal(design)
        for family in self.families:
            if family.crystal != crystal or set(family.anchors[0].place) != set(place):
                continue
            try:
                fine, coarse = (mesh.numbers(design, part, domain, method) for mesh in family.meshes)
            except MeshError:
                continue
            weights = family.weights(place)
            step, gap, error = (
                weights @ np.array([getattr(anchor, name) for anchor in family.anchors])
                for name in ("step", "gap", "error")
            )
            away = min(extrusion.distance(anchor.place, place) for anchor in family.anchors)
            changed = np.hypot(np.abs(np.log(fine / coarse) - step).max(), DRIFT * away)
            sigma = np.hypot(error, changed)
            # An anchor nearer than this would know no better: its own limit is as uncertain.
            if sigma.max() <= max(self.accuracy, 1.2 * error.max()):
                quantities = self._quantities(design, fine * np.exp(gap), sigma, MORPHED)
                return quantities + self._besides(design, part, domain, method, family, quantities, changed)
            return self._solve_anchor(design, part, domain, method, family)
        return self._solve_anchor(design, part, domain, method, None)

    def anchor(self, design: Design) -> list[Quantity]:
        """Make a design an anchor, and return its quantities; raise InputError as `evaluate` does."""
        part, domain = extrusion.of_design(design)
        method = extrusion.method(part, domain, self.mesh)
        for family in self.families:
            if family.crystal == _crystal(design) and morphing.have_same_topology(
                family.meshes[0].pattern.section, method.section
            ):
                try:
                    return self._solve_anchor(design, part, domain, method, family)
                except MeshError:
                    continue
        return self._solve_anchor(design, part, domain, method, None)

    def _solve_anchor(
        self, design: Design, part: Part, domain: Domain, method: Extruded, family: Family | None
    ) -> list[Quantity]:
        """Solve on fine meshes, remember the errors of the coarse ones, and return the limits."""
        try:
            known = family or Family(_crystal(design), _pair(design, part, domain, method))
            fine, coarse = (mesh.numbers(design, part, domain, method) for mesh in known.meshes)
        except MeshError as error:
            if family is not None:
                raise
            raise InputError(design.file, "mesh", None, str(error)) from error
        extrusion.require_solid(design, part, domain)
        limits, errors, meshes, sizes = self._limits(design, part, domain, method)
        anchor = Anchor(extrusion.coordinates(design), np.log(fine / coarse), np.log(limits / fine), errors)
        if self.further is not None:
            found = [
                self.further.on(mesh, design, part, domain)
                for mesh in (known.meshes[0].morph(method), *meshes[:WITH_MODES])
            ]
            anchor.additional = self.further.anchor_errors(found[0], found[1:], sizes[:WITH_MODES], method.scatter)
        known.anchors.append(anchor)
        if family is None:
            self.families.append(known)
        quantities = self._quantities(design, limits, errors, "FEM, anchor: fine meshes, extrapolated")
        return quantities + self._besides(design, part, domain, method, known, quantities, 0.0)

    def _besides(
        self,
        design: Design,
        part: Part,
        domain: Domain,
        method: Extruded,
        family: Family,
        quantities: Sequence[Quantity],
        changed: float,
    ) -> list[Quantity]:
        """Return the further quantities asked for, corrected; the errors may have `changed`, relative."""
        if self.further is None:
            return []
        found = self.further.on(family.meshes[0].morph(method), design, part, domain)
        rest = {key: quantity for key, quantity in found.items() if key not in {q.key for q in quantities}}
        weights = family.weights(extrusion.coordinates(design)).tolist()
        return self.further.correct(rest, [anchor.additional for anchor in family.anchors], weights, changed)

    def _limits(
        self, design: Design, part: Part, domain: Domain, method: Extruded
    ) -> tuple[FloatArray, FloatArray, list[TaggedMesh], list[float]]:
        """Return the limits of the three numbers, their relative half-widths, the meshes and their edge lengths."""
        found, meshes, sizes = [], [], []
        for coarseness in (*ANCHORING, *((FINEST,) if self.accuracy < FINE else ())):
            try:
                mesh = method.mesh(coarseness)
                resolution_gate.check(mesh, domain, part.linkage().of_kind("hinge"))
                compliance, factor = solve(part, domain, Elasticity(mesh, design.material))
            except MeshError as error:  # too coarse for a fillet: two others will do
                if coarseness > max(ANCHORING[-2:]):
                    continue
                raise InputError(design.file, "mesh", None, str(error)) from error
            except NotEnoughMemory as error:
                raise InputError(design.file, "mesh", None, f"{error}; ask for less accuracy") from error
            factor.free()
            found.append(three(compliance))
            meshes.append(mesh)
            sizes.append(method.size(mesh, coarseness))
        stiff = np.array(found)[:, 0]
        limit = convergence.extrapolate(stiff.tolist(), sizes, mesh_noise=method.scatter).value
        errors = np.abs(stiff / limit - 1).tolist()
        all_limits = [
            convergence.extrapolate(values.tolist(), sizes, mesh_noise=method.scatter, remaining_errors=errors)
            for values in np.array(found).T
        ]
        values = np.array([each.value for each in all_limits])
        return values, np.array([each.error for each in all_limits]) / np.abs(values), meshes, sizes

    def _quantities(self, design: Design, numbers: FloatArray, sigma: FloatArray, source: str) -> list[Quantity]:
        """Return the quantities, their half-widths from those of the three numbers, in quadrature."""

        def all_of(these: FloatArray) -> list[Quantity]:
            return of_compliance(of_three(these), design.actuator, self.output.load)

        found = all_of(numbers)
        shifts = [all_of(numbers * np.where(np.arange(3) == i, 1 + sigma[i], 1.0)) for i in range(3)]
        return [
            replace(q, half_width=float(np.hypot.reduce([s[i].value - q.value for s in shifts])), source=source)
            for i, q in enumerate(found)
        ]


def three(compliance: PortCompliance) -> FloatArray:
    """Return C11, lambda and C22 - C12^2 / C11: of one sign each, and none a small difference of others."""
    c11, c12, c22 = compliance.c11, compliance.c12, compliance.c22
    return np.array([c11, c12 / c11, c22 - c12**2 / c11])


def of_three(numbers: FloatArray) -> PortCompliance:
    """Return the compliance that has these three numbers.

    >>> of_three(three(PortCompliance(np.array([[2.0, 1.0], [1.0, 3.0]]), np.eye(2)[0], np.eye(2)[1]))).matrix
    array([[2., 1.],
           [1., 3.]])
    """
    c11, ratio, held = numbers
    matrix = np.array([[c11, ratio * c11], [ratio * c11, held + ratio**2 * c11]])
    return PortCompliance(matrix, np.array([1.0, 0.0]), np.array([0.0, 1.0]))


def solve(part: Part, domain: Domain, body: Elasticity, factor: Factor | None = None) -> tuple[PortCompliance, Factor]:
    """Solve the symmetric class for input and output, with the order of elimination of a `factor` if that fits."""
    stiffness = body.stiffness(zeros=True)
    held = [domain.ports[port.name] for port in part.ports() if port.role == "ground" and port.name in domain.ports]
    space, cls = port_compliance.port_space(body, domain, part.ports()), port_compliance.classes(domain)[0]
    system = statics.class_system(body, domain, cls, stiffness, held, factor)
    if factor is not None and system.factor is not factor:
        factor.free()
    compliance, checks = statics.drive_compliance(body, system, stiffness, space)
    checks.require()
    return compliance, system.factor


def _pair(design: Design, part: Part, domain: Domain, method: Extruded) -> tuple[Coarse, Coarse]:
    """Mesh a design anew, twice; raise MeshError if no pair of meshes passes the gate."""
    refused: MeshError | None = None
    for fine, coarse in PAIRS:
        try:
            meshes = Coarse.of(design, method, fine), Coarse.of(design, method, coarse)
            for mesh in meshes:
                resolution_gate.check(mesh.body.mesh, domain, part.linkage().of_kind("hinge"))
            return meshes
        except MeshError as error:
            refused = error
    assert refused is not None
    raise refused


def _crystal(design: Design) -> list[object] | None:
    return None if design.material.crystal is None else [design.material.crystal.tensor.tolist()]
