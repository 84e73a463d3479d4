"""The output port as a spring in six directions: what a joint's report is about."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexdesign.core import units
from flexdesign.core.model import Quantity
from flexdesign.design.faces import in_mm
from flexdesign.design.part import in_file
from flexdesign.fem.analysis import Solution
from flexdesign.fem.quantities import port_stiffness
from flexdesign.fem.quantities.port_stiffness import FREE, HELD
from flexdesign.fem.solving.port_compliance import MOTIONS
from flexdesign.report import strength_text
from flexdesign.report.document import Section, Table
from flexdesign.report.validation import table_motion
from flexdesign.report.wording import format_quantity, name_of
from flexdesign.workflows.validation import Validation

TITLE = "Stiffness of the output port in six directions"


def table_1(validation: Validation) -> Table:
    """Return what FEM says of the port, or of input and output, of a part without formulas."""
    if not validation.has_input:
        return _six(validation)
    names = ("K_in", "lambda", "K_out")
    rows = [[name_of(q), q.boundary, format_quantity(q)] for q in validation.further if q.name in names]
    return Table(["quantity", "boundary", "FEM"], rows, "FEM ± estimated discretisation error")


def section(validation: Validation) -> Section:
    """Return the section; empty for a part that names its members."""
    if not _results(validation):
        return Section(TITLE)
    part = validation.study.design.part()
    port = next(p for p in part.ports() if p.role == "output")
    about = in_mm(in_file(part, port.point))
    face = "its faces move as one body" if port.rigid else "its faces carry an even traction and are free to deform"
    text = (
        f"The port {port.name} against the held ground{', inputs free' if validation.has_input else ''}; {face}, which "
        "the stiffness depends on. Motions and moments are those about the point "
        f"({about}) mm. With the other motions held a stiffness is the diagonal of the matrix; with them free, one "
        "over the diagonal of its inverse."
    )
    if validation.has_input:
        return Section(TITLE, [text], [_six(validation), _matrix(validation)])
    return Section(TITLE, [text], [_matrix(validation), *table_motion.rotation_centres(validation)])


def summary(validation: Validation) -> list[str]:
    """Say how stiff a joint is; a moment alone shifts what it turns, unless other motions are held."""
    rotations = [motion for motion in MOTIONS if motion.startswith("r")]
    held, free = _listed(validation, MOTIONS, HELD), _listed(validation, rotations, FREE)
    return [
        f"FEM gives the stiffness of the output port against the ground, other motions held: {held}.",
        f"With the other motions free: {free}.",
    ]


def _listed(validation: Validation, motions: Sequence[str], boundary: str) -> str:
    ports = validation.study.design.part().ports()
    pieces: dict[str, list[str]] = {}
    for motion in motions:
        kind = port_stiffness.kind(motion, ports) or f"along {motion}"
        pieces.setdefault(kind, []).append(format_quantity(_fem(validation, motion, boundary)))
    return "; ".join(f"{kind} {' and '.join(values)}" for kind, values in pieces.items())


def strength(validation: Validation) -> Section:
    """Return how far each motion of a joint may go until it yields."""
    solution, material = _whole(validation), validation.study.design.material
    text = strength_text.strengths(material)[:1]
    note = "grows with refinement: a re-entrant edge is sharp" if validation.sharp else "on the finest mesh"
    if validation.unresolved_fillet:
        text.append(validation.unresolved_fillet)
        note = "not resolved at a fillet"
    rows = []
    for motion, peak in zip(MOTIONS, solution.peaks.tolist(), strict=True):
        load, unit = ("N m", "mrad") if motion.startswith("r") else ("N", "um")
        row = [motion, f"{1e-6 * peak:.4g} MPa per {load}"]
        if material.yield_strength is not None:
            force = material.yield_strength / peak
            way = force / _fem(validation, motion, FREE).value
            row += [
                units.to_text(force, load, 3),
                units.to_text(way, unit, 3, si="rad" if motion.startswith("r") else "m"),
            ]
        rows.append(row)
    heads = ["motion", "peak von Mises stress", *(["load at yield", "motion at yield"] if len(rows[0]) > 2 else [])]
    return Section("Stress", text, [Table(heads, rows, f"Peak on the thin regions, {note}; other motions free")])


def result(validation: Validation) -> dict[str, Any] | None:
    """Return the matrices as result.json has them; None for a part that names its members."""
    if not _results(validation):
        return None
    stiffness, compliance = port_stiffness.matrices(_whole(validation).compliance)
    return {
        "motions": list(MOTIONS),
        "unit": "N/m, N/rad, N m/rad",
        "stiffness": stiffness.tolist(),
        "compliance": compliance.tolist(),
        "peak_stress_per_unit_load": _whole(validation).peaks.tolist(),
    }


def _whole(validation: Validation) -> Solution:
    """Return the solution of the finest mesh that was solved for every symmetry class."""
    return next(level.solution for level in reversed(validation.levels) if level.solution.whole)


def _results(validation: Validation) -> list[Quantity]:
    return [q for q in validation.further if q.name.startswith("k_") and q.boundary in (HELD, FREE)]


def _fem(validation: Validation, motion: str, boundary: str) -> Quantity:
    return next(q for q in _results(validation) if q.name == f"k_{motion}" and q.boundary == boundary)


def _six(validation: Validation) -> Table:
    ports = validation.study.design.part().ports()
    rows = []
    for motion in MOTIONS:
        kind = port_stiffness.kind(motion, ports)
        cells = [format_quantity(_fem(validation, motion, boundary)) for boundary in (HELD, FREE)]
        rows.append([f"k_{motion}{f' ({kind})' if kind else ''}", *cells])
    return Table(["stiffness", HELD, FREE], rows, "FEM ± estimated discretisation error")


def _matrix(validation: Validation) -> Table:
    stiffness, _ = port_stiffness.matrices(_whole(validation).compliance)
    small = 1e-9 * np.sqrt(np.outer(np.diag(stiffness), np.diag(stiffness)))
    rows = [
        [motion, *("0" if abs(value) < least else f"{value:.4g}" for value, least in zip(row, limits, strict=True))]
        for motion, row, limits in zip(MOTIONS, stiffness.tolist(), small.tolist(), strict=True)
    ]
    caption = f"Stiffness matrix on the mesh of {_whole(validation).facts['unknowns']} unknowns: N/m, N/rad and N m/rad"
    return Table(["", *MOTIONS], rows, caption)
