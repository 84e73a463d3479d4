"""The engine: steps a whole stage, axis by axis and sample by sample, through the addresses of its chain.

Upstream of the mechanics a signal is known at the start, the middle and the end of each step, and every block takes
the three values of its input to the three of its output, exactly for what is linear. The modes are advanced exactly
under the parabola through the three values of the drive; forces that depend on the motion enter by the fourth-order
exponential Runge-Kutta scheme of Cox and Matthews (J. Comput. Phys. 176, 2002), whose weights are those of the
parabola, so that without such forces nothing but the parabola is approximate.

All of it stands in one file, as numba would not notice a change in another.
"""

from __future__ import annotations

from numba import njit

from flexdesign.dynamics.signal_chain.kernels import (
    call_control,
    call_flow,
    call_move,
    call_pull,
    call_tick,
    ints,
    reals,
)
from flexdesign.dynamics.signal_chain.memory_layout import (
    BlockCalls,
    Coupling,
    Forces,
    Inputs,
    Modes,
    Reals,
    Record,
    SignalPlaces,
    State,
    Ticks,
    Timing,
)

#: What `run` calls is compiled into it; nothing else calls it, so that it needs no way in of its own.
inside = njit(nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=True)
#: The same for what is called at one place: put there before anything is compiled, it is not optimised twice.
once = njit(nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True, inline="always")


@njit(cache=True, nogil=True, error_model="numpy")
def run(
    inputs: Inputs,
    timing: Timing,
    places: SignalPlaces,
    command_ticks: Ticks,
    block_calls: BlockCalls,
    forces: Forces,
    modes: Modes,
    coupling: Coupling,
    sensor_ticks: Ticks,
    controllers: Ticks,
    state: State,
    bound: float,
    record: Record,
) -> int:
    """Run all samples; return their number, or the sample at which a motion left `bound` or stopped being a number."""
    closed, given, steps = ints(inputs.closed), reals(inputs.given), ints(timing.steps)
    motion = reals(record.motion)
    for axis in range(inputs.axes):
        if not closed[axis]:
            for at in range(axis * inputs.samples, (axis + 1) * inputs.samples):
                _apply(axis, at, given[at], command_ticks, inputs, record)
    for k in range(inputs.samples):
        for axis in range(inputs.axes):
            at = axis * inputs.samples + k
            motion[at] = _table_position(axis, inputs.axes, state.axis_motion, coupling)
            if not abs(motion[at]) < bound:
                return k
            _observe(axis, at, motion[at], inputs, places, block_calls, sensor_ticks, state, record)
            if closed[axis] and k % inputs.every:
                reals(record.command)[at], reals(record.cut)[at] = (
                    reals(record.command)[at - 1],
                    reals(record.cut)[at - 1],
                )
            elif closed[axis]:
                _apply(
                    axis, at, _add_controllers(axis, at, k, inputs, controllers, record), command_ticks, inputs, record
                )
        if k < inputs.samples - 1:
            within = timing.within
            for segment in range(timing.segments):
                for _ in range(steps[segment]):
                    _advance(
                        k, segment, within, inputs, timing, places, block_calls, forces, modes, coupling, state, record
                    )
                    within += 24  # three numbers on
    return inputs.samples


# --- once per sample --------------------------------------------------------------------------------------------


@once
def _observe(
    axis: int,
    at: int,
    motion: float,
    inputs: Inputs,
    places: SignalPlaces,
    block_calls: BlockCalls,
    ticks: Ticks,
    state: State,
    record: Record,
) -> None:
    """Take the reading of an axis, and record voltage and drive."""
    signals = reals(state.signals)
    y = signals[ints(places.reading)[axis] + 2] if block_calls.upstream < block_calls.number else motion
    reals(record.reading)[at] = _apply_ticks(axis, y + reals(inputs.noise)[at], ticks)
    reals(record.voltage)[at] = signals[ints(places.voltage)[axis] + 2]
    reals(record.drive)[at] = signals[ints(places.drive)[axis] + 2]


@once
def _add_controllers(axis: int, at: int, k: int, inputs: Inputs, controllers: Ticks, record: Record) -> float:
    """Return feedforward and controllers together."""
    first, entries = ints(controllers.first), ints(controllers.entries)
    u = reals(inputs.given)[at]
    r, y = reals(inputs.reference)[at], reals(record.reading)[at]
    over = reals(record.cut)[at - 1] if k > 0 else 0.0
    for i in range(first[axis], first[axis + 1]):
        u += call_control(entries[3 * i], r, y, over, entries[3 * i + 1], entries[3 * i + 2])
    return u


