"""A design: a part with numbers, a material and an actuator, read from TOML and checked before anything runs."""

from __future__ import annotations

import copy
import difflib
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError

from flexdesign import materials, part, shipped, units
from flexdesign.errors import InputError
from flexdesign.materials import Material
from flexdesign.model import Parameter

FORMAT = 1

Schema = TypeVar("Schema", bound=BaseModel)


def in_si(si: str, lower: float = 0.0, upper: float = float("inf"), *, exclusive: bool = False) -> Any:
    """Annotate a number that files write with a unit and the program holds in the SI unit `si`."""

    def read(text: object) -> float:
        value = text if isinstance(text, float) and si == "1" else units.from_text(text, si)
        if not lower <= value <= upper or (exclusive and value == lower):
            low = f"{'more than' if exclusive else 'at least'} {units.significant(lower)}"
            raise ValueError(
                f"allowed: {low} {si if lower else ''}".rstrip()
                + (f", at most {upper:g} {si}" if upper < 1e300 else "")
            )
        return value

    return Annotated[float, BeforeValidator(read)]


class Table(BaseModel):
    """A table of a file: immutable, and with no room for misspelt keys."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Actuator(Table):
    """A piezo stack between the input ports.

    `free_stroke` is its extension when nothing holds it, `stiffness` that of the stack, `contact_stiffness` that of
    both its seats together, in series with the stack; `preload` the compressive force at rest.
    """

    name: str = "actuator"
    free_stroke: in_si("m", exclusive=True)  # type: ignore[valid-type]
    stiffness: in_si("N/m", exclusive=True)  # type: ignore[valid-type]
    contact_stiffness: in_si("N/m", exclusive=True) = float("inf")  # type: ignore[valid-type]
    preload: in_si("N") = 0.0  # type: ignore[valid-type]
    voltage_range: tuple[in_si("V", lower=-1e4, upper=1e4), in_si("V", lower=-1e4, upper=1e4)] | None = None  # type: ignore[valid-type]
    source: str = ""

    @property
    def installed_stiffness(self) -> float:
        """Stack and seats in series [N/m]."""
        return float(1 / (1 / self.stiffness + 1 / self.contact_stiffness))


class _MaterialTable(Table):
    name: str
    youngs_modulus: in_si("Pa", lower=1e6, upper=2e12)  # type: ignore[valid-type]
    poissons_ratio: in_si("1", lower=0.0, upper=0.495)  # type: ignore[valid-type]
    density: in_si("kg/m^3", lower=1.0, upper=3e4)  # type: ignore[valid-type]
    yield_strength: in_si("Pa", lower=1e3, upper=2e10)  # type: ignore[valid-type]
    source: str = ""


class _DesignFile(Table):
    format: int
    part: str
    dimensions: dict[str, Any]
    material: str | _MaterialTable
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
            raise InputError(
                self.file, "dimensions", None, f"the part fails with {type(error).__name__}: {error}"
            ) from error

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
    if path.suffix == ".toml" or path.is_file():
        if path.is_file():
            return path
        raise InputError(path, "", None, "no such file")
    folders = [base / sub for base in (Path(), shipped.root()) for sub in ("geometry", "studies")]
    for folder in folders:
        if (folder / f"{name}.toml").is_file():
            return folder / f"{name}.toml"
    known = sorted({f.stem for folder in folders if folder.is_dir() for f in folder.glob("*.toml")})
    raise InputError(
        "command line", "design or study", str(name), "no such design or study" + _suggest(str(name), known)
    )


def read_toml(path: Path, overrides: Sequence[str] = ()) -> dict[str, Any]:
    """Read a TOML file and lay ``table.key=value`` overrides over it.

    Raises
    ------
    InputError
        If the file cannot be read, is no TOML, or an override has no equals sign or no such table.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(path, "", None, f"cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(path, "", None, f"is not valid TOML: {error}") from error
    return overlay(content, overrides)


def overlay(content: Mapping[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """Return `content` with ``table.key=value`` overrides; values are text with units, numbers or true/false."""
    changed = copy.deepcopy(dict(content))
    for override in overrides:
        key, equals, text = override.partition("=")
        *tables, last = key.strip().split(".")
        if not equals or not last:
            raise InputError("command line", "--set", override, 'write --set table.key="value unit"')
        table = changed
        for name in tables:
            table = table.setdefault(name, {})
            if not isinstance(table, dict):
                raise InputError("command line", key.strip(), text, f"{name} is not a table")
        table[last] = _literal(text.strip())
    return changed


def read(path: Path, overrides: Sequence[str] = ()) -> Design:
    """Read and check a design.

    Raises
    ------
    InputError
        If anything in it cannot be used.
    """
    content = read_toml(path, overrides)
    checked = check(_DesignFile, content, path)
    if checked.format != FORMAT:
        raise InputError(path, "format", checked.format, f"this version reads format = {FORMAT}")
    part_class = part.load(checked.part, path.parent)
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
    design.part()
    return design


def check(schema: type[Schema], content: Mapping[str, Any], path: Path) -> Schema:
    """Validate `content` against a pydantic schema, turning the first failure into an InputError."""
    try:
        return schema.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        location = [
            str(piece) for piece in first["loc"] if not str(piece).startswith(("_", "function-", "str", "constrained"))
        ]
        field = ".".join(location)
        kind = first["type"]
        if kind == "missing":
            raise InputError(path, field, None, "is missing") from None
        if kind == "extra_forbidden":
            known = _known_keys(schema, location[:-1])
            raise InputError(
                path, field, first["input"], "is not a known key" + _suggest(location[-1], known)
            ) from None
        message = first["msg"].removeprefix("Value error, ")
        raise InputError(path, field, first["input"], message) from None


def _known_keys(schema: type[BaseModel], tables: Sequence[str]) -> list[str]:
    for name in tables:
        annotation = schema.model_fields[name].annotation
        options = [annotation, *getattr(annotation, "__args__", ())]
        nested = [o for o in options if isinstance(o, type) and issubclass(o, BaseModel)]
        if not nested:
            return []
        schema = nested[0]
    return list(schema.model_fields)


def _dimensions(part_class: type[part.Part], given: Mapping[str, Any], path: Path) -> dict[str, float]:
    known = [p.name for p in part_class.dimensions]
    for name in given:
        if name not in known:
            raise InputError(
                path, f"dimensions.{name}", given[name], "is not a dimension of this part" + _suggest(name, known)
            )
    values = {}
    for p in part_class.dimensions:
        if p.name not in given:
            raise InputError(path, f"dimensions.{p.name}", None, f"is missing: {p.meaning}")
        try:
            values[p.name] = units.from_text(given[p.name], p.si)
        except ValueError as error:
            raise InputError(path, f"dimensions.{p.name}", given[p.name], str(error)) from None
    return values


def _material(given: str | _MaterialTable, path: Path) -> Material:
    if isinstance(given, _MaterialTable):
        return Material(**given.model_dump())
    if given not in materials.LIBRARY:
        known = list(materials.LIBRARY)
        raise InputError(
            path, "material", given, "is not in the library" + _suggest(given, known) + "; or give a [material] table"
        )
    return materials.LIBRARY[given]


def _literal(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _suggest(name: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
    if near:
        return f"; did you mean {' or '.join(near)}?"
    return f"; known: {', '.join(known)}" if known else ""
