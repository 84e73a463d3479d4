"""Smooth functions of where a stage is and how it moves: what a rival without physics is put together from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import Observation
from flexdesign.diagnosis.effect_selection.linear_system import mode_response
from flexdesign.diagnosis.preparation.dataset import DiagnosisData
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.estimation.model_selection.fitted_model import FittedModel
from flexdesign.measurements.recordings import FrequencyResponse, Run
from flexdesign.measurements.recordings.frequency_response import parts, whole

Array = NDArray[np.float64]
#: Velocities are counted in this share of stroke times natural frequency; dry friction turns at a tenth of it.
VELOCITY_SCALE = 0.1
#: Where thresholds are tried, in shares of the stroke.
THRESHOLDS = (0.15, 0.3, 0.5, 0.7, 0.85)
#: Numbers of bumps over the band of frequency responses, and lines for each at least; how broad each is, as a standard
#: deviation in distances to the next.
BUMP_COUNTS, FEWEST_LINES, BUMP_WIDTH = (6, 12, 24, 48), 4, 0.6


@dataclass(frozen=True, eq=False)
class BasisFunctions:
    """Functions of position, velocity, voltage and time that add to the reading, or to the force on the table.

    Parameters
    ----------
    model
        The axis.
    band
        Lowest and highest frequency of all frequency responses [Hz], and the number of their lines; None if there are
        none. Then there are smooth functions of the logarithm of frequency, too, by which a response is multiplied.
    is_time_domain
        Whether there are runs in time.
    """

    model: AxisDynamics
    band: tuple[float, float, int] | None = None
    is_time_domain: bool = True

    def __call__(self, observation: Observation, predicted: Array) -> dict[str, Array]:
        """Return the functions by name, n values each, about as large as one; zero where they are not meant."""
        if isinstance(observation, FrequencyResponse):
            there = self._of_frequency(observation, predicted)
        else:
            there = self._in_time(observation, predicted)
        if self.band is None:
            return there
        return {name: there.get(name, np.zeros(len(predicted))) for name in self._names}

    @cached_property
    def _names(self) -> list[str]:
        """Names of all functions, those in time first."""
        made = list(self._of_frequency(None, np.zeros(0))) if self.band else []
        if not self.is_time_domain:
            return made
        t = self.model.first.natural_frequency**-1 * np.arange(4.0)
        blank = Run("blank", t, {"u": np.zeros(4), self.model.name: np.zeros(4)}, {"u": "V"})
        return [*self._in_time(blank, np.zeros(4)), *made]

    def _of_frequency(self, response: FrequencyResponse | None, predicted: Array) -> dict[str, Array]:
        """Return bumps over the logarithm of frequency times the response, in step with it and a quarter ahead."""
        assert self.band is not None
        low, high, lines = self.band
        made = dict[str, Array]()
        for count in (many for many in BUMP_COUNTS if many <= max(lines // FEWEST_LINES, BUMP_COUNTS[0])):
            centres = np.geomspace(low, high, count)
            for centre in centres.tolist():
                about = f"near {centre:.3g} Hz, 1/{count} of the band"
                if response is None:
                    made |= {f"magnitude {about}": predicted, f"phase {about}": predicted}
                    continue
                width = math.log(high / low) / (count - 1)
                bump = np.exp(-0.5 * (np.log(response.frequencies / centre) / (BUMP_WIDTH * width)) ** 2)
                made[f"magnitude {about}"] = parts(bump * whole(predicted))
                made[f"phase {about}"] = parts(1j * bump * whole(predicted))
        return made

    def _in_time(self, observation: Observation, predicted: Array) -> dict[str, Array]:
        assert isinstance(observation, Run)
        made = self._functions(observation, predicted)
        forces = {f"force: {name}": self._through(values, observation.period) for name, values in made.items()}
        readings = {f"reading: {name}": values for name, values in made.items()}
        return {**readings, **forces, **self._of_time(observation)}

    def _functions(self, run: Run, predicted: Array) -> dict[str, Array]:
        x = predicted / self.model.stroke
        fast = 2 * math.pi * self.model.axis.natural_frequency * VELOCITY_SCALE
        v = np.gradient(x, run.period) / fast
        u = self.model.command(run) / self.model.max_command
        powers = {f"position^{k}": x**k for k in (2, 3, 4)}
        knees = {f"position beyond {100 * knee:.0f} %": np.maximum(x - knee, 0.0) for knee in THRESHOLDS}
        moving = {"velocity": v, "velocity^2": v**2, "velocity |velocity|": v * np.abs(v), "velocity^3": v**3}
        dry = {"sign of velocity": np.tanh(10 * v), "position x velocity": x * v, "position^2 x velocity": x**2 * v}
        of_voltage = {f"voltage^{k}": u**k for k in (1, 2, 3)} | {"voltage x position": u * x}
        return {**powers, **knees, **moving, **dry, **of_voltage}

    def _of_time(self, run: Run) -> dict[str, Array]:
        command = self.model.command(run)
        jumps = np.abs(np.diff(command, prepend=command[0])) > 0.02 * self.model.max_command
        last = np.maximum.accumulate(np.where(jumps, np.arange(len(command)), 0))
        since = (np.arange(len(command)) - last) * run.period
        return {
            "reading: log of time since a step": np.log10(1 + since / 0.01),
            "reading: time": run.time - run.time[0],
        }

    def _through(self, force: Array, period: float) -> Array:
        """Return what a force over the stiffness does to the main mode, held between samples."""
        axis = self.model.axis
        return mode_response(force, axis.natural_frequency, axis.damping_ratio, period)[0]


def basis_functions_of(data: DiagnosisData, fit: FittedModel) -> BasisFunctions:
    """Return the smooth functions that recordings of a kind may show."""
    lines = [int(each.present.sum()) for each in data.taught]
    band = (*data.band, max(lines)) if lines else None
    return BasisFunctions(cast(AxisDynamics, fit.model), band, bool(data.runs))
