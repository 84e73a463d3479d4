"""The catalogue as candidates of a diagnosis: which numbers a fit may move, and where a search tries them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import cast

import numpy as np

from flexdesign import effects
from flexdesign.core.arrays import Array
from flexdesign.core.model import Effect, Model, Observation, Parameter, Resonance, parameter_of
from flexdesign.diagnosis.preparation.dataset import DiagnosisData
from flexdesign.diagnosis.preparation.spectra import FREQUENCIES_TRIED, line_frequencies, mode_frequencies
from flexdesign.dynamics import spectrum
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.axis.axis_parameters import DELAY, SENSOR_DELAY, frequency_scale, of_catalogue, power_in
from flexdesign.dynamics.axis.axis_run import acts_before_stack
from flexdesign.dynamics.stage_model import fields
from flexdesign.estimation.model_selection.fitted_model import FittedModel
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.measurements.recordings import Run

#: Effects that only move a number of the model itself: a recalibration beyond the prior names them.
NAMED_BY_CALIBRATION = ("payload_mass", "stiffness_loss", "sensor_gain")
#: The one among them that a known mass distinguishes from the others.
SHOWN_BY_MASS = "payload_mass"
#: Forces of inertia: they show where a mode does, and in runs that show none they represent something else.
INERTIAL_EFFECTS = ("base_motion",)
#: Readings in whole steps are noise to a fit.
NOISE_EFFECTS = ("quantisation",)


def _line(frequency: str, model: Model, observation: Observation) -> Array | None:
    """Return cosine and sine at a frequency, by its name, n by 2; None for a frequency response, which has no time."""
    if not isinstance(observation, Run):
        return None
    angle = 2 * math.pi * (parameter_of(model, frequency).start or 0.0) * (observation.time - observation.time[0])
    return np.column_stack([np.cos(angle), np.sin(angle)])


def candidates(
    model: AxisDynamics,
    more: Sequence[str] = (),
    lines: Sequence[float] = (),
    peaks: Sequence[float] = (),
    *,
    loaded: bool = False,
    at_stack: bool = False,
    swings: bool = True,
    band: tuple[float, float] | None = None,
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
    peaks
        Frequencies [Hz] at which the residual shows modes.
    loaded
        Whether some runs carry a known mass: then the table's own mass shows.
    at_stack
        Whether all runs know the voltage at the stack: then nothing ahead of it shows, and only the sensor is late.
    swings
        Whether the runs show the mode of the axis.
    band
        Lowest and highest frequency [Hz] of frequency responses, where there are no runs in time: these show small
        sines and nothing else. Modes are then tried all over the band.
    """
    made, present = [], {p.name: p.start for p in model.parameters()}
    left_out = (
        *(name for name in NAMED_BY_CALIBRATION if not (loaded and name == SHOWN_BY_MASS)),
        *NOISE_EFFECTS,
        *(() if swings else INERTIAL_EFFECTS),
    )
    several = [each for name in effects.names() for each in effects.again(name)]
    for name in (*effects.names(), *several, *more):
        effect = effects.find(name)
        if name in left_out or name in model.axis.effects or (at_stack and acts_before_stack(effect)):
            continue
        if not effect.can_be_of(model.axis.driven_by):
            continue
        # Elsewhere than behind the stack no recording distinguishes it from a delay of the command.
        if name == "sensor_delay" and not at_stack:
            continue
        number = fields.AXIS_FIELDS.get(name)
        if number is not None and present[number] not in (0.0, math.inf):
            continue
        if (band is not None and not spectrum.shows(effect)) or not _shows_frequency(model, effect, name):
            continue
        candidate = candidate_of(model, name, lines, peaks, band)
        after = _before(name)
        made.append(candidate if after in model.axis.effects else replace(candidate, after=after))
    return tuple(made)


def catalogue(
    data: DiagnosisData, dynamics: AxisDynamics, fit: FittedModel, *, more: Sequence[str] = ()
) -> tuple[Candidate, ...]:
    """Return the effects of the catalogue, and those of the paths `more`, as candidates at a calibrated fit."""
    return candidates(
        dynamics,
        more,
        line_frequencies(data, fit) if data.runs else (),
        mode_frequencies(data, fit),
        loaded=data.is_loaded,
        at_stack=data.is_at_stack,
        swings="natural_frequency" in fit.solution.problem.where.names,
        band=None if data.runs else data.band,
    )


