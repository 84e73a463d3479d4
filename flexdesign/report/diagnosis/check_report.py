"""The report of a check: what recordings hold, what is suspicious, which effects they can reveal."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from flexdesign.core import units, versions
from flexdesign.core.serialise import header
from flexdesign.diagnosis.check import Channel, Check, Coverage, Recorded
from flexdesign.diagnosis.check.coverage import KIND_TEXTS
from flexdesign.diagnosis.check.suspicion import Suspicion
from flexdesign.measurements.recordings import Run
from flexdesign.report import charts
from flexdesign.report.comparison_text import axis_unit
from flexdesign.report.document import Document, Figure, Section, Table
from flexdesign.report.traces import thin_out

#: Most recordings that are drawn, and panels side by side.
PANELS, COLUMNS = 12, 2
#: What may differ between suspicions of one kind.
NUMBER = re.compile(r"[\d.]+(e[+-]?\d+)?")
#: SI units of responses, which are written with the prefix that suits their range.
RESPONSES = ("m", "rad", "m/V", "rad/V")
#: Kinds of experiment whose names say more than a record shows: a slow sine turns, too.
SHORT_NAMES = {"triangle": "slow loops"}


def table(check: Check) -> Table:
    """Return what is there, one line for each recording."""
    rows = []
    for recording in check.recordings:
        channels = "; ".join(_channel(channel) for channel in recording.channels)
        kind = recording.kind or ", ".join(SHORT_NAMES.get(kind, kind) for kind in recording.kinds) or "–"
        rows.append([recording.name, kind, recording.role, *_length(recording), channels])
    for each in check.tables:
        parts = f"{each.parts} part{'s' if each.parts > 1 else ''}"
        rows.append([each.name, "static table", "–", f"{len(each.rows)} rows", parts, "; ".join(each.kinds)])
    heads = ["recording", "experiment", "role", "length", "rate or band", "channels: range, noise"]
    return Table(heads, rows)


def _length(each: Recorded) -> list[str]:
    if each.band:
        low, high = each.band
        return [f"{each.samples} lines", f"{units.significant(low, 4)} to {units.significant(high, 4)} Hz"]
    return [f"{units.significant(each.seconds, 4)} s, {each.samples} samples", units.hertz(each.rate, 5)]


def _channel(channel: Channel) -> str:
    is_response = channel.si in RESPONSES
    unit = (
        axis_unit(channel.si, [channel.low, channel.high]) if is_response else "" if channel.si == "1" else channel.si
    )

    def number(value: float, digits: int = 3) -> str:
        return units.significant(value / units.factor(unit or "1", channel.si), digits)

    sentences = f"{channel.name} {number(channel.low)} to {number(channel.high)} {unit}".rstrip()
    if channel.noise is not None:
        fine = axis_unit(channel.si, channel.noise) if is_response else unit
        sentences = f"{sentences} ± {units.to_text(channel.noise, fine, 2, channel.si)}"
    if channel.missing > 0:
        sentences = f"{sentences}, {100 * channel.missing:.2g} % missing"
    return sentences


def document(check: Check) -> Document:
    """Return the whole report."""
    summary = [_headline(check)]
    summary += _sentences(check.suspicions)
    summary += _coverage(check)
    return Document("Check of recordings", summary, partial(_sections, check))


def _sections(check: Check) -> list[Section]:
    suspicious = Table(
        ["recording", "what is suspicious", "what to do"],
        [[each.recording or "all", each.what, each.remedy or "–"] for each in check.suspicions],
    )
    effects = Table(
        ["effect", "can show", "by", "what would reveal it"],
        [
            [each.effect.replace("_", " "), "yes" if each.kinds else "no", _kinds(each), each.lacking or "–"]
            for each in check.shown
        ],
        "Which effects of the catalogue the recordings can show",
    )  # fmt: skip
    sections = [Section("What is there", tables=[table(check)], figures=[_picture(check)] if check.data else [])]
    if check.suspicions:
        sections.append(Section("What is suspicious", tables=[suspicious]))
    tables = [effects] if check.shown else []
    sections.append(Section("What a diagnosis can identify", tables=tables))
    return sections


def _picture(check: Check) -> Figure:
    """Draw the responses of each recording: over time, or their magnitude over frequency."""
    from matplotlib.figure import Figure as Drawing

    shown = check.data[:PANELS]
    columns = min(len(shown), COLUMNS)
    rows = -(-len(shown) // columns)
    drawing = Drawing(figsize=(2.7 * columns, 1.7 * rows), layout="constrained")
    for place, recording in enumerate(shown):
        axes = drawing.add_subplot(rows, columns, place + 1)
        charts.plain(axes)
        axes.grid(color=charts.NEUTRAL, alpha=0.25)
        axes.set_title(recording.name, color=charts.NEUTRAL, loc="left")
        if isinstance(recording, Run):
            _draw_run(axes, recording)
        else:
            size = np.abs(recording.response)
            unit = axis_unit(f"{recording.si}/V", size)
            axes.loglog(recording.frequencies, size / units.factor(unit, f"{recording.si}/V"), color=charts.COLOURS[0])
            axes.set_ylabel(f"response [{unit}]")
            axes.set_xlabel("frequency [Hz]")
    more = f"; the first {len(shown)} of {len(check.data)}" if len(shown) < len(check.data) else ""
    return Figure("recordings.svg", charts.svg(drawing), f"What each recording holds{more}")


def _draw_run(axes: Any, run: Run) -> None:
    """Draw the responses of a run, in the unit of the largest."""
    names = [name for name in run.responses if run.si[name] == run.si[run.responses[0]]]
    unit = axis_unit(run.si[names[0]], *(run.columns[name] for name in names))
    for index, name in enumerate(names):
        x, y = thin_out(run.time, run.columns[name])
        axes.plot(x, y / units.factor(unit, run.si[name]), color=charts.COLOURS[index % 10], linewidth=0.8, label=name)
    axes.set_ylabel(f"{', '.join(names[:3])} [{unit}]")
    axes.set_xlabel("time [s]")


def _kinds(each: Coverage) -> str:
    return ", ".join(KIND_TEXTS[kind] for kind in each.kinds) or "–"


def _headline(check: Check) -> str:
    count, doubts = len(check.recordings) + len(check.tables), len(check.suspicions)
    suspicious = f"{doubts} suspicion{'s' if doubts > 1 else ''}" if doubts else "nothing suspicious"
    sentences = f"{count} recording{'s' if count > 1 else ''}, {suspicious}."
    noise = "; ".join(f"{axis}: {source}" for axis, source in check.noise.items())
    return f"{sentences} Noise of {noise}." if noise else sentences


def _sentences(suspicions: Sequence[Suspicion]) -> list[str]:
    """Return a sentence for each suspicion; of those that differ in recording and numbers alone, one for the first."""
    alike: dict[tuple[bool, str, str], list[Suspicion]] = {}
    for each in suspicions:
        alike.setdefault((bool(each.recording), NUMBER.sub("", each.what), each.remedy), []).append(each)
    sentences = []
    for first, *others in alike.values():
        more = f" and {len(others)} other{'s' if len(others) > 1 else ''} alike" if others else ""
        remedy = f". Remedy: {first.remedy}" if first.remedy else ""
        sentences.append(f"{first.recording or 'All recordings'}{more}: {first.what}{remedy}.")
    return sentences


def _coverage(check: Check) -> list[str]:
    if not check.recordings:
        return ["A diagnosis of a static table needs its design: flexdesign diagnose DESIGN TABLE."]
    visible = [each.effect.replace("_", " ") for each in check.shown if each.kinds]
    hidden = [name.replace("_", " ") for name in check.hidden]
    sentences = (
        [f"These recordings can reveal: {', '.join(visible)}."] if visible else ["These recordings reveal no effect."]
    )
    if hidden:
        sentences.append(
            f"No recording here is made to reveal: {', '.join(hidden)}. flexdesign plan writes commands that are."
        )
    return sentences


def result(check: Check) -> dict[str, Any]:
    """Return what result.json holds."""
    return {
        **header("check"),
        "recordings": list(check.recordings),
        "suspicions": list(check.suspicions),
        "effects": list(check.shown),
        "noise": check.noise,
        "tables": list(check.tables),
        "made_by": versions.installed(),
    }
