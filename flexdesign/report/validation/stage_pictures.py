"""The pictures of a stage: as drawn, deformed by its actuators, and in its lowest modes.

Inside a part its displacements are those of the fundamental domain and of its mirror images: where the domain moves
with vectors V by amplitudes a, the image of its point x in a plane, S x, moves by S V R a. Bodies move as a whole.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import units
from flexdesign.design.assembly import Body, Box, Element
from flexdesign.fem.quantities.stage_modes import ModeShares, mode_shares
from flexdesign.fem.superelements.assembled_stage import AssembledStage
from flexdesign.fem.superelements.superelement import Interior
from flexdesign.report.document import Figure
from flexdesign.report.pictures import displacement_unit
from flexdesign.report.validation import stage_scene, stage_view
from flexdesign.report.validation.stage_motion import describe_mode
from flexdesign.report.validation.stage_scene import SMALL, Scene, Skin
from flexdesign.report.validation.stage_text import Axes
from flexdesign.report.views import View
from flexdesign.workflows.validation.validate_stage import StageValidation

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Exaggerated motions are drawn as large as this fraction of the stage.
DRAWN = 0.04
#: Number of the lowest modes drawn.
DRAWN_MODES = 4
#: Colours of the table, of other bodies and of hinges, then of kinds of amplifiers.
TABLE, BODY, HINGE, AMPLIFIERS = "#d9822b", "#a3b3c1", "#41505c", ("#2f7fb5", "#3f9c4d", "#b0529e", "#c9a227")
#: Corners of a box, and its twelve triangles seen from outside.
CORNERS = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
SIDES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)  # fmt: skip


def draw(validation: StageValidation) -> tuple[list[Figure], list[Figure]]:
    """Draw everything, in one go; return the stage at rest and deformed, and its modes.

    Raises
    ------
    NoPictures
        If nothing can be drawn on this machine.
    """
    stage = validation.stages[0]
    driven = {axis: _drive(validation, stage, axis) for axis in Axes(validation).listed}
    actuator = validation.study.design.actuator
    modes = mode_shares(stage, actuator.installed_stiffness if actuator else 0.0, DRAWN_MODES)
    fields = np.stack([*driven.values(), *(mode.mode.amplitudes for mode in modes)], axis=1)
    skins, displaced = _skins(stage, fields)
    jobs = [(Scene("stage.png"), _caption(validation))]
    for index, axis in enumerate(driven):
        jobs.append(_draw_deformation(validation, axis, skins, [each[..., index] for each in displaced]))
    swings = [
        (_swing(f"mode_{rank}.png", skins, [each[..., len(driven) + rank - 1] for each in displaced]), mode)
        for rank, mode in enumerate(modes, 1)
    ]
    images = stage_scene.draw(skins, [scene for scene, _ in [*jobs, *swings]])
    still = [Figure(scene.file, images[scene.file], caption) for scene, caption in jobs]
    if driven:  # the page turns the first of them, and shows the others and the modes in its place
        still[1] = replace(still[1], live=_view(validation, skins, displaced, list(driven), modes))
    vibrating = [
        Figure(scene.file, images[scene.file], _mode_caption(mode, rank, installed=actuator is not None))
        for rank, (scene, mode) in enumerate(swings, 1)
    ]
    return still, vibrating


def _drive(validation: StageValidation, stage: AssembledStage, axis: str) -> FloatArray:
    """Return the unknowns when an axis' actuators part their inputs by the stated mean."""
    drives = stage.assembly.axes[axis].drives
    load = stage.drive(axis)
    displaced = np.linalg.solve(stage.stiffness, load)
    return np.asarray(validation.inputs[axis] * len(drives) / float(load @ displaced) * displaced)


def _skins(stage: AssembledStage, fields: FloatArray) -> tuple[list[Skin], list[FloatArray]]:
    """Return what is drawn, and how its points move in each field, shape (n, 3, f) each."""
    assembly = stage.assembly
    groups: dict[str, tuple[str, bool, list[tuple[FloatArray, IntArray, FloatArray]]]] = {}

    def add(name: str, colour: str, piece: tuple[FloatArray, IntArray, FloatArray], *, glass: bool = False) -> None:
        groups.setdefault(name, (colour, glass, []))[2].append(piece)

    for body in assembly.bodies:
        name = "table" if body.name == assembly.table else "frame" if body.fixed else "rigid bodies"
        colour = TABLE if name == "table" else BODY
        for box in body.boxes:
            add(name, colour, _box(stage, body, box, fields), glass=body.fixed)
    palette = iter(itertools.cycle(AMPLIFIERS))
    for _, elements in assembly.kinds():
        pushed = elements[0].name in assembly.driven
        name, colour = (_element_name(elements), next(palette)) if pushed else ("hinges", HINGE)
        for element in elements:
            add(name, colour, _element(stage, element, fields))
    skins, displaced = [], []
    for name, (colour, glass, pieces) in groups.items():
        points, triangles, motions = _join(pieces)
        skins.append(Skin(name, colour, points, triangles, glass))
        displaced.append(motions)
    return skins, displaced


def _element_name(elements: Sequence[Element]) -> str:
    first, *others = (element.name.split("_") for element in elements)
    words = [word for word in first if all(word in other for other in others)]
    own = [word for word in words if word != "amplifier"]
    return f"amplifiers, {' '.join(own)}" if own else "amplifiers"


def _join(pieces: Sequence[tuple[FloatArray, IntArray, FloatArray]]) -> tuple[FloatArray, IntArray, FloatArray]:
    starts = np.cumsum([0, *(len(points) for points, _, _ in pieces)])
    return (
        np.concatenate([points for points, _, _ in pieces]),
        np.concatenate([triangles + start for (_, triangles, _), start in zip(pieces, starts, strict=False)]),
        np.concatenate([motions for _, _, motions in pieces]),
    )