def _shows_frequency(model: AxisDynamics, effect: Effect, name: str) -> bool:
    """Return whether the samples show some frequency that an effect may have; of effects without one, always."""
    numbers = (p for p in model.with_effect(effect, name).parameters() if p.name == f"{name}.frequency")
    return all(p.plausible[0] < p.plausible[1] for p in numbers)


def _before(name: str) -> str:
    """Return the name of the effect after which one that an axis has several times is tried; empty for the first.

    >>> _before("second_mode"), _before("second_mode.2"), _before("second_mode.3")
    ('', 'second_mode', 'second_mode.2')
    """
    first = effects.original(name)
    names = (first, *effects.again(first))
    return "" if name == first else names[names.index(name) - 1]


def candidate_of(
    model: AxisDynamics,
    name: str,
    lines: Sequence[float],
    peaks: Sequence[float] = (),
    band: tuple[float, float] | None = None,
) -> Candidate:
    """Return one effect as a candidate.

    Parameters
    ----------
    model
        The axis, without the effect.
    name
        The name under which `flexdesign.effects.find` has it.
    lines, peaks, band
        See `candidates`.
    """
    effect, number = effects.find(name), fields.AXIS_FIELDS.get(name)  # of driver, sensor or controller, if any
    with_it = {p.name: p for p in model.with_effect(effect, name).parameters()}
    if number is not None:
        own = [_with_screen(with_it[number], effect.parameters[0], model)]
    else:
        own = [with_it[f"{name}.{p.name}"] for p in effect.parameters]
    if band is not None:
        own = [replace(p, screen=_values_in_band(p, band)) if p.screen else p for p in own]
    strength = next(p for p in own if p.null is not None)
    power = fields.POWER_LAWS.get(name, ("", ()))[0]
    free = tuple(p.name for p in own if not p.per_run and p.name.rpartition(".")[2] != power)
    phase = next((p.name for p in own if p.per_run and p.si == "rad"), "")
    frequency = next((p.name for p in own if p.si == "Hz"), "")
    if any(isinstance(face, Resonance) for face in effect.faces):
        # Far below the main mode, a lightly damped one imitates what a periodic command makes of any effect.
        lowest = min((value for p in own if p.si == "Hz" for value in p.screen), default=0.0)
        lines = [peak for peak in peaks if peak >= lowest]
    elif not phase:
        lines = ()
    return Candidate(
        name=name,
        add=lambda of: cast(AxisDynamics, of).with_effect(effect, name),
        strength=strength.name,
        free=free,
        trials=_trials(own, lines),
        phase=phase,
        signed=strength.plausible[0] < 0,
        has_own_trials=bool(strength.screen),
        trace=partial(_line, frequency) if phase and frequency else None,
    )


def _values_in_band(parameter: Parameter, band: tuple[float, float]) -> tuple[float, ...]:
    """Return the values at which a number is tried in a band: frequencies all over it, delays of a radian at each.

    >>> [round(value, 6) for value in _values_in_band(Parameter(DELAY, "s", "ms", "delay"), (1.0, 400.0))][-2:]
    [0.000774, 0.000398]
    """
    frequencies = np.geomspace(*band, FREQUENCIES_TRIED)
    if parameter.si == "Hz":
        return tuple(frequencies.tolist())
    if parameter.name in (DELAY, SENSOR_DELAY):
        return tuple((1 / (2 * math.pi * frequencies)).tolist())
    return parameter.screen


def _with_screen(number: Parameter, catalogue: Parameter, model: AxisDynamics) -> Parameter:
    """Return a number of driver, sensor or controller with what the catalogue says of the effect that it represents."""
    scale = of_catalogue(catalogue, model.stroke, model.max_command)
    scale *= frequency_scale(model.first, model.highest) ** -power_in("s", catalogue.si.replace("Hz", "1/s"))
    return replace(number, screen=tuple(value * scale for value in catalogue.screen), null=catalogue.null)


def _trials(own: Sequence[Parameter], lines: Sequence[float]) -> tuple[dict[str, float], ...]:
    grids: list[list[tuple[str, float]]] = []
    for p in own:
        if p.per_run:
            continue
        values = list(p.screen)
        if lines and p.si == "Hz":
            values += [line for line in lines if p.is_plausible(line)]
        low, high = p.plausible
        values = sorted({min(max(value, low), high) for value in values})
        start = p.start if p.start is not None else 0.0
        grids.append([(p.name, value) for value in values or [start]])
    return tuple(dict(trial) for trial in itertools.product(*grids))
