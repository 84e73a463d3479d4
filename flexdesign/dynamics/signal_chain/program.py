"""Chains laid out for the engine: the arrays through which it runs them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import Block, Controller, Socket
from flexdesign.core.model.effect import Values
from flexdesign.dynamics.signal_chain import engine, kernels
from flexdesign.dynamics.signal_chain.arena import Arena
from flexdesign.dynamics.signal_chain.chain import AxisChain
from flexdesign.dynamics.signal_chain.memory_layout import (
    BlockCalls,
    Coupling,
    Forces,
    Inputs,
    Modes,
    Record,
    SignalPlaces,
    State,
    Ticks,
    Timing,
)
from flexdesign.dynamics.signal_chain.partial_fractions import parts, step_matrices

#: Sockets before the mechanics, in the order of the signal.
UPSTREAM = (Socket.COMMAND, Socket.DRIVER, Socket.HYSTERESIS, Socket.ACTUATOR)


@dataclass(frozen=True)
class Program:
    """A chain laid out for the engine."""

    timing: Timing
    signals: SignalPlaces
    command_ticks: Ticks
    block_calls: BlockCalls
    forces: Forces
    modes: Modes
    sensor_ticks: Ticks
    controllers: Ticks
    state: State

    def run(self, inputs: Inputs, coupling: Coupling, bound: float) -> tuple[NDArray[np.float64], int]:
        """Run from the present state; return the record (six by axes by samples) and how many samples were run.

        Parameters
        ----------
        inputs, coupling
            What comes from outside, and what axes do to one another.
        bound
            A motion that leaves it ends the run [m].
        """
        record = np.empty((6, inputs.axes, inputs.samples))  # what the engine fills in is all that is read
        first, size = record.ctypes.data, record.strides[0]
        done = engine.run(
            inputs,
            self.timing,
            self.signals,
            self.command_ticks,
            self.block_calls,
            self.forces,
            self.modes,
            coupling,
            self.sensor_ticks,
            self.controllers,
            self.state,
            bound,
            Record(*(first + size * i for i in range(len(record)))),
        )
        return record, done


def program(
    keep: Arena,
    axes: Sequence[AxisChain],
    controllers: Mapping[str, Sequence[Controller]],
    period: float,
    substeps: int,
    *,
    delay: float = 0.0,
    is_linear: bool = False,
    every: int = 1,
    lead_period: float = 0.0,
) -> tuple[Program, Program]:
    """Lay out the chains of all axes, at rest at zero volts; return this and the same for a lead, with the same state.

    Parameters
    ----------
    keep
        Where its numbers go; they are there when it is filled.
    axes
        Their chains.
    controllers
        For each axis, by name, the controllers of its loop.
    period
        Sampling period [s].
    substeps
        Number of steps in a sample.
    delay
        How late a command acts [s].
    is_linear
        Whether commands run straight from sample to sample; otherwise they are held.
    every
        Samples between two actions of a controller.
    lead_period
        Sampling period of a lead [s], whose commands are linear and act at once; 0 where there is none.
    """
    shares, steps, lengths, late = _division(period, substeps, delay)
    segments = len(lengths)
    lengths = [*lengths, *([lead_period / substeps] if lead_period else [])]
    builder = _StepBuilder(keep, lengths)
    command, voltage, drive = zip(*(builder.upstream(axis) for axis in axes), strict=True)
    upstream = len(builder.moves)
    motion = [builder.slot() for _ in axes]
    reading = [builder.sensor(axis, place) for axis, place in zip(axes, motion, strict=True)]
    signals = keep.reals([0.0] * (3 * builder.slots))
    of_axes = [parts(axis) for axis in axes]
    modes = [part for each in of_axes for part in each]
    made = Program(
        Timing(
            segments,
            keep.reals(lengths),
            keep.ints(steps),
            late,
            is_linear,
            keep.reals(_within(shares, steps)) if is_linear else 0,
        ),
        SignalPlaces(keep.ints(command), keep.ints(voltage), keep.ints(drive), keep.ints(motion), keep.ints(reading)),
        _ticks(keep, [_block_ticks(axis, Socket.COMMAND, period) for axis in axes]),
        builder.laid_out(signals, upstream),
        _forces(keep, axes, period / substeps),
        Modes(
            len(modes),
            keep.ints(list(accumulate(map(len, of_axes), initial=0))),
            keep.reals([number for step in lengths for part in modes for number in step_matrices(part, step)]),
        ),
        _ticks(keep, [_block_ticks(axis, Socket.SENSOR, period) for axis in axes]),
        _ticks(keep, [_control_ticks(controllers.get(axis.name, ()), every * period) for axis in axes]),
        State(signals, *(keep.reals([0.0] * (2 * count)) for count in (len(modes), len(axes), len(axes)))),
    )
    return made, _lead(keep, made, axes, lead_period / substeps, substeps) if lead_period else made


def _lead(keep: Arena, made: Program, axes: Sequence[AxisChain], step: float, substeps: int) -> Program:
    """Return a program for the last of the steps that another one has numbers for, with the state of that one."""
    last, within = made.timing.segments, keep.reals(_within([1.0], [substeps]))
    blocks, forces, modes = made.block_calls, made.forces, made.modes
    return replace(
        made,
        timing=Timing(1, made.timing.step + 8 * last, keep.ints([substeps]), 0, True, within),
        block_calls=blocks._replace(constants=blocks.constants + 8 * last * blocks.number),
        forces=forces._replace(constants=keep.ints(_force_constants(keep, axes, step))),
        modes=modes._replace(passages=modes.passages + 8 * 16 * last * modes.number),
    )


def number_of_steps(period: float, substeps: int, delay: float) -> list[int]:
    """Return the number of steps in each part into which a delay divides a sample."""
    return _division(period, substeps, delay)[1]


def _division(period: float, substeps: int, delay: float) -> tuple[list[float], list[int], list[float], int]:
    """Divide a sample where the late command changes: shares, numbers and lengths of steps, and whole samples late."""
    late = math.floor(delay / period + 1e-9)
    rest = delay / period - late
    shares = [1.0] if rest < 1e-9 else [rest, 1.0 - rest]
    steps = [max(1, math.ceil(substeps * share - 1e-9)) for share in shares]
    return shares, steps, [period * share / count for share, count in zip(shares, steps, strict=True)], late


def _within(shares: Sequence[float], steps: Sequence[int]) -> list[float]:
    """Return where start, middle and end of each step lie in the stretch between two commands, as shares.

    The first of two segments is the end of such a stretch, the last one its beginning.
    """
    begins = [0.0] if len(shares) == 1 else [1.0 - shares[0], 0.0]
    return [
        begin + share * (step + half) / count
        for begin, share, count in zip(begins, shares, steps, strict=True)
        for step in range(count)
        for half in (0.0, 0.5, 1.0)
    ]


class _StepBuilder:
    """Collects what happens to the signals in a step."""

    def __init__(self, keep: Arena, steps: Sequence[float]) -> None:
        self.keep, self.steps = keep, steps
        self.slots = 0
        #: hook, input, output, state, base, constants
        self.moves: list[tuple[int, int, int, int, float, list[int]]] = []

    def slot(self) -> int:
        """Return the place of three new values in the signal array."""
        self.slots += 1
        return 3 * (self.slots - 1)

    def upstream(self, axis: AxisChain) -> tuple[int, int, int]:
        """Add the sockets before the mechanics; return the places of command, voltage and drive."""
        command = place = at_stack = self.slot()
        for socket in UPSTREAM:
            if socket is Socket.DRIVER:
                place = self._socket(place, (), axis.amplifier)
            if socket is Socket.HYSTERESIS and axis.gain < 0:
                place = self._socket(place, (), -1.0)  # so that hysteresis holds the motion back here too
            place = self._socket(place, axis.blocks(socket), abs(axis.gain) if socket is Socket.HYSTERESIS else 1.0)
            if socket is Socket.DRIVER:
                at_stack = place
        return command, at_stack, place

    def sensor(self, axis: AxisChain, place: int) -> int:
        """Add the sensor; return the place of the reading."""
        return self._socket(place, axis.blocks(Socket.SENSOR), 1.0)

    def _socket(self, source: int, blocks: Sequence[tuple[Block, Values]], base: float) -> int:
        moving = [(block, values) for block, values in blocks if block.move is not None]
        if not moving and base == 1.0:
            return source
        place = source
        for block, values in moving:  # those that replace work in series
            if block.mode == "replace":
                path, place = place, self.slot()
                self._move(block, values, path, place, 0.0)
        if place == source:
            place = self.slot()
            self.moves.append((0, source, place, 0, base, [0] * len(self.steps)))
        for block, values in moving:
            if block.mode == "add":
                self._move(block, values, source, place, math.nan)
        return place

    def _move(self, block: Block, values: Values, path: int, out: int, base: float) -> None:
        assert block.move is not None
        hook = kernels.address(block.move, "move")
        constants = [self.keep.reals(block.constants(values, step)) for step in self.steps]
        self.moves.append((hook, path, out, _state(self.keep, block), base, constants))

    def laid_out(self, signals: int, upstream: int) -> BlockCalls:
        """Return the moves as addresses."""
        columns = zip(*self.moves, strict=True) if self.moves else ((),) * 6
        hooks, paths, outs, states, bases, constants = columns
        ints, reals = self.keep.ints, self.keep.reals
        places = (ints(paths), ints(outs))
        return BlockCalls(
            len(paths),
            upstream,
            ints(hooks),
            ints([signals + 8 * path for path in paths]),
            ints([signals + 8 * out for out in outs]),
            ints(states),
            ints([address for row in zip(*constants, strict=True) for address in row]),
            *places,
            reals(bases),
        )


def _state(keep: Arena, block: Block) -> int:
    return keep.reals([0.0] * (len(block.states) + block.memory))


def _forces(keep: Arena, axes: Sequence[AxisChain], step: float) -> Forces:
    first, hooks, by_path, place = [0], list[int](), list[int](), [0]
    constants = _force_constants(keep, axes, step)
    for axis in axes:
        blocks = axis.blocks(Socket.FORCE)
        for kind in ("flow", "pull"):
            for block, _ in blocks:
                if (hook := getattr(block, kind)) is not None:
                    hooks.append(kernels.address(hook, kind))
                    place.append(place[-1] + len(block.states))
            if kind == "flow":
                by_path.append(len(hooks))
        first.append(len(hooks))
    rooms = (keep.reals([0.0] * (count * place[-1])) for count in (1, 1, 4))
    return Forces(place[-1], *(keep.ints(numbers) for numbers in (first, hooks, by_path, place, constants)), *rooms)


def _force_constants(keep: Arena, axes: Sequence[AxisChain], step: float) -> list[int]:
    """Return the addresses of the constants of all forces for a length of step [s], those with rates first."""
    return [
        keep.reals(block.constants(values, step))
        for axis in axes
        for kind in ("flow", "pull")
        for block, values in axis.blocks(Socket.FORCE)
        if getattr(block, kind) is not None
    ]


#: A hook, the number of its states, and its constants.
Tick = tuple[int, int, Sequence[float]]


def _block_ticks(axis: AxisChain, socket: Socket, period: float) -> list[Tick]:
    return [
        (kernels.address(block.tick, "tick"), len(block.states) + block.memory, block.constants(values, period))
        for block, values in axis.blocks(socket)
        if block.tick is not None
    ]


def _control_ticks(controllers: Sequence[Controller], period: float) -> list[Tick]:
    return [(kernels.address(c.tick, "control"), len(c.states), c.constants(c.values, period)) for c in controllers]


def _ticks(keep: Arena, by_axis: Sequence[Sequence[Tick]]) -> Ticks:
    flat = [tick for ticks in by_axis for tick in ticks]
    entries = [number for hook, states, c in flat for number in (hook, keep.reals([0.0] * states), keep.reals(c))]
    return Ticks(keep.ints(list(accumulate(map(len, by_axis), initial=0))), keep.ints(entries))