@inside
def _apply(axis: int, at: int, wanted: float, ticks: Ticks, inputs: Inputs, record: Record) -> None:
    """Pass a command through its ticks and limits."""
    limits, command = reals(inputs.limits), reals(record.command)
    u = _apply_ticks(axis, wanted, ticks)
    command[at] = min(max(u, limits[2 * axis]), limits[2 * axis + 1])
    reals(record.cut)[at] = u - command[at]


@inside
def _apply_ticks(axis: int, value: float, ticks: Ticks) -> float:
    first, entries = ints(ticks.first), ints(ticks.entries)
    for i in range(first[axis], first[axis + 1]):
        value = call_tick(entries[3 * i], value, entries[3 * i + 1], entries[3 * i + 2])
    return value


# --- once per step ----------------------------------------------------------------------------------------------


@once
def _advance(
    k: int,
    segment: int,
    within: Reals,
    inputs: Inputs,
    timing: Timing,
    places: SignalPlaces,
    block_calls: BlockCalls,
    forces: Forces,
    modes: Modes,
    coupling: Coupling,
    state: State,
    record: Record,
) -> None:
    """Advance the whole stage by one step."""
    length = reals(timing.step)[segment]
    for axis in range(inputs.axes):
        _command(axis, k, segment, within, inputs, timing, places, state, record)
    _move(0, block_calls.upstream, segment, block_calls, state)
    drive, first = ints(places.drive), ints(forces.first)
    axis_motion, previous = reals(state.axis_motion), reals(state.previous_axis_motion)
    for axis in range(inputs.axes):
        previous[2 * axis], previous[2 * axis + 1] = axis_motion[2 * axis], axis_motion[2 * axis + 1]
        if first[axis + 1] > first[axis]:
            _advance_with_forces(axis, segment, drive[axis], length, modes, forces, state)
        else:
            _free(axis, segment, drive[axis], modes, state)
    if block_calls.upstream < block_calls.number:
        _motion(length, inputs.axes, places, coupling, state)
        _move(block_calls.upstream, block_calls.number, segment, block_calls, state)


@once
def _command(
    axis: int,
    k: int,
    segment: int,
    within: Reals,
    inputs: Inputs,
    timing: Timing,
    places: SignalPlaces,
    state: State,
    record: Record,
) -> None:
    """Fill in the command at the start, the middle and the end of a step."""
    path, command = reals(state.signals), reals(record.command)
    place, row = ints(places.command)[axis], axis * inputs.samples
    index = k - timing.late - (timing.segments - 1 - segment)
    held = command[row + index] if index >= 0 else reals(inputs.before)[axis]
    if not timing.linear:
        path[place] = path[place + 1] = path[place + 2] = held
        return
    # Before its first value a linear command rests, then it jumps there.
    following = command[row + min(index + 1, inputs.samples - 1)] if index >= 0 else held
    share = reals(within)
    for i in range(3):
        path[place + i] = held + (following - held) * share[i]
    if inputs.derivatives != 0 and index >= 0:  # a cubic with the right derivatives at both samples
        slope, difference = reals(inputs.derivatives), following - held
        previous, after = slope[row + index] - difference, slope[row + min(index + 1, inputs.samples - 1)] - difference
        for i in range(3):
            f = share[i]
            path[place + i] += f * (1.0 - f) * (previous * (1.0 - f) - after * f)


@inside
def _move(first: int, last: int, segment: int, block_calls: BlockCalls, state: State) -> None:
    """Let blocks take their three values of input to three values of output."""
    signals, base, hook = reals(state.signals), reals(block_calls.base), ints(block_calls.hook)
    source, target = ints(block_calls.source), ints(block_calls.target)
    path, out, states, constants = (
        ints(block_calls.path),
        ints(block_calls.out),
        ints(block_calls.state),
        ints(block_calls.constants),
    )
    for i in range(first, last):
        if base[i] == base[i]:
            for node in range(3):
                signals[target[i] + node] = base[i] * signals[source[i] + node] if base[i] != 0.0 else 0.0
        if hook[i] != 0:
            call_move(hook[i], path[i], out[i], states[i], constants[segment * block_calls.number + i])


