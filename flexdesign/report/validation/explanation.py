"""Where formulas and FEM differ, and which compliance the formulas leave out."""

from __future__ import annotations

from flexdesign.report import charts
from flexdesign.report.document import Figure, Section, Table
from flexdesign.report.wording import MODELS, PIECES, name_of
from flexdesign.workflows.validation import Comparison, Validation

#: Deviations below this need no explanation, and pieces below the other are not named.
AGREEMENT = 0.02
NAMED = 0.005

TITLE = "Where formulas and FEM differ, and why"
METHOD = (
    "Each compliance, twice the strain energy under unit load, is split over the members: N²L/EA, V²L/κGA and the "
    "integral of M²/EI from the section forces, which are integrated from the FEM stresses along each hinge, arm and "
    "rod, extrapolated like everything else. The remainder is the part that beam theory of the members "
    "does not cover: the roots, where a leaf's stress spreads into its neighbours, the blocks, and the stiffening of "
    "wide leaves, which cannot contract sideways and count negative."
)


def section(validation: Validation) -> Section:
    """Return the section that splits the compliances and says what the first model misses."""
    if not validation.shares:
        return Section(TITLE, ["The part names no members, so that the compliance is not split over them."])
    others = [why(validation, key) for key in validation.shares if key != "K_in_output_free"]
    chart = charts.shares(_percentages(validation), "% of FEM's compliance")
    figure = Figure("compliance_shares.svg", chart, "Compliance by member, from FEM")
    lacking = [] if validation.formula_shares else ["The part does not state what the compliances of its formulas are."]
    return Section(
        TITLE,
        [METHOD, *lacking, *filter(None, others)],
        [_table(validation)],
        [figure],
    )


def why(validation: Validation, key: str, *, first: bool = False) -> str:
    """Say which neglected compliances account for the first model's error in one stiffness; empty if it has none.

    Where the model's name stands `first` in a text it is explained.
    """
    split, formula = validation.shares.get(key), validation.formula_shares.get(key)
    if split is None or formula is None:
        return ""
    comparison = _comparison(validation, key)
    if comparison is None:
        return ""
    what = f"{name_of(comparison.fem)}, {comparison.fem.boundary},"
    model = next(iter(comparison.analytic))
    error = comparison.error(model)
    if error is None or abs(error) < AGREEMENT:
        return f"{_spoken(model)} agrees with FEM in {what} within {100 * AGREEMENT:g} %."
    total = sum(split.values())
    gaps = {piece: (value - formula.get(piece, 0.0)) / total for piece, value in split.items()}
    missing = _join_pieces({piece: gap for piece, gap in gaps.items() if gap > NAMED})
    excess = _join_pieces({piece: -gap for piece, gap in gaps.items() if gap < -NAMED})
    gap = 100 * (1 - 1 / (1 + error))
    named = f"{_spoken(model)} ({MODELS[model]})" if first and model in MODELS else _spoken(model)
    text = (
        f"{named} puts {what} {100 * abs(error):.0f} % {'above' if error > 0 else 'below'} FEM: its compliance is "
        f"{abs(gap):.1f} % {'smaller' if gap > 0 else 'larger'}."
    )
    parts = {"too small": missing, "too large": excess}
    listed = "; ".join(f"{how} are {pieces}" for how, pieces in parts.items() if pieces)
    return f"{text} Of its parts, in percent of FEM's compliance, {listed}." if listed else text


def _spoken(model: str) -> str:
    """Return the name of a model as it begins a sentence: a column's head has no article."""
    return f"The {model}" if model.endswith("model") else model


def _join_pieces(pieces: dict[str, float]) -> str:
    ranked = sorted(pieces.items(), key=lambda item: -item[1])[:5]
    return ", ".join(f"{PIECES.get(piece, piece)} {100 * value:.1f} %" for piece, value in ranked)


def _comparison(validation: Validation, key: str) -> Comparison | None:
    """Return what FEM and formulas say of a quantity; None where no formula does."""
    return next((c for c in validation.comparisons if c.fem.key == key), None)


def _label(validation: Validation, key: str) -> str:
    fem = validation.fem(key)
    return f"1/{fem.name}, {fem.boundary}"


def _percentages(validation: Validation) -> dict[str, dict[str, float]]:
    return {
        _label(validation, key): {
            PIECES.get(p, p): 100 * split.get(p, 0.0) / sum(split.values()) for p in _pieces(validation)
        }
        for key, split in validation.shares.items()
    }


def _pieces(validation: Validation) -> list[str]:
    """Return the pieces that carry a twentieth of a percent anywhere."""
    splits = validation.shares.values()
    known = dict.fromkeys([*PIECES, *(piece for split in splits for piece in split)])
    return [p for p in known if any(abs(split.get(p, 0.0)) > 5e-4 * sum(split.values()) for split in splits)]


def _table(validation: Validation) -> Table:
    columns = ["piece of the compliance, %"]
    models = {}
    for key in validation.shares:
        columns += [_label(validation, key)]
        if key in validation.formula_shares and (comparison := _comparison(validation, key)) is not None:
            models[key] = next(iter(comparison.analytic))
            columns += [models[key]]
    rows = []
    for piece in _pieces(validation):
        row = [PIECES.get(piece, piece)]
        for key, split in validation.shares.items():
            total = sum(split.values())
            row.append(f"{100 * split.get(piece, 0.0) / total:.1f}")
            if key in models:
                row.append(f"{100 * validation.formula_shares[key].get(piece, 0.0) / total:.1f}")
        rows.append(row)
    return Table(columns, rows, "In percent of FEM's compliance, the formula's columns too")
