"""The whole stage: its axes, what couples them, and the controller's clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from flexdesign.dynamics.stage_model.axis import AxisModel


@dataclass(frozen=True)
class ControllerTiming:
    """The clock of the sampled controller.

    Parameters
    ----------
    rate
        Samples per second [Hz].
    delay
        From the moment a reading is taken to the moment its command acts [s].
    """

    rate: float = 1000.0
    delay: float = 0.0


@dataclass(frozen=True)
class Coupling:
    """How the motion of one axis shows in another: y += linear x + quadratic x^2.

    Parameters
    ----------
    linear
        Ratios by (to, from): ``{("y", "x"): 0.0176}``; [1] where both axes respond in the same unit.
    quadratic
        By (to, from) [1/m]; eq (25) of Lin et al. (2019) is of this kind.
    """

    linear: Mapping[tuple[str, str], float] = field(default_factory=dict)
    quadratic: Mapping[tuple[str, str], float] = field(default_factory=dict)


@dataclass(frozen=True)
class StageModel:
    """A stage.

    Parameters
    ----------
    axes
        By name.
    controller, coupling
        Its clock, and what one axis does to another.
    title, source
        What people call it, and where its numbers come from.
    name
        Name of its file.
    """

    axes: Mapping[str, AxisModel]
    controller: ControllerTiming = ControllerTiming()
    coupling: Coupling = Coupling()
    title: str = ""
    source: str = ""
    name: str = ""
