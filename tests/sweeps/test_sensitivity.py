"""Sobol's indices beside those that are known in closed form."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("SALib")

from flexdesign.workflows.sweeps import sensitivity


def test_indices_of_ishigamis_function_are_those_of_its_closed_form() -> None:
    """Ishigami and Homma (1990): sin a + 7 sin^2 b + 0.1 c^4 sin a on [-pi, pi]; variances by integration."""
    unit = sensitivity.points(3, 4096, 1)
    a, b, c = (2 * math.pi * unit - math.pi).T
    found = sensitivity.indices(np.sin(a) + 7 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a), 3, 1)
    assert found is not None
    v_a = 0.5 * (1 + 0.1 * math.pi**4 / 5) ** 2
    v_b, v_ac = 49 / 8, 0.01 * math.pi**8 * (1 / 18 - 1 / 50)
    total = v_a + v_b + v_ac
    assert found.first == pytest.approx(np.array([v_a, v_b, 0.0]) / total, abs=0.02)
    assert found.total == pytest.approx(np.array([v_a + v_ac, v_b, v_ac]) / total, abs=0.02)
    assert (np.abs(found.total - np.array([v_a + v_ac, v_b, v_ac]) / total) < 2 * found.total_half + 1e-3).all()


def test_groups_with_a_failed_case_are_left_out_and_the_rest_is_the_same() -> None:
    unit = sensitivity.points(2, 1024, 0)
    values = unit[:, 0] + 2 * unit[:, 1]
    values[5] = math.nan
    found = sensitivity.indices(values, 2, 0)
    assert found is not None
    assert found.total == pytest.approx([0.2, 0.8], abs=0.03)  # variances of 1/12 and 4/12
    again = sensitivity.indices(values, 2, 0)
    assert again is not None and (again.total_half == found.total_half).all()


def test_what_does_not_vary_has_none() -> None:
    assert sensitivity.indices(np.ones(40), 2, 0) is None
    assert sensitivity.indices(np.full(40, math.nan), 2, 0) is None


def test_there_are_as_many_points_as_said(tmp_path: Path) -> None:
    assert len(sensitivity.points(4, 100, 0)) == 128 * 6
