"""Drawings of what an effect changes: readings with and without it, and below them their difference."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import units
from flexdesign.core.arrays import Array
from flexdesign.diagnosis.experiment_design.commands import Command
from flexdesign.diagnosis.experiment_design.effect_strength import EffectResponse
from flexdesign.report.charts import COLOURS, NEUTRAL, plain, svg
from flexdesign.report.comparison_text import axis_unit, sign
from flexdesign.report.traces import thin_out

#: Of the readings with and without the effect, and of their difference.
WITH, DIFFERENCE = COLOURS[1], COLOURS[0]
#: How responses are drawn: SI unit -> unit and its factor.
DISPLAY_UNITS = {"m": ("µm", 1e6), "rad": ("µrad", 1e6), "V": ("V", 1.0)}
#: A hold is drawn from this long after its step on [s].
FIRST = 0.05


@dataclass(frozen=True)
class Pair:
    """Curves with and without an effect, and what lies between them, over one abscissa.

    Parameters
    ----------
    x
        Abscissae, n values, in the unit of `xlabel`.
    without, affected, difference
        Ordinates, n values each, in the units of `ylabel` and `below`.
    xlabel, ylabel, below
        Axis labels.
    log
        Which axes are logarithmic: ``"x"``, ``"xy"`` or none.
    """

    x: Array
    without: Array
    affected: Array
    difference: Array
    xlabel: str
    ylabel: str
    below: str
    log: str = ""


def draw(
    seen: EffectResponse, response: str, labels: tuple[str, str] = ("with the effect", "without")
) -> tuple[bytes, str]:
    """Return the drawing of one experiment as SVG, and what it shows, in words.

    Parameters
    ----------
    seen
        The experiment.
    response
        SI unit of the response.
    labels
        What the curves are called.
    """
    make, words = _VIEWS.get(seen.command.kind, (_over_time, "Reading over time"))
    unit = axis_unit(response, seen.without, seen.affected)
    return _draw(make(seen, sign(unit), 1.0 / units.factor(unit, response)), labels), words


def commands(experiments: Sequence[Command]) -> bytes:
    """Draw every command over its time, in small panels with a common ordinate."""
    from matplotlib.figure import Figure

    columns = 3
    rows = -(-len(experiments) // columns)
    figure = Figure(figsize=(7.6, 1.45 * rows), layout="constrained")
    grid = figure.subplots(rows, columns, sharey=True, squeeze=False)
    for place, command in zip(grid.flat, experiments, strict=False):
        x, y = thin_out(command.time, command.samples)
        place.plot(x, y, color=COLOURS[2] if command.role == "validate" else COLOURS[0], linewidth=0.8)
        place.set_title(command.name, fontsize=8, color=NEUTRAL, loc="left", pad=3)
        plain(place)
        place.tick_params(labelsize=7)
        place.grid(color=NEUTRAL, alpha=0.2)
    for place in list(grid.flat)[len(experiments) :]:
        place.set_axis_off()
    figure.supylabel("command [V]", color=NEUTRAL, fontsize=8)
    figure.supxlabel("time [s]", color=NEUTRAL, fontsize=8)
    return svg(figure)


def _draw(pair: Pair, labels: tuple[str, str]) -> bytes:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 4.6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    _plot(upper, pair.x, pair.affected, pair.log, color=WITH, linewidth=1.6, label=labels[0])
    _plot(upper, pair.x, pair.without, pair.log, color=NEUTRAL, linewidth=1.3, linestyle=(0, (4, 3)), label=labels[1])
    _plot(lower, pair.x, pair.difference, pair.log, color=DIFFERENCE, linewidth=1.3)
    upper.set_ylabel(pair.ylabel)
    lower.set_ylabel(pair.below)
    lower.set_xlabel(pair.xlabel)
    for place in (upper, lower):
        plain(place)
        place.grid(color=NEUTRAL, alpha=0.25)
    if not pair.log.endswith("y") and min(pair.difference) < 0 < max(pair.difference):
        lower.axhline(0.0, color=NEUTRAL, linewidth=0.8)
    place = {"loc": "lower left", "bbox_to_anchor": (0.0, 0.99), "ncols": 2, "borderaxespad": 0.0}
    upper.legend(**place, frameon=False, labelcolor=NEUTRAL, fontsize=9)
    figure.align_ylabels()
    return svg(figure)


def _plot(place: Any, x: Array, y: Array, log: str, **style: Any) -> None:
    if "x" in log:
        place.set_xscale("log")
    if "y" in log:
        place.set_yscale("log")
    place.plot(x, y, **style)


# --- what each kind of experiment is drawn over ---------------------------------------------------------------------


def _over_time(seen: EffectResponse, unit: str, factor: float) -> Pair:
    time, without, affected = seen.command.time, seen.without * factor, seen.affected * factor
    keep = _thin_out(time, affected - without)
    return Pair(
        time[keep], without[keep], affected[keep], (affected - without)[keep], "time [s]", f"reading [{unit}]",
        f"difference [{unit}]",
    )  # fmt: skip


def _thin_out(x: Array, y: Array) -> NDArray[np.intp]:
    """Return the places at which a curve keeps its shape when drawn with fewer points."""
    return np.searchsorted(x, thin_out(x, y)[0])


def _loop(seen: EffectResponse, unit: str, factor: float) -> Pair:
    """Draw the last cycle over the voltage."""
    command, count = seen.command.samples, round(seen.command.cycle / seen.command.period)
    end = int(np.flatnonzero(command != command[-1])[-1]) + 2 if np.ptp(command) else len(command)
    cut = slice(max(0, end - count - 1), end)
    u, without, affected = command[cut], seen.without[cut] * factor, seen.affected[cut] * factor
    step = max(1, len(u) // 1200)
    return Pair(
        u[::step], without[::step], affected[::step], (affected - without)[::step], "command [V]", f"reading [{unit}]",
        f"difference [{unit}]",
    )  # fmt: skip


def _after_the_step(seen: EffectResponse, unit: str, factor: float) -> Pair:
    """Draw what follows a step over the logarithm of time, as change since shortly after it."""
    steps = np.flatnonzero(np.diff(seen.command.samples))
    runs = np.split(steps, np.flatnonzero(np.diff(steps) > 1) + 1)
    starts = [run[-1] + 1 for run in runs]
    ends = [run[0] for run in runs[1:]] + [len(seen.command.samples) - 1]
    longest = max(range(len(starts)), key=lambda k: ends[k] - starts[k])
    begin, end, period = int(starts[longest]), int(ends[longest]), seen.command.period
    since = np.arange(1, end - begin) * period
    first = max(FIRST, 2 * period)
    wanted = np.geomspace(first, since[-1], 600)
    places = np.unique(np.searchsorted(since, wanted).clip(0, len(since) - 1))
    rows = begin + 1 + places
    without, affected = seen.without[rows] * factor, seen.affected[rows] * factor
    return Pair(
        since[places], without, affected, affected - without, "time since the step [s]",
        f"reading [{unit}]", f"difference [{unit}]", "x",
    )  # fmt: skip


def _spectrum(seen: EffectResponse, unit: str, factor: float) -> Pair:
    """Draw the amplitude at every tone of the last period, and that of the difference."""
    command = seen.command
    count, end = round(command.cycle / command.period), round(command.marks[-1] / command.period)
    cut = slice(end - count, end)
    frequency = np.arange(count // 2) / command.cycle
    asked = np.abs(np.fft.rfft(command.samples[cut]))[: count // 2]
    asked[0] = 0.0
    tones = np.flatnonzero(asked > 0.1 * asked.max())
    amplitude = 2.0 / count * factor

    def at_tones(values: Array) -> Array:
        return np.asarray(amplitude * np.abs(np.fft.rfft(values[cut]))[tones])

    return Pair(
        frequency[tones], at_tones(seen.without), at_tones(seen.affected), at_tones(seen.affected - seen.without),
        "frequency [Hz]", f"amplitude [{unit}]", f"difference [{unit}]", "xy",
    )  # fmt: skip


def _constant_command(seen: EffectResponse, unit: str, factor: float) -> Pair:
    """Draw a part of a quiet record, in which nothing but the effect moves."""
    pair = _over_time(seen, unit, factor)
    window = pair.x <= 0.2
    if np.ptp(pair.difference[window]) < 0.5 * np.ptp(pair.difference):
        return pair
    return Pair(
        pair.x[window], pair.without[window], pair.affected[window], pair.difference[window], pair.xlabel, pair.ylabel,
        pair.below,
    )  # fmt: skip


def _other(seen: EffectResponse, unit: str, factor: float) -> Pair:
    """Draw the reading over the other column that was recorded."""
    ((name, values),) = seen.command.recorded.items()
    x, label = (values, "change of temperature [K]") if name == "T" else (values * factor, f"motion of {name} [{unit}]")
    order = np.argsort(x)[:: max(1, len(x) // 600)]
    without, affected = seen.without[order] * factor, seen.affected[order] * factor
    return Pair(x[order], without, affected, affected - without, label, f"reading [{unit}]", f"difference [{unit}]")


def _one_step(seen: EffectResponse, unit: str, factor: float) -> Pair:
    """Draw the largest step: what goes before it, its edge and its ringing."""
    command = seen.command
    jumps = [round(mark / command.period) for mark in command.marks]
    sizes = [abs(command.samples[min(j + 1, len(command.samples) - 1)] - command.samples[max(j - 1, 0)]) for j in jumps]
    at = jumps[int(np.argmax(sizes))]
    first, last = max(0, at - round(0.01 / command.period)), at + round(0.12 / command.period)
    cut = slice(first, last)
    time = (command.time[cut] - command.time[at]) * 1e3
    without, affected = seen.without[cut] * factor, seen.affected[cut] * factor
    return Pair(
        time,
        without,
        affected,
        affected - without,
        "time since the step [ms]",
        f"reading [{unit}]",
        f"difference [{unit}]",
    )


_VIEWS: dict[str, tuple[Callable[[EffectResponse, str, float], Pair], str]] = {
    "quiet": (_constant_command, "Reading while the command rests"),
    "steps": (_one_step, "The largest step"),
    "multisine": (_spectrum, "Amplitude at every tone of the multisine"),
    "triangle": (_loop, "Reading over the command, one cycle"),
    "hold": (_after_the_step, "After a step, over the logarithm of time"),
    "temperature": (_other, "Reading over the temperature, command at rest"),
    "other axis": (_other, "Reading over the motion of another axis, command at rest"),
}
