"""The part of a validation as a page turns it: deformed, stressed, and in its lowest modes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import units
from flexdesign.fem import quantities
from flexdesign.fem.analysis import ModeRecord, Solution
from flexdesign.fem.meshing import mesh
from flexdesign.fem.solving import port_compliance
from flexdesign.report.views import State, Surface, View
from flexdesign.workflows.validation import Validation

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
#: Exaggerated motions are drawn as large as this fraction of the part.
DRAWN = 0.06


def view(validation: Validation, drawn: Sequence[tuple[ModeRecord, FloatArray]]) -> View:
    """Return the part deformed and stressed at the load of the report, and some of its modes."""
    solution = validation.finest.solution
    load, full = 1.0, "1 N of output force"
    if validation.has_input:
        load, full = quantities.stated_force(validation.study, solution)
    field = solution.input_field if validation.has_input else solution.output_field
    points, triangles = skin(validation, solution)
    fields = {"motion": load * field} | ({"stress": load * solution.von_mises / 1e6} if validation.has_input else {})
    whole = mesh.mirror_mesh(solution.positions, solution.nodes, validation.domain.planes, fields)[2]
    enlarged = round_down(DRAWN * extent(points) / float(np.linalg.norm(whole["motion"], axis=1).max()))
    states = [State(f"Deformation at {full}", 0, whole["motion"], enlarged, full=full)]
    if validation.has_input:
        stress = whole["stress"]
        top = float(np.quantile(stress[np.unique(triangles)], 0.999))
        states.append(
            State(
                f"Von Mises stress at {full}", 0, whole["motion"], enlarged, label="von Mises stress", unit="MPa",
                values=stress, full=full, limit=top,
            )
        )  # fmt: skip
    return View([Surface(points, triangles), *_modal_surface(validation)], [*states, *_modes(validation, drawn)])


def _modal_surface(validation: Validation) -> list[Surface]:
    return [Surface(*skin(validation, validation.modal.solution))]


def _modes(validation: Validation, drawn: Sequence[tuple[ModeRecord, FloatArray]]) -> list[State]:
    """Return modes relative to their largest motion, which is drawn as large as a deformation."""
    solution = validation.modal.solution
    states = []
    for rank, (mode, shape) in enumerate(drawn, 1):
        points, _, whole = mesh.mirror_mesh(
            solution.positions, solution.nodes, validation.domain.planes, {"shape": shape}
        )
        moved = whole["shape"] * image_signs(validation, mode)[:, None]
        name = f"Mode {rank}, {units.significant(mode.frequency, 4)} Hz"
        states.append(State.of_mode(name, 1, moved, DRAWN * extent(points)))
    return states


def skin(validation: Validation, solution: Solution) -> tuple[FloatArray, IntArray]:
    """Return the nodes of the whole part and the triangles of its skin, symmetry planes left out."""
    corners, planes = solution.nodes[:, :4], validation.domain.planes
    points, tets, _ = mesh.mirror_mesh(solution.positions, corners, planes, {})
    triangles = mesh.boundary(tets)
    reach = float(np.ptp(points, axis=0).max())
    inside = np.zeros(len(triangles), dtype=bool)
    for plane in planes:
        inside |= np.abs(points[triangles][:, :, plane.index]).max(axis=1) < 1e-9 * reach
    return points, triangles[~inside]


def image_signs(validation: Validation, mode: ModeRecord) -> FloatArray:
    """Return for each node of the whole the sign by which an odd mode differs from the even one `mirrored` makes."""
    cls = next(c for c in port_compliance.classes(validation.domain) if c.name == mode.symmetry)
    signs = np.ones(1)
    for sign in cls.signs:
        signs = np.concatenate([signs, sign * signs])
    return np.repeat(signs, len(validation.modal.solution.positions))


def extent(points: FloatArray) -> float:
    """Return the diagonal of the box around points [m]."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def round_down(value: float) -> float:
    """Return the next number below that is 1, 2 or 5 times a power of ten."""
    step = float(10 ** math.floor(math.log10(value)))
    return step * max(m for m in (1, 2, 5) if m * step <= value)
