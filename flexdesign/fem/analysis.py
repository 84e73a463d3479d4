"""One part on one mesh, solved for everything a validation asks; a record that can be stored and read back."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from time import perf_counter
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flexdesign.design.materials import Material
from flexdesign.design.part import Part
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.mesh import TaggedMesh
from flexdesign.fem.post_processing import effective_mass, energy, resultants, stress
from flexdesign.fem.solving import modes, port_compliance, statics
from flexdesign.fem.solving.elasticity import Elasticity
from flexdesign.fem.solving.port_compliance import PortSpace
from flexdesign.fem.solving.statics import Checks, ClassSystem, PortCompliance

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Progress = Callable[[str], None]


@dataclass(frozen=True)
class ModeRecord:
    """What is kept of a `modes.Mode`, whether the actuator is installed, and its effective masses along x, y, z [kg].

    The masses are NaN where nobody asked for them.
    """

    frequency: float
    symmetry: str
    output_mass: float
    extension: float
    installed: bool
    effective_mass: tuple[float, float, float] = (math.nan, math.nan, math.nan)

    @classmethod
    def of(
        cls, mode: modes.Mode, *, installed: bool, effective_mass: tuple[float, float, float] = (math.nan,) * 3
    ) -> ModeRecord:
        """Return the record of a mode."""
        return cls(mode.frequency, mode.symmetry, mode.output_mass, mode.extension, installed, effective_mass)


@dataclass(frozen=True)
class Solution:
    """What one mesh says about one part.

    Parameters
    ----------
    compliance
        Between the ports.
    checks
        The worst of all solves.
    modes
        Lowest modes of each symmetry class, without and with the actuator, by frequency; empty if none were asked.
    input_sections, output_sections
        Section forces per unit actuator force and per unit output force.
    positions, nodes
        Where the nodes are, shape (n, 3) [m], and those of each element, corners then edge midpoints, shape (m, 10).
    input_field, output_field
        Displacements of the nodes per unit actuator force and per unit output force, shape (n, 3) [m/N].
    mode_shapes
        Displacements of the nodes in the modes with the actuator, or without where there is none, in the order of
        `modes`, shape (k, n, 3).
    von_mises, tension
        Von Mises stress and largest principal stress at the nodes per unit actuator force, shape (n,) [Pa/N].
    energies
        Strain energy of the whole part by kind of member: U_11, U_12, U_22 of `energy.by_region` for unit actuator
        force and unit output force [J/N^2].
    facts
        Numbers of the mesh and the solve for the report.
    thin_nodes
        Where stress is judged if the part names no hinges: nodes on what was found to be thin, shape (k,).
    peaks
        Largest von Mises stress on them per unit load on each motion of the output, shape (6,) [Pa/N, Pa/(N m)];
        empty where the part names its hinges.
    """

    compliance: PortCompliance
    checks: Checks
    modes: tuple[ModeRecord, ...]
    input_sections: tuple[resultants.Section, ...]
    output_sections: tuple[resultants.Section, ...]
    positions: FloatArray
    nodes: IntArray
    input_field: FloatArray
    output_field: FloatArray
    mode_shapes: FloatArray
    von_mises: FloatArray
    tension: FloatArray
    energies: dict[str, tuple[float, float, float]]
    facts: dict[str, Any]
    thin_nodes: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    peaks: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def whole(self) -> bool:
        """Whether the compliance holds all motions of the ports, of every symmetry class, of a part without members."""
        return bool(len(self.thin_nodes)) and bool(self.facts["every class"])

    def to_store(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays and a JSON-ready table from which `from_store` makes the same record."""
        arrays: dict[str, NDArray[Any]] = {
            "compliance": self.compliance.matrix,
            "extension": self.compliance.extension,
            "output": self.compliance.output,
            "input_sections": _rows(self.input_sections),
            "output_sections": _rows(self.output_sections),
            "positions": self.positions,
            "nodes": self.nodes.astype(np.int32),
            "input_field": self.input_field,
            "output_field": self.output_field,
            "mode_shapes": self.mode_shapes,
            "von_mises": self.von_mises,
            "tension": self.tension,
            "thin_nodes": self.thin_nodes,
            "peaks": self.peaks,
        }
        table = {
            "checks": asdict(self.checks),
            "modes": [asdict(mode) for mode in self.modes],
            "members": [section.member.name for section in self.input_sections],
            "energies": self.energies,
            "facts": self.facts,
        }
        return arrays, table

    @classmethod
    def from_store(cls, arrays: dict[str, NDArray[Any]], table: dict[str, Any], part: Part) -> Solution:
        """Rebuild a record from what `to_store` returned."""
        members = {member.name: member for member in part.linkage().members}

        def sections(rows: FloatArray) -> tuple[resultants.Section, ...]:
            return tuple(
                resultants.Section(members[name], *map(float, row))
                for name, row in zip(table["members"], rows, strict=True)
            )

        return cls(
            compliance=PortCompliance(arrays["compliance"], arrays["extension"], arrays["output"]),
            checks=Checks(**table["checks"]),
            modes=tuple(
                ModeRecord(**mode | {"effective_mass": tuple(mode["effective_mass"])}) for mode in table["modes"]
            ),
            input_sections=sections(arrays["input_sections"]),
            output_sections=sections(arrays["output_sections"]),
            positions=arrays["positions"],
            nodes=arrays["nodes"],
            input_field=arrays["input_field"],
            output_field=arrays["output_field"],
            mode_shapes=arrays["mode_shapes"],
            von_mises=arrays["von_mises"],
            tension=arrays["tension"],
            energies={region: tuple(three) for region, three in table["energies"].items()},
            facts=table["facts"],
            thin_nodes=arrays["thin_nodes"],
            peaks=arrays["peaks"],
        )


