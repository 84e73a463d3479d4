"""The judgement: whether something is missing, whether it is known, and what these runs cannot tell apart."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexdesign.diagnosis.effect_selection.per_run_parameters import ByRun, with_means, with_runs
from flexdesign.diagnosis.effect_selection.prior_conflicts import LARGE, Conflict
from flexdesign.diagnosis.preparation.dataset import Setting
from flexdesign.diagnosis.result import Course, Diagnosis, Named, Rung, Tried, Value, Verdict
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.estimation.model_selection.fitted_model import Stand
from flexdesign.estimation.model_selection.model_comparison import Step, Trial
from flexdesign.estimation.model_selection.sparse_residual_model import Rival
from flexdesign.estimation.uncertainty.intervals import intervals
from flexdesign.measurements.noise_level import allowed_excess

Array = NDArray[np.float64]
#: A sample so many standard deviations of its run from zero is a jump, and so many jumps are no chance: in Gaussian
#: noise one sample in five hundred million lies as far.
JUMP, JUMPS = 6.0, 3
#: Standard deviation of Gaussian noise over the median of its size.
GAUSSIAN = 1.4826


@dataclass(frozen=True)
class Remainder:
    """How a stand's remainder compares with the noise.

    Parameters
    ----------
    excess
        Mean square of what is left, whitened, less that of noise, of the runs that were fitted and of those kept apart:
        the larger one.
    allowed
        What counts as none.
    raw
        What is left above the noise on the runs that judge, rms [response].
    jumps
        Sudden changes in what is left, whitened, of the runs that were fitted.
    """

    excess: float
    allowed: float
    raw: float
    jumps: int = 0

    @property
    def is_noise(self) -> bool:
        """Tell whether nothing but noise is left."""
        return self.excess <= self.allowed and self.jumps < JUMPS


def remainder(setting: Setting, stand: Stand) -> Remainder:
    """Return how what a stand leaves compares with the noise."""
    margins = [(ratio - 1, allowed_excess(count, level)) for ratio, count, level in _ratios(setting, stand)]
    excess, allowed = max(margins, key=lambda pair: pair[0] - pair[1])
    left = setting.error(stand) ** 2 - setting.floor**2
    return Remainder(excess, allowed, math.sqrt(max(left, 0.0)), _jumps(setting, stand))


def _ratios(setting: Setting, stand: Stand) -> Iterator[tuple[float, int, float]]:
    """Yield mean squares of what is left, whitened, with their counts and twice the relative error of the noise.

    Runs and frequency responses are judged apart: these have so few values that they would drown among those.
    """
    level = 2 * setting.noise.relative_error
    pairs = list(zip(stand.solution.problem.suite.records, stand.solution.residuals, strict=True))
    kinds = [(level, [pair for pair in pairs if pair[0].observation.name not in setting.lines])]
    kinds += [(_line_level(setting), [pair for pair in pairs if pair[0].observation.name in setting.lines])]
    for error, seen in kinds:
        if count := int(sum(record.present.sum() for record, _ in seen)):
            yield sum(float(part @ part) for _, part in seen) / count, count, error
    held = 0.0
    judging = [each for each in setting.responses if each.role == "validate"]
    if judging:
        left = [(stand.remainders[e.name] / setting.lines[e.name].of_values)[np.tile(e.present, 2)] for e in judging]
        held = float(sum(part @ part for part in left))
        values = sum(len(part) for part in left)
        yield held / values, values, _line_level(setting)
    if kept := sum(int(np.isfinite(run.measured()).sum()) for run in setting.of("validate")):
        yield (stand.held_cost - held) / kept, kept, level


def _line_level(setting: Setting) -> float:
    """Return twice the relative error of the noise of frequency responses."""
    return max((math.sqrt(2 / noise.dof) if noise.dof else math.inf for noise in setting.lines.values()), default=0.0)


def _jumps(setting: Setting, stand: Stand) -> int:
    """Count the jumps in what is left; a reading in coarse steps has them by itself."""
    if setting.coarse_step is not None:
        return 0
    count = 0
    for record, part in zip(stand.solution.problem.suite.records, stand.solution.residuals, strict=True):
        if record.observation.name in setting.lines:  # neighbouring lines are no neighbours in time
            continue
        left = np.abs(part[: len(record.measured)][record.present])
        count += int((left > JUMP * GAUSSIAN * np.median(left)).sum())
    return count


def levels(course: Course) -> list[Stand]:
    """Return the fits from the calibrated model on, each with further effects."""
    return [course.calibrated, *course.stands]


def decide(
    setting: Setting, course: Course, left: Rival, is_better_smooth: Callable[[Stand, Stand], bool]
) -> tuple[Verdict, Stand]:
    """Return the verdict, and the fit whose effects are named.

    Beside an adequate model all effects are. Else each must explain `LARGE` times what remains unexplained after the
    last one that is named, in mean squares: of a large and certain share one may speak, whatever else the model lacks.
    And the smooth functions that describe the remainder must not do better in the place of the effects, which would
    then be an approximation of something else.

    Parameters
    ----------
    setting, course, left
        What was diagnosed, how it went, and what smooth functions explain of the residual of the last fit.
    is_better_smooth
        Tells for the calibrated model and one with effects whether smooth functions do better than these.
    """
    every = levels(course)
    if is_adequate(setting, course.final, left) and not course.final.at_bound():
        return ("effects-found", course.final) if course.final.effects else ("nothing-missing", course.calibrated)
    rests = np.array([_unexplained_squares(setting, stand) for stand in every])
    added = np.maximum(np.diff([[len(stand.effects)] for stand in every], axis=0), 1)
    for named in range(len(every) - 1, 0, -1):
        is_large = np.all(-np.diff(rests[: named + 1], axis=0) >= LARGE * added[:named] * rests[named])
        if is_large and not every[named].at_bound() and not is_better_smooth(every[0], every[named]):
            return "effects-found", every[named]
    return "unknown", course.calibrated


def _unexplained_squares(setting: Setting, stand: Stand) -> tuple[float, float]:
    """Return what remains of the validation runs above the noise: mean square [response^2], and whitened chi^2."""
    count = sum(int(np.isfinite(run.measured()).sum()) for run in setting.of("validate"))
    held = stand.held_cost - count if count else stand.seen_cost - stand.solution.problem.suite.samples
    return max(setting.error(stand) ** 2 - setting.known_floor**2, 0.0), max(held, 0.0)


def conclude(
    model: StageModel,
    setting: Setting,
    course: Course,
    left: Rival,
    verdict: Verdict,
    ladder: Sequence[Stand],
    groups: tuple[tuple[str, ...], ...],
    moved: Sequence[Conflict],
    implied: Sequence[Conflict],
    alone: Array | None = None,
    by_run: Mapping[str, ByRun] | None = None,
) -> Diagnosis:
    """Return the diagnosis.

    Parameters
    ----------
    model, setting, course
        What was diagnosed, and how it went.
    left
        What smooth functions explain of the residual of the last fit.
    verdict, ladder
        The verdict; and the fits from the model as designed and as calibrated to the last whose effects are named.
    groups
        Effects that the runs cannot tell apart, one of each among those that are named.
    moved, implied
        Numbers that moved beyond what was known of them, and those among them that stand for an effect.
    alone
        Residual of the runs that errors are stated of, if nothing is fitted but their offsets [response].
    by_run
        Numbers of the effects that are named which differ from run to run, by their names.
    """
    final, (_, calibrated, *_) = ladder[-1], ladder
    is_noise = is_adequate(setting, course.final, left)
    doubt = "" if is_noise else _in_words(setting, remainder(setting, course.final), left)
    effects = tuple(with_runs(_named(setting, ladder[1:], name), by_run or {}) for name in final.names)
    if implied:
        verdict = "effects-found"
        effects = (*effects, *(conflict.named for conflict in implied if conflict.named))
        groups = (*groups, *(conflict.group for conflict in implied if len(conflict.group) > 1))
    return Diagnosis(
        verdict=verdict,
        axis=setting.name,
        before=model,
        model=model_of(model, setting, final, implied),
        effects=effects,
        confusable=groups,
        near=tuple(name for name in course.final.names if name not in final.names),
        candidates=_tried(course.steps),
        ladder=(*_offset_rung(alone), *_rungs(setting, ladder)),
        calibration=values_of(final, own_numbers(final)),
        conflicts=tuple(conflict.words for conflict in moved),
        noise=setting.noise,
        noise_floor=setting.floor,
        validation_error=setting.test_error(final),
        rival=left,
        remainder=doubt,
        remainder_rms=0.0 if is_noise else _unexplained_on_tests(setting, final),
        stroke=setting.stroke,
        tolerance=setting.tolerance,
        undetermined=course.undetermined,
        remainders={"calibrated": calibrated.remainders, "found": final.remainders},
        runs=setting.runs,
        confidence=_confidence(setting, course),
        evaluations=0,
        seconds=0.0,
        responses=setting.responses,
        lines=setting.lines,
    )


def unexplained(setting: Setting, stand: Stand) -> float:
    """Return the rms residual above the noise of the runs that judge [response]; all of it where that is unknown."""
    return math.sqrt(max(setting.error(stand) ** 2 - setting.known_floor**2, 0.0))


def is_adequate(setting: Setting, stand: Stand, left: Rival) -> bool:
    """Tell whether no more than noise remains, or no more than what matters to the user."""
    if (setting.is_asked or not setting.noise.known) and unexplained(setting, stand) <= setting.tolerance:
        return True
    # Smooth functions that explain something show that there is something, however small it is beside the noise.
    explainable = left.held_gain > 0 and left.moved > setting.tolerance and left.gain > 0
    if not setting.noise.known:  # a white residual may be noise, whatever its size
        return stand.is_white and not explainable
    return remainder(setting, stand).is_noise and not explainable


def _confidence(setting: Setting, course: Course) -> str:
    """Return what weakens the verdict, in words."""
    said = []
    if not setting.noise.known:
        said.append(
            "the noise of these runs is unknown: evidence is weighed by the share that is explained, and nothing says "
            "how much of the residual is noise"
        )
    if course.is_refused:
        said.append(
            "calibration makes the validation runs worse, so that the structure of the model is wrong for these runs; "
            "the design values were kept"
        )
    return "; ".join(said)


def _in_words(setting: Setting, final: Remainder, left: Rival) -> str:
    share = f"{math.sqrt(1 + max(final.excess, 0.0)):.3g} times the noise remains"
    if not setting.noise.known:
        share = "the residual remains"
    if final.jumps >= JUMPS:
        share += f", with {final.jumps} sudden jumps"
    if not left.terms:
        return f"{share}; no smooth function of position, velocity, voltage or time explains it"
    best = sorted(left.shares, key=lambda name: -left.shares[name])[:3]
    return f"{share}; of smooth functions these explain most: {', '.join(best)}"


def ladder_of(course: Course, final: Stand) -> list[Stand]:
    """Return the fits from the calibrated one to the one whose effects are named."""
    every = levels(course)
    place = next(i for i, stand in enumerate(every) if {*final.names} <= {*stand.names})
    return [*every[:place], final]


def _unexplained_on_tests(setting: Setting, stand: Stand) -> float:
    """Return the rms residual above the noise of what errors are stated of [response]."""
    floor = setting.floor if setting.noise.known else 0.0
    return math.sqrt(max(setting.test_error(stand) ** 2 - floor**2, 0.0))


def _named(setting: Setting, ladder: Sequence[Stand], name: str) -> Named:
    final = ladder[-1]
    effect = next(effect for effect in final.effects if effect.name == name)
    shares = [_share(setting, ladder, name, setting.judging, setting.floor if setting.noise.known else 0.0)]
    if setting.runs and (judging := [each.name for each in setting.responses if each.role != "identify"]):
        floor = math.sqrt(float(np.mean([setting.noise.rms[each] ** 2 for each in judging])))
        shares.append(_share(setting, ladder, name, judging, floor))  # what runs do not show a response may
    return Named(name, values_of(final, effect.free), max(shares))


def _share(setting: Setting, ladder: Sequence[Stand], name: str, judging: Sequence[str], floor: float) -> float:
    """Return the share of the mean square that calibration leaves unexplained which an effect explains."""
    errors = [stand.rms(judging, setting.scales) for stand in ladder]
    place = next((i for i, stand in enumerate(ladder) if name in stand.names), len(ladder) - 1)
    before, after = errors[place - 1] ** 2, errors[place] ** 2
    return float(np.clip((before - after) / max(errors[0] ** 2 - floor**2, 1e-300), 0.0, 1.0))


def values_of(stand: Stand, names: Sequence[str], known_variance: float | None = 1.0) -> tuple[Value, ...]:
    """Return fitted numbers with their 95 % intervals, by the profile likelihood.

    Parameters
    ----------
    stand, names
        The fit, and its numbers that are asked for.
    known_variance
        Of the whitened residual where the noise is known; None where it is not.
    """
    where, x = stand.solution.problem.where, stand.solution.x
    present = where.values(x)
    shown = [name for name in where.names if name in names]
    found = intervals(stand.solution, shown, known_variance=known_variance)
    return tuple(Value(e.parameter, present[e.name], e.interval or e.parameter.plausible) for e in found)


def own_numbers(stand: Stand) -> list[str]:
    """Return the free numbers that belong to the model itself."""
    of_effects = {name for effect in stand.effects for name in effect.free}
    return [p.name for p in stand.solution.problem.where.parameters if not p.run and p.name not in of_effects]


def _tried(steps: Sequence[Step]) -> tuple[Tried, ...]:
    found = []
    for step in steps:
        for trial in step.trials:
            beside = trial.stand.names[: len(trial.stand.names) - len(trial.names)]
            outcome = (
                "added"
                if step.chosen and trial.names == step.chosen.names
                else trial.reason or _not_chosen(step, trial)
            )
            evidence = trial.gain / trial.needed if trial.needed else 0.0
            found.append(Tried(trial.names, beside, trial.error, evidence, outcome))
    return tuple(found)


def _not_chosen(step: Step, trial: Trial) -> str:
    is_alike = any(trial.names == other.names for other in step.alike)
    return "these runs cannot tell it from what was added" if is_alike else "explains less"


def _offset_rung(alone: Array | None) -> tuple[Rung, ...]:
    """Return the first step of the ladder, which shows what the initial conditions of the runs explain."""
    return () if alone is None else (Rung("as designed, offsets alone", float(np.sqrt(np.nanmean(alone**2)))),)


def _rungs(setting: Setting, ladder: Sequence[Stand]) -> tuple[Rung, ...]:
    designed, calibrated, *added = ladder
    rungs = [
        Rung("as designed", setting.test_error(designed)),
        Rung("recalibrated", setting.test_error(calibrated)),
    ]
    before: tuple[str, ...] = ()
    for stand in added:
        label = [f"+ {name}" for name in stand.names if name not in before]
        label += [f"- {name}" for name in before if name not in stand.names]
        rungs.append(Rung(" ".join(label), setting.test_error(stand)))
        before = stand.names
    return tuple(rungs)


def model_of(model: StageModel, setting: Setting, stand: Stand, implied: Sequence[Conflict] = ()) -> StageModel:
    """Return the stage model with what was fitted, and with what its numbers stand for that moved too far."""
    dynamics = with_means(stand)
    for conflict in implied:
        dynamics = conflict.written(dynamics)
    axis = dynamics.axis
    rested = setting.axis.effects.get("bouc_wen", {}).get("rest")
    if rested:  # where a stage rests in simulations is not for records to say, each of which begins elsewhere
        axis = replace(axis, effects={**axis.effects, "bouc_wen": {**axis.effects["bouc_wen"], "rest": rested}})
    axes = {**model.axes, setting.name: axis}
    return replace(model, axes=axes, controller=replace(model.controller, delay=dynamics.delay))
