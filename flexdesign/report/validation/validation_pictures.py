"""The pictures of a validation: mesh, deformation, stress, and the lowest modes, one of them moving."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import units
from flexdesign.core.model import Member
from flexdesign.fem import quantities
from flexdesign.fem.analysis import ModeRecord, Solution
from flexdesign.fem.meshing.mesh import mirror_mesh
from flexdesign.fem.meshing.thin_regions import ThinRegions, main_direction
from flexdesign.report import pictures
from flexdesign.report.document import Figure
from flexdesign.report.pictures import Picture, Reel, Shot, displacement_unit
from flexdesign.report.validation import part_view, vibrations
from flexdesign.workflows.validation import Validation

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Number of the lowest modes drawn.
DRAWN_MODES = 6


def draw(validation: Validation) -> tuple[list[Figure], list[Figure]]:
    """Draw everything, in one go; return the part at rest and deformed, and its modes.

    Raises
    ------
    NoPictures
        If nothing can be drawn on this machine.
    """
    jobs, modes, main = _static(validation), drawn_modes(validation), carrying_output(validation)
    swinging = reel(validation, modes)
    images = pictures.draw([picture for picture, _ in jobs], swinging)
    whole = part_view.view(validation, modes)
    still = [
        Figure(picture.file, images[picture.file], caption, whole if picture.file == "deformation.png" else None)
        for picture, caption in jobs
    ]
    vibrating = [
        Figure(shot.file, images[shot.file], _mode_caption(validation, rank, mode, main=mode is main))
        for rank, (shot, (mode, _)) in enumerate(zip(swinging.shots, modes, strict=True), start=1)
    ]
    return still, vibrating


def _static(validation: Validation) -> list[tuple[Picture, str]]:
    level = validation.finest
    if not validation.has_members:
        return _without_members(validation)
    force, boundary = quantities.stated_force(validation.study, level.solution)
    fields = {"motion": force * level.solution.input_field, "stress": force * level.solution.von_mises / 1e6}
    planes, solution = validation.domain.planes, level.solution
    points, tets, whole = mirror_mesh(solution.positions, solution.nodes, planes, fields)
    vertices, linear, _ = mirror_mesh(level.mesh.points, level.mesh.tets, planes, {})
    motion, stress, label = whole["motion"], whole["stress"], "von Mises stress [MPa]"
    place, peak, hinge = hinge_maximum(solution)
    mark = (place, f"{'largest on this mesh' if validation.sharp else 'maximum'}: {1e-6 * force * peak:.3g} MPa")
    focus = (hinge.centre, 1.6 * max(hinge.length, 4 * hinge.thickness))
    limits = (0.0, 1.2e-6 * force * max(s.nominal_stress for s in level.solution.input_sections))
    return [
        (
            Picture("mesh.png", vertices, linear, edges=True, view="oblique"),
            "The finest mesh of the whole part: the fundamental domain and its mirror images",
        ),
        (
            Picture("mesh_hinge.png", vertices, linear, edges=True, focus=focus),
            f"The mesh at {hinge.name}, refined at the roots",
        ),
        (
            _deformation(points, tets, motion, "front"),
            f"Deformation at {boundary}, with the undeformed outline",
        ),
        (
            Picture("stress.png", points, tets, scalars=stress, label=label, limits=limits, mark=mark),
            f"Von Mises stress at {boundary}, the largest at a hinge marked; the colours end at 1.2 times the nominal "
            "hinge stress",
        ),
        (
            Picture(
                "stress_hinge.png", points, tets, scalars=stress, label=label, limits=limits, focus=focus, mark=mark
            ),
            f"Von Mises stress at {hinge.name}, where it is largest",
        ),
    ]  # fmt: skip


def _deformation(points: FloatArray, tets: IntArray, motion: FloatArray, view: Literal["front", "oblique"]) -> Picture:
    """Return the picture of a deformed part, its displacements [m] drawn larger."""
    travel = np.linalg.norm(motion, axis=1)
    scale = part_view.round_down(part_view.DRAWN * part_view.extent(points) / travel.max())
    factor, label = displacement_unit(travel.max())
    colours = factor * travel
    notes = [f"displacements drawn {scale:g} times as large"]
    return Picture(
        "deformation.png", points, tets, scale * motion, colours, label, (0.0, colours.max()), view=view, notes=notes
    )


def _without_members(validation: Validation) -> list[tuple[Picture, str]]:
    """Return mesh, deformation and stress of a part that names no hinges, and its mesh where it is thinnest."""
    level, solution, planes = validation.finest, validation.finest.solution, validation.domain.planes
    output = next(port for port in validation.study.design.part().ports() if port.role == "output")
    load, boundary = 1.0, f"1 N of output force along the port's {'axis' if output.is_round else 'normal'}"
    if validation.has_input:
        load, boundary = quantities.stated_force(validation.study, solution)
    field = solution.input_field if validation.has_input else solution.output_field
    points, tets, whole = mirror_mesh(solution.positions, solution.nodes, planes, {"motion": load * field})
    vertices, linear, _ = mirror_mesh(level.mesh.points, level.mesh.tets, planes, {})
    jobs = [
        (
            Picture("mesh.png", vertices, linear, edges=True, view="oblique"),
            "The finest mesh, graded by the thickness found on the solid",
        ),
        (
            _deformation(points, tets, whole["motion"], "oblique"),
            f"Deformation at {boundary}, with the undeformed outline",
        ),
    ]  # fmt: skip
    if validation.has_input:
        stress = mirror_mesh(solution.positions, solution.nodes, planes, {"s": load * solution.von_mises / 1e6})[2]["s"]
        top = float(stress[solution.thin_nodes].max())
        jobs.append(
            (
                Picture(
                    "stress.png", points, tets, scalars=stress, label="von Mises stress [MPa]", limits=(0.0, top),
                    view="oblique",
                ),
                f"Von Mises stress at {boundary}; the colours end at the largest on the thin regions",
            )
        )  # fmt: skip
    if validation.domain.thin is not None and validation.domain.thin.hinges:
        jobs.insert(1, _cut_hinge(validation.domain.thin, vertices, linear))
    return jobs


def _cut_hinge(thin: ThinRegions, points: FloatArray, cells: IntArray) -> tuple[Picture, str]:
    """Return the mesh at the thinnest hinge found on a solid, cut through the middle of its width.

    The half of the solid in front of the cut is left out, as other parts of it may stand before the hinge.
    """
    index = int(np.argmin([hinge.thickness for hinge in thin.hinges]))
    hinge, inward = thin.hinges[index], thin.inward[thin.chosen[index]]
    centre, toward = np.array(hinge.centre), np.cross(hinge.axis, main_direction(inward))
    toward = toward if toward @ (0.45, 0.55, 1.0) >= 0 else -toward
    behind = (points[cells].mean(axis=1) - centre) @ toward <= 0
    x, y, z = map(float, toward)
    view = Picture(
        "mesh_hinge.png", points, cells[behind], edges=True, view=(x, y, z),
        focus=(hinge.centre, max(0.8 * hinge.length, 12 * hinge.thickness)),
    )  # fmt: skip
    return view, f"The mesh at {hinge.name}, cut through the middle of its width"


def hinge_maximum(solution: Solution) -> tuple[tuple[float, float, float], float, Member]:
    """Return where the von Mises stress at the hinges is largest [m], how large it is [Pa/N], and at which hinge."""
    node = quantities.hinge_peak_node(solution)
    x, y, z = (float(coordinate) for coordinate in solution.positions[node])
    hinges = [section.member for section in solution.input_sections if section.member.kind == "hinge"]
    nearest = min(hinges, key=lambda hinge: math.dist(hinge.centre[:2], (x, y)))
    return (x, y, z), float(solution.von_mises[node]), nearest


def animated_modes(validation: Validation) -> list[ModeRecord]:
    """Return the modes whose shapes are kept, by frequency: with the actuator, where there is one."""
    installed = validation.study.design.actuator is not None
    return [mode for mode in validation.modal.solution.modes if mode.installed == installed]


def carrying_output(validation: Validation) -> ModeRecord:
    """Return the mode that carries most of the output's compliance."""
    actuator, compliance = validation.study.design.actuator, validation.modal.solution.compliance
    spring = actuator.installed_stiffness if actuator else 0.0
    return max(animated_modes(validation), key=lambda mode: quantities.output_share(mode, compliance, spring))


