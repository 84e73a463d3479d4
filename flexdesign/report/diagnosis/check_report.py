"""The report of a check: what recordings hold, what is suspicious, which effects they can reveal."""

from __future__ import annotations

from typing import Any

from flexdesign.core import units, versions
from flexdesign.core.serialise import header
from flexdesign.diagnosis.check import Channel, Check, Recorded, Shown
from flexdesign.diagnosis.check.coverage import SAID
from flexdesign.report.document import Document, Section, Table

#: How channels are shown: SI unit -> unit.
SHOWN = {"m": "um", "rad": "urad", "m/V": "um/V", "rad/V": "urad/V", "A": "A", "K": "K", "1": ""}


def table(found: Check) -> Table:
    """Return what is there, one line for each recording."""
    rows = []
    for recording in found.recordings:
        channels = "; ".join(_channel(channel) for channel in recording.channels)
        kind = recording.kind or ", ".join(recording.kinds) or "–"
        rows.append([recording.name, kind, recording.role, *_length(recording), channels])
    for each in found.tables:
        parts = f"{each.parts} part{'s' if each.parts > 1 else ''}"
        rows.append([each.name, "static table", "–", f"{len(each.rows)} rows", parts, "; ".join(each.kinds)])
    heads = ["recording", "experiment", "role", "length", "rate or band", "channels: range, noise"]
    return Table(heads, rows, "What is there")


def _length(each: Recorded) -> list[str]:
    if each.band:
        low, high = each.band
        return [f"{each.samples} lines", f"{units.significant(low, 4)} to {units.significant(high, 4)} Hz"]
    return [f"{units.significant(each.seconds, 4)} s, {each.samples} samples", f"{units.significant(each.rate, 5)} Hz"]


def _channel(channel: Channel) -> str:
    unit = SHOWN.get(channel.si, channel.si)

    def number(value: float, digits: int = 3) -> str:
        return units.significant(value / units.factor(unit or "1", channel.si), digits)

    sentences = f"{channel.name} {number(channel.low)} to {number(channel.high)} {unit}".rstrip()
    if channel.noise is not None:
        sentences = f"{sentences} ± {units.to_text(channel.noise, 'nm' if channel.si == 'm' else unit, 2, channel.si)}"
    if channel.missing > 0:
        sentences = f"{sentences}, {100 * channel.missing:.2g} % missing"
    return sentences


def document(found: Check) -> Document:
    """Return the whole report."""
    summary = [_headline(found)]
    summary += [_sentence(each.recording, each.what, each.remedy) for each in found.suspicions]
    summary += _coverage(found)
    suspicious = Table(
        ["recording", "what is suspicious", "what to do"],
        [[each.recording or "all", each.what, each.remedy or "–"] for each in found.suspicions],
    )
    effects = Table(
        ["effect", "can show", "by", "what would reveal it"],
        [
            [each.effect.replace("_", " "), "yes" if each.kinds else "no", _kinds(each), each.lacking or "–"]
            for each in found.shown
        ],
        "Which effects of the catalogue the recordings can show",
    )  # fmt: skip
    sections = [Section("What is there", tables=[table(found)])]
    if found.suspicions:
        sections.append(Section("What is suspicious", tables=[suspicious]))
    tables = [effects] if found.shown else []
    sections.append(Section("What a diagnosis can identify", _coverage(found), tables=tables))
    return Document("Check of recordings", summary, sections)


def _kinds(each: Shown) -> str:
    return ", ".join(SAID[kind] for kind in each.kinds) or "–"


def _headline(found: Check) -> str:
    count, doubts = len(found.recordings) + len(found.tables), len(found.suspicions)
    suspicious = f"{doubts} suspicion{'s' if doubts > 1 else ''}" if doubts else "nothing suspicious"
    sentences = f"{count} recording{'s' if count > 1 else ''}, {suspicious}."
    noise = "; ".join(f"{axis}: {source}" for axis, source in found.noise.items())
    return f"{sentences} Noise of {noise}." if noise else sentences


def _sentence(recording: str, what: str, remedy: str) -> str:
    where = f"{recording}: " if recording else ""
    return f"{where}{what}{f': {remedy}' if remedy else ''}."


def _coverage(found: Check) -> list[str]:
    if not found.recordings:
        return ["A diagnosis of a static table needs its design: flexdesign diagnose DESIGN TABLE."]
    visible = [each.effect.replace("_", " ") for each in found.shown if each.kinds]
    hidden = [name.replace("_", " ") for name in found.hidden]
    sentences = (
        [f"These recordings can reveal: {', '.join(visible)}."] if visible else ["These recordings reveal no effect."]
    )
    if hidden:
        sentences.append(
            f"No recording here is made to reveal: {', '.join(hidden)}. flexdesign plan writes commands that are."
        )
    return sentences


def result(found: Check) -> dict[str, Any]:
    """Return what result.json holds."""
    return {
        **header("check"),
        "recordings": list(found.recordings),
        "suspicions": list(found.suspicions),
        "effects": list(found.shown),
        "noise": found.noise,
        "tables": list(found.tables),
        "made_by": versions.installed(),
    }
