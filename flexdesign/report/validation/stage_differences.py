"""What makes formulas, other programs and FEM of a stage differ: each by a measured cause, or called unexplained."""

from __future__ import annotations

import math

from flexdesign.core import units
from flexdesign.report.document import Section, Table
from flexdesign.report.validation.stage_text import Axes, computed_values, percent, written
from flexdesign.report.wording import format_quantity
from flexdesign.workflows.validation import Comparison
from flexdesign.workflows.validation.validate_stage import StageValidation

#: A formula that is nearer than this to what others published, in every number, is the one that they used.
SAME = 0.01
#: Remarks on a model, in addition to its numbers.
REMARKS = {
    "paper (21)": "Equation (21) of Lin et al. (2019) is not consistent: with four amplifiers around the table it "
    "counts four times the mass M_b of an amplifier in X and Y, but one times its stiffness K_b. The springs counted "
    "here are those of all amplifiers whose output moves with the table. Its masses are the table's M_s, the "
    "amplifiers' M_b of (19) and the guides' M_p; blocks, carriers, limbs and struts move too, and are counted with "
    "the springs. The sizes of all these bodies are choices; a comparison with (31) reflects the choices alone.",
}
#: What depends on the sizes of bodies, which are choices where dimensions are reconstructed.
OF_BODIES = ("output_mass", "output_frequency")


def section(validation: StageValidation) -> Section:
    """Return the section: springs, the way from formula to FEM, variants, and the residual."""
    axes = Axes(validation)
    text = [*_circular(validation), *_remarks(validation), _springs_text(), _chain_text(validation, axes)]
    tables = [*_springs(validation, axes), *_chains(validation, axes)]
    if validation.variants:
        text += [_variants_text(validation, axes)]
        tables += [_variants(validation, axes), *_unexplained(validation, axes)]
    return Section("What explains the differences", [each for each in text if each], tables)


def listed_comparisons(validation: StageValidation, axes: Axes) -> list[Comparison]:
    """Return the comparisons with computed numbers at the stated input, axes that are alike once."""
    far = {q.key for motion in validation.at_full_stroke for q in motion.quantities()}
    return [c for c in validation.comparisons if computed_values(c) and c.fem.key not in far and axes.is_listed(c.fem)]


def nearest(validation: StageValidation) -> str | None:
    """Return the variant that comes nearest to what other programs published, if nearer than the stage itself."""
    others = set(_others(validation))
    misses: dict[str, float] = {}
    for variant in (None, *validation.variants):
        logs = []
        for comparison in validation.comparisons:
            for model, quantity in computed_values(comparison).items():
                value = comparison.fem.value if variant is None else validation.as_in(variant, comparison.fem.key)
                if model in others and value is not None and comparison.fem.name not in OF_BODIES:
                    # A coupling that symmetry forbids misses all there is.
                    logs.append(math.log(quantity.value / value) if value * quantity.value > 0 else math.inf)
        finite = [min(abs(each), 1.0) for each in logs]
        misses[variant or ""] = math.fsum(each**2 for each in finite) if finite else math.inf
    best = min(misses, key=lambda variant: misses[variant])
    return best or None


def _others(validation: StageValidation) -> list[str]:
    """Return the published columns of computed numbers that no formula here returns."""
    found = []
    for label in validation.study.published:
        numbers = [c for c in validation.comparisons if label in computed_values(c)]
        if numbers and _returned_by(validation, label) is None:
            found.append(label)
    return found


def _returned_by(validation: StageValidation, label: str) -> str | None:
    """Return the formula that gives what was published, within the digits printed; couplings aside."""
    left_out = ("coupling", *OF_BODIES)
    rows = [c for c in validation.comparisons if label in computed_values(c) and not c.fem.name.startswith(left_out)]
    for model in _formulas(validation):
        shared = [c.analytic[model].value / c.analytic[label].value - 1 for c in rows if model in c.analytic]
        if shared and max(map(abs, shared)) < SAME:
            return model
    return None


def _formulas(validation: StageValidation) -> list[str]:
    found = dict.fromkeys(model for c in validation.comparisons for model in c.analytic)
    return [model for model in found if model not in validation.study.published]


def _circular(validation: StageValidation) -> list[str]:
    provenance = validation.study.design.provenance
    found = []
    for label in validation.study.published:
        model = _returned_by(validation, label)
        if model and provenance:
            found.append(
                f"“{model}” returns the stiffnesses of “{label}” within {100 * SAME:g} %. That is circular by "
                f"construction and proves nothing, as the dimensions are {provenance}."
            )
    return found


def _remarks(validation: StageValidation) -> list[str]:
    return [REMARKS[model] for model in _formulas(validation) if model in REMARKS]


def _springs_text() -> str:
    return (
        "Springs: on the left what is counted by hand; on the right what FEM finds. There each kind of part has the "
        "strain energy 2U/x² that it holds as a force on the table moves it by x, and these add up to K_out. A kind "
        "that nobody counted bends because the table, the blocks or the bridges tilt; one that holds less than counted "
        "moves less than the table."
    )


