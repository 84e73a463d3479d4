"""The parts of the diagnosis that can be switched off, each with what takes its place."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import Any

from flexdesign.estimation.model_selection.sparse_residual_model import SparseModel
from studies.sensitivity.constants import holders

_ESTIMATION = "flexdesign.estimation"
_SELECTION = f"{_ESTIMATION}.model_selection"
_EFFECTS = "flexdesign.diagnosis.effect_selection"
_PREPARATION = "flexdesign.diagnosis.preparation"


@dataclass(frozen=True)
class Part:
    """A function of the diagnosis that can be switched off.

    Parameters
    ----------
    module, name
        The module that defines it, and its name there; a method or a property after the name of its class and a dot.
    does
        What it does.
    without
        What takes its place: of the same arguments.
    """

    module: str
    name: str
    does: str
    without: Callable[..., Any]

    @property
    def key(self) -> str:
        """Its name, as it is called in tables and on the command line."""
        return self.name.lstrip("_")


def _none(*_: object, **__: object) -> None:
    return None


def _empty(*_: object, **__: object) -> tuple[()]:
    return ()


def _second(_: object, second: Any, *__: object, **___: object) -> Any:
    return second


def _false(*_: object, **__: object) -> bool:
    return False


PARTS: tuple[Part, ...] = (
    Part(f"{_SELECTION}.fitted_model", "escape", "restarts fits that may be in a local minimum", _second),
    Part(
        f"{_SELECTION}.estimation_task", "search_initial_states", "fits initial states from a grid", lambda t, d, m: m
    ),
    Part(f"{_SELECTION}.estimation_task", "grid_initial_states", "tries initial states on a grid", _second),
    Part(
        f"{_ESTIMATION}.least_squares.levenberg_marquardt",
        "_Search.hold_initial_states",
        "holds kinked initial states",
        _false,
    ),
    Part(
        f"{_EFFECTS}.per_run_parameters",
        "vary_step",
        "tries what adds to the reading with numbers of each run",
        lambda task, before, step, **_: step,
    ),
    Part(f"{_EFFECTS}.per_run_parameters", "vary_by_run", "lets strengths differ from run to run", _second),
    Part(f"{_SELECTION}.score_test", "Screening.pairs", "adds two effects in one step", lambda *_: []),
    Part(f"{_SELECTION}.stepwise_selection", "backward", "drops effects that later ones replace", _second),
    Part(
        f"{_SELECTION}.model_comparison",
        "_choose",
        "of approximations takes the one that predicts better",
        lambda _, accepted: next(iter(accepted), None),
    ),
    Part(f"{_SELECTION}.model_comparison", "_trace", "asks that a sinusoid shows by its line", lambda *_: math.inf),
    Part(
        "flexdesign.diagnosis.models_without_physics",
        "is_better_smooth",
        "compares effects with smooth functions",
        _false,
    ),
    Part(
        "flexdesign.diagnosis.models_without_physics",
        "is_better_curve",
        "compares several effects without memory with a static curve",
        _false,
    ),
    Part(
        "flexdesign.diagnosis.models_without_physics",
        "is_better_linear",
        "compares effects with a linear system",
        _false,
    ),
    Part(
        f"{_SELECTION}.sparse_residual_model",
        "sparse_model",
        "explains the residual by smooth functions",
        lambda *_: SparseModel({}, 0.0, 0.0, 0.0, {}),
    ),
    Part(f"{_EFFECTS}.prior_conflicts", "conflicts", "finds effects in parameters beyond their prior", _empty),
    Part(f"{_SELECTION}.stepwise_selection", "confusable", "fits alternatives in the place of what is named", _empty),
    Part(
        f"{_SELECTION}.model_comparison",
        "relevant_ends",
        "tolerates irrelevant ends of ranges",
        lambda t, f: f.at_bound(),
    ),
    Part("flexdesign.diagnosis.procedure", "choose_interpolation", "asks what commands do between samples", _second),
    Part("flexdesign.diagnosis.procedure", "grid_delay", "starts from the best common delay", _second),
    Part("flexdesign.diagnosis.procedure", "grid_frequency", "starts from the best natural frequency", _second),
    Part(f"{_EFFECTS}.estimation_setup", "modes", "lets modes ring as a record begins", _empty),
    Part(f"{_EFFECTS}.estimation_setup", "find_undetermined", "holds what the runs cannot show", _empty),
    Part(
        "flexdesign.diagnosis.procedure", "CalibratedTask.expansion_points", "selects from the design as well", _empty
    ),
    Part(f"{_PREPARATION}.dataset", "DiagnosisData.coarse_step", "counts rounding in coarse steps as noise", _none),
    Part(f"{_PREPARATION}.spectra", "line_frequencies", "tries lines as disturbances", _empty),
    Part(f"{_SELECTION}.fitted_model", "FittedModel.jumps", "counts jumps of the residual", lambda *_: 0),
    Part(
        f"{_ESTIMATION}.least_squares.dataset",
        "Dataset.nuisance_dof",
        "discounts linear initial conditions",
        lambda _: 0.0,
    ),
    Part(
        f"{_SELECTION}.fitted_model", "FittedModel.discrepancy", "discounts evidence by the discrepancy", lambda _: 1.0
    ),
)


def chosen(only: str | None) -> list[Part]:
    """Return all parts, or one by its key; each is there.

    Raises
    ------
    ValueError
        If none is called so.
    """
    found = [part for part in PARTS if only in (None, part.key)]
    if not found:
        raise ValueError(f"there is no part {only}; parts: {', '.join(part.key for part in PARTS)}")
    for part in found:
        _places(part)
    return found


@contextmanager
def switched_off(part: Part) -> Iterator[None]:
    """Put into the place of a part what it is without it, and the part back afterwards."""
    with _replaced(part, lambda _: part.without):
        yield


@contextmanager
def watching(parts: tuple[Part, ...] = PARTS) -> Iterator[set[str]]:
    """Yield the keys of the parts that returned something else than what takes their place would have."""
    acted = set[str]()

    def watch(part: Part) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
        def around(function: Callable[..., Any]) -> Callable[..., Any]:
            def watched(*given: Any, **named: Any) -> Any:
                found = function(*given, **named)
                if part.key not in acted and not _is_same(found, part.without(*given, **named)):
                    acted.add(part.key)
                return found

            return watched

        return around

    with ExitStack() as stack:
        for part in parts:
            stack.enter_context(_replaced(part, watch(part)))
        yield acted


@contextmanager
def _replaced(part: Part, of: Callable[[Callable[..., Any]], Callable[..., Any]]) -> Iterator[None]:
    places = _places(part)
    before = vars(places[0][0])[places[0][1]]
    made: Any
    if isinstance(before, cached_property):
        made = cached_property(of(before.func))
        made.__set_name__(*places[0])
    elif isinstance(before, property):
        assert before.fget is not None
        made = property(of(before.fget))
    else:
        made = of(before)
    try:
        for owner, name in places:
            setattr(owner, name, made)
        yield
    finally:
        for owner, name in places:
            setattr(owner, name, before)


def _places(part: Part) -> list[tuple[ModuleType | type, str]]:
    """Return where it is defined and every module that imported it by name."""
    owner, _, name = part.name.rpartition(".")
    if owner:
        return [(getattr(importlib.import_module(part.module), owner), name)]
    return [*holders(part.module, part.name)]


def _is_same(found: Any, without: Any) -> bool:
    if found is without:
        return True
    if isinstance(found, tuple) and isinstance(without, tuple):
        return len(found) == len(without) and all(_is_same(a, b) for a, b in zip(found, without, strict=True))
    if isinstance(found, SparseModel):
        return not found.terms
    return isinstance(found, bool | int | float | str | list | set | dict) and bool(found == without)
