"""The one place where the trial meets the package: what `flexdesign.diagnosis` says of a folder of recordings."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from studies.hidden_effect_trial.folder import MODEL, RUNS, Answer
from studies.hidden_effect_trial.scoring import Diagnosed


def diagnose(folder: Path, answer: Answer) -> Diagnosed:
    """Diagnose a case's folder; the answer serves only to compare intervals with afterwards."""
    from flexdesign import diagnosis
    from flexdesign.dynamics.stage_model import reading
    from flexdesign.measurements import recordings

    recorded = recordings.read_runs([folder / RUNS])
    began = time.perf_counter()
    found: Any = diagnosis.diagnose(reading.read(folder / MODEL), recorded, threads=1)
    seconds = time.perf_counter() - began
    error = _test_error(found, [run.name for run in recorded if run.role == "test"])
    inside: dict[str, tuple[bool, float]] = {}
    for named in found.effects:
        inside |= _interval_checks(named, answer.effects.get(named.name, {}))
    return Diagnosed(
        verdict=str(found.verdict),
        named=tuple(named.name for named in found.effects),
        groups=tuple(tuple(group) for group in found.confusable),
        floor=float(found.noise_floor),
        error=float(found.error if error is None else error),
        inside=inside,
        seconds=seconds,
        is_tested=error is not None,
        remainder=float(getattr(found, "remainder_rms", 0.0)),
        words=str(getattr(found, "remainder", "")),
    )


def _test_error(found: Any, names: list[str]) -> float | None:
    """Return the error on the runs for testing [m]; None if the diagnosis predicts none of them."""
    left = found.residuals_by_run.get("found", {})
    tested = [np.asarray(left[name], dtype=float) for name in names if name in left]
    return float(np.sqrt(np.nanmean(np.concatenate(tested) ** 2))) if tested else None


def _interval_checks(named: Any, truth: Mapping[str, float]) -> dict[str, tuple[bool, float]]:
    """Return for each number of an effect whether its interval holds the truth, and how wide it is."""
    coverage = {}
    for each in getattr(named, "values", ()):
        key = each.parameter.name.rpartition(".")[2]
        low, high = each.interval
        if key in truth and truth[key] and math.isfinite(low) and math.isfinite(high):
            coverage[f"{named.name}.{key}"] = (low <= truth[key] <= high, 0.5 * (high - low) / abs(truth[key]))
    return coverage
