"""A design: a part with numbers, a material and an actuator, read from TOML and checked before anything runs."""

from __future__ import annotations

import copy
import json
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError
from pydantic.fields import FieldInfo

from flexdesign import materials, part, shipped, units
from flexdesign.errors import InputError
from flexdesign.materials import Material
from flexdesign.model import Parameter
from flexdesign.part import suggest

FORMAT = 1

Schema = TypeVar("Schema", bound=BaseModel)


@dataclass(frozen=True)
class Bounds:
    """The numbers a field accepts, in the SI unit `si`."""

    si: str
    lower: float
    upper: float
    exclusive: bool = False

    def read(self, given: object) -> float:
        """Return what a file says as a number in SI.

        Raises
        ------
        ValueError
            If it is none, or lies outside; the message says what is allowed.
        """
        try:
            value = units.from_text(given, self.si)
        except ValueError as error:
            raise ValueError(f"{error}; {self}" if self.si == "1" else str(error)) from error
        if not self.lower <= value <= self.upper or (self.exclusive and value == self.lower):
            raise ValueError(str(self))
        return value

    def __str__(self) -> str:
        unit = units.DISPLAY.get(self.si, self.si)
        low, high = (f"{bound / units.factor(unit or '1', self.si):g}" for bound in (self.lower, self.upper))
        span = f"more than {low}, at most {high}" if self.exclusive else f"{low} to {high}"
        return f"allowed: {span} {unit}".rstrip()


@dataclass(frozen=True)
class WholeBounds(Bounds):
    """The whole numbers a field accepts."""

    def read(self, given: object) -> int:
        """Return what a file says as a whole number."""
        if isinstance(given, bool) or not isinstance(given, int) or not self.lower <= given <= self.upper:
            raise ValueError(f"{self}, a whole number")
        return given


def in_si(si: str, lower: float, upper: float, *, exclusive: bool = False) -> Any:
    """Annotate a number that files write with a unit and the program holds in the SI unit `si`."""
    bounds = Bounds(si, lower, upper, exclusive)
    return Annotated[float, BeforeValidator(bounds.read), bounds]


def whole(lower: int, upper: int) -> Any:
    """Annotate a whole number."""
    bounds = WholeBounds("1", lower, upper)
    return Annotated[int, BeforeValidator(bounds.read), bounds]


class Table(BaseModel):
    """A table of a file: immutable, and with no room for misspelt keys."""

    model_config = ConfigDict(extra="forbid", frozen=True)


_VOLTAGE = Bounds("V", -1e4, 1e4)


def _voltages(given: object) -> tuple[float, float]:
    if not isinstance(given, (list, tuple)) or len(given) != 2:
        raise ValueError('expected two voltages, the lower first, such as ["0 V", "150 V"]')
    low, high = (_VOLTAGE.read(voltage) for voltage in given)
    if low >= high:
        raise ValueError("the first voltage must be the lower one")
    return low, high


class Actuator(Table):
    """A piezo stack between the input ports.

    `free_stroke` is its extension when nothing holds it, `stiffness` that of the stack, `contact_stiffness` that of
    both its seats together, in series with the stack; `preload` the compressive force at rest.
    """

    name: str = "actuator"
    free_stroke: in_si("m", 1e-7, 1e-2)  # type: ignore[valid-type]
    stiffness: in_si("N/m", 1e3, 2e10)  # type: ignore[valid-type]
    contact_stiffness: in_si("N/m", 1e3, 1e13) = float("inf")  # type: ignore[valid-type]
    preload: in_si("N", 0.0, 1e5) = 0.0  # type: ignore[valid-type]
    voltage_range: Annotated[tuple[float, float], BeforeValidator(_voltages)] | None = None
    source: str = ""

    @property
    def installed_stiffness(self) -> float:
        """Stack and seats in series [N/m]."""
        return float(1 / (1 / self.stiffness + 1 / self.contact_stiffness))


class _MaterialTable(Table):
    name: str
    youngs_modulus: in_si("Pa", 1e6, 2e12)  # type: ignore[valid-type]
    poissons_ratio: in_si("1", 0.0, 0.495)  # type: ignore[valid-type]
    density: in_si("kg/m^3", 50.0, 3e4)  # type: ignore[valid-type]
    yield_strength: in_si("Pa", 1e6, 2e10)  # type: ignore[valid-type]
    source: str = ""