def _box(stage: AssembledStage, body: Body, box: Box, fields: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    points = np.array(box.centre) + CORNERS * np.array(box.size)
    if body.fixed:
        return points, SIDES, np.zeros((8, 3, fields.shape[1]))
    return points, SIDES, np.stack([stage.motion(body.name, point)[:3] @ fields for point in points])


def _element(stage: AssembledStage, element: Element, fields: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return points, triangles and motions of a part's skin, with its mirror images, at its place."""
    inside = stage.parts[element.name].interior
    assert inside is not None, "the coarsest mesh keeps what goes on inside"
    places, onto = stage.connection(element.name)
    amplitudes = onto @ fields[places]
    nodes, triangles = _outside(inside)
    vectors = inside.vectors.reshape(-1, 3, inside.vectors.shape[1])[nodes]
    points, turn = inside.body.positions[nodes], element.placement.matrix
    pieces = []
    for mirrored in itertools.product((False, True), repeat=len(inside.planes)):
        signs, seen = np.ones(3), amplitudes
        for index, plane in enumerate(inside.planes):
            if mirrored[index]:
                signs[plane.index], seen = -1.0, inside.reflections[index] @ seen
        motions = np.einsum("ij,j,njf->nif", turn, signs, np.einsum("njk,kf->njf", vectors, seen))
        facing = triangles if sum(mirrored) % 2 == 0 else triangles[:, ::-1]
        pieces.append((element.placement.outside(points * signs), facing, motions))
    return _join(pieces)


def _outside(inside: Interior) -> tuple[IntArray, IntArray]:
    """Return the nodes on the domain's skin and its triangles between them, symmetry planes left out."""
    points, facets = inside.body.mesh.points, inside.body.mesh.facets
    is_outside = np.ones(len(facets), dtype=bool)
    reach = float(np.ptp(points, axis=0).max())
    for plane in inside.planes:
        is_outside &= np.abs(points[facets][:, :, plane.index]).max(axis=1) > 1e-9 * reach
    nodes, numbers = np.unique(facets[is_outside], return_inverse=True)
    return nodes, numbers.reshape(-1, 3)


def _draw_deformation(
    validation: StageValidation, axis: str, skins: Sequence[Skin], motions: Sequence[FloatArray]
) -> tuple[Scene, str]:
    sizes = [np.linalg.norm(each, axis=1) for each in motions]
    largest, scale = _largest(motions), _enlargement(skins, motions)
    parted = _parted(validation, axis)
    factor, label = displacement_unit(largest)
    scene = Scene(
        f"deformation_{axis}.png",
        [scale * each for each in motions],
        [factor * size for size in sizes],
        label,
        notes=[f"{axis.upper()} driven, inputs parted by {parted}", f"displacements drawn {scale:g} times as large"],
    )
    caption = (
        f"The stage as {axis.upper()} is driven, {parted} at each actuator; displacements drawn {scale:g} times as "
        f"large, the frame seen through; the largest is {units.to_text(largest, 'um', si='m')} (linear solution)"
    )
    return scene, caption


def _swing(file: str, skins: Sequence[Skin], motions: Sequence[FloatArray]) -> Scene:
    sizes, largest = [np.linalg.norm(each, axis=1) for each in motions], _largest(motions)
    scale = DRAWN * _extent(skins) / largest
    return Scene(file, [scale * each for each in motions], [size / largest for size in sizes], size=SMALL)


def _view(
    validation: StageValidation,
    skins: Sequence[Skin],
    displaced: Sequence[FloatArray],
    driven: Sequence[str],
    modes: Sequence[ModeShares],
) -> View:
    shown = [
        (
            axis,
            f"inputs parted by {_parted(validation, axis)}",
            _enlargement(skins, [each[..., k] for each in displaced]),
        )
        for k, axis in enumerate(driven)
    ]
    names = [f"Mode {rank}, {units.significant(mode.mode.frequency, 4)} Hz" for rank, mode in enumerate(modes, 1)]
    return stage_view.view(skins, displaced, shown, names, DRAWN * _extent(skins))


def _parted(validation: StageValidation, axis: str) -> str:
    return units.to_text(validation.inputs[axis], "um", si="m")


def _largest(motions: Sequence[FloatArray]) -> float:
    return max(float(np.linalg.norm(each, axis=1).max(initial=0.0)) for each in motions)


def _enlargement(skins: Sequence[Skin], motions: Sequence[FloatArray]) -> float:
    """Return how many times as large displacements are drawn."""
    return _round_down(DRAWN * _extent(skins) / _largest(motions))


def _caption(validation: StageValidation) -> str:
    assembly = validation.assembly
    counts = f"{len(assembly.driven)} amplifiers, {len(assembly.elements) - len(assembly.driven)} hinges"
    note = " Dimensions are reconstructed." if "reconstructed" in validation.study.design.provenance else ""
    return (
        f"The stage as drawn: {counts} between {len(assembly.free_bodies)} rigid bodies, the frame seen through.{note}"
    )


def _mode_caption(mode: ModeShares, rank: int, *, installed: bool) -> str:
    state = "actuators installed" if installed else "no actuators"
    return f"Mode {rank}, {state}: {units.significant(mode.mode.frequency, 4)} Hz; the table: {describe_mode(mode)}"


def _extent(skins: Sequence[Skin]) -> float:
    return float(np.linalg.norm(np.ptp(np.vstack([skin.points for skin in skins]), axis=0)))


def _round_down(value: float) -> float:
    step = float(10 ** math.floor(math.log10(value)))
    return step * max(m for m in (1, 2, 5) if m * step <= value)
