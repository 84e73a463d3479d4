"""What a part notes of its solid, such as what was done to one from a file; its ports; and what is thin."""

from __future__ import annotations

import numpy as np

from flexdesign.core import units
from flexdesign.design.faces import in_mm
from flexdesign.design.part import in_file
from flexdesign.design.step_part import StepPart
from flexdesign.fem.mesh_refinement import Level
from flexdesign.report.document import Section, Table
from flexdesign.workflows.validation import Validation

#: Volumes that differ by more than this, relative, are worth a warning: twice the thousandth or so that chords on
#: curved faces leave (`conforming.CHORD`).
VOLUME = 2e-3


def section(validation: Validation) -> Section:
    """Return the section; empty for a part that notes nothing and names its hinges."""
    thin, part = validation.domain.thin, validation.study.design.part()
    notes: list[str] = list(getattr(part, "notes", tuple)())
    if thin is None:
        return Section("The solid", notes)
    text = (
        "The part names no hinges. Its thickness was measured on the solid, by rays from its faces to the faces "
        f"across; the mesh is graded by it. The thinnest place has {units.to_text(thin.thinnest, 'mm', si='m')}."
    )
    if len(thin.slivers):
        least = units.to_text(float(thin.slivers.min()), "mm", si="m")
        text += (
            f" Left out were {len(thin.slivers)} places down to {least}: "
            "they are thinner than every thin region and too few to be one, as at a small step between two faces."
        )
    rows = [
        [
            hinge.name,
            units.to_text(hinge.thickness, "mm", si="m"),
            f"{1e3 * hinge.length:.3g} x {1e3 * hinge.width:.3g} mm",
            f"{in_mm(in_file(part, hinge.centre))} mm",
        ]
        for hinge in thin.hinges
    ]
    regions = [Table(["thin region", "thickness", "extent", "centre"], rows)] if rows else []
    if not isinstance(part, StepPart):
        return Section("The solid", [*notes, text], regions)
    return Section("The solid", [*notes, text], [_ports(part), *regions])


def volume_deviation(validation: Validation, level: Level) -> float:
    """Return by how much the volume of a mesh differs from that of the solid, relative."""
    return level.mesh.volume / validation.domain.volume - 1


def geometric_errors(validation: Validation) -> list[str]:
    """Return what is said of a solid from a file whose volume, or thin regions, the finest mesh does not have."""
    off = volume_deviation(validation, validation.finest)
    volume = (
        f"Geometric error: the volume of the finest mesh differs from that of the solid by {100 * off:+.2g} %. Mass "
        "and stiffness are off by about as much, and the estimated discretisation error need not contain it; reduce "
        "mesh.at_root for less."
    )
    return [volume] * (abs(off) > VOLUME) + [
        f"Geometric error: {check.hinge.name} is off its {units.to_text(check.hinge.thickness, 'mm', si='m')} by "
        f"{100 * check.deviation:.2g} % at places and {100 * abs(check.bending):.2g} % in bending on the finest mesh, "
        f"more than a hinge may. It holds up to {100 * check.share:.2g} % of the strain energy under any load on the "
        f"output, so that stiffness is off by up to {100 * check.stiffness_error:.2g} %; reduce mesh.at_root for less."
        for check in validation.finest.hinges
        if not check.passed
    ]


def _ports(part: StepPart) -> Table:
    """Return which faces are ports, in the coordinates of the file."""
    rows = []
    for port in part.ports():
        faces = [part.faces()[index] for index in port.faces]
        areas = np.array([face.area for face in faces])
        centre = areas @ np.array([face.centroid for face in faces]) / areas.sum()
        rows.append(
            [
                port.name,
                ", ".join(face.label for face in faces),
                f"{1e6 * areas.sum():.4g} mm²",
                f"{in_mm(centre - np.array(part.moved()))} mm",
                ", ".join(f"{round(x, 6) + 0.0:.4g}" for x in port.normal),
                "rigid" if port.rigid else "traction",
            ]
        )
    return Table(["port", "faces", "area", "centre", "normal", "interface"], rows)
