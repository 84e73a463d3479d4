"""The residual of the mirror's outputs: by one linear response, by the modal axes as calibrated, and with effects."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexdesign.diagnosis import Diagnosis, diagnose
from flexdesign.dynamics.stage_model import reading
from flexdesign.measurements.recordings import AXES, read_runs
from studies.steering_mirror.modes import apply_response
from studies.steering_mirror.recordings import JUDGING, LEVELS, Decoupled, Recordings, decouple, linear, name_of, write

Array = NDArray[np.float64]
#: Stands: one linear response, and one for each level, which has all that follows the level; and what a diagnosis
#: leaves, before and after effects.
LINEAR, MODAL = ("linear", "linear per level"), ("calibrated", "found")


@dataclass(frozen=True, eq=False)
class Findings:
    """What came out.

    Parameters
    ----------
    decoupled
        The linear response and its modes.
    diagnoses
        By modal axis.
    residuals
        Root mean square of the residual over that of the output, by stand and level: one number per channel, on the
        validation realisation.
    own
        The same of the modal coordinates, by stand (`MODAL`), axis and level.
    """

    decoupled: Decoupled
    diagnoses: Mapping[str, Diagnosis]
    residuals: Mapping[str, Mapping[int, Array]]
    own: Mapping[str, Mapping[str, Mapping[int, float]]]


def investigate(recordings: Recordings, folder: Path, progress: Callable[[str], None] = lambda _: None) -> Findings:
    """Decouple, write runs and model into a folder, diagnose each modal axis, and turn the predictions back."""
    decoupled = decouple(recordings)
    model_file, place = write(recordings, decoupled, folder)
    model, runs = reading.read(model_file), read_runs([place])
    diagnoses = {}
    for axis in AXES:
        progress(f"diagnosing axis {axis}")
        diagnoses[axis] = diagnose(model, runs, axis=axis, threads=1)
        progress(f"axis {axis}: {diagnoses[axis].verdict}, {diagnoses[axis].seconds:.0f} s")
    return together(recordings, decoupled, diagnoses)


def together(recordings: Recordings, decoupled: Decoupled, diagnoses: Mapping[str, Diagnosis]) -> Findings:
    """Return what the diagnoses of the modal axes leave of the outputs."""
    left: dict[str, dict[int, Array]] = {fit: {} for fit in LINEAR + MODAL}
    for level in LEVELS:
        u, y = (np.moveaxis(each, 2, 0) for each in recordings.record(level, JUDGING))
        scale = np.concatenate(y).T
        for fit, levels in zip(LINEAR, (LEVELS, (level,)), strict=True):
            response = linear(recordings, levels)
            predicted = np.concatenate([apply_response(response, period) for period in u]).T
            left[fit][level] = share(scale - predicted, scale)
        for fit in MODAL:
            modal = np.stack([remainder(diagnoses[axis], fit, level) for axis in AXES])
            left[fit][level] = share(decoupled.modes.outputs(modal), scale[:, : modal.shape[1]])
    return Findings(decoupled, diagnoses, left, {fit: _own_residuals(diagnoses, fit) for fit in MODAL})


def remainder(found: Diagnosis, fit: str, level: int) -> Array:
    """Return what a fitted model leaves of the judging run of a level [m], n values."""
    return np.asarray(found.residuals_by_run[fit][name_of(level, JUDGING)], dtype=np.float64)


def share(left: Array, of: Array) -> Array:
    """Return the root mean square of the residual, over the standard deviation of the measured signal, row by row."""
    return np.asarray(np.sqrt(np.nanmean(left**2, axis=-1)) / np.nanstd(of, axis=-1))


def _own_residuals(diagnoses: Mapping[str, Diagnosis], fit: str) -> dict[str, dict[int, float]]:
    own: dict[str, dict[int, float]] = {}
    for axis, found in diagnoses.items():
        measured = {run.name: run.measured() for run in found.runs}
        own[axis] = {
            level: float(share(remainder(found, fit, level), measured[name_of(level, JUDGING)])) for level in LEVELS
        }
    return own
