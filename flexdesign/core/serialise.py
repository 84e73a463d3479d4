"""One rule for JSON: what results hold becomes what result.json holds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Set
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import PurePath
from typing import Any

import numpy as np

from flexdesign.core.toml_files import FORMAT


def header(kind: str) -> dict[str, Any]:
    """Return what every result.json begins with: the version of the format, and the kind of the result."""
    return {"format": FORMAT, "kind": kind}


def with_unit(value: Any, unit: str) -> dict[str, Any]:
    """Return a number, or several, with their unit, as result.json holds them."""
    return {"value": value, "unit": unit}


def to_json(value: Any) -> Any:
    """Return a value as JSON can hold it.

    A class with a method `to_json` has its own shape, such as `Quantity`: value, half-width and unit. Any other
    dataclass becomes an object with its fields. Arrays, tuples and sets become lists, enums their values, paths text
    with forward slashes. JSON has no NaN and no infinity: both become null.

    Raises
    ------
    TypeError
        If the value is of a type without a rule, or a key is not text.

    Examples
    --------
    >>> to_json({"gain": float("nan"), "span": (0, 1.5)})
    {'gain': None, 'span': [0, 1.5]}
    """
    if isinstance(value, Enum):
        return to_json(value.value)
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, (np.ndarray, np.generic)):
        return to_json(value.tolist())
    if isinstance(value, PurePath):
        return value.as_posix()
    if isinstance(value, Mapping):
        if wrong := [key for key in value if not isinstance(key, str)]:
            raise TypeError(f"a key of JSON is text, found {wrong[0]!r}")
        return {key: to_json(inner) for key, inner in value.items()}
    if isinstance(value, Set):
        return [to_json(inner) for inner in sorted(value)]
    if isinstance(value, (list, tuple)):
        return [to_json(inner) for inner in value]
    if hasattr(value, "to_json"):
        return to_json(value.to_json())
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: to_json(getattr(value, field.name)) for field in fields(value)}
    raise TypeError(f"JSON has no rule for {type(value).__name__}")
