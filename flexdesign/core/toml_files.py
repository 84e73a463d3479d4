"""Files that users write: TOML whose fields carry units and bounds, overrides from the command line, clear refusals."""

from __future__ import annotations

import copy
import json
import math
import os
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError
from pydantic.fields import FieldInfo

from flexdesign.core import units
from flexdesign.core.errors import InputError, suggest

#: The format of files that this version reads and writes.
FORMAT = 1
#: How names of STEP files end.
STEP = (".step", ".stp")

#: Whole numbers are smaller, as in TOML (64 bits); tables and lists are no deeper within each other.
LARGEST, DEEPEST = 2**63, 20
#: A dot between names, of which some are quoted.
_DOT = re.compile(r'\.(?=(?:[^"]*"[^"]*")*[^"]*$)')
_TOO_LARGE = "write it with an exponent, such as 1e20"

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


def as_text(table: Table) -> dict[str, Any]:
    """Return a table as a file would hold it: numbers that have a unit as text with that unit."""

    def text(number: float, si: str) -> str:
        unit = units.DISPLAY.get(si, si)
        return f"{number / units.factor(unit, si):.6g} {unit}"

    def written(name: str, value: Any) -> Any:
        if isinstance(inner := getattr(table, name), Table):
            return as_text(inner)
        bounds = next((m for m in type(table).model_fields[name].metadata if isinstance(m, Bounds)), None)
        if bounds is None:  # optional numbers carry their bounds one level down
            options = getattr(type(table).model_fields[name].annotation, "__args__", ())
            nested = [m for option in options for m in getattr(option, "__metadata__", ())]
            bounds = next((m for m in nested if isinstance(m, Bounds)), None)
        if bounds is None or bounds.si == "1" or value is None:
            return value
        if isinstance(value, tuple):
            return [text(number, bounds.si) for number in value]
        return text(value, bounds.si)

    return {name: written(name, value) for name, value in table.model_dump().items()}