def drawn_modes(validation: Validation) -> list[tuple[ModeRecord, FloatArray]]:
    """Return the lowest modes and their shapes, and among them or behind them the one that carries the output."""
    modes = zip(animated_modes(validation), validation.modal.solution.mode_shapes, strict=True)
    main = carrying_output(validation)
    return [(mode, shape) for rank, (mode, shape) in enumerate(modes) if rank < DRAWN_MODES or mode is main]


def reel(validation: Validation, modes: Sequence[tuple[ModeRecord, FloatArray]]) -> Reel:
    """Return what is drawn of some modes of the whole part, the one that carries the output moving."""
    solution, main = validation.modal.solution, carrying_output(validation)
    shapes = {f"mode_{rank}.png": shape for rank, (_, shape) in enumerate(modes, start=1)}
    points, tets, whole = mirror_mesh(solution.positions, solution.nodes, validation.domain.planes, shapes)
    shots = []
    for file, (mode, _) in zip(shapes, modes, strict=True):
        shape = whole[file] * part_view.image_signs(validation, mode)[:, None]
        largest = np.linalg.norm(shape, axis=1).max()
        shots.append(Shot(file, part_view.DRAWN * part_view.extent(points) / largest * shape, moving=mode is main))
    return Reel(points, tets, shots)


def _mode_caption(validation: Validation, rank: int, mode: ModeRecord, *, main: bool) -> str:
    shares = [100 * mass / validation.modal.solution.facts["mass"] for mass in mode.effective_mass]
    role = ", the mode that carries the output, moving" if main else ""
    masses = ", ".join(f"{share:.0f} % in {axis}" for axis, share in zip("xyz", shares, strict=True) if share > 0.5)
    mass_text = f"effective mass {masses}" if masses else "no effective mass"
    frequency = units.significant(mode.frequency, 4)
    return f"Mode {rank}{role}: {frequency} Hz, {vibrations.symmetry(mode.symmetry)}; {mass_text}"
