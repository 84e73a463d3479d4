"""A design: a part with numbers, a material and an actuator, read from TOML and checked before anything runs."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, create_model

from flexdesign.core import data_files, toml_files, toml_writing
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.toml_files import Bounds, Table, as_written, attribute_overrides, check, in_si, read_toml
from flexdesign.design import changes, materials, part, sketch, step_part
from flexdesign.design.assembly import Assembly, Stage
from flexdesign.design.materials import Material
from flexdesign.effects import statics

#: Where files named by a bare name are looked up.
FOLDERS = ("geometry", "geometry/sketches", "studies")
_VOLTAGE = Bounds("V", -1e4, 1e4)


def _voltages(given: object) -> tuple[float, float]:
    if not isinstance(given, (list, tuple)) or len(given) != 2:
        raise ValueError('expected two voltages, the lower first, such as ["0 V", "150 V"]')
    low, high = (_VOLTAGE.read(voltage) for voltage in given)
    if low >= high:
        raise ValueError("the first voltage must be the lower one")
    return low, high


class Hysteresis(Table):
    """The hysteresis of a piezo stack that nothing holds, after eqs (26) to (29) of Lin et al. (2019) with n = 1.

    The loop between rising and falling voltage saturates at a / (b + c) and a / (b - c) of extension. Where `assumed`,
    nobody measured it.
    """

    model: Literal["bouc-wen"] = Field(examples=['model = "bouc-wen"'])
    a: in_si("m/V", 0.0, 1e-4)  # type: ignore[valid-type]
    b: in_si("1/V", 0.0, 10.0, exclusive=True)  # type: ignore[valid-type]
    c: in_si("1/V", -10.0, 10.0) = 0.0  # type: ignore[valid-type]
    assumed: bool = False
    source: str = ""


class Actuator(Table):
    """A piezo stack between the input ports.

    `free_stroke` is its extension when nothing holds it, over the whole range of voltage there and back; `stiffness` is
    that of the stack, `contact_stiffness` that of both its seats together, in series with the stack; `preload` the
    compressive force at rest.
    """

    name: str = "actuator"
    free_stroke: in_si("m", 1e-7, 1e-2)  # type: ignore[valid-type]
    stiffness: in_si("N/m", 1e3, 2e10)  # type: ignore[valid-type]
    contact_stiffness: in_si("N/m", 1e3, 1e13) = float("inf")  # type: ignore[valid-type]
    preload: in_si("N", 0.0, 1e5) = 0.0  # type: ignore[valid-type]
    voltage_range: Annotated[tuple[float, float], BeforeValidator(_voltages), _VOLTAGE] | None = None
    hysteresis: Hysteresis | None = None
    source: str = ""

    @property
    def installed_stiffness(self) -> float:
        """Stack and seats in series [N/m]."""
        return float(1 / (1 / self.stiffness + 1 / self.contact_stiffness))


class Tolerances(Table):
    """How well a part is what it is drawn as: the ends of what is likely, alike in all its hinges.

    `dimensions` is that of wire EDM on any dimension, `modulus` the relative one of Young's modulus.
    """

    dimensions: in_si("m", 0.0, 1e-3) = 5e-6  # type: ignore[valid-type]
    modulus: in_si("1", 0.0, 0.5) = 0.02  # type: ignore[valid-type]


class _DesignFile(Table):
    format: int
    part: str
    material: Any  # a name, a file or a table: see flexdesign.design.materials
    dimensions: dict[str, Any] = Field(default_factory=dict)
    ports: dict[str, Any] = Field(default_factory=dict)  # of a STEP file: see flexdesign.design.step_part
    solids: list[str | int] = Field(default_factory=list)  # of a STEP file, by name or number
    title: str = ""
    provenance: str = ""
    actuator: Actuator | None = None
    tolerances: Tolerances = Field(default_factory=Tolerances)
    effects: dict[str, dict[str, Any]] = Field(default_factory=dict)


#: A design that draws its part itself; `sketch.read` checks what is in these keys.
_SKETCHED: dict[str, Any] = dict.fromkeys(sketch.KEYS, (Any, None))
_SketchFile = create_model("_SketchFile", __base__=_DesignFile, **_SKETCHED)


@dataclass(frozen=True)
class Design:
    """A part with numbers.

    Parameters
    ----------
    name, title, provenance
        Name of its file, what people call it, and where its numbers come from if not from its author.
    file
        The file it was read from.
    part_class
        The class of its part or stage.
    dimensions
        The part's dimensions, in SI, in the part's order.
    material, actuator
        What it is made of and what drives it; a design without an actuator has no stroke.
    tolerances
        Of its dimensions and its modulus.
    effects
        Static effects in addition to those that follow from the drawing: values of their parameters, SI, by name.
    changed
        What overrides changed of its file: ``dimensions.width``, ``material``, ``actuator``.
    """

    name: str
    title: str
    provenance: str
    file: Path
    part_class: type[Any]
    dimensions: Mapping[str, float]
    material: Material
    actuator: Actuator | None
    tolerances: Tolerances = field(default_factory=Tolerances)
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    changed: tuple[str, ...] = ()

    @property
    def is_stage(self) -> bool:
        """Whether it is a whole stage rather than one part."""
        return part.is_stage(self.part_class)

    def part(self) -> part.Part:
        """Return the part with these dimensions.

        Raises
        ------
        InputError
            If the dimensions cannot be built; it names the field, its value and the allowed range.
        """
        built: part.Part = self._built
        return built

    def stage(self) -> Stage:
        """Return the stage with these dimensions; raise InputError as `part` does."""
        built: Stage = self._built
        return built

    def assembly(self) -> Assembly:
        """Return the parts and bodies of the stage, put together once."""
        return self._assembled

    @cached_property
    def _assembled(self) -> Assembly:
        return self.stage().assembly()

    @cached_property
    def _built(self) -> Any:
        try:
            return self.part_class(**self.dimensions)
        except InputError as error:
            raise InputError(self.file, error.field, error.value, error.remedy) from None
        except Exception as error:
            why = part.reason(error, part.file_of(self.part_class))
            remedy = f"fails with {why}; correct the part, or change the dimensions it fails with"
            raise InputError(part.file_of(self.part_class), self.part_class.__name__, None, remedy) from error

    def __getstate__(self) -> dict[str, Any]:
        """Return what another process gets: the design without its part, whose solid may not be copied."""
        return {key: value for key, value in self.__dict__.items() if key not in ("_built", "_assembled")}


def find(name: str | Path) -> Path:
    """Find a design or study file: a path, or a bare name looked up in `FOLDERS`, here and as shipped.

    Raises
    ------
    InputError
        If there is no such file; the message suggests the nearest names.
    """
    path = Path(name)
    if toml_files.is_file(path):
        if path.suffix == ".py":
            raise InputError(path, "", None, "is a part; name a design (.toml) that uses it")
        return path
    folders = [
        base / sub for base in (Path(), data_files.root()) for sub in ("geometry", "geometry/sketches", "studies")
    ]
    known = sorted({f.stem for folder in folders if folder.is_dir() for f in folder.glob("*.toml")})
    try:
        if path.is_dir() and str(name):
            raise InputError(path, "", None, "is a folder; name a design or study file (.toml)")
    except OSError as error:
        raise InputError(
            "command line", "STUDY", as_written(str(name)), f"{error.strerror}{suggest('', known)}"
        ) from error
    if path.suffix == ".toml" or len(path.parts) > 1:
        closest = suggest(path.stem, known).replace(
            "; known", "; check the path, or give one of the names that are known"
        )
        raise InputError(path, "", None, f"no such file{closest}")
    for folder in folders:
        if toml_files.is_file(folder / f"{name}.toml"):
            return folder / f"{name}.toml"
    remedy = f"no such design or study{suggest(str(name), known)}"
    raise InputError("command line", "STUDY", as_written(str(name)), remedy)


def read(path: Path, overrides: Sequence[str] = ()) -> Design:
    """Read and check a design.

    Raises
    ------
    InputError
        If anything in it cannot be used.
    """
    with attribute_overrides(overrides):
        return _read(path, overrides)


def _read(path: Path, overrides: Sequence[str]) -> Design:
    content = read_toml(path, overrides)
    if _is_sketch(content) and "ports" in content:
        raise InputError(path, "ports", None, "belong to a part from a STEP file; of a sketch write port = [...]")
    checked = check(_SketchFile if _is_sketch(content) else _DesignFile, content, path)
    part_class = _part_class(checked, path)
    if _is_sketch(content):
        sketched = {key: content[key] for key in sketch.KEYS if key in content}
        part_class = part_class.planned(sketch.read(sketched, checked.dimensions, path))
    dimensions = _dimensions(part_class, checked.dimensions, path)
    design = Design(
        name=path.stem,
        title=changes.title_with_changes(checked.title or path.stem.replace("_", " "), overrides),
        provenance=_still(checked.provenance, overrides),
        file=path,
        part_class=part_class,
        dimensions=dimensions,
        material=materials.find(checked.material, path),
        actuator=checked.actuator,
        tolerances=checked.tolerances,
        effects=_effects(checked.effects, path),
        changed=tuple(dict.fromkeys(_top(override) for override in overrides)),
    )
    try:
        if design.is_stage:
            design.assembly()
        else:
            part.examine(design.part())
            _require_input(design)
    except InputError as error:  # the value as it was written
        given = checked.dimensions.get(error.field.removeprefix("dimensions."), error.value)
        file = path if error.file == "design" else error.file
        raise InputError(file, error.field, as_written(given), error.remedy) from error
    return design


def _is_sketch(content: Mapping[str, Any]) -> bool:
    """Tell whether a design draws its part itself."""
    return content.get("part") == sketch.PART


def _require_input(design: Design) -> None:
    """Raise InputError if there is an actuator and nothing that it could part."""
    if design.actuator is not None and not any(port.role == "input" for port in design.part().ports()):
        remedy = "there is no port with the role input for it to push at; name the faces of its seats, or leave it out"
        raise InputError(design.file, "actuator", design.actuator.name, remedy)


def _part_class(checked: _DesignFile, path: Path) -> type[Any]:
    """Return the class of the part: that of its Python file, or one made of a STEP file and the design's ports."""
    if step_part.is_step(checked.part):
        return step_part.load(checked.part, checked.ports, path, checked.solids)
    if step_part.is_other_solid(checked.part):
        remedy = f'is no STEP file; export the solid as STEP, and write part = "{Path(checked.part).stem}.step"'
        raise InputError(path, "part", checked.part, remedy)
    if checked.ports:
        remedy = "belong to a part from a STEP file; a part in Python names its own in ports()"
        raise InputError(path, "ports", ", ".join(checked.ports), remedy)
    if checked.solids:
        raise InputError(path, "solids", ", ".join(map(str, checked.solids)), "belong to a part from a STEP file")
    try:
        return part.load(checked.part, path.parent)
    except InputError as error:
        if error.file != "part":
            raise
        raise InputError(path, error.field, as_written(error.value), error.remedy) from error


