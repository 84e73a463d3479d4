"""Pages of the catalogue: all effects in a table, or one in full with the picture of its signature.

The table needs nothing that simulates or draws; what does is imported where it is used, so that the list comes at once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexdesign import effects
from flexdesign.core import units, versions
from flexdesign.core.errors import InputError
from flexdesign.core.model import Effect, Parameter
from flexdesign.core.serialise import header, with_unit
from flexdesign.effects import statics
from flexdesign.report.document import Document, Figure, Section, Table

if TYPE_CHECKING:
    from flexdesign.diagnosis.experiment_design.effect_strength import EffectResponse, Signature

#: Number of experiments that are drawn, one of each kind.
DRAWN = 3


def find(name: str) -> Effect:
    """Return an effect by its name or path.

    Raises
    ------
    InputError
        If there is none.
    """
    try:
        return effects.find(name)
    except ValueError as error:
        raise InputError("command line", "effects", name, str(error)) from None


def find_static(name: str) -> Effect:
    """Return a static effect by its name or path; raise as `find` does."""
    try:
        return statics.find(name)
    except ValueError as error:
        raise InputError("command line", "effects", name, str(error)) from None


def catalogue() -> Table:
    """Return all effects, the static ones last: their names, where they act, what reveals them."""
    found = [(name, effects.find(name)) for name in effects.names()]
    found += [(name, statics.find(name)) for name in statics.names()]
    rows = [[name, effect.where, effect.reveal] for name, effect in found]
    return Table(["effect", "where it acts", "what reveals it"], rows, "flexdesign effects NAME shows one in full")


def catalogue_result() -> dict[str, Any]:
    """Return the catalogue as result.json has it."""
    found = {name: description(effects.find(name)) for name in effects.names()}
    static = {name: description(statics.find(name)) for name in statics.names()}
    return {**header("effects"), "effects": found, "static_effects": static}


def result(name: str, signature: Signature | None) -> dict[str, Any]:
    """Return one effect as result.json has it: what it states, and what it changes in each experiment."""
    effect = find(name)
    answer: dict[str, Any] = {**header("effect"), **description(effect)}
    if signature is None:
        return answer
    from flexdesign.report.catalogue import effect_charts

    axis = signature.effect.without
    unit, factor = effect_charts.DISPLAY_UNITS[axis.axis.response]
    values = signature.effect.values(signature.strength)
    stated = {p.name: p for p in effect.parameters}
    answer["signature"] = {
        "axis": axis.name,
        "stroke": with_unit(factor * signature.stroke, unit),
        "values": {key: _number(value, stated[key]) for key, value in values.items() if key in stated},
        "experiments": [
            {
                "name": seen.command.name,
                "kind": seen.command.kind,
                "change_rms": with_unit(factor * seen.change, unit),
                "beyond_gain_rms": with_unit(factor * seen.left, unit),
            }
            for seen in signature.seen
        ],
    }
    return answer


def description(effect: Effect) -> dict[str, Any]:
    """Return what an effect states, as result.json has it."""
    return {
        "name": effect.name,
        "physics": effect.physics,
        "where": effect.where,
        "reveal": effect.reveal,
        "confused_with": list(effect.confused_with),
        "remedy": effect.remedy,
        "remedies": dict(effect.remedies),
        "reference": effect.reference,
        "parameters": [
            {
                "name": p.name,
                "meaning": p.meaning,
                "unit": p.unit,
                **{key: _number(getattr(p, key), p)["value"] for key in ("null", "start")},
                "plausible": [_number(end, p)["value"] for end in p.plausible],
                "of_each_run": p.per_run,
            }
            for p in effect.parameters
        ],
    }


def _number(value: float | None, parameter: Parameter) -> dict[str, Any]:
    """Return a value in the parameter's own unit; infinite ones as text, as JSON has no number for them."""
    if value is None:
        return with_unit(None, parameter.unit)
    if not math.isfinite(value):
        return with_unit(str(value), parameter.unit)
    number = value / units.factor(parameter.unit or "1", parameter.si)
    return with_unit(float(f"{number:.12g}"), parameter.unit)


def document(
    name: str, signature: Signature | None, model: Mapping[str, str] | None = None, drawn: int = DRAWN
) -> Document:
    """Write the page of one effect.

    Parameters
    ----------
    name
        By which it is found.
    signature
        What it changes; None if nothing shows it in time.
    model
        ``title`` of the stage model on which it is shown, and ``changes`` in words.
    drawn
        Number of experiments that get a picture.
    """
    effect = find(name)
    sections = []
    if signature is not None:
        sections = [_signature(effect, signature, model or {}, drawn), _where_it_shows(signature)]
    sections += stated(effect)
    return Document(effect.name, [effect.physics, f"Where it acts: {effect.where}."], sections)


def stated(effect: Effect) -> list[Section]:
    """Return the sections on what an effect states of itself."""
    return [_parameters(effect), _advice(effect)]


