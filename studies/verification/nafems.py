"""Benchmarks of NAFEMS: an elliptic membrane, a thick plate and a tapered membrane that vibrates.

Sources: The Standard NAFEMS Benchmarks, Rev. 3 (1990), tests LE1 and LE10; Abbassian, Dawswell and Knowles, Selected
Benchmarks for Natural Frequency Analysis, NAFEMS (1987), test FV32.
"""

from __future__ import annotations

import numpy as np

from flexdesign.design.materials import Material
from flexdesign.design.part import Port, SymmetryPlane
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.post_processing import stress
from flexdesign.fem.solving import modes, port_compliance
from flexdesign.fem.solving.solver import factorize
from flexdesign.fem.solving.statics import ClassSystem
from studies.verification import loads
from studies.verification.finding import Finding, range_around
from studies.verification.solids import Array, Bent, at, graded_intervals, lattice

STEEL = Material("steel of LE1 and LE10", 210e9, 0.3, 7800.0, None)


def quarter_ellipse(cells: tuple[int, int], height: Array) -> Bent:
    """Return the quarter between the ellipses x^2/4 + y^2 = 1 and (x/3.25)^2 + (y/2.75)^2 = 1 [m].

    Lattice: x from inner to outer ellipse, y is the eccentric angle over 90 degrees, z the height. Cells are finest at
    D = (2, 0), the end of the hole's long axis, where the stress is asked for.
    """

    def shape(place: Array) -> Array:
        across, angle, z = place[:, 0], place[:, 1] * np.pi / 2, place[:, 2]
        inner, outer = (np.stack([a * np.cos(angle), b * np.sin(angle)]) for a, b in ((2.0, 1.0), (3.25, 2.75)))
        return np.column_stack([*(inner + across * (outer - inner)), z])

    radial, around_ = cells
    across, angle = (
        graded_intervals(0.0, 1.0, radial, 12 ** (1 / radial)),
        graded_intervals(0.0, 1.0, around_, 10 ** (1 / around_)),
    )
    return Bent.of(lattice(across, angle, height), shape, STEEL)


def elliptic_membrane(cells: tuple[int, int] = (32, 48)) -> list[Finding]:
    """Return sigma_yy at D of LE1: 10 MPa pull outwards at the outer ellipse.

    Plane stress is that of a slice 10 mm thick with free faces, a fiftieth of the hole's smallest radius of curvature,
    of which the upper half is meshed. The value is the mean over the thickness, by Simpson's rule.
    """
    half = 5e-3
    bent = quarter_ellipse(cells, np.array([0.0, half]))
    free = bent.free((bent.side("y", 0.0), "y"), (bent.side("y", 1.0), "x"), (bent.side("z", 0.0), "z"))
    moved = bent.solve(free, loads.pressure(bent.body, bent.facets("x", 1.0), -10e6))
    stresses = stress.nodal(bent.body, moved)[:, 1, 1]
    low, middle, high = (stresses[bent.node(0.0, 0.0, z)] for z in (0.0, half / 2, half))
    found = float(low + 4 * middle + high) / 6e6
    return [
        Finding(
            "NAFEMS LE1, elliptic membrane", "sigma_yy at D", "benchmark", "The Standard NAFEMS Benchmarks, LE1",
            92.7, found, "MPa", *range_around(92.7, 5e-3), bent.body.n_dofs,
            "chords make up the hole, and D is one of their corners",
        )
    ]  # fmt: skip


def thick_plate(cells: tuple[int, int] = (16, 24), layers: int = 8) -> list[Finding]:
    """Return sigma_yy at D of LE10: 1 MPa on the upper face of a plate 0.6 m thick.

    The outer rim is held in the plane, and at half height also vertically. Layers are finest at the upper face.
    """
    lower = graded_intervals(-0.3, 0.0, layers // 2)
    upper = graded_intervals(0.0, 0.3, layers - layers // 2, 0.25 ** (1 / (layers - layers // 2)))
    bent = quarter_ellipse(cells, np.concatenate([lower, upper[1:]]))
    rim = bent.side("x", 1.0)
    line = np.intersect1d(rim, bent.side("z", 0.0))
    free = bent.free((bent.side("y", 0.0), "y"), (bent.side("y", 1.0), "x"), (rim, "xy"), (line, "z"))
    moved = bent.solve(free, loads.pressure(bent.body, bent.facets("z", 0.3), 1e6))
    found = float(stress.nodal(bent.body, moved)[bent.node(0.0, 0.0, 0.3), 1, 1]) / 1e6
    return [
        Finding(
            "NAFEMS LE10, thick plate", "sigma_yy at D", "benchmark", "The Standard NAFEMS Benchmarks, LE10",
            -5.38, found, "MPa", *range_around(-5.38, 0.02), bent.body.n_dofs,
            "chords as in LE1; the line that holds the rim yields more, the finer the mesh",
        )
    ]  # fmt: skip


#: Natural frequencies of FV32 [Hz].
TAPERED = (44.623, 130.03, 162.70, 246.05, 379.90, 391.44)


def tapered_membrane(along: int = 32, across: int = 16) -> list[Finding]:
    """Return the in-plane frequencies of FV32: 10 m long, 5 m wide at the clamp and 1 m at the tip, 50 mm thick.

    Plane stress is that of a slice with free faces. Symmetry at half thickness leaves the modes in the plane; the clamp
    holds the two directions in the plane and lets the thickness contract.
    """
    metal = Material("steel of FV32", 200e9, 0.3, 8000.0, None)
    axes = np.linspace(0, 10, along + 1), np.linspace(-0.5, 0.5, across + 1), np.array([0.0, 25e-3])

    def shape(place: Array) -> Array:
        x, y, z = place.T
        return np.column_stack([x, y * (5 - 0.4 * x), z])

    bent = Bent.of(lattice(*axes), shape, metal, {"output": at("x", 10.0)})
    free = bent.free((bent.side("x", 0.0), "xy"), (bent.side("z", 0.0), "z"))
    found = _frequencies(bent, free, bent.domain(SymmetryPlane("z", {})))
    return [
        Finding(
            "NAFEMS FV32, tapered membrane", f"frequency of mode {number}", "benchmark",
            "Selected Benchmarks for Natural Frequency Analysis, FV32",
            right, frequency, "Hz", *range_around(right, 1e-3), bent.body.n_dofs,
            "the corners of the clamp are singular",
        )
        for number, (right, frequency) in enumerate(zip(TAPERED, found, strict=True), start=1)
    ]  # fmt: skip


def _frequencies(bent: Bent, free: Array, domain: Domain) -> list[float]:
    """Return the lowest six frequencies [Hz] of the fields that are even in the planes of the domain."""
    body, cls = bent.body, port_compliance.classes(domain)[0]
    stiffness = body.stiffness()[free][:, free].tocsr()
    system = ClassSystem(cls, free, factorize(stiffness), stiffness, body.n_dofs)
    tip = Port("output", "output", (10.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    space = port_compliance.port_space(body, domain, (tip,))
    found = modes.class_modes(system, body.mass(), space, len(TAPERED), 0.0)
    system.factor.free()
    return [mode.frequency for mode in found]
