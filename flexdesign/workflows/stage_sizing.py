"""A stage sized by its formulas and by finite elements at once: least squares on the dimensions that are free.

Targets are of three kinds: what one of the stage's formulas returns, the coupling by arms that tilt, delta^2 / 2L, and
what finite elements give. The compliance model stands in for finite elements, times their ratio at the last iterate:

    min over x of  sum_i (ln(q_i(x) / target_i) / tolerance_i)^2 + sum_j ((x_j - x_j0) / prior)^2,   x = ln dimension,

with q = model(x) FEM(x_k) / model(x_k). This is output space mapping (Bandler et al., Space mapping: the state of the
art, IEEE Trans. Microw. Theory Tech. 52 (2004), 337): each iteration costs one solution by finite elements, and where
the ratio no longer changes the iterate meets the targets by finite elements themselves. There are mostly more
dimensions than targets: the prior chooses the solution nearest to the start, and so one realisation of many.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from flexdesign.analytic import dimension_synthesis
from flexdesign.core import toml_files, toml_writing, units
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model import Quantity, by_key
from flexdesign.core.printed_numbers import Printed
from flexdesign.core.result_cache import Cache
from flexdesign.core.serialise import header, with_unit
from flexdesign.design import study as studies
from flexdesign.design.design import Design
from flexdesign.fem import stage_condensation
from flexdesign.workflows.sweeps.evaluators import MODELS, by_formulas, version

Progress = Callable[[str], None]
#: Elements by key, as they solve a design.
Solver = Callable[[Design], Mapping[str, Quantity]]

#: A printed number is not met closer than this, relative, however many digits it has.
CLOSEST = 2e-3
#: Most solutions by finite elements.
MOST = 5
#: A ratio has settled when it changes by less than this share of every tolerance.
CONVERGED = 0.25
#: Residual of a design that cannot be built, in tolerances: far above any other.
UNBUILDABLE = 1e3


# --- the file


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


@dataclass(frozen=True)
class StageSizing:
    """Dimensions of a stage that meet targets.

    Parameters
    ----------
    name, title, provenance, note
        Of the file, what the design is to say of itself, and what the report is to say.
    started, design
        Where the search started, and what it found.
    free
        The dimensions that it changed.
    rows
        Targets and results.
    further
        What finite elements give besides.
    ratios
        For each solution by finite elements, their ratio to the compliance model by key.
    """

    name: str
    title: str
    provenance: str
    note: str
    started: Design
    design: Design
    free: tuple[str, ...]
    rows: tuple[Row, ...]
    further: tuple[Quantity, ...]
    ratios: tuple[Mapping[str, float], ...]

    @property
    def met(self) -> bool:
        """Whether all targets are met."""
        return all(row.met for row in self.rows)

    def to_toml(self) -> str:
        """Return the dimensions as the table of a design."""
        return "\n".join(_lines(self)) + "\n"

    def result(self) -> dict[str, Any]:
        """Return everything as result.json has it."""
        dims = self.design.dimensions
        return {
            **header("stage sizing"),
            "title": self.title,
            "provenance": self.provenance,
            "dimensions": {name: with_unit(dims[name], "m") for name in self.free},
            "targets": [
                {**row.target.quantity.to_json(), "by": row.target.kind, "tolerance": row.target.tolerance,
                 "found": row.found.to_json(), "met": row.met, "source": row.target.source}
                for row in self.rows
            ],
            "further": [quantity.to_json() for quantity in self.further],
            "solutions": [dict(ratio) for ratio in self.ratios],
        }  # fmt: skip


def is_stage_targets(name: str | Path) -> bool:
    """Tell whether a file of targets names a stage and its free dimensions."""
    return "free" in toml_files.read_toml(dimension_synthesis.find(name))


def size(
    name: str | Path,
    overrides: Sequence[str] = (),
    cache: Cache | None = None,
    progress: Progress = lambda _: None,
    solver: Solver | None = None,
) -> StageSizing:
    """Read targets and find dimensions that meet them.

    Parameters
    ----------
    name, overrides
        Of the file, and ``table.key=value``.
    cache
        Where meshes and condensed parts are kept; needed without a `solver`.
    progress
        Receives a text about the progress.
    solver
        Stands in for finite elements.

    Raises
    ------
    InputError
        If the file, the design or a mesh cannot be used.
    """
    problem = _read(name, overrides)
    if solver is None:
        assert cache is not None
        solver = _elements(problem.study, cache, progress)
    return _search(problem, solver, progress)


def rows_of(name: str | Path, design: Design, computed: Mapping[str, Quantity]) -> list[Row]:
    """Return the targets of a file and the values of a design: formulas, arms, and `computed` by finite elements."""
    problem = _read(name)
    return problem.rows(design, computed, problem.targets)


def _read(name: str | Path, overrides: Sequence[str] = ()) -> _Problem:
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
    return _Problem(checked, study, start, path)


@dataclass(frozen=True)
class _Problem:
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
            key, kind = _key(target), target.kind
            value = known[kind][key].value * (ratio.get(key, 1.0) if kind == "elements" else 1.0)
            missed.append(np.log(value / target.quantity.value) / target.tolerance)
        return np.concatenate([missed, logs / self.checked.prior])

    def rows(self, design: Design, computed: Mapping[str, Quantity], targets: Sequence[Target]) -> list[Row]:
        """Return targets and what formulas and finite elements give for a design."""
        known = {**self._model_values(design), "elements": dict(computed)}
        return [Row(target, known[target.kind][_key(target)]) for target in targets]

    def ratio(self, design: Design, computed: Mapping[str, Quantity]) -> dict[str, float]:
        """Return finite elements over the compliance model, for what is asked of the former."""
        model = self._model_values(design)["elements"]
        return {key: computed[key].value / model[key].value for key in self.checked.targets.elements}


def _search(problem: _Problem, solver: Solver, progress: Progress) -> StageSizing:
    from scipy.optimize import least_squares  # slow to import: not before it is needed

    checked, targets = problem.checked, problem.targets
    logs, ratio, ratios = np.zeros(len(checked.free)), dict[str, float](), list[Mapping[str, float]]()
    design, computed = problem.study.design, dict[str, Quantity]()
    tolerances = {_key(t): t.tolerance for t in targets if t.kind == "elements"}
    for number in range(1, checked.iterations + 1):
        progress(f"solution {number}: fitting {len(logs)} dimensions to {len(targets)} targets by formulas")
        logs = least_squares(problem.residual, logs, x_scale=0.1, max_nfev=100, args=(targets, ratio)).x
        design = _round_dimensions(problem, logs)
        computed = dict(solver(design))
        ratios.append(problem.ratio(design, computed))
        changes = [abs(ratios[-1][key] / ratio.get(key, 1.0) - 1) / tolerances[key] for key in tolerances]
        progress(f"solution {number}: finite elements differ by {max(changes, default=0.0):.2g} tolerances")
        ratio = dict(ratios[-1])
        if max(changes, default=0.0) <= CONVERGED:
            break
    asked = {_key(target) for target in targets if target.kind == "elements"}
    return StageSizing(
        problem.path.stem,
        checked.title or problem.path.stem.replace("_", " "),
        checked.provenance,
        checked.note,
        problem.study.design,
        design,
        checked.free,
        tuple(problem.rows(design, computed, targets)),
        tuple(q for key, q in computed.items() if key not in asked),
        tuple(ratios),
    )


def _round_dimensions(problem: _Problem, logs: NDArray[np.float64]) -> Design:
    """Return the design with its free dimensions in whole micrometres, as a drawing has them."""
    design, names = problem.at(logs), problem.checked.free
    rounded = {name: round(design.dimensions[name], 6) for name in names}
    return version(problem.study.design.file, problem.start, rounded)


def _elements(study: studies.Study, cache: Cache, progress: Progress) -> Solver:
    """Return finite elements of a whole stage, extrapolated over the meshes of a study."""

    def solve(design: Design) -> Mapping[str, Quantity]:
        levels = stage_condensation.refine(replace(study, design=design), design.stage().assembly(), cache, progress)
        return by_key(stage_condensation.gather_quantities(levels))

    return solve


# --- reading and writing


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


def _key(target: Target) -> str:
    """Return the target's key among those of its kind."""
    return target.quantity.boundary.replace(" ", "_") if target.kind == "arms" else target.quantity.key


def _lines(found: StageSizing) -> Iterator[str]:
    """Yield a design's table of dimensions, those that were found first."""
    described = {p.name: p for p in found.design.part_class.dimensions}
    yield f"# Dimensions by flexdesign size from the targets {found.name}: one realisation of them."
    yield "[dimensions]"
    for name, value in sorted(found.design.dimensions.items(), key=lambda item: item[0] not in found.free):
        parameter = described[name]
        number = f"{value / units.factor(parameter.unit or '1', parameter.si):.6g}"
        written = f'"{number} {parameter.unit}"' if parameter.unit else f"{value:g}"
        comment = ", ".join(filter(None, ["found" if name in found.free else "start", parameter.symbol]))
        yield toml_writing.with_comment(f"{name} = {written}", comment, 36)
