"""Drawings of a sweep: curves over one dimension, maps over two, and the front of what can be had together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flexdesign.core import units
from flexdesign.core.arrays import Array
from flexdesign.report import charts
from flexdesign.report.document import Figure
from flexdesign.workflows.sweeps import Sweep
from flexdesign.workflows.sweeps.results import key_of
from flexdesign.workflows.sweeps.sampling import Factor
from flexdesign.workflows.sweeps.sensitivity import Indices

#: Most curves of other values in one drawing.
CURVES = 8
#: Most panels side by side.
COLUMNS = 2
#: Number of points drawn one by one; more as a picture.
MANY = 2000


def axis_label(name: str, unit: str) -> str:
    """Return the label of an axis."""
    return f"{name.replace('_', ' ')} [{unit}]" if unit and unit != "1" else name.replace("_", " ")


def factor_values(sweep: Sweep, factor: Factor) -> Array:
    """Return a factor that is a number in all cases, in its display unit."""
    scale = units.factor(factor.unit or "1", factor.si)
    return np.array([case.values[factor.key] for case in sweep.cases], dtype=float) / scale


def figures(sweep: Sweep, quantities: Sequence[str], front: Sequence[int], feasible: Sequence[int]) -> list[Figure]:
    """Return the drawings that suit what varies."""
    numbers = [factor for factor in sweep.plan.factors if factor.is_number]
    others = [factor for factor in sweep.plan.factors if not factor.is_number]
    is_grid = sweep.plan.method == "grid"
    charts_ = []
    if is_grid and len(numbers) == 1:
        charts_ = [_curves(sweep, quantity, numbers[0], others) for quantity in quantities]
    elif is_grid and len(numbers) == 2 and not others:
        charts_ = [_map(sweep, quantity, numbers, feasible) for quantity in quantities]
    elif numbers:
        charts_ = [_scatter(sweep, quantity, numbers) for quantity in quantities]
    if len(sweep.plan.aims) > 1 and len(front):
        charts_.append(_front(sweep, front, feasible))
    return charts_


def _name(kind: str, quantity: str) -> str:
    return f"{kind}_{quantity.strip('|')}.svg"


def _curves(sweep: Sweep, quantity: str, factor: Factor, others: Sequence[Factor]) -> Figure:
    """Draw a quantity over one number, a curve for each choice of the rest."""
    figure, axes = charts.drawing(charts.NARROW, 3.6)
    x, y = factor_values(sweep, factor), sweep.results.in_unit(quantity)
    labels = [", ".join(str(case.values[other.key]) for other in others) for case in sweep.cases]
    for index, label in enumerate(list(dict.fromkeys(labels))[:CURVES]):
        chosen = [i for i, each in enumerate(labels) if each == label]
        axes.plot(x[chosen], y[chosen], marker="o", markersize=3, color=charts.COLOURS[index], label=label)
    _draw_limits(axes, sweep, quantity)
    _scale(axes, factor)
    _name_axes(axes, axis_label(factor.name, factor.unit), axis_label(quantity, sweep.results.unit(quantity)))
    if others or axes.get_legend_handles_labels()[1] not in ([], [""]):
        charts.below(figure, axes, 3)
    return Figure(_name("curve", quantity), charts.svg(figure), f"{quantity} over {factor.name}")


def _draw_limits(axes: Any, sweep: Sweep, quantity: str) -> None:
    if not sweep.results.has(quantity):
        return
    si, unit = sweep.results.kinds[key_of(quantity)].si, sweep.results.unit(quantity)
    for limit in sweep.plan.limits:
        if limit.quantity == quantity:
            bound = limit.bound(si) / units.factor(unit, si)
            axes.axhline(bound, color=charts.NEUTRAL, linestyle="--", linewidth=1, label=f"limit {limit.text}")


def _scale(axes: Any, x: Factor, y: Factor | None = None) -> None:
    """Let equal ratios be equally long where a factor takes them for equal steps."""
    if x.is_log:
        axes.set_xscale("log")
    if y is not None and y.is_log:
        axes.set_yscale("log")


def _map(sweep: Sweep, quantity: str, factors: Sequence[Factor], feasible: Sequence[int]) -> Figure:
    """Draw a quantity over two numbers; what breaks a limit is paler."""
    figure, axes = charts.drawing(charts.NARROW, 4.2)
    shape = tuple(len(factor.values) for factor in factors)
    x, y = (factor_values(sweep, factor).reshape(shape) for factor in factors)
    z = np.ma.masked_invalid(sweep.results.in_unit(quantity).reshape(shape))
    if z.count() and min(shape) > 1:
        contours = axes.contourf(x, y, z, levels=14, cmap="viridis")
        bar = figure.colorbar(contours, ax=axes)
        bar.set_label(axis_label(quantity, sweep.results.unit(quantity)), color=charts.NEUTRAL)
        bar.ax.tick_params(colors=charts.NEUTRAL)
    if sweep.plan.limits:
        broken = np.ones(len(sweep.cases), dtype=bool)
        broken[list(feasible)] = False
        veil = np.ma.masked_where(~broken.reshape(shape), np.ones(shape))
        axes.pcolormesh(x, y, veil, cmap="Greys", vmin=0, vmax=2, alpha=0.45, shading="nearest")
    _scale(axes, *factors)
    _name_axes(axes, *(axis_label(factor.name, factor.unit) for factor in factors))
    caption = f"{quantity} over {' and '.join(factor.name for factor in factors)}"
    caption += "; veiled: a limit is broken" if sweep.plan.limits else ""
    return Figure(_name("map", quantity), charts.svg(figure), caption)


def _scatter(sweep: Sweep, quantity: str, numbers: Sequence[Factor]) -> Figure:
    """Draw a quantity over each of several numbers, a point for each case."""
    from matplotlib.figure import Figure as Drawing

    columns = min(len(numbers), COLUMNS)
    rows = -(-len(numbers) // columns)
    drawing = Drawing(figsize=(2.7 * columns, 2.4 * rows), layout="constrained")
    y = sweep.results.in_unit(quantity)
    for place, factor in enumerate(numbers):
        axes = drawing.add_subplot(rows, columns, place + 1)
        charts.plain(axes)
        axes.plot(factor_values(sweep, factor), y, ".", markersize=3, color=charts.COLOURS[0], rasterized=len(y) > MANY)
        _scale(axes, factor)
        _name_axes(
            axes,
            axis_label(factor.name, factor.unit),
            axis_label(quantity, sweep.results.unit(quantity)) if place % columns == 0 else "",
        )
    return Figure(_name("points", quantity), charts.svg(drawing), f"{quantity} of all cases over what varies")


def _front(sweep: Sweep, front: Sequence[int], feasible: Sequence[int]) -> Figure:
    """Draw the first two aims against each other, and the third as colour."""
    figure, axes = charts.drawing(charts.NARROW, 4.2)
    first, second, *more = (aim.quantity for aim in sweep.plan.aims)
    x, y = sweep.results.in_unit(first), sweep.results.in_unit(second)
    many = len(x) > MANY
    axes.plot(x, y, ".", color=charts.NEUTRAL, alpha=0.4, markersize=3, label="all cases", rasterized=many)
    if sweep.plan.limits:
        x_kept, y_kept = x[list(feasible)], y[list(feasible)]
        axes.plot(x_kept, y_kept, ".", color=charts.COLOURS[0], markersize=4, label="keep limits", rasterized=many)
    if more:
        third = sweep.results.in_unit(more[0])[list(front)]
        points = axes.scatter(x[list(front)], y[list(front)], c=third, s=28, zorder=3)
        bar = figure.colorbar(points, ax=axes)
        bar.set_label(axis_label(more[0], sweep.results.unit(more[0])), color=charts.NEUTRAL)
        bar.ax.tick_params(colors=charts.NEUTRAL)
    else:
        order = sorted(front, key=lambda i: x[i])
        axes.plot(x[order], y[order], "o-", color=charts.COLOURS[1], markersize=5, label="no other beats them")
    _name_axes(axes, *(axis_label(each, sweep.results.unit(each)) for each in (first, second)))
    charts.below(figure, axes, 3)
    return Figure("front.svg", charts.svg(figure), "Designs that no other beats in all aims at once")


def importance(indices: Mapping[str, Indices], names: Sequence[str]) -> Figure:
    """Draw total indices as bars, their first-order part in full colour: a group for each quantity."""
    figure, axes = charts.drawing(charts.NARROW, 0.28 * len(names) * len(indices) + 1.4)
    place, ticks = 0.0, []
    for quantity, each in indices.items():
        for index, name in enumerate(names):
            colour = charts.COLOURS[index % len(charts.COLOURS)]
            axes.barh(place, each.total[index], height=0.8, color=colour, alpha=0.35)
            axes.errorbar(each.total[index], place, xerr=each.total_half[index], color=charts.NEUTRAL, capsize=2)
            axes.barh(place, max(each.first[index], 0.0), height=0.8, color=colour)
            ticks.append((place, f"{quantity}: {name}".replace("_", " ")))
            place += 1.0
        place += 0.6
    axes.set_yticks([at for at, _ in ticks], [text.replace("|", "") for _, text in ticks])
    axes.invert_yaxis()
    axes.set_xlabel("share of the variance\nalone (full), and in all (pale)")
    return Figure("importance.svg", charts.svg(figure), "Which factor matters for what")


def _name_axes(axes: Any, xlabel: str, ylabel: str) -> None:
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    axes.grid(color=charts.NEUTRAL, alpha=0.25)
