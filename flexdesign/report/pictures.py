"""Pictures of mesh, deformation and stress, drawn off-screen.

VTK ends its process where no OpenGL library can be loaded, so that the drawing is done in a process of its own; if
that one dies, the report goes without pictures and says what to install.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from flexdesign import isolated

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: What a Debian system lacks where pictures fail.
REMEDY = "no OpenGL library; on Debian: apt-get install libgl1 libegl1 libegl-mesa0"

_SIZE = (1500, 940)
_INK = "#2b3138"


@dataclass(frozen=True)
class Picture:
    """What to draw.

    Parameters
    ----------
    file
        Name of the picture.
    points, tets
        The whole part, shapes (n, 3) [m] and (m, 4), or (m, 10) for quadratic elements.
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
        From the front, or obliquely.
    """

    file: str
    points: FloatArray
    tets: IntArray
    displacement: FloatArray | None = None
    scalars: FloatArray | None = None
    label: str = ""
    limits: tuple[float, float] | None = None
    edges: bool = False
    focus: tuple[tuple[float, float, float], float] | None = None
    view: Literal["front", "oblique"] = "front"
    notes: Sequence[str] = field(default_factory=tuple)


class NoPictures(Exception):
    """Nothing can be drawn here; the message says what to install."""


def draw(pictures: Sequence[Picture]) -> list[bytes]:
    """Draw the pictures in a process of their own and return them as PNG.

    Raises
    ------
    NoPictures
        If that process cannot draw.
    """
    try:
        return isolated.call(_draw_all, pictures)
    except isolated.ProcessDied as error:
        raise NoPictures(REMEDY) from error
    except RuntimeError as error:
        raise NoPictures(f"{error}") from error


def _draw_all(pictures: Sequence[Picture]) -> list[bytes]:
    import pyvista as pv

    logging.disable(logging.CRITICAL)
    pv.global_theme.font.color = _INK
    return [_draw(picture, pv) for picture in pictures]


def _draw(picture: Picture, pv: Any) -> bytes:
    import vtk

    vtk.vtkObject.GlobalWarningDisplayOff()  # without a display VTK warns on every window before it falls back
    vtk.vtkLogger.SetStderrVerbosity(vtk.vtkLogger.VERBOSITY_OFF)
    kind = pv.CellType.TETRA if picture.tets.shape[1] == 4 else pv.CellType.QUADRATIC_TETRA
    cells = {kind: picture.tets}
    grid = pv.UnstructuredGrid(cells, picture.points * 1e3)
    shown = grid.copy()
    if picture.displacement is not None:
        shown.points = (picture.points + picture.displacement) * 1e3
    if picture.scalars is not None:
        shown[picture.label] = picture.scalars
    plotter = pv.Plotter(off_screen=True, window_size=_SIZE)
    plotter.set_background("white")
    surface = _skin(shown)
    style: dict[str, Any] = {"color": "#b9c6d1"}
    if picture.scalars is not None:
        bar = {
            "title": f"{picture.label}\n",
            "color": _INK,
            "vertical": False,
            "position_x": 0.3,
            "position_y": 0.03,
            "width": 0.4,
            "height": 0.07,
            "fmt": "%.3g",
            "n_labels": 4,
            "title_font_size": 24,
            "label_font_size": 22,
        }
        style = {"scalars": picture.label, "cmap": "viridis", "clim": picture.limits, "scalar_bar_args": bar}
    plotter.add_mesh(
        surface, show_edges=picture.edges, edge_color="#41505c", line_width=0.6, smooth_shading=False, **style
    )
    outline = _skin(grid).extract_feature_edges(feature_angle=30, boundary_edges=False, manifold_edges=False)
    if picture.displacement is not None:
        plotter.add_mesh(outline, color="#8a949e", line_width=1.5)
    elif not picture.edges:
        plotter.add_mesh(outline, color=_INK, line_width=1.5)
    _aim(plotter, picture, grid)
    if picture.view == "front":
        _scale_bar(plotter, picture, grid, pv)
    for row, note in enumerate(picture.notes):
        plotter.add_text(note, position=(25, _SIZE[1] - 45 - 32 * row), font_size=12, color=_INK)
    image = plotter.screenshot(return_img=True)
    plotter.close()
    return _png(image)


def _skin(grid: Any) -> Any:
    """Outer surface, without the seams that mirrored halves leave in their symmetry planes."""
    return grid.clean(tolerance=1e-9).extract_surface(algorithm="dataset_surface", nonlinear_subdivision=2)


def _aim(plotter: Any, picture: Picture, grid: Any) -> None:
    centre = np.array(grid.center)
    half = max(np.ptp(grid.points[:, 1]) / 2, np.ptp(grid.points[:, 0]) / 2 / (_SIZE[0] / _SIZE[1])) * 1.32
    direction = np.array([0.0, 0.0, 1.0]) if picture.view == "front" else np.array([0.45, 0.55, 1.0])
    if picture.focus is not None:
        centre, half = np.array(picture.focus[0]) * 1e3, picture.focus[1] * 1e3
    plotter.enable_parallel_projection()
    plotter.camera.focal_point = centre
    plotter.camera.position = centre + direction / np.linalg.norm(direction) * 1000
    plotter.camera.up = (0.0, 1.0, 0.0)
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
        [(start + end) / 2 + [0, 0.03 * scale, 0]], [f"{length:g} mm"], font_size=26, text_color=_INK, shape=None,
        show_points=False, always_visible=True, justification_horizontal="center", justification_vertical="bottom",
    )  # fmt: skip


def _png(image: NDArray[np.uint8]) -> bytes:
    import io

    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(image).quantize(256, dither=Image.Dither.NONE).save(stream, format="PNG", optimize=True)
    return stream.getvalue()
