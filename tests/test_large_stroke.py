"""What large displacements do over the stroke, from paths whose law is known."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from flexdesign.core.model import Quantity
from flexdesign.fem import large_stroke
from flexdesign.fem.large_stroke import LargeStroke
from flexdesign.fem.solving.load_path import StrokePath

ACTUATOR, FREE = 50e6, 40e-6
C11, AMPLIFICATION = 5e-7, -8.0


def path(q: float, c: float, s: float, drive: np.ndarray) -> StrokePath:
    """Return a path with y + q y^2 + c y^3 = d (1 + s d), and with the tangents of that output stiffness."""
    linear = FREE * AMPLIFICATION * C11 / (C11 + 1 / ACTUATOR) * drive
    output = np.array([_real_root(q, c, d * (1 + s * d)) for d in linear])
    stiffness = 1e5 * (1 + 2 * q * output + 3 * c * output**2)
    c22 = 1 / stiffness + (AMPLIFICATION * C11) ** 2 / (C11 + 1 / ACTUATOR)
    one = np.ones(len(drive))
    half = 0.5 * FREE * drive
    return StrokePath(ACTUATOR * half, half, output, one / C11, 1 / c22, AMPLIFICATION * one)


def _real_root(q: float, c: float, right: float) -> float:
    roots = np.roots([c, q, 1.0, -right])
    real = roots[np.abs(roots.imag) < 1e-9 * np.abs(roots).max()].real
    return float(real[np.argmin(np.abs(real - right))])


@pytest.mark.parametrize(("q", "c", "s"), [(200.0, 3e4, 150.0), (-100.0, 1e5, 0.0), (50.0, -2e4, -80.0)])
def test_the_law_of_a_path_is_found_again(q: float, c: float, s: float) -> None:
    found = LargeStroke(path(q, c, s, np.linspace(0, 1, 5)), ACTUATOR, FREE)
    assert found.drive == pytest.approx(np.linspace(0, 1, 5))
    assert found.output_stiffness[0] == pytest.approx(1e5)
    assert found.effects() == {
        "quadratic_stiffness": {"quadratic": pytest.approx(q, rel=1e-6)},
        "stress_stiffening": {"cubic": pytest.approx(c, rel=1e-6)},
        "stroke_dependent_amplification": {"slope": pytest.approx(s, rel=1e-6, abs=1e-6)},
    }


def test_changes_are_those_at_full_drive() -> None:
    found = LargeStroke(path(200.0, 3e4, 150.0, np.linspace(0, 1.2, 7)), ACTUATOR, FREE)
    named = {quantity.name: quantity.value for quantity in found.quantities()}
    assert found.full_stroke == pytest.approx(found.path.output[5])
    assert named["K_out_change"] == pytest.approx(found.output_stiffness[5] / 1e5 - 1)
    assert named["K_in_change"] == named["lambda_change"] == 0.0


def test_progress_is_told_in_shares_of_full_drive_and_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps of Newton's method mean nothing to who waits."""
    said: list[str] = []
    clock = iter([100.0, 110.0, 130.0])

    def pushed(*_: object, enough: Callable[[float, float], bool]) -> StrokePath:
        assert [enough(25.0 * k, 2.5e-6 * k) for k in (1e-6, 1, 3, 4)] == [False, False, False, True]
        ones = np.ones(2)
        return StrokePath(np.array([0.0, 100.0]), np.array([0.0, 1e-5]), ones, ones, ones, ones)

    monkeypatch.setattr(large_stroke, "stroke_path", pushed)
    monkeypatch.setattr(large_stroke, "perf_counter", lambda: next(clock))
    linear = SimpleNamespace(actuator_force=lambda *_: 100.0)
    # 100 N over 10 N/um and 10 um of extension: the free stroke of 20 um.
    large_stroke.follow(None, None, None, None, linear, 1e7, 2e-5, 4, said.append)  # type: ignore[arg-type]
    assert said == [
        "pushing to full drive in about 4 steps",
        "25 % of full drive reached, 30 s left",
        "75 % of full drive reached, 10 s left",
    ]


def test_the_stroke_keeps_the_error_of_the_linear_one() -> None:
    """On a mesh that is 2 % off, large displacements change the extrapolated stroke by the same factor as its own."""
    found = LargeStroke(path(200.0, 3e4, 150.0, np.linspace(0, 1.2, 7)), ACTUATOR, FREE)
    linear = Quantity("stroke", found.linear_stroke / 1.02, "m", "um", "output free", "FEM", 1e-6)
    told = found.stroke(linear)
    ratio = found.full_stroke / found.linear_stroke
    assert told.value == pytest.approx(ratio * linear.value)
    assert told.key == "stroke_output_free_large_displacements"
    assert told.half_width is not None and told.half_width > abs(ratio) * 1e-6


def test_full_drive_between_two_steps_is_found_by_their_tangents() -> None:
    """A path of few steps, whose tangents are its own, has the stroke of one of many."""
    q = 100.0

    def stroke(points: int) -> float:
        force = np.linspace(0, 1.3, points) * FREE / (C11 + 1 / ACTUATOR)
        linear = AMPLIFICATION * C11 * force
        one = np.ones(points)
        tangents = AMPLIFICATION * (1 + 2 * q * linear)
        output = linear + q * linear**2
        return LargeStroke(
            StrokePath(force, C11 * force, output, one / C11, 1e5 * one, tangents), ACTUATOR, FREE
        ).full_stroke

    assert stroke(5) == pytest.approx(stroke(400), rel=1e-9)
