"""Simulation of a stage: commands or references in, motions and readings out, with an error estimate."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.model import Controller, Socket
from flexdesign.dynamics.signal_chain.arena import Arena
from flexdesign.dynamics.signal_chain.interpolation import derivatives, smooth
from flexdesign.dynamics.signal_chain.memory_layout import Coupling, Inputs
from flexdesign.dynamics.step_error import SAFETY, error_left, is_same_divergence, relative_change

if TYPE_CHECKING:
    from flexdesign.dynamics.signal_chain.chain import AxisChain
    from flexdesign.dynamics.signal_chain.program import Program

#: The error that a simulation may have, relative to the largest span of motion.
TOLERANCE = 1e-6
#: More steps in a sample than this are not tried.
MOST_STEPS = 1024
#: A delay divides samples, and the part behind the jump of a held command may have one step in both runs that are
#: compared: a run with this multiple of the steps then decides.
UNSEEN = 8
#: With this number of steps in a sample a divergence is that of the stage; with fewer the steps may be too long.
CONVERGED_DIFFERENCE = 64
#: A motion larger than this multiple of the motion at full drive is a divergence.
RUNAWAY = 1e4


@dataclass(frozen=True)
class Loop:
    """How one axis is commanded.

    Parameters
    ----------
    command
        The command at each sample [V]; in a closed loop the feedforward, to which the controllers add theirs.
    reference
        The motion that is asked for [m]; None in an open loop.
    controllers
        None in an open loop.
    """

    command: Array
    reference: Array | None = None
    controllers: tuple[Controller, ...] = ()

    @property
    def is_closed(self) -> bool:
        """Whether the reading acts on the command."""
        return bool(self.controllers)


@dataclass(frozen=True)
class Stage:
    """Chains of all axes, and what they share.

    Parameters
    ----------
    axes
        Their chains.
    coupling
        Motion along an axis (row) per motion of an axis (column); the identity if none is given.
    quadratic_coupling
        The same per square of motion [1/m].
    limits
        For each axis, by name, the lowest and highest command [V].
    noise
        For each axis, by name, the sensor's noise, rms [m].
    """

    axes: tuple[AxisChain, ...]
    coupling: Array | None = None
    quadratic_coupling: Array | None = None
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Lead:
    """How a stage of one axis comes from rest to where a simulation begins.

    Parameters
    ----------
    command
        Linear between its samples [V]; the last one holds until a delayed command acts.
    period
        Sampling period [s], as a rule longer than that of the simulation: nobody looks.
    """

    command: Array
    period: float


@dataclass(frozen=True)
class Response:
    """What a simulation gives, arrays of axes by samples.

    Parameters
    ----------
    time
        [s]
    command, cut
        After limits; what they cut off [V].
    voltage
        At the stack [V].
    drive
        Displacement that drives the modes, referred to the output [m].
    motion, reading
        Of the table; as the sensor gives it [m].
    error
        Estimated error of the motion relative to its span; NaN if the number of steps was given.
    substeps
        Steps in a sample.
    diverged
        Time at which the motion ran away, or None; arrays end there.
    """

    time: Array
    command: Array
    cut: Array
    voltage: Array
    drive: Array
    motion: Array
    reading: Array
    error: float
    substeps: int
    diverged: float | None


def simulate(
    stage: Stage,
    loops: Mapping[str, Loop],
    period: float,
    *,
    delay: float = 0.0,
    between_samples: str = "hold",
    oversampling: int = 1,
    seed: int = 0,
    tolerance: float = TOLERANCE,
    substeps: int | None = None,
    most_steps: int = MOST_STEPS,
    disturbances: Mapping[str, Array] | None = None,
    lead: Lead | None = None,
) -> Response:
    """Run a stage from rest at zero volts, or from where a lead has brought it.

    The number of steps in a sample is doubled until the motion changes by less than the tolerance; the residual is
    estimated from the last changes.

    Parameters
    ----------
    stage
        Its axes; those without a loop rest.
    loops
        Command or loop of each axis, by name; all of one length.
    period
        Sampling period [s].
    delay
        How late commands act [s].
    between_samples
        ``"hold"`` or, in an open loop, ``"linear"`` or ``"smooth"``: see `signal_chain.interpolation`.
    oversampling
        How many samples of the response to give for each sampling period, to show what happens between them.
    seed
        Of the sensor noise.
    tolerance
        Error allowed, relative to the largest span of motion.
    substeps
        A fixed number of steps, for fits that need a smooth dependence; no error is estimated then.
    most_steps
        More than these are not tried, and the error is what it is.
    disturbances
        For each axis, by name, what is added to its reading at each sample, in addition to noise [m]; may be NaN in an
        open loop. By default what effects of the axis add that need no recorded column, such as hum.
    lead
        What brings a stage of one axis to the first sample, in an open loop.

    Raises
    ------
    ValueError
        If lengths differ, a command or reference is not finite, or a loop is closed with commands that are not held.
    """
    inputs = _Inputs(stage, loops, period, delay, between_samples, oversampling, seed, disturbances, lead)
    if substeps is not None:
        return inputs.response(substeps, math.nan)
    steps, changes = 1, list[float]()
    coarse = inputs.response(steps, math.inf)
    while True:
        steps *= 2
        fine = inputs.response(steps, math.inf)
        if fine.diverged is not None:
            both = coarse.diverged is not None and is_same_divergence(coarse.motion, fine.motion)
            if both or steps >= CONVERGED_DIFFERENCE:
                return fine
        elif coarse.diverged is None:
            changes.append(inputs.change(coarse, fine))
            error = error_left(changes, inputs.most_order)
            # Readings in whole steps decide by less than any tolerance: then changes stop falling. Two that do not fall
            # say little: a lag faster than the first steps is not resolved by them.
            stalled = len(changes) > 3 and min(changes[-3:]) > 0.7 * changes[-4]
            if stalled or steps >= most_steps:
                return replace(fine, error=error)
            if error <= tolerance:
                unseen = inputs.change_unseen(steps, fine, most_steps)
                if SAFETY * unseen <= tolerance:
                    return replace(fine, error=max(error, SAFETY * unseen))
                # What the parts of a sample leave that had one step in both.
                steps, changes = min(UNSEEN * steps, most_steps // 2), []
                fine = inputs.response(steps, math.inf)
        coarse = fine


class _Inputs:
    """Arrays for the engine that do not depend on the number of steps."""

    def __init__(
        self,
        stage: Stage,
        loops: Mapping[str, Loop],
        period: float,
        delay: float,
        between_samples: str,
        oversampling: int,
        seed: int,
        disturbances: Mapping[str, Array] | None,
        lead: Lead | None,
    ) -> None:
        names = [axis.name for axis in stage.axes]
        lengths = {len(loop.command) for loop in loops.values()}
        if len(lengths) != 1 or not set(loops) <= set(names):
            raise ValueError(f"commands need one length, and axes among {', '.join(names)}")
        self.is_smooth = between_samples == "smooth"
        self.is_linear = between_samples == "linear" or self.is_smooth
        if self.is_linear and any(loop.is_closed for loop in loops.values()):
            raise ValueError("the command of a closed loop is held between samples")
        self.stage, self.delay, self.every, self.lead = stage, delay, oversampling, lead
        self.period = period / oversampling
        self.controllers = {name: loop.controllers for name, loop in loops.items()}
        rest = Loop(np.zeros(lengths.pop()))
        self.ordered = [loops.get(name, rest) for name in names]
        self.given = self._finer([loop.command for loop in self.ordered])
        self.reference = self._finer([self._reference(loop) for loop in self.ordered])
        self.count = self.given.shape[1]
        sizes = np.array([[stage.noise.get(name, 0.0)] for name in names])
        self.noise = np.zeros((len(names), self.count))
        if sizes.any():
            self.noise += sizes * np.random.default_rng(seed).standard_normal(self.noise.shape)
        self._disturb(disturbances)
        limits = [stage.limits.get(name, (-math.inf, math.inf)) for name in names]
        self.limits = np.array(limits, dtype=np.float64)
        self.derivatives = None
        if self.is_smooth:
            within = np.clip(self.given, self.limits[:, :1], self.limits[:, 1:])
            self.derivatives = np.array([derivatives(row) for row in within])

    @staticmethod
    def _reference(loop: Loop) -> Array:
        return np.zeros(len(loop.command)) if loop.reference is None else loop.reference

    def _finer(self, rows: Sequence[Array]) -> Array:
        """Return rows with further samples in between, held or linear, up to the last one given."""
        given = np.array(rows, dtype=np.float64)
        if not np.isfinite(given).all():
            raise ValueError("a command or reference is not finite")
        if self.every == 1:
            return given
        last = given.shape[1] - 1
        at = np.arange(last * self.every + 1) / self.every
        if self.is_smooth:
            return np.array([smooth(row, at) for row in given])
        if self.is_linear:
            return np.array([np.interp(at, np.arange(last + 1), row) for row in given])
        return np.ascontiguousarray(given[:, np.floor(at + 1e-9).astype(np.intp)])

    def _disturb(self, given: Mapping[str, Array] | None) -> None:
        """Add to the noise what else disturbs the readings."""
        time = self.period * np.arange(self.count, dtype=np.float64)
        for row, axis, loop in zip(self.noise, self.stage.axes, self.ordered, strict=True):
            if given is None:
                added = axis.disturbance(time)
            elif (added := given.get(axis.name)) is not None:
                if len(added) != len(loop.command) or (loop.is_closed and not np.isfinite(added).all()):
                    raise ValueError("a disturbance needs as many values as the command, in a closed loop finite ones")
                added = np.interp(time, time[:: self.every], added)
            if added is not None:
                row += added

    def response(self, substeps: int, error: float) -> Response:
        """Run once with a number of steps in a sample."""
        from flexdesign.dynamics.signal_chain.program import program  # compiles: only where something is run

        keep = Arena()
        laid_out, of_lead = program(
            keep,
            self.stage.axes,
            self.controllers,
            self.period,
            substeps,
            delay=self.delay,
            is_linear=self.is_linear,
            every=self.every,
            lead_period=self.lead.period if self.lead else 0.0,
        )
        inputs, coupling, bound = self._inputs(keep), self._coupling(keep), self._runaway_limit()
        keep.fill()
        if self.lead is not None and not self._is_led(of_lead, inputs, coupling, bound):
            empty = np.zeros((inputs.axes, 0))
            return Response(empty[0], empty, empty, empty, empty, empty, empty, error, substeps, 0.0)
        record, done = laid_out.run(inputs, coupling, bound)
        time = self.period * np.arange(done, dtype=np.float64)
        diverged = None if done == self.count else done * self.period
        command, cut, voltage, drive, motion, reading = record[:, :, :done]
        return Response(time, command, cut, voltage, drive, motion, reading, error, substeps, diverged)

    def _inputs(self, keep: Arena) -> Inputs:
        axes = len(self.stage.axes)
        return Inputs(
            axes,
            self.count,
            self.every,
            self.given.ctypes.data,
            self.reference.ctypes.data,
            self.noise.ctypes.data,
            keep.ints([loop.is_closed for loop in self.ordered]),
            self.limits.ctypes.data,
            0 if self.derivatives is None else self.derivatives.ctypes.data,
            keep.reals([self.lead.command[-1]] if self.lead else [0.0] * axes),
        )

    def _coupling(self, keep: Arena) -> Coupling:
        axes = len(self.stage.axes)
        linear = np.eye(axes) if self.stage.coupling is None else self.stage.coupling
        square = np.zeros((axes, axes)) if self.stage.quadratic_coupling is None else self.stage.quadratic_coupling
        return Coupling(keep.reals(np.ravel(linear).tolist()), keep.reals(np.ravel(square).tolist()))

    def _is_led(self, of_lead: Program, inputs: Inputs, coupling: Coupling, bound: float) -> bool:
        """Run the lead, whose state the record begins with; return whether its motion stays within the bound."""
        assert self.lead is not None
        command, still = self.lead.command, np.zeros((2, len(self.lead.command)))
        given, rests = command.ctypes.data, still.ctypes.data
        leading = inputs._replace(samples=len(command), given=given, reference=rests, noise=rests, derivatives=0)
        return of_lead.run(leading, coupling, bound)[1] == len(command)

    def change_unseen(self, steps: int, found: Response, most: int) -> float:
        """Return what more steps change behind jumps of a held command, relative; zero where half as many suffice."""
        from flexdesign.dynamics.signal_chain.program import number_of_steps

        coarse, fine = (number_of_steps(self.period, count, self.delay)[-1] for count in (steps // 2, steps))
        if self.is_linear or fine > coarse:
            return 0.0
        finer = self.response(min(UNSEEN * steps, most), math.inf)
        return math.inf if finer.diverged is not None else self.change(found, finer)

    def change(self, coarse: Response, fine: Response) -> float:
        """Return by how much two runs differ in what the tolerance is for, relative to its span."""
        pairs = zip(self.compared_signals(coarse), self.compared_signals(fine), strict=True)
        # A stage may stand still in a record, to which it came a long way.
        least = abs(self.stage.axes[0].gain) * float(np.ptp(self.lead.command)) if self.lead else 0.0
        return max(relative_change(a, b, least) for a, b in pairs)

    def compared_signals(self, response: Response) -> list[Array]:
        """Return what the tolerance is for: the motion, and the reading if it does not come in whole steps."""
        rounded = any(block.tick for axis in self.stage.axes for block, _ in axis.blocks(Socket.SENSOR))
        return [response.motion] if rounded else [response.motion, response.reading]

    @property
    def most_order(self) -> float:
        """The order of convergence that an error estimate may count on: lower where a force bends within steps."""
        bends = any(block.pull for axis in self.stage.axes for block, _ in axis.blocks(Socket.FORCE))
        return 2.0 if bends else 4.0

    def _runaway_limit(self) -> float:
        """Return how large a motion may grow: far beyond what full drive gives."""
        largest = [abs(limit) for limit in self.limits.flat if math.isfinite(limit)]
        before = float(np.abs(self.lead.command).max()) if self.lead else 0.0
        largest_command = max(float(np.abs(self.given).max()), before, *largest)
        gain = max(abs(axis.gain) for axis in self.stage.axes)
        return RUNAWAY * (gain * largest_command + float(np.abs(self.reference).max())) or math.inf
