"""Which experiments distinguish two effects: simulated with either, at strengths that agree on a multisine.

Those that would distinguish confounded effects of a diagnosis are chosen from the menu of the bench.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexdesign import effects
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.diagnosis.experiment_design.commands import Command
from flexdesign.diagnosis.experiment_design.effect_strength import (
    EQUAL_FACTOR,
    VISIBLE_SHARE,
    EffectAtStrength,
    fit_linear,
    names_kind,
    on,
    reading,
    rms,
    signature_of,
)
from flexdesign.diagnosis.experiment_design.experiments import SAME_WITH_MASS, other_excitations, suite_of
from flexdesign.diagnosis.experiment_design.limits import dynamics, of_axis
from flexdesign.diagnosis.preparation.initial_conditions import modes
from flexdesign.diagnosis.result import Diagnosis
from flexdesign.dynamics.axis.axis_model import AxisDynamics

#: A difference of this multiple of the sensor's noise, rms, is clear in one run.
CLEAR_DIFFERENCE = 3.0
#: An effect changes the standard multisine's response by this share of itself at most.
LARGEST_CHANGE = 0.1
#: Relative change of the damping ratio from which its influence is taken.
DAMPING_CHANGE = 0.01
#: Number of corrections of the damping.
DAMPING_CORRECTIONS = 3
#: Number of experiments proposed, one of each kind.
EXPERIMENTS_PROPOSED = 3
#: Without a stated noise of the sensor, this share of the stroke is assumed.
ASSUMED_NOISE = 1e-4
#: Samples in a period of the highest mode where experiments are simulated: their tones end at three times its
#: frequency, well below Nyquist's; a controller may sample a slow stage a thousand times as fast.
SAMPLES_PER_PERIOD = 10


@dataclass(frozen=True)
class Separation:
    """How far one experiment distinguishes two effects.

    Parameters
    ----------
    command
        The experiment.
    first, second
        Readings with either effect, n values [response]; the second refitted to the first.
    difference
        Between the two, rms; of a multisine over its whole periods [response].
    over_noise
        The same over the sensor's noise.
    """

    command: Command
    first: Array
    second: Array
    difference: float
    over_noise: float


@dataclass(frozen=True)
class Resolved:
    """Two effects, and what distinguishes them.

    Parameters
    ----------
    effects
        Both, on the axis without either.
    strengths
        At which they are compared, SI.
    alike
        The remaining difference on the standard multisine, rms [response].
    noise
        Of the sensor, rms [response].
    separations
        Of every experiment, the best first.
    """

    effects: tuple[EffectAtStrength, EffectAtStrength]
    strengths: tuple[float, float]
    alike: float
    noise: float
    separations: tuple[Separation, ...]

    @property
    def proposed(self) -> tuple[Separation, ...]:
        """The best experiment of each kind, three at most, among those whose difference is plain to see."""
        kinds: dict[str, Separation] = {}
        for each in self.separations:
            kind = "added mass" if each.command.mass_ratio else each.command.kind
            if each.over_noise >= CLEAR_DIFFERENCE and each.command.role == "identify":
                kinds.setdefault(kind, each)
        return tuple(kinds.values())[:EXPERIMENTS_PROPOSED]


def resolve_effects(
    model: AxisDynamics, names: tuple[str, str], experiments: Sequence[Command], noise: float
) -> Resolved:
    """Return which experiments distinguish two effects.

    The strength of the first effect changes the response to the standard multisine by 1 % of the stroke, rms, or by a
    tenth of that response where this is less. The strength of the second effect minimises the difference from the first
    there. In every experiment gain, offset and damping of the second are refitted to the first, as they are not known
    well enough; a static push is compared as it is read.

    Parameters
    ----------
    model
        The axis; should it have one of the effects, it is taken away.
    names
        Of both effects.
    experiments
        The menu; the standard multisine among them.
    noise
        Of the sensor, rms [response].

    Raises
    ------
    InputError
        If both effects are the same, or one is not known or does not act in time.
    """
    if names[0] == names[1]:
        raise InputError("command line", "--resolve", " ".join(names), "names one effect twice; name two")
    plain = on(on(model, names[0]).without, names[1]).without
    first, second = on(plain, names[0]), on(plain, names[1])
    standard = next(command for command in experiments if command.name == SAME_WITH_MASS)
    one = _visible(first, standard, experiments)
    target = reading(first.at(one), standard)
    other = _closest_strength(second, standard, target, experiments)
    found = [_separation(command, first.at(one), second.at(other), noise) for command in experiments]
    left = next(each.difference for each in found if each.command is standard)
    words = " ".join(effects.find(name).reveal for name in names)
    ordered = sorted(found, key=lambda each: _rank(each, words), reverse=True)
    return Resolved((first, second), (one, other), left, noise, tuple(ordered))


def required_experiments(experiments: Sequence[Command], resolved: Resolved) -> tuple[Command, ...]:
    """Return those of the experiments that distinguish two effects, and the record of the noise.

    The added mass repeats a multisine, which is then needed as well.
    """
    wanted = {each.command.name for each in resolved.proposed} | {"quiet"}
    if any(each.command.mass_ratio for each in resolved.proposed):
        wanted.add(SAME_WITH_MASS)
    return tuple(command for command in experiments if command.name in wanted)


def steady(command: Command) -> slice:
    """Return the samples that are compared: of a multisine its whole periods, without the ramps before and after."""
    if command.kind != "multisine":
        return slice(None)
    first, last = (round(command.marks[end] / command.period) for end in (0, -1))
    return slice(first, last)


def _rank(each: Separation, reveal: str) -> tuple[float, bool, float]:
    """Return the place of an experiment: among equals those come first that the effects' own words name."""
    seen = each.over_noise
    place = math.floor(math.log(seen) / math.log(EQUAL_FACTOR)) if 0 < seen < math.inf else -math.inf
    return place, names_kind(reveal, each.command.kind), seen


