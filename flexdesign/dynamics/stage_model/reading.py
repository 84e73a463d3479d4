"""Reading a stage model from its file: every number with its unit, every refusal with file, field, value and remedy."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from flexdesign import effects
from flexdesign.core import data_files, toml_files, units
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.toml_files import is_file
from flexdesign.design import changes
from flexdesign.dynamics.stage_model import fields, response_units
from flexdesign.dynamics.stage_model.axis import (
    ActuatorData,
    AxisModel,
    Contradiction,
    Driver,
    Mode,
    Sensor,
    lumped_frequency,
)
from flexdesign.dynamics.stage_model.fields import Field, Fields
from flexdesign.dynamics.stage_model.model import ControllerTiming, Coupling, StageModel
from flexdesign.dynamics.stage_model.writing import to_toml

#: Tables and lists of an axis, in addition to its single numbers.
_TABLES = ("hysteresis", "effects", "modes", "driver", "sensor", "actuator", "uncertainty", "sources")
_PIECES = (*_TABLES, "unit", "assumed", "fitted")


class _StageFile(toml_files.Table):
    format: int
    axis: Any
    title: str = ""
    source: str = ""
    controller: Any = None
    coupling: Any = None


@dataclass(frozen=True)
class _Place:
    """A table in a file."""

    file: Path
    name: str

    def at(self, key: object) -> _Place:
        """Return the place of one of its keys."""
        return _Place(self.file, f"{self.name}.{key}" if self.name else str(key))

    def refused(self, value: object, remedy: str) -> InputError:
        """Return the refusal of what stands here."""
        return InputError(self.file, self.name, toml_files.as_written(value), remedy)

    def table(self, given: object) -> Mapping[str, Any]:
        """Return what is given if it is a table."""
        if not isinstance(given, Mapping):
            raise self.refused(given, f"expected a table: [{self.name}]")
        return given

    def keys(self, given: Mapping[str, Any], known: Sequence[str]) -> None:
        """Refuse keys that are not known."""
        for key in given:
            if key not in known:
                raise self.at(key).refused(given[key], f"is not a known key{suggest(key, list(known))}")

    def read(self, given: object, known: Fields, required: Collection[str] = ()) -> dict[str, Any]:
        """Return a table of numbers and words."""
        table = self.table(given)
        self.keys(table, list(known))
        for name in required:
            if name not in table:
                raise self.at(name).refused(None, f"is missing; write for example {name} = {known[name].example()}")
        return {name: self.at(name).number(value, known[name]) for name, value in table.items()}

    def number(self, given: object, field: Field) -> Any:
        """Return a number or words."""
        try:
            return field.read(given)
        except ValueError as error:
            raise self.refused(given, str(error)) from None


def find(name: str | Path) -> Path:
    """Find a stage model: a path, or a bare name looked up in studies/, here and as shipped.

    Raises
    ------
    InputError
        If there is no such file; the message suggests the nearest names.
    """
    there = Path(name) / "stage_model.toml"
    hint = f"name the file in it: {there}" if is_file(there) else "name a stage model, which flexdesign validate writes"
    return data_files.find(
        name,
        "stage model",
        "[axis.",
        "MODEL",
        folder=f"is a folder; {hint}",
        remedy="; flexdesign validate writes one: stage_model.toml",
    )


def read(name: str | Path, overrides: Sequence[str] = ()) -> StageModel:
    """Read a stage model.

    Parameters
    ----------
    name
        Path of its file, or the bare name of one in ``studies/``.
    overrides
        ``table.key=value``, such as ``axis.x.damping_ratio=0.02``.

    Raises
    ------
    InputError
        If anything in the file or in the overrides cannot be used.
    """
    path = find(name)
    content = toml_files.read_toml(path)
    _same_axes(content.get("axis"), overrides)
    with toml_files.attribute_overrides(overrides):
        stage = from_content(toml_files.overlay(content, overrides), path)
    return (
        replace(stage, title=changes.title_with_changes(stage.title or stage.name, overrides)) if overrides else stage
    )


def with_overrides(model: StageModel, overrides: Sequence[str]) -> StageModel:
    """Return a stage model with overrides laid over it, as over its file.

    Raises
    ------
    InputError
        If one cannot be used.
    """
    if not overrides:
        return model
    content = tomllib.loads(to_toml(model))
    _same_axes(content["axis"], overrides)
    with toml_files.attribute_overrides(overrides):
        made = from_content(toml_files.overlay(content, overrides), Path(f"{model.name}.toml"))
    return replace(made, name=model.name, title=changes.title_with_changes(made.title or model.name, overrides))


def _same_axes(axes: object, overrides: Sequence[str]) -> None:
    """Refuse overrides of axes that are not there, lest half an axis come into being."""
    for override in overrides:
        key, _, value = override.partition("=")
        first, _, rest = key.strip().partition(".")
        axis = rest.partition(".")[0]
        if first == "axis" and axis and isinstance(axes, Mapping) and axis not in axes:
            raise InputError("command line", key.strip(), value.strip(), f"there is no axis {axis}{_there(axis, axes)}")


def _there(name: str, axes: Mapping[str, Any]) -> str:
    return suggest(name, list(axes)).replace("known", "there are")


def from_content(content: Mapping[str, Any], path: Path) -> StageModel:
    """Return the stage model that a parsed file holds; `path` is where it lies, or would lie.

    Raises
    ------
    InputError
        If anything in it cannot be used.
    """
    if content and not content.get("axis"):
        if "part" in content or "design" in content:
            raise InputError(path, "", None, "is a design or a study; flexdesign validate makes a stage model of it")
        raise InputError(path, "axis", None, "is missing; a stage model has a table for each axis, such as [axis.x]")
    checked = toml_files.check(_StageFile, content, path)
    root = _Place(path, "")
    axes = {name: _axis(given, root.at("axis").at(name)) for name, given in root.at("axis").table(checked.axis).items()}
    timing = root.at("controller").read({} if checked.controller is None else checked.controller, fields.CONTROLLER)
    return StageModel(
        axes=axes,
        controller=ControllerTiming(**timing),
        coupling=Coupling() if checked.coupling is None else _coupling(checked.coupling, axes, root.at("coupling")),
        title=checked.title,
        source=checked.source,
        name=path.stem,
    )


# --- one axis -----------------------------------------------------------------------------------------------------


def _axis(given: object, place: _Place) -> AxisModel:
    name = place.name.removeprefix("axis.")
    if not re.fullmatch(r"(?!.*_from_)[A-Za-z]\w*", name, re.ASCII):
        raise place.refused(None, "an axis is named by letters, digits and underscores, such as x or theta_z")
    table = place.table(given)
    place.keys(table, [*fields.axis("m"), *_PIECES])
    if "gain" not in table:
        remedy = 'is missing; write for example gain = "1.5 um/V"; if validate wrote this file, give the design'
        raise place.at("gain").refused(None, f"{remedy} actuator.voltage_range, and it will know")
    try:
        response = fields.response_of(table["gain"])
    except ValueError as error:
        raise place.at("gain").refused(table["gain"], str(error)) from None
    numbers = place.read(
        {key: value for key, value in table.items() if key not in _PIECES}, fields.axis(response), ["damping_ratio"]
    )
    if "natural_frequency" not in numbers and not {"mass", "stiffness"} & set(numbers):
        remedy = 'is missing; write for example natural_frequency = "116 Hz", or give mass and stiffness'
        raise place.at("natural_frequency").refused(None, remedy)
    numbers.setdefault("natural_frequency", _lumped_frequency(numbers))
    try:
        axis = AxisModel(
            **numbers,
            response=response,
            unit=_unit(table.get("unit", ""), response, place.at("unit")),
            modes=_modes(table.get("modes", []), place.at("modes")),
            effects=_effects(table, response, place),
            driver=Driver(**place.at("driver").read(table.get("driver", {}), fields.DRIVER)),
            sensor=Sensor(**place.at("sensor").read(table.get("sensor", {}), fields.sensor(response))),
            actuator=_actuator(table.get("actuator", {}), response, place.at("actuator")),
        )
    except Contradiction as error:
        raise place.at(error.field).refused(table.get(error.field), error.remedy) from None
    return _provenance(axis, table, place)


def _lumped_frequency(numbers: Mapping[str, float]) -> float:
    both = "mass" in numbers and "stiffness" in numbers
    return lumped_frequency(numbers["mass"], numbers["stiffness"]) if both else float("nan")  # refused with the axis


def _unit(given: object, response: str, place: _Place) -> str:
    """Return the unit in which an axis is to be reported."""
    unit = place.number(given, fields.Text())
    try:
        units.factor(unit or response, response)
    except ValueError as error:
        defaults = " or ".join(dict.fromkeys((*fields.RESPONSES[response], *response_units.DEFAULT_UNITS[response])))
        raise place.refused(given, f"{error}; the gain is per volt of it: write for example {defaults}") from None
    return str(unit)


def _modes(given: object, place: _Place) -> tuple[Mode, ...]:
    if not isinstance(given, list):
        raise place.refused(given, f"expected one table for each further mode: [[{place.name}]]")
    found = [place.at(i).read(each, fields.MODE, list(fields.MODE)) for i, each in enumerate(given, start=1)]
    return tuple(Mode(**mode) for mode in found)


def _actuator(given: object, response: str, place: _Place) -> ActuatorData | None:
    table = place.table(given)
    stroke = fields.stroke_of(table["free_stroke"], response) if "free_stroke" in table else "m"
    return ActuatorData(**place.read(table, fields.actuator(stroke)), stroke_si=stroke) if table else None


def _provenance(axis: AxisModel, given: Mapping[str, Any], place: _Place) -> AxisModel:
    """Return the axis with what the file says of how well its numbers are known, and from where."""
    whole = {name: _whole(name, place.at("effects")) for name in given.get("effects", {})}
    numbers = list(axis.numbers)
    spans = ["driver.limits", "sensor.range", "actuator.voltage_range"]
    named = [*numbers, *spans, *axis.effects, *(f"modes.{i + 1}" for i in range(len(axis.modes))), *_PIECES]

    def entries(key: str, known: list[str], field: Field) -> dict[str, Any]:
        table = _flat(place.at(key).table(given.get(key, {})))
        for name, value in table.items():
            if _with_path(name, whole) not in known:
                remedy = f"is not a number that this axis has{suggest(name, known)}"
                raise place.at(key).at(name).refused(value, remedy)
        return {_with_path(name, whole): place.at(key).at(name).number(value, field) for name, value in table.items()}

    assumed = given.get("assumed", [])
    if not isinstance(assumed, list):
        raise place.at("assumed").refused(assumed, 'expected a list of fields, such as ["damping_ratio"]')
    for name in assumed:
        if _with_path(str(name), whole) not in named:
            remedy = f"{toml_files.as_written(name)} is not a number that this axis has{suggest(str(name), named)}"
            raise place.at("assumed").refused(assumed, remedy)
    measures = given.get("fitted", [])
    if not isinstance(measures, list) or not all(isinstance(measure, str) for measure in measures):
        raise place.at("fitted").refused(measures, 'expected a list of measures, such as ["loop_span"]')
    return replace(
        axis,
        fitted=tuple(measures),
        uncertainty=entries("uncertainty", numbers, fields.RELATIVE),
        assumed=tuple(_with_path(name, whole) for name in assumed),
        sources=entries("sources", named, fields.Text()),
    )


def _with_path(name: str, whole: Mapping[str, str]) -> str:
    """Return the name of an effect or of one of its numbers with the effect's whole path."""
    owner = next((owner for owner in whole if name == owner or name.startswith(f"{owner}.")), "")
    return whole[owner] + name[len(owner) :] if owner else name


