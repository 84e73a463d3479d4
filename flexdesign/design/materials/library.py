"""Reads materials: the library, a user's own file, or a table in a design.

A material's table holds ``youngs_modulus`` and ``poissons_ratio``, or, for a cubic crystal, ``c11``, ``c12``, ``c44``
and ``orientation``; besides them density, strengths, ``[fatigue]`` and ``[sources]``. With ``like = "Si"`` it takes
from the library what it does not state itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from flexdesign.core import units
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.toml_files import FORMAT, Table, as_written, check, in_si, is_file, read_toml
from flexdesign.design.materials.crystal import WAFER, Crystal, Vector, engineering
from flexdesign.design.materials.fatigue import Fatigue
from flexdesign.design.materials.material import Material

#: Where the library is.
LIBRARY = Path(__file__).with_name("library.toml")
#: Keys that only a crystal has.
CRYSTAL = ("c11", "c12", "c44", "orientation")
#: Directions of a crystal count as orthogonal within this cosine.
SQUARE = 1e-6
#: How an orientation is written.
ORIENTATIONS = 'write "<100>" or "<110>" (x along it, z along [001]), or {x = [1, 1, 0], z = [0, 0, 1], turn = "0 deg"}'

Axes = tuple[Vector, Vector, Vector]


def _axes(given: object) -> Axes:
    """Return the part's axes as directions of the crystal."""
    if isinstance(given, str) and given in WAFER:
        return WAFER[given]
    if not isinstance(given, Mapping) or not {"x", "z"} <= set(given) <= {"x", "z", "turn"}:
        raise ValueError(ORIENTATIONS)
    x, z = (_direction(given[axis]) for axis in "xz")
    if abs(x @ z) > SQUARE:
        raise ValueError("x and z must be at right angles: the sum of the products of their indices must be 0")
    turn = units.from_text(given.get("turn", "0 deg"), "rad")
    y = np.cross(z, x)
    x, y = math.cos(turn) * x + math.sin(turn) * y, math.cos(turn) * y - math.sin(turn) * x
    return tuple(x), tuple(y), tuple(z)


def _direction(given: object) -> np.ndarray:
    if isinstance(given, (list, tuple)) and len(given) == 3 and all(type(index) in (int, float) for index in given):
        length = math.hypot(*given)
        if 0 < length < math.inf:
            return np.array(given) / length
    raise ValueError(f"a direction is three indices, such as [1, 1, 0]; {ORIENTATIONS}")


class _MaterialTable(Table):
    """What every material states."""

    name: str
    density: in_si("kg/m^3", 50.0, 3e4)  # type: ignore[valid-type]
    ultimate_strength: in_si("Pa", 1e6, 2e10) | None = None  # type: ignore[valid-type]
    fatigue: Fatigue | None = None
    source: str = ""
    sources: dict[str, str] = Field(default_factory=dict)
    note: str = ""

    @model_validator(mode="after")
    def _whole(self) -> _MaterialTable:
        for name in self.sources:
            if getattr(self, name, None) is None:
                raise ValueError(f"sources.{name} is the source of a number that is not there")
        if self.fatigue is not None:
            try:
                self.fatigue.slope(self.ultimate_strength)
            except ValueError as error:
                raise ValueError(f"with the fatigue data as they are, {error}") from None
        return self


class _MetalTable(_MaterialTable):
    youngs_modulus: in_si("Pa", 1e6, 2e12)  # type: ignore[valid-type]
    poissons_ratio: in_si("1", 0.0, 0.495)  # type: ignore[valid-type]
    yield_strength: in_si("Pa", 1e6, 2e10)  # type: ignore[valid-type]

    def material(self) -> Material:
        return Material(
            self.name, self.youngs_modulus, self.poissons_ratio, self.density, self.yield_strength, self.source,
            self.ultimate_strength, self.fatigue, None, self.sources, self.note,
        )  # fmt: skip