def _visible(effect: EffectAtStrength, standard: Command, experiments: Sequence[Command]) -> float:
    """Return the strength at which an effect changes the response to the standard multisine visibly.

    The change is at most a share of that response, which is small without a resonance. If the multisine does not show
    the effect, the strength is that of the experiment that shows it best.
    """
    without = reading(effect.without, standard)
    cut = steady(standard)
    wanted = min(VISIBLE_SHARE * effect.without.stroke, LARGEST_CHANGE * float(np.std(without[cut])))

    def change(model: AxisDynamics) -> float:
        return rms((reading(model, standard) - without)[cut])

    strength = effect.search(wanted, change)
    if change(effect.at(strength)) > 0.5 * wanted:
        return strength
    return signature_of(effect, experiments).strength


def _closest_strength(
    effect: EffectAtStrength, standard: Command, target: Array, experiments: Sequence[Command]
) -> float:
    """Return the strength at which an effect comes closest to a target on the standard multisine.

    From its visible strength on, of either sign where both are plausible, by golden section over the logarithm.
    """
    from scipy.optimize import minimize_scalar

    visible = _visible(effect, standard, experiments)
    low, high = effect.strength.plausible

    def off(strength: float) -> float:
        return rms((target - _refit(effect.at(strength), standard, target))[steady(standard)])

    best = visible
    for sign in (1.0, -1.0):
        start = sign * visible
        if not low <= start <= high:
            continue
        bounds = (math.log(abs(start) / 30), math.log(abs(start) * 30))
        found = minimize_scalar(
            lambda place, sign=sign: off(math.copysign(1.0, sign * visible) * math.exp(place)),
            bounds=bounds, method="bounded", options={"xatol": 1e-3},
        )  # fmt: skip
        tried = min(max(math.copysign(math.exp(found.x), start), low), high)
        best = min((best, tried), key=off)
    return best


def _refit(model: AxisDynamics, command: Command, target: Array) -> Array:
    """Return a reading with the gain, offset and damping that bring it closest to a target; NaN if it runs away."""
    found = reading(model, command)
    if command.push:  # its force is known, and so is what the sensor reads at rest
        return found
    cut, first = steady(command), model.axis.damping_ratio
    damping = first
    for _ in range(DAMPING_CORRECTIONS):
        model = model.replace({"damping_ratio": damping})
        found = reading(model, command)
        turned = reading(model.replace({"damping_ratio": (1 + DAMPING_CHANGE) * damping}), command) - found
        if not math.isfinite(rms(found) + rms(turned)):
            break
        gain, step = fit_linear(found[cut], target[cut], turned[cut])[1]
        best = gain * found + step * turned
        best += np.mean((target - best)[cut])
        if not gain > 0:
            return best
        damping = min(
            max(damping * (1 + DAMPING_CHANGE * step / gain), first / 5, 0.5 * damping), 5 * first, 2 * damping
        )
    else:
        return best
    return np.full(len(found), np.nan)


def _separation(command: Command, first: AxisDynamics, second: AxisDynamics, noise: float) -> Separation:
    one = reading(first, command)
    other = _refit(second, command, one)
    difference = rms((one - other)[steady(command)])
    return Separation(command, one, other, difference, difference / noise)


# --- confounded effects of a diagnosis -------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Proposal:
    """A group of confounded effects, and the experiments that would distinguish them.

    Parameters
    ----------
    group
        Names of the effects, the one that was added first.
    resolved
        The first with each of the others, and every experiment of the menu, by how far it distinguishes the two.
    reason
        Why some could not be simulated; empty if all could.
    """

    group: tuple[str, ...]
    resolved: tuple[Resolved, ...]
    reason: str = ""


def proposals(found: Diagnosis, progress: Callable[[str], None] = lambda _: None) -> tuple[Proposal, ...]:
    """Return for every group of confounded effects the experiments that would distinguish them.

    The candidates are commands within the limits of the axis, a known added mass, a static push, motion of another
    axis, and a change of temperature. Each is simulated with either effect in the diagnosed model; the difference is
    stated as a multiple of the noise of the runs.
    """
    return tuple(_proposal(found, group, progress) for group in found.confusable)


def _proposal(found: Diagnosis, group: tuple[str, ...], progress: Callable[[str], None]) -> Proposal:
    resolved = list[Resolved]()
    try:
        sampled = replace(found.model, controller=replace(found.model.controller, rate=_rate(found)))
        limits = of_axis(sampled, found.axis)
        model = dynamics(found.model, found.axis, limits)
        menu = [*suite_of(model, limits), *other_excitations(model, limits)]
        for other in group[1:]:
            progress(f"simulating what distinguishes {group[0]} from {other}")
            resolved.append(resolve_effects(model, (group[0], other), menu, found.noise_floor))
    except InputError as error:  # a model may lack what experiments go by, and is diagnosed all the same
        return Proposal(group, tuple(resolved), f"{error.field} {error.remedy}".strip())
    return Proposal(group, tuple(resolved))


def _rate(found: Diagnosis) -> float:
    """Return the sampling rate of simulated experiments, a whole fraction of the controller's [Hz]."""
    highest = max(frequency for frequency, _ in modes(found.model.axes[found.axis]))
    rate = found.model.controller.rate
    return rate / max(math.floor(rate / (SAMPLES_PER_PERIOD * highest)), 1)
