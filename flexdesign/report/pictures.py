"""Pictures of mesh, deformation, stress and vibrations, drawn off-screen.

VTK ends its process where no OpenGL library can be loaded, so that the drawing is done in a process of its own; if
that one dies, the report goes without pictures and says what to install.
"""

from __future__ import annotations

import io
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, ParamSpec

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import subprocess_call
from flexdesign.report.document import Figure

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
P = ParamSpec("P")

#: What a Debian system lacks where pictures fail.
REMEDY = "no OpenGL library; on Debian: apt-get install libgl1 libegl1 libegl-mesa0"

_SIZE, _SMALL = (1500, 940), (720, 450)
#: What a moving picture shows of its displacement: half a period, which it then goes back; the time of a frame [ms].
SWING, FRAME = tuple(np.cos(np.pi * np.arange(9) / 8).tolist()), 60
_INK = "#2b3138"
#: The colour of a mark, which no colour map has.
MARK = "#d62728"
#: Reports show a picture at about a third of its size: letters are so large that 11 pixels or more remain there. A text
#: of VTK's in points takes about 1.4 pixels each.
TITLE, LABEL, NOTE = 40, 36, 24
#: Share of a picture's height that a scalar bar with its title takes, and that a line of text does.
BAR_SHARE, LINE_SHARE = 0.2, 0.07
#: Room around a part, relative to its size: along an edge with letters, and where there are none.
MARGIN, WIDE_MARGIN = 1.1, 1.32
#: How a scalar bar is lettered and placed.
BAR: dict[str, Any] = {
    "color": _INK, "vertical": False, "position_x": 0.25, "position_y": 0.02, "width": 0.5, "height": 0.13,
    "fmt": "%.3g", "n_labels": 4, "title_font_size": TITLE, "label_font_size": LABEL, "unconstrained_font_size": True,
}  # fmt: skip


@dataclass(frozen=True)
class Picture:
    """What to draw.

    Parameters
    ----------
    file
        Name of the picture.
    points, cells
        The whole part, shapes (n, 3) [m] and (m, 4), or (m, 10) for quadratic elements, or (m, 3) for the triangles of
        its surface.
    displacement
        Exaggerated as drawn, shape (n, 3) [m]; the undeformed outline is then drawn as well. None for none.
    scalars, label
        Colours, shape (n,), and what they are, with unit.
    limits
        Range of the colours; None for theirs.
    edges
        Whether element edges are drawn.
    focus
        Centre and half-height of the view, [m]; None for the whole part.
    view
        From the front, obliquely, or from this direction.
    notes
        What is written into the picture.
    mark
        A point [m] of a front view that is marked, and what is said of it in a corner.
    labels
        Points [m] and what is written there, where nothing is in front of them.
    """

    file: str
    points: FloatArray
    cells: IntArray
    displacement: FloatArray | None = None
    scalars: FloatArray | None = None
    label: str = ""
    limits: tuple[float, float] | None = None
    edges: bool = False
    focus: tuple[tuple[float, float, float], float] | None = None
    view: Literal["front", "oblique"] | tuple[float, float, float] = "front"
    notes: Sequence[str] = field(default_factory=tuple)
    mark: tuple[tuple[float, float, float], str] | None = None
    labels: Sequence[tuple[tuple[float, float, float], str]] = ()


@dataclass(frozen=True)
class Reel:
    """Small pictures of one part in motion, all in the same oblique view and drawn by the same window.

    Parameters
    ----------
    points, cells
        As in a `Picture`.
    shots
        What to draw of it.
    """

    points: FloatArray
    cells: IntArray
    shots: Sequence[Shot]


@dataclass(frozen=True)
class Shot:
    """One of them.

    Parameters
    ----------
    file
        Name of the picture.
    displacement
        Exaggerated as drawn, shape (n, 3) [m].
    moving
        Whether it swings, as an animated PNG; viewers that know none of these show the largest displacement.
    """

    file: str
    displacement: FloatArray
    moving: bool = False


class NoPictures(Exception):
    """Nothing can be drawn here; the message says what to install."""


def draw_or_explain(
    draw: Callable[[], tuple[list[Figure], list[Figure]]], progress: Callable[[str], None]
) -> tuple[list[Figure], list[Figure], list[str]]:
    """Return two groups of pictures; where none can be drawn, none, and a sentence that says why."""
    try:
        return *draw(), []
    except NoPictures as error:
        sentences = f"No pictures: {error}."
        progress(sentences)
        return [], [], [sentences]


def draw(pictures: Sequence[Picture], reel: Reel | None = None) -> dict[str, bytes]:
    """Draw the pictures in a process of their own and return them as PNG, by their files' names.

    Raises
    ------
    NoPictures
        If that process cannot draw.
    """
    return apart(_draw_all, pictures, reel)


def apart(draw_all: Callable[P, dict[str, bytes]], *arguments: P.args, **options: P.kwargs) -> dict[str, bytes]:
    """Return what a function draws in a process of its own: without a graphics library that process ends at once.

    Raises
    ------
    NoPictures
        If it cannot draw.
    """
    try:
        return subprocess_call.call(draw_all, *arguments, **options)
    except subprocess_call.ProcessDied as error:
        raise NoPictures(REMEDY) from error
    except RuntimeError as error:
        raise NoPictures(f"{error}") from error