def read_toml(path: Path, overrides: Sequence[str] = ()) -> dict[str, Any]:
    """Read a TOML file and lay ``table.key=value`` overrides over it.

    Raises
    ------
    InputError
        If the file cannot be read, is no TOML, or an override has no equals sign or no such table.
    """
    if path.suffix.lower() in STEP and is_file(path):
        command = f"flexdesign ports {path} -o {path.with_suffix('.toml')}"
        raise InputError(path, "", None, f"is a STEP file, not TOML; write a design for it by `{command}`")
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError(path, "", None, f"cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise InputError(path, "", None, f"is not UTF-8 text (line {line}); save it as UTF-8") from error
    except (ValueError, RecursionError) as error:
        raise InputError(path, "", None, _no_toml(error)) from error
    for place, value, remedy in _unusable(content):
        raise InputError(path, place, value, remedy)
    return overlay(content, overrides)


def _no_toml(error: Exception) -> str:
    """Return why a text is no TOML, in words that say what to do."""
    if isinstance(error, RecursionError):
        return f"is not valid TOML: tables or lists stand more than {DEEPEST} deep in each other; write them flat"
    if "integer string" in str(error):  # Python reads no whole number of more than 4300 digits
        return f"is not valid TOML: a whole number has more than 64 bits; {_TOO_LARGE}"
    return f"is not valid TOML: {error}; correct that line"


def _unusable(content: Mapping[str, Any]) -> Iterator[tuple[str, object, str]]:
    """Yield place, value and remedy of what TOML allows and nothing can use: numbers and nests without end."""
    waiting: list[tuple[list[str], object]] = [([], content)]
    while waiting:
        place, value = waiting.pop()
        if len(place) > DEEPEST:
            yield ".".join(place), None, f"is more than {DEEPEST} tables or lists deep; write it flat"
        elif isinstance(value, Mapping):
            waiting += [([*place, name], inner) for name, inner in value.items()]
        elif isinstance(value, list):
            waiting += [([*place, str(number)], inner) for number, inner in enumerate(value, start=1)]
        elif isinstance(value, int) and not -LARGEST <= value < LARGEST:
            yield ".".join(place), None, f"is a whole number of more than 64 bits; {_TOO_LARGE}"


def overlay(content: Mapping[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """Return `content` with overrides: ``table.key=value``, or ``table.key*=factor`` for a multiple of what it is.

    A name with dots is quoted, as in TOML. Values are text with units, numbers or true/false.

    >>> overlay({}, ['effects."my_effect.py".rate=1'])
    {'effects': {'my_effect.py': {'rate': 1}}}
    """
    changed = copy.deepcopy(dict(content))
    for override in overrides:
        key, equals, text = override.partition("=")
        *tables, last = pieces = [name.strip('"') for name in _DOT.split(key.strip())]
        if not equals or not all(pieces) or len(pieces) > DEEPEST:
            raise InputError("command line", "--set", override, 'write --set table.key="value unit"')
        table = changed
        for name in tables:
            table = table.setdefault(name, {})
            if not isinstance(table, dict):
                remedy = f"{name} is a value ({as_written(table)}), not a table; write --set {name}=..."
                raise InputError("command line", key.strip(), text.strip(), remedy)
        table[last] = _literal(text.strip())
        for _, _, remedy in _unusable({last: table[last]}):
            raise InputError("command line", key.strip(), text.strip(), remedy)
        if last.endswith("*"):
            name = last.removesuffix("*").rstrip()
            try:
                table[name] = _multiple(table.get(name), table.pop(last))
            except ValueError as error:
                raise InputError(
                    "command line", key.strip(), text.strip(), f"{error}; write {overridden(override)}=..."
                ) from None
    return changed


def overridden(override: str) -> str:
    """Return the dotted key that an override changes."""
    return override.partition("=")[0].strip().removesuffix("*").rstrip()


def _multiple(value: object, factor: object) -> object:
    """Return a number, with its unit if it has one, times a factor."""
    if isinstance(factor, bool) or not isinstance(factor, (int, float)) or not math.isfinite(factor):
        raise ValueError("takes a factor, such as 1.2")
    if isinstance(value, str) and (parts := re.fullmatch(r"\s*([-+]?\d[\d.]*(?:[eE][-+]?\d+)?)\s*(.*)", value)):
        return f"{float(parts[1]) * factor:.15g} {parts[2]}".rstrip()
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ValueError("has no number in the file that could be multiplied")
    return value * factor


@contextmanager
def attribute_overrides(overrides: Sequence[str]) -> Iterator[None]:
    """Let an InputError about an overridden field name the command line, not the file it was laid over."""
    try:
        yield
    except InputError as error:
        for override in overrides:
            key = overridden(override)
            if error.field and (key == error.field or key.startswith(f"{error.field}.")):
                raise InputError("command line", error.field, error.value, error.remedy) from error
        raise


def key(name: str) -> str:
    """Return a key as TOML: bare where it may be.

    >>> key("over_cut"), key("my_effect.py")
    ('over_cut', '"my_effect.py"')
    """
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else quote(name)


def quote(text: str) -> str:
    """Return text as TOML: a JSON string is one but for the delete character."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def way(file: Path, folder: Path) -> str:
    """Return how a file that lies in a folder names another one.

    By the way from there, if it is of the same tree, below that folder or with it below the working directory, so that
    the tree can move; else by its whole path.
    """
    here, work = folder.resolve(), Path().resolve()
    trees = [here, work] if here.is_relative_to(work) else [here]
    within = any(file.is_relative_to(tree) for tree in trees)
    return Path(os.path.relpath(file, here)).as_posix() if within else str(file)


def is_file(path: Path) -> bool:
    """Tell whether `path` is a file; a name that no file system would take is none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def is_folder(path: Path) -> bool:
    """Tell whether `path` is a folder; a name that no file system would take is none."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


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


def check(schema: type[Schema], content: Mapping[str, Any], path: Path, table: str = "") -> Schema:
    """Validate the content of a file, or of one `table` of it, turning the first failure into an InputError."""
    if not content:
        raise InputError(path, table, None, "is empty; it needs " + ", ".join(_required_keys(schema)))
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
        place = [str(piece + 1) if isinstance(piece, int) else piece for piece in first["loc"]]
        if not place:  # what is wrong is how the keys of the table go together
            raise InputError(path, table, None, first["msg"].removeprefix("Value error, ")) from None
        field, (owner, annotation) = ".".join([*([table] if table else []), *place]), _field(schema, place)
        written = "" if place[-1].isdecimal() else f"{place[-1]} = "
        known = [each.alias or name for name, each in owner.model_fields.items()]
        remedy = {
            "missing": f"is missing; {_how(place[-1], annotation)}",
            "extra_forbidden": f"is not a known key{suggest(place[-1], known)}",
            "string_type": f'expected text: {written}"..."',
            "dict_type": f"expected a table: [{field}]",
            "model_type": f"expected a table: [{field}]",
            "tuple_type": f'expected a list: {written}["...", "..."]',
            "list_type": f'expected a list: {written}["...", "..."]',
            "bool_parsing": f"expected true or false: {written}true",
            "bool_type": f"expected true or false: {written}true",
        }.get(first["type"], _plain_message(first["msg"]))
        value = None if first["type"] == "missing" else as_written(first["input"])
        raise InputError(path, field, value, remedy) from None


def _field(schema: type[BaseModel], place: Sequence[str]) -> tuple[type[BaseModel], FieldInfo | None]:
    """Return the table in which a place lies, and what is known of the field there."""
    *tables, last = place
    for name in [each for each in tables if not each.isdecimal()]:  # items of a list are of its own type
        field = schema.model_fields.get(name)
        options = [field.annotation, *getattr(field.annotation, "__args__", ())] if field else []
        inner = next((o for o in options if isinstance(o, type) and issubclass(o, BaseModel)), None)
        if inner is None:  # within a list, or a table whose keys are free
            return schema, None
        schema = inner
    return schema, schema.model_fields.get(last)


def _plain_message(message: str) -> str:
    """Return what pydantic says of a value in the words of a file.

    >>> _plain_message("Input should be a valid dictionary"), _plain_message("Value error, is empty")
    ('expected a table', 'is empty')
    """
    message = message.removeprefix("Value error, ").replace("Input should be", "expected").replace("a valid ", "a ")
    return message.replace("a dictionary", "a table").replace("a string", "text")


def _required_keys(schema: type[BaseModel]) -> list[str]:
    return [name for name, field in schema.model_fields.items() if field.is_required()]


def _how(name: str, field: FieldInfo | None) -> str:
    """Return how a field is written."""
    if name.isdecimal():
        return "add it to the list"
    bounds = next((m for m in field.metadata if isinstance(m, Bounds)), None) if field else None
    if name == "format":
        return f"write format = {FORMAT}"
    if field and field.examples:
        return f"write for example {field.examples[0]}"
    if bounds and bounds.si != "1":
        return f'write for example {name} = "{units.example(bounds.si)}"'
    if bounds:
        return f"write {name} = ..., {bounds}"
    if field and _is_table(field.annotation):
        return f"write a table: [{name}]"
    if field and get_origin(field.annotation) is Literal:
        return f'write {name} = "{get_args(field.annotation)[0]}"'
    example = {"part": "bridge_amplifier", "design": "bridge_amplifier", "material": "AZ31B"}
    return f'write for example {name} = "{example.get(name, "...")}"'


def _is_table(kind: Any) -> bool:
    return get_origin(kind) is dict or (isinstance(kind, type) and issubclass(kind, BaseModel))


def _literal(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text
