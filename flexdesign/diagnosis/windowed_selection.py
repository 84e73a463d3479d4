"""Forward steps of the selection in very long recordings: searched in windows, decided on all values.

A search fits dozens of models, and a simulation of all values takes as long as they are many. Screening and fits of all
candidates therefore use windows, more of them where the present model fails: systematic sampling with probability
proportional to size (Madow 1949, Ann. Math. Statist. 20, 333-354). The size of a block is the sum of its squared
residuals plus the mean of all blocks, so that half of the windows are spread evenly. A window is simulated from its own
initial state, after a lead of the recorded command in which the mode forgets what happened before.

What is chosen there is fitted to all values, and must pass the same checks. If nothing passes, the effects that are too
slow for a window, such as creep, drift and hysteresis whose loops last longer, are searched in all values.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from flexdesign import effects
from flexdesign.core.arrays import Array
from flexdesign.core.model import Block, Disturbance, Socket
from flexdesign.diagnosis.effect_selection.estimation_setup import (
    case_of,
    evaluate_design,
    find_undetermined,
    with_calibrated_conditions,
)
from flexdesign.diagnosis.preparation.dataset import SAMPLES_SEARCHED, DiagnosisData, of_blocks
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import (
    FittedModel,
    fit_model,
    with_effects,
    with_values,
)
from flexdesign.estimation.model_selection.forward_selection import forward
from flexdesign.estimation.model_selection.model_comparison import Step, Trial, compare
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.measurements.recordings import Run

#: Why an effect that was accepted in windows is not fitted to all values.
WORSE_IN_WINDOWS = "explains less in the windows that were searched"
#: By these words a report finds the statement of `describe` among the remarks on a run.
SEARCHED = "effects were searched in"
#: Least length of a window [values]; a ring-down fits into it.
WINDOW = 1_000


def forward_in_windows(
    model: StageModel,
    data: DiagnosisData,
    task: EstimationTask,
    fit: FittedModel,
    candidates: Sequence[Candidate],
    expansion_points: Sequence[FittedModel] = (),
) -> Step:
    """Return the forward step of a selection in very long recordings; see the module.

    Parameters
    ----------
    model, data
        The stage model and all values.
    task, fit, candidates, expansion_points
        As those of `forward`, for all values.
    """
    task.progress("searching in windows in which the model fails most")
    step = _step(model, windows(data, fit.residuals_by_run), task, fit, candidates, is_gross=bool(expansion_points))
    trial = None if step.chosen is None else confirm(task, fit, step.chosen)
    others = [
        each if each.reason or each in step.alike else replace(each, reason=WORSE_IN_WINDOWS)
        for each in step.trials
        if each is not step.chosen
    ]
    if trial is not None and not trial.reason:
        return Step(trial, (trial, *others))
    task.progress("searching slow effects in all samples")
    slow = forward(task, fit, [each for each in candidates if is_slow(each.name)], expansion_points)
    refused = [*([] if trial is None else [trial]), *(each for each in others if each.reason)]
    return replace(slow, trials=(*slow.trials, *refused))


def is_slow(effect: str) -> bool:
    """Tell whether an effect may be too slow for a window: it relaxes, has loops, or adds to the reading."""
    faces = effects.find(effect).faces
    blocks = [face for face in faces if isinstance(face, Block)]
    has_loops = any(block.states and block.socket in (Socket.HYSTERESIS, Socket.FORCE) for block in blocks)
    relaxes = any(block.relaxing for block in blocks)
    return has_loops or relaxes or (bool(faces) and all(isinstance(face, Disturbance) for face in faces))


def _step(
    model: StageModel,
    parts: DiagnosisData,
    whole: EstimationTask,
    fit: FittedModel,
    candidates: Sequence[Candidate],
    *,
    is_gross: bool,
) -> Step:
    """Return the forward step in windows from the effects of a fit to all values."""
    dynamics, task = case_of(model, parts, whole.each, whole.progress)
    # A window has no delay of its own, which would stand for the phase of a mode, and begins after its lead.
    dynamics = dynamics.set_apart(())
    task = replace(task, bare=lambda _: dynamics)
    begun = cast(AxisDynamics, with_values(with_effects(dynamics, fit.effects), fit.model))
    undetermined = find_undetermined(task, begun)
    task = with_calibrated_conditions(replace(task, free=tuple(n for n in whole.free if n not in undetermined)), begun)
    # The parameters keep the values that fit all samples: windows about an error of the model would lead them astray.
    own = evaluate_design(task, task.fine(begun, 1.0), fit.effects)
    expansion_points = (evaluate_design(with_calibrated_conditions(task, dynamics), dynamics),) if is_gross else ()
    return forward(task, own, candidates, expansion_points)


def confirm(task: EstimationTask, fit: FittedModel, chosen: Trial) -> Trial | None:
    """Return the trial of the effects that were chosen in a part of the recordings, fitted to all values.

    It adds to `fit` all effects that the chosen fit has in addition; None where the model fails.
    """
    added = tuple(effect for effect in chosen.fit.effects if effect.name not in fit.names)
    names = tuple(effect.name for effect in added)
    task.progress(f"fitting with {' and '.join((*fit.names, *names))}, the whole runs")
    model = with_values(with_effects(fit.model, added), chosen.fit.model)
    extended = fit_model(task, task.fine(model, 1.0), (*fit.effects, *added))
    return None if extended is None else compare(task, fit, extended, names, chosen.score)


# --- windows ----------------------------------------------------------------------------------------------------------


def describe(data: DiagnosisData) -> str:
    """Return what is done with very long recordings, a sentence without its full stop."""
    return (
        f"of {data.values} samples, {SEARCHED} {_count(data)} windows of {_length(data)} where the model "
        "fails most, and slow ones in all; what was found is fitted to all samples and checked on all"
    )


def windows(data: DiagnosisData, residuals: Mapping[str, Array]) -> DiagnosisData:
    """Return the data set with windows in the place of its runs, without test runs.

    Parameters
    ----------
    data
        The data set.
    residuals
        Residual of each run by its name, n values [response], NaN at gaps; without one, windows are spread evenly.
    """
    searched, chosen = [*data.of("identify"), *data.of("validate")], list[Run]()
    for runs in (data.of("identify"), data.of("validate")):
        share = _present(runs) / _present(searched)
        chosen += _sample(data, runs, residuals, max(1, round(share * _count(data)))) if runs else []
    return replace(data, runs=tuple(chosen), noise=of_blocks(data.noise, chosen))


def _present(runs: Iterable[Run]) -> int:
    return int(sum(np.isfinite(run.measured()).sum() for run in runs))


def _length(data: DiagnosisData) -> int:
    """Return the number of values in a window, without its lead."""
    period = min(run.period for run in data.runs)
    return min(max(WINDOW, math.ceil(data.axis.settling_time / period)), SAMPLES_SEARCHED // 2)


def _count(data: DiagnosisData) -> int:
    return SAMPLES_SEARCHED // _length(data)


def _sample(data: DiagnosisData, runs: Sequence[Run], residuals: Mapping[str, Array], count: int) -> list[Run]:
    """Return windows of runs at equal steps of their accumulated size."""
    length, places, sizes = _length(data), list[tuple[Run, int]](), list[float]()
    for run in runs:
        squares, there = residuals.get(run.name, np.zeros(len(run.time))) ** 2, np.isfinite(run.measured())
        for first in range(0, max(len(run.time) - length, 0) + 1, length):
            if 2 * there[first : first + length].sum() >= min(length, len(run.time)):
                places.append((run, first))
                sizes.append(float(np.nansum(squares[first : first + length])))
    if not places:
        return list(runs)
    reached = np.cumsum(np.array(sizes) + (np.mean(sizes) or 1.0))
    at = np.unique(np.searchsorted(reached, reached[-1] * (np.arange(count) + 0.5) / count))
    return [_window(data, places[k][0], places[k][1], length) for k in at]


def _window(data: DiagnosisData, run: Run, first: int, length: int) -> Run:
    """Return a window of a run, with a lead without readings."""
    lead = min(math.ceil(data.axis.settling_time / run.period), length, first)
    part = slice(first - lead, first + length)
    columns = {name: values[part].copy() for name, values in run.columns.items()}
    for name in run.responses:
        columns[name][:lead] = np.nan
    return replace(run, name=f"{run.name}:{first}", time=run.time[part], columns=columns)
