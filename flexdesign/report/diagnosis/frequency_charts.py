"""Drawings for dynamics: frequency responses, step responses, curves in panels; SVG for light and dark paper."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexdesign.report.charts import COLOURS, NEUTRAL, below, plain, svg

#: Width of a chart, and height of one of its panels [in].
WIDTH, HEIGHT = 7.2, 2.3


class Curve(NamedTuple):
    """A labelled curve: `x` and `y` of one length, in the units of the axes."""

    label: str
    x: Sequence[float]
    y: Sequence[float]


class Panel(NamedTuple):
    """Curves over a common abscissa: axis label, curves, whether the ordinate is logarithmic."""

    label: str
    curves: Sequence[Curve]
    logarithmic: bool = False


class Mark(NamedTuple):
    """A vertical line at `x` with a label."""

    label: str
    x: float


class Line(NamedTuple):
    """A labelled frequency response: frequencies [Hz], complex numbers, and whether it is drawn as dots."""

    label: str
    frequencies: NDArray[np.float64]
    response: NDArray[np.complex128]
    dots: bool = False


def _phase(line: Line, smooth: Line) -> NDArray[np.float64]:
    """Return the phase [deg], continuous in a smooth line, and of dots that next to it: noise has no continuous one."""
    phase = np.degrees(np.unwrap(np.angle(smooth.response)))
    expected = np.interp(line.frequencies, smooth.frequencies, phase)
    own = np.degrees(np.angle(line.response) if line.dots else np.unwrap(np.angle(line.response)))
    turns = np.round((own - expected) / 360.0)
    return own - 360.0 * (turns if line.dots else turns[0])


def measured_bode(lines: Sequence[Line], coherence: NDArray[np.float64] | None, unit: str) -> bytes:
    """Draw frequency responses over the logarithm of frequency: magnitude, phase, and coherence where it is known.

    Parameters
    ----------
    lines
        The first is the measured one, whose frequencies the coherence has.
    coherence
        n numbers; None if there is none.
    unit
        Of the magnitude.
    """
    figure, axes = _panels(2 if coherence is None else 3, 0.85 * HEIGHT)
    for index, line in enumerate(lines):
        style = {"marker": ".", "markersize": 4, "linestyle": ""} if line.dots else {"linewidth": 1.6}
        colour = NEUTRAL if line.dots else COLOURS[(index - 1) % len(COLOURS)]
        phase = _phase(line, lines[-1])
        axes[0].plot(line.frequencies, np.abs(line.response), color=colour, label=line.label, **style)
        axes[1].plot(line.frequencies, phase, color=colour, **style)
    _logarithmic(axes[0])
    axes[0].set_ylabel(f"magnitude [{unit}]")
    axes[1].set_ylabel("phase [deg]")
    if coherence is not None:
        axes[2].plot(lines[0].frequencies, coherence, color=NEUTRAL, linewidth=1.2)
        axes[2].set_ylim(0, 1.02)
        axes[2].set_ylabel("coherence")
    axes[-1].set_xscale("log")
    axes[-1].set_xlabel("frequency [Hz]")
    below(figure, axes[0], min(3, len(lines)))
    return svg(figure)


def bode(
    names: Sequence[str],
    frequencies: Sequence[float],
    magnitude: Sequence[Sequence[float]],
    phase: Sequence[Sequence[float]],
    marks: Sequence[Mark] = (),
    unit: str = "",
) -> bytes:
    """Draw magnitude over phase against frequency.

    Parameters
    ----------
    names
        Of the plants.
    frequencies
        In Hz, common to all.
    magnitude, phase
        A row for each plant [`unit`, deg].
    marks
        Frequencies to point out [Hz].
    unit
        Of the magnitude; empty for a ratio.
    """
    above = [Curve(name, frequencies, row) for name, row in zip(names, magnitude, strict=True)]
    below = [Curve(name, frequencies, row) for name, row in zip(names, phase, strict=True)]
    label = f"magnitude [{unit}]" if unit else "magnitude"
    return stack_panels([Panel(label, above, logarithmic=True), Panel("phase [deg]", below)], "frequency [Hz]", marks)


def steps(curves: Sequence[Curve], band: float, ylabel: str = "motion over step") -> bytes:
    """Draw step responses, each as a share of its step over time [ms], with the settling band around 1.

    Parameters
    ----------
    curves
        Time [ms], motion as a share of the step.
    band
        Half width of the band, as a share of the step.
    ylabel
        What the ordinate shows.
    """
    figure, (axes,) = _panels(1, 1.5 * HEIGHT)
    axes.axhspan(1 - band, 1 + band, color=NEUTRAL, alpha=0.3, linewidth=0)
    for index, curve in enumerate(curves):
        axes.plot(curve.x, curve.y, color=COLOURS[index], label=curve.label, linewidth=1.6)
    axes.set_ylabel(ylabel)
    axes.set_xlabel("time [ms]")
    axes.set_xlim(0, max(max(curve.x) for curve in curves))
    below(figure, axes, min(3, len(curves)))
    return svg(figure)


def stack_panels(panels: Sequence[Panel], xlabel: str, marks: Sequence[Mark] = ()) -> bytes:
    """Draw panels one above the other; the n-th curve has the same colour in each, the first panel names them.

    Parameters
    ----------
    panels
        From the top.
    xlabel
        The common abscissa.
    marks
        Vertical lines through all panels, labelled in the topmost.
    """
    figure, all_axes = _panels(len(panels), HEIGHT)
    for axes, panel in zip(all_axes, panels, strict=True):
        for index, curve in enumerate(panel.curves):
            axes.plot(curve.x, curve.y, color=COLOURS[index], label=curve.label, linewidth=1.8)
        axes.set_ylabel(panel.label)
        if panel.logarithmic:
            _logarithmic(axes)
        for mark in marks:
            axes.axvline(mark.x, color=NEUTRAL, linestyle=(0, (4, 3)), linewidth=1.2)
    curves = [curve for panel in panels for curve in panel.curves]
    all_axes[-1].set_xlim(min(min(c.x) for c in curves), max(max(c.x) for c in curves))
    all_axes[-1].set_xlabel(xlabel)
    for mark in marks:
        where = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
        all_axes[0].annotate(mark.label, (mark.x, 1.0), (4, 1), color=NEUTRAL, fontsize=9, **where)
    if len(panels[0].curves) > 1:
        below(figure, all_axes[0], min(3, len(panels[0].curves)))
    return svg(figure)


def _panels(count: int, height: float) -> tuple[Any, list[Any]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height * count + 0.7), layout="constrained")
    found = list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])
    for axes in found:
        plain(axes)
        axes.grid(color=NEUTRAL, alpha=0.25)
    figure.align_ylabels(found)
    return figure, found


def _logarithmic(axes: Any) -> None:
    """Scale the ordinate, with plain numbers at 1, 2 and 5: a resonance may span less than a decade.

    Of more than three decades only these are numbered: there is no room for more.
    """
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axes.set_yscale("log")
    low, high = axes.get_ylim()
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0,) if high > 1e3 * low else (1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
