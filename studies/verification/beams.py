"""Cantilevers against Timoshenko, and what their clamp does.

A clamp that holds a face holds back two things: the warping of shear, whatever the material, and lateral contraction,
where there is some. Both end within some d = h / 4.2 of the clamp, the length over which self-equilibrated stresses in
a strip decay e-fold (Horgan, Recent developments concerning Saint-Venant's principle: an update, 1989). Hence the
ranges here: shear can lose, or by the uniform traction at the tip gain, what d of the beam contributes; and bending can
lose of d what a material does that cannot contract at all, 1 - (1 + nu)(1 - 2 nu) / (1 - nu) of it.
"""

from __future__ import annotations

from flexdesign.design.materials import Material
from studies.verification.elements import compliance
from studies.verification.finding import Finding, range_around
from studies.verification.solids import CORK, METAL, Array, beam

#: Height and width of the section [m], and the length over which ends are felt.
SIDE = 4e-3
DECAY = SIDE / 4.2
#: Length of the beam, and by how much another is longer, in heights.
HEIGHTS, PIECE = 6, 2
LENGTH = HEIGHTS * SIDE
#: The exact field lies in the space of quadratic elements: rounding and the solver's residual alone.
EXACT = 1e-9


def cantilevers(cells: int = 6) -> list[Finding]:
    """Bend a square cantilever by a moment and by a force, without and with lateral contraction.

    Parameters
    ----------
    cells
        Cells across the section; one less to a height along the beam.
    """
    return [*_without_contraction(cells), *_with_contraction(cells)]


def _without_contraction(cells: int) -> list[Finding]:
    matrix, unknowns = _solve(CORK, cells, HEIGHTS)
    turn, bending, shear = _timoshenko(CORK)
    problem, source = "cantilever, nu = 0", "Timoshenko, kappa = 5/6 (Cowper, 1966)"
    force = bending + shear
    return [
        Finding(
            problem, "turn under a moment", "analytic", "M L / E I", turn, float(matrix[5, 5]), "rad/(N m)",
            *range_around(turn, EXACT), unknowns, "the clamp disturbs nothing: rounding",
        ),
        Finding(
            problem, "deflection under a force", "analytic", source, force, float(matrix[1, 1]), "m/N",
            *range_around(force, shear / force * DECAY / LENGTH), unknowns,
            "warping held at the clamp, loaded at the tip",
        ),
    ]  # fmt: skip


def _with_contraction(cells: int) -> list[Finding]:
    """Measure in pure bending by how much the clamp shortens the beam, and with that foretell the deflection."""
    matrix, unknowns = _solve(METAL, cells, HEIGHTS)
    longer, _ = _solve(METAL, cells, HEIGHTS + PIECE)
    turn, bending, shear = _timoshenko(METAL)
    piece = turn * PIECE / HEIGHTS
    gained = float(longer[5, 5] - matrix[5, 5])
    lost = 1 - float(matrix[5, 5]) / turn  # of the length
    nu = METAL.poissons_ratio
    most = DECAY / LENGTH * (1 - (1 + nu) * (1 - 2 * nu) / (1 - nu))
    source = "Timoshenko, kappa = 10 (1 + nu) / (12 + 11 nu) (Cowper, 1966)"
    problem = f"cantilever, nu = {nu:g}"
    plain, foretold = bending + shear, bending * (1 - lost) ** 3 + shear
    shortening = f"{100 * lost * LENGTH / SIDE:.2f} % of its height"
    clamp = f"the clamp holds back contraction, which shortens the beam by {shortening}"
    return [
        Finding(
            problem, "turn under a moment of a piece far from the clamp", "analytic", "M L / E I", piece, gained,
            "rad/(N m)", *range_around(piece, EXACT), unknowns, "two lengths, so that the clamp drops out: rounding",
        ),
        Finding(
            problem, "turn under a moment", "bound", "M L / E I", turn, float(matrix[5, 5]), "rad/(N m)",
            (1 - most) * turn, turn, unknowns, clamp,
        ),
        Finding(
            problem, "deflection under a force", "bound", source, plain, float(matrix[1, 1]), "m/N",
            plain - 3 * most * bending - DECAY / LENGTH * shear, plain, unknowns, clamp,
        ),
        Finding(
            problem, "the same, the clamp accounted for", "analytic", source + ", L shortened as in pure bending",
            foretold, float(matrix[1, 1]), "m/N", *range_around(foretold, shear / foretold * DECAY / LENGTH), unknowns,
            "warping held at the clamp, loaded at the tip",
        ),
    ]  # fmt: skip


def _solve(material: Material, cells: int, heights: int) -> tuple[Array, int]:
    return compliance(beam(heights * SIDE, SIDE, SIDE, (heights * (cells - 1), cells, cells), material))


def _timoshenko(material: Material) -> tuple[float, float, float]:
    """Return the turn under a unit moment, and what bending and shear add to the deflection under a unit force."""
    stiffness = material.youngs_modulus * SIDE**4 / 12
    nu = material.poissons_ratio
    kappa = 10 * (1 + nu) / (12 + 11 * nu)
    shear = LENGTH / (kappa * material.shear_modulus * SIDE**2)
    return LENGTH / stiffness, LENGTH**3 / (3 * stiffness), shear