def _springs(validation: StageValidation, axes: Axes) -> list[Table]:
    design = validation.study.design
    counted, tables = design.stage().springs(design.material), []
    for axis in axes.listed:
        left = [[name, f"{count}", _stiffness(q.value)] for name, count, q, _ in counted.get(axis, ())]
        right = [[spring.kind, f"{spring.count}", _stiffness(spring.stiffness)] for spring in validation.springs[axis]]
        left.append(["all", "", _stiffness(sum(row[2].value for row in counted.get(axis, ())))])
        right.append(["all", "", _stiffness(sum(spring.stiffness for spring in validation.springs[axis]))])
        rows = [a + b for a, b in zip(*_even(left, right), strict=True)]
        columns = ["springs counted", "number", "K_out", "parts in FEM", "number", "K_out"]
        caption = f"{axes.label(axis)}: what the table's motion bends, inputs free, FEM on the finest mesh"
        tables.append(Table(columns, rows, caption))
    return tables


def _even(*columns: list[list[str]]) -> list[list[list[str]]]:
    longest = max(map(len, columns))
    return [column + [["", "", ""]] * (longest - len(column)) for column in columns]


def _chain_text(validation: StageValidation, axes: Axes) -> str:
    parts = []
    for axis, chain in validation.chains.items():
        if axes.head[axis] != axis:
            continue
        (output, its_output), (ratio, its_ratio) = chain.output, chain.amplification
        parts.append(
            f"In {axes.label(axis)}, for one amplifier alone that pushes against {_stiffness(chain.load)}, the formula "
            f"is {_off(chain.formula / chain.amplifier - 1)} FEM in K_in, {_off(ratio / its_ratio - 1)} in λ and "
            f"{_off(output / its_output - 1)} in K_out; K_in of the stage differs from that of this amplifier by FEM "
            f"by {100 * abs(chain.stage / chain.amplifier - 1):.1f} %."
        )
    return f"Input side: {' '.join(parts)}" if parts else ""


def _off(ratio: float) -> str:
    return f"{100 * abs(ratio):.0f} % {'above' if ratio > 0 else 'below'}"


def _chains(validation: StageValidation, axes: Axes) -> list[Table]:
    """Return the way from the formulas' K_in to that of FEM, one cause at a time."""
    rows = []
    for axis, chain in validation.chains.items():
        if axes.head[axis] != axis:
            continue
        fem = next(c for c in validation.comparisons if c.fem.key == f"K_in_{axis}_table_free")
        model, start = next((m, q.value) for m, q in fem.analytic.items())
        steps = [
            ("amplifiers by their own formula, loaded by what the springs counted hold", chain.formula),
            ("amplifiers by FEM, alone, so loaded: their compliance that the formula leaves out", chain.amplifier),
            ("FEM of the stage: bodies that tilt, limbs that stretch", chain.stage),
            ("extrapolated to vanishing elements", fem.fem.value),
        ]
        rows.append([axes.label(axis), model, _stiffness(start), ""])
        for (words, value), before in zip(steps, [start, *(value for _, value in steps)], strict=False):
            rows.append(["", words, _stiffness(value), percent(value / before - 1)])
    columns = ["axis", "input stiffness K_in by", "value", "change"]
    return [Table(columns, rows, "From formula to FEM, one cause at a time")] if rows else []


def _variants_text(validation: StageValidation, axes: Axes) -> str:
    others, best = _others(validation), nearest(validation)
    text = (
        "Variants are solved on the two coarsest meshes; what they change there, extrapolated, is put on top of the "
        "extrapolated value, and ± holds the estimated errors of both. "
        "A coupling of 0 is one that symmetry forbids: arms on both sides draw equally."
    )
    if not others:
        return text
    named = " and ".join(f"“{label}”" for label in others)
    if best is None:
        return f"{text} None comes nearer to {named} than the stage itself: what differs is unexplained."
    return (
        f"{text} Nearest to {named} is “{best}”: how many amplifiers or guides share the load is not stated there, and "
        "this reading closes best. The residual is unexplained."
    )


def _variants(validation: StageValidation, axes: Axes) -> Table:
    columns = ["quantity", "FEM"]
    for label in validation.variants:
        columns += [label, "change"]
    rows = []
    for comparison in listed_comparisons(validation, axes):
        fem = comparison.fem
        row = [f"{axes.short(fem)}", format_quantity(fem)]
        for label in validation.variants:
            value = validation.as_in(label, fem.key)
            row += [_as(validation, label, fem.key), percent(value / fem.value - 1 if value and fem.value else None)]
        rows.append(row)
    return Table(columns, rows, "Variants")


def _unexplained(validation: StageValidation, axes: Axes) -> list[Table]:
    """Return a table for what other programs published: its deviation from FEM as in Table 1, and from a variant."""
    best, tables = nearest(validation), []
    for label in _others(validation):
        rows = []
        for comparison in (c for c in listed_comparisons(validation, axes) if label in c.analytic):
            fem, theirs = comparison.fem, comparison.analytic[label]
            row = [axes.short(fem), written(validation, label, theirs), _deviation(theirs.value, fem.value)]
            if best is not None:
                value = validation.as_in(best, fem.key)
                row += [_as(validation, best, fem.key), "–" if value is None else _deviation(theirs.value, value)]
            rows.append(row)
        columns = ["quantity", label, "deviation from FEM"]
        columns += [best, "deviation from that, unexplained"] if best is not None else []
        tables.append(Table(columns, rows, f"{label}: deviations from FEM, as in the first table"))
    return tables


def _deviation(value: float, reference: float) -> str:
    """Write how far a value is off a reference; of one that symmetry forbids there is no percentage."""
    return percent(value / reference - 1) if reference else "symmetry forbids it"


def _as(validation: StageValidation, variant: str, key: str) -> str:
    found = validation.variants[variant].get(key)
    return "–" if found is None else format_quantity(found)


def _stiffness(value: float) -> str:
    return units.to_text(value, "N/mm", 4, si="N/m")
