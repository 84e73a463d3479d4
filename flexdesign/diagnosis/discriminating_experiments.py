"""The experiment that would distinguish confounded effects: chosen from the menu of the bench by simulation."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from flexdesign.core.errors import InputError
from flexdesign.diagnosis import experiment_design
from flexdesign.diagnosis.experiment_design import Resolved, StatedLimits
from flexdesign.diagnosis.preparation.initial_conditions import modes
from flexdesign.diagnosis.result import Diagnosis

#: Samples in a period of the highest mode where experiments are simulated: their tones end at three times its
#: frequency, well below Nyquist's; a controller may sample a slow stage a thousand times as fast.
SAMPLES_PER_PERIOD = 10


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

    The menu is that of `experiment_design`: what the command can do within the limits of the axis, a known added
    mass, a static push, another axis, warmth. Each is simulated with either effect, on the model with all else that was
    found, and its difference counted in the noise of the runs.
    """
    return tuple(_proposal(found, group, progress) for group in found.confusable)


def _proposal(found: Diagnosis, group: tuple[str, ...], progress: Callable[[str], None]) -> Proposal:
    resolved = list[Resolved]()
    try:
        limits = experiment_design.of_axis(found.model, found.axis, StatedLimits(rate=_rate(found)))
        dynamics = experiment_design.dynamics(found.model, found.axis, limits)
        menu = [*experiment_design.suite_of(dynamics, limits), *experiment_design.other_excitations(dynamics, limits)]
        for other in group[1:]:
            progress(f"simulating what distinguishes {group[0]} from {other}")
            resolved.append(experiment_design.resolve_effects(dynamics, (group[0], other), menu, found.noise_floor))
    except InputError as error:  # a model may lack what experiments go by, and is diagnosed all the same
        return Proposal(group, tuple(resolved), error.remedy)
    return Proposal(group, tuple(resolved))


def _rate(found: Diagnosis) -> float:
    """Return the sampling rate of simulated experiments, a whole fraction of the controller's [Hz]."""
    highest = max(frequency for frequency, _ in modes(found.model.axes[found.axis]))
    rate = found.model.controller.rate
    return rate / max(math.floor(rate / (SAMPLES_PER_PERIOD * highest)), 1)