def _still(provenance: str, overrides: Sequence[str]) -> str:
    """Return where dimensions come from, and what was changed since: then what was said of them holds no longer."""
    keys = [toml_files.overridden(override) for override in overrides]
    changed = [key for key in keys if key.startswith(("dimensions.", "material"))]
    if not provenance or not changed or "provenance" in keys:
        return provenance
    return f"{provenance}; changed since, so that this no longer holds: {', '.join(changed)}"


def _top(override: str) -> str:
    """Return what an override changes: a dimension, or a whole table of the design."""
    key = toml_files.overridden(override)
    return key if key.startswith("dimensions.") else key.partition(".")[0]


def _effects(given: Mapping[str, Mapping[str, Any]], path: Path) -> dict[str, dict[str, float]]:
    """Return values of effects [SI]; one in a file, next to the design or in the working folder, by its whole path."""
    found: dict[str, dict[str, float]] = {}
    for name, values in given.items():
        try:
            whole = statics.resolve_name(name, path.parent)
        except ValueError as error:
            raise InputError(path, f"effects.{name}", None, str(error)) from None
        if whole in found:
            raise InputError(path, f"effects.{name}", None, "is the same file as another effect of this design")
        found[whole] = _effect(whole, name, values, path)
    return found


def _effect(whole: str, name: str, given: Mapping[str, Any], path: Path) -> dict[str, float]:
    """Return the values of an effect's parameters [SI]."""
    try:
        known = {p.name: p for p in statics.find(whole).parameters}
    except ValueError as error:
        raise InputError(path, f"effects.{name}", None, str(error)) from None
    values = {}
    for key, p in known.items():
        if key not in given and p.null is None and p.start is not None:  # a constant, which has a usual value
            values[key] = p.start
            continue
        if key not in given:
            raise InputError(path, f"effects.{name}.{key}", None, f"is missing ({p.meaning})")
        try:
            values[key] = Bounds(p.si, *p.plausible).read(given[key])
        except ValueError as error:
            raise InputError(path, f"effects.{name}.{key}", as_written(given[key]), str(error)) from None
    for key in given:
        if key not in known:
            raise InputError(
                path, f"effects.{name}.{key}", as_written(given[key]), f"is unknown{suggest(key, list(known))}"
            )
    return values


