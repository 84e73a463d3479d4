"""Von Mises stress of known tensors and fields."""

from __future__ import annotations

import numpy as np
import pytest

from flexdesign.fem import stress
from tests.fem.solids import CORK, Array, beam, solve

ROUNDING = 1e-12


@pytest.mark.parametrize(
    ("tensor", "expected"),
    [
        (np.diag([7.0, 0.0, 0.0]), 7.0),  # tension
        (np.diag([-7.0, 0.0, 0.0]), 7.0),  # compression
        (np.array([[0.0, 2.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), 2.0 * np.sqrt(3)),  # shear
        (5.0 * np.eye(3), 0.0),  # pressure
        (np.diag([4.0, 4.0, 0.0]), 4.0),  # equal biaxial tension
        (np.diag([3.0, 2.0, -1.0]), np.sqrt(((3 - 2) ** 2 + (2 + 1) ** 2 + (3 + 1) ** 2) / 2)),  # principal stresses
    ],
)
def test_von_mises_of_known_states(tensor: Array, expected: float) -> None:
    assert stress.von_mises(tensor) == pytest.approx(expected, rel=ROUNDING, abs=1e-12)


def test_von_mises_does_not_depend_on_axes_or_pressure() -> None:
    rng = np.random.default_rng(2)
    tensors = rng.standard_normal((20, 3, 3))
    tensors += tensors.transpose(0, 2, 1)
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    expected = stress.von_mises(tensors)
    np.testing.assert_allclose(stress.von_mises(turn @ tensors @ turn.T), expected, rtol=ROUNDING)
    np.testing.assert_allclose(stress.von_mises(tensors + 3.0 * np.eye(3)), expected, rtol=1e-11)


def test_bar_in_tension_has_the_same_stress_everywhere() -> None:
    """F/A at every vertex; the solver's residual is what deviates."""
    height, width = 2e-3, 3e-3
    solved = solve(beam(10e-3, height, width, (5, 2, 2), CORK, wobble=1e-4))
    field = solved.displacements[0][:, 0].reshape(-1, 3)
    found = stress.nodal_von_mises(solved.body, field)
    np.testing.assert_allclose(found, 1 / (height * width), rtol=1e-9)


def test_peak_of_pure_bending_lies_on_the_outermost_fibre() -> None:
    """M h / 2I, linear over the height, in the element's space (no lateral contraction)."""
    height, width = 2e-3, 3e-3
    solved = solve(beam(10e-3, height, width, (5, 2, 2), CORK))
    field = solved.displacements[0][:, 5].reshape(-1, 3)
    found = stress.nodal_von_mises(solved.body, field)
    assert found.max() == pytest.approx(6 / (width * height**2), rel=1e-9)
    assert abs(solved.body.positions[found.argmax(), 1]) == pytest.approx(height / 2, rel=1e-12)
