"""Which experiments distinguish two effects, simulated with either.

Those that would distinguish confounded effects of a diagnosis are chosen from the menu of the bench.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.diagnosis.effect_selection.estimation_setup import modes
from flexdesign.diagnosis.experiment_design.commands import Command
from flexdesign.diagnosis.experiment_design.effect_strength import (
    VISIBLE_SHARE,
    EffectAtStrength,
    EffectResponse,
    exact_reading,
    fit_linear,
    on,
    reading,
    signature_of,
)
from flexdesign.diagnosis.experiment_design.experiments import SAME_WITH_MASS, suite_of
from flexdesign.diagnosis.experiment_design.limits import of_axis
from flexdesign.diagnosis.preparation.spectra import FEWEST_PER_PERIOD
from flexdesign.diagnosis.result import Diagnosis
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.estimation.criterion import significant_deviation

#: Number of experiments proposed, one of each kind.
EXPERIMENTS_PROPOSED = 3


@dataclass(frozen=True)
class Separation(EffectResponse):
    """How far one experiment distinguishes two effects.

    The reading with the first is `affected`; that with the second, fitted to it, takes the place of `without`.

    Parameters
    ----------
    difference
        What fits of the second to the first leave, rms; of a multisine over its whole periods [response].
    over_noise
        The same over the sensor's noise.
    """

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
    noise
        Of the sensor, rms [response].
    separations
        Of every experiment, the best first.
    """

    effects: tuple[EffectAtStrength, EffectAtStrength]
    strengths: tuple[float, float]
    noise: float
    separations: tuple[Separation, ...]

    @property
    def required(self) -> frozenset[str]:
        """Names of the proposed experiments, of the record of the noise, and of what an added mass repeats."""
        repeated = {SAME_WITH_MASS} if any(each.command.mass_ratio for each in self.proposed) else set()
        return frozenset({each.command.name for each in self.proposed} | {"quiet"} | repeated)

    @property
    def proposed(self) -> tuple[Separation, ...]:
        """The best experiment of each kind, three at most, among those that differ clearly."""
        kinds: dict[str, Separation] = {}
        for each in self.separations:
            kind = "added mass" if each.command.mass_ratio else each.command.kind
            if each.over_noise >= significant_deviation() and each.command.role == "identify":
                kinds.setdefault(kind, each)
        return tuple(kinds.values())[:EXPERIMENTS_PROPOSED]


def resolve_effects(
    model: AxisDynamics, names: tuple[str, str], experiments: Sequence[Command], noise: float
) -> Resolved:
    """Return which experiments distinguish two effects.

    Each effect has a strength that changes the reading of the standard multisine by 1 % of the stroke, rms, or if that
    does not show it, of the experiment that shows it best. A multiple of the change by the second is fitted to that by
    the first in the standard multisine, and in the standard multisine and an experiment together; in either, gain,
    damping and offset are free, as they are not known well enough. What the experiment leaves unexplained in addition
    distinguishes the effects.

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
    standard = next(command for command in experiments if command.name == SAME_WITH_MASS)
    shown = [signature_of(on(plain, name), [standard]) for name in names]
    first, second = (each if each.visible else signature_of(each.effect, experiments) for each in shown)
    compared = [each.effect.at(each.strength) for each in (first, second)]
    numbers = {name: (1 + VISIBLE_SHARE) * getattr(plain.axis, name) for name in ("gain", "damping_ratio")}

    def readings(command: Command) -> tuple[Array, Array, Array]:
        """Return the reading with the first effect, and what gain, damping and offset leave of the change by either.

        And of the latter the samples that are compared, divided by the root of their number.
        """
        cut, exact = steady(command), exact_reading(plain, command)
        with_effects = np.stack([reading(each, command) for each in compared])
        changed = with_effects - reading(plain, command)
        recalibrated = [exact_reading(plain.replace({name: number}), command) for name, number in numbers.items()]
        offset = np.full(len(exact), VISIBLE_SHARE * plain.stroke)
        columns = np.stack([*(each - exact for each in recalibrated), offset])
        left = changed - fit_linear(changed[:, cut], columns[:, cut]) @ columns
        return with_effects[0], left, left[:, cut] / math.sqrt(left[:, cut].shape[1])

    in_multisine, found = readings(standard)[2], list[Separation]()
    for command in experiments:
        with_first, left, parts = readings(command)
        if np.isfinite(left).all():
            both = np.concatenate([in_multisine, parts], axis=1)
            difference = math.sqrt(max(_unexplained(both) - _unexplained(in_multisine), 0.0))
            with_second = with_first - (left[0] - fit_linear(both[0], both[1:]) @ left[1:])
            found.append(Separation(command, with_second, with_first, difference, difference / noise))
    found.sort(key=lambda each: each.over_noise, reverse=True)
    return Resolved((first.effect, second.effect), (first.strength, second.strength), noise, tuple(found))


def _unexplained(changes: Array) -> float:
    """Return the squares of the first of two changes that a multiple of the second does not explain."""
    return float(np.sum((changes[0] - fit_linear(changes[0], changes[1:]) @ changes[1:]) ** 2))


def steady(command: Command) -> slice:
    """Return the samples that are compared: of a multisine its whole periods, without the ramps before and after."""
    if command.kind != "multisine":
        return slice(None)
    first, last = (round(command.marks[end] / command.period) for end in (0, -1))
    return slice(first, last)


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
    proposed = []
    for group in found.confusable:
        resolved, reason = list[Resolved](), ""
        try:
            highest = max(frequency for frequency, _ in modes(found.model.axes[found.axis]))
            controller = found.model.controller
            controller = replace(controller, rate=min(controller.rate, FEWEST_PER_PERIOD * highest))
            limits = of_axis(replace(found.model, controller=controller), found.axis)
            model = limits.dynamics(found.model, found.axis)
            menu = suite_of(model, limits)
            for other in group[1:]:
                progress(f"simulating what distinguishes {group[0]} from {other}")
                resolved.append(resolve_effects(model, (group[0], other), menu, found.noise_floor))
        except InputError as error:  # a model may lack what experiments go by, and is diagnosed all the same
            reason = f"{error.field} {error.remedy}".strip()
        proposed.append(Proposal(group, tuple(resolved), reason))
    return tuple(proposed)
