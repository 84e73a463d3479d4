"""A whole stage drawn off-screen: its skin, shaded by kind or coloured by how far it moves, the frame seen through.

Like `pictures`, in a process of its own, as VTK ends its process where no OpenGL library can be loaded.
"""

from __future__ import annotations

import io
import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import units
from flexdesign.report import views
from flexdesign.report.pictures import BAR, NOTE, apart

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LARGE, SMALL = (1500, 1000), (900, 640)
INK, OUTLINE, GLASS = "#2b3138", "#7b8792", "#aab6c1"
#: Colours from rest to the largest motion: pale where nothing moves, so that what does stands out.
MOTION = ("#e8ecef", "#b4dccf", "#5fb8bd", "#3a7fb8", "#5c4aa3")
#: Light from all around, so that faces turned away keep their colour.
LIGHT = {"ambient": 0.38, "diffuse": 0.66, "specular": 0.0, "smooth_shading": False}
#: Room above the stage for what is written there, as a share of its height.
STRIP = 0.15
#: Edges are drawn where neighbouring triangles differ by more than this [degrees].
CORNER = 35.0


@dataclass(frozen=True)
class Skin:
    """Surface triangles of one kind of thing.

    Parameters
    ----------
    name, colour
        What it is, and how it is drawn where nothing else colours it.
    points, triangles
        Shapes (n, 3) [m] and (m, 3).
    glass
        Whether one sees through it.
    """

    name: str
    colour: str
    points: FloatArray
    triangles: IntArray
    glass: bool = False


@dataclass(frozen=True)
class Scene:
    """One picture of the stage.

    Parameters
    ----------
    file
        Name of the picture.
    displacements
        By skin, as drawn, shape (n, 3) [m]; none for the stage at rest, each skin in its own colour.
    colours
        By skin, shape (n,), with a label; relative to the largest where there is no label.
    label
        Of the colours, with unit.
    view
        Where the camera stands, seen from the stage.
    size
        In pixels.
    notes
        What is written into the picture.
    """

    file: str
    displacements: Sequence[FloatArray] = field(default_factory=tuple)
    colours: Sequence[FloatArray] = field(default_factory=tuple)
    label: str = ""
    view: tuple[float, float, float] = (0.45, -1.0, 0.5)
    size: tuple[int, int] = LARGE
    notes: Sequence[str] = field(default_factory=tuple)


def draw(skins: Sequence[Skin], scenes: Sequence[Scene]) -> dict[str, bytes]:
    """Draw the pictures in a process of their own and return them as PNG, by their files' names.

    Raises
    ------
    NoPictures
        If that process cannot draw.
    """
    return apart(_draw_all, skins, scenes)


def _draw_all(skins: Sequence[Skin], scenes: Sequence[Scene]) -> dict[str, bytes]:
    import pyvista as pv
    import vtk

    logging.disable(logging.CRITICAL)
    vtk.vtkObject.GlobalWarningDisplayOff()
    vtk.vtkLogger.SetStderrVerbosity(vtk.vtkLogger.VERBOSITY_OFF)
    pv.global_theme.font.color = INK
    edges = [sharp_edges(skin) for skin in skins]
    return {scene.file: _draw(skins, edges, scene, pv) for scene in scenes}


