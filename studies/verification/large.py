"""Large displacements: the elastica, and a table on two parallel leaf springs."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from flexdesign.design.part import Port, SymmetryPlane
from flexdesign.fem.meshing.mesh import mirror_mesh
from flexdesign.fem.solving import port_compliance, statics
from flexdesign.fem.solving.load_path import Equilibrium, load_path
from studies.verification.finding import Finding, range_around
from studies.verification.solids import CORK, Array, Solid, at, beam, hold_ground, lattice, weld_points


def elastica(alpha: float) -> tuple[float, float]:
    """Return tip displacements over length, along and across, of an inextensible cantilever; alpha = P L^2 / E I.

    Bisshopp and Drucker, Large deflection of cantilever beams, Quarterly of Applied Mathematics 3 (1945), 272-275, with
    the slope a of the tip, p^2 = (1 + sin a) / 2 and sin t = 1 / (p sqrt 2):

        sqrt(alpha) = K(p) - F(t, p),
        across = 1 - 2 (E(p) - E(t, p)) / sqrt(alpha),   along = sqrt(2 sin a / alpha) - 1.

    >>> [round(motion, 5) for motion in elastica(1.0)]
    [-0.05643, 0.30172]
    """

    def modulus(slope: float) -> tuple[float, float]:
        p = np.sqrt((1 + np.sin(slope)) / 2)
        return p**2, np.arcsin(1 / (p * np.sqrt(2)))

    def gap(slope: float) -> float:
        m, t = modulus(slope)
        return float(ellipk(m) - ellipkinc(t, m) - np.sqrt(alpha))

    slope = brentq(gap, 1e-9, np.pi / 2 - 1e-9)
    m, t = modulus(slope)
    across = 1 - 2 * (ellipe(m) - ellipeinc(t, m)) / np.sqrt(alpha)
    return float(np.sqrt(2 * np.sin(slope) / alpha) - 1), float(across)


def bent_cantilever(cells: int = 60, alpha: float = 2.0) -> list[Finding]:
    """Bend a cantilever of 1:100 by P L^2 / E I = 2, in four steps: the tip moves by half its length.

    Shear adds 6e-5 of the deflection, 3 E I / (kappa G A L^2); the elements take away less.
    """
    length, side = 100e-3, 1e-3
    solid = beam(length, side, side, (cells, 1, 1), CORK)
    body = solid.body
    load = port_compliance.port_space(body, solid.domain, solid.ports).loads["output"][:, [1]]
    force = alpha * CORK.youngs_modulus * side**4 / 12 / length**2
    *_, end = load_path(hold_ground(solid), load, [force * k / 4 for k in (1, 2, 3, 4)])
    tip = end.displacement.reshape(-1, 3)[np.isclose(body.positions[:, 0], length)].mean(axis=0) / length
    source = "Bisshopp and Drucker (1945), elliptic integrals"
    along, across = elastica(alpha)
    return [
        Finding(
            "elastica, P L^2 / E I = 2", f"motion of the tip {name} the beam over its length", "analytic", source,
            right, float(found), "1", *range_around(right, 5e-4), body.n_dofs,
            "shear and the elements, 1e-4 each at most; the shortening goes with the square",
        )
        for name, right, found in (("along", along, tip[0]), ("across", across, tip[1]))
    ]  # fmt: skip


#: The parallelogram: length, thickness and width of the leaves, length of the table [m].
LEAF, THICKNESS, WIDTH, TABLE = 40e-3, 0.4e-3, 2e-3, 10e-3


def parallelogram() -> Solid:
    """Return a table on two parallel leaf springs along x, 24 mm apart; elements are mirror images in y = 0."""
    x = np.concatenate([np.linspace(0, LEAF, 25), [LEAF + TABLE]])
    y = np.array([0.0, 4e-3, 12e-3, 12e-3 + THICKNESS])
    half = lattice(x, y, np.array([0.0, WIDTH]), lambda c: (c[:, 1] > 12e-3) | (c[:, 0] > LEAF))
    points, tets, _ = mirror_mesh(*half, (SymmetryPlane("y", {}),), {})
    ends = (
        Port("output", "output", (LEAF + TABLE, 0.0, WIDTH / 2), (1.0, 0.0, 0.0)),
        Port("ground", "ground", (0.0, 0.0, WIDTH / 2), (-1.0, 0.0, 0.0)),
    )
    patches = {"output": at("x", LEAF + TABLE), "ground": at("x", 0.0)}
    return Solid.of(weld_points(points, tets), patches, ends, (), CORK)


def parasitic_motion(shifts: tuple[float, ...] = (1e-3, 2e-3)) -> list[Finding]:
    """Push the parallelogram sideways: it shortens by 3/5 of the square over the length; linearly it does not.

    Parameters
    ----------
    shifts
        About how far it is pushed [m].
    """
    solid = parallelogram()
    body = solid.body
    load = port_compliance.port_space(body, solid.domain, solid.ports).loads["output"][:, [1]]
    stiffness = 24 * CORK.youngs_modulus * WIDTH * THICKNESS**3 / 12 / LEAF**3
    table = np.isclose(body.positions[:, 0], LEAF + TABLE)

    def coefficient(displacement: Array) -> float:
        shift = displacement.reshape(-1, 3)[table].mean(axis=0)
        return float(-shift[0] * LEAF / shift[1] ** 2)

    model = hold_ground(solid)
    path: list[Equilibrium] = list(load_path(model, load, [stiffness * shift for shift in shifts]))
    system = statics.class_system(
        body, solid.domain, port_compliance.classes(solid.domain)[0], body.stiffness(), [solid.domain.ports["ground"]]
    )
    linear = coefficient(system.solve(load * stiffness * shifts[-1]))
    system.factor.free()
    source = "Jones, Instruments and Experiences (1988): u_x = -(3/5) u_y^2 / L"
    problem = "leaf-spring parallelogram"
    rows = [
        Finding(
            problem, f"shortening times L over the square of {1e3 * shift:g} mm", "analytic", source, 0.6,
            coefficient(point.displacement), "1", *range_around(0.6, 0.01), body.n_dofs,
            "stretch of the leaves and higher orders of the shift",
        )
        for shift, point in zip(shifts, path, strict=True)
    ]  # fmt: skip
    nothing = Finding(
        problem, f"the same of the linear solution at {1e3 * shifts[-1]:g} mm", "analytic",
        "no second order in a linear theory", 0.0, abs(linear), "1", 0.0, 1e-8, body.n_dofs, "rounding",
    )  # fmt: skip
    return [*rows, nothing]
