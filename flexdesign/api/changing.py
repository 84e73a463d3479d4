"""Changes of a design or a model from Python, as the overrides that a command line gives."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any


def overrides(changes: Sequence[str], tables: Mapping[str, Any]) -> list[str]:
    """Return ``key=value`` texts: those given, and one for each value of nested tables.

    >>> overrides(["material=Ti-6Al-4V"], {"dimensions": {"width": "15 mm"}, "mesh": {"levels": 2}})
    ['material=Ti-6Al-4V', 'dimensions.width=15 mm', 'mesh.levels=2']
    >>> overrides([], {"effects": {"my_effect.py": {"rate": "1 nm/s"}}})
    ['effects."my_effect.py".rate=1 nm/s']
    """
    return [*changes, *(f"{key}={_text(value)}" for key, value in _flat(tables))]


def _flat(tables: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in tables.items():
        key = f'{before}"{name}"' if before and "." in name else f"{before}{name}"
        if isinstance(value, Mapping):
            yield from _flat(value, f"{key}.")
        else:
            yield key, value


def _text(value: object) -> str:
    return json.dumps(value) if isinstance(value, (bool, list, tuple)) else str(value)