def _flat(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table of tables with dotted names: ``bouc_wen.a`` is the same in quotes and without."""
    found: dict[str, Any] = {}
    for name, value in table.items():
        if isinstance(value, Mapping):
            found |= {f"{name}.{inner}": v for inner, v in _flat(value).items()}
        else:
            found[name] = value
    return found


# --- effects and coupling -----------------------------------------------------------------------------------------


def _effects(table: Mapping[str, Any], response: str, place: _Place) -> dict[str, dict[str, float]]:
    given = place.at("effects").table(table.get("effects", {}))
    found = {}
    if "hysteresis" in table:
        short = place.at("hysteresis")
        values = short.table(table["hysteresis"])
        if values.get("model") != "bouc-wen":
            remedy = f'expected model = "bouc-wen"; write any other effect as a table: [{place.name}.effects.NAME]'
            raise short.at("model").refused(values.get("model"), remedy)
        if "bouc_wen" in given:
            raise short.refused(None, f"stands in {place.name}.effects.bouc_wen as well; keep one of them")
        found["bouc_wen"] = _effect("bouc_wen", {k: v for k, v in values.items() if k != "model"}, response, short)
    for name, values in given.items():
        whole, here = _whole(name, place.at("effects")), place.at("effects").at(name)
        if whole in found:
            raise here.refused(None, "is the same file as another effect of this axis; keep one of them")
        found[whole] = _effect(whole, values, response, here)
    return found


def _whole(name: str, place: _Place) -> str:
    """Return the name of an effect, an absolute path if it is one: so it is found from wherever the model is written.

    A path is looked up next to the stage model's file first, then in the working directory.
    """
    if name in fields.AXIS_FIELDS:
        number = fields.AXIS_FIELDS[name]
        if not number.startswith("controller."):
            number = f"{place.name.removesuffix('.effects')}.{number}"
        raise place.at(name).refused(None, f"has its own place in the file; write {number} instead")
    try:
        return effects.resolve_name(name, place.file.parent)
    except ValueError as error:
        raise place.at(name).refused(None, str(error)) from None


def _effect(name: str, given: object, response: str, place: _Place) -> dict[str, float]:
    """Return the values of all parameters of an effect."""
    try:
        known, optional = fields.effect(name, response), fields.optional(name)
    except ValueError as error:
        raise place.refused(None, str(error)) from None
    table = place.table(given)
    power, _ = fields.POWER_LAWS.get(name, ("", ()))
    if power:
        exponent = place.at(power).number(table.get(power, 1), known[power])
        known = fields.effect(name, response, exponent)
    values = place.read(table, known, [key for key in known if key not in optional])
    return {key: values.get(key, optional.get(key, 0.0)) for key in known}


def _coupling(given: object, axes: Mapping[str, AxisModel], place: _Place) -> Coupling:
    table = place.table(given)
    linear = {key: value for key, value in table.items() if key != "quadratic"}
    quadratic = place.at("quadratic").table(table.get("quadratic", {}))
    return Coupling(_pairs(linear, axes, place, 1), _pairs(quadratic, axes, place.at("quadratic"), 2))


def _pairs(
    given: Mapping[str, Any], axes: Mapping[str, AxisModel], place: _Place, power: int
) -> dict[tuple[str, str], float]:
    found = {}
    for key, value in given.items():
        to, middle, origin = key.partition("_from_")
        if not middle:
            raise place.at(key).refused(value, "names no pair of axes; write for example y_from_x")
        for name in (to, origin):
            if name not in axes:
                raise place.at(key).refused(value, f"there is no axis {name}{_there(name, axes)}")
        if to == origin:
            raise place.at(key).refused(value, "couples an axis with itself; that belongs into its gain or its effects")
        field = fields.coupling(axes[to].response, axes[origin].response, power)
        found[to, origin] = place.at(key).number(value, field)
    return found
