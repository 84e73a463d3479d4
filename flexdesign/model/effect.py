"""An effect: one piece of physics that can be added to a model, and the faces through which it acts.

The same description serves static tables, time series and frequency responses. An effect at the null of its
parameters leaves the model it is added to unchanged, bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Literal

from flexdesign.model.linkage import Member, MemberKind
from flexdesign.model.parameter import Parameter

Values = Mapping[str, float]


class Socket(Enum):
    """Where in the signal chain a block sits; the order of the members is the order of the signal."""

    COMMAND = 0
    DRIVER = 1
    HYSTERESIS = 2
    ACTUATOR = 3
    FORCE = 4
    MECHANICS = 5
    SENSOR = 6


@dataclass(frozen=True)
class Adjust:
    """A face that changes base values: payload mass, modulus, over-cut.

    ``apply(base_values, own_values)`` returns the adjusted base values and leaves its arguments alone.
    """

    apply: Callable[[Values, Values], dict[str, float]]


@dataclass(frozen=True)
class Block:
    """A face that takes part in the signal chain in time.

    ``flow`` gives rates, ``move`` advances exactly over a step and across jumps, ``tick`` acts once per sample.
    """

    socket: Socket
    mode: Literal["add", "replace"] = "add"
    states: tuple[str, ...] = ()
    constants: Callable[[Values, float], Any] | None = None
    flow: Callable[..., Any] | None = None
    move: Callable[..., Any] | None = None
    tick: Callable[..., Any] | None = None
    memory: int = 0


@dataclass(frozen=True)
class Term:
    """A face that adds compliance to the members of one kind: ``compliance(member, values)`` is 6 by 6, SI."""

    member_kind: MemberKind
    compliance: Callable[[Member, Values], Any]


@dataclass(frozen=True)
class Effect:
    """One piece of physics with everything a user needs to decide about it.

    Parameters
    ----------
    name
        One word, as files and commands use it.
    physics
        What happens, in a paragraph.
    where
        Where in the machine it acts.
    reveal
        The experiment that shows it.
    remedy
        What one can do about it.
    reference
        Where it is described.
    parameters
        Its strengths and constants; each states its null.
    faces
        How it acts.
    confused_with
        Names of effects that look alike.
    """

    name: str
    physics: str
    where: str
    reveal: str
    remedy: str
    reference: str
    parameters: tuple[Parameter, ...]
    faces: tuple[Adjust | Block | Term, ...]
    confused_with: tuple[str, ...] = ()

    def is_null(self, values: Values) -> bool:
        """Tell whether the effect is switched off: some strength of it stands at its null."""
        strengths = [p for p in self.parameters if p.null is not None]
        return any(values[p.name] == p.null for p in strengths)
