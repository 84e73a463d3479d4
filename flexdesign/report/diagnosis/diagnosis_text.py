"""How a diagnosis is put into words: the verdict, what is missing and by how much, and what to do about it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from flexdesign import effects
from flexdesign.core import units
from flexdesign.diagnosis import Diagnosis, ErrorStep, IdentifiedEffect, Value
from flexdesign.diagnosis.discriminating_experiments import Proposal
from flexdesign.diagnosis.effect_selection.estimation_setup import FITS_BETTER
from flexdesign.diagnosis.experiment_design import Resolved
from flexdesign.diagnosis.residual_comparison import ModelResiduals, compared
from flexdesign.dynamics.axis.axis_run import doubts
from flexdesign.estimation import Estimate
from flexdesign.measurements.recordings import FrequencyResponse, Run
from flexdesign.report import comparison_text as words
from flexdesign.report.diagnosis import response_pages

#: Half-width of a 95 % interval, in standard deviations.
HALF_WIDTH = 1.96
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


def verdict(found: Diagnosis) -> str:
    """Return the verdict in a few sentences: what is missing, the error with it, and the residual."""
    error = of_line(found, found.validation_error) + words.error(response(found), found.validation_error)
    error += _of_stroke(found, found.validation_error)
    runs = validated_on(recorded(found))
    if found.verdict == "nothing-missing":
        return f"Nothing is missing. The recalibrated model predicts {runs} within {error} rms; {_noise(found)}."
    if found.verdict == "unknown":
        sentences = "Something is missing, and no effect known here explains a large and certain share of it"
        return f"{sentences}. The recalibrated model misses {runs} by {error} rms; {_noise(found)}."
    names = [_alternatives(found, named.name) for named in found.effects]
    missing, it = ("; " if found.confusable else ", ").join(names), "them" if len(names) > 1 else "it"
    return f"Missing: {missing}. With {it} the model misses {runs} by {error} rms; {_noise(found)}.{_remains(found)}"


def _remains(found: Diagnosis) -> str:
    """Return how much the named effects leave unexplained, as a further sentence; empty if the residual is noise."""
    if not found.remainder_rms:
        return ""
    size = words.error(response(found), found.remainder_rms)
    ratio = found.remainder_rms / found.noise_floor
    times = f"{units.significant(ratio, 2)} times the noise, " if found.noise.known else ""
    line = of_line(found, found.remainder_rms).removesuffix(", ")
    share = line or (f"{words.percent(found.remainder_rms / found.stroke)} of the stroke" if found.stroke else "")
    return f" What remains, {size} ({times}{share}), is no effect that is known here."


def possible(found: Diagnosis) -> str:
    """Return the effects that may be there without being certain, what each explains, and how it is fitted."""
    names = words.listed([f"{effect_name(n)} ({words.percent(s)})" for n, s in found.possible_effects.items()])
    lines = "; ".join(f"flexdesign add MODEL {name} RUNS" for name in found.possible_effects)
    each = "each of them" if len(found.possible_effects) > 1 else "it"
    return (
        f"Possible, but not certain, with the explained share of what calibration leaves: {names}. An effect is named "
        "if it explains twice what then remains, and if smooth functions do not explain more in its place. "
        f"To fit {each} all the same: {lines}."
    )


def undetermined(found: Diagnosis) -> str:
    """Return which numbers these runs cannot show, and so keep the values of the design or of the catalogue.

    Where these predict the validation runs worse, fitted values stay, without an interval.
    """
    names = words.listed([name.replace("_", " ").replace(".", ": ") for name in found.undetermined])
    return f"These runs do not determine {names}; held at values of the design, of the catalogue or of a fit."


def effect(found: Diagnosis, named: IdentifiedEffect) -> str:
    """Return an effect with its numbers, what it explains and what to do about it, in some sentences."""
    values = "; ".join(quantity(value, short=True) for value in named.values)
    name = _sentence(effect_name(named.name))
    sentences = (
        f"{name}: {values}" if values else f"{name}: seen in the model's own numbers ({'; '.join(found.conflicts)})"
    )
    if named.by_run:
        sentences += f", the mean over runs; it differs from run to run, {_between(named)}"
    if named.values:
        others = _added_together(found, named.name)
        it = f"Together with {words.listed([effect_name(other) for other in others])} it" if others else "It"
        if named.share > 0:  # else recalibration left no more than the noise
            sentences += f". {it} explains {words.percent(named.share)} of what recalibration leaves unexplained"
    return f"{sentences}. What to do about it: {remedy(found, named.name)}."


def _between(named: IdentifiedEffect) -> str:
    """Return between which values the number of an effect lies that differs from run to run."""
    ends = sorted(named.by_run.values(), key=lambda value: value.value)
    return f"from {estimated(ends[0]).value_text} to {estimated(ends[-1]).value_text}"


def remedy(found: ModelResiduals, name: str) -> str:
    """Return what one can do about an effect, with the actuator that the model states."""
    return effects.find(name).remedy_for(found.before.axes[found.axis].driven_by)


def quantity(value: Value, *, short: bool = False) -> str:
    """Return a number with its 95 % interval."""
    estimate = estimated(value)
    name = value.parameter.name.rpartition(".")[2] if short else value.parameter.name
    return f"{name} {estimate.value_text} (95 %: {estimate.interval_text})"


def estimated(value: Value) -> Estimate:
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


def summary(found: Diagnosis, proposals: Sequence[Proposal]) -> list[str]:
    """Return the answer in a few paragraphs."""
    sentences = [*doubts(found.runs), verdict(found), *(effect(found, named) for named in found.effects)]
    sentences += [apart(group, proposals) for group in found.confusable]
    if found.possible_effects:
        sentences.append(possible(found))
    if found.verdict == "unknown" or found.remainder_rms:
        left, mode = compared(found, "found"), found.before.axes[found.axis].natural_frequency
        looks = words.sentences(left) if found.runs else []
        looks += response_pages.sentences(left.responses, mode) if found.responses else []
        shape = f" {_sentence(found.remainder)}." if found.remainder else ""
        sentences.append(f"What remains looks like this. {' '.join(looks)}{shape}")
    if found.undetermined:
        sentences.append(undetermined(found))
    if found.conflicts and all(named.values for named in found.effects):
        sentences.append(f"Beyond the prior of the model: {'; '.join(found.conflicts)}.")
    if found.confidence:
        sentences.append(f"Take care: {found.confidence}.")
    remarks = {remark for run in found.runs for remark in run.remarks}
    sentences += [f"Take care: {assumed}." for assumed in FITS_BETTER.values() if assumed in remarks]
    return sentences


def validated_on(runs: Sequence[Run | FrequencyResponse]) -> str:
    """Return which runs errors are stated of, in words."""
    for role, kind in (("test", "test"), ("validate", "validation")):
        validation_runs = [run.name.removesuffix(f":{role}") for run in runs if run.role == role]
        if validation_runs and any(isinstance(run, FrequencyResponse) for run in runs):
            return f"the {kind} lines of {words.listed(validation_runs)}"
        if validation_runs:
            return (
                f"the {len(validation_runs)} {kind} runs"
                if len(validation_runs) > 1
                else f"the {kind} run {validation_runs[0]}"
            )
    return "the fitted runs (there are no validation runs)"


def response(found: ModelResiduals) -> str:
    """Return the SI unit of errors: that of the response, per volt where there are frequency responses alone."""
    si = found.before.axes[found.axis].response_units
    return si if found.runs else si.per_volt


def of_line(found: ModelResiduals, error: float) -> str:
    """Return an error of frequency responses as a share of the line, as its size follows; nothing where runs judge."""
    size = response_pages.line_size(found)
    return f"{words.percent(error / size)} of the line, " if math.isfinite(size) else ""


def recorded(found: ModelResiduals) -> Sequence[Run | FrequencyResponse]:
    """Return what the errors of the ladder are of: the runs, or frequency responses where there are no runs."""
    return found.runs or found.responses


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


def _added_together(found: Diagnosis, name: str) -> list[str]:
    """Return the effects that were added in one step with another."""
    steps = [tried.names for tried in found.candidates if tried.outcome == "added" and name in tried.names]
    return [other for names in steps for other in names if other != name]


def _alternatives(found: Diagnosis, name: str) -> str:
    group = next((group for group in found.confusable if group[0] == name), (name,))
    return " or ".join(effect_name(each) for each in group)


def _noise(found: Diagnosis) -> str:
    if not found.noise.known:
        return "the noise is unknown"
    return f"the noise is {words.error(response(found), found.noise_floor, 2)}"


def _of_stroke(found: Diagnosis, error: float) -> str:
    return f" ({words.percent(error / found.stroke)} of the stroke)" if found.runs and found.stroke else ""


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
