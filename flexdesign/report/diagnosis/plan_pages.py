"""The page of a plan for the bench: every command with picture and limits, and what distinguishes two effects."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flexdesign import effects
from flexdesign.core import units, versions
from flexdesign.core.serialise import header, with_unit
from flexdesign.diagnosis.experiment_design.commands import Command
from flexdesign.diagnosis.experiment_design.discrimination import Resolved
from flexdesign.diagnosis.experiment_design.effect_strength import EffectAtStrength
from flexdesign.diagnosis.experiment_design.limits import Limits
from flexdesign.diagnosis.experiment_design.planning import Plan
from flexdesign.estimation.criterion import significant_deviation
from flexdesign.report.catalogue import effect_charts
from flexdesign.report.document import Document, Figure, Section, Table


def table(files: Mapping[str, Command], limits: Limits) -> Table:
    """Return every command file with what it is for and what it asks of driver and stack."""
    rows = []
    for file, command in files.items():
        current = limits.current(command.slew)
        rows.append([
            file, command.purpose + (f" [{command.scaled}]" if command.scaled else ""),
            f"{command.duration:.1f}", units.significant(command.peak, 4), units.significant(command.slew, 3),
            "–" if current is None else units.significant(1e3 * current, 3),
        ])  # fmt: skip
    return Table(["file", "what it is for", "s", "peak V", "peak V/s", "mA"], rows)


def document(plan: Plan) -> Document:
    """Write the page of a plan."""
    files, limits, resolved = plan.files, plan.limits, plan.resolved
    total = sum(command.duration for command in files.values())
    summary = [
        f"{len(files)} command files, {total:.0f} s in all. Record the response to each, add it to its file as a third "
        "column, correct measurements.toml where the bench differs, and the folder can be read as runs."
    ]
    sections = [_commands(files, limits, plan.seed), _limits(limits), _by_hand(files)]
    if resolved is not None:
        summary.insert(0, verdict(resolved))
        sections.insert(0, _separation(resolved, plan.noise is None))
    return Document(plan.title, summary, [section for section in sections if section.tables or section.figures])


def verdict(resolved: Resolved) -> str:
    """Return in a few sentences what distinguishes two effects."""
    first, second = (_display_name(effect) for effect in resolved.effects)
    if not resolved.proposed:
        return (
            f"None of these experiments distinguishes {first} from {second}: none differs by more than "
            f"{significant_deviation():.1f} times the sensor's noise. Record longer, average, or use a better sensor."
        )
    best = resolved.proposed[0]
    others = [_plain(each.command) for each in resolved.proposed[1:]]
    more = f" Next: {', '.join(others)}." if others else ""
    return (
        f"{_plain(best.command).capitalize()} distinguishes {first} from {second} best: the readings differ by "
        f"{units.significant(best.over_noise, 2)} times the sensor's noise, rms.{more}"
    )


def separations(resolved: Resolved) -> Table:
    """Return how far each experiment distinguishes two effects, the best first."""
    response = resolved.effects[0].without.axis.response
    unit, factor = effect_charts.DISPLAY_UNITS[response]
    rows = [
        [
            _plain(each.command), each.command.note or "command alone",
            units.significant(factor * each.difference, 2), units.significant(each.over_noise, 2),
        ]
        for each in resolved.separations
    ]  # fmt: skip
    return Table(["experiment", "by hand", f"difference {unit}", "over noise"], rows)


def _separation(resolved: Resolved, is_assumed: bool) -> Section:
    first, second = resolved.effects
    response = first.without.axis.response
    unit, factor = effect_charts.DISPLAY_UNITS[response]
    sentences = " and ".join(_strength(e, s) for e, s in zip(resolved.effects, resolved.strengths, strict=True))
    noise = f"{units.significant(factor * resolved.noise, 2)} {unit}"
    text = [
        f"Simulated with {sentences}, each of which changes a reading by 1 % of the stroke, rms. In each experiment "
        "the second is given the strength, the gain, the offset and the damping that fit the first best there and on "
        f"the medium multisine. Noise of the sensor: {noise}, rms"
        f"{', assumed, as neither the model nor --sensor-noise states it' if is_assumed else ''}.",
    ]
    figures = []
    for each in resolved.proposed:
        chart, words = effect_charts.draw(each, response, (_display_name(first), f"{_display_name(second)}, fitted"))
        caption = f"{words} ({_plain(each.command)}); below, the difference of the two"
        figures.append(Figure(f"separates_{each.command.name}.svg", chart, caption))
    title = f"What distinguishes {_display_name(first)} from {_display_name(second)}"
    return Section(title, text, [separations(resolved)], figures)


def _strength(effect: EffectAtStrength, strength: float) -> str:
    stated = effect.strength
    name = stated.name.rpartition(".")[2]
    return f"{_display_name(effect)} ({name} = {units.to_text(strength, stated.unit, 3, stated.si)})"


def _display_name(effect: EffectAtStrength) -> str:
    return effects.find(effect.name).name


def _commands(files: Mapping[str, Command], limits: Limits, seed: int) -> Section:
    notes = [f"Phases and levels are drawn with seed {seed}: the same seed gives the same commands."]
    if limits.capacitance is None:
        notes.append("The current is not known: the model states no capacitance of the stacks.")
    figure = Figure(
        "commands.svg", effect_charts.commands(list(files.values())), "The commands; for validation in green"
    )
    return Section("Commands", notes, [table(files, limits)], [figure])


def _limits(limits: Limits) -> Section:
    slew = "none" if math.isinf(limits.slew) else f"{units.significant(limits.slew, 4)} V/s"
    rows = [
        ["voltage", f"{limits.low:g} V to {limits.high:g} V", limits.origin.get("volts", "")],
        ["slew", slew, limits.origin.get("slew", "")],
        ["bandwidth", f"{limits.bandwidth:g} Hz", limits.origin.get("bandwidth", "")],
        ["sampling", f"{limits.rate:g} Hz", limits.origin.get("rate", "")],
    ]
    return Section("Limits", [], [Table(["", "kept to", "from"], rows)])


def _by_hand(files: Mapping[str, Command]) -> Section:
    rows = [[file, command.note] for file, command in files.items() if command.note]
    return Section("By hand", [], [Table(["file", "before it runs"], rows)] if rows else [])


def result(plan: Plan) -> dict[str, Any]:
    """Return result.json's content: every command with its numbers, and what distinguishes two effects."""
    files, limits, resolved = plan.files, plan.limits, plan.resolved
    answer: dict[str, Any] = {
        **header("plan"),
        "seed": plan.seed,
        "limits": {
            "voltage": with_unit([limits.low, limits.high], "V"),
            "slew": with_unit(limits.slew if math.isfinite(limits.slew) else None, "V/s"),
            "bandwidth": with_unit(limits.bandwidth, "Hz"),
            "rate": with_unit(limits.rate, "Hz"),
            "from": dict(limits.origin),
        },
        "commands": [
            {
                "file": file,
                "kind": command.kind,
                "role": command.role,
                "purpose": command.purpose,
                "duration": with_unit(command.duration, "s"),
                "peak": with_unit(command.peak, "V"),
                "slew": with_unit(command.slew, "V/s"),
                "current": with_unit(limits.current(command.slew), "A"),
                "reduced": command.scaled or None,
                "by_hand": command.note or None,
            }
            for file, command in files.items()
        ],
    }
    if resolved is not None:
        unit, factor = effect_charts.DISPLAY_UNITS[resolved.effects[0].without.axis.response]
        answer["resolve"] = {
            "effects": [_display_name(effect) for effect in resolved.effects],
            "strengths": [
                {"parameter": e.key, "value": s, "unit": e.strength.si}
                for e, s in zip(resolved.effects, resolved.strengths, strict=True)
            ],
            "noise": with_unit(factor * resolved.noise, unit),
            "proposed": [each.command.name for each in resolved.proposed],
            "experiments": [
                {
                    "name": each.command.name,
                    "difference_rms": with_unit(factor * each.difference, unit),
                    "over_noise": each.over_noise,
                }
                for each in resolved.separations
            ],
        }
    return answer | {"made_by": {"versions": versions.installed()}}


def files_to_list(written: Sequence[Path]) -> list[Path]:
    """Return what a terminal lists of the files written: the report, and the description of the commands."""
    return [path for path in written if path.suffix != ".svg" and path.suffix != ".csv"]


def _plain(command: Command) -> str:
    return command.name.replace("_", " ")
