"""The judgement: whether something is missing, whether it is known, and what these runs cannot tell apart."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from flexdesign.diagnosis.conflicts import HALF_WIDTH, Conflict, conflicts
from flexdesign.diagnosis.findings import Diagnosis, Named, Rung, Tried, Value, Verdict
from flexdesign.dynamics.axis_model import AxisDynamics
from flexdesign.evidence.coordinates import value
from flexdesign.evidence.rival import Rival
from flexdesign.evidence.stand import Stand
from flexdesign.evidence.trial import LESS, Step, Trial
from flexdesign.stage_model import StageModel

if TYPE_CHECKING:
    from flexdesign.diagnosis.course import Course
    from flexdesign.diagnosis.setting import Setting

#: What is left counts as noise if its mean square, whitened, is above one by no more than this ...
ADEQUATE = 0.09
#: ... and by no more than so many standard errors, of chance and of the noise level together.
ERRORS = 3.5
#: A sample so many standard deviations of its run from zero is a jump, and so many jumps are no chance: in Gaussian
#: noise one sample in five hundred million lies as far.
JUMP, JUMPS = 6.0, 3
#: Effects explain enough where what is left is no more than this share of what was unexplained (in squares).
EXPLAINED = 0.01
#: Standard deviation of Gaussian noise over the median of its size.
GAUSSIAN = 1.4826
#: Not more effects than these make a group that the runs cannot tell apart.
LARGEST_GROUP = 3


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
    margins = [
        (ratio - 1, ADEQUATE + ERRORS * math.hypot(math.sqrt(2 / count), level))
        for ratio, count, level in _ratios(setting, stand)
    ]
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


def conclude(model: StageModel, setting: Setting, course: Course, before: Rival, left: Rival) -> Diagnosis:
    """Return the diagnosis.

    Parameters
    ----------
    model, setting, course
        What was diagnosed, and how it went.
    before, left
        What smooth functions explain without effects, and of what these leave.
    """
    final = course.final
    verdict, doubt = _verdict(setting, course, before, left)
    moved = conflicts(setting, final)
    implied = [conflict for conflict in moved if conflict.named is not None and verdict != "unknown"]
    effects = tuple(_named(setting, course, name) for name in final.names)
    groups = _groups(course)
    if implied:
        verdict = "effects-found"
        effects = (*effects, *(conflict.named for conflict in implied if conflict.named))
        groups = (*groups, *(conflict.group for conflict in implied if len(conflict.group) > 1))
    known = verdict == "effects-found"
    return Diagnosis(
        verdict=verdict,
        axis=setting.name,
        before=model,
        model=model_of(model, setting, final if known else course.calibrated, implied),
        effects=effects if known else (),
        confusable=groups if known else (),
        near=final.names if verdict == "unknown" else (),
        candidates=_tried(course.steps),
        ladder=_ladder(setting, course),
        calibration=values_of(course.final, own_numbers(course.final)),
        conflicts=tuple(conflict.words for conflict in moved),
        noise=setting.noise,
        noise_floor=setting.floor,
        validation_error=setting.error(final),
        rival=left,
        remainder=doubt,
        remainders={"calibrated": course.calibrated.remainders, "found": final.remainders},
        runs=setting.runs,
        confidence="" if setting.noise.known else "the noise is unknown; it was guessed from neighbouring samples",
        evaluations=0,
        seconds=0.0,
        responses=setting.responses,
        lines=setting.lines,
    )


def _verdict(setting: Setting, course: Course, before: Rival, left: Rival) -> tuple[Verdict, str]:
    """Return the verdict, and what is left above the noise in words."""
    final, at_first = remainder(setting, course.final), remainder(setting, course.calibrated)
    # Smooth functions that explain something show that there is something, however small it is beside the noise.
    explainable = left.held_gain > 0 and left.moved > setting.tolerance and left.gain > 0
    if final.is_noise and not explainable:
        return ("effects-found" if course.final.effects else "nothing-missing"), ""
    words = _in_words(final, left)
    if not course.final.effects:
        return "unknown", words
    stays = max(final.excess, 0.0) / max(at_first.excess, 1e-300)
    fallen = course.calibrated.held_cost - course.final.held_cost
    if stays <= EXPLAINED and fallen >= before.held_gain:
        return "effects-found", words
    return "unknown", words


def _in_words(final: Remainder, left: Rival) -> str:
    share = f"{math.sqrt(1 + max(final.excess, 0.0)):.3g} times the noise stays"
    if final.jumps >= JUMPS:
        share += f", with {final.jumps} sudden jumps"
    if not left.terms:
        return f"{share}; no smooth function of position, velocity, voltage or time explains it"
    best = sorted(left.shares, key=lambda name: -left.shares[name])[:3]
    return f"{share}; of smooth functions these explain most: {', '.join(best)}"


def _named(setting: Setting, course: Course, name: str) -> Named:
    final = course.final
    effect = next(effect for effect in final.effects if effect.name == name)
    shares = [_share(setting, course, name, setting.judging, setting.floor)]
    if setting.runs and (judging := [each.name for each in setting.responses if each.role == "validate"]):
        floor = math.sqrt(float(np.mean([setting.noise.rms[each] ** 2 for each in judging])))
        shares.append(_share(setting, course, name, judging, floor))  # what runs do not show, a frequency response may
    return Named(name, values_of(final, effect.free), max(shares))


def _share(setting: Setting, course: Course, name: str, judging: Sequence[str], floor: float) -> float:
    """Return how much of what recalibration leaves of some observations an effect explains, in squares."""
    errors = [stand.rms(judging, setting.scales) for stand in (course.calibrated, *course.stands)]
    place = next((i for i, stand in enumerate(course.stands) if name in stand.names), len(course.stands) - 1)
    before, after = errors[place] ** 2, errors[place + 1] ** 2
    unexplained = max(errors[0] ** 2 - floor**2, 1e-300)
    return float(np.clip((before - after) / unexplained, 0.0, 1.0))


def values_of(stand: Stand, names: Sequence[str]) -> tuple[Value, ...]:
    """Return fitted numbers with their intervals."""
    where, x = stand.solution.problem.where, stand.solution.x
    scale = max(stand.cost / stand.solution.problem.suite.samples, 1.0)
    sigma = np.sqrt(np.maximum(np.diag(stand.solution.covariance), 0.0) * scale)
    found = []
    for j, parameter in enumerate(where.parameters):
        if parameter.name in names:
            ends = np.clip([x[j] - HALF_WIDTH * sigma[j], x[j] + HALF_WIDTH * sigma[j]], where.lower[j], where.upper[j])
            low, high = sorted(value(parameter, float(end)) for end in ends)
            found.append(Value(parameter, value(parameter, float(x[j])), (low, high)))
    return tuple(found)


def own_numbers(stand: Stand) -> list[str]:
    """Return the free numbers that belong to the model itself."""
    of_effects = {name for effect in stand.effects for name in effect.free}
    return [p.name for p in stand.solution.problem.where.parameters if not p.run and p.name not in of_effects]


def _groups(course: Course) -> tuple[tuple[str, ...], ...]:
    """Return the groups that the runs cannot tell apart, the chosen effect first."""
    groups = []
    for step in course.steps:
        chosen = step.chosen.names if step.chosen else ()
        for name in chosen:
            beside = {*chosen} - {name}
            alike = [trial.names for trial in step.alike if len(trial.names) == len(chosen)]
            others = [other for names in alike if beside <= {*names} for other in names if other not in beside]
            if others and name in course.final.names:
                groups.append((name, *others[: LARGEST_GROUP - 1]))
    return tuple(groups)


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
    return "these runs cannot tell it from what was added" if is_alike else LESS


def _ladder(setting: Setting, course: Course) -> tuple[Rung, ...]:
    rungs = [
        Rung("as designed", setting.error(course.designed)),
        Rung("recalibrated", setting.error(course.calibrated)),
    ]
    before: tuple[str, ...] = ()
    for stand in course.stands:
        new = [name for name in stand.names if name not in before]
        rungs.append(Rung(f"+ {' + '.join(new)}", setting.error(stand)))
        before = stand.names
    return tuple(rungs)


def model_of(model: StageModel, setting: Setting, stand: Stand, implied: Sequence[Conflict] = ()) -> StageModel:
    """Return the stage model with what was fitted, and with what its numbers stand for that moved too far."""
    dynamics = cast(AxisDynamics, stand.model)
    for conflict in implied:
        dynamics = conflict.written(dynamics)
    axis = dynamics.axis
    rested = setting.axis.effects.get("bouc_wen", {}).get("rest")
    if rested:  # where a stage rests in simulations is not for records to say, each of which begins elsewhere
        axis = replace(axis, effects={**axis.effects, "bouc_wen": {**axis.effects["bouc_wen"], "rest": rested}})
    axes = {**model.axes, setting.name: axis}
    return replace(model, axes=axes, controller=replace(model.controller, delay=dynamics.delay))