def _dimensions(part_class: type[part.Part], given: Mapping[str, Any], path: Path) -> dict[str, float]:
    known = [p.name for p in part_class.dimensions]
    for name in given:
        if name not in known:
            remedy = f"is not a dimension of this part{suggest(name, known)}"
            raise InputError(path, f"dimensions.{name}", as_written(given[name]), remedy)
    values = {}
    for p in part_class.dimensions:
        if p.name not in given:
            remedy = f'is missing ({p.meaning}); write {p.name} = "... {p.unit}"'
            raise InputError(path, f"dimensions.{p.name}", None, remedy)
        try:
            values[p.name] = Bounds(p.si, *p.plausible).read(given[p.name])
        except ValueError as error:
            raise InputError(path, f"dimensions.{p.name}", as_written(given[p.name]), str(error)) from None
    return values


def to_toml(design: Design, content: Mapping[str, Any], folder: Path) -> str:
    """Return the content of a design file as text for a file in another folder, from which its part is found."""
    file = part.file_of(design.part_class)
    if step_part.is_step(file.name):
        return toml_writing.to_toml({**content, "part": os.path.relpath(file, folder)})
    try:
        by_name = part.find(file.stem, folder).resolve() == file.resolve()
    except InputError:
        by_name = False
    name = file.stem if by_name else os.path.relpath(file, folder)
    return toml_writing.to_toml({**content, "part": name})
