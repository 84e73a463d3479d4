"""The command ``python -m studies.theory_against_fem``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign import __version__
from flexdesign.core import units
from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity
from flexdesign.core.result_cache import Cache, default_folder
from flexdesign.core.serialise import header
from flexdesign.report import charts, render
from flexdesign.report.diagnosis.table_text import effect_name
from flexdesign.report.document import Document, Figure, Section, Table
from flexdesign.report.validation.hierarchy_section import SYMBOLS
from flexdesign.workflows.validation import model_hierarchy
from flexdesign.workflows.validation.model_hierarchy import ModelHierarchy
from studies.error_bars import trial
from studies.error_bars.designs import SEED, SampledDesign, designs

OUT = Path("reports/theory_against_fem")
COUNT = 200
#: Requirements on the compliance model with all effects of the drawing: median and worst distance from FEM.
MEDIAN, WORST = 0.01, 0.03
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Comparison:
    """One design by theory and by FEM: its ladder, and the relative estimate of FEM's own error by quantity."""

    sample: SampledDesign
    ladder: ModelHierarchy
    estimates: Mapping[str, float]


def compare_design(sample: SampledDesign, work: Path, store: Cache) -> Comparison:
    """Solve a design by finite elements, or take the kept solution, and climb its ladder."""
    answer = trial.solve_design(sample, "extruded", work, store, lambda _: None)
    if answer.error:
        raise InputError("design", str(sample.number), None, answer.error)
    fem = {key: _quantity(key, value) for key, value in answer.values.items()}
    climbed = model_hierarchy.model_hierarchy(sample.study(trial.ACCURACY, "extruded").design, fem)
    assert climbed is not None
    return Comparison(sample, climbed, {key: e / abs(answer.values[key]) for key, e in answer.estimates.items()})


def _quantity(key: str, value: float) -> Quantity:
    name = trial.QUANTITIES[key]
    return Quantity(name, value, "", "", key.removeprefix(f"{name}_").replace("_", " "))


def distances(found: Sequence[Comparison], rung: int) -> Array:
    """Return the distances from FEM of all designs on a rung: designs by quantities."""
    return np.array([[abs(each.ladder.rungs[rung].errors[key]) for key in SYMBOLS] for each in found])


def document(found: Sequence[Comparison]) -> Document:
    """Write the report."""
    bare, full = distances(found, 0), distances(found, -1)
    rows = [_row(label, values) for label, values in (("pseudo-rigid", bare), ("all that is drawn", full))]
    worst = found[int(np.argmax(full.max(axis=1)))]
    head = ["model", *(f"{symbol}, {what}" for symbol in SYMBOLS.values() for what in ("median", "worst"))]
    steps = [
        [
            f"+ {effect_name(rung.effect)}" if rung.effect else "pseudo-rigid",
            *(f"{100 * e:+.2f} %" for e in rung.errors.values()),
        ]
        for rung in worst.ladder.rungs
    ]
    sections = [
        Section(
            "Distance from FEM", [_estimates(found)], [Table(head, rows, f"{len(found)} designs")], [_picture(found)]
        ),
        Section(
            "The worst case",
            [f"Design {worst.sample.number}: {worst.sample.text()}, {worst.sample.material}."],
            [Table(["model", *SYMBOLS.values()], steps, "Model / FEM - 1"), _dimensions(worst.sample)],
        ),
    ]
    return Document("How near is theory to finite elements?", summary(found), sections)


def summary(found: Sequence[Comparison]) -> list[str]:
    """Return the answer in a sentence or two."""
    bare, full = distances(found, 0), distances(found, -1)
    verdict = "within" if holds(found) else "NOT within"
    return [
        f"With all effects of the drawing, the compliance model is off by {_spans(np.median(full, axis=0))} in the "
        f"median and by {_spans(full.max(axis=0))} in the worst of {len(found)} designs (K_in, λ, K_out): {verdict} "
        f"{100 * MEDIAN:g} and {100 * WORST:g} %.",
        f"The pseudo-rigid model is off by {_spans(np.median(bare, axis=0))} and {_spans(bare.max(axis=0))}.",
    ]


