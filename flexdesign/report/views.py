"""A part or stage that a page turns: surfaces, and the states among which the reader chooses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import units
from flexdesign.report import packed

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
#: Points that are closer than this share of the part are one.
MERGED = 1e-7
#: Edges are drawn where neighbouring triangles differ by more than this [degrees].
CORNER = 30.0


@dataclass(frozen=True)
class Surface:
    """Triangles, seen from outside counter-clockwise.

    Parameters
    ----------
    points, triangles
        Shapes (n, 3) [m] and (m, 3).
    glass
        Triangles that one sees through, shape (k, 3).
    """

    points: FloatArray
    triangles: IntArray
    glass: IntArray | None = None


@dataclass(frozen=True)
class State:
    """What moves a surface, and what colours it.

    Parameters
    ----------
    name
        As the reader chooses it.
    surface
        Which surface moves.
    displacement
        At the full load or at the crest of a mode, shape (n, 3) [m].
    enlarged
        How many times as large it is drawn.
    slider
        Whether the slider sets the load or the phase of a mode.
    label, unit, values
        Colours, shape (n,): what they are; none for the size of the displacement [um].
    full
        What the full load is.
    limit
        Where the colours end; none for the largest value.
    """

    name: str
    surface: int
    displacement: FloatArray
    enlarged: float
    slider: Literal["load", "phase"] = "load"
    label: str = "displacement"
    unit: str = "µm"
    values: FloatArray | None = None
    full: str = ""
    limit: float | None = None

    @classmethod
    def of_mode(cls, name: str, surface: int, shape: FloatArray, drawn: float) -> State:
        """Return a mode, of whatever size its shape is, whose largest motion is drawn as long as stated [m].

        Its crest is taken as 1 µm; its colours are relative to the largest motion.
        """
        size = np.linalg.norm(shape, axis=1)
        crest, what = 1e-6 * shape / size.max(), "motion, relative to the largest"
        return cls(name, surface, crest, 1e6 * drawn, "phase", what, "", size / size.max())


@dataclass(frozen=True)
class View:
    """Surfaces and their states.

    Parameters
    ----------
    surfaces, states
        What there is, and what is shown of it; the first state is shown first.
    toward, up
        Where the camera stands, seen from the part, and which direction is up.
    """

    surfaces: Sequence[Surface]
    states: Sequence[State]
    toward: tuple[float, float, float] = (0.45, 0.55, 1.0)
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)

    @property
    def curves(self) -> int:
        """How many curves share the room of a page: none."""
        return 0

    @property
    def kind(self) -> str:
        """The page's script that shows it."""
        return "view"

    def payload(self, points: int) -> dict[str, Any]:
        """Return the data of a page; lengths in mm, displacements in µm. It has no curves, and `points` no meaning."""
        first = [next(s.displacement for s in self.states if s.surface == k) for k in range(len(self.surfaces))]
        merged = [_merge_points(surface, motion) for surface, motion in zip(self.surfaces, first, strict=True)]
        return {
            "toward": self.toward,
            "up": self.up,
            "surfaces": [_surface(surface) for surface, _ in merged],
            "states": [
                {
                    "name": units.typeset(state.name),
                    "surface": state.surface,
                    "displacement": packed.quantise(1e6 * state.displacement[merged[state.surface][1]]),
                    "enlarged": state.enlarged,
                    "slider": state.slider,
                    "label": state.label,
                    "unit": state.unit,
                    "values": None if state.values is None else packed.quantise(state.values[merged[state.surface][1]]),
                    "full": units.typeset(state.full),
                    "limit": state.limit,
                }
                for state in self.states
            ],
        }


def _surface(surface: Surface) -> dict[str, Any]:
    edges = np.concatenate(
        [sharp_edges(surface.points, t) for t in (surface.triangles, surface.glass) if t is not None]
    )
    return {
        "points": packed.exact(1e3 * surface.points),
        "triangles": packed.corners(surface.triangles),
        "glass": None if surface.glass is None else packed.corners(surface.glass),
        "edges": packed.corners(edges),
    }


def _merge_points(surface: Surface, motion: FloatArray) -> tuple[Surface, IntArray]:
    """Return a surface of the points that its triangles need, each once, and which of the points these are.

    Points that lie and move together are one; parts that only touch stay apart.
    """
    every = surface.triangles if surface.glass is None else np.concatenate([surface.triangles, surface.glass])
    used, places = np.unique(every, return_inverse=True)
    alike = [MERGED * max(float(np.abs(field[used]).max()), 1e-300) for field in (surface.points, motion)]
    keys = np.hstack([np.round(f[used] / a) for f, a in zip((surface.points, motion), alike, strict=True)])
    _, first, joined = np.unique(keys + 0.0, axis=0, return_index=True, return_inverse=True)
    triangles = joined.reshape(-1)[places.reshape(-1, 3)]
    solid = len(surface.triangles)
    glass = None if surface.glass is None else triangles[solid:]
    kept = used[first]
    return Surface(surface.points[kept], triangles[:solid], glass), kept


def sharp_edges(points: FloatArray, triangles: IntArray, corner: float = CORNER) -> IntArray:
    """Return the edges in which a surface of merged points has a corner, shape (k, 2)."""
    sides = points[triangles]
    normals = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    edges, owners = edges[order], order // 3
    pairs = np.flatnonzero((edges[1:] == edges[:-1]).all(axis=1))
    cosines = np.einsum("ij,ij->i", normals[owners[pairs]], normals[owners[pairs + 1]])
    return np.asarray(edges[pairs[cosines < np.cos(np.radians(corner))]])
