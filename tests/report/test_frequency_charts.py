"""Charts of frequency responses: the phase of noisy lines is drawn next to that of the model."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from flexdesign.report.diagnosis.frequency_charts import Line, _logarithmic, _phase

F = np.linspace(0.1, 30.0, 600)


def test_the_phase_of_noisy_lines_is_next_to_that_of_the_model() -> None:
    """Lines of noise alone wander by whole turns if each is unwrapped against the one before."""
    model = np.exp(-0.1j * np.pi * F) / (1 - (F / 9) ** 2 + 0.02j * F / 9)  # with a delay, by more than a turn
    rng = np.random.default_rng(0)
    noise = rng.standard_normal((2, len(F))) * np.where(F < 3, 30.0, 0.01)
    smooth, dots = Line("model", F, model), Line("measured", F, model * (1 + noise[0] + 1j * noise[1]), dots=True)
    phase = _phase(smooth, smooth)
    assert phase[-1] == pytest.approx(-180 - 0.1 * 180 * F[-1], abs=2)
    apart = _phase(dots, smooth) - phase
    assert np.abs(apart).max() <= 180 and np.abs(apart[F > 3.5]).max() < 5
    other = Line("turned", F, -model)
    assert np.ptp(_phase(other, smooth) - phase) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(("smallest", "numbers"), [(0.3, {0.5, 1, 2}), (1e-4, {1e-4, 1e-3, 1e-2, 0.1, 1})])
def test_only_decades_are_numbered_where_there_are_many(smallest: float, numbers: set[float]) -> None:
    axes = Figure().subplots()
    axes.plot([0, 1], [smallest, 3.0])
    _logarithmic(axes)
    low, high = axes.get_ylim()
    assert {round(float(tick), 9) for tick in axes.get_yticks() if low < tick < high} == numbers
