"""Line drawings of simulated experiments: responses over time, loops, errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.report.charts import COLOURS, NEUTRAL, plain, svg

Array = NDArray[np.float64]
#: A curve is drawn with at most so many points.
POINTS = 1000


@dataclass(frozen=True)
class Curve:
    """One line: its label, abscissae and ordinates in the units of the axes; dashed for what was asked."""

    label: str
    x: Array
    y: Array
    dashed: bool = False


def panels(
    rows: Sequence[Sequence[Curve]],
    xlabel: str,
    ylabels: Sequence[str],
    *,
    height: float = 2.5,
    limits: tuple[float, float] | None = None,
) -> bytes:
    """Draw panels above each other with a common abscissa; a label has one colour in all of them.

    Parameters
    ----------
    rows
        The curves of each panel.
    xlabel, ylabels
        Axis labels, one ordinate for each panel.
    height
        Of each panel [inches].
    limits
        Range of the abscissa.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, height * len(rows) + 0.9), layout="constrained")
    axes = figure.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0]
    labels = list(dict.fromkeys(c.label for row in rows for c in row if not c.dashed))
    for place, curves, ylabel in zip(axes, rows, ylabels, strict=True):
        for curve in curves:
            colour = NEUTRAL if curve.dashed else COLOURS[labels.index(curve.label) % len(COLOURS)]
            x, y = thinned(curve.x, curve.y, limits)
            style = {"linestyle": (0, (4, 3)), "linewidth": 1.1} if curve.dashed else {"linewidth": 1.4}
            place.plot(x, y, color=colour, label=curve.label, zorder=3 if curve.dashed else 2, **style)
        place.set_ylabel(ylabel)
        plain(place)
        place.grid(color=NEUTRAL, alpha=0.25)
    axes[-1].set_xlabel(xlabel)
    if limits:
        axes[-1].set_xlim(*limits)
    _legend(figure, list(axes))
    return svg(figure)


def thinned(x: Array, y: Array, limits: tuple[float, float] | None = None) -> tuple[Array, Array]:
    """Return a curve with fewer points: of each stretch the first, the lowest, the highest and the last."""
    if limits:
        inside = np.flatnonzero((x >= limits[0]) & (x <= limits[1]))
        if inside.size:
            x, y = x[inside[0] : inside[-1] + 1], y[inside[0] : inside[-1] + 1]
    if len(x) <= POINTS:
        return x, y
    edges = np.linspace(0, len(x), POINTS // 4 + 1).astype(int)
    kept = set()
    for first, last in pairwise(edges):
        part = y[first:last]
        kept |= {first, first + int(part.argmin()), first + int(part.argmax()), last - 1}
    index = np.array(sorted(kept))
    return x[index], y[index]


def _legend(figure: Any, axes: Sequence[Any]) -> None:
    found: dict[str, Any] = {}
    for place in axes:
        handles, labels = place.get_legend_handles_labels()
        found |= {label: handle for label, handle in zip(labels, handles, strict=True) if label not in found}
    if len(found) < 2:
        return
    columns = 3 if max(map(len, found)) < 26 else 2
    legend = figure.legend(
        found.values(), found.keys(), loc="outside lower center", ncols=columns, frameon=False, fontsize=9
    )
    for text in legend.get_texts():
        text.set_color(NEUTRAL)
