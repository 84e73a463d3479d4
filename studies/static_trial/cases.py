"""Tables with something hidden in them, made without the program's own models."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexdesign.analytic.static_model import Row, StaticTable
from flexdesign.core import units
from flexdesign.design.design import Actuator, Design
from studies.error_bars.designs import SampledDesign, designs

Array = NDArray[np.float64]
#: Stiffness of the stack in the tables [N/m].
STACK = 5e7
#: What is hidden; the last two are no effects of the catalogue.
KINDS = (
    "none", "over_cut", "fillet", "modulus", "base_compliance", "contact_stiffness", "input_restraint", "output_load",
    "outside: other offset", "outside: other rod",
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A design as it is drawn, and a table of the part that was really made and measured."""

    number: int
    kind: str
    design: Design
    table: StaticTable


@cache
def references() -> Mapping[int, tuple[float, float, float, float]]:
    """Return K_in [N/m], lambda, K_out with the input free and held [N/m] of each amplifier, by hexahedra."""
    content = tomllib.loads((Path(__file__).parent / "references.toml").read_text(encoding="utf-8"))

    def stiffness(text: str) -> float:
        return units.from_text(text, "N/m")

    return {
        a["number"]: (stiffness(a["K_in"]), a["lambda"], stiffness(a["K_out"]), stiffness(a["K_out_held"]))
        for a in content["amplifier"]
    }


def case(number: int, kind: str, noise: float = 0.01) -> Case | None:
    """Return the case of a number and a kind; None where nothing of the kind can be hidden in that amplifier."""
    drawn, springs, scale = designs()[number], dict[str, float](), 1.0
    design = _with_stack(drawn)
    k_in, ratio, k_out, _ = references()[number]
    c11, c12, c22 = 1 / k_in, ratio / k_in, 1 / k_out
    changed = dict(design.dimensions)
    rng = np.random.default_rng([number, KINDS.index(kind)])
    if kind == "over_cut":  # what was solved is the true part; it was drawn thicker
        changed["hinge_thickness"] += max(0.06 * changed["hinge_thickness"], 15e-6)
    elif kind == "fillet":
        if not drawn.rounded:
            return None
        changed["fillet_radius"] = 0.0
    elif kind == "modulus":
        scale = float(rng.choice([0.9, 1.1]))
    elif kind == "base_compliance":
        springs["base"] = 0.1 * c22 + 0.3 * (c22 - c12**2 / c11)
    elif kind == "contact_stiffness":
        springs["contact"] = 0.5 * c11
    elif kind == "input_restraint":
        springs["restraint"] = 1e11
    elif kind == "output_load":
        springs["load"] = 0.3 / c22
    elif kind == "outside: other offset":
        changed["arm_offset"] *= 0.8
    elif kind == "outside: other rod":
        if not drawn.dimensions["rod_length"]:
            return None
        changed["rod_length"] *= 0.75
    table = _measure(np.array([c11, c12, c22]) / scale, springs, noise, rng)
    return Case(number, kind, replace(design, dimensions=changed), table)


def _with_stack(drawn: SampledDesign) -> Design:
    design = drawn.study(0.01, "auto").design
    return replace(design, actuator=Actuator(free_stroke="40 um", stiffness=f"{STACK / 1e6:g} N/um"))


def _measure(compliance: Array, springs: Mapping[str, float], noise: float, rng: np.random.Generator) -> StaticTable:
    """Return what is measured of a compliance (input, between, output) with springs at its ports."""
    c11, c12, c22 = compliance + np.array([0.0, 0.0, springs.get("base", 0.0)])
    load = springs.get("load", 0.0)
    pushed = load / (1 + load * c22)
    extension, travel = c11 - c12**2 * pushed, c12 - c22 * c12 * pushed
    contact, restraint = springs.get("contact", 0.0), springs.get("restraint", 0.0)
    values = {
        ("K_in", "output free"): 1 / extension,
        ("lambda", "output free"): travel / extension,
        ("K_out", "input free"): 1 / (c22 - (c12**2 / (c11 + 1 / restraint) if restraint else 0.0)),
        ("K_out", "input held"): 1 / (c22 - c12**2 / (c11 + contact)),
        ("K_out", "actuator installed"): 1 / (c22 - c12**2 / (c11 + contact + 1 / STACK)),
    }
    return StaticTable(
        "bench",
        tuple(
            Row(name, boundary, float(value * (1 + noise * rng.standard_normal())), noise * abs(float(value)), "")
            for (name, boundary), value in values.items()
        ),
    )
