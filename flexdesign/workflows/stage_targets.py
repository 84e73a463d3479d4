"""Targets of a stage: what formulas, tilting arms and finite elements shall give, and how far a design is off."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from flexdesign.analytic import dimension_synthesis
from flexdesign.core import toml_files, units
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model import Quantity, by_key
from flexdesign.core.printed_numbers import Printed
from flexdesign.design import study as studies
from flexdesign.design.design import Design
from flexdesign.workflows.sweeps.evaluators import MODELS, by_formulas, version

#: A printed number is not met closer than this, relative, however many digits it has.
CLOSEST = 2e-3
#: Most solutions by finite elements.
MOST = 5
#: Residual of a design that cannot be built, in tolerances: far above any other.
UNBUILDABLE = 1e3


class _Arms(toml_files.Table):
    input_stroke: toml_files.in_si("m", 1e-9, 1e-2)  # type: ignore[valid-type]
    y_from_x: str
    z_from_x: str


class _Targets(toml_files.Table):
    model: str
    formulas: dict[str, str]
    arms: _Arms
    elements: dict[str, str]


class _File(toml_files.Table):
    format: int
    title: str = ""
    provenance: str = ""
    note: str = ""
    design: str
    free: tuple[str, ...] = Field(examples=['free = ["width", "hinge_length"]'])
    start: dict[str, Any] = Field(default_factory=dict)
    prior: toml_files.in_si("1", 1e-2, 1e2) = 1.0  # type: ignore[valid-type]
    iterations: toml_files.whole(1, MOST) = MOST  # type: ignore[valid-type]
    mesh: studies.MeshSettings = studies.MeshSettings()
    targets: _Targets
    sources: dict[str, str] = Field(default_factory=dict)


@dataclass(frozen=True)
class Target:
    """A number that the stage shall have.

    Parameters
    ----------
    kind
        ``"formulas"``, ``"arms"`` or ``"elements"``: who says what the stage has.
    quantity
        The number asked for, `sigma` half a unit of its last digit or its own ±.
    source
        Where it comes from.
    """

    kind: str
    quantity: Quantity
    source: str

    @property
    def key(self) -> str:
        """Its key among those of its kind."""
        return self.quantity.boundary.replace(" ", "_") if self.kind == "arms" else self.quantity.key

    @property
    def tolerance(self) -> float:
        """How closely it is to be met, relative."""
        return max(CLOSEST, (self.quantity.half_width or 0.0) / abs(self.quantity.value))


@dataclass(frozen=True)
class Row:
    """A target and the result."""

    target: Target
    found: Quantity

    @property
    def off(self) -> float:
        """Relative difference."""
        return self.found.value / self.target.quantity.value - 1

    @property
    def met(self) -> bool:
        """Whether the difference is within the tolerance and the error of finite elements together."""
        error = (self.found.half_width or 0.0) / abs(self.target.quantity.value)
        return bool(abs(self.off) <= self.target.tolerance + error)


def is_stage_targets(name: str | Path) -> bool:
    """Tell whether a file of targets names a stage and its free dimensions."""
    return "free" in toml_files.read_toml(dimension_synthesis.find(name))


def read_targets(name: str | Path, overrides: Sequence[str] = ()) -> StageTargets:
    """Return the targets of a file; raise InputError as `size` does."""
    path = dimension_synthesis.find(name)
    with toml_files.attribute_overrides(overrides):
        checked = toml_files.check(_File, toml_files.overlay(toml_files.read_toml(path), overrides), path)
    start = tuple(f"dimensions.{key}={json.dumps(value)}" for key, value in checked.start.items())
    if not studies.read(checked.design).design.is_stage:
        raise InputError(path, "design", checked.design, "is no stage; name a stage's design")
    study = replace(studies.read(checked.design, start), mesh=checked.mesh)
    unknown = next((each for each in checked.free if each not in study.design.dimensions), None)
    if unknown is not None:
        remedy = f"is no dimension of this stage{suggest(unknown, list(study.design.dimensions))}"
        raise InputError(path, "free", unknown, remedy)
    return StageTargets(checked, study, start, path)


@dataclass(frozen=True)
class StageTargets:
    """Targets, and the models that say how far a design is from them."""

    checked: _File
    study: studies.Study
    start: tuple[str, ...]
    path: Path

    @property
    def targets(self) -> list[Target]:
        """All targets, in the order of the file."""
        design, sources = self.study.design, self.checked.sources
        known = self._model_values(design)
        found = []
        for kind, asked in (
            ("formulas", self.checked.targets.formulas),
            ("arms", {"y_from_x": self.checked.targets.arms.y_from_x, "z_from_x": self.checked.targets.arms.z_from_x}),
            ("elements", self.checked.targets.elements),
        ):
            for key, text in asked.items():
                place = f"targets.{kind}.{key}"
                if key not in known[kind]:
                    raise InputError(self.path, place, text, f"is not known{suggest(key, list(known[kind]))}")
                found.append(Target(kind, _parse(text, known[kind][key], self.path, place), sources.get(place, "")))
        return found

    def at(self, logs: NDArray[np.float64]) -> Design:
        """Return the design whose free dimensions are `exp(logs)` times those of the start."""
        dims = self.study.design.dimensions
        dimensions = {name: dims[name] * float(np.exp(log)) for name, log in zip(self.checked.free, logs, strict=True)}
        return version(self.study.design.file, self.start, dimensions)

    def _model_values(self, design: Design) -> dict[str, dict[str, Quantity]]:
        """Return what the models say of a design, by kind of target and key."""
        stage = design.stage()
        actuator = design.actuator.installed_stiffness if design.actuator else None
        models = stage.formulas(design.material, actuator, None)
        name = self.checked.targets.model
        if name not in models:
            remedy = f"is no model of this stage{suggest(name, list(models))}"
            raise InputError(self.path, "targets.model", name, remedy)
        formulas, arms = by_key(models[name]), stage.arms()
        travel = self.checked.targets.arms.input_stroke * formulas["lambda_x_table_free"].value
        ratios = {
            f"{to}_from_x": Quantity("coupling", travel / (2 * arms[to, "x"]), "1", "%", f"{to} from x")
            for to in ("y", "z")
        }
        return {"formulas": formulas, "arms": ratios, "elements": by_key(by_formulas(design, MODELS["analytic"]))}

    def residual(self, logs: NDArray[np.float64], targets: Sequence[Target], ratio: Mapping[str, float]) -> Any:
        """Return how far each target is missed, in tolerances, then how far each dimension moved, in priors."""
        try:
            known = self._model_values(self.at(logs))
        except (InputError, ValueError):
            return np.full(len(targets) + len(logs), UNBUILDABLE)
        missed = []
        for target in targets:
            key, kind = target.key, target.kind
            value = known[kind][key].value * (ratio.get(key, 1.0) if kind == "elements" else 1.0)
            missed.append(np.log(value / target.quantity.value) / target.tolerance)
        return np.concatenate([missed, logs / self.checked.prior])

    def rows(self, design: Design, computed: Mapping[str, Quantity], targets: Sequence[Target]) -> list[Row]:
        """Return targets and what formulas and finite elements give for a design."""
        known = {**self._model_values(design), "elements": dict(computed)}
        return [Row(target, known[target.kind][target.key]) for target in targets]

    def ratio(self, design: Design, computed: Mapping[str, Quantity]) -> dict[str, float]:
        """Return finite elements over the compliance model, for what is asked of the former."""
        model = self._model_values(design)["elements"]
        return {key: computed[key].value / model[key].value for key in self.checked.targets.elements}


def _parse(text: str, like: Quantity, path: Path, place: str) -> Quantity:
    """Read a target such as "18.3 N/mm", known to half a unit of its last digit, or "238 ± 4 um"."""
    number, _, spread = (each.strip() for each in text.partition("±"))
    unit = (spread or number).lstrip("+-.0123456789eE").strip()
    digits = number.split()[0]
    try:
        printed = Printed(place, "", f"{digits} {unit}".strip())
        value = printed.value(like.si)
        sigma = units.from_text(spread, like.si) if spread else printed.half_digit(like.si)
    except (ValueError, ArithmeticError) as error:
        raise InputError(path, place, text, str(error)) from None
    if value <= 0:
        raise InputError(path, place, text, "must be positive")
    return replace(like, value=value, half_width=sigma)
