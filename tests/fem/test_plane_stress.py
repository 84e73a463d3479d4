"""Plane stress against closed forms: a bar, a slender beam under even load, what a traction must add up to; and halves
against wholes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from flexdesign.core.model import Linkage
from flexdesign.design import design
from flexdesign.design.materials import Material
from flexdesign.design.part import Axis, Outline, Port, SymmetryPlane
from flexdesign.fem.meshing import polygon_domain
from flexdesign.fem.meshing.planar import triangulate
from flexdesign.fem.multifidelity import Planar
from flexdesign.fem.solving.plane_stress import Plate, plane_stress
from studies.verification.solids import CORK, METAL

LENGTH, HEIGHT, WIDTH = 60e-3, 2e-3, 7e-3
GROUND = Port("ground", "ground", (0.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
END = Port("output", "output", (LENGTH, 0.0, 0.0), (1.0, 0.0, 0.0))
TOP = Port("output", "output", (LENGTH / 2, HEIGHT / 2, 0.0), (0.0, 1.0, 0.0))


@dataclass(frozen=True)
class Beam:
    """A bar along x, held at its left end."""

    output: Port
    planes: tuple[SymmetryPlane, ...] = ()

    def outline(self) -> Outline:
        corners = [(0.0, -HEIGHT / 2), (LENGTH, -HEIGHT / 2), (LENGTH, HEIGHT / 2), (0.0, HEIGHT / 2)]
        return Outline([corners], -WIDTH / 2, WIDTH / 2)

    def prismatic(self) -> Axis:
        return "z"

    def symmetry(self) -> tuple[SymmetryPlane, ...]:
        return self.planes

    def linkage(self) -> Linkage:
        return Linkage({}, ())

    def ports(self) -> tuple[Port, ...]:
        return GROUND, replace(END, name="input", role="input"), self.output


def plate(part: Any, material: Material, edge: float = 5e-4) -> Plate:
    body = polygon_domain.of_part(part)
    assert body is not None and body.section is not None
    plan = triangulate(body.section.outline, lambda points: np.full(len(points), edge), 1e-6)
    return Plate(body, plan, material)


def test_the_elastic_matrix_is_that_of_the_books() -> None:
    """D = E / (1 - nu^2) [[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]] (Timoshenko and Goodier 1970, chapter 2)."""
    young, nu = METAL.youngs_modulus, METAL.poissons_ratio
    expected = young / (1 - nu**2) * np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]])
    assert plane_stress(METAL, [0, 1, 2]) == pytest.approx(expected, rel=1e-12, abs=1e-3)


@pytest.mark.parametrize("planes", [(), (SymmetryPlane("z", {}),), (SymmetryPlane("y", {}), SymmetryPlane("z", {}))])
def test_a_bar_in_tension_is_exact(planes: tuple[SymmetryPlane, ...]) -> None:
    """Without lateral contraction the clamp disturbs nothing: u = F L / EA, whole, halved along or across the width."""
    part = Beam(END, planes)
    found = plate(part, CORK).compliance(part.ports())
    expected = LENGTH / (CORK.youngs_modulus * HEIGHT * WIDTH)
    assert (found.c22, found.c12, found.c11) == pytest.approx((expected, -expected, expected), rel=1e-9)


def test_a_beam_under_an_even_load_bends_in_plane_stress() -> None:
    """The mean deflection is L^3 / 20 EI + L / (3 kappa G A), with E and not E / (1 - nu^2), 10 % more.

    The clamp hinders warping and contraction over about a height: of the order of (h / L) times nu^2, and of the share
    of shear, both below 3e-3.
    """
    part = Beam(TOP)
    found = plate(part, METAL).compliance(part.ports()).c22
    inertia, area = WIDTH * HEIGHT**3 / 12, WIDTH * HEIGHT
    shear = LENGTH / (3 * 5 / 6 * METAL.shear_modulus * area)
    assert found == pytest.approx(LENGTH**3 / (20 * METAL.youngs_modulus * inertia) + shear, rel=3e-3)


@pytest.mark.parametrize("place", [LENGTH / 2, LENGTH / 3])
def test_tractions_add_up_to_the_force_at_the_port(place: float) -> None:
    port = replace(TOP, point=(place, HEIGHT / 2, 0.0))
    given = plate(Beam(port), METAL)
    forces, nodes = given.load(port), given.nodes_on(given.domain.ports["output"])
    ends = given.plan.points[nodes[:, :2]]
    places = {int(n): x for n, x in zip(nodes[:, :2].ravel(), ends.reshape(-1, 2), strict=True)}
    places |= {int(n): x for n, x in zip(nodes[:, 2], ends.mean(axis=1), strict=True)}
    pushes = np.array([forces[given.dofs[n]] for n in places])
    arms = np.array(list(places.values())) - np.array(port.point)[:2]
    assert pushes.sum(axis=0) == pytest.approx([0.0, 1.0], abs=1e-12)
    moment = (arms[:, 0] * pushes[:, 1] - arms[:, 1] * pushes[:, 0]).sum()
    assert moment == pytest.approx(0.0, abs=1e-12 * LENGTH)
    assert forces.sum() == pytest.approx(1.0)  # and nothing elsewhere


def test_half_an_amplifier_answers_as_the_whole() -> None:
    """Two meshes of one part: they differ by what they leave open, 0.4 % in K_in on these."""
    read = design.read(design.find("bridge_amplifier"))

    class Whole(read.part_class):  # type: ignore[misc, name-defined]
        def symmetry(self) -> Sequence[SymmetryPlane]:
            return ()

    answers = [
        {q.key: q.value for q in Planar(coarseness=1.0).evaluate(given)}
        for given in (read, replace(read, part_class=Whole))
    ]
    for key, value in answers[0].items():
        assert answers[1][key] == pytest.approx(value, rel=5e-3), key
