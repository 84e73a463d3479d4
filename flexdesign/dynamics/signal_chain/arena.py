"""The arrays that hold the numbers of a chain, at addresses that the engine reads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Numbers for which a chain has room in one array: several times what one of the catalogue needs.
ARENA_SIZE = 1024


class Arena:
    """Keeps numbers and gives their addresses; most fit into two arrays, filled in one go when all are there."""

    def __init__(self) -> None:
        self.kept: list[NDArray[Any]] = []
        self._reals, self._ints = (
            _Allocation(np.zeros(ARENA_SIZE), self.kept),
            _Allocation(np.zeros(ARENA_SIZE, dtype=np.int64), self.kept),
        )

    def reals(self, numbers: Sequence[float]) -> int:
        """Keep numbers, at least one; return their address."""
        return self._reals.keep(numbers)

    def ints(self, numbers: Sequence[int]) -> int:
        """Keep whole numbers; return their address."""
        return self._ints.keep(numbers)

    def fill(self) -> None:
        """Put what was kept where its addresses point to."""
        self._reals.fill()
        self._ints.fill()


class _Allocation:
    """An array that is filled from its beginning; what does not fit gets an array of its own."""

    def __init__(self, array: NDArray[Any], arrays: list[NDArray[Any]]) -> None:
        self.array, self.kept, self.address = array, arrays, array.ctypes.data
        self.numbers: list[float] = []
        arrays.append(array)

    def keep(self, numbers: Sequence[float]) -> int:
        """Put numbers and a zero behind them into the array; return their address."""
        first = len(self.numbers)
        if first + len(numbers) < ARENA_SIZE:
            self.numbers += numbers
            self.numbers.append(0)
            return self.address + 8 * first
        own = np.zeros(len(numbers) + 1, dtype=self.array.dtype)
        own[:-1] = numbers
        self.kept.append(own)
        return int(own.ctypes.data)

    def fill(self) -> None:
        """Put the numbers into the array."""
        self.array[: len(self.numbers)] = self.numbers
