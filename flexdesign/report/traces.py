"""Curves in panels over a common abscissa: as SVG, and as data that a page zooms into."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import units
from flexdesign.core.arrays import Array
from flexdesign.report import packed
from flexdesign.report.charts import COLOURS, NEUTRAL, plain, svg

IntArray = NDArray[np.int64]
#: Most points of a curve.
POINTS = 1000
#: Points this number of times the usual distance apart are not joined.
GAP = 10.0


@dataclass(frozen=True)
class Curve:
    """One line: its label, abscissae and ordinates in the units of the axes; dashed for what was asked."""

    label: str
    x: Array
    y: Array
    dashed: bool = False


@dataclass(frozen=True)
class Traces:
    """Panels above each other; a label has one colour in all of them.

    Parameters
    ----------
    rows
        The curves of each panel.
    xlabel, ylabels
        Axis labels with units, one ordinate for each panel.
    height
        Of each panel [inches].
    limits
        Range of the abscissa that is shown first.
    """

    rows: Sequence[Sequence[Curve]]
    xlabel: str
    ylabels: Sequence[str]
    height: float = 2.5
    limits: tuple[float, float] | None = None

    @property
    def every(self) -> list[Curve]:
        """The curves of all panels."""
        return [curve for row in self.rows for curve in row]

    @property
    def curves(self) -> int:
        """How many curves share the room of a page."""
        return len(self.every)

    @property
    def kind(self) -> str:
        """The page's script that shows them."""
        return "traces"

    def svg(self) -> bytes:
        """Draw the panels."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(7.2, self.height * len(self.rows) + 0.9), layout="constrained")
        axes = figure.subplots(len(self.rows), 1, sharex=True, squeeze=False)[:, 0]
        for place, curves, ylabel in zip(axes, self.rows, self.ylabels, strict=True):
            for curve in curves:
                x, y = thin_out(curve.x, curve.y, self.limits)
                style = {"linestyle": (0, (4, 3)), "linewidth": 1.1} if curve.dashed else {"linewidth": 1.4}
                order = 3 if curve.dashed else 2
                place.plot(x, y, color=self._colour(curve), label=curve.label, zorder=order, **style)
            place.set_ylabel(ylabel)
            plain(place)
            place.grid(color=NEUTRAL, alpha=0.25)
        axes[-1].set_xlabel(self.xlabel)
        if self.limits:
            axes[-1].set_xlim(*self.limits)
        _legend(figure, list(axes))
        return svg(figure)

    def payload(self, points: int) -> dict[str, Any]:
        """Return the data of a page, with a limited number of points in a curve."""
        return {
            "x": units.typeset(self.xlabel),
            "limits": self.limits,
            "panels": [
                {"y": units.typeset(ylabel), "groups": [self._group(group, points) for group in _groups(curves)]}
                for curves, ylabel in zip(self.rows, self.ylabels, strict=True)
            ],
        }

    def _group(self, curves: Sequence[Curve], points: int) -> dict[str, Any]:
        x, rows = curves[0].x, np.stack([curve.y for curve in curves])
        kept = extremes(rows, points)
        return {
            "x": packed.exact(x[kept]),
            "curves": [
                {
                    "label": units.typeset(c.label),
                    "colour": self._colour(c),
                    "dashed": c.dashed,
                    "y": packed.quantise(row),
                }
                for c, row in zip(curves, rows[:, kept], strict=True)
            ],
        }

    def _colour(self, curve: Curve) -> str:
        if curve.dashed:
            return NEUTRAL
        labels = list(dict.fromkeys(c.label for c in self.every if not c.dashed))
        return COLOURS[labels.index(curve.label) % len(COLOURS)]


def _groups(curves: Sequence[Curve]) -> list[list[Curve]]:
    """Return curves that share their abscissae together."""
    groups: list[list[Curve]] = []
    for curve in curves:
        for group in groups:
            if curve.x is group[0].x or np.array_equal(curve.x, group[0].x):
                group.append(curve)
                break
        else:
            groups.append([curve])
    return groups


def with_gaps(x: Array, *rows: Array) -> tuple[Array, ...]:
    """Return abscissae and ordinates with a NaN where nothing was recorded for long, so that no line crosses it.

    >>> [row.tolist() for row in with_gaps(np.array([0.0, 1.0, 2.0, 30.0]), np.ones(4))]
    [[0.0, 1.0, 2.0, 16.0, 30.0], [1.0, 1.0, 1.0, nan, 1.0]]
    """
    apart = np.diff(x)
    places = np.flatnonzero(apart > GAP * np.median(apart)) + 1 if len(apart) else np.zeros(0, dtype=int)
    middles = 0.5 * (x[places - 1] + x[places])
    return np.insert(x, places, middles), *(np.insert(row, places, np.nan) for row in rows)


def thin_out(x: Array, y: Array, limits: tuple[float, float] | None = None) -> tuple[Array, Array]:
    """Return a curve with fewer points: of each stretch the first, the lowest, the highest and the last."""
    if limits:
        inside = np.flatnonzero((x >= limits[0]) & (x <= limits[1]))
        if inside.size:
            x, y = x[inside[0] : inside[-1] + 1], y[inside[0] : inside[-1] + 1]
    kept = extremes(y[None, :], POINTS)
    return x[kept], y[kept]


def extremes(rows: Array, points: int) -> IntArray:
    """Return which of n samples to keep so that no row, shape (k, n), loses a peak.

    Of each stretch these are the first and the last sample, the lowest and the highest of each row, and the first that
    a row lacks; a row alone keeps at most `points` of them.
    """
    count = rows.shape[1]
    if count <= points:
        return np.arange(count)
    kept = set[int]()
    stretches = max(points // (3 + 2 * len(rows)), 1)
    for first, last in pairwise(np.linspace(0, count, stretches + 1).astype(int)):
        part = np.nan_to_num(rows[:, first:last])
        kept |= {int(first), int(last) - 1}
        lacks = np.flatnonzero(np.isnan(rows[:, first:last]).any(axis=0))[:1]
        kept |= {int(first) + int(k) for k in (*part.argmin(axis=1), *part.argmax(axis=1), *lacks)}
    return np.array(sorted(kept))


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
