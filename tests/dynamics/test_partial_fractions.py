"""Partial fractions of an axis with linear forces, compared with its state space by SciPy."""

import math
from collections.abc import Mapping

import numpy as np
import pytest
from scipy.linalg import expm

from flexdesign import effects
from flexdesign.dynamics.signal_chain.chain import AxisChain, Oscillator
from flexdesign.dynamics.signal_chain.partial_fractions import Part, parts, step_matrices

DAMPED = "structural_damping"
#: Modes that ring, that are overdamped, and two of them.
MODES = [
    (Oscillator(300.0, 0.02),),
    (Oscillator(5.0, 3.0),),
    (Oscillator(80.0, 0.01, 0.7), Oscillator(400.0, 0.9, 0.3)),
]


def axis(modes: tuple[Oscillator, ...], loss_factor: float = 0.1) -> AxisChain:
    """Return a chain with structural damping."""
    return AxisChain("x", 1e-6, modes, ((effects.find(DAMPED), {"loss_factor": loss_factor}),))


def response(found: tuple[Part, ...], s: complex) -> complex:
    """Return motion over drive of parts: p (s^2 + a1 s + a0) = b0 (s + a1) d + b1 d."""
    return sum((part.b0 * (s + part.a1) + part.b1) / (s**2 + part.a1 * s + part.a0) for part in found)


@pytest.mark.parametrize("modes", MODES)
@pytest.mark.parametrize("frequency", [0.03, 1.0, 79.0, 5000.0])
def test_parts_respond_as_modes_and_relaxations_together(modes: tuple[Oscillator, ...], frequency: float) -> None:
    """x = G (d + f) and f = -(c s + sum k s / (s + r)) x, solved by hand."""
    chain, s = axis(modes), 2j * math.pi * frequency
    (block,) = effects.find(DAMPED).faces
    force = block.maxwell({"loss_factor": 0.1})
    w = [2 * math.pi * mode.frequency for mode in modes]
    g = sum(m.share * w0**2 / (s**2 + 2 * m.damping_ratio * w0 * s + w0**2) for m, w0 in zip(modes, w, strict=True))
    stiffness = force.dashpot * s + sum(k * s / (s + rate) for rate, k in force.elements)
    assert response(parts(chain), s) == pytest.approx(g / (1 + g * stiffness), rel=1e-8)


@pytest.mark.parametrize("modes", MODES)
def test_velocities_add_up_to_that_of_the_motion(modes: tuple[Oscillator, ...]) -> None:
    found = parts(axis(modes))
    assert abs(sum(part.b0 for part in found)) < 1e-9 * sum(abs(part.b0) for part in found)


def test_without_loss_the_parts_are_the_modes() -> None:
    (one,) = parts(axis(MODES[0], loss_factor=0.0))
    w = 2 * math.pi * 300.0
    assert (one.a0, one.a1, one.b0, one.b1) == pytest.approx((w**2, 0.04 * w, 0.0, w**2))


@pytest.mark.parametrize("part", [Part(4e4, 8.0, 0.3, 500.0), Part(0.0, 60.0, -2.0, 120.0), Part(0.0, 1e6, 1.0, -1e6)])
def test_a_step_is_that_of_the_matrix_exponential(part: Part) -> None:
    """Transition over half a step and a whole one, and the response to a constant drive."""
    length = 7e-3
    numbers = np.array(step_matrices(part, length))
    system = np.array([[0.0, 1.0, part.b0], [-part.a0, -part.a1, part.b1], [0.0, 0.0, 0.0]])
    half, whole = expm(0.5 * length * system), expm(length * system)
    scale = np.abs(np.concatenate([half[:2].ravel(), whole[:2].ravel()])).max()
    assert numbers[:4] == pytest.approx(half[:2, :2].ravel(), abs=1e-11 * scale)
    assert numbers[4:6] == pytest.approx(half[:2, 2], abs=1e-11 * scale)
    assert numbers[6:10] == pytest.approx(whole[:2, :2].ravel(), abs=1e-11 * scale)
    assert numbers[10:].reshape(2, 3).sum(axis=1) == pytest.approx(whole[:2, 2], abs=1e-11 * scale)


def test_loss_is_that_of_the_motion_in_time() -> None:
    """Energy lost in a cycle of free vibration: the decay is half the loss factor, which the band's ends lessen."""
    values: Mapping[str, float] = {"loss_factor": 0.02}
    chain = AxisChain("x", 1e-6, (Oscillator(30.0, 0.0),), ((effects.find(DAMPED), values),))
    ringing = max(parts(chain), key=lambda part: part.a0)
    assert ringing.a1 / (2 * math.sqrt(ringing.a0)) == pytest.approx(0.01, rel=0.07)
