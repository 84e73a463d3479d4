"""The quantities of several analytic models, each computed when it is asked for: some take a hundred times longer."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from flexdesign.core.model.quantity import Quantity


class Formulas(Mapping[str, Sequence[Quantity]]):
    """Quantities by the name of the model.

    Parameters
    ----------
    models
        By name what computes them.

    >>> Formulas({"rigid": lambda: [], "soft": lambda: 1 / 0})["rigid"]
    ()
    """

    def __init__(self, models: Mapping[str, Callable[[], Sequence[Quantity]]]) -> None:
        self._models, self._found = models, dict[str, tuple[Quantity, ...]]()

    def __getitem__(self, model: str) -> tuple[Quantity, ...]:
        if model not in self._found:
            self._found[model] = tuple(self._models[model]())
        return self._found[model]

    def __iter__(self) -> Iterator[str]:
        return iter(self._models)

    def __len__(self) -> int:
        return len(self._models)