@inside
def _free(axis: int, segment: int, drive: int, modes: Modes, state: State) -> None:
    """Advance the modes of an axis over a step, exactly for a drive that is a parabola."""
    d, q, p = reals(state.signals), reals(state.modes), reals(modes.passages)
    first = ints(modes.first)
    x = v = 0.0
    for m in range(first[axis], first[axis + 1]):
        i = 16 * (segment * modes.number + m)
        q0, q1 = q[2 * m], q[2 * m + 1]
        d0, d1, d2 = d[drive], d[drive + 1], d[drive + 2]
        q[2 * m] = p[i + 6] * q0 + p[i + 7] * q1 + p[i + 10] * d0 + p[i + 11] * d1 + p[i + 12] * d2
        q[2 * m + 1] = p[i + 8] * q0 + p[i + 9] * q1 + p[i + 13] * d0 + p[i + 14] * d1 + p[i + 15] * d2
        x, v = x + q[2 * m], v + q[2 * m + 1]
    reals(state.axis_motion)[2 * axis], reals(state.axis_motion)[2 * axis + 1] = x, v


@once
def _advance_with_forces(
    axis: int, segment: int, drive: int, step: float, modes: Modes, forces: Forces, state: State
) -> None:
    """Advance the modes of an axis over a step with forces that depend on the motion (Cox and Matthews, eqs 26-29)."""
    d, q, p = reals(state.signals), reals(state.modes), reals(modes.passages)
    axis_motion, first = reals(state.axis_motion), ints(modes.first)
    d0, d1, d2 = d[drive], d[drive + 1], d[drive + 2]
    r1 = forces.rates  # addresses of the states' rates at the four stages
    r2, r3, r4 = r1 + 8 * forces.number, r1 + 16 * forces.number, r1 + 24 * forces.number
    begin = _drive_and_forces(axis, d0, axis_motion[2 * axis], axis_motion[2 * axis + 1], 0.0, r1, r1, forces, state)
    # Two guesses of the middle, from the force at the start and from that at the first guess.
    x, v = _halfway(axis, segment, begin, modes, state)
    guess_a = _drive_and_forces(axis, d1, x, v, 0.5 * step, r1, r2, forces, state)
    x, v = _halfway(axis, segment, guess_a, modes, state)
    guess_b = _drive_and_forces(axis, d1, x, v, 0.5 * step, r2, r3, forces, state)
    # A guess of the end, by a second half from the first guess of the middle.
    x = v = 0.0
    for m in range(first[axis], first[axis + 1]):
        i = 16 * (segment * modes.number + m)
        qa0 = p[i] * q[2 * m] + p[i + 1] * q[2 * m + 1] + p[i + 4] * begin
        qa1 = p[i + 2] * q[2 * m] + p[i + 3] * q[2 * m + 1] + p[i + 5] * begin
        x += p[i] * qa0 + p[i + 1] * qa1 + p[i + 4] * (2.0 * guess_b - begin)
        v += p[i + 2] * qa0 + p[i + 3] * qa1 + p[i + 5] * (2.0 * guess_b - begin)
    end = _drive_and_forces(axis, d2, x, v, step, r3, r4, forces, state)
    d[drive], d[drive + 1], d[drive + 2] = begin, 0.5 * (guess_a + guess_b), end
    _free(axis, segment, drive, modes, state)
    d[drive], d[drive + 1], d[drive + 2] = d0, d1, d2
    place, states, force = ints(forces.place), reals(forces.states), ints(forces.first)
    for i in range(place[force[axis]], place[force[axis + 1]]):  # forces by path have rates of zero
        states[i] += step / 6.0 * (reals(r1)[i] + 2.0 * reals(r2)[i] + 2.0 * reals(r3)[i] + reals(r4)[i])
    _path_forces(axis, axis_motion[2 * axis], axis_motion[2 * axis + 1], step, forces.states, forces, state)


@inside
def _halfway(axis: int, segment: int, force: float, modes: Modes, state: State) -> tuple[float, float]:
    """Return position and velocity of an axis after half a step under a constant input."""
    q, p, first = reals(state.modes), reals(modes.passages), ints(modes.first)
    x = v = 0.0
    for m in range(first[axis], first[axis + 1]):
        i = 16 * (segment * modes.number + m)
        x += p[i] * q[2 * m] + p[i + 1] * q[2 * m + 1] + p[i + 4] * force
        v += p[i + 2] * q[2 * m] + p[i + 3] * q[2 * m + 1] + p[i + 5] * force
    return x, v