class _DesignFile(Table):
    format: int
    part: str
    dimensions: dict[str, Any]
    material: Any
    title: str = ""
    provenance: str = ""
    actuator: Actuator | None = None


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
        The class of its part.
    dimensions
        The part's dimensions, in SI, in the part's order.
    material, actuator
        What it is made of and what drives it; a design without an actuator has no stroke.
    """

    name: str
    title: str
    provenance: str
    file: Path
    part_class: type[part.Part]
    dimensions: Mapping[str, float]
    material: Material
    actuator: Actuator | None

    def part(self) -> part.Part:
        """Return the part with these dimensions.

        Raises
        ------
        InputError
            If the dimensions cannot be built; it names the field, its value and the allowed range.
        """
        try:
            return self.part_class(**self.dimensions)
        except InputError as error:
            raise InputError(self.file, error.field, error.value, error.remedy) from None
        except Exception as error:
            why = part.reason(error, part.file_of(self.part_class))
            remedy = f"fails with {why}; correct the part, or change the dimensions it fails with"
            raise InputError(part.file_of(self.part_class), self.part_class.__name__, None, remedy) from error

    def parameter(self, name: str) -> Parameter:
        """Return the description of one dimension."""
        return next(p for p in self.part_class.dimensions if p.name == name)


def find(name: str | Path) -> Path:
    """Find a design or study file: a path, or a bare name looked up in geometry/ and studies/, here and as shipped.

    Raises
    ------
    InputError
        If there is no such file; the message suggests the nearest names.
    """
    path = Path(name)
    if part.is_file(path):
        if path.suffix == ".py":
            raise InputError(path, "", None, "is a part; name a design (.toml) that uses it")
        return path
    folders = [base / sub for base in (Path(), shipped.root()) for sub in ("geometry", "studies")]
    known = sorted({f.stem for folder in folders if folder.is_dir() for f in folder.glob("*.toml")})
    try:
        if path.is_dir() and str(name):
            raise InputError(path, "", None, "is a folder; name a design or study file (.toml)")
    except OSError as error:
        raise InputError(
            "command line", "STUDY", as_written(str(name)), f"{error.strerror}{suggest('', known)}"
        ) from error
    if path.suffix == ".toml" or len(path.parts) > 1:
        near = suggest(path.stem, known).replace("; known", "; check the path, or give one of the names that are known")
        raise InputError(path, "", None, f"no such file{near}")
    for folder in folders:
        if part.is_file(folder / f"{name}.toml"):
            return folder / f"{name}.toml"
    remedy = f"no such design or study{suggest(str(name), known)}"
    raise InputError("command line", "STUDY", as_written(str(name)), remedy)


def read_toml(path: Path, overrides: Sequence[str] = ()) -> dict[str, Any]:
    """Read a TOML file and lay ``table.key=value`` overrides over it.

    Raises
    ------
    InputError
        If the file cannot be read, is no TOML, or an override has no equals sign or no such table.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError(path, "", None, f"cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise InputError(path, "", None, f"is not UTF-8 text (line {line}); save it as UTF-8") from error
    except (ValueError, RecursionError) as error:
        raise InputError(path, "", None, f"is not valid TOML: {error}; correct that line") from error
    return overlay(content, overrides)


def overlay(content: Mapping[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """Return `content` with ``table.key=value`` overrides; values are text with units, numbers or true/false."""
    changed = copy.deepcopy(dict(content))
    for override in overrides:
        key, equals, text = override.partition("=")
        *tables, last = pieces = key.strip().split(".")
        if not equals or not all(pieces):
            raise InputError("command line", "--set", override, 'write --set table.key="value unit"')
        table = changed
        for name in tables:
            table = table.setdefault(name, {})
            if not isinstance(table, dict):
                remedy = f"{name} is a value ({as_written(table)}), not a table; write --set {name}=..."
                raise InputError("command line", key.strip(), text.strip(), remedy)
        table[last] = _literal(text.strip())
    return changed


@contextmanager
def attributed(overrides: Sequence[str]) -> Iterator[None]:
    """Let an InputError about an overridden field name the command line, not the file it was laid over."""
    try:
        yield
    except InputError as error:
        for override in overrides:
            key = override.partition("=")[0].strip()
            if error.field and (key == error.field or key.startswith(f"{error.field}.")):
                raise InputError("command line", error.field, error.value, error.remedy) from error
        raise


def as_written(value: object) -> object:
    """Return a value as a message shows it: text that would pass for another thing in quotes, tables not at all."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        plain = value.strip() and value.isprintable() and isinstance(_literal(value), str)
        return value if plain else json.dumps(value, ensure_ascii=False)
    if isinstance(value, Mapping) or (isinstance(value, list) and any(isinstance(v, Mapping) for v in value)):
        return None
    return value


def read(path: Path, overrides: Sequence[str] = ()) -> Design:
    """Read and check a design.

    Raises
    ------
    InputError
        If anything in it cannot be used.
    """
    with attributed(overrides):
        return _read(path, overrides)


def _read(path: Path, overrides: Sequence[str]) -> Design:
    content = read_toml(path, overrides)
    checked = check(_DesignFile, content, path)
    try:
        part_class = part.load(checked.part, path.parent)
    except InputError as error:
        if error.file != "part":
            raise
        raise InputError(path, error.field, as_written(error.value), error.remedy) from error
    dimensions = _dimensions(part_class, checked.dimensions, path)
    design = Design(
        name=path.stem,
        title=checked.title or path.stem.replace("_", " "),
        provenance=checked.provenance,
        file=path,
        part_class=part_class,
        dimensions=dimensions,
        material=_material(checked.material, path),
        actuator=checked.actuator,
    )
    try:
        part.examine(design.part())
    except InputError as error:  # the value as it was written
        given = checked.dimensions.get(error.field.removeprefix("dimensions."), error.value)
        raise InputError(error.file, error.field, as_written(given), error.remedy) from error
    return design


def check(schema: type[Schema], content: Mapping[str, Any], path: Path, table: str = "") -> Schema:
    """Validate the content of a file, or of one `table` of it, turning the first failure into an InputError."""
    if not content:
        raise InputError(path, table, None, "is empty; it needs " + ", ".join(_required(schema)))
    if "format" in schema.model_fields:
        written = content.get("format", FORMAT)
        if type(written) is not int or written != FORMAT:
            remedy = f"this version reads format = {FORMAT}; a higher one needs a newer flexdesign"
            raise InputError(path, "format", as_written(written), remedy)
    try:
        return schema.model_validate(content)
    except ValidationError as error:
        # A misspelt key comes before the one that is missing because of it.
        first = min(error.errors(), key=lambda e: {"extra_forbidden": 0, "missing": 2}.get(e["type"], 1))
        place = [str(piece) for piece in first["loc"]]
        field, (owner, annotation) = ".".join([*([table] if table else []), *place]), _field(schema, place)
        remedy = {
            "missing": f"is missing; {_how(place[-1], annotation)}",
            "extra_forbidden": f"is not a known key{suggest(place[-1], list(owner.model_fields))}",
            "string_type": f'expected text: {place[-1]} = "..."',
            "dict_type": f"expected a table: [{field}]",
            "model_type": f"expected a table: [{field}]",
        }.get(first["type"], first["msg"].removeprefix("Value error, "))
        value = None if first["type"] == "missing" else as_written(first["input"])
        raise InputError(path, field, value, remedy) from None


def _field(schema: type[BaseModel], place: Sequence[str]) -> tuple[type[BaseModel], FieldInfo | None]:
    """Return the table in which a place lies, and what is known of the field there."""
    *tables, last = place
    for name in tables:
        annotation = schema.model_fields[name].annotation
        options = [annotation, *getattr(annotation, "__args__", ())]
        schema = next(o for o in options if isinstance(o, type) and issubclass(o, BaseModel))
    return schema, schema.model_fields.get(last)


def _required(schema: type[BaseModel]) -> list[str]:
    return [name for name, field in schema.model_fields.items() if field.is_required()]


def _how(name: str, field: FieldInfo | None) -> str:
    """Return how a field is written."""
    bounds = next((m for m in field.metadata if isinstance(m, Bounds)), None) if field else None
    if name == "format":
        return f"write format = {FORMAT}"
    if bounds and bounds.si != "1":
        return f'write for example {name} = "{units.example(bounds.si)}"'
    if bounds:
        return f"write {name} = ..., {bounds}"
    if field and field.annotation is not str and name != "material":
        return f"write a table: [{name}]"
    example = {"part": "bridge_amplifier", "design": "bridge_amplifier", "material": next(iter(materials.LIBRARY))}
    return f'write for example {name} = "{example.get(name, "...")}"'


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


def _material(given: object, path: Path) -> Material:
    if isinstance(given, Mapping):
        return Material(**check(_MaterialTable, given, path, "material").model_dump())
    if not isinstance(given, str):
        remedy = 'expected a name, such as "Al 7075-T6", or a [material] table'
        raise InputError(path, "material", as_written(given), remedy)
    if given not in materials.LIBRARY:
        remedy = f"is not in the library{suggest(given, list(materials.LIBRARY))} (or give a [material] table)"
        raise InputError(path, "material", as_written(given), remedy)
    return materials.LIBRARY[given]


def _literal(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text
