"""Root and width coefficients against the planar finite elements and Ritz solutions they come from, and O'Donnell."""

from __future__ import annotations

import numpy as np
import pytest

from flexdesign.core.model import Elastic, Member, Root
from flexdesign.effects.hinge_compliance import roots, width
from studies.hinge_coefficients import planar, plate


@pytest.mark.parametrize(
    ("depth", "radius"), [(1.75, 0.0), (3.5, 0.0), (8.0, 0.0), (16.0, 0.0), (6.0, 0.25), (6.0, 1.0)]
)
def test_the_end_of_a_thicker_beam(depth, radius):
    """Between its knots; 0.1 of MM is 0.2 % of the rotation of a hinge four times as long as thick."""
    solved = planar.end(depth, radius)
    mm, mv, nn, nm = roots.coefficients(Root("end", depth), 1.0, radius)
    assert mm == pytest.approx(solved[2, 2], abs=0.07)
    assert mv == pytest.approx(solved[1, 2], abs=0.03)
    assert nn == pytest.approx(solved[0, 0], abs=0.02)
    assert nm == 0


def test_a_deep_wall_gives_way_a_little_less_than_o_donnell_reckoned():
    """16.67 / pi holds for a linear stress at the root; the leaf's own elasticity evens it out, and takes 6 %."""
    assert planar.end(40.0)[2, 2] == pytest.approx(16.67 / np.pi, rel=0.08)
    assert planar.end(40.0)[2, 2] < 16.67 / np.pi


@pytest.mark.parametrize(("depth", "overhang"), [(6.0, 1.0), (10.0, 2.0), (12.0, 1.0)])
def test_the_side_of_a_beam(depth, overhang):
    solved = planar.flank(depth, overhang, 4 * depth)
    mm, mv, nn, nm = roots.coefficients(Root("flank", depth, overhang, height=4 * depth), 1.0)
    assert mm == pytest.approx(solved[2, 2], abs=0.07)
    assert mv == pytest.approx(solved[1, 2], abs=0.3)
    assert nn == pytest.approx(solved[0, 0], abs=0.05)
    assert -nm == pytest.approx(solved[0, 2], abs=0.03)


@pytest.mark.parametrize(("depth", "overhang"), [(4.0, 1.5), (8.0, 2.0), (12.0, 3.0)])
def test_a_block_pulled_from_both_sides(depth, overhang):
    solved = planar.block(depth, overhang, 1.5 * depth)
    mm, _, nn, nm = roots.coefficients(Root("block", depth, overhang), 1.0)
    assert mm == pytest.approx(solved[1, 1], abs=0.1)
    assert nn == pytest.approx(solved[0, 0], abs=0.05)
    assert nm == pytest.approx(solved[0, 1], abs=0.03)


def test_the_height_of_a_block_hardly_matters():
    """Twice the height takes 0.07 off, which is why the height is none of the coefficients' arguments."""
    assert planar.block(8.0, 2.0, 10.0)[0, 0] == pytest.approx(planar.block(8.0, 2.0, 20.0)[0, 0], abs=0.1)


@pytest.mark.parametrize("ratio", [0.05, 0.15, 0.4, 1.0])
def test_the_relief_of_wide_plates(ratio):
    assert np.interp(ratio, width.RATIOS, width.BENDING) == pytest.approx(plate.bent(ratio), abs=0.005)
    assert np.interp(ratio, width.RATIOS, width.STRETCHING) == pytest.approx(plate.relief(ratio), abs=0.015)


def test_the_modulus_lies_between_plane_stress_and_plane_strain():
    def leaf(wide: float) -> Member:
        return Member("leaf", "hinge", ("a", "b"), (0, 0, 0), (3e-3, 0, 0), 0.3e-3, wide)

    elastic = Elastic(70e9, 0.33, constraint=1.0)
    moduli = [width.bending_modulus(leaf(wide), elastic) for wide in (0.4e-3, 2e-3, 10e-3, 1.0)]
    assert moduli == sorted(moduli)
    assert moduli[0] == pytest.approx(70e9, rel=0.01)
    assert moduli[-1] == pytest.approx(70e9 / (1 - 0.33**2), rel=0.01)
    assert width.bending_modulus(leaf(10e-3), Elastic(70e9, 0.33)) == 70e9
