"""Drawings of what a model leaves: where its error lies, its spectrum, and how it depends on position and time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from flexdesign.core import units
from flexdesign.core.arrays import Array
from flexdesign.diagnosis.preparation.spectra import cross_spectra
from flexdesign.measurements.recordings.command_segments import steps
from flexdesign.report.charts import COLOURS, NEUTRAL, below, plain, svg

WIDTH = 7.2
#: Points of a spectrum per decade, and of a curve over position or over the logarithm of time.
PER_DECADE, PLACES = 30, 48
#: A place with fewer samples is not drawn.
FEWEST = 5
#: Samples before a step whose mean is where a residual begins.
BEFORE = 10
#: Most holds that are drawn one by one.
HOLDS = 24
#: Segments over which a coherence is averaged; what noise alone exceeds once in this many frequencies is marked.
SEGMENTS, EXCEEDED = 40, 0.01


class Bars(NamedTuple):
    """Shares of one breakdown: title, names of the parts, their shares and their weights (0 to 1)."""

    title: str
    names: Sequence[str]
    shares: Sequence[float]
    weights: Sequence[float]


class Trace(NamedTuple):
    """One run as drawings need it.

    The period [s], command [V], measured, predicted [unit of the drawing]; NaN in `measured` where nothing was
    compared; and the noise floor, a standard deviation.
    """

    name: str
    period: float
    command: Array
    measured: Array
    predicted: Array
    floor: float

    @property
    def residual(self) -> Array:
        """Measured less predicted."""
        return self.measured - self.predicted


def shares(breakdowns: Sequence[Bars]) -> bytes:
    """Draw bars of the error's shares, a panel for each breakdown; ticks show the shares of time."""
    from matplotlib.figure import Figure

    rows = [breakdowns[k : k + 2] for k in range(0, len(breakdowns), 2)]
    heights = [max(len(b.names) for b in row) + 1.9 for row in rows]
    figure = Figure(figsize=(WIDTH, 0.235 * sum(heights) + 0.35), layout="constrained")
    grid = figure.add_gridspec(len(rows), 2, height_ratios=heights)
    for k, bars in enumerate(breakdowns):
        axes = figure.add_subplot(grid[k // 2, k % 2])
        plain(axes)
        places = np.arange(len(bars.names))
        axes.barh(places, 100 * np.asarray(bars.shares), color=COLOURS[0], height=0.66, label="of the error")
        tick: dict[str, Any] = {"marker": "|", "linestyle": "", "markersize": 11, "markeredgewidth": 2}
        axes.plot(100 * np.asarray(bars.weights), places, color=COLOURS[1], label="of the time", **tick)
        axes.set_yticks(places, list(bars.names), fontsize=8.5)
        axes.set_ylim(max(heights[k // 2] - 1.9, len(places)) - 0.4, -0.6)
        axes.set_xlim(0, 100)
        axes.set_title(bars.title, color=NEUTRAL, fontsize=10, loc="left")
        axes.tick_params(axis="y", length=0)
        axes.tick_params(axis="x", labelsize=8.5)
        axes.spines["left"].set_visible(False)
        axes.grid(axis="x", color=NEUTRAL, alpha=0.25)
        axes.set_axisbelow(True)
        if k >= len(breakdowns) - 2:
            axes.set_xlabel("share [%]")
    below(figure, axes, 2)
    return svg(figure)


def spectrum(traces: Sequence[Trace], noise: Sequence[Array], frequencies: Array, unit: str, mode: float) -> bytes:
    """Draw the spectra of what was measured, of the residual, and of the noise; means over the runs.

    Parameters
    ----------
    traces
        The runs.
    noise
        Of each run the density of its noise [unit^2/Hz] at the frequencies; NaN beyond its Nyquist frequency.
    frequencies
        Increasing [Hz]; see `octaves`.
    unit
        Of the response.
    mode
        Natural frequency [Hz], which is marked.
    """
    figure, axes = _figure(3.6)
    edges = np.append(frequencies, frequencies[-1] ** 2 / frequencies[-2])
    measured = _mean([_density(t.measured, t.period, edges) for t in traces])
    left = _mean([_density(t.residual, t.period, edges) for t in traces])
    noise_floor = _mean(list(noise))
    for values, colour, label, style in (
        (measured, COLOURS[0], "measured", {"linewidth": 1.3, "alpha": 0.75}),
        (left, COLOURS[1], "measured minus predicted", {"linewidth": 1.8}),
        (noise_floor, NEUTRAL, "noise floor", {"linewidth": 1.4, "linestyle": (0, (4, 3))}),
    ):
        seen = np.isfinite(values) & (values > 0)
        axes.loglog(frequencies[seen], np.sqrt(values[seen]), color=colour, label=label, **style)
    axes.axvline(mode, color=NEUTRAL, linewidth=0.9, alpha=0.7)
    axes.annotate(
        f"mode, {units.hertz(mode)}", (mode, 1.0), (4, -9), color=NEUTRAL, fontsize=8.5,
        xycoords=("data", "axes fraction"), textcoords="offset points",
    )  # fmt: skip
    axes.set_xlim(frequencies[0], frequencies[-1])
    axes.set_xlabel("frequency [Hz]")
    axes.set_ylabel(f"amplitude density [{unit}/√Hz]")
    below(figure, axes, 3)
    return svg(figure)


def octaves(traces: Sequence[Trace]) -> Array:
    """Return frequencies [Hz] in even ratios, from the longest run's resolution to the highest Nyquist frequency."""
    low, high = min(1 / (t.period * len(t.measured)) for t in traces), max(0.5 / t.period for t in traces)
    return np.geomspace(low, high, max(int(PER_DECADE * math.log10(high / low)), 8))


def coherence(traces: Sequence[Trace]) -> bytes:
    """Draw how much of the residual goes with the command, linearly, at each frequency.

    Runs of the period that most samples have are averaged. A linear model that is wrong leaves a coherent residual;
    what is nonlinear, or driven by something else than the command, does not.
    """
    figure, axes = _figure(2.9)
    periods = {round(t.period, 9): 0 for t in traces}
    for t in traces:
        periods[round(t.period, 9)] += len(t.measured)
    period = max(periods, key=lambda p: periods[p])
    chosen = [t for t in traces if round(t.period, 9) == period]
    lengths = [len(t.measured) for t in chosen]
    length = min([max(sum(lengths) // SEGMENTS, 16), *lengths])
    spectra = cross_spectra([(t.command, t.residual) for t in chosen], period, length)
    frequency = spectra.frequencies
    axes.semilogx(frequency[1:], spectra.coherence[1:], color=COLOURS[1], linewidth=1.4, label="command to residual")
    by_chance = spectra.exceeded_by_chance(EXCEEDED)
    axes.axhspan(0, by_chance, color=NEUTRAL, alpha=0.25, linewidth=0, label="by chance, 99 %")
    axes.set_xlim(frequency[1], frequency[-1])
    axes.set_ylim(0, 1.02)
    axes.set_xlabel("frequency [Hz]")
    axes.set_ylabel("coherence")
    below(figure, axes, 2)
    return svg(figure)


def over_position(traces: Sequence[Trace], unit: str, fine: str, factor: float) -> bytes | None:
    """Draw the mean residual over position, moving up and moving down apart, with the middle 80 % of it.

    None where next to nothing moves between its steps, so that no line would be drawn.

    Parameters
    ----------
    traces
        The runs.
    unit, fine
        Of the position, and of the residual.
    factor
        How many `fine` one `unit` is.
    """
    position = np.concatenate([t.predicted for t in traces])
    speed: Array = np.concatenate([np.gradient(t.predicted, t.period) for t in traces])
    left = factor * np.concatenate([t.residual for t in traces])
    edges = np.linspace(position.min(), position.max(), PLACES + 1)
    rests = 0.01 * float(np.quantile(np.abs(speed), 0.98))
    ways = (("moving up", speed > rests, COLOURS[0]), ("moving down", speed < -rests, COLOURS[1]))
    bands = [_bin(position[moving], left[moving], edges) for _, moving, _ in ways]
    if all(np.isfinite(middle).sum() < 2 for middle, _, _ in bands):
        return None
    figure, axes = _figure(3.3)
    noise_floor = factor * math.sqrt(float(np.mean([t.floor**2 for t in traces])))
    axes.axhspan(-2 * noise_floor, 2 * noise_floor, color=NEUTRAL, alpha=0.25, linewidth=0, label="noise, 95 %")
    for (label, _, colour), (middle, low, high) in zip(ways, bands, strict=True):
        places = 0.5 * (edges[1:] + edges[:-1])
        axes.fill_between(places, low, high, color=colour, alpha=0.18, linewidth=0)
        axes.plot(places, middle, color=colour, linewidth=1.8, label=label)
    axes.set_xlabel(f"position, predicted [{unit}]")
    axes.set_ylabel(f"measured minus predicted [{fine}]")
    below(figure, axes, 3)
    return svg(figure)


def since_step(traces: Sequence[Trace], fine: str, factor: float) -> bytes | None:
    """Draw the residual after each step over the logarithm of time, in the direction of the step; None without steps.

    What creeps is a straight line here; what lags or rings dies away.
    """
    found: list[tuple[float, Array, Array]] = []
    for t in traces:
        for first, last, jump in steps(t.command):
            before = np.nan_to_num(t.residual[max(first - BEFORE, 0) : first]).mean()
            after = factor * math.copysign(1.0, jump) * (t.residual[first:last] - before)
            time: Array = t.period * (0.5 + np.arange(last - first, dtype=float))
            found.append((abs(jump), time, after))
    found = [hold for hold in found if np.isfinite(hold[2]).sum() >= FEWEST]
    if not found:
        return None
    figure, axes = _figure(3.3)
    edges = np.geomspace(min(h[1][0] for h in found) * 0.99, max(h[1][-1] for h in found) * 1.01, PLACES + 1)
    places = np.sqrt(edges[1:] * edges[:-1])
    noise_floor = factor * math.sqrt(float(np.mean([t.floor**2 for t in traces])))
    axes.axhspan(-2 * noise_floor, 2 * noise_floor, color=NEUTRAL, alpha=0.25, linewidth=0, label="noise, 95 %")
    for k, (_, time, after) in enumerate(sorted(found, key=lambda h: -h[0])[:HOLDS]):
        middle, _, _ = _bin(time, after, edges, fewest=1)
        seen = np.isfinite(middle)
        label = {"label": "each step"} if k == 0 else {}
        axes.semilogx(places[seen], middle[seen], color=COLOURS[0], linewidth=0.8, alpha=0.5, **label)
    times = np.asarray(np.concatenate([h[1] for h in found]), dtype=float)
    whole, _, _ = _bin(times, np.concatenate([h[2] for h in found]), edges, fewest=1)
    seen = np.isfinite(whole)
    axes.semilogx(places[seen], whole[seen], color=COLOURS[1], linewidth=2.2, label="mean of all steps")
    axes.set_xscale("log")
    axes.set_xlabel("time since the step [s]")
    axes.set_ylabel(f"residual along the step [{fine}]")
    below(figure, axes, 3)
    return svg(figure)


def _bin(x: Array, y: Array, edges: Array, fewest: int = FEWEST) -> tuple[Array, Array, Array]:
    """Return mean, lower and upper tenth of y in each bin of x; NaN where there are too few."""
    finite = np.isfinite(y)
    x, y = x[finite], y[finite]
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    order = np.argsort(place, kind="stable")
    ends = np.searchsorted(place[order], np.arange(len(edges)))
    made = np.full((3, len(edges) - 1), np.nan)
    for k in range(len(edges) - 1):
        inside = y[order[ends[k] : ends[k + 1]]]
        if len(inside) >= fewest:
            made[:, k] = inside.mean(), *np.quantile(inside, [0.1, 0.9])
    return made[0], made[1], made[2]


def _density(values: Array, period: float, edges: Array) -> Array:
    """Return the power spectral density in bands, gaps and mean taken as zero; NaN beyond its frequencies."""
    from scipy.signal import periodogram

    filled = np.nan_to_num(values - np.nanmean(values))
    frequency, power = periodogram(filled, 1 / period, window="hann", detrend=False)
    frequency, power = frequency[1:-1], power[1:-1]  # without the mean, and the end that counts half
    place = np.searchsorted(edges, frequency, side="right") - 1
    inside = (place >= 0) & (place < len(edges) - 1)
    count = np.bincount(place[inside], minlength=len(edges) - 1)
    total = np.bincount(place[inside], power[inside], len(edges) - 1)
    middles = np.sqrt(edges[1:] * edges[:-1])
    between = np.interp(middles, frequency, power, left=np.nan, right=np.nan)  # bands narrower than the resolution
    return np.where(count > 0, total / np.maximum(count, 1), between)


def _mean(rows: Sequence[Array]) -> Array:
    """Return the mean of rows where they are numbers."""
    stacked = np.stack(rows)
    there = np.isfinite(stacked)
    count = there.sum(axis=0)
    return np.where(count > 0, np.where(there, stacked, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def _figure(height: float) -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    axes = figure.add_subplot()
    plain(axes)
    axes.grid(color=NEUTRAL, alpha=0.25)
    return figure, axes
