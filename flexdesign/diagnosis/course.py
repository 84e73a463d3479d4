"""Diagnosis of one axis: calibrate, add what earns its place, and judge whether that is all.

First the numbers of the model itself are fitted, what finite elements know within its uncertainty, so that no effect is
blamed for a stiffness that is one percent off. Then effects are added while they earn their place, rivals are tried in
their stead, and what is left is laid beside the noise. Only where nothing is left, or where the effects explain more
than any smooth function of position, velocity and voltage could, are they named.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import cast

import numpy as np
from numpy.typing import NDArray

from flexdesign.diagnosis import periodic
from flexdesign.diagnosis.beginning import (
    in_time,
    in_tune,
    offset_residual,
)
from flexdesign.diagnosis.by_run import chosen_by_run, needed_by_run, of_runs
from flexdesign.diagnosis.candidates import candidates
from flexdesign.diagnosis.conflicts import conflicts, explains
from flexdesign.diagnosis.features import features_of
from flexdesign.diagnosis.findings import Course, Diagnosis
from flexdesign.diagnosis.judgement import conclude, decide, is_adequate, ladder_of
from flexdesign.diagnosis.opening import opening
from flexdesign.diagnosis.setting import Setting, settle
from flexdesign.diagnosis.task import BELIEVED, begun, case_of, simulating, undetermined, with_better_between
from flexdesign.dynamics.axis_model import AxisDynamics
from flexdesign.errors import InputError
from flexdesign.evidence.beginnings import begun_otherwise
from flexdesign.evidence.calibration import calibrated, evaluated
from flexdesign.evidence.case import Case, Fitting
from flexdesign.evidence.determination import hold_undetermined
from flexdesign.evidence.marquardt import SHARE
from flexdesign.evidence.model_comparison import Step
from flexdesign.evidence.rival import Rival, cost_of_terms, rival
from flexdesign.evidence.screening import Candidate
from flexdesign.evidence.selection import (
    FIRST_SHARE,
    MOST,
    MOST_OF_LINES,
    confirmed,
    confusable,
    forward,
    leaves_more_than_noise,
)
from flexdesign.evidence.stand import (
    GROSS,
    Stand,
    escape,
    finished,
    fitted,
    like,
    tested,
)
from flexdesign.runs import FrequencyResponse, Run
from flexdesign.stage_model import StageModel

Array = NDArray[np.float64]
#: Calibration is refused where it makes the validation error larger by this factor: more than chance of their noise.
WORSE = 1.02
#: Smooth functions are the better explanation where they leave no more than this share of what effects leave above the
#: noise, in squares.
BETTER = 0.5
#: How fits are made where runs are long, in their openings and in the whole of them. A step that promises to lower the
#: cost by less than about one moves no number by its standard deviation, and one that promises a few tells nothing of
#: what is missing; and among many values corners lie so close that a difference taken from farther is none of a slope.
AHEAD, LONG = Fitting(share=1e-4, last=1e-4), Fitting(share=1e-4, last=1e-5, moved=1e-6, sparing=True)


def diagnose(
    model: StageModel,
    runs: Sequence[Run | FrequencyResponse],
    *,
    axis: str | None = None,
    more: Sequence[str] = (),
    tolerance: float | None = None,
    noise: float | None = None,
    threads: int = 2,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Find which physical effects a stage model lacks.

    Parameters
    ----------
    model
        The stage model; its uncertainties say how far its numbers may move.
    runs
        What was recorded, frequency responses among it; where nobody chose roles, they are split.
    axis
        Which one; may be left out where model and runs leave no choice.
    more
        Paths of effects beside those of the catalogue.
    tolerance
        What an effect must at least move a held-out prediction, rms [response]; by default 0.05 % of the stroke or
        0.3 of the noise, whichever is less. A residual below a stated tolerance counts as none.
    noise
        Standard deviation of the noise of runs, where it is stated [response]; by default it is estimated.
    threads
        Simulations at a time.
    seed
        Of the sample of starts.
    progress
        Told what is being done.

    Raises
    ------
    InputError
        If the axis is ambiguous, a run does not suit it, or no run may be fitted.
    """
    began = perf_counter()
    progress("reading the noise")
    setting = settle(model, runs, axis, tolerance, noise)
    with simulating(threads) as each:
        setting = with_better_between(model, setting, each, progress)
        dynamics, case = case_of(model, setting, each, progress)

        def every(of: Setting, stand: Stand) -> tuple[Candidate, ...]:
            lines = periodic.frequencies(of, stand) if of.runs else periodic.peaks(of, stand)
            return candidates(
                dynamics,
                more,
                lines,
                loaded=setting.is_loaded,
                at_stack=setting.is_at_stack,
                band=None if setting.runs else setting.band,
            )

        ahead = None
        if (short := opening(setting)) is not None:
            progress("searching in the opening of each run")
            _, case_of_openings = case_of(model, short, each, progress)
            part = replace(case_of_openings, fitting=AHEAD)
            _, ahead = search(short, part, dynamics, partial(every, short), seed, is_part=True)
            case = replace(case, fitting=LONG)
        case, course = search(setting, case, dynamics, partial(every, setting), seed, ahead)
        course = ended(case, course)
        progress("looking at what is left")
        left = _rival(setting, case, course.final)
        verdict, named = decide(setting, course, left, partial(_is_better_smooth, setting, case))
        if named.effects and named is not course.final:
            named = finished(case.at_last, named)
        named, held = hold_undetermined(case, named, dynamics)
        course = replace(course, undetermined=(*course.undetermined, *held))
        groups = confusable(case, named, dynamics, course.steps)
        beyond = conflicts(setting, named)
        is_done = is_adequate(setting, course.final, left)
        implied = [c for c in beyond if c.named is not None and (is_done or explains(setting, case, named, c))]
        progress("predicting the test runs")
        judging = [run for run in setting.runs if run.name in setting.judging]
        alone = np.concatenate([offset_residual(dynamics, run) for run in judging]) if judging else None
        ladder = [tested(case, stand) for stand in (course.designed, *ladder_of(course, named))]
        by_run = of_runs(case, ladder[-1])
        found = conclude(model, setting, course, left, verdict, ladder, groups, beyond, implied, alone, by_run)
    evaluations = sum(stand.solution.problem.evaluations for stand in (course.calibrated, *course.stands))
    return replace(found, evaluations=evaluations, seconds=perf_counter() - began)