def solve(
    part: Part,
    material: Material,
    domain: Domain,
    mesh: TaggedMesh,
    *,
    actuator: float = 0.0,
    mode_count: int = 0,
    all_classes: bool = True,
    progress: Progress = lambda _: None,
) -> Solution:
    """Solve a part on a mesh of its fundamental domain, symmetry class by symmetry class.

    Parameters
    ----------
    part, material, domain, mesh
        What to solve.
    actuator
        Stiffness of the installed actuator [N/m] for the modes; 0 for none.
    mode_count
        Modes to find in each symmetry class, 0 for none.
    all_classes
        False to solve the fully symmetric class alone, which input and output along their axes belong to; what the
        compliance then lacks, lateral motions and tilts, stands as zero.
    progress
        Receives a text about the progress.

    Raises
    ------
    ValueError
        If the material is a crystal that is not its own mirror image in a plane that cuts the domain.
    """
    if not all(material.mirrors_in(plane.index) for plane in domain.planes):
        raise ValueError(f"{material.name} is no mirror image of itself in the domain's planes; mesh the whole part")
    began = perf_counter()
    body = Elasticity(mesh, material)
    stiffness = body.stiffness()
    mass = body.mass() if mode_count else None
    assembled = perf_counter() - began
    held = [domain.ports[port.name] for port in part.ports() if port.role == "ground" and port.name in domain.ports]
    space = port_compliance.port_space(body, domain, part.ports())
    matrix = np.zeros((space.size, space.size))
    checks = Checks(0.0, 0.0, 0.0, 0.0)
    found: list[tuple[modes.Mode, ModeRecord]] = []
    fields: dict[str, FloatArray] = {}
    output = next((port.name for port in space.ports if port.role == "output"), "")
    rigid = [port for port in space.ports if port.rigid and port.name in space.retained]
    thin_nodes = _thin_nodes(body, domain)
    roots = domain.thin.roots_of_hinges.inside(domain.planes) if domain.thin is not None else None
    peaks = np.zeros(6 if len(thin_nodes) else 0)
    hinge_shares: dict[str, float] = {}
    solver, memory = "", 0
    for cls in port_compliance.classes(domain)[: None if all_classes else 1]:
        progress(f"{body.n_dofs} unknowns, {cls.name}")
        system = statics.class_system(body, domain, cls, stiffness, held, rigid=rigid)
        solver, memory = system.factor.name, max(memory, system.factor.memory)
        share, seen, displacements, projection = statics.class_compliance(body, system, stiffness, space)
        matrix += share
        seen.require()
        checks = checks.worst(seen)
        if cls.is_symmetric:
            for name, motion in (("input", space.extension), ("output", space.output)):
                fields[name] = (displacements @ (space.halves * (projection @ motion))).reshape(-1, 3)
        if len(thin_nodes):  # a motion of an output that is its own mirror image fits one class, and is zero in others
            at_output = displacements[:, space.retained_rows(output)]
            peaks = np.maximum(peaks, _peaks(body, at_output, thin_nodes))
            for name, largest in _hinge_shares(body, domain, at_output, space.loads[output]).items():
                hinge_shares[name] = max(largest, hinge_shares.get(name, 0.0))
        if mass is not None:
            found += _vibrations(system, mass, space, mode_count, actuator)
        system.factor.free()
    members, stresses = part.linkage().slender, stress.nodal(body, fields["input"])
    found.sort(key=lambda pair: pair[1].frequency)
    shapes = [mode.shape for mode, record in found if record.installed == (actuator > 0)]
    return Solution(
        compliance=PortCompliance(matrix, space.extension, space.output),
        checks=checks,
        modes=tuple(record for _, record in found),
        input_sections=tuple(resultants.sections(body, domain, fields["input"], members)),
        output_sections=tuple(resultants.sections(body, domain, fields["output"], members)),
        positions=body.positions,
        nodes=body.nodes,
        input_field=fields["input"],
        output_field=fields["output"],
        mode_shapes=np.array(shapes).reshape(-1, *body.positions.shape),
        von_mises=stress.von_mises(stresses),
        tension=stress.largest_principal(stresses),
        energies=energy.by_region(body, domain, fields["input"], fields["output"], members),
        thin_nodes=thin_nodes,
        peaks=peaks,
        facts={
            "sharp": roots is not None and roots.is_sharp,
            "unresolved fillet": roots.unresolved(mesh.points, mesh.facets) if roots is not None else None,
            "hinge shares": hinge_shares,
            "tetrahedra": len(mesh.tets),
            "unknowns": body.n_dofs,
            "worst quality": float(mesh.quality().min()),
            "loose vertices": len(mesh.loose),
            "every class": all_classes or not domain.planes,
            "symmetric class": port_compliance.classes(domain)[0].name,
            "mass": material.density * mesh.volume * domain.copies,
            "solver": solver,
            "factor bytes": memory,
            "assembly seconds": round(assembled, 2),
            "solve seconds": round(perf_counter() - began - assembled, 2),
        },
    )


