"""Measured against modelled as an interactive chart, and tables as HTML."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from flexdesign.api.confrontation import Traces

Array = NDArray[np.float64]
#: Colours with a contrast of at least 4.5 on white (WCAG AA): measured, modelled; residual within three times the
#: noise, within ten times, and beyond.
MEASURED, MODELLED, NOISE, SOME, LARGE = "#1b1b1b", "#0b5fa5", "#5f6368", "#9a5b00", "#b3261e"
#: Samples of a trace that a screen can show: of longer ones each stretch keeps its ends.
POINTS = 1200


def trace_options(traces: Traces) -> dict[str, Any]:
    """Return the chart of one run: motion above, residual below, painted where it is large."""
    grid = [
        {"left": 70, "right": 16, "top": 34, "height": "46%"},
        {"left": 70, "right": 16, "top": "64%", "height": "20%"},
    ]
    name = {"nameLocation": "middle", "nameGap": 48, "nameTextStyle": {"color": MEASURED}}
    floor = traces.floor
    return {
        "animation": False,
        "aria": {"enabled": True, "label": {"description": spoken(traces)}},
        "legend": {"top": 0, "data": ["measured", "modelled", "residual"]},
        "tooltip": {"trigger": "axis", "axisPointer": {"type": "line"}},
        "axisPointer": {"link": [{"xAxisIndex": "all"}]},
        "grid": grid,
        "xAxis": [
            {"type": "value", "gridIndex": 0, "axisLabel": {"show": False}, "min": "dataMin", "max": "dataMax"},
            {
                "type": "value", "gridIndex": 1, "name": "time [s]", "nameLocation": "middle", "nameGap": 22,
                "min": "dataMin", "max": "dataMax", "nameTextStyle": {"color": MEASURED},
            },
        ],
        "yAxis": [
            {"type": "value", "gridIndex": 0, "name": f"motion [{traces.unit}]", "scale": True, **name},
            {"type": "value", "gridIndex": 1, "name": f"residual [{traces.fine}]", "splitNumber": 3, **name},
        ],
        "dataZoom": [
            {"type": "inside", "xAxisIndex": [0, 1]},
            {"type": "slider", "xAxisIndex": [0, 1], "height": 18, "bottom": 4},
        ],
        "visualMap": {
            "show": False, "seriesIndex": 2, "dimension": 1, "type": "piecewise",
            "pieces": [
                {"lt": -10 * floor, "color": LARGE},
                {"gte": -10 * floor, "lt": -3 * floor, "color": SOME},
                {"gte": -3 * floor, "lte": 3 * floor, "color": NOISE},
                {"gt": 3 * floor, "lte": 10 * floor, "color": SOME},
                {"gt": 10 * floor, "color": LARGE},
            ],
        },
        "series": trace_series(traces),
    }  # fmt: skip


def trace_series(traces: Traces, names: Sequence[str] = ("measured", "modelled", "residual")) -> list[dict[str, Any]]:
    """Return curves of that chart by name; given to it again, they replace those that it has."""
    common = {"type": "line", "showSymbol": False, "connectNulls": False}
    lines: list[tuple[str, Any, int, dict[str, Any]]] = [
        ("measured", traces.measured, 0, {"color": MEASURED, "width": 1.5}),
        ("modelled", traces.modelled, 0, {"color": MODELLED, "width": 1.5, "type": "dashed"}),
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
            "itemStyle": {"color": style.get("color", LARGE)},
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
    heads = "".join(f'<th scope="col">{escape(str(head))}</th>' for head in columns)
    body = "".join(f"<tr>{''.join(f'<td>{escape(str(cell))}</td>' for cell in row)}</tr>" for row in rows)
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f'<table class="fd-table">{title}<thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>'


def ladder(steps: Sequence[tuple[str, str, float]]) -> str:
    """Return the error ladder as a table with bars; the bars are logarithmic, one decade above the floor at 20 %."""
    rows = []
    for name, error, ratio in steps:
        width = 5 + 95 * min(max(np.log10(max(ratio, 1.0)) / 3, 0.0), 1.0)
        bar = f'<span class="fd-bar" style="width:{width:.0f}%" aria-hidden="true"></span>'
        rows.append(
            f'<tr><th scope="row">{escape(name)}</th><td>{escape(error)}</td>'
            f"<td>{ratio:.3g} × floor</td><td class='fd-bars'>{bar}</td></tr>"
        )
    heads = (
        "<tr><th scope='col'>model</th><th scope='col'>rms error</th><th scope='col'>over the floor</th><th></th></tr>"
    )
    return f'<table class="fd-table" id="ladder"><thead><tr>{heads}</tr></thead><tbody>{"".join(rows)}</tbody></table>'
