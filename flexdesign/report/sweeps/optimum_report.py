"""The report of an optimisation: the optimum, what formulas and finite elements say of it, how both came to agree."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from flexdesign.core import toml_files, versions
from flexdesign.core.model import Quantity
from flexdesign.core.serialise import header
from flexdesign.design import design as designs
from flexdesign.fem import mesh_refinement
from flexdesign.report import accuracy_text
from flexdesign.report.document import Document, Section, Table
from flexdesign.report.validation import design_pictures
from flexdesign.workflows.sweeps import evaluators
from flexdesign.workflows.sweeps.optimising import Optimum, Round
from flexdesign.workflows.sweeps.results import key_of, value_by_name
from flexdesign.workflows.sweeps.sampling import Case


def document(optimum: Optimum) -> Document:
    """Write the report."""
    return Document(title(optimum), summary(optimum), partial(_sections, optimum))


def _sections(found: Optimum) -> list[Section]:
    pictures, missing = design_pictures.draw(
        {_factors_text(found): evaluators.version_of(found.plan, Case(found.last.values))}
    )
    sections = [
        Section("The optimum", missing, [optimum(found)], pictures),
        Section("What it gives", [_who(found)], [_quantities(found), *_other_quantities(found)]),
    ]
    if len(found.rounds) > 1:
        text = "Each round optimises the formulas times what finite elements found over them in the round before."
        sections.append(Section("How formulas and finite elements came to agree", [text], [_rounds(found)]))
    return sections


def title(optimum: Optimum) -> str:
    """Return what the file calls the search, or what was optimised."""
    return optimum.plan.title or f"{optimum.plan.design.title}, optimised"


def summary(optimum: Optimum) -> list[str]:
    """Say what the optimum is and whether it keeps its limits."""
    aim, (same, searches) = optimum.plan.aims[0], optimum.converged_searches
    best = _quantity_text(optimum.found, aim.quantity)
    text = f"The {aim} is {best}: {_factors_text(optimum)}."
    if optimum.broken:
        broken = " and ".join(map(str, optimum.broken))
        text = f"Nothing was found that keeps all limits; the nearest breaks {broken}. {text}"
    elif optimum.plan.limits:
        text += f" It keeps {' and '.join(map(str, optimum.plan.limits))}."
    agreement = f"{same} of {searches} searches ended there. {_who(optimum)}"
    return [text, *_inaccurate(optimum), *_ends(optimum), *_like(optimum), agreement]


def _inaccurate(optimum: Optimum) -> list[str]:
    """Say that finite elements do not reach the accuracy that was asked of them."""
    elements = optimum.last.elements
    if not elements:
        return []
    sentences = accuracy_text.not_reached(optimum.plan.mesh.accuracy, list(elements.values()), "at the optimum")
    return [sentences] if sentences else []


def _who(optimum: Optimum) -> str:
    if optimum.last.elements is None:
        return "The numbers are those of the formulas, and unchecked."
    return f"Finite elements checked it in {len(optimum.rounds)} {'round' if len(optimum.rounds) == 1 else 'rounds'}."


def optimum(optimum: Optimum) -> Table:
    """Return what varied, at the optimum, and between which limits."""
    rows = []
    for factor in optimum.plan.factors:
        low, high = (factor.formatted(end) for end in factor.ends) if factor.ends else ("", "")
        end = optimum.end_of(factor)
        between = f"{low} to {high}" if factor.ends else ", ".join(factor.formatted(value) for value in factor.values)
        rows.append([factor.key, _factor_text(optimum, factor.key), between, f"at its {end} limit" if end else ""])
    return Table(["what varied", "optimum", "searched", ""], rows)


def _factor_text(optimum: Optimum, key: str) -> str:
    factor = next(factor for factor in optimum.plan.factors if factor.key == key)
    return factor.formatted(optimum.last.values[key])


def _ends(optimum: Optimum) -> list[str]:
    """Say what stands at the limit of its range, where a wider one would do better."""
    at_end = [factor for factor in optimum.plan.factors if optimum.end_of(factor)]
    notes = [
        f"{factor.key.rpartition('.')[2]} at its {optimum.end_of(factor)} limit, {_factor_text(optimum, factor.key)}"
        for factor in at_end
    ]
    if not notes:
        return []
    return [f"The search ended with {', and with '.join(notes)}: a wider range may give a better design."]


def _like(optimum: Optimum) -> list[str]:
    """Say what stress, safety and frequency the optimum has."""
    if not optimum.further:
        return []
    return [f"At the optimum: {', '.join(f'{_name(q)} {q.formatted()}' for q in optimum.further)}."]


def _name(quantity: Quantity) -> str:
    name = quantity.name.replace("_", " ")
    return f"{name} ({quantity.boundary})" if quantity.boundary else name


def _other_quantities(optimum: Optimum) -> list[Table]:
    rows = [[quantity.name, quantity.boundary, quantity.formatted()] for quantity in optimum.further]
    return [Table(["stress, safety, frequency", "holds", "finite elements"], rows)] if rows else []


def _quantities(optimum: Optimum) -> Table:
    last = optimum.last
    rows = []
    for key, quantity in last.formulas.items():
        fem = last.elements.get(key) if last.elements else None
        off = f"{100 * (quantity.value / fem.value - 1):+.2f} %" if fem and fem.value else "–"
        rows.append(
            [f"{quantity.name} {quantity.boundary}", quantity.formatted(), fem.formatted() if fem else "–", off]
        )
    return Table(["quantity", "formulas", "finite elements", "formulas are off by"], rows)


def _rounds(optimum: Optimum) -> Table:
    aim = optimum.plan.aims[0].quantity
    named = [aim, *(limit.quantity for limit in optimum.plan.limits)]
    heads = ["round", *(f"{q}, {who}" for q in named for who in ("promised", "found"))]
    rows = [[str(i), *_promises(each, named)] for i, each in enumerate(optimum.rounds, 1)]
    return Table(heads, rows)


def _promises(each: Round, named: list[str]) -> list[str]:
    pairs = [
        (_quantity_text(each.predicted, q), _quantity_text(each.elements, q) if each.elements else "–") for q in named
    ]
    return [text for pair in pairs for text in pair]


def _quantity_text(found: Mapping[str, Quantity], quantity: str) -> str:
    there = found.get(key_of(quantity))
    return "–" if there is None else replace(there, value=value_by_name(quantity, there.value)).formatted()


def _factors_text(optimum: Optimum) -> str:
    return ", ".join(f"{key.rpartition('.')[2]} {_factor_text(optimum, key)}" for key in optimum.last.values)


def to_toml(optimum: Optimum, folder: Path) -> str:
    """Return the optimum as a design file for a folder."""
    plan = optimum.plan
    changed = [f"{key}={_factor_text(optimum, key)}" for key in optimum.last.values]
    content = toml_files.read_toml(plan.design.file, [*plan.overrides, *changed])
    content["title"] = f"{plan.design.title}, optimised"
    content["provenance"] = f"optimised: {plan.aims[0]}; what did not vary is that of {plan.design.file.name}"
    return f"# {summary(optimum)[0]}\n" + designs.to_toml(plan.design, content, folder)


def result(optimum: Optimum) -> dict[str, Any]:
    """Return the numbers as result.json has them."""
    plan, last = optimum.plan, optimum.last
    return {
        **header("optimum"),
        "title": title(optimum),
        "aim": str(plan.aims[0]),
        "limits": [str(limit) for limit in plan.limits],
        "broken": [str(limit) for limit in optimum.broken],
        "values": {key: _factor_text(optimum, key) for key in last.values},
        "formulas": [quantity.to_json() for quantity in last.formulas.values()],
        "finite_elements": [quantity.to_json() for quantity in (last.elements or {}).values()],
        "at_limits": {f.key: optimum.end_of(f) for f in plan.factors if optimum.end_of(f)},
        "further": [quantity.to_json() for quantity in optimum.further],
        "rounds": len(optimum.rounds),
        "searches": {"ended": optimum.converged_searches[1], "at_the_optimum": optimum.converged_searches[0]},
        "made_by": {
            "study": plan.file.name,
            "design": plan.design.name,
            "evaluator": plan.evaluator,
            "seed": plan.seed,
            "versions": versions.installed(mesh_refinement.LIBRARIES),
        },
    }