def holds(found: Sequence[Comparison]) -> bool:
    """Tell whether the model is as near as is asked."""
    full = distances(found, -1)
    return bool(np.median(full, axis=0).max() <= MEDIAN and full.max() <= WORST)


def result(found: Sequence[Comparison]) -> dict[str, Any]:
    """Return the numbers as result.json has them."""
    return {
        **header("theory against FEM"),
        "designs": [
            {
                "design": each.sample.number,
                "material": each.sample.material,
                "dimensions": {name: f"{value:g} mm" for name, value in each.sample.dimensions.items()},
                "pseudo_rigid": dict(each.ladder.rungs[0].errors),
                "compliance": dict(each.ladder.rungs[-1].errors),
                "fem_estimate": dict(each.estimates),
            }
            for each in found
        ],
        "made_by": {"study": "studies.theory_against_fem", "seed": SEED, "flexdesign": __version__},
    }


def _row(label: str, values: Array) -> list[str]:
    pairs = zip(np.median(values, axis=0), values.max(axis=0), strict=True)
    numbers = [f"{units.significant(100 * number, 2)} %" for pair in pairs for number in pair]
    return [label, *numbers]


def _spans(values: Array) -> str:
    return ", ".join(units.significant(100 * value, 2) for value in values) + " %"


def _estimates(found: Sequence[Comparison]) -> str:
    values = [each.estimates[key] for each in found for key in SYMBOLS]
    return (
        f"FEM's own estimates: {100 * float(np.median(values)):.2g} % in the median, at most {100 * max(values):.2g} %."
    )


def _picture(found: Sequence[Comparison]) -> Figure:
    figure, axes = charts.drawing(charts.NARROW, 3.6)
    share = (np.arange(len(found)) + 0.5) / len(found)
    for index, symbol in enumerate(SYMBOLS.values()):
        for rung, style in ((0, "--"), (-1, "-")):
            values = np.sort(np.maximum(100 * distances(found, rung)[:, index], 1e-3))
            label = f"{symbol}, {'pseudo-rigid' if rung == 0 else 'compliance'}"
            axes.plot(values, 100 * share, style, color=charts.COLOURS[index], label=label)
    axes.set_xscale("log")
    axes.set_xlabel("distance from FEM [%]")
    axes.set_ylabel("designs that are nearer [%]")
    axes.grid(color=charts.NEUTRAL, alpha=0.25)
    charts.below(figure, axes, 3)
    return Figure("distances.svg", charts.svg(figure), "How many designs are nearer to FEM than that")


def _dimensions(sample: SampledDesign) -> Table:
    return Table(["dimension", "value"], [[name, f"{value:g} mm"] for name, value in sample.dimensions.items()])


def main(arguments: Sequence[str] | None = None) -> int:
    """Solve the designs and write the report; return 1 if the model is not near enough."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.theory_against_fem", description="How near is the compliance model to finite elements?"
    )
    parser.add_argument("--designs", type=int, default=COUNT, metavar="N")
    parser.add_argument("--work", type=Path, help="folder of the single results; without it, in the cache")
    parser.add_argument("--out", type=Path, default=OUT, help="folder of the report")
    given = parser.parse_args(arguments)
    try:
        render.prepare(given.out)
        store = Cache(default_folder())
        work = given.work or store.folder / "error_bars"
        found, began = [], perf_counter()
        for count, sample in enumerate(designs(SEED, given.designs), 1):
            found.append(compare_design(sample, work, store))
            left = (perf_counter() - began) / count * (given.designs - count) / 60
            errors = ", ".join(f"{100 * error:+.2f}" for error in found[-1].ladder.rungs[-1].errors.values())
            print(f"{count:3d}/{given.designs}  {errors} %  [{left:.0f} min left]", file=sys.stderr, flush=True)
        render.write(given.out, document(found), result(found), {})
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(*summary(found), given.out / "report.html", sep="\n")
    return 0 if holds(found) else 1


if __name__ == "__main__":
    sys.exit(main())
