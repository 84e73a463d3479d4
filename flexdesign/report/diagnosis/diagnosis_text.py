"""How a diagnosis is put into words: the verdict, what is missing and by how much, and what to do about it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from flexdesign import effects
from flexdesign.core import units
from flexdesign.core.errors import join_names
from flexdesign.core.model import ACTUATORS
from flexdesign.diagnosis import Diagnosis, ErrorStep, IdentifiedEffect, Value
from flexdesign.diagnosis.experiment_design.discrimination import Proposal, Resolved
from flexdesign.diagnosis.procedure import INTERPOLATION_TEXTS
from flexdesign.diagnosis.result import ModelResiduals, compare_model
from flexdesign.diagnosis.windowed_selection import SEARCHED
from flexdesign.dynamics.axis.axis_run import doubts
from flexdesign.estimation import Estimate
from flexdesign.estimation.criterion import HALF_WIDTH, LARGE, large_share
from flexdesign.measurements.recordings import FrequencyResponse, Run
from flexdesign.report import comparison_text as words
from flexdesign.report.diagnosis import response_pages

#: Effects that are mentioned although they are refused.
MOST_REFUSED = 3
#: Effects that are called after people.
PROPER = {
    "abbe_error": "Abbe error",
    "bouc_wen": "Bouc-Wen hysteresis",
    "coulomb_friction": "Coulomb friction",
    "prandtl_ishlinskii": "Prandtl-Ishlinskii hysteresis",
}


def effect_name(name: str) -> str:
    """Return what an effect is called in a sentence.

    >>> effect_name("stress_stiffening"), effect_name("bouc_wen"), effect_name("second_mode.2")
    ('stress stiffening', 'Bouc-Wen hysteresis', 'another second mode (second_mode.2)')
    """
    if effects.original(name) != name:
        return f"another {effect_name(effects.original(name))} ({name})"
    own = effects.find(name).name
    return PROPER.get(own, own.replace("_", " "))


def verdict(diagnosis: Diagnosis) -> str:
    """Return the verdict in a few sentences: what is missing, the error with it, and the residual."""
    error = of_line(diagnosis, diagnosis.error) + words.error(response(diagnosis), diagnosis.error)
    error += _of_stroke(diagnosis, diagnosis.error)
    runs = validated_on(observations(diagnosis))
    if diagnosis.verdict == "nothing-missing":
        sentences = f"Nothing is missing. The recalibrated model predicts {runs} within {error} rms"
        return f"{sentences}; {_noise(diagnosis)}.{_remains(diagnosis)}"
    if diagnosis.verdict == "unknown":
        sentences = "Something is missing, and no effect known here explains a large and certain share of it"
        return f"{sentences}. The recalibrated model misses {runs} by {error} rms; {_noise(diagnosis)}."
    names = [_alternatives(diagnosis, named.name) for named in diagnosis.effects]
    missing, it = ("; " if diagnosis.confusable else ", ").join(names), "them" if len(names) > 1 else "it"
    sentence = f"Missing: {missing}. With {it} the model misses {runs} by {error} rms; {_noise(diagnosis)}."
    return sentence + _remains(diagnosis)


def _remains(diagnosis: Diagnosis) -> str:
    """Return how much the named effects leave unexplained, as a further sentence; empty if the residual is noise.

    A residual that counts as noise may be larger than the noise that quiet stretches show.
    """
    if not diagnosis.remainder_rms:
        ratio = diagnosis.error / diagnosis.noise_floor if diagnosis.noise.known else 0.0
        if ratio < LARGE:
            return ""
        return (
            f" That is {units.significant(ratio, 2)} times the noise. It counts as noise, as these runs show that too "
            "briefly, or a stated tolerance covers it."
        )
    size = words.error(response(diagnosis), diagnosis.remainder_rms)
    ratio = diagnosis.remainder_rms / diagnosis.noise_floor
    times = f"{units.significant(ratio, 2)} times the noise, " if diagnosis.noise.known else ""
    line = of_line(diagnosis, diagnosis.remainder_rms).removesuffix(", ")
    share = line or (
        f"{words.percent(diagnosis.remainder_rms / diagnosis.stroke)} of the stroke" if diagnosis.stroke else ""
    )
    return f" What remains, {size} ({times}{share}), is no effect that is known here."


def possible(diagnosis: Diagnosis) -> str:
    """Return the effects that may be there without being certain, what each explains, and how it is fitted."""
    shares = diagnosis.possible_effects
    added = {name: tried.names for tried in diagnosis.candidates if tried.outcome == "added" for name in tried.names}
    steps = dict.fromkeys(tuple(n for n in added.get(name, ()) if n in shares) or (name,) for name in shares)
    said = {step: f"{'together ' if len(step) > 1 else ''}{words.percent(shares[step[0]])}" for step in steps}
    names = join_names([f"{join_names([effect_name(n) for n in step])} ({share})" for step, share in said.items()])
    lines = "; ".join(f"flexdesign add MODEL {name} RUNS" for name in shares)
    is_one = len(shares) == 1
    return (
        f"Possible, but not certain, with the explained share of what calibration leaves: {names}."
        f"{_why_not_named(diagnosis)} To fit {'it' if is_one else 'each of them'} all the same: {lines}."
    )


def _why_not_named(diagnosis: Diagnosis) -> str:
    """Return why possible effects are not named: a sentence for each reason, with a space before it."""
    by_reason = dict[str, list[str]]()
    for name in diagnosis.possible_effects:
        if name in diagnosis.refusals:
            by_reason.setdefault(diagnosis.refusals[name], []).append(name)
    subjects = {reason: _sentence(join_names([effect_name(n) for n in names])) for reason, names in by_reason.items()}
    if len(by_reason) == 1:
        subjects = dict.fromkeys(by_reason, "It" if len(diagnosis.possible_effects) == 1 else "They")
    verbs = {reason: "is" if len(names) == 1 else "are" for reason, names in by_reason.items()}
    return "".join(f" {subjects[reason]} {verbs[reason]} not named, as {reason}." for reason in by_reason)


def refused(diagnosis: Diagnosis) -> str:
    """Return which effects explain much in the calibrated model but were refused, and why; empty if none does."""
    first = [tried for tried in diagnosis.candidates if not tried.present and tried.evidence > 1]
    near = sorted((t for t in first if t.share >= large_share()), key=lambda tried: -tried.share)[:MOST_REFUSED]
    if not near:
        return ""
    each = "; ".join(
        f"{join_names([effect_name(name) for name in tried.names])}, {words.percent(tried.share)} of what "
        f"calibration leaves on the validation runs ({tried.outcome.replace('_', ' ').replace('.', ': ')})"
        for tried in near
    )
    return (
        f"These would explain much, but are refused: {each}. To fit one all the same: flexdesign add MODEL "
        f"{near[0].names[0]} RUNS."
    )


def undetermined(diagnosis: Diagnosis) -> str:
    """Return which numbers these runs cannot show, and so keep the values of the design or of the catalogue.

    Where these predict the validation runs worse, fitted values stay, without an interval.
    """
    names = join_names([name.replace("_", " ").replace(".", ": ") for name in diagnosis.undetermined])
    return f"These runs do not determine {names}; held at values of the design, of the catalogue or of a fit."


def effect(diagnosis: Diagnosis, named: IdentifiedEffect) -> str:
    """Return an effect with its numbers, what it explains and what to do about it, in some sentences."""
    values = "; ".join(quantity(value, short=True) for value in named.values)
    name = _sentence(effect_name(named.name))
    sentences = (
        f"{name}: {values}"
        if values
        else f"{name}: seen in the parameters of the model ({'; '.join(diagnosis.conflicts)})"
    )
    if named.by_run:
        sentences += f", the mean over runs; it differs from run to run, {_range_over_runs(named)}"
    if named.values:
        others = _added_together(diagnosis, named.name)
        it = f"Together with {join_names([effect_name(other) for other in others])} it" if others else "It"
        if named.share > 0:  # else recalibration left no more than the noise
            sentences += f". {it} explains {words.percent(named.share)} of what recalibration leaves unexplained"
    return f"{sentences}. What to do about it: {remedy(diagnosis, named.name)}.{_whose(diagnosis, named.name)}"


def _whose(diagnosis: Diagnosis, name: str) -> str:
    """Return which actuators have an effect, where the model does not say what drives the axis; else nothing."""
    its = effects.find(name).actuators
    if its == ACTUATORS or diagnosis.before.axes[diagnosis.axis].driven_by:
        return ""
    return (
        f" A {its[0]} has it: if another actuator drives the axis, write its kind in [axis.{diagnosis.axis}.actuator] "
        "and diagnose again."
    )


def _range_over_runs(named: IdentifiedEffect) -> str:
    """Return between which values the number of an effect lies that differs from run to run."""
    ends = sorted(named.by_run.values(), key=lambda value: value.value)
    return f"from {estimate_of(ends[0]).value_text} to {estimate_of(ends[-1]).value_text}"


def remedy(residuals: ModelResiduals, name: str) -> str:
    """Return what one can do about an effect, with the actuator that the model states."""
    return effects.find(name).remedy_for(residuals.before.axes[residuals.axis].driven_by)


def quantity(value: Value, *, short: bool = False) -> str:
    """Return a number with its 95 % interval; one with an interval of all that is plausible is not determined."""
    estimate = estimate_of(value)
    name = value.parameter.name.rpartition(".")[2] if short else value.parameter.name
    low, high = value.parameter.plausible
    if value.interval[0] <= low and value.interval[1] >= high:
        return f"{name} {estimate.value_text} (not determined)"
    return f"{name} {estimate.value_text} (95 %: {estimate.interval_text})"


def estimate_of(value: Value) -> Estimate:
    """Return a number as an estimate, which knows how many of its digits mean something."""
    low, high = value.interval
    width = high - low
    sigma = width / (2 * HALF_WIDTH) if math.isfinite(width) and width > 0 else None
    return Estimate(value.parameter, value.value, sigma, value.interval, True)


def label(step_of_ladder: ErrorStep) -> str:
    """Return what a step of the ladder is called.

    >>> label(ErrorStep("+ creep + mains_hum - bouc_wen", 1e-6))
    '+ creep + mains hum - Bouc-Wen hysteresis'
    """
    if not step_of_ladder.label.startswith("+ "):
        return step_of_ladder.label
    return " ".join(word if word in ("+", "-") else effect_name(word) for word in step_of_ladder.label.split(" "))


def apart(group: Sequence[str], proposals: Sequence[Proposal]) -> str:
    """Return that the runs do not distinguish a group, and what would."""
    sentences = f"These runs do not distinguish {either([effect_name(name) for name in group])}."
    for proposal in proposals:
        if proposal.group == tuple(group):
            sentences += "".join(f" {_would(resolved)}" for resolved in proposal.resolved)
            sentences += f" No experiment could be simulated: {proposal.reason}." if proposal.reason else ""
    return sentences


def summary(diagnosis: Diagnosis, proposals: Sequence[Proposal]) -> list[str]:
    """Return the answer in a few paragraphs."""
    sentences = [
        *doubts(diagnosis.runs),
        verdict(diagnosis),
        *(effect(diagnosis, named) for named in diagnosis.effects),
    ]
    sentences += [apart(group, proposals) for group in diagnosis.confusable]
    if diagnosis.possible_effects:
        sentences.append(possible(diagnosis))
    if diagnosis.verdict == "unknown" and not diagnosis.possible_effects and (near := refused(diagnosis)):
        sentences.append(near)
    if diagnosis.verdict == "unknown" or diagnosis.remainder_rms:
        left, mode = compare_model(diagnosis, "found"), diagnosis.model.axes[diagnosis.axis].natural_frequency
        looks = words.sentences(left) if diagnosis.runs else []
        looks += response_pages.sentences(left.responses, mode) if diagnosis.responses else []
        shape = f" {_sentence(diagnosis.remainder)}." if diagnosis.remainder else ""
        sentences.append(f"What remains looks like this. {' '.join(looks)}{shape}")
    if diagnosis.undetermined:
        sentences.append(undetermined(diagnosis))
    if diagnosis.conflicts and all(named.values for named in diagnosis.effects):
        sentences.append(f"Beyond the prior of the model: {'; '.join(diagnosis.conflicts)}.")
    if diagnosis.confidence:
        sentences.append(f"Take care: {diagnosis.confidence}.")
    remarks = {remark for run in diagnosis.runs for remark in run.remarks}
    sentences += [f"Take care: {assumed}." for assumed in INTERPOLATION_TEXTS.values() if assumed in remarks]
    sentences += [f"{_sentence(remark)}." for remark in sorted(remarks) if SEARCHED in remark]
    return sentences


def validated_on(runs: Sequence[Run | FrequencyResponse]) -> str:
    """Return which runs errors are stated of, in words."""
    for role, kind in (("test", "test"), ("validate", "validation")):
        validation_runs = [run.name.removesuffix(f":{role}") for run in runs if run.role == role]
        if validation_runs and any(isinstance(run, FrequencyResponse) for run in runs):
            return f"the {kind} lines of {join_names(validation_runs)}"
        if validation_runs:
            return (
                f"the {len(validation_runs)} {kind} runs"
                if len(validation_runs) > 1
                else f"the {kind} run {validation_runs[0]}"
            )
    return "the fitted runs (there are no validation runs)"


def response(residuals: ModelResiduals) -> str:
    """Return the SI unit of errors: that of the response, per volt where there are frequency responses alone."""
    si = residuals.before.axes[residuals.axis].response_units
    return si if residuals.runs else si.per_volt


def of_line(residuals: ModelResiduals, error: float) -> str:
    """Return an error of frequency responses as a share of the line, as its size follows; nothing where runs judge."""
    size = response_pages.line_size(residuals)
    return f"{words.percent(error / size)} of the line, " if math.isfinite(size) else ""


def observations(residuals: ModelResiduals) -> Sequence[Run | FrequencyResponse]:
    """Return what the errors of the ladder are of: the runs, or frequency responses where there are no runs."""
    return residuals.runs or residuals.responses


def either(names: Sequence[str]) -> str:
    """Return names as confounded effects.

    >>> either(["creep", "drift", "warmth"])
    'creep from drift or warmth'
    """
    return f"{names[0]} from {' or '.join(names[1:])}"


def _would(resolved: Resolved) -> str:
    """Return which experiments would distinguish two effects, by how many times the noise."""
    other = effect_name(resolved.effects[1].name)
    if not resolved.proposed:
        most = max((each.over_noise for each in resolved.separations), default=0.0)
        return (
            f"No experiment of the menu shows {other} apart by more than {units.significant(most, 2)} times the noise: "
            "record longer, average, or use a better sensor."
        )
    parts = [
        f"{each.command.name.replace('_', ' ')} {units.significant(each.over_noise, 2)}"
        + (f" ({each.command.note})" if each.command.note else "")
        for each in resolved.proposed
    ]
    pair = either([effect_name(effect.name) for effect in resolved.effects])
    return f"What would distinguish {pair}, and by how many times the noise the readings differ: {', '.join(parts)}."


def _added_together(diagnosis: Diagnosis, name: str) -> list[str]:
    """Return the effects that were added in one step with another."""
    steps = [tried.names for tried in diagnosis.candidates if tried.outcome == "added" and name in tried.names]
    return [other for names in steps for other in names if other != name]


def _alternatives(diagnosis: Diagnosis, name: str) -> str:
    group = next((group for group in diagnosis.confusable if group[0] == name), (name,))
    return " or ".join(effect_name(each) for each in group)


def _noise(diagnosis: Diagnosis) -> str:
    if not diagnosis.noise.known:
        return "the noise is unknown"
    return f"the noise is {words.error(response(diagnosis), diagnosis.noise_floor, 2)}"


def _of_stroke(diagnosis: Diagnosis, error: float) -> str:
    return f" ({words.percent(error / diagnosis.stroke)} of the stroke)" if diagnosis.runs and diagnosis.stroke else ""


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