def _thin_nodes(body: Elasticity, domain: Domain) -> IntArray:
    """Return the nodes on what was found to be thin; none where the part names its hinges."""
    if domain.thin is None:
        return np.zeros(0, dtype=np.int64)
    middles, reach = domain.thin.middles_of_hinges()
    away, nearest = cKDTree(middles).query(body.positions)
    return np.flatnonzero(away <= reach[nearest])


def _peaks(body: Elasticity, displacements: FloatArray, nodes: IntArray) -> FloatArray:
    """Return the largest von Mises stress on some nodes for each of several displacements (n_dofs, k)."""
    return np.array([stress.nodal_von_mises(body, u.reshape(-1, 3))[nodes].max() for u in displacements.T])


def _hinge_shares(body: Elasticity, domain: Domain, fields: FloatArray, loads: FloatArray) -> dict[str, float]:
    """Return, by name, the largest share of the strain energy that each hinge found on the solid holds under any load.

    Fields and unit loads have shape (n_dofs, k). To a hinge belongs what is no farther than three quarters of the
    thickness from its middle: with all of its thickness, and some of what is around it.
    """
    found, thin = dict[str, float](), domain.thin
    if thin is None:
        return found
    middles, whole = body.mesh.points[body.mesh.tets].mean(axis=1), fields.T @ loads
    for hinge, on in zip(thin.hinges, thin.chosen, strict=True):
        thickness = thin.thickness[on]
        away, nearest = cKDTree(thin.points[on] + thin.inward[on] * thickness[:, None] / 2).query(middles)
        form = energy.between(body, fields, away < 0.75 * thickness[nearest])
        found[hinge.name] = energy.largest_share(form, whole)
    return found


def _vibrations(
    system: ClassSystem, mass: sp.csr_matrix, space: PortSpace, count: int, actuator: float
) -> list[tuple[modes.Mode, ModeRecord]]:
    """Return the lowest modes of a class without the actuator, and with it if there is one."""
    moving_mass = effective_mass.translated_mass(mass)
    batches = {False: modes.class_modes(system, mass, space, count, 0.0)}
    if actuator:
        felt = np.any(space.projection(system.cls) @ space.extension)
        batches[True] = modes.class_modes(system, mass, space, count, actuator) if felt else batches[False]
    return [
        (
            mode,
            ModeRecord.of(
                mode, installed=on, effective_mass=effective_mass.of_mode(mode.shape, moving_mass, system.cls)
            ),
        )
        for on, batch in batches.items()
        for mode in batch
    ]


def _rows(sections: tuple[resultants.Section, ...]) -> FloatArray:
    return np.array([(s.normal, s.shear, s.moment) for s in sections]).reshape(-1, 3)