def _draw(skins: Sequence[Skin], edges: Sequence[IntArray], scene: Scene, pv: Any) -> bytes:
    from matplotlib.colors import LinearSegmentedColormap

    plotter = pv.Plotter(off_screen=True, window_size=scene.size)
    plotter.set_background("white")
    plotter.enable_anti_aliasing("ssaa")
    plotter.enable_parallel_projection()
    colours = LinearSegmentedColormap.from_list("rest to motion", MOTION)
    limits = (0.0, max((float(np.max(each, initial=0.0)) for each in scene.colours), default=1.0))
    for index, (skin, lines) in enumerate(zip(skins, edges, strict=True)):
        if skin.glass:
            plotter.add_mesh(_surface(skin.points, skin, pv), color=GLASS, opacity=0.13)
            plotter.add_mesh(_lines(skin.points, lines, pv), color=OUTLINE, line_width=0.8, opacity=0.45)
        elif not scene.displacements:
            plotter.add_mesh(_surface(skin.points, skin, pv), color=skin.colour, **LIGHT)
            plotter.add_mesh(_lines(skin.points, lines, pv), color=INK, line_width=1.2)
        else:
            places = skin.points + scene.displacements[index]
            bent = _surface(places, skin, pv)
            bent["moved"] = scene.colours[index]
            actor = plotter.add_mesh(bent, scalars="moved", cmap=colours, clim=limits, show_scalar_bar=False, **LIGHT)
            plotter.add_mesh(_lines(places, lines, pv), color=INK, line_width=1.0, opacity=0.8)
            plotter.add_mesh(_lines(skin.points, lines, pv), color=OUTLINE, line_width=0.8, opacity=0.3)
    if scene.label:
        _bar(plotter, scene.label, actor.mapper)
    if not scene.displacements:
        named = [[skin.name, OUTLINE if skin.glass else skin.colour] for skin in skins]
        plotter.add_legend(
            named, bcolor=None, face="rectangle", size=(0.16, 0.03 * len(named)), loc="lower right", border=False
        )
    for row, note in enumerate(scene.notes):
        plotter.add_text(units.typeset(note), position=(28, scene.size[1] - 60 - 50 * row), font_size=NOTE, color=INK)
    _aim(plotter, np.vstack([skin.points for skin in skins]) * 1e3, scene)
    plotter.add_axes(color=INK, line_width=3, viewport=(0.0, 0.0, 0.12, 0.18))
    image = np.asarray(plotter.screenshot(return_img=True))
    plotter.close()
    return _png(image)


def _surface(points: FloatArray, skin: Skin, pv: Any) -> Any:
    faces = np.hstack([np.full((len(skin.triangles), 1), 3), skin.triangles])
    return pv.PolyData(points * 1e3, faces.ravel())


def _lines(points: FloatArray, pairs: IntArray, pv: Any) -> Any:
    return pv.PolyData(points * 1e3, lines=np.hstack([np.full((len(pairs), 1), 2), pairs]).ravel())


def sharp_edges(skin: Skin) -> IntArray:
    """Return the edges in which a skin has a corner, shape (k, 2); those where mirror images meet flush are none."""
    _, first, joined = np.unique(np.round(skin.points, 9), axis=0, return_index=True, return_inverse=True)
    corners = joined.reshape(-1)[skin.triangles]
    return np.asarray(first[views.sharp_edges(skin.points[first], corners, CORNER)])


def _bar(plotter: Any, label: str, mapper: Any) -> None:
    plotter.add_scalar_bar(title=f"{label}\n", mapper=mapper, **{**BAR, "fmt": "%.0f"})


def _aim(plotter: Any, points: FloatArray, scene: Scene) -> None:
    """Look at the whole stage with parallel rays."""
    away = np.array(scene.view) / np.linalg.norm(scene.view)
    right = np.cross([0.0, 0.0, 1.0], away)
    right /= np.linalg.norm(right)
    up = np.cross(away, right)
    across, upward = points @ right, points @ up
    wide, high = np.ptp(across), np.ptp(upward) * (1 + STRIP * bool(scene.notes))
    middle = (across.max() + across.min()) / 2 * right + (upward.min() + high / 2) * up
    plotter.camera.focal_point = middle
    plotter.camera.position = middle + 2000.0 * away
    plotter.camera.up = (0.0, 0.0, 1.0)
    plotter.camera.parallel_scale = max(high / 2, wide / 2 / (scene.size[0] / scene.size[1])) * 1.04
    plotter.reset_camera_clipping_range()


def _png(image: NDArray[np.uint8]) -> bytes:
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(image).quantize(256, dither=Image.Dither.NONE).save(stream, format="PNG", optimize=True)
    return stream.getvalue()