def _draw_all(pictures: Sequence[Picture], reel: Reel | None) -> dict[str, bytes]:
    import pyvista as pv
    import vtk

    logging.disable(logging.CRITICAL)
    vtk.vtkObject.GlobalWarningDisplayOff()  # without a display VTK warns on every window before it falls back
    vtk.vtkLogger.SetStderrVerbosity(vtk.vtkLogger.VERBOSITY_OFF)
    pv.global_theme.font.color = _INK
    images = {picture.file: _draw(picture, pv) for picture in pictures}
    return images | (_draw_reel(reel, pv) if reel is not None else {})


def _draw_reel(reel: Reel, pv: Any) -> dict[str, bytes]:
    rest = _grid(reel.points, reel.cells, pv)
    points = rest.copy()
    for index, shot in enumerate(reel.shots):
        points[f"{index}"] = shot.displacement * 1e3
    surface = _skin(points, subdivision=1)
    still = surface.points.copy()
    plotter = pv.Plotter(off_screen=True, window_size=_SMALL)
    plotter.set_background("white")
    surface["motion"] = np.zeros(surface.n_points)
    plotter.add_mesh(surface, scalars="motion", cmap="viridis", clim=(0.0, 1.0), show_scalar_bar=False)
    _add_outline(plotter, rest, "#8a949e", 1.0)
    _aim(plotter, [rest], np.array([0.45, 0.55, 1.0]), _SMALL)

    def drawn(displacement: FloatArray, phase: float) -> NDArray[np.uint8]:
        surface.points = still + phase * displacement
        plotter.render()
        return np.asarray(plotter.screenshot(return_img=True))

    files = {}
    for index, shot in enumerate(reel.shots):
        displacement = np.asarray(surface[f"{index}"])
        size = np.linalg.norm(displacement, axis=1)
        surface["motion"] = size / size.max()
        frames = [drawn(displacement, phase) for phase in (SWING if shot.moving else (1.0,))]
        files[shot.file] = _animate(frames) if shot.moving else _png(frames[0])
    plotter.close()
    return files


def _grid(points: FloatArray, cells: IntArray, pv: Any) -> Any:
    """Return the part as VTK has it, in mm."""
    kinds = {3: pv.CellType.TRIANGLE, 4: pv.CellType.TETRA, 10: pv.CellType.QUADRATIC_TETRA}
    return pv.UnstructuredGrid({kinds[cells.shape[1]]: cells}, points * 1e3)


def _draw(picture: Picture, pv: Any) -> bytes:
    grid = _grid(picture.points, picture.cells, pv)
    deformed = grid.copy()
    if picture.displacement is not None:
        deformed.points = (picture.points + picture.displacement) * 1e3
    if picture.scalars is not None:
        deformed[picture.label] = picture.scalars
    plotter = pv.Plotter(off_screen=True, window_size=_SIZE)
    plotter.set_background("white")
    surface = _skin(deformed)
    style: dict[str, Any] = {"color": "#b9c6d1"}
    if picture.scalars is not None:
        bar = {"title": f"{picture.label}\n", **BAR}
        style = {"scalars": picture.label, "cmap": "viridis", "clim": picture.limits, "scalar_bar_args": bar}
    plotter.add_mesh(
        surface, show_edges=picture.edges, edge_color="#41505c", line_width=0.6, smooth_shading=False, **style
    )
    if picture.displacement is not None:
        _add_outline(plotter, grid, "#8a949e", 1.5)
    elif not picture.edges:
        _add_outline(plotter, grid, _INK, 1.5)
    directions = {"front": (0.0, 0.0, 1.0), "oblique": (0.45, 0.55, 1.0)}
    direction = directions[picture.view] if isinstance(picture.view, str) else picture.view
    below = BAR_SHARE if picture.scalars is not None else 0.0
    above = LINE_SHARE * (len(picture.notes) + (picture.mark is not None))
    _aim(plotter, [grid, deformed], np.array(direction), _SIZE, picture.focus, (below, above))
    if picture.view == "front":
        _scale_bar(plotter, picture, grid, pv)
    for row, note in enumerate(picture.notes):
        plotter.add_text(note, position=(25, _SIZE[1] - 60 - 50 * row), font_size=NOTE, color=_INK)
    if picture.mark is not None:
        _mark(plotter, *picture.mark, front=float(grid.points[:, 2].max()) + 1.0)
    if picture.labels:
        plotter.add_point_labels(
            1e3 * np.array([point for point, _ in picture.labels]), [text for _, text in picture.labels],
            font_size=LABEL, text_color=_INK, shape_color="white", shape_opacity=0.9, show_points=False,
            always_visible=False,
        )  # fmt: skip
    image = plotter.screenshot(return_img=True)
    plotter.close()
    return _png(image)


