"""Measured against modelled as an interactive chart, and tables as HTML."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from flexdesign.core import units
from flexdesign.core.arrays import Array

if TYPE_CHECKING:
    from flexdesign.api.confrontation import Traces


@dataclass(frozen=True)
class Palette:
    """Colours with a contrast of at least 4.5 on their paper (WCAG AA).

    Parameters
    ----------
    paper
        What they are drawn on, that of style.css.
    measured, modelled
        The curves; letters are as the measured one.
    noise, some, large
        Residual within three times the noise, within ten times, and beyond.
    """

    paper: str
    measured: str
    modelled: str
    noise: str
    some: str
    large: str


LIGHT = Palette("#ffffff", "#1b1b1b", "#0b5fa5", "#5f6368", "#9a5b00", "#b3261e")
DARK = Palette("#1b2127", "#e8eaed", "#79b8f0", "#9aa0a6", "#e0a33a", "#ff8a80")
#: Lines that separate, on light and on dark paper alike.
LINE = "#8a949e55"
#: An ordinate about a curve that is zero everywhere; of other curves the chart chooses it.
ZERO = {f":{end}": f"y => y.min === 0 && y.max === 0 ? {value} : null" for end, value in (("min", -1), ("max", 1))}
#: A record that begins within a hundredth of its length after zero is drawn from zero on.
START = {":min": "x => x.min >= 0 && x.min < 0.01 * x.max ? 0 : x.min"}
#: Samples of a trace that a screen can show: of longer ones each stretch keeps its ends.
POINTS = 1200


def trace_options(traces: Traces, palette: Palette = LIGHT) -> dict[str, Any]:
    """Return the chart of one run: motion above, residual below, painted where it is large."""
    grid = [
        {"left": 70, "right": 16, "top": 34, "height": "46%"},
        {"left": 70, "right": 16, "top": "64%", "height": "20%"},
    ]
    name = {"nameLocation": "middle", "nameGap": 48, "nameTextStyle": {"color": palette.measured}, **ZERO}
    shown = {"color": palette.measured}
    axis = {"axisLabel": shown, "axisLine": {"lineStyle": shown}, "splitLine": {"lineStyle": {"color": LINE}}}
    floor = traces.floor
    return {
        "animation": False,
        "aria": {"enabled": True, "label": {"description": spoken(traces)}},
        "darkMode": palette is DARK,
        "legend": {"top": 0, "data": ["measured", "modelled", "residual"], "textStyle": shown},
        "tooltip": {
            "trigger": "axis", "axisPointer": {"type": "line"}, "backgroundColor": palette.paper, "textStyle": shown,
        },
        "axisPointer": {"link": [{"xAxisIndex": "all"}]},
        "grid": grid,
        "xAxis": [
            {**axis, "type": "value", "gridIndex": 0, "axisLabel": {"show": False}, "max": "dataMax", **START},
            {
                **axis, "type": "value", "gridIndex": 1, "name": "time [s]", "nameLocation": "middle", "nameGap": 22,
                "max": "dataMax", "nameTextStyle": shown, **START,
            },
        ],
        "yAxis": [
            {**axis, "type": "value", "gridIndex": 0, "name": f"motion [{traces.unit}]", "scale": True, **name},
            {**axis, "type": "value", "gridIndex": 1, "name": f"residual [{traces.fine}]", "splitNumber": 3, **name},
        ],
        "dataZoom": [
            {"type": "inside", "xAxisIndex": [0, 1]},
            {"type": "slider", "xAxisIndex": [0, 1], "height": 18, "bottom": 4, "textStyle": shown},
        ],
        "visualMap": {
            "show": False, "seriesIndex": 2, "dimension": 1, "type": "piecewise",
            "pieces": [
                {"lt": -10 * floor, "color": palette.large},
                {"gte": -10 * floor, "lt": -3 * floor, "color": palette.some},
                {"gte": -3 * floor, "lte": 3 * floor, "color": palette.noise},
                {"gt": 3 * floor, "lte": 10 * floor, "color": palette.some},
                {"gt": 10 * floor, "color": palette.large},
            ],
        },
        "series": trace_series(traces, palette),
    }  # fmt: skip


def trace_series(
    traces: Traces, palette: Palette = LIGHT, names: Sequence[str] = ("measured", "modelled", "residual")
) -> list[dict[str, Any]]:
    """Return curves of that chart by name; given to it again, they replace those that it has."""
    common = {"type": "line", "showSymbol": False, "connectNulls": False}
    lines: list[tuple[str, Any, int, dict[str, Any]]] = [
        ("measured", traces.measured, 0, {"color": palette.measured, "width": 1.5}),
        ("modelled", traces.modelled, 0, {"color": palette.modelled, "width": 1.5, "type": "dashed"}),
        ("residual", traces.residual, 1, {"width": 1.2}),
    ]
    return [
        {
            **common,
            "id": name,
            "name": name,
            "xAxisIndex": place,
            "yAxisIndex": place,
            "lineStyle": style,
            "itemStyle": {"color": style.get("color", palette.large)},
            "data": _points(traces.time, values),
        }
        for name, values, place, style in lines
        if name in names
    ]


def spoken(traces: Traces) -> str:
    """Return the chart in words, for who cannot see it."""
    return (
        f"Run {traces.run}, measured and modelled motion over time, and their residual: rms {traces.ratio:.3g} times "
        f"the noise floor of {traces.floor:.3g} {traces.fine}."
    )


def _points(time: Array, values: Array) -> list[list[float | None]]:
    """Return points of a curve; of a long one the least and the largest value of each stretch, in their order."""
    if len(time) > POINTS:
        stretch = -(-len(time) // (POINTS // 2))
        count = -(-len(time) // stretch)
        parts = np.append(values, np.full(count * stretch - len(values), np.nan)).reshape(count, stretch)
        least = np.where(np.isfinite(parts), parts, np.inf).argmin(axis=1)
        largest = np.where(np.isfinite(parts), parts, -np.inf).argmax(axis=1)
        places = np.unique(stretch * np.arange(count) + np.array([least, largest]))
        time, values = time[places], values[places]
    points: list[list[float | None]] = np.column_stack([_rounded(time, 6), _rounded(values, 5)]).tolist()
    for place in np.flatnonzero(~np.isfinite(values)):
        points[place][1] = None
    return points


def _rounded(values: Array, digits: int) -> Array:
    """Return values rounded to the given number of digits of the largest: what a chart can show."""
    largest = float(np.max(np.abs(values), initial=0.0, where=np.isfinite(values)))
    return np.round(values, digits - 1 - math.floor(math.log10(largest))) if largest else values


def table(columns: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "") -> str:
    """Return a table as HTML."""
    heads = "".join(f'<th scope="col">{_set(head)}</th>' for head in columns)
    body = "".join(f"<tr>{''.join(f'<td>{_set(cell)}</td>' for cell in row)}</tr>" for row in rows)
    title = f"<caption>{_set(caption)}</caption>" if caption else ""
    return f'<table class="fd-table">{title}<thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>'


def _set(text: object) -> str:
    return escape(units.typeset(str(text)))


def ladder(steps: Sequence[tuple[str, str, float]]) -> str:
    """Return the error ladder as a table with bars; the bars are logarithmic, one decade above the floor at 20 %."""
    rows = []
    for name, error, ratio in steps:
        width = 5 + 95 * min(max(np.log10(max(ratio, 1.0)) / 3, 0.0), 1.0)
        bar = f'<span class="fd-bar" style="width:{width:.0f}%" aria-hidden="true"></span>'
        rows.append(
            f'<tr><th scope="row">{_set(name)}</th><td>{_set(error)}</td>'
            f"<td>{ratio:.3g} × floor</td><td class='fd-bars'>{bar}</td></tr>"
        )
    heads = (
        "<tr><th scope='col'>model</th><th scope='col'>rms error</th><th scope='col'>over the floor</th><th></th></tr>"
    )
    return f'<table class="fd-table" id="ladder"><thead><tr>{heads}</tr></thead><tbody>{"".join(rows)}</tbody></table>'
