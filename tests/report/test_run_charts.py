"""What the pictures of runs leave out: lines across gaps of a record, and pictures without a line."""

from __future__ import annotations

import numpy as np
import pytest

from flexdesign.report.diagnosis.diagnosis_charts import run_traces
from flexdesign.report.diagnosis.residual_charts import Trace, over_position
from flexdesign.report.traces import extremes

TIME = np.arange(4000) * 1e-3


@pytest.mark.parametrize("points", [200, 10_000])
def test_no_line_joins_two_blocks_of_a_record(points: int) -> None:
    """Also where a page thins the curves out."""
    blocks = (TIME < 1) | (TIME > 3)
    drawn = run_traces(
        TIME[blocks], TIME[blocks] + 5, [("model", 0.9 * TIME[blocks] + 5)], ("x [um]", "left [nm]"), 1e3
    )
    for curve in drawn.every:
        kept = extremes(curve.y[None, :], points)
        missing = np.isnan(curve.y[kept])
        assert missing.sum() == 1
        assert curve.x[kept][missing].item() == pytest.approx(2.0, abs=2e-3)
    whole = run_traces(TIME, TIME, [("model", TIME)], ("x [um]", "left [nm]"), 1e3)
    assert not any(np.isnan(curve.y).any() for curve in whole.every)


def test_a_picture_over_position_needs_motion() -> None:
    """Steps alone move through a position in a sample or two."""
    steps, sine = np.where(TIME % 2 < 1, 0.0, 5.0), np.sin(2 * np.pi * TIME)
    drawn = [
        over_position([Trace("a", 1e-3, position, position + 0.1, position, 0.01)], "um", "nm", 1e3)
        for position in (steps, sine)
    ]
    assert [picture is None for picture in drawn] == [True, False]
