"""The chain of an axis: the blocks through which its signal goes, in order, and its modes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import Block, Disturbance, Effect, Socket
from flexdesign.core.model.effect import Values


@dataclass(frozen=True)
class Oscillator:
    """One mode: its frequency [Hz], damping ratio, and the part of the static response that it carries."""

    frequency: float
    damping_ratio: float
    share: float = 1.0


@dataclass(frozen=True)
class AxisChain:
    """The chain of one axis.

    Parameters
    ----------
    name
        Its name.
    gain
        Displacement that drives the modes, per voltage, before hysteresis [m/V].
    modes
        At least one; the motion is the sum of all.
    effects
        Effects with their values in SI; those at null take no part. What they do to the numbers and modes of the axis
        is in those already, see `flexdesign.dynamics.stage_dynamics.chain`.
    amplifier
        Voltage at the stack per command [V/V].
    """

    name: str
    gain: float
    modes: tuple[Oscillator, ...]
    effects: tuple[tuple[Effect, Mapping[str, float]], ...] = ()
    amplifier: float = 1.0

    @cached_property
    def active_effects(self) -> list[tuple[Effect, Values]]:
        """The effects that are not at null with their values, by name."""
        return by_name(self.effects)

    def blocks(self, *sockets: Socket) -> list[tuple[Block, Values]]:
        """Return the blocks of some sockets with their values, by name of their effect."""
        return [each for each in self._blocks if each[0].socket in sockets]

    @cached_property
    def _blocks(self) -> list[tuple[Block, Values]]:
        faces = ((face, values) for effect, values in self.active_effects for face in effect.faces)
        return [(face, values) for face, values in faces if isinstance(face, Block)]

    def disturbance(
        self, time: NDArray[np.float64], recorded: Mapping[str, NDArray[np.float64]] | None = None
    ) -> NDArray[np.float64] | None:
        """Return what the effects add to the reading [m], n values; None if none does.

        Parameters
        ----------
        time
            Of the samples [s], n values.
        recorded
            Columns, n values each; an effect that needs one that is not there adds nothing.
        """
        there, total = recorded or {}, None
        for effect, values in self.active_effects:
            for face in effect.faces:
                if isinstance(face, Disturbance) and set(face.columns) <= set(there):
                    added = face.reading(values, there, time)
                    total = added if total is None else total + added
        return total


def by_name(given: Iterable[tuple[Effect, Values]]) -> list[tuple[Effect, Values]]:
    """Return the effects that act, in an order that does not depend on the one in which they were added."""
    return sorted((each for each in given if not each[0].is_null(each[1])), key=lambda each: each[0].name)
