"""An effect at a chosen strength on an axis, and what it changes in an experiment."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from flexdesign import effects
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.model import Disturbance, Parameter, Term, parameter_of
from flexdesign.diagnosis.experiment_design.commands import Command
from flexdesign.diagnosis.preparation.dataset import OF_STROKE
from flexdesign.dynamics import stage_dynamics as stages
from flexdesign.dynamics.axis.axis_model import COMPARED_TOLERANCE, AxisDynamics
from flexdesign.dynamics.axis.axis_parameters import DELAY
from flexdesign.dynamics.stage_model import fields

#: The strength is such that the response changes by this share of the stroke, where it changes most.
VISIBLE_SHARE = 0.01
#: Words by which the catalogue names each kind of experiment.
KIND_WORDS = {
    "quiet": ("quiet",),
    "steps": ("steps", "a step recorded", "resonance"),  # steps, too, make a stage ring
    "multisine": ("multisine", "frequency response", "resonance"),
    "triangle": ("triangle", "slow sine", "small sines", "slow force"),
    "staircase": ("staircase", "bias", "positions"),
    "hold": ("held",),
    "push": ("push",),
    "temperature": ("temperature",),
    "other axis": ("other axis",),
}


@dataclass(frozen=True)
class EffectAtStrength:
    """An effect on an axis.

    Parameters
    ----------
    name
        Of the catalogue, of an installed package or the path of a file.
    without
        The axis without it; without any other hysteresis too, if it is one.
    added
        The axis with it, at its start values.
    strength
        The number by which it is made stronger or weaker: its first one with a null; plausible range as on this axis.
    key
        What `AxisDynamics.replace` calls that number.
    """

    name: str
    without: AxisDynamics
    added: AxisDynamics
    strength: Parameter
    key: str

    @property
    def start(self) -> float:
        """The strength to begin with: the start value, or a tenth of the largest plausible one."""
        value, null = {**self.added.axis.numbers, DELAY: self.added.delay}.get(self.key, math.nan), self.strength.null
        low, high = self.strength.plausible
        tried = (value, 0.1 * high if math.isfinite(high) else low)
        return next((each for each in tried if math.isfinite(each) and each not in (0.0, null)), 1.0)

    def at(self, strength: float) -> AxisDynamics:
        """Return the axis with the effect at a strength, SI."""
        return self.added.replace({self.key: strength})

    def values(self, strength: float) -> dict[str, float]:
        """Return all its numbers at a strength, by their names in the catalogue, SI."""
        own = dict(self.added.axis.effects.get(self.name, {}))
        return {**own, self.strength.name.rpartition(".")[2]: strength}

    def search(self, wanted: float, measure: Callable[[AxisDynamics], float]) -> float:
        """Return the strength at which `measure` comes to `wanted`, or the end of the plausible range next to it.

        `measure` must grow with the effect and be zero without it. The root is sought between the logarithms of both,
        where most effects are straight lines.
        """
        from scipy.optimize import brentq

        largest = max(map(abs, self.strength.plausible))
        largest = largest if math.isfinite(largest) else 1e6 * abs(self.start)
        ends = math.log(max(self.strength.plausible[0], 1e-9 * largest)), math.log(largest)  # at most nine decades

        @cache
        def excess(place: float) -> float:
            found = measure(self.at(math.copysign(math.exp(place), self.start)))
            return math.log(min(max(found / wanted, 1e-6), 1e6))

        is_between = excess(ends[0]) * excess(ends[1]) <= 0
        place = brentq(excess, *ends) if is_between else min(ends, key=lambda end: abs(excess(end)))
        return math.copysign(math.exp(place), self.start)


def on(model: AxisDynamics, name: str) -> EffectAtStrength:
    """Return an effect on an axis, at its start values.

    Raises
    ------
    InputError
        If there is no such effect, or it has nothing that acts in time.
    """
    try:
        effect = effects.find(name)
    except ValueError as error:
        raise InputError("command line", "effect", name, str(error)) from None
    elsewhere = fields.AXIS_FIELDS.get(name)
    if not elsewhere and all(isinstance(face, Term) for face in effect.faces):
        remedy = "acts on static formulas alone; choose one that an experiment in time shows"
        raise InputError("command line", "effect", name, remedy)
    own = next((p for p in effect.parameters if p.null is not None), effect.parameters[0])
    if elsewhere:
        model = model.replace({elsewhere: 0.0 if own.null is None else own.null})
    # A hysteresis takes the place of another one.
    others = {
        other: values
        for other, values in model.axis.effects.items()
        if other != name and not (effect.is_hysteresis and effects.find(other).is_hysteresis)
    }
    axis = replace(model.axis, effects=others)
    without = AxisDynamics(model.name, axis, model.max_command, COMPARED_TOLERANCE, delay=model.delay)
    added, key = without.with_effect(effect, name), elsewhere or f"{name}.{own.name}"
    return EffectAtStrength(name, without, added, own if elsewhere else parameter_of(added, key), key)


# --- what an experiment shows ---------------------------------------------------------------------------------------


def reading(model: AxisDynamics, command: Command) -> Array:
    """Return what the sensor reads in an experiment [response], n values; NaN where the motion runs away."""
    found, step = exact_reading(model, command), model.axis.sensor.resolution
    return step * np.floor(found / step + 0.5) if step > 0 else found


def exact_reading(model: AxisDynamics, command: Command) -> Array:
    """Return the same without the rounding of the sensor.

    An added mass and a static push, which begins half-way, are taken into account where the effects of `model` depend
    on them.
    """
    mass, compliance = inertia(model)
    if command.mass_ratio:
        # Mass and frequency before and after: (w'/w)^2 = m / (m + added); the damper stays, so that zeta falls as w.
        fall = math.sqrt(mass / (mass + command.mass_ratio))
        names = ("natural_frequency", "damping_ratio")
        model = model.replace({name: fall * getattr(model.axis, name) for name in names})
    found = model.predict(command.run(model.name, model.axis.response))
    return found + command.push * compliance * (2 * command.time >= command.duration)


def inertia(model: AxisDynamics) -> tuple[float, float]:
    """Return moving mass and compliance per those of the plain axis, by the effects that adjust its numbers.

    The drive is a force, so that the static gain is in proportion to the compliance, and the mass follows from it and
    the natural frequency.
    """
    now, axis = stages.main_mode(model.axis), model.axis
    compliance = now["gain"] / axis.gain
    return 1.0 / (compliance * (now["natural_frequency"] / axis.natural_frequency) ** 2), compliance


def rms(values: Array) -> float:
    """Return the root of the mean square; infinite if the motion ran away."""
    found = float(np.sqrt(np.mean(values**2)))
    return found if math.isfinite(found) else math.inf


def fit_linear(target: Array, columns: Array) -> Array:
    """Return the k factors with which the sum of k columns comes closest to a target; a row for each of several."""
    return np.asarray(np.linalg.lstsq(columns.T, target.T, rcond=None)[0].T)


# --- signatures ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class EffectResponse:
    """One experiment with and without an effect.

    Parameters
    ----------
    command
        What was sent.
    without, affected
        Readings, n values [response].
    """

    command: Command
    without: Array
    affected: Array

    @property
    def change(self) -> float:
        """By how much the reading changes, rms [response]."""
        return rms(self.affected - self.without)

    @property
    def left(self) -> float:
        """The change that a refitted gain and offset do not explain, rms [response]."""
        without, affected = self.without - self.without.mean(), self.affected - self.affected.mean()
        return rms(affected - fit_linear(affected, without[np.newaxis])[0] * without)


@dataclass(frozen=True)
class Signature:
    """An effect, made visible.

    Parameters
    ----------
    effect
        On its axis.
    strength
        At which it is shown, SI.
    stroke
        Of the axis [response].
    seen
        Every experiment; those first that show it most.
    """

    effect: EffectAtStrength
    strength: float
    stroke: float
    seen: tuple[EffectResponse, ...]

    @property
    def visible(self) -> tuple[EffectResponse, ...]:
        """The experiments that show it; none if the strongest plausible effect hardly changes any of them."""
        return tuple(each for each in self.seen if each.change >= OF_STROKE * self.stroke)


def signature_of(effect: EffectAtStrength, experiments: Sequence[Command]) -> Signature:
    """Return the signature of an effect at a strength that can be seen.

    Experiments that its description names come first, if they show it, then those that it changes most.
    """
    stroke, catalogued = effect.without.stroke, effects.find(effect.name)
    needs_columns = any(isinstance(face, Disturbance) and face.columns for face in catalogued.faces)
    experiments = [command for command in experiments if needs_columns or not command.recorded]
    without = [reading(effect.without, command) for command in experiments]

    def seen_at(strength: float) -> list[EffectResponse]:
        affected = effect.at(strength)
        pairs = zip(experiments, without, strict=True)
        return [EffectResponse(command, before, reading(affected, command)) for command, before in pairs]

    best = max(seen_at(effect.start), key=lambda each: each.change if math.isfinite(each.change) else 0.0)
    strength = effect.search(VISIBLE_SHARE * stroke, lambda model: rms(reading(model, best.command) - best.without))
    finite = [each for each in seen_at(strength) if math.isfinite(each.change)]

    def rank(each: EffectResponse) -> tuple[bool, float]:
        return names_kind(catalogued.reveal, each.command.kind) and each.change >= OF_STROKE * stroke, each.change

    return Signature(effect, strength, stroke, tuple(sorted(finite, key=rank, reverse=True)))


def names_kind(reveal: str, kind: str) -> bool:
    """Tell whether an effect's description names a kind of experiment.

    >>> names_kind("a step held for a hundred seconds or more", "hold"), names_kind("a quiet record", "triangle")
    (True, False)
    """
    return any(word in reveal for word in KIND_WORDS.get(kind, ()))
