"""The verdict: whether something is missing, whether it is known, and which effects these runs do not distinguish."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexdesign.core.errors import join_names
from flexdesign.diagnosis.comparison.compare import reversal_doubt
from flexdesign.diagnosis.effect_selection.per_run_parameters import ByRun, with_means, with_runs
from flexdesign.diagnosis.effect_selection.prior_conflicts import Conflict, displaced
from flexdesign.diagnosis.models_without_physics import better_kind
from flexdesign.diagnosis.preparation.dataset import DiagnosisData
from flexdesign.diagnosis.result import CandidateRecord, Diagnosis, ErrorStep, IdentifiedEffect, Value, Verdict
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.estimation.criterion import LARGE, is_worse
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel
from flexdesign.estimation.model_selection.model_comparison import Step, is_end_relevant, relevant_ends
from flexdesign.estimation.model_selection.sparse_residual_model import SparseModel
from flexdesign.estimation.model_selection.stepwise_selection import SelectionHistory
from flexdesign.estimation.uncertainty.identifiability import intervals
from flexdesign.measurements.noise_level import allowed_excess

#: Why an effect is not named, see `LARGE`.
LITTLE = "less than twice what then remains is explained"
#: This number of jumps in a residual is not random.
FEWEST_JUMPS = 3


def decide(
    data: DiagnosisData, task: EstimationTask, history: SelectionHistory, left: SparseModel
) -> tuple[Verdict, FittedModel, dict[str, str]]:
    """Return the verdict, the fit whose effects are named, and why each further effect of the last fit is not.

    Each effect must explain `LARGE` times the mean square that remains unexplained after the last effect that is named.
    A large and certain share is a finding, whatever else the model lacks. A residual below a stated tolerance counts as
    explained, and so does a white one if the noise is unknown.

    If the model is not adequate, effects may approximate something else. They are then refused in two cases. A linear
    system, a static curve, or the smooth functions that describe the remainder, explain more in their place. Or a
    parameter of the model itself, such as the gain, ends at a limit, or is moved far beyond its prior by the effects:
    they then stand for the motion that the model no longer explains.
    """
    every = history.levels
    adequate = is_adequate(data, history.final, left) and not relevant_ends(task, history.final)
    if adequate and (not history.final.effects or not data.noise.known or data.is_negligible(history.final)):
        return ("effects-found" if history.final.effects else "nothing-missing"), history.final, {}
    rests = np.array([data.unexplained_rms(fit) ** 2 for fit in every])
    added = np.maximum(np.diff([len(fit.effects) for fit in every]), 1)
    refusals = dict[str, str]()
    for named in range(len(every) - 1, 0, -1):
        fit = every[named]
        if not np.all(-np.diff(rests[: named + 1]) >= LARGE * added[:named] * rests[named]):
            reason = LITTLE
        else:
            reason = "" if adequate and fit is history.final else _approximation(data, task, every[0], fit)
        if not reason:
            return "effects-found", fit, refusals
        refusals |= {name: reason for name in fit.names if name not in every[named - 1].names}
    if {*refusals.values()} == {LITTLE} and (kind := better_kind(data, task, every[0], history.final)):
        refusals = dict.fromkeys(refusals, kind)  # it says what the model lacks
    return "unknown", history.calibration, refusals


def _approximation(data: DiagnosisData, task: EstimationTask, calibration: FittedModel, fit: FittedModel) -> str:
    """Return why the effects of a fit may approximate something else; empty if nothing shows that they do."""
    if kind := better_kind(data, task, calibration, fit):
        return kind
    if ends := [*relevant_ends(task, fit), *(name for name in _limits(fit) if is_end_relevant(task, fit, name))]:
        return f"{_in_words(ends)} {'are' if len(ends) > 1 else 'is'} at the end of what is plausible"
    if moved := displaced(data, task, calibration, fit):
        return f"with them the {_in_words(moved)} is more than twice or less than half what the model says"
    return ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Conclusion:
    """The verdict on a selection, and the fits and sets of effects that it rests on.

    Parameters
    ----------
    verdict, refusals
        The verdict; and why effects of the last fit are not named, by their names.
    smooth_model
        Smooth functions that explain most of the residual of the last fit.
    error_ladder
        The fits from the model as designed and as calibrated to the last whose effects are named.
    groups
        Effects that the runs do not distinguish; one of each group is named.
    conflicts, implied_effects
        Parameters that moved beyond their prior, and those among them that represent an effect.
    offset_rms
        Rms residual of the runs that errors are stated of, if only their offsets are fitted [response]; None without
        runs.
    by_run
        Strengths of named effects that differ from run to run, by name.
    """

    verdict: Verdict
    refusals: Mapping[str, str]
    smooth_model: SparseModel
    error_ladder: Sequence[FittedModel]
    groups: tuple[tuple[str, ...], ...]
    conflicts: Sequence[Conflict]
    implied_effects: Sequence[Conflict]
    offset_rms: float | None
    by_run: Mapping[str, ByRun]


def diagnosis_of(
    model: StageModel, data: DiagnosisData, history: SelectionHistory, conclusion: Conclusion
) -> Diagnosis:
    """Return the diagnosis that states a conclusion, with intervals, shares and the model that was found."""
    error_ladder, implied_effects = conclusion.error_ladder, conclusion.implied_effects
    calibration, final = error_ladder[1], error_ladder[-1]
    is_noise = is_adequate(data, history.final, conclusion.smooth_model)
    shape = "" if is_noise else _describe(data, history.final, conclusion.smooth_model)
    if is_noise and not {*history.final.names} <= {*final.names}:
        is_noise, shape = False, _describe_size(data, final)  # effects that are not named explain it
    unexplained = max(data.test_error(final) ** 2 - data.known_noise(data.scored) ** 2, 0.0)
    values = values_of(final, is_fitted=not history.is_refused or bool(final.effects))
    steps = error_steps(data, error_ladder)
    if conclusion.offset_rms is not None:  # shows what the initial conditions of the runs explain
        steps = (ErrorStep("as designed, offsets alone", conclusion.offset_rms), *steps)
    named = [with_runs(identified_effect(data, error_ladder[1:], n, values), conclusion.by_run) for n in final.names]
    unnamed = [name for name in history.final.names if name not in final.names]
    shares = {name: _share(data, history.levels, name, data.selecting) for name in unnamed}
    return Diagnosis(
        verdict="effects-found" if implied_effects else conclusion.verdict,
        axis=data.name,
        before=model,
        model=model_of(model, data, final, values, implied_effects),
        effects=(*named, *(conflict.named for conflict in implied_effects if conflict.named)),
        confusable=(*conclusion.groups, *(c.group for c in implied_effects if len(c.group) > 1)),
        possible_effects={name: share for name, share in shares.items() if share > 0},
        candidates=_candidate_records(history.steps),
        error_ladder=steps,
        calibration=tuple(values[name] for name in own_numbers(final)),
        conflicts=tuple(conflict.words for conflict in conclusion.conflicts),
        noise=data.noise,
        noise_floor=data.noise_rms,
        sparse_model=conclusion.smooth_model,
        remainder=shape,
        remainder_rms=0.0 if is_noise else math.sqrt(unexplained),
        stroke=data.stroke,
        tolerance=data.tolerance,
        undetermined=history.undetermined,
        residuals_by_run={"calibrated": calibration.residuals_by_run, "found": final.residuals_by_run},
        runs=data.runs,
        confidence=_confidence(data, history, error_ladder),
        responses=data.responses,
        lines=data.lines,
        refusals=conclusion.refusals,
    )


def _confidence(data: DiagnosisData, history: SelectionHistory, error_ladder: Sequence[FittedModel]) -> str:
    """Return what weakens the verdict, in words; the fits have the residuals of the test runs."""
    nominal, calibration, final = *error_ladder[:2], error_ladder[-1]
    doubt = reversal_doubt(data.runs, data.responses, history.nominal.residuals_by_run)
    remarks = [doubt] if doubt else []
    if not data.noise.known:
        remarks.append(
            "the noise of these runs is unknown: evidence is weighed by the share that is explained, and nothing says "
            "how much of the residual is noise"
        )
    is_kept = data.observed("test") or data.observed("validate")
    if data.noise.known and is_kept and LARGE * data.test_error(calibration) < data.noise_rms:
        remarks.append(
            "the residual is far below the noise, which is overstated: the stretches or repeats that it was read from "
            "hold motion, or the stated one is too large; smaller effects are not seen"
        )
    if history.is_refused:
        remarks.append(
            "calibration makes the validation runs worse, so that the structure of the model is wrong for these runs; "
            "the design values were kept"
        )
    elif data.observed("test") and is_worse(data.test_error(calibration), data.test_error(nominal)):
        remarks.append(
            "calibration makes the test runs worse, which had no part in the fit: the structure of the model may be "
            "wrong for them"
        )
    if (ends := _own_ends(final)) and (final.effects or not history.is_refused):
        remarks.append(
            f"{_in_words(ends)} of the model ended at the limit of what is plausible: its structure may be wrong for "
            "these runs, or they do not show it"
        )
    return "; ".join(remarks)


def _in_words(names: Sequence[str]) -> str:
    return join_names([name.replace("_", " ").replace(".", ": ") for name in names])


def _own_ends(fit: FittedModel) -> list[str]:
    """Return the parameters of the model itself that the fit moved to an end of their plausible range."""
    own = own_numbers(fit)
    return [name for name in fit.ends() if name in own]


def _limits(fit: FittedModel) -> list[str]:
    """Return the parameters of the model itself that end at a limit, without the upper one of the natural frequency.

    There the runs show no mode; at any other limit the structure of the model is wrong.
    """
    where, ends = fit.solution.problem.where, _own_ends(fit)
    if "natural_frequency" in ends:
        j = where.names.index("natural_frequency")
        if 2 * fit.solution.x[j] > where.lower[j] + where.upper[j]:
            ends.remove("natural_frequency")
    return ends


def identified_effect(
    data: DiagnosisData, error_ladder: Sequence[FittedModel], name: str, values: Mapping[str, Value]
) -> IdentifiedEffect:
    """Return an effect of the last fit with its values and its share; the first fit is the calibrated one."""
    final = error_ladder[-1]
    effect = next(effect for effect in final.effects if effect.name == name)
    shares = [_share(data, error_ladder, name, data.scored)]
    if data.runs and (scored := [each.name for each in data.responses if each.role != "identify"]):
        shares.append(_share(data, error_ladder, name, scored))  # responses may show what runs do not
    return IdentifiedEffect(name, tuple(values[number] for number in effect.free), max(shares))


def _share(data: DiagnosisData, error_ladder: Sequence[FittedModel], name: str, scored: Sequence[str]) -> float:
    """Return the share of the mean square that calibration leaves unexplained which an effect explains."""
    errors = [fit.rms(scored, data.scales) for fit in error_ladder]
    place = next((i for i, fit in enumerate(error_ladder) if name in fit.names), len(error_ladder) - 1)
    before, after = errors[place - 1] ** 2, errors[place] ** 2
    return float(np.clip((before - after) / max(errors[0] ** 2 - data.known_noise(scored) ** 2, 1e-300), 0.0, 1.0))


def values_of(fit: FittedModel, *, is_fitted: bool = True) -> dict[str, Value]:
    """Return the parameters that belong to no run, with their 95 % intervals by the profile likelihood, by name.

    The intervals of strengths are those by which effects were kept.

    Parameters
    ----------
    fit
        The fit.
    is_fitted
        Whether its parameters are fitted. If they are, a better point that a profile meets gives the values; values of
        the design stay.
    """
    where = fit.solution.problem.where
    present = where.values(fit.solution.x)
    names, strengths = [p.name for p in where.parameters if not p.run], {effect.strength for effect in fit.effects}
    alone = (intervals(fit.solution, [name])[0] for name in names if name in strengths)
    together = intervals(fit.solution, [name for name in names if name not in strengths])
    estimates = sorted((*alone, *together), key=lambda e: names.index(e.name))
    values = {e.name: e.value if is_fitted and e.value is not None else present[e.name] for e in estimates}
    return {e.name: Value(e.parameter, values[e.name], e.interval or e.parameter.plausible) for e in estimates}


def own_numbers(fit: FittedModel) -> list[str]:
    """Return the free parameters that belong to the model itself."""
    of_effects = {name for effect in fit.effects for name in effect.free}
    return [p.name for p in fit.solution.problem.where.parameters if not p.run and p.name not in of_effects]


def _candidate_records(steps: Sequence[Step]) -> tuple[CandidateRecord, ...]:
    records = []
    for step in steps:
        alike = [trial.names for trial in step.alike]
        for trial in step.trials:
            present = trial.fit.names[: len(trial.fit.names) - len(trial.names)]
            outcome = trial.reason or "explains less"
            if step.chosen is not None and trial.names == step.chosen.names:
                outcome = "added"
            elif trial.names in alike:
                outcome = "these runs do not distinguish it from what was added"
            evidence = trial.gain / trial.critical_gain if trial.critical_gain else 0.0
            records.append(CandidateRecord(trial.names, present, trial.error, trial.share, evidence, outcome))
    return tuple(records)


def error_steps(data: DiagnosisData, error_ladder: Sequence[FittedModel]) -> tuple[ErrorStep, ...]:
    """Return the steps of the error ladder: of the model as designed, as calibrated, and with effects."""
    labels = ("as designed", "recalibrated")
    steps = [ErrorStep(label, data.test_error(fit)) for label, fit in zip(labels, error_ladder, strict=False)]
    before: tuple[str, ...] = ()
    for fit in error_ladder[2:]:
        label = [f"+ {name}" for name in fit.names if name not in before]
        label += [f"- {name}" for name in before if name not in fit.names]
        steps.append(ErrorStep(" ".join(label), data.test_error(fit)))
        before = fit.names
    return tuple(steps)


def model_of(
    model: StageModel,
    data: DiagnosisData,
    fit: FittedModel,
    values: Mapping[str, Value],
    implied_effects: Sequence[Conflict] = (),
) -> StageModel:
    """Return the stage model with the fitted values, and with the effects implied by parameters beyond their prior.

    Parameters
    ----------
    model, data, fit
        The stage model as it was, the data, and the fit.
    values
        Parameters of the fit that are stated.
    implied_effects
        Parameters that moved beyond their prior and represent an effect.
    """
    dynamics = with_means(replace(fit, model=fit.model.replace({name: each.value for name, each in values.items()})))
    for conflict in implied_effects:
        dynamics = conflict.written(dynamics)
    axis = dynamics.axis
    rest = data.axis.effects.get("bouc_wen", {}).get("rest")
    if rest:  # the rest position of simulations stays: runs do not determine it, as each has its own initial state
        axis = replace(axis, effects={**axis.effects, "bouc_wen": {**axis.effects["bouc_wen"], "rest": rest}})
    axes = {**model.axes, data.name: axis}
    return replace(model, axes=axes, controller=replace(model.controller, delay=dynamics.delay))


# --- remainder -------------------------------------------------------------------------------------------------------


def excess(data: DiagnosisData, fit: FittedModel) -> tuple[float, float]:
    """Return the mean square of the whitened residual less that of noise, and the largest that counts as noise.

    Runs and frequency responses are compared separately, fitted and validation ones, and the largest excess counts:
    frequency responses have few values, which would not count among those of runs.
    """
    pairs = list(zip(fit.solution.problem.dataset.records, fit.solution.residuals, strict=True))
    of_lines = [pair for pair in pairs if pair[0].observation.name in data.lines]
    of_runs = [pair for pair in pairs if pair[0].observation.name not in data.lines]
    level = 2 * data.noise.relative_error  # of squares
    line_level = max((math.sqrt(2 / e.dof) if e.dof else math.inf for e in data.lines.values()), default=0.0)
    sums = [
        (sum(float(part @ part) for _, part in each), sum(int(record.present.sum()) for record, _ in each), error)
        for each, error in ((of_runs, level), (of_lines, line_level))
    ]
    validated = [
        (fit.residuals_by_run[each.name] / data.lines[each.name].of_values)[np.tile(each.present, 2)]
        for each in data.responses
        if each.role == "validate"
    ]
    chi2 = sum(float(part @ part) for part in validated)
    sums.append((chi2, sum(len(part) for part in validated), line_level))
    samples = sum(int(np.isfinite(run.measured()).sum()) for run in data.of("validate"))
    sums.append((fit.validation_chi2 - chi2, samples, level))
    margins = [(chi2 / count - 1, allowed_excess(count, error)) for chi2, count, error in sums if count]
    return max(margins, key=lambda pair: pair[0] - pair[1])


def is_adequate(data: DiagnosisData, fit: FittedModel, smooth_model: SparseModel) -> bool:
    """Return whether the residual is noise, or below the tolerance that the user stated."""
    if data.is_negligible(fit):
        return True
    # Smooth functions that explain a part of the residual show that it is not noise, however small that part is.
    explainable = smooth_model.held_gain > 0 and smooth_model.validation_rms > data.tolerance and smooth_model.gain > 0
    if not data.noise.known:  # a white residual may be noise, whatever its size
        return fit.is_white and not explainable
    found, allowed = excess(data, fit)
    return found <= allowed and _jumps(data, fit) < FEWEST_JUMPS and not explainable


def _jumps(data: DiagnosisData, fit: FittedModel) -> int:
    """Count the jumps in the residual of runs; a reading in coarse steps has jumps by itself, which do not count."""
    return fit.jumps([run.name for run in data.runs]) if data.coarse_step is None else 0


def _describe_size(data: DiagnosisData, fit: FittedModel) -> str:
    if not data.noise.known:
        return "the residual remains"
    return f"{math.sqrt(1 + max(excess(data, fit)[0], 0.0)):.3g} times the noise remains"


def _describe(data: DiagnosisData, fit: FittedModel, smooth_model: SparseModel) -> str:
    """Return the size of a remainder, and the smooth functions that explain most of it, in words."""
    share = _describe_size(data, fit)
    if data.noise.known and any(data.noise.whitening.process(run.name).order for run in data.runs):
        share += " (whitened: of each sample counts what those before it do not predict; the errors stated are raw)"
    if (jumps := _jumps(data, fit)) >= FEWEST_JUMPS:
        share += f", with {jumps} sudden jumps"
    if not smooth_model.terms:
        return f"{share}; no smooth function of position, velocity, voltage or time explains it"
    best = sorted(smooth_model.shares, key=lambda name: -smooth_model.shares[name])[:3]
    return f"{share}; of smooth functions these explain most: {', '.join(best)}"