class _CrystalTable(_MaterialTable):
    c11: in_si("Pa", 1e6, 2e12)  # type: ignore[valid-type]
    c12: in_si("Pa", -1e12, 2e12)  # type: ignore[valid-type]
    c44: in_si("Pa", 1e6, 2e12)  # type: ignore[valid-type]
    orientation: Annotated[Axes, BeforeValidator(_axes)]
    yield_strength: in_si("Pa", 1e6, 2e10) | None = None  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _stable(self) -> _CrystalTable:
        if not (self.c11 > abs(self.c12) and self.c11 + 2 * self.c12 > 0):
            raise ValueError("no crystal is like that: c11 must exceed c12 and -2 c12")
        return self

    def material(self) -> Material:
        crystal = Crystal(self.c11, self.c12, self.c44, self.orientation)
        young, contraction, _ = engineering(crystal.tensor, np.eye(3)[0], np.eye(3)[1])
        return Material(
            self.name, young, contraction, self.density, self.yield_strength, self.source,
            self.ultimate_strength, self.fatigue, crystal, self.sources, self.note,
        )  # fmt: skip


@cache
def library() -> Mapping[str, Material]:
    """Return the materials of the library, by name."""
    return {name: _check({"name": name, **table}, LIBRARY, name) for name, table in _tables().items()}


@cache
def _tables() -> dict[str, dict[str, Any]]:
    return {name: table for name, table in read_toml(LIBRARY).items() if isinstance(table, dict)}


def read(path: Path) -> Material:
    """Read a file that holds one material: ``format = 1`` and the keys of a material's table.

    Raises
    ------
    InputError
        If it cannot be used; the message names the field.
    """
    content = read_toml(path)
    if type(content.get("format")) is not int or content["format"] != FORMAT:
        raise InputError(path, "format", as_written(content.get("format")), f"write format = {FORMAT}")
    return _of_table({key: value for key, value in content.items() if key != "format"}, path, "")


def find(given: object, path: Path) -> Material:
    """Return the material that a design names: one of the library, a file of its own, or a table.

    Parameters
    ----------
    given
        What the design says.
    path
        The design's file; a material's file is looked for next to it.

    Raises
    ------
    InputError
        If there is none, or it cannot be used.
    """
    if isinstance(given, Mapping):
        return _of_table(given, path, "material")
    if not isinstance(given, str):
        remedy = 'expected a name, such as "Al 7075-T6", a file (.toml) or a [material] table'
        raise InputError(path, "material", as_written(given), remedy)
    if given.endswith(".toml"):
        return read(path.parent / given if is_file(path.parent / given) else Path(given))
    return _find_by_name(given, path, "material")


def _find_by_name(name: str, path: Path, field: str) -> Material:
    known = library()
    if name not in known:
        remedy = f"is not in the library{suggest(name, list(known))} (or give a file or a [material] table)"
        raise InputError(path, field, as_written(name), remedy)
    return known[name]


def _of_table(given: Mapping[str, Any], path: Path, field: str) -> Material:
    """Check a table, laid over the library's if it is like one of them."""
    prefix = f"{field}." if field else ""
    if "like" not in given:
        return _check(given, path, field)
    like = given["like"]
    if not isinstance(like, str):
        raise InputError(path, f"{prefix}like", as_written(like), 'expected a name of the library, such as "Si"')
    base = _tables()[_find_by_name(like, path, f"{prefix}like").name]
    own = {key: value for key, value in given.items() if key != "like"}
    # A number of its own does not come from the library's source.
    sources = {key: source for key, source in base.get("sources", {}).items() if key not in own}
    laid = {"name": f"{like}, changed", **base, **own}
    if isinstance(own.get("sources", {}), Mapping):
        laid["sources"] = {**sources, **own.get("sources", {})}
    return _check(laid, path, field)


def _check(table: Mapping[str, Any], path: Path, field: str) -> Material:
    if any(key in table for key in CRYSTAL):
        return check(_CrystalTable, table, path, field).material()
    return check(_MetalTable, table, path, field).material()
