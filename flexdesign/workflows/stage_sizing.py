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

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import toml_writing, units
from flexdesign.core.model import Quantity, by_key
from flexdesign.core.result_cache import Cache
from flexdesign.core.serialise import header, with_unit
from flexdesign.design import study as studies
from flexdesign.design.design import Design
from flexdesign.fem import stage_condensation
from flexdesign.workflows.stage_targets import Row, StageTargets, Target, read_targets

Progress = Callable[[str], None]
#: Elements by key, as they solve a design.
Solver = Callable[[Design], Mapping[str, Quantity]]

#: A ratio has settled when it changes by less than this share of every tolerance.
CONVERGED = 0.25


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
    problem = read_targets(name, overrides)
    if solver is None:
        assert cache is not None
        solver = _elements(problem.study, cache, progress)
    return _search(problem, solver, progress)


def rows_of(name: str | Path, design: Design, computed: Mapping[str, Quantity]) -> list[Row]:
    """Return the targets of a file and the values of a design: formulas, arms, and `computed` by finite elements."""
    problem = read_targets(name)
    return problem.rows(design, computed, problem.targets)


def _search(problem: StageTargets, solver: Solver, progress: Progress) -> StageSizing:
    checked, targets = problem.checked, problem.targets
    logs, ratio, ratios = np.zeros(len(checked.free)), dict[str, float](), list[Mapping[str, float]]()
    design, computed = problem.study.design, dict[str, Quantity]()
    tolerances = {t.key: t.tolerance for t in targets if t.kind == "elements"}
    for number in range(1, checked.iterations + 1):
        progress(f"solution {number}: fitting {len(logs)} dimensions to {len(targets)} targets by formulas")
        logs = _fit_rounded(problem, logs, targets, ratio)
        design = problem.at(logs)
        computed = dict(solver(design))
        ratios.append(problem.ratio(design, computed))
        changes = [abs(ratios[-1][key] / ratio.get(key, 1.0) - 1) / tolerances[key] for key in tolerances]
        progress(f"solution {number}: finite elements differ by {max(changes, default=0.0):.2g} tolerances")
        ratio = dict(ratios[-1])
        if max(changes, default=0.0) <= CONVERGED:
            break
    asked = {target.key for target in targets if target.kind == "elements"}
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


def _fit_rounded(
    problem: StageTargets, logs: NDArray[np.float64], targets: Sequence[Target], ratio: Mapping[str, float]
) -> NDArray[np.float64]:
    """Return the free dimensions that meet the targets best, in whole micrometres, as a drawing has them.

    The smaller half is rounded first, and the others fitted again, until all are rounded: a micrometre of a hinge
    changes its stiffness by a percent.
    """
    from scipy.optimize import least_squares  # slow to import: not before it is needed

    def residual(values: NDArray[np.float64], fitted: NDArray[np.int_]) -> Any:
        moved = logs.copy()
        moved[fitted] = values
        return problem.residual(moved, targets, ratio)

    start = np.array([problem.study.design.dimensions[name] for name in problem.checked.free])
    logs = logs.copy()
    rest = np.argsort(start)
    while len(rest):
        logs[rest] = least_squares(residual, logs[rest], x_scale=0.1, max_nfev=100, args=(rest,)).x
        smaller, rest = np.array_split(rest, 2)
        logs[smaller] = np.log(np.round(start[smaller] * np.exp(logs[smaller]), 6) / start[smaller])
    return logs


def _elements(study: studies.Study, cache: Cache, progress: Progress) -> Solver:
    """Return finite elements of a whole stage, extrapolated over the meshes of a study."""

    def solve(design: Design) -> Mapping[str, Quantity]:
        levels = stage_condensation.refine(replace(study, design=design), design.stage().assembly(), cache, progress)
        return by_key(stage_condensation.gather_quantities(levels))

    return solve


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
