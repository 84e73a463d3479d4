"""Reading a study of experiments, each refusal with its place."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import Field

from flexdesign.core import data_files, toml_files
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.toml_files import Table, in_si
from flexdesign.dynamics.experiments.plan import (
    AS_MODELLED,
    COMMANDS,
    KNOWN,
    ControllerTable,
    Experiment,
    Gains,
    Plan,
    Published,
    Variant,
    pieces,
)
from flexdesign.dynamics.stage_model import StageModel


class _File(Table):
    format: int
    title: str = ""
    note: str = ""
    robust_ms: in_si("1", 1.05, 5.0) = 1.6  # type: ignore[valid-type]
    cycled: bool = True
    variants: Any = None
    controllers: Any = None
    experiment: Any = Field(examples=["[[experiment]], and below it its name, axes and reference"])


def read(name: str | Path, axes: Sequence[str], overrides: Sequence[str] = ()) -> Plan:
    """Read a study of experiments.

    Parameters
    ----------
    name
        Its path, or the bare name of one in ``studies/``.
    axes
        Axes that the stage model has; every experiment must do with them.
    overrides
        ``table.key=value``.

    Raises
    ------
    InputError
        If anything in it cannot be used.
    """
    path = find(name)
    content = toml_files.read_toml(path)
    with toml_files.attribute_overrides(overrides):
        found = toml_files.check(_File, toml_files.overlay(content, overrides), path)
    if not isinstance(found.experiment, list) or not found.experiment:
        raise InputError(path, "experiment", None, "expected one table or more: [[experiment]]")
    plan = Plan(
        path.stem,
        found.title or path.stem,
        found.note,
        tuple(_experiment(given, n, path) for n, given in enumerate(found.experiment, start=1)),
        {name: toml_files.check(Variant, t, path, at) for name, at, t in _tables(found.variants, path, "variants")},
        {name: _controller(t, path, at) for name, at, t in _tables(found.controllers, path, "controllers")},
        found.robust_ms,
        found.cycled,
        str(path),
    )
    _check(plan, axes, path)
    return plan


def variants(plan: Plan, read_with: Callable[[Sequence[str]], StageModel]) -> dict[str, StageModel]:
    """Return the variants of a stage that some experiment names.

    Parameters
    ----------
    plan
        The study.
    read_with
        Reads the stage model with further overrides laid over it.

    Raises
    ------
    InputError
        If a variant sets what cannot be set; it names the study, not the command line.
    """
    found = {}
    for name, variant in plan.variants_in_use().items():
        try:
            found[name] = read_with(variant.set)
        except InputError as error:
            if error.file != "command line":
                raise
            value = error.value if error.field == "--set" else f"{error.field}={error.value}"
            raise InputError(plan.file, f"variants.{name}.set", value, error.remedy) from error
    return found


def _tables(given: Any, path: Path, at: str) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """Yield name, place and content of the tables within a table."""
    for name, table in _table(given or {}, path, at).items():
        yield name, f"{at}.{name}", _table(table, path, f"{at}.{name}")


def _table(given: Any, path: Path, at: str) -> Mapping[str, Any]:
    if not isinstance(given, Mapping):
        raise InputError(path, at, toml_files.as_written(given), f"expected a table: [{at}]")
    return given


def _controller(given: Mapping[str, Any], path: Path, at: str) -> ControllerTable:
    gains = {
        name: toml_files.check(Gains, table, path, place)
        for name, place, table in _tables(given.get("axis"), path, f"{at}.axis")
    }
    return toml_files.check(ControllerTable, {**given, "axis": gains}, path, at)


def _experiment(given: Any, number: int, path: Path) -> Experiment:
    """Read one experiment, its published numbers one by one, so that a refusal can name its place."""
    at = f"experiment {number}"
    table = dict(_table(given, path, at))
    listed = table.pop("published", [])
    if not isinstance(listed, list):
        raise InputError(path, f"{at}.published", None, "expected a list of tables: published = [{ ... }, { ... }]")
    published = tuple(
        toml_files.check(Published, _table(entry, path, f"{at}.published {n}"), path, f"{at}.published {n}")
        for n, entry in enumerate(listed, start=1)
    )
    found = toml_files.check(Experiment, table, path, at)
    return _with_folder(found.model_copy(update={"published": published}), path.parent)


def _with_folder(experiment: Experiment, folder: Path) -> Experiment:
    """Return an experiment whose files are looked up next to the study."""
    placed = {
        key: given.with_folder(folder)
        for key in ("command", "reference")
        if (given := getattr(experiment, key)) is not None
    }
    return experiment.model_copy(update=placed)


def _check(plan: Plan, axes: Sequence[str], path: Path) -> None:
    """Refuse names that are unknown, ambiguous, or of the wrong kind."""
    for kind, own, reserved in (("variants", plan.variants, [AS_MODELLED]), ("controllers", plan.controllers, KNOWN)):
        for name in own:
            if name in reserved or "+" in name:
                why = "cannot hold a plus, which joins two" if "+" in name else "has a meaning in every study"
                raise InputError(path, f"{kind}.{name}", None, f"this name {why}; choose another")
    owners: dict[str, str] = {}
    for number, experiment in enumerate(plan.experiments, start=1):
        at = f"experiment {number} ({experiment.name})"
        for variant in experiment.variants:
            _require_known(variant, [AS_MODELLED, *plan.variants], path, f"{at}.variants", "a known variant")
            file = stem(experiment.name if variant == AS_MODELLED else f"{experiment.name} {variant}").casefold()
            if file in owners:
                other = owners[file]
                why = "is used twice" if other == experiment.name else f"names the same figures as {other}"
                raise InputError(path, f"{at}.name", experiment.name, f"{why}; give each experiment its own name")
            owners[file] = experiment.name
        for axis in experiment.axes:
            _require_known(axis, axes, path, f"{at}.axes", "an axis of the stage model")
        for controller in experiment.controllers:
            _check_controller(controller, experiment.axes, plan, path, f"{at}.controllers")
        for n, published in enumerate(experiment.published, start=1):
            place = f"{at}.published {n}"
            if published.axis:
                _require_known(published.axis, [*axes, "all axes"], path, f"{place}.axis", "an axis of the stage model")
            if published.controller:
                known = experiment.controllers
                _require_known(
                    published.controller, known, path, f"{place}.controller", "a controller of this experiment"
                )


def _require_known(name: str, known: Sequence[str], path: Path, at: str, what: str) -> None:
    if name not in known:
        raise InputError(path, at, toml_files.as_written(name), f"is not {what}{suggest(name, list(known))}")


def _check_controller(controller: str, axes: Sequence[str], plan: Plan, path: Path, at: str) -> None:
    """Refuse what is no controller, has no gains for an axis, or is more than one command and one feedback."""
    feedbacks = 0
    for piece in pieces(controller):
        _require_known(piece, [*KNOWN, *plan.controllers], path, at, "a known controller")
        feedbacks += piece not in COMMANDS
        for axis in axes:
            if piece in plan.controllers and axis not in plan.controllers[piece].axis:
                remedy = f"has no gains for axis {axis}; add [controllers.{piece}.axis.{axis}]"
                raise InputError(path, at, piece, remedy)
    if feedbacks > 1 or len(pieces(controller)) - feedbacks > 1:
        remedy = "joins two of a kind; at most one of open loop and feedforward, and one PID"
        raise InputError(path, at, controller, remedy)


def stem(title: str) -> str:
    """Return words as the stem of a file name.

    >>> stem("P16 light damping")
    'P16_light_damping'
    """
    return "".join(character if character.isalnum() else "_" for character in title)


def find(name: str | Path) -> Path:
    """Find a study of experiments: a path, or a bare name looked up in studies/, here and as shipped.

    Raises
    ------
    InputError
        If there is no such file; the message suggests the nearest names.
    """
    folder = "is a folder; name a study of experiments (.toml)"
    return data_files.find(name, "study of experiments", "[[experiment]]", "STUDY", folder=folder)
