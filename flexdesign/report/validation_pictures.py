"""The pictures of a validation: mesh, deformation, stress, and the mode that moves the output."""

from __future__ import annotations

import math

import numpy as np

from flexdesign import quantities, units
from flexdesign.fem.mesh import mirrored
from flexdesign.report import pictures
from flexdesign.report.document import Figure
from flexdesign.report.pictures import Picture
from flexdesign.validation import Validation

#: Exaggerated motions are drawn as large as this fraction of the part.
DRAWN = 0.06


def draw(validation: Validation) -> list[Figure]:
    """Draw everything, in one go.

    Raises
    ------
    NoPictures
        If nothing can be drawn on this machine.
    """
    jobs = _static(validation)
    if len(validation.modal.solution.mode_shapes):
        jobs.append(_mode(validation))
    images = pictures.draw([picture for picture, _ in jobs])
    return [Figure(picture.file, data, caption) for (picture, caption), data in zip(jobs, images, strict=True)]


def _static(validation: Validation) -> list[tuple[Picture, str]]:
    level = validation.finest
    force, boundary = quantities.stated_force(validation.study, level.solution)
    fields = {"motion": force * level.solution.input_field, "stress": force * level.solution.von_mises / 1e6}
    planes, solution = validation.domain.planes, level.solution
    points, tets, whole = mirrored(solution.positions, solution.nodes, planes, fields)
    vertices, linear, _ = mirrored(level.mesh.points, level.mesh.tets, planes, {})
    motion, stress, label = whole["motion"], whole["stress"], "von Mises stress [MPa]"
    travel = np.linalg.norm(motion, axis=1)
    scale = _round_down(DRAWN * _size(points) / travel.max())
    hinge = level.solution.input_sections[0].member
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
            Picture(
                "deformation.png", points, tets, scale * motion, travel * 1e6, "displacement [um]",
                notes=[f"displacements drawn {scale:g} times as large"],
            ),
            f"Deformation at {boundary}, with the undeformed outline",
        ),
        (
            Picture("stress.png", points, tets, scalars=stress, label=label, limits=limits),
            f"Von Mises stress at {boundary}; the colours end at 1.2 times the nominal hinge stress",
        ),
        (
            Picture("stress_hinge.png", points, tets, scalars=stress, label=label, limits=limits, focus=focus),
            f"Von Mises stress at {hinge.name}",
        ),
    ]  # fmt: skip


def _mode(validation: Validation) -> tuple[Picture, str]:
    level = validation.modal
    installed = validation.study.design.actuator is not None
    symmetric = level.solution.facts["symmetric class"]
    modes = [m for m in level.solution.modes if m.installed == installed and m.symmetry == symmetric]
    actuator = validation.study.design.actuator
    spring = actuator.installed_stiffness if actuator else 0.0
    index = int(np.argmax([quantities.output_share(mode, level.solution.compliance, spring) for mode in modes]))
    points, tets, whole = mirrored(
        level.solution.positions,
        level.solution.nodes,
        validation.domain.planes,
        {"shape": level.solution.mode_shapes[index]},
    )
    relative = whole["shape"] / np.linalg.norm(whole["shape"], axis=1).max()
    state = "with the actuator installed" if installed else "without actuator"
    caption = f"The mode that carries the output, {units.significant(modes[index].frequency, 3)} Hz {state}"
    motion = DRAWN * _size(points) * relative
    return Picture(
        "mode.png",
        points,
        tets,
        motion,
        np.linalg.norm(relative, axis=1),
        "relative motion",
        notes=["amplitude arbitrary"],
    ), caption


def _size(points: np.ndarray) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def _round_down(value: float) -> float:
    step = float(10 ** math.floor(math.log10(value)))
    return step * max(m for m in (1, 2, 5) if m * step <= value)
