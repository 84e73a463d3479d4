"""Writing a stage model as a file that people can read: its numbers with their units, its caveats as comments."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import fields as members
from pathlib import Path

from flexdesign.core import toml_files, units
from flexdesign.core.toml_files import FORMAT
from flexdesign.core.toml_writing import with_comment
from flexdesign.dynamics.stage_model import fields
from flexdesign.dynamics.stage_model.axis import AxisModel, lumped_frequency
from flexdesign.dynamics.stage_model.model import Coupling, StageModel

_TEXT = fields.Text()
_HEADING = "# Stage model. Any number may be changed, and any unit that measures the same may be written."
#: The comment that names the effects for which there is no data.
ABSENT = "# assumed to be none, for lack of data:"
#: What users should know about a field, in addition to its source.
_COMMENTS = {
    "stiffness": "at the output, actuators installed",
    "gain": "coefficient of the voltage, actuators installed",
    "input_stiffness": "at the actuator, output free",
    "amplification": "output motion per extension, output free",
}


def to_toml(model: StageModel, folder: Path | None = None) -> str:
    """Return a stage model as a file that `read` takes, every number with its unit.

    A number is written with as few digits as give it back, and with seven at most: what people wrote comes back as they
    wrote it, what was computed within a relative 1e-6.

    Parameters
    ----------
    model
        The stage model.
    folder
        Where the file will lie. An effect in a file of the same tree, below this folder or with it below the working
        directory, is then named by the way to it from here, so that the tree can move; any other by its whole path.
    """
    lines = [_HEADING, f"format = {FORMAT}"]
    words = {"title": model.title, "source": model.source}
    lines += [f"{key} = {_TEXT.write(text)}" for key, text in words.items() if text]
    for name, axis in model.axes.items():
        lines += _axis(f"axis.{name}", axis, _ways(axis, folder))
    lines += _table("controller", model.controller, fields.CONTROLLER)
    responses = {name: axis.response for name, axis in model.axes.items()}
    lines += _coupling(model.coupling, responses)
    return "\n".join(lines) + "\n"


def _ways(axis: AxisModel, folder: Path | None) -> dict[str, str]:
    """Return how a file in a folder names those effects of an axis that are files, by their names."""
    if folder is None:
        return {}
    return {name: toml_files.way(Path(name), folder) for name in axis.effects if name.endswith(".py")}


def _relative_name(name: str, ways: Mapping[str, str]) -> str:
    """Return the name of an effect or of one of its numbers with the way to its file, if it has one."""
    owner = next((owner for owner in ways if name == owner or name.startswith(f"{owner}.")), "")
    return ways[owner] + name[len(owner) :] if owner else name


def _axis(place: str, axis: AxisModel, ways: Mapping[str, str]) -> Iterator[str]:
    gain = fields.axis(axis.response, axis.unit)["gain"]
    yield from ("", f"[{place}]")
    if axis.unit:
        yield f"unit = {_TEXT.write(axis.unit)}"
    for name, text in _numbers(axis):
        comment = "assumed: neither computed nor measured" if name in axis.assumed else _comment(name, axis)
        yield with_comment(f"{name} = {text}", comment) if comment else f"{name} = {text}"
    if math.isnan(axis.gain):
        yield with_comment(f"# gain = {gain.example()}", "an example: the gain is not known; see its source below")
    if "bouc_wen" in axis.effects:
        values = _effect("bouc_wen", axis.effects["bouc_wen"], axis.response)
        if not axis.effects["bouc_wen"].get("rest"):  # a stage that was never driven, as is understood
            values.pop("rest", None)
        yield f'hysteresis = {{ model = "bouc-wen", {", ".join(f"{k} = {v}" for k, v in values.items())} }}'
    if axis.uncertainty:
        relative = ", ".join(
            f"{_key(_relative_name(name, ways))} = {fields.RELATIVE.write(value)}"
            for name, value in axis.uncertainty.items()
        )
        yield f"uncertainty = {{ {relative} }}    # relative, 1 sigma"
    if axis.assumed:
        yield f"assumed = [{', '.join(_TEXT.write(_relative_name(name, ways)) for name in axis.assumed)}]"
    if axis.absent:
        yield f"{ABSENT} {', '.join(axis.absent)}"
    if axis.fitted:
        yield f"fitted = [{', '.join(map(_TEXT.write, axis.fitted))}]"
    for mode in axis.modes:
        yield from _table(place + ".modes", mode, fields.MODE, "[[{}]]")
    actuator = fields.actuator(axis.actuator.stroke_si if axis.actuator else "m")
    known = {"actuator": actuator, "driver": fields.DRIVER, "sensor": fields.sensor(axis.response)}
    for key in known:
        yield from _table(f"{place}.{key}", getattr(axis, key), known[key])
    for name, effect in axis.effects.items():
        if name != "bouc_wen":
            yield from ("", f"[{place}.effects.{toml_files.key(_relative_name(name, ways))}]")
            yield from (f"{key} = {text}" for key, text in _effect(name, effect, axis.response).items())
    if axis.sources:
        yield from ("", f"[{place}.sources]")
        for name, text in axis.sources.items():
            yield f"{toml_files.key(_relative_name(name, ways))} = {_TEXT.write(text)}"


def _numbers(axis: AxisModel) -> Iterator[tuple[str, str]]:
    """Yield the single numbers that say something, as TOML; the frequency only where mass and stiffness do not."""
    for name, field in fields.axis(axis.response, axis.unit).items():
        value = getattr(axis, name)
        if value is None or math.isnan(value):
            continue
        if name == "natural_frequency" and axis.mass is not None and axis.stiffness is not None:
            lumped = lumped_frequency(axis.mass, axis.stiffness)
            if math.isclose(value, lumped, rel_tol=1e-9):
                continue
        yield name, field.write(value)


def _comment(name: str, axis: AxisModel) -> str:
    if name != "mass":
        return _COMMENTS.get(name, "")
    share = "" if not axis.modes else f", carries {100 * axis.main_share:.3g} % of the response"
    return f"lumped; the main mode, {units.to_text(axis.natural_frequency, 'Hz')}{share}"


def _table(place: str, table: object, known: fields.Fields, heading: str = "[{}]") -> Iterator[str]:
    """Yield a table without what stands at its default; nothing if all does."""
    if table is None:
        return
    defaults = {each.name: each.default for each in members(table)}  # type: ignore[arg-type]
    values = {name: getattr(table, name) for name in known if getattr(table, name) != defaults[name]}
    if values:
        yield from ("", heading.format(place))
        yield from (f"{name} = {known[name].write(value)}" for name, value in values.items())


def _effect(name: str, values: Mapping[str, float], response: str) -> dict[str, str]:
    """Return the parameters of an effect as TOML; units that depend on an exponent follow it as it is written."""
    known = fields.effect(name, response)
    power, _ = fields.POWER_LAWS.get(name, ("", ()))
    if power:
        known = fields.effect(name, response, float(known[power].write(values.get(power, 1.0))))
    return {key: known[key].write(value) for key, value in values.items()}


def _coupling(coupling: Coupling, responses: Mapping[str, str]) -> Iterator[str]:
    for power, place, pairs in ((1, "coupling", coupling.linear), (2, "coupling.quadratic", coupling.quadratic)):
        if pairs:
            yield from ("", f"[{place}]")
        for (to, origin), value in pairs.items():
            field = fields.coupling(responses[to], responses[origin], power)
            yield f"{to}_from_{origin} = {field.write(value)}"


def _key(name: str) -> str:
    """Return a dotted key, or a quoted one where a part of it may not stand bare."""
    return name if all(toml_files.key(part) == part for part in name.split(".")) else toml_files.quote(name)
