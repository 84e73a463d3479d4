"""The decision constants of the diagnosis, and how one is changed in a running process.

``from x import NAME`` copies. A changed constant is therefore set in the module that defines it and in every module
that imported it by name. One whose value went into something else while a module was imported, such as the default of
an argument, cannot be changed afterwards, and that is an error.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from types import ModuleType

#: Imports all that a diagnosis consists of.
ENTRANCE = "flexdesign.diagnosis"


@dataclass(frozen=True)
class Constant:
    """A constant that decides.

    Parameters
    ----------
    module, name
        The module that defines it, and its name there.
    decides
        What it decides.
    most
        No value is larger: one for a probability or a share.
    """

    module: str
    name: str
    decides: str
    most: float = float("inf")

    @property
    def key(self) -> str:
        """Module and name, as they are called in tables and on the command line."""
        return f"{self.module.rpartition('.')[2]}.{self.name}"

    def value(self, factor: float = 1.0) -> float:
        """Return its value, or its value at a factor; whole numbers stay whole and at least one.

        Raises
        ------
        ValueError
            If there is no such number.
        """
        try:
            present = getattr(importlib.import_module(self.module), self.name, None)
        except ModuleNotFoundError as error:
            raise ValueError(f"there is no module {self.module}; edit CONSTANTS in {__name__}") from error
        if isinstance(present, bool) or not isinstance(present, int | float):
            why = "has no" if present is None else "has no number"
            raise ValueError(f"{self.module} {why} {self.name}; edit CONSTANTS in {__name__}")
        if factor == 1.0:
            return present
        scaled = min(factor * present, self.most)
        return max(round(scaled), 1) if isinstance(present, int) else scaled


#: Constants that decide, each with what it decides. Edit here.
CONSTANTS: tuple[Constant, ...] = (
    Constant(
        "flexdesign.estimation.criterion",
        "LEVEL",
        "family-wise probability of a false effect in one step",
        most=1.0,
    ),
    Constant(
        "flexdesign.estimation.criterion",
        "SHARE",
        "least share of the unexplained that an effect removes",
        most=1.0,
    ),
    Constant(
        "flexdesign.estimation.criterion",
        "INDISTINGUISHABLE",
        "difference of BIC below which two effects are alike",
    ),
    Constant(
        "flexdesign.estimation.criterion",
        "SHARE_OF_RANGE",
        "width of an interval that says nothing, of the range",
    ),
    Constant(
        "flexdesign.diagnosis.preparation.dataset",
        "OF_NOISE",
        "relevance: least motion of a prediction, in shares of the noise",
    ),
    Constant(
        "flexdesign.diagnosis.preparation.dataset",
        "OF_STROKE",
        "relevance: least motion of a prediction, in shares of the stroke",
    ),
    Constant(
        "flexdesign.estimation.criterion",
        "LARGE",
        "how much more than remains an effect explains that is named",
    ),
    Constant(
        "flexdesign.measurements.noise_level.noise_floor",
        "ADEQUATE",
        "mean square of the residual above one that still counts as noise",
    ),
    Constant(
        "flexdesign.measurements.noise_level.noise_floor",
        "ERRORS",
        "standard errors of the residual that still count as noise",
    ),
)


def chosen(only: str | None) -> list[Constant]:
    """Return all constants, or one by its key or its name; each is there.

    Raises
    ------
    ValueError
        If none is called so, or one is not in the package.
    """
    found = [each for each in CONSTANTS if only in (None, each.key, each.name, f"{each.module}.{each.name}")]
    if not found:
        raise ValueError(f"there is no constant {only}; constants: {', '.join(each.key for each in CONSTANTS)}")
    for each in found:
        each.value()
        holders(each.module, each.name)
    return found


@contextmanager
def override_constant(constant: Constant, value: float) -> Iterator[None]:
    """Give a constant another value in all modules that hold it, and its own afterwards."""
    before = constant.value()
    try:
        for module, name in holders(constant.module, constant.name):
            setattr(module, name, value)
        yield
    finally:  # modules that were imported meanwhile hold it, too
        for module, name in holders(constant.module, constant.name):
            setattr(module, name, before)


def holders(module: str, name: str) -> list[tuple[ModuleType, str]]:
    """Return the module that defines a constant and all that imported it by name, each with its name there.

    Raises
    ------
    ValueError
        If the value went into something else while a module was imported.
    """
    importlib.import_module(ENTRANCE)
    first, package = importlib.import_module(module), module.partition(".")[0]
    loaded = [each for key, each in sys.modules.items() if key.partition(".")[0] == package]
    found, number = [(first, name)], getattr(first, name)
    for holder, known_as in found:  # grows: a module may import it from one that imported it
        for each in loaded:
            for source, original, own in _imports_of(each):
                is_it = (source, original) == (holder.__name__, known_as) and getattr(each, own, None) is number
                if is_it and (each, own) not in found:
                    found.append((each, own))
    for holder, known_as in found:
        if (line := _used_at_import(holder, known_as)) is not None:
            place = f"line {line} of {holder.__name__} uses it while that is imported"
            raise ValueError(f"{module}.{name} cannot be changed: {place}")
    return found


@cache
def _tree(module: ModuleType) -> ast.Module:
    try:
        return ast.parse(inspect.getsource(module))
    except (OSError, TypeError):  # an empty module, or one without a source
        return ast.Module([], [])


@cache
def _imports_of(module: ModuleType) -> tuple[tuple[str, str, str], ...]:
    """Return what a module imports by name as it is imported: from which module, its name there and here."""
    found = []
    for node in _at_import(_tree(module)):
        if isinstance(node, ast.ImportFrom):
            package = (module.__package__ or "").split(".")
            base = package[: len(package) - node.level + 1] if node.level else []
            source = ".".join([*base, *([node.module] if node.module else [])])
            found += [(source, alias.name, alias.asname or alias.name) for alias in node.names]
    return tuple(found)


def _used_at_import(module: ModuleType, name: str) -> int | None:
    """Return the line where a name is read while a module is imported; None if that happens in functions only."""
    nodes = (node for node in _at_import(_tree(module)) if isinstance(node, ast.Name))
    return next((node.lineno for node in nodes if node.id == name and isinstance(node.ctx, ast.Load)), None)


def _at_import(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes that run as a module is imported: all but the bodies of functions, and annotations."""
    yield node
    for field, value in ast.iter_fields(node):
        is_body = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda) and field == "body"
        if is_body or field in ("annotation", "returns"):
            continue
        for each in value if isinstance(value, list) else [value]:
            if isinstance(each, ast.AST):
                yield from _at_import(each)