def search(
    setting: Setting,
    case: Case,
    dynamics: AxisDynamics,
    catalogue: Callable[[Stand], Sequence[Candidate]],
    seed: int,
    ahead: Course | None = None,
    *,
    is_part: bool = False,
) -> tuple[Case, Course]:
    """Calibrate, and add effects while they earn their place; return the case as calibrated, and how it went.

    Which effects are tried, and at what values, may follow from what calibration leaves: `catalogue` tells. What a
    search `ahead` found in a part of the runs is tried first, and alone. A part is searched while it leaves more than
    noise: for what is fainter, and for what moves slowly, all of the runs are asked.
    """
    case.progress("predicting with the model as it is")
    held = undetermined(case, dynamics)
    case = replace(case, free=tuple(name for name in case.free if name not in held))
    designed = evaluated(replace(case, believed=BELIEVED), dynamics)
    case.progress("calibrating")
    stand, agreed = (
        calibrated(case, in_tune(case, in_time(case, dynamics)), seed=seed)
        if ahead is None
        else (fitted(case, like(dynamics, ahead.calibrated), (), {}, most=1, exact=False), ahead.agreed)
    )
    if stand is not None:  # how a mode rings as a record begins follows from its calibrated numbers
        case = begun(case, cast(AxisDynamics, stand.model), setting.rounded(stand))
        is_rough = ahead is not None and stand.scale > GROSS  # then an effect is missing beside which this is no matter
        stand = fitted(case, stand.model, (), {}, share=FIRST_SHARE if is_rough else SHARE)
    if designed is None or stand is None:
        raise InputError("model", f"axis.{dynamics.name}", None, "cannot be simulated at the values it has")
    is_refused = bool(case.validate.records) and setting.error(stand) > WORSE * setting.error(designed)
    if is_refused:  # the structure of the model is wrong for these runs: its design is the better beginning
        stand = evaluated(begun(case, dynamics, setting.rounded(designed)), designed.model) or designed
    base, stands, steps, every = stand, list[Stand](), list[Step](), catalogue(stand)
    found = [] if ahead is None else _lasting(ahead)
    most = MOST if setting.runs else MOST_OF_LINES
    while len(stand.effects) < most and (leaves_more_than_noise(stand) or not is_part):
        step = confirmed(case, stand, found.pop(0)) if found else None
        if step is None:  # nothing was found ahead, or all of the runs refuse it
            found.clear()
            step = forward(case, stand, every)
        step = chosen_by_run(case, stand, step, every)
        steps.append(step)
        if step.chosen is None:
            break
        stand = needed_by_run(case, step.chosen.stand, dynamics, every)
        before = stands[-1] if stands else base
        if stand.names == before.names:  # what was added made itself superfluous: it helped a fit that was caught
            stand = min(before, stand, key=lambda each: each.cost)
            base, stands = (base, [*stands[:-1], stand]) if stands else (stand, stands)
            break
        stands.append(stand)
    if not setting.runs:  # simulations of small sines cost little
        steps, stands = begun_otherwise(case, (steps, stands), dynamics, every, most)
        stand = stands[-1] if stands else stand
    final = escape(case.at_last, stand) if stand.effects else stand
    return case, Course(designed, base, tuple(stands), tuple(steps), final, agreed, held, is_refused)


def ended(case: Case, course: Course) -> Course:
    """Return a course with its last fit carried to its end, simulated more exactly."""
    if not course.final.effects:
        return course
    case.progress("fitting once more, simulated more exactly")
    stand, stands = finished(case.at_last, course.final), course.stands
    stands = (*stands[:-1], stand) if stands and stands[-1].names == stand.names else stands
    return replace(course, stands=stands, final=stand)


def _lasting(course: Course) -> list[Step]:
    """Return the steps whose effects are in the last stand, too; what the last one chose stands as that does."""
    final = course.final
    steps = [step for step in course.steps if step.chosen is not None and {*step.chosen.names} <= {*final.names}]
    if steps and (last := steps[-1].chosen) is not None and last.stand.names == final.names:
        steps[-1] = replace(steps[-1], chosen=replace(last, stand=final))
    return steps


def _is_better_smooth(setting: Setting, case: Case, base: Stand, stand: Stand) -> bool:
    """Tell whether the smooth functions of what a fit with effects leaves explain more in the place of the effects."""
    terms = _rival(setting, case, stand).terms
    if not terms:
        return False
    alone = cost_of_terms(case, base, features_of(setting, base), terms)
    samples = base.solution.problem.suite.samples
    return alone - samples < BETTER * (stand.seen_cost - samples)


def _rival(setting: Setting, case: Case, stand: Stand) -> Rival:
    seen = stand.solution.problem.suite  # records may begin in more ways in a later stand
    case = replace(case.prepared(case, stand.model), identify=seen)
    return rival(case, stand, features_of(setting, stand))
