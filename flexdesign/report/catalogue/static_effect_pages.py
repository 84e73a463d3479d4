"""Pages of the static effects: what each changes of a design's stiffnesses and amplification."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from flexdesign.analytic.static_model import StaticModel, of_design
from flexdesign.core import units
from flexdesign.core.model import Effect
from flexdesign.core.serialise import header
from flexdesign.design.design import Design
from flexdesign.effects import statics
from flexdesign.report import charts
from flexdesign.report.catalogue import effect_pages
from flexdesign.report.document import Document, Figure, Section, Table

Changes = Mapping[str, float]


def changes(name: str, design: Design) -> dict[str, float]:
    """Return by how much an effect at its start changes each quantity of a design, relative.

    What the design has anyhow by its drawing is compared with the design without it.
    """
    model, effect = of_design(design), statics.find(name)
    rest = {key: values for key, values in model.effects.items() if key != name}
    without = StaticModel(design, rest).compliance({}).quantities()
    with_it = StaticModel(design, {**rest, name: strength(effect)}).compliance({}).quantities()
    return {key: with_it[key].value / q.value - 1 for key, q in without.items() if key in with_it}


def strength(effect: Effect) -> dict[str, float]:
    """Return the values at which an effect is shown, SI: where a fit begins."""
    return {p.name: float(p.start) for p in effect.parameters if p.start is not None}


def document(name: str, design: Design) -> Document:
    """Write the page of one static effect."""
    effect, found = statics.find(name), changes(name, design)
    at = ", ".join(
        f"{p.name} = {units.to_text(strength(effect)[p.name], p.unit, 3, p.si) if p.unit else strength(effect)[p.name]}"
        for p in effect.parameters
    )
    rows = [[key.replace("_", " "), f"{100 * change:+.2f} %"] for key, change in found.items()]
    figure = Figure("signature.svg", _draw(found), f"What it changes of {design.title}, at {at}")
    sections = [
        Section("Signature", [f"Shown on {design.title}, at {at}."], [Table(["quantity", "change"], rows)], [figure]),
        *effect_pages.stated(effect),
    ]
    return Document(effect.name, [effect.physics, f"Where it acts: {effect.where}."], sections)


def result(name: str, design: Design) -> dict[str, Any]:
    """Return the page as result.json has it."""
    return {
        **header("effect"),
        **effect_pages.description(statics.find(name)),
        "signature": {"design": design.name, "relative_changes": changes(name, design)},
        "made_by": effect_pages.provenance(),
    }


def _draw(found: Changes) -> bytes:
    labels = [key.replace("_", " ") for key in found]
    figure, axes = charts.drawing(charts.NARROW, 0.42 * len(labels) + 1.0)
    values = 100 * np.array(list(found.values()))
    axes.barh(range(len(labels)), values, color=charts.COLOURS[0], height=0.6)
    axes.axvline(0, color=charts.NEUTRAL, linewidth=1)
    axes.set_yticks(range(len(labels)), labels)
    axes.invert_yaxis()
    axes.set_xlabel("change [%]")
    return charts.svg(figure)
