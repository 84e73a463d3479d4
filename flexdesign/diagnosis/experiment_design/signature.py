"""What an effect looks like: the experiments of the bench with and without it, those first that show it most."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from flexdesign import effects
from flexdesign.core.model import Disturbance
from flexdesign.diagnosis.experiment_design.commands import Array, Command
from flexdesign.diagnosis.experiment_design.effect_strength import EffectAtStrength, fit_linear, reading, rms

#: The strength is such that the response changes by this share of the stroke, where it changes most.
VISIBLE_SHARE = 0.01
#: Experiments within this factor show an effect equally well: then the plainer one comes first.
EQUAL_FACTOR = 1.25
#: Below this share of the stroke nothing is seen.
INVISIBLE_SHARE = 1e-5
#: An experiment shows an effect if it changes by this share of what it changes in the best one.
SHOWN_SHARE = 0.1
#: Words by which the catalogue names each kind of experiment.
KIND_WORDS = {
    "quiet": ("quiet",),
    "steps": ("steps",),
    "multisine": ("multisine", "frequency response", "resonance"),
    "triangle": ("triangle", "slow sine", "small sines", "slow force"),
    "staircase": ("staircase", "bias", "positions"),
    "hold": ("held",),
    "push": ("push",),
    "temperature": ("temperature",),
    "other axis": ("other axis",),
}


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
        """What of the change a new gain and a new offset cannot take up, rms [response]."""
        return rms(self.affected - fit_linear(self.without, self.affected)[0])


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
        """The experiments that show it; none if the strongest plausible effect changes nothing in any of them."""
        best = max((each.change for each in self.seen), default=0.0)
        return tuple(
            each for each in self.seen if each.change >= max(SHOWN_SHARE * best, INVISIBLE_SHARE * self.stroke)
        )


def signature_of(effect: EffectAtStrength, experiments: Sequence[Command]) -> Signature:
    """Return the signature of an effect at a strength that can be seen.

    Parameters
    ----------
    effect
        On an axis.
    experiments
        In the order of plainness: the first of several that show it alike comes first.
    """
    stroke, columns = effect.without.stroke, _columns(effect.name)
    experiments = [command for command in experiments if columns or not command.recorded]
    without = [reading(effect.without, command) for command in experiments]

    def change(number: int, strength: float) -> float:
        return rms(reading(effect.at(strength), experiments[number]) - without[number])

    changes = [change(number, effect.start) for number in range(len(experiments))]
    best = max(range(len(experiments)), key=lambda number: changes[number] if math.isfinite(changes[number]) else 0.0)
    plain = without[best]
    strength = effect.search(VISIBLE_SHARE * stroke, lambda model: rms(reading(model, experiments[best]) - plain))
    seen = [
        EffectResponse(command, before, reading(effect.at(strength), command))
        for command, before in zip(experiments, without, strict=True)
    ]
    finite = [each for each in seen if math.isfinite(each.change)]
    return Signature(effect, strength, stroke, tuple(_sort(finite, effects.find(effect.name).reveal)))


def _columns(name: str) -> tuple[str, ...]:
    """Return the recorded columns that an effect needs."""
    faces = effects.find(name).faces
    return tuple(column for face in faces if isinstance(face, Disturbance) for column in face.columns)


def names_kind(reveal: str, kind: str) -> bool:
    """Tell whether an effect's own words name a kind of experiment.

    >>> names_kind("a step held for a hundred seconds or more", "hold"), names_kind("a quiet record", "triangle")
    (True, False)
    """
    return any(word in reveal for word in KIND_WORDS.get(kind, ()))


def _sort(seen: Sequence[EffectResponse], reveal: str) -> list[EffectResponse]:
    """Return experiments by what they show: those that the effect's own words name first, if they do show it.

    What counts is what a new gain does not take up, unless the effect is one of gain.
    """
    largest = max((each.change for each in seen), default=0.0)
    is_gain = max((each.left for each in seen), default=0.0) < 0.05 * largest

    def rank(each: EffectResponse) -> tuple[bool, float]:
        change = each.change if is_gain else each.left
        place = math.floor(math.log(change) / math.log(EQUAL_FACTOR)) if change > 0 else -math.inf
        return names_kind(reveal, each.command.kind) and each.change >= SHOWN_SHARE * largest, place

    return sorted(seen, key=rank, reverse=True)  # stable: the order of plainness among equals
