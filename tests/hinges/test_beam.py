"""Members as beams against closed forms and a numerical integral."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from flexdesign.core.model import Elastic, Member
from flexdesign.effects.hinge_compliance import beam

ELASTIC = Elastic(70e9, 0.33)
W, T, L = 10e-3, 0.5e-3, 3e-3
LEAF = Member("leaf", "hinge", ("a", "b"), (0.0, 0.0, 0.0), (L, 0.0, 0.0), T, W)


def test_a_leaf_in_plane_stress():
    inertia = W * T**3 / 12
    assert beam.stretch(LEAF, ELASTIC) == pytest.approx(L / (70e9 * W * T), rel=1e-12)
    assert beam.rotation(LEAF, ELASTIC) == pytest.approx(L / (70e9 * inertia), rel=1e-12)
    assert beam.sway(LEAF, ELASTIC) == pytest.approx(L**3 / (12 * 70e9 * inertia), rel=1e-12)
    assert beam.shear(LEAF, ELASTIC) == pytest.approx(1.2 * L / (ELASTIC.shear_modulus * W * T), rel=1e-12)


def test_a_circular_notch_is_the_integral_over_its_profile():
    """R 2 mm, t 0.5 mm, b 10 mm, E 71 GPa: 6486.3 N mm/rad by Euler and Bernoulli."""
    notch = Member("notch", "hinge", ("a", "b"), (0, 0, 0), (4e-3, 0, 0), 0.5e-3, 10e-3, curvature_radius=2e-3)
    stiffness = 1 / beam.rotation(notch, Elastic(71e9, 0.33))
    integral, _ = quad(lambda s: 12 / (71e9 * 10e-3 * notch.thickness_at(s) ** 3), -2e-3, 2e-3, points=[0.0])
    assert stiffness == pytest.approx(1 / integral, rel=1e-5)
    assert stiffness == pytest.approx(6.4863, rel=1e-4)


def test_a_fillet_stiffens_as_its_profile_does():
    rounded = Member("leaf", "hinge", ("a", "b"), (0.0, 0.0, 0.0), (L, 0.0, 0.0), T, W, root_radius=0.3e-3)
    for moment, found in ((0, beam.rotation), (2, beam.sway)):

        def integrand(s: float, moment: int = moment) -> float:
            return 12 * s**moment / (70e9 * W * rounded.thickness_at(s) ** 3)

        integral, _ = quad(integrand, -L / 2, L / 2, points=[-L / 2 + 0.3e-3, L / 2 - 0.3e-3])
        assert found(rounded, ELASTIC) == pytest.approx(integral, rel=1e-4)


def test_a_force_elsewhere_is_a_force_and_a_moment_at_the_centre():
    """A hinge that turns by M / k at one end lets the other end move by F l^2 / k."""
    turning = np.diag([0.0, 0.0, 1 / 5.0])
    at_centre = beam.from_place(turning, -L / 2)
    at_other_end = np.array([0.0, 1.0, 0.0]) + np.array([0.0, 0.0, L / 2])  # V there, as V and M at the centre
    motion = at_centre @ at_other_end
    assert motion[2] == pytest.approx(L / 5.0)
    assert motion[1] + L / 2 * motion[2] == pytest.approx(L**2 / 5.0)


def test_an_evenly_pressed_block_is_a_beam_under_even_load():
    """Under a load q per length the supports of a beam of length 2l lie 2 q l^4 / 15 EI from its mean deflection."""
    block = Member("block", "block", ("end", "middle"), (0, 6e-3, 0), (0, 0, 0), 5e-3, W)
    length, bending = 6e-3, 70e9 * W * (5e-3) ** 3 / 12
    stiff_in_shear = Elastic(70e9, -1 + 1e-12)
    found = beam.evenly_loaded(block, stiff_in_shear)
    at_end = found[1, 1] - length * found[1, 2] + length**2 / 4 * found[2, 2]  # V at the end: V and M = -V l / 2
    y = np.linspace(0, length, 4001)  # from the middle: deflection of the simply supported beam, q = 1 / l
    shape = (5 * length**4 - 6 * length**2 * y**2 + y**4) / (24 * bending * length)
    mean = float(np.trapezoid(shape, y) / length)
    assert mean == pytest.approx(2 * length**3 / (15 * bending), rel=1e-6)
    assert at_end == pytest.approx(mean, rel=1e-6)
    assert math.isclose(found[2, 2], length / bending)
