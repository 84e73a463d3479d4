"""An effect: one piece of physics that can be added to a model, and the faces through which it acts.

The same description serves static tables, time series and frequency responses. An effect at the null of its
parameters leaves the model it is added to unchanged, bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model.linkage import Member, MemberKind
from flexdesign.core.model.parameter import Parameter

Values = Mapping[str, float]
Floats = NDArray[np.float64]
#: Among the recorded columns that a `Disturbance` may need: the response of another axis of the stage.
OTHER = "another axis"
#: Classes of actuators, by which effects and remedies differ; those of a design are stacks.
PIEZO = "piezo stack"
ACTUATORS = (PIEZO, "voice coil", "motor", "other")


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
    """A face that changes base values: payload mass, modulus, a soft base.

    Parameters
    ----------
    apply
        ``apply(base_values, own_values)`` returns the adjusted base values and leaves its arguments alone.
    of
        Whose base values: those of an ``axis`` in time are its ``natural_frequency``, ``damping_ratio`` and ``gain``;
        those of a ``part`` at rest are listed in `flexdesign.analytic.compliance.BASE`.
    """

    apply: Callable[[Values, Values], dict[str, float]]
    of: Literal["axis", "part"] = "axis"


@dataclass(frozen=True)
class Resonance:
    """A face that adds a mode to an axis.

    ``mode(values)`` returns its natural frequency [Hz], its damping ratio and the share of the static response that it
    takes from the main mode.
    """

    mode: Callable[[Values], tuple[float, float, float]]


@dataclass(frozen=True)
class Disturbance:
    """A face that adds to what the sensor reads something that does not depend on the motion of its axis.

    Parameters
    ----------
    reading
        ``reading(values, recorded, time)`` returns what is added [m], n values; `recorded` holds the columns it needs,
        n values each in SI, `time` is the recorded one [s].
    columns
        The recorded columns it needs; `OTHER` is the response of another axis. A run that lacks one cannot
        show the effect.
    """

    reading: Callable[[Values, Mapping[str, Floats], Floats], Floats]
    columns: tuple[str, ...] = ()


@dataclass(frozen=True)
class Maxwell:
    """A linear force with relaxations, over the stiffness: f = -dashpot x' - sum k (x - y), y' = rate (x - y).

    Parameters
    ----------
    dashpot
        Viscosity over the stiffness [s].
    elements
        Pairs: the rate of a Maxwell element [1/s], and its stiffness over that of the stage.
    """

    dashpot: float
    elements: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Block:
    """A face that takes part in the signal chain in time.

    A block has the hooks that its physics needs. Hooks are plain functions of arrays of floats, written so that they
    compile: they call nothing but `math` and functions of their own file. They are compiled one by one when a chain
    first needs them, so that a chain put together anew costs no compilation.

    Parameters
    ----------
    socket
        Where it sits. Blocks of one socket work side by side on the same input, and their outputs add up.
    mode
        ``"replace"`` if it takes the place of what the socket does by itself (pass the signal on); at most one may.
    states
        Names of its state variables, all zero at rest.
    memory
        Further floats of state, for a history.
    constants
        ``constants(values, step)`` gives the numbers its hooks need, from its parameters in SI and the length of the
        step [s]; for ``tick`` the step is the sampling period.
    move
        ``move(path, out, state, constants)``, for sockets before and after the mechanics: `path` holds the input at
        the start, the middle and the end of a step; adds its output there to `out` and takes its state to the end. The
        input may have jumped since the last step; between the three points it is a parabola.
    flow
        ``flow(drive, position, velocity, state, rates, constants)``, for forces: returns the force on the moving mass
        over the stiffness, as the displacement it would cause at rest [m], and fills the rates of its states.
    pull
        ``pull(begin, end, state, constants)``, for forces that depend on the path of the position alone and bend
        somewhere on it, such as friction and contacts: takes its state from one position to the other and returns the
        force there, as `flow` does. However fast its state follows, it asks for no shorter steps.
    maxwell
        ``maxwell(values)``, for forces that are linear: a dashpot and Maxwell elements, which are solved exactly with
        the modes. It need not compile.
    tick
        ``tick(value, state, constants)``, once per sample at the command or the sensor: returns the new value.
    transfer
        ``transfer(values, frequency, bias, amplitude)``, how small sines about a working point pass: n complex numbers
        or one for n frequencies [Hz], output over input of the socket; for forces the force as `flow` gives it over the
        position. `bias` is the input at the working point, `amplitude` that of the sine there, zero where it is not
        known; what depends on it answers with its describing function. A block without it lets small sines through
        as they are, and no frequency response shows it. It need not compile.
    relaxing
        ``relaxing(values)``, pairs for its slow linear states: the time constant [s], and by what share of the stroke
        the response still moves if the state began as far from rest as it may. What a state did before a record is
        unknown. It need not compile.
    settled
        ``settled(values, bias)``, what the block adds to its output at rest at a working point, where that is none of
        `transfer` times the bias: for forces the force. It need not compile.
    """

    socket: Socket
    mode: Literal["add", "replace"] = "add"
    states: tuple[str, ...] = ()
    memory: int = 0
    constants: Callable[[Values, float], Sequence[float]] = lambda values, step: ()
    move: Callable[[Floats, Floats, Floats, Floats], None] | None = None
    flow: Callable[[float, float, float, Floats, Floats, Floats], float] | None = None
    pull: Callable[[float, float, Floats, Floats], float] | None = None
    maxwell: Callable[[Values], Maxwell] | None = None
    tick: Callable[[float, Floats, Floats], float] | None = None
    transfer: Callable[[Values, Floats, float, float], complex | NDArray[np.complex128]] | None = None
    relaxing: Callable[[Values], Sequence[tuple[float, float]]] | None = None
    settled: Callable[[Values, float], float] | None = None

    @property
    def remembers(self) -> bool:
        """Whether its output depends on more than the present input."""
        return bool(self.states or self.memory or self.maxwell)


@dataclass(frozen=True)
class Controller:
    """What turns reference and sensor reading into a command, once per sample; several in one loop add up.

    Parameters
    ----------
    name
        Its name in tables.
    values
        Its settings, SI.
    tick
        ``tick(reference, reading, excess, state, constants)`` returns its share of the command [V]; `excess` is what
        the limits cut off the whole command one sample ago (requested less applied), zero while they do not act.
    constants
        ``constants(values, period)`` gives the numbers `tick` needs.
    states
        Names of its state variables, zero at the start.
    """

    name: str
    values: Values
    tick: Callable[[float, float, float, Floats, Floats], float]
    constants: Callable[[Values, float], Sequence[float]]
    states: tuple[str, ...] = ()


@dataclass(frozen=True)
class Elastic:
    """What a member's material and width do to its stiffness.

    Parameters
    ----------
    youngs_modulus
        E [Pa].
    poissons_ratio
        nu.
    constraint
        How much of what keeps wide members from contracting sideways is reckoned with: 0 is plane stress, 1 as much as
        there is.
    """

    youngs_modulus: float
    poissons_ratio: float
    constraint: float = 0.0

    @property
    def shear_modulus(self) -> float:
        """G [Pa]."""
        return self.youngs_modulus / (2 * (1 + self.poissons_ratio))


@dataclass(frozen=True)
class Term:
    """A face that adds compliance to the members of one kind.

    Parameters
    ----------
    member_kind
        Of these.
    compliance
        ``compliance(member, elastic, values)`` is 3 by 3, SI: the motion of the member's end relative to its start, as
        the one at its centre, per force there: along the member, across it to the left, and turning to the left.
    out_of_plane
        Whether it is out of the mechanism's plane instead, which shows in a stage alone: along z, twisting about the
        member, and turning about the line across it.
    """

    member_kind: MemberKind
    compliance: Callable[[Member, Elastic, Values], Floats]
    out_of_plane: bool = False


@dataclass(frozen=True)
class Reshape:
    """A face that changes the shape of the members of some kinds.

    Parameters
    ----------
    member_kinds
        Of these.
    shape
        ``shape(member, values)`` returns the true member.
    number
        The parameter that selects the member that is changed: 1 is the first of these kinds in the linkage. Empty if
        all are.
    """

    member_kinds: tuple[MemberKind, ...]
    shape: Callable[[Member, Values], Member]
    number: str = ""

    def changed(self, members: Sequence[Member], values: Values) -> tuple[Member, ...]:
        """Return which of the members of a linkage change their shape."""
        its = tuple(member for member in members if member.kind in self.member_kinds)
        if not self.number:
            return its
        place = round(values[self.number]) - 1
        return its[place : place + 1]


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
        What one can do about it, whatever drives the axis.
    reference
        Where it is described.
    parameters
        Its strengths and constants; each states its null.
    faces
        How it acts; none if a parameter of the stage model represents it.
    confused_with
        Names of effects that look alike.
    cautions
        ``cautions(values)`` says what is physically doubtful about values in SI; nothing if they are sound.
    remedies
        What one can do about it with an actuator of one of the classes `ACTUATORS`, where that differs.
    is_hysteresis
        Whether it is the hysteresis that every piezo stack has, or replaces it: rising and falling voltage make a
        loop, however slow. A stage model of a stack without such an effect is said to assume none.
    is_linear
        Whether it leaves the response to the command linear: twice the command gives twice the response.
    actuators
        Classes of actuators that can have it.

    Raises
    ------
    ValueError
        If there is a remedy for an actuator that is none of these.
    """

    name: str
    physics: str
    where: str
    reveal: str
    remedy: str
    reference: str
    parameters: tuple[Parameter, ...]
    faces: tuple[Adjust | Block | Disturbance | Reshape | Resonance | Term, ...]
    confused_with: tuple[str, ...] = ()
    cautions: Callable[[Values], tuple[str, ...]] = lambda values: ()
    remedies: Mapping[str, str] = field(default_factory=dict, hash=False)
    is_hysteresis: bool = False
    is_linear: bool = False
    actuators: tuple[str, ...] = ACTUATORS

    def __post_init__(self) -> None:
        if unknown := [actuator for actuator in self.remedies if actuator not in ACTUATORS]:
            raise ValueError(f"has a remedy for {unknown[0]!r}; known actuators: {', '.join(ACTUATORS)}")

    def can_be_of(self, actuator: str) -> bool:
        """Tell whether an axis can have it that is driven by a class of actuator; empty if that is not known."""
        return not actuator or actuator in self.actuators

    def remedy_for(self, actuator: str = "") -> str:
        """Return what one can do about it with a class of actuator; without one the neutral answer."""
        return self.remedies.get(actuator, self.remedy)

    @property
    def acts_at_rest(self) -> bool:
        """Whether it has a face that changes the stiffnesses of a part: a static effect."""
        return any(_is_static(face) for face in self.faces)

    @property
    def acts_in_time(self) -> bool:
        """Whether recordings can show one of its faces; without faces, a parameter of the stage model represents it."""
        return not self.faces or any(not _is_static(face) for face in self.faces)

    @property
    def is_curve(self) -> bool:
        """Whether it only bends the static relation of command and reading: not linear, and without memory."""
        has_memory = any(not isinstance(face, Block) or face.remembers for face in self.faces)
        return bool(self.faces) and not self.is_linear and not has_memory

    def is_null(self, values: Values) -> bool:
        """Tell whether the effect is switched off: all its strengths stand at their nulls."""
        return bool(self._nulls) and all(values[name] == null for name, null in self._nulls)

    @cached_property
    def _nulls(self) -> tuple[tuple[str, float], ...]:
        return tuple((p.name, p.null) for p in self.parameters if p.null is not None)


def _is_static(face: object) -> bool:
    return isinstance(face, Term | Reshape) or (isinstance(face, Adjust) and face.of == "part")
