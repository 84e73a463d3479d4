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
from flexdesign.workflows.sweeps.results import as_named, key_of
from flexdesign.workflows.sweeps.sampling import Case


def document(found: Optimum) -> Document:
    """Write the report."""
    return Document(title(found), summary(found), partial(_sections, found))


def _sections(found: Optimum) -> list[Section]:
    pictures, missing = design_pictures.draw(
        {_words(found): evaluators.version_of(found.plan, Case(found.last.values))}
    )
    sections = [
        Section("The optimum", missing, [optimum(found)], pictures),
        Section("What it gives", [_who(found)], [_quantities(found), *_other_quantities(found)]),
    ]
    if len(found.rounds) > 1:
        text = "Each round optimises the formulas times what finite elements found over them in the round before."
        sections.append(Section("How formulas and finite elements came to agree", [text], [_rounds(found)]))
    return sections


def title(found: Optimum) -> str:
    """Return what the file calls the search, or what was optimised."""
    return found.plan.title or f"{found.plan.design.title}, optimised"


def summary(found: Optimum) -> list[str]:
    """Say what the optimum is and whether it keeps its limits."""
    aim, (same, searches) = found.plan.aims[0], found.converged_searches
    best = _shown(found.found, aim.quantity)
    text = f"The {aim} is {best}: {_words(found)}."
    if found.broken:
        broken = " and ".join(map(str, found.broken))
        text = f"Nothing was found that keeps all limits; the nearest breaks {broken}. {text}"
    elif found.plan.limits:
        text += f" It keeps {' and '.join(map(str, found.plan.limits))}."
    agreement = f"{same} of {searches} searches ended there; {_who(found)}"
    return [text, *_inaccurate(found), *_ends(found), *_like(found), agreement]


def _inaccurate(found: Optimum) -> list[str]:
    """Say that finite elements do not reach the accuracy that was asked of them."""
    elements = found.last.elements
    if not elements:
        return []
    sentences = accuracy_text.not_reached(found.plan.mesh.accuracy, list(elements.values()), "at the optimum")
    return [sentences] if sentences else []


def _who(found: Optimum) -> str:
    if found.last.elements is None:
        return "the numbers are those of the formulas, and unchecked."
    return f"finite elements checked it in {len(found.rounds)} {'round' if len(found.rounds) == 1 else 'rounds'}."


def optimum(found: Optimum) -> Table:
    """Return what varied, at the optimum, and between which limits."""
    rows = []
    for factor in found.plan.factors:
        low, high = (factor.formatted(end) for end in factor.ends) if factor.ends else ("", "")
        end = found.end_of(factor)
        between = f"{low} to {high}" if factor.ends else ", ".join(factor.formatted(value) for value in factor.values)
        rows.append([factor.key, _given(found, factor.key), between, f"at its {end} limit" if end else ""])
    return Table(["what varied", "optimum", "searched", ""], rows)


def _given(found: Optimum, key: str) -> str:
    factor = next(factor for factor in found.plan.factors if factor.key == key)
    return factor.formatted(found.last.values[key])


def _ends(found: Optimum) -> list[str]:
    """Say what stands at the limit of its range, where a wider one would do better."""
    at_end = [factor for factor in found.plan.factors if found.end_of(factor)]
    notes = [
        f"{factor.key.rpartition('.')[2]} at its {found.end_of(factor)} limit, {_given(found, factor.key)}"
        for factor in at_end
    ]
    if not notes:
        return []
    return [f"The search ended with {', and with '.join(notes)}: a wider range may give a better design."]


def _like(found: Optimum) -> list[str]:
    """Say what stress, safety and frequency the optimum has."""
    if not found.further:
        return []
    return [f"At the optimum: {', '.join(f'{_name(q)} {q.formatted()}' for q in found.further)}."]


def _name(quantity: Quantity) -> str:
    name = quantity.name.replace("_", " ")
    return f"{name} ({quantity.boundary})" if quantity.boundary else name


def _other_quantities(found: Optimum) -> list[Table]:
    rows = [[quantity.name, quantity.boundary, quantity.formatted()] for quantity in found.further]
    return [Table(["stress, safety, frequency", "holds", "finite elements"], rows)] if rows else []


def _quantities(found: Optimum) -> Table:
    last = found.last
    rows = []
    for key, quantity in last.formulas.items():
        fem = last.elements.get(key) if last.elements else None
        off = f"{100 * (quantity.value / fem.value - 1):+.2f} %" if fem and fem.value else "–"
        rows.append(
            [f"{quantity.name} {quantity.boundary}", quantity.formatted(), fem.formatted() if fem else "–", off]
        )
    return Table(["quantity", "formulas", "finite elements", "formulas are off by"], rows)


def _rounds(found: Optimum) -> Table:
    aim = found.plan.aims[0].quantity
    named = [aim, *(limit.quantity for limit in found.plan.limits)]
    heads = ["round", *(f"{q}, {who}" for q in named for who in ("promised", "found"))]
    rows = [[str(i), *_promises(each, named)] for i, each in enumerate(found.rounds, 1)]
    return Table(heads, rows)


def _promises(each: Round, named: list[str]) -> list[str]:
    pairs = [(_shown(each.predicted, q), _shown(each.elements, q) if each.elements else "–") for q in named]
    return [text for pair in pairs for text in pair]


def _shown(found: Mapping[str, Quantity], quantity: str) -> str:
    there = found.get(key_of(quantity))
    return "–" if there is None else replace(there, value=as_named(quantity, there.value)).formatted()


def _words(found: Optimum) -> str:
    return ", ".join(f"{key.rpartition('.')[2]} {_given(found, key)}" for key in found.last.values)


def to_toml(found: Optimum, folder: Path) -> str:
    """Return the optimum as a design file for a folder."""
    plan = found.plan
    changed = [f"{key}={_given(found, key)}" for key in found.last.values]
    content = toml_files.read_toml(plan.design.file, [*plan.overrides, *changed])
    content["title"] = f"{plan.design.title}, optimised"
    content["provenance"] = f"optimised: {plan.aims[0]}; what did not vary is that of {plan.design.file.name}"
    return f"# {summary(found)[0]}\n" + designs.to_toml(plan.design, content, folder)


def result(found: Optimum) -> dict[str, Any]:
    """Return the numbers as result.json has them."""
    plan, last = found.plan, found.last
    return {
        **header("optimum"),
        "title": title(found),
        "aim": str(plan.aims[0]),
        "limits": [str(limit) for limit in plan.limits],
        "broken": [str(limit) for limit in found.broken],
        "values": {key: _given(found, key) for key in last.values},
        "formulas": [quantity.to_json() for quantity in last.formulas.values()],
        "finite_elements": [quantity.to_json() for quantity in (last.elements or {}).values()],
        "at_limits": {f.key: found.end_of(f) for f in plan.factors if found.end_of(f)},
        "further": [quantity.to_json() for quantity in found.further],
        "rounds": len(found.rounds),
        "searches": {"ended": found.converged_searches[1], "at_the_optimum": found.converged_searches[0]},
        "made_by": {
            "study": plan.file.name,
            "design": plan.design.name,
            "evaluator": plan.evaluator,
            "seed": plan.seed,
            "versions": versions.installed(mesh_refinement.LIBRARIES),
        },
    }
