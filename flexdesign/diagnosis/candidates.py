"""The catalogue as candidates of a diagnosis: which numbers a fit may move, and where a search tries them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

from flexdesign import effects
from flexdesign.dynamics import spectrum
from flexdesign.dynamics.axis_model import AxisDynamics
from flexdesign.dynamics.axis_parameters import of_catalogue
from flexdesign.dynamics.axis_run import acts_ahead_of_stack
from flexdesign.evidence.screening import Candidate
from flexdesign.model import Effect, Model, Parameter
from flexdesign.stage_model import fields

#: Effects that only move a number of the model itself: a recalibration beyond what was known names them.
IMITATED = ("payload_mass", "stiffness_loss", "sensor_gain")
#: The one among them that a known mass tells from the others.
LOADED = "payload_mass"
#: Readings in whole steps are noise to a fit.
NOISE = ("quantisation",)
#: Not more trials than these for one effect.
MOST_TRIALS = 48


@dataclass(frozen=True)
class Adder:
    """Adds an effect to a model.

    Parameters
    ----------
    effect, name
        The effect, and the name under which `flexdesign.effects.find` has it.
    """

    effect: Effect
    name: str

    def __call__(self, model: Model) -> Model:
        """Return the model with the effect."""
        return cast(AxisDynamics, model).with_effect(self.effect, self.name)


def candidates(
    model: AxisDynamics,
    more: Sequence[str] = (),
    lines: Sequence[float] = (),
    *,
    loaded: bool = False,
    at_stack: bool = False,
    in_time: bool = True,
) -> tuple[Candidate, ...]:
    """Return every effect of the catalogue that the axis does not have.

    Parameters
    ----------
    model
        The axis.
    more
        Paths of further effects.
    lines
        Frequencies [Hz] of sinusoids that were seen in quiet records.
    loaded
        Whether some runs carry a known mass: then the table's own mass shows.
    at_stack
        Whether all runs know the voltage at the stack: then nothing ahead of it shows.
    in_time
        Whether there are runs in time; frequency responses alone show small sines and nothing else.
    """
    made = []
    left_out = (*(name for name in IMITATED if not (loaded and name == LOADED)), *NOISE)
    for name in (*effects.names(), *more):
        if name in left_out or name in model.axis.effects or (at_stack and acts_ahead_of_stack(effects.find(name))):
            continue
        if not in_time and not spectrum.shows(effects.find(name)):
            continue
        number = fields.ELSEWHERE.get(name)
        present = {p.name: p.start for p in model.parameters()}
        if number is not None and present[number] not in (0.0, math.inf):
            continue
        made.append(candidate_of(model, effects.find(name), name, number, lines))
    return tuple(made)


def candidate_of(
    model: AxisDynamics, effect: Effect, name: str, number: str | None, lines: Sequence[float]
) -> Candidate:
    """Return one effect as a candidate.

    Parameters
    ----------
    model
        The axis, without the effect.
    effect, name
        The effect, and the name under which `flexdesign.effects.find` has it.
    number
        The number of driver, sensor or controller that it stands for, if any.
    lines
        Frequencies [Hz] of sinusoids that were seen in quiet records.
    """
    with_it = {p.name: p for p in model.with_effect(effect, name).parameters()}
    if number is not None:
        own = [_with_screen(with_it[number], effect.parameters[0], model)]
    else:
        own = [with_it[f"{name}.{p.name}"] for p in effect.parameters]
    strength = next(p for p in own if p.null is not None)
    power = fields.POWER_LAWS.get(name, ("", ()))[0]
    free = tuple(p.name for p in own if not p.per_run and p.name.rpartition(".")[2] != power)
    phase = next((p.name for p in own if p.per_run and p.si == "rad"), "")
    return Candidate(
        name=name,
        add=Adder(effect, name),
        strength=strength.name,
        free=free,
        trials=_trials(own, strength, lines if phase else ()),
        phase=phase,
        signed=strength.plausible[0] < 0,
        is_limit=strength.null == math.inf,
        like=effect.confused_with,
    )


def _with_screen(number: Parameter, catalogue: Parameter, model: AxisDynamics) -> Parameter:
    """Return a number of driver, sensor or controller with what the catalogue says of the effect that it stands for."""
    scale = of_catalogue(catalogue, model.stroke, model.volts)
    return replace(number, screen=tuple(value * scale for value in catalogue.screen), null=catalogue.null)


def _trials(own: Sequence[Parameter], strength: Parameter, lines: Sequence[float]) -> tuple[dict[str, float], ...]:
    grids: list[list[tuple[str, float]]] = []
    for p in own:
        if p.per_run:
            continue
        values = list(p.screen) if p.screen and (p is not strength or p.null == math.inf) else []
        if lines and p.si == "Hz":
            values += [line for line in lines if p.is_plausible(line)]
        low, high = p.plausible
        values = sorted({min(max(value, low), high) for value in values})
        start = p.start if p.start is not None else 0.0
        grids.append([(p.name, value) for value in values or [start]])
    return tuple(dict(trial) for trial in itertools.islice(itertools.product(*grids), MOST_TRIALS))
