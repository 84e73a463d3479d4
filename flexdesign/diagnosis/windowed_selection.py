"""Forward steps of the selection in very long recordings: searched in windows, decided on all values.

Screening and fits of all candidates use windows in which the present model fails most. What is chosen there is fitted
to all values, and must pass the same checks. If nothing passes, the effects that are too slow for a window, such as
creep, drift and hysteresis whose loops last longer, are searched in all values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from flexdesign import effects
from flexdesign.core.model import Block, Disturbance, Socket
from flexdesign.diagnosis.effect_selection.estimation_setup import (
    case_of,
    evaluate_design,
    find_undetermined,
    with_calibrated_conditions,
)
from flexdesign.diagnosis.preparation.dataset import DiagnosisData
from flexdesign.diagnosis.preparation.windows import windows
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

#: Why an effect that was accepted in windows is not fitted to all values.
WORSE_IN_WINDOWS = "explains less in the windows that were searched"


def forward_in_windows(
    model: StageModel,
    data: DiagnosisData,
    task: EstimationTask,
    fit: FittedModel,
    candidates: Sequence[Candidate],
    origins: Sequence[FittedModel] = (),
) -> Step:
    """Return the forward step of a selection in very long recordings; see the module.

    Parameters
    ----------
    model, data
        The stage model and all values.
    task, fit, candidates, origins
        As those of `forward`, for all values.
    """
    task.progress("searching in windows in which the model fails most")
    step = _step(model, windows(data, fit.residuals_by_run), task, fit, candidates, is_gross=bool(origins))
    trial = None if step.chosen is None else confirm(task, fit, step.chosen)
    others = [
        each if each.reason or each in step.alike else replace(each, reason=WORSE_IN_WINDOWS)
        for each in step.trials
        if each is not step.chosen
    ]
    if trial is not None and not trial.reason:
        return Step(trial, (trial, *others))
    task.progress("searching slow effects in all samples")
    slow = forward(task, fit, [each for each in candidates if is_slow(each.name)], origins)
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
    own = evaluate_design(task, task.fine(begun), fit.effects)
    origins = (evaluate_design(with_calibrated_conditions(task, dynamics), dynamics),) if is_gross else ()
    return forward(task, own, candidates, origins)


def confirm(task: EstimationTask, fit: FittedModel, chosen: Trial) -> Trial | None:
    """Return the trial of the effects that were chosen in a part of the recordings, fitted to all values.

    It adds to `fit` all effects that the chosen fit has in addition; None where the model fails.
    """
    added = tuple(effect for effect in chosen.fit.effects if effect.name not in fit.names)
    names = tuple(effect.name for effect in added)
    task.progress(f"fitting with {' and '.join((*fit.names, *names))}, the whole runs")
    model = with_values(with_effects(fit.model, added), chosen.fit.model)
    extended = fit_model(task, task.fine(model), (*fit.effects, *added))
    return None if extended is None else compare(task, fit, extended, names, chosen.score)
