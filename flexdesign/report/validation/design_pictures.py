"""Pictures of designs side by side: extruded parts as sections in one scale, others as solids, off-screen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.arrays import Array
from flexdesign.design.design import Design
from flexdesign.design.part import Outline, straight_outline
from flexdesign.report import charts, pictures
from flexdesign.report.document import Figure
from flexdesign.report.pictures import NoPictures, Picture

#: Chord and angle of the triangles that approximate a solid's curved faces [mm], [rad].
CHORD, ANGLE = 0.05, 0.1


def draw(designs: Mapping[str, Design]) -> tuple[list[Figure], list[str]]:
    """Draw designs, each under what it is called.

    Returns
    -------
    figures, said
        The pictures, and why some are not there.
    """
    outlines = {label: _outline(design) for label, design in designs.items()}
    drawn_outlines = {label: outline for label, outline in outlines.items() if outline is not None}
    figures = [_sections(drawn_outlines)] if drawn_outlines else []
    try:
        return [*figures, *_solids({label: designs[label] for label in designs if label not in drawn_outlines})], []
    except NoPictures as error:
        return figures, [f"No pictures: {error}."]


def _outline(design: Design) -> Outline | None:
    """Return the section of an extruded part; None where a part does not state it, and of a stage."""
    return None if design.is_stage else straight_outline(design.part())


def _solids(designs: Mapping[str, Design]) -> list[Figure]:
    """Draw the solids of designs obliquely, each in a picture of its own.

    Raises
    ------
    NoPictures
        If nothing can be drawn on this machine.
    """
    jobs = {
        label: Picture(f"design_{i}.png", *skin(design), view="oblique")
        for i, (label, design) in enumerate(designs.items(), 1)
    }
    images = pictures.draw(list(jobs.values())) if jobs else {}
    return [Figure(picture.file, images[picture.file], label) for label, picture in jobs.items()]


def skin(design: Design) -> tuple[Array, NDArray[np.int64]]:
    """Return the surface of a design's solid: points [m] and triangles."""
    solid = design.stage().solid() if design.is_stage else design.part().solid()
    points, triangles = solid.tessellate(CHORD, ANGLE)
    return 1e-3 * np.array([point.toTuple() for point in points]), np.array(triangles)


def _sections(drawn_outlines: Mapping[str, Outline]) -> Figure:
    """Draw sections in one scale."""
    from matplotlib.figure import Figure as Drawing
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    drawing, shared = Drawing(figsize=(2.6 * len(drawn_outlines), 2.4), layout="constrained"), None
    for place, (label, outline) in enumerate(drawn_outlines.items(), 1):
        axes = drawing.add_subplot(1, len(drawn_outlines), place, sharex=shared, sharey=shared)
        shared = shared or axes
        loops = [Path(1e3 * loop, closed=True) for loop in _orient_loops(outline.loops)]
        axes.add_patch(PathPatch(Path.make_compound_path(*loops), facecolor=charts.COLOURS[0], edgecolor="none"))
        axes.set_title(label.replace(", ", "\n"), fontsize=8, color=charts.NEUTRAL)
        axes.set_aspect("equal")
        axes.autoscale_view()
        axes.set_axis_off()
    return Figure("sections.svg", charts.svg(drawing), "Sections of the designs, in one scale")


def _orient_loops(loops: Sequence[Sequence[tuple[float, float]]]) -> list[Array]:
    """Return contours closed, the largest to the left and the holes in it to the right, as filling asks."""
    closed = [np.array([*loop, loop[0]]) for loop in loops]
    areas = [float(np.sum(c[:-1, 0] * c[1:, 1] - c[1:, 0] * c[:-1, 1])) for c in closed]
    largest = max(range(len(areas)), key=lambda i: abs(areas[i]))
    return [
        c if (area > 0) == (i == largest) else c[::-1] for i, (c, area) in enumerate(zip(closed, areas, strict=True))
    ]