def _signature(effect: Effect, signature: Signature, model: Mapping[str, str], drawn: int) -> Section:
    from flexdesign.report import comparison_text

    axis = signature.effect.without
    stated = {p.name: p for p in effect.parameters}
    given = signature.effect.values(signature.strength)
    sentences = ", ".join(f"{key} = {_text(value, stated[key])}" for key, value in given.items() if key in stated)
    stroke = comparison_text.span(axis.axis.response, signature.stroke, 3)
    on = f"axis {axis.name} of the {model['title']}" if model.get("title") else f"axis {axis.name}"
    where = f"Shown on {on}{model.get('changes', '')}, stroke {stroke}, without noise, at {sentences}."
    if not signature.visible:
        return Section("Signature", [where, "Even so none of the experiments changes by a thousandth of it."])
    best = max(signature.seen, key=lambda seen: seen.change)
    share = 100 * best.change / signature.stroke
    strongest = f"It changes the reading of {_plain(best)} most: by {units.significant(share, 2)} % of the stroke, rms."
    return Section("Signature", [where, strongest], figures=_figures(signature, axis.axis.response, drawn))


def _figures(signature: Signature, response: str, drawn: int) -> list[Figure]:
    from flexdesign.report.catalogue import effect_charts

    found: list[Figure] = []
    kinds: list[str] = []
    for seen in signature.visible:
        if seen.command.kind in kinds or len(found) == drawn:
            continue
        kinds.append(seen.command.kind)
        figures, words = effect_charts.draw(seen, response)
        caption = f"{words} ({seen.command.name}); below, what the effect changes"
        found.append(Figure(f"{seen.command.name}.svg", figures, caption))
    return found


def _where_it_shows(signature: Signature) -> Section:
    stroke = signature.stroke
    rows = [
        [seen.command.name, seen.command.purpose, _percent(seen.change / stroke), _percent(seen.left / stroke)]
        for seen in signature.seen
    ]
    caption = (
        "Change of the reading, rms, in percent of the stroke; and what of it a new gain and offset cannot take up"
    )
    return Section(
        "Where it shows",
        ["One sensor alone does not show an effect that a new gain absorbs: it looks like a calibration error."],
        [Table(["experiment", "made for", "change %", "beyond gain %"], rows, caption)],
    )


def _parameters(effect: Effect) -> Section:
    rows = [
        [
            p.name, p.meaning + (", of each run its own" if p.per_run else ""), p.unit or "–",
            "–" if p.null is None else _text(p.null, p), "–" if p.start is None else _text(p.start, p),
            _range(p),
        ]
        for p in effect.parameters
    ]  # fmt: skip
    scaled = "For a stroke of 100 µm and 100 V; on another stage lengths and voltages scale with its own"
    caption = scaled if effect.acts_in_time else ""
    heads = ["parameter", "meaning", "unit", "null", "start", "plausible"]
    return Section("Parameters", ["At the null of a parameter the effect is not there."], [Table(heads, rows, caption)])


def _range(parameter: Parameter) -> str:
    low, high = parameter.plausible
    if math.isinf(low) and math.isinf(high):
        return "any"
    return f"{_text(low, parameter)} … {_text(high, parameter)}"


def _advice(effect: Effect) -> Section:
    confused = ", ".join(effect.confused_with) or "nothing in the catalogue"
    rows = [
        ["what reveals it", effect.reveal],
        ["easily confused with", confused],
        ["what to do about it", effect.remedy],
        *([f"with a {actuator}", remedy] for actuator, remedy in effect.remedies.items()),
        ["reference", effect.reference],
    ]
    return Section("On the bench", [], [Table(["", ""], rows)])


def brief(effect: Effect) -> Table:
    """Return what a terminal shows of an effect."""
    table = _parameters(effect).tables[0]
    return Table(["parameter", "meaning", "null", "start", "plausible"], [_without_unit(row) for row in table.rows])


def _without_unit(row: Sequence[str]) -> list[str]:
    return [*row[:2], *row[3:]]


def advice(effect: Effect) -> list[str]:
    """Return the advice on an effect for a terminal, in addition to its parameters."""
    return [f"{head}: {text}" for head, text in _advice(effect).tables[0].rows]


def model_file(signature: Signature) -> str:
    """Return a stage model of one axis with the effect as it is shown, ready for `flexdesign simulate`."""
    from flexdesign.dynamics.stage_model import ControllerTiming, StageModel, to_toml

    values = signature.effect.at(signature.strength)
    timing = ControllerTiming(delay=values.delay)
    title = f"axis {values.name} with {Path(signature.effect.name).stem}"
    return to_toml(StageModel({values.name: values.axis}, timing, title=title))


def provenance() -> dict[str, Any]:
    """Return what made a result."""
    return {"versions": versions.installed()}


def _plain(seen: EffectResponse) -> str:
    return seen.command.name.replace("_", " ")


def _text(value: float, parameter: Parameter) -> str:
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    return units.to_text(value, parameter.unit, 3, parameter.si)


def _percent(share: float) -> str:
    return "0" if share < 5e-6 else units.significant(100 * share, 2)
