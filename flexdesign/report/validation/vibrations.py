"""The section on natural frequencies: what single modes carry, and their pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from flexdesign.core import units
from flexdesign.core.serialise import with_unit
from flexdesign.fem import quantities
from flexdesign.fem.analysis import ModeRecord
from flexdesign.report.document import Figure, Section, Table
from flexdesign.report.wording import format_quantity, name_of
from flexdesign.workflows.validation import Validation

#: Number of modes listed, without the actuator and with it; the one that carries most of 1/K_out besides.
LISTED = 6
#: Columns of a design with an actuator.
DRIVEN = ("actuator", "share of static stroke")
#: The quantities that are extrapolated.
LIMITS = ("first_frequency", "output_frequency", "output_mass", "output_share")


def section(validation: Validation, figures: Sequence[Figure]) -> Section:
    """Return the section, with pictures of modes where there are any."""
    facts, is_driven = validation.modal.solution.facts, validation.study.design.actuator is not None
    held = "Ground held. "
    of_mass = (
        f"The mass in x, y or z is the effective modal mass for a base motion that way, relative to the part's "
        f"{units.to_text(facts['mass'], 'g', si='kg')}; all modes together make 100 %. A dash means zero."
    )
    if is_driven:
        held += (
            "The actuator is a spring between the input blocks that holds nothing sideways, and has no mass here: the "
            "frequencies are upper bounds for modes that move the input blocks. "
        )
        of_mass = (
            "A mode's share of the static stroke is its part of the output's motion under a constant voltage, by mode "
            "superposition. It is negative where the mode moves the output the other way; all modes together make "
            f"100 %. {of_mass}"
        )
    on_mesh = f"The second table lists single modes on one mesh ({facts['unknowns']} unknowns), before extrapolation."
    text = [held + on_mesh, of_mass]
    if figures:
        text.append(
            "Colours run from rest (dark) to the largest motion (bright); the drawn size of a mode has no meaning."
        )
    extrapolated = [*(comparison.fem for comparison in validation.comparisons), *validation.further]
    limits = [[name_of(q), q.boundary, format_quantity(q)] for q in extrapolated if q.name in LIMITS]
    heads = ["frequency", "actuator", "symmetry", "share of 1/K_out", "share of static stroke"]
    rows = [[*heads, *(f"mass in {axis}" for axis in "xyz")], *_rows(validation)]
    if not is_driven:
        rows = [[cell for cell, head in zip(row, rows[0], strict=True) if head not in DRIVEN] for row in rows]
    tables = [Table(["quantity", "boundary", "FEM"], limits), Table(rows[0], rows[1:])]
    return Section("Natural frequencies", text, tables, figures, gallery=True)


def _rows(validation: Validation) -> list[list[str]]:
    solution, actuator = validation.modal.solution, validation.study.design.actuator
    spring = actuator.installed_stiffness if actuator else 0.0
    rows = []
    for installed, state in ((False, "no"), (True, "yes")):
        modes = [m for m in solution.modes if m.installed == installed]
        shares = [quantities.output_share(mode, solution.compliance, spring) for mode in modes]
        main = shares.index(max(shares)) if shares else 0
        for mode, share in [pair for n, pair in enumerate(zip(modes, shares, strict=True)) if n < LISTED or n == main]:
            driven = quantities.drive_share(mode, solution.compliance, spring) if installed else 0.0
            participating = f"{100 * share:.0f} %" if share > 0 else "–"
            answer = f"{round(100 * driven)} %" if installed and share > 0 else "–"
            masses = [100 * mass / solution.facts["mass"] for mass in mode.effective_mass]
            mass_text = [f"{mass:.1f} %" if mass >= 0.05 else "–" for mass in masses]
            rows.append(
                [
                    f"{units.significant(mode.frequency, 4)} Hz",
                    state,
                    symmetry(mode.symmetry),
                    participating,
                    answer,
                    *mass_text,
                ]
            )
    return rows


def symmetry(name: str) -> str:
    """Return the symmetry of a mode in words.

    >>> symmetry("odd in x, even in z"), symmetry("whole part")
    ('antisymmetric about the plane x = 0, symmetric about z = 0', 'no symmetry')
    """
    words = []
    for each in name.split(", "):
        kind, is_in, axis = each.partition(" in ")
        if not is_in:
            return "no symmetry"
        words.append(f"{'symmetric' if kind == 'even' else 'antisymmetric'} about {axis} = 0")
    return ", ".join(words).replace("about ", "about the plane ", 1)


def result(mode: ModeRecord) -> dict[str, Any]:
    """Return a mode as result.json holds it."""
    return {
        "frequency": with_unit(mode.frequency, "Hz"),
        "output_mass": with_unit(mode.output_mass if math.isfinite(mode.output_mass) else None, "kg"),
        "effective_mass": {**dict(zip("xyz", mode.effective_mass, strict=True)), "unit": "kg"},
        "symmetry": mode.symmetry,
        "actuator_installed": mode.installed,
    }
