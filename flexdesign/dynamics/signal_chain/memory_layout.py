"""What the engine is given: the tables of a chain, by the addresses of their arrays.

Addresses, because an array that compiled code takes apart is counted at every turn, and that counting cost more than
the physics. `flexdesign.dynamics.signal_chain.program` makes the arrays and keeps them.
"""

from __future__ import annotations

from typing import NamedTuple

#: The address of whole numbers, and of numbers.
Ints = int
Reals = int


class BlockCalls(NamedTuple):
    """What happens to the signals' three values in a step, in order; those from `upstream` on are the sensors'.

    For each move: the addresses of its hook (0: none), input, output and state, and of its constants (a row for each
    segment); places in the signal array, of which the target first becomes `base` times the source, unless NaN.
    """

    number: int
    upstream: int
    hook: Ints
    path: Ints
    out: Ints
    state: Ints
    constants: Ints
    source: Ints
    target: Ints
    base: Reals


class Modes(NamedTuple):
    """The modes, or parts of them, axis after axis, see `partial_fractions.Part`, under drive and force together.

    `first` holds for each axis its first mode, and the count behind the last. A passage, one for each segment and
    mode, holds 16 numbers: transition over half a step (4), weights of an input that is constant over half a step (2),
    transition over the step (4), weights of the drive at its start, middle and end (6).
    """

    number: int
    first: Ints
    passages: Reals


class Forces(NamedTuple):
    """Forces that depend on the motion: for each axis its first; their hooks, places of states, and constants.

    `by_path` holds for each axis the first of those that follow the path of the position (`pull`); those before have
    rates (`flow`). In addition to the states, of which there are `number`, there is room for their trial values, and
    for their rates at the four stages of a step, one stage after the other.
    """

    number: int
    first: Ints
    hook: Ints
    by_path: Ints
    place: Ints
    constants: Ints
    states: Reals
    trial: Reals
    rates: Reals


class Ticks(NamedTuple):
    """What happens once per sample: for each axis its first tick; for each tick its hook, state and constants."""

    first: Ints
    entries: Ints


class Inputs(NamedTuple):
    """What comes from outside, axes by samples.

    `given` is the command, or in a closed loop the feedforward. `limits` are the lowest and highest command of each
    axis; `closed` is 1 where controllers act, at every `every`-th sample. `derivatives` are those of a command that is
    smooth between its samples, per sample; 0 where it is not. `before` is the command of each axis before the first.
    """

    axes: int
    samples: int
    every: int
    given: Reals
    reference: Reals
    noise: Reals
    closed: Ints
    limits: Reals
    derivatives: Reals
    before: Reals


class Timing(NamedTuple):
    """How a sample is divided: for each segment its step [s] and the number of these.

    The command that acts is `late` samples old, and one more in the first of two segments; it is held, or linear. Then
    `within` holds for each step where its start, middle and end lie in the stretch between two commands, as shares.
    """

    segments: int
    step: Reals
    steps: Ints
    late: int
    linear: bool
    within: Reals


class SignalPlaces(NamedTuple):
    """Places in the signal array: of command, voltage, drive, motion and reading of each axis."""

    command: Ints
    voltage: Ints
    drive: Ints
    motion: Ints
    reading: Ints


class State(NamedTuple):
    """What changes: the signals' values, and pairs of position and velocity.

    They are those of each mode, of each axis now, and of each axis one step before.
    """

    signals: Reals
    modes: Reals
    axis_motion: Reals
    previous_axis_motion: Reals


class Coupling(NamedTuple):
    """Motion along an axis (row) per motion of an axis (column), and per its square."""

    linear: Reals
    quadratic: Reals


class Record(NamedTuple):
    """What is kept of a run, axes by samples."""

    command: Reals
    cut: Reals
    voltage: Reals
    drive: Reals
    motion: Reals
    reading: Reals
