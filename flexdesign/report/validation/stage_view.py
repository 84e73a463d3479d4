"""A stage as a page turns it: deformed as each axis is driven, and in its lowest modes; the frame is seen through."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexdesign.report.validation.stage_scene import Scene, Skin
from flexdesign.report.views import State, Surface, View

FloatArray = NDArray[np.float64]


def view(
    skins: Sequence[Skin],
    displaced: Sequence[FloatArray],
    driven: Sequence[tuple[str, str, float]],
    modes: Sequence[str],
    drawn: float,
) -> View:
    """Return the skins as one surface with a state for each field.

    Parameters
    ----------
    skins
        What is drawn.
    displaced
        Motions of their points, shape (n, 3, f) each [m]: fields of driven axes, then of modes.
    driven
        Of each driven axis: its name, what its full load is, and how many times as large its motion is drawn.
    modes
        Names of the modes.
    drawn
        How large the largest motion of a mode is drawn [m].
    """
    starts = np.cumsum([0, *(len(skin.points) for skin in skins)])
    shifted = [(skin, skin.triangles + start) for skin, start in zip(skins, starts, strict=False)]
    solid = np.concatenate([triangles for skin, triangles in shifted if not skin.glass])
    seen_through = [triangles for skin, triangles in shifted if skin.glass]
    motions = np.concatenate(list(displaced))
    states = [
        State(f"{axis.upper()} driven, {full}", 0, motions[..., index], enlarged, full=full)
        for index, (axis, full, enlarged) in enumerate(driven)
    ]
    states += [
        State.of_mode(name, 0, motions[..., index], drawn) for index, name in enumerate(modes, start=len(driven))
    ]
    surface = Surface(
        np.concatenate([skin.points for skin in skins]), solid, np.concatenate(seen_through) if seen_through else None
    )
    return View([surface], states, toward=Scene.view, up=(0.0, 0.0, 1.0))