@inside
def _drive_and_forces(
    axis: int,
    drive: float,
    x: float,
    v: float,
    after: float,
    earlier: Reals,
    rates: Reals,
    forces: Forces,
    state: State,
) -> float:
    """Return the drive and all forces over the stiffness, `after` the start of the step; fill in the states' rates.

    The states have gone there at the `earlier` rates. Every addition that is left out makes the whole step shorter: a
    stage waits for the one before.
    """
    first, place, hook, constants = ints(forces.first), ints(forces.place), ints(forces.hook), ints(forces.constants)
    states, trial, by_path = reals(forces.states), reals(forces.trial), ints(forces.by_path)[axis]
    for i in range(place[first[axis]], place[first[axis + 1]]):
        trial[i] = states[i] + after * reals(earlier)[i]
    driven = drive
    if first[axis] < by_path:
        f = first[axis]
        offset = 8 * place[f]
        total = call_flow(hook[f], drive, x, v, forces.trial + offset, rates + offset, constants[f])
        for f in range(first[axis] + 1, by_path):
            offset = 8 * place[f]
            total += call_flow(hook[f], drive, x, v, forces.trial + offset, rates + offset, constants[f])
        driven += total
    if by_path < first[axis + 1]:
        driven += _path_forces(axis, x, v, after, forces.trial, forces, state)
    return driven


@inside
def _path_forces(axis: int, x: float, v: float, after: float, states: Reals, forces: Forces, state: State) -> float:
    """Return all forces that follow the path from the start of the step, `after` it, and take their states there.

    Where the velocity has changed its sign the path goes by the turning point, found as if the velocity were straight.
    """
    first, last = ints(forces.by_path)[axis], ints(forces.first)[axis + 1]
    if first == last:
        return 0.0
    begin, speed = reals(state.previous_axis_motion)[2 * axis], reals(state.previous_axis_motion)[2 * axis + 1]
    turns = speed * v < 0.0
    turn = begin + 0.5 * after * speed * speed / (speed - v) if turns else begin
    hook, place, constants = ints(forces.hook), ints(forces.place), ints(forces.constants)
    total = 0.0
    for f in range(first, last):
        own = states + 8 * place[f]
        if turns:
            call_pull(hook[f], begin, turn, own, constants[f])
        total += call_pull(hook[f], turn, x, own, constants[f])
    return total


@inside
def _table_position(axis: int, axes: int, motions: Reals, coupling: Coupling) -> float:
    """Return the table's position along an axis, to which every axis contributes."""
    axis_motion, linear, quadratic = reals(motions), reals(coupling.linear), reals(coupling.quadratic)
    total = 0.0
    for other in range(axes):
        x = axis_motion[2 * other]
        total += (linear[axis * axes + other] + quadratic[axis * axes + other] * x) * x
    return total


@inside
def _mixed_velocity(axis: int, axes: int, motions: Reals, coupling: Coupling) -> float:
    axis_motion, linear, quadratic = reals(motions), reals(coupling.linear), reals(coupling.quadratic)
    total = 0.0
    for other in range(axes):
        x, v = axis_motion[2 * other], axis_motion[2 * other + 1]
        total += (linear[axis * axes + other] + 2.0 * quadratic[axis * axes + other] * x) * v
    return total


@once
def _motion(step: float, axes: int, places: SignalPlaces, coupling: Coupling, state: State) -> None:
    """Fill in the table's motion at the start, the middle (by the cubic through both ends) and the end of a step."""
    signals = reals(state.signals)
    for axis in range(axes):
        x0, x1 = (
            _table_position(axis, axes, state.previous_axis_motion, coupling),
            _table_position(axis, axes, state.axis_motion, coupling),
        )
        v0 = _mixed_velocity(axis, axes, state.previous_axis_motion, coupling)
        v1 = _mixed_velocity(axis, axes, state.axis_motion, coupling)
        place = ints(places.motion)[axis]
        signals[place] = x0
        signals[place + 1] = 0.5 * (x0 + x1) + 0.125 * step * (v0 - v1)
        signals[place + 2] = x1