def displacement_unit(largest: float) -> tuple[float, str]:
    """Return the factor from metres to a unit in which the largest displacement [m] has few digits, and a label."""
    factor, unit = (1e3, "mm") if largest >= 1e-3 else (1e6, "µm") if largest >= 1e-6 else (1e9, "nm")
    return factor, f"displacement [{unit}]"


def _skin(grid: Any, subdivision: int = 2) -> Any:
    """Outer surface, without the seams that mirrored halves leave in their symmetry planes."""
    return grid.clean(tolerance=1e-9).extract_surface(algorithm="dataset_surface", nonlinear_subdivision=subdivision)


def _add_outline(plotter: Any, grid: Any, colour: str, width: float) -> None:
    """Draw the sharp edges of a grid, if it has some: a ball has none, and VTK draws nothing that is empty."""
    edges = _skin(grid).extract_feature_edges(feature_angle=30, boundary_edges=False, manifold_edges=False)
    if edges.n_points:
        plotter.add_mesh(edges, color=colour, line_width=width)


def _aim(
    plotter: Any,
    grids: Sequence[Any],
    direction: FloatArray,
    size: tuple[int, int],
    focus: tuple[tuple[float, float, float], float] | None = None,
    lettered: tuple[float, float] = (0.0, 0.0),
) -> None:
    """Look along a direction, at all of the grids or at a focus, with parallel rays.

    Shares of the height `lettered`, below and above, are for letters: the part stands between them.
    """
    toward = direction / np.linalg.norm(direction)
    upright = np.array([0.0, 1.0, 0.0]) if abs(toward[1]) < 0.9 else np.array([0.0, 0.0, -1.0])
    right = np.cross(upright, toward)
    right /= np.linalg.norm(right)
    upward = np.cross(toward, right)
    axes = np.stack([right, upward])  # across and up, as the camera sees it
    seen = axes @ np.concatenate([grid.points for grid in grids]).T
    centre = np.array(grids[0].center)
    centre += ((seen.min(axis=1) + seen.max(axis=1)) / 2 - axes @ centre) @ axes
    below, above = lettered
    width, height = np.ptp(seen, axis=1)
    tall = max(MARGIN / (1.0 - below - above), WIDE_MARGIN) * height
    half = max(tall, WIDE_MARGIN * width * size[1] / size[0]) / 2
    if focus is not None:
        centre, half = np.array(focus[0]) * 1e3, focus[1] * 1e3
    centre -= (below - above) * half * upward
    plotter.enable_parallel_projection()
    plotter.camera.focal_point = centre
    plotter.camera.position = centre + toward * 2 * grids[0].length  # before all of it
    plotter.camera.up = upright
    plotter.camera.parallel_scale = half
    plotter.reset_camera_clipping_range()


def _scale_bar(plotter: Any, picture: Picture, grid: Any, pv: Any) -> None:
    scale, centre = plotter.camera.parallel_scale, np.array(plotter.camera.focal_point)
    wide = scale * _SIZE[0] / _SIZE[1]
    length = 10 ** np.floor(np.log10(wide / 3))
    length *= max(step for step in (1, 2, 5) if step * length <= wide / 2.5)
    front = float(grid.points[:, 2].max()) + 1.0
    start = np.array([centre[0] + 0.94 * wide - length, centre[1] - 0.90 * scale, front])
    end = start + np.array([length, 0, 0])
    plotter.add_mesh(pv.Line(start, end), color=_INK, line_width=5)
    plotter.add_point_labels(
        [(start + end) / 2 + [0, 0.03 * scale, 0]], [f"{length:g} mm"], font_size=LABEL, text_color=_INK, shape=None,
        show_points=False, always_visible=True, justification_horizontal="center", justification_vertical="bottom",
    )  # fmt: skip


def _mark(plotter: Any, point: tuple[float, float, float], text: str, front: float) -> None:
    """Put a dot before a point [m] of the front view, and a text into the upper left corner."""
    x, y, _ = 1e3 * np.array(point)
    plotter.add_points(np.array([[x, y, front]]), color=MARK, point_size=26, render_points_as_spheres=True)
    written = plotter.add_text(f"• {text}", position=(25, _SIZE[1] - 60), font_size=NOTE, color=MARK)
    written.prop.SetBackgroundColor(1.0, 1.0, 1.0)
    written.prop.SetBackgroundOpacity(1.0)


def _animate(frames: Sequence[NDArray[np.uint8]]) -> bytes:
    """Return an animated PNG that swings through the frames and back, for ever."""
    from PIL import Image

    first = Image.fromarray(frames[0]).quantize(256, dither=Image.Dither.NONE)
    others = [Image.fromarray(frame).quantize(palette=first, dither=Image.Dither.NONE) for frame in frames[1:]]
    stream = io.BytesIO()
    back = others[-2::-1]
    first.save(stream, "PNG", save_all=True, append_images=[*others, *back], duration=FRAME, loop=0, optimize=True)
    return stream.getvalue()


def _png(image: NDArray[np.uint8]) -> bytes:
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(image).quantize(256, dither=Image.Dither.NONE).save(stream, format="PNG", optimize=True)
    return stream.getvalue()
