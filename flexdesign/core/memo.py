"""What was found for a key is kept and given again."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import TypeVar

T = TypeVar("T")
#: Answers that are kept, some kilobytes each; the grid of a pair of effects asks for 200.
KEPT = 4096


class Memo:
    """Answers by key, of one object; `functools.lru_cache` would keep the object itself for as long.

    >>> memo = Memo()
    >>> memo.once("answer", lambda: 42), memo.once("answer", lambda: 43)
    (42, 42)
    """

    def __init__(self) -> None:
        self._kept: dict[Hashable, object] = {}

    def once(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return what was made for a key, or make it."""
        if key not in self._kept:
            found = make()
            if len(self._kept) >= KEPT:
                self._kept.clear()
            self._kept[key] = found
        return self._kept[key]  # type: ignore[return-value]
