"""How quantities and pieces of compliance are called, and how many digits they deserve."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from flexdesign.core.model import Quantity

#: How quantities are called in tables.
NAMES = {
    "K_in": "input stiffness K_in",
    "K_out": "output stiffness K_out",
    "lambda": "amplification λ",
    "stroke": "stroke",
    "K_in_change": "change of the input stiffness",
    "lambda_change": "change of the amplification",
    "K_out_change": "change of the output stiffness",
    "blocked_force": "blocked force",
    "actuator_force": "actuator force",
    "preload_shift": "shift of the output by the preload",
    "output_force_that_unloads_the_stack": "output force that uses up the preload",
    "first_frequency": "first natural frequency",
    "drive_frequency": "frequency of the mode with the largest share of the static stroke",
    "drive_share": "share of that mode in the static stroke",
    "output_frequency": "frequency of the mode with the largest share of 1/K_out",
    "output_share": "share of that mode in 1/K_out",
    "output_mass": "modal mass at the output m_out",
    "tilt": "tilt of the output per travel",
    "coupling_x": "sideways motion in x per travel",
    "coupling_y": "sideways motion in y per travel",
    "coupling_z": "sideways motion in z per travel",
    "peak_stress": "peak von Mises stress",
    "peak_tension": "peak tension (largest principal stress)",
    "hinge_stress": "largest nominal hinge stress",
    "safety_against_yield": "safety against yield",
    "safety_against_fatigue": "safety against fatigue",
    **{f"centre_{axis}": f"centre of rotation of the output, {axis}" for axis in "xyz"},
    **{f"k_{motion}": f"stiffness of the output port k_{motion}" for motion in ("x", "y", "z", "rx", "ry", "rz")},
}
#: What a compliance's pieces are, in words; the order of tables and charts.
PIECES = {
    "hinge bending": "bending of the hinges",
    "hinge axial": "stretch of the hinges",
    "hinge shear": "shear of the hinges",
    "arm bending": "bending of the arms",
    "arm axial": "stretch of the arms",
    "arm shear": "shear of the arms",
    "rod bending": "bending of the input rods",
    "rod axial": "stretch of the input rods",
    "rod shear": "shear of the input rods",
    "roots, blocks and width": "roots, blocks and width (remainder)",
}
#: How the regions of a part are called.
REGIONS = {"hinge": "hinges", "arm": "arms", "rod": "input rods", "guide": "guides", "block": "blocks"}


#: What the names of models mean, stated where they appear first.
MODELS = {
    "PRB": "the pseudo-rigid-body model, in which hinges bend and all else is rigid",
    "rigid-body model": "flexures are beams and all else is rigid",
}


def flat(value: Any) -> str:
    """Write an input that is a table or a list in one line, without what is not set.

    >>> flat({"levels": 3, "accuracy": None, "contact_stiffness": "inf N/um", "voltage_range": ["0 V", "150 V"]})
    'levels 3, contact_stiffness infinite, voltage_range 0 V to 150 V'
    """
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {flat(item)}" for key, item in value.items() if item not in (None, ""))
    if isinstance(value, (list, tuple)):
        is_range = len(value) == 2 and all(str(each).lstrip("+-")[:1].isdigit() for each in value)
        return (" to " if is_range else ", ").join(map(flat, value))
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}" if math.isfinite(value) else "infinite"
    text = str(value)
    return "infinite" if text.startswith("inf ") else text


def name_of(quantity: Quantity) -> str:
    """Return what a quantity is called in tables."""
    return NAMES.get(quantity.name, quantity.name.replace("_", " "))


def format_quantity(quantity: Quantity) -> str:
    """Write a FEM quantity; exact zeros as such."""
    if quantity.value == 0:
        return "0 (by symmetry)"
    return quantity.formatted()


def cycles(number: float) -> str:
    """Write a number of cycles.

    >>> cycles(5e8), cycles(1e7)
    ('5 x 10^8', '10^7')
    """
    power = math.floor(math.log10(number) + 1e-9)
    leading = number / 10**power
    return f"10^{power}" if math.isclose(leading, 1.0) else f"{leading:.3g} x 10^{power}"
