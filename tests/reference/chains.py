"""One axis from command to sensor, solved tightly: a reference for `flexdesign.dynamics`, with which it shares no code.

Each stretch of time is cut where the equations are not smooth: at samples, where a delayed command arrives, where the
voltage or the mass turns round, and where a hysteresis passes zero. Within a cut everything is analytic (for integer
exponents of the hysteresis), and an eighth-order Runge-Kutta pair at a tolerance near rounding solves it. The lagged
voltage is a closed form, so its reversals are too; the other cuts are located as events.

Before t = 0 all is at rest at zero volts. The chain, each part optional but the modes:

- driver lag: tau v' = u - v
- hysteresis, over v: dh = a dv - b |dv| h |h|^(n-1) - c dv |h|^n (Lin et al. 2019, eqs (28) and (29) for n = 1)
- drive: s = k_v v - h, and creep: d = s + sum c_i z_i with tau_i z_i' = s - z_i
- mechanics: x = sum x_i, with x_i'' + 2 zeta_i w_i x_i' + w_i^2 x_i = w_i^2 share_i (d + f(x, x') - q), where q is a
  hysteretic spring: the hysteresis above, over x
- sensor lag: tau_s y' = x - y
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Floats = NDArray[np.float64]
Rates = Callable[[float, Floats], Any]

#: A branch ends when its quantity is on the wrong side by this part of its scale. It is well above the error of a step,
#: so that rest ends no branch, and the next one starts on its own side; the kinks it passes over so are of its square.
_HAIR = 1e-10


@dataclass(frozen=True)
class BoucWen:
    """dh = a dv - b |dv| h |h|^(n-1) - c dv |h|^n; h in metres, v in volts (or metres, for a spring), n >= 1."""

    a: float
    b: float
    c: float
    n: float = 1.0

    def slope(self, h: float, rising: float, side: float) -> float:
        """Return dh/dv while v rises (+1) or falls (-1), on the side h >= 0 (+1) or h <= 0 (-1).

        Beyond its side it goes on smoothly if n is whole, so that a step may look across the cut.
        """
        whole = round(self.n)
        power = (side * h) ** whole if whole == self.n else side * h * abs(h) ** (self.n - 1)
        return self.a - (self.b * rising * side + self.c) * power


@dataclass(frozen=True)
class Mode:
    """One mode: angular frequency [rad/s], damping ratio, and its share of the static displacement."""

    w0: float
    zeta: float
    share: float = 1.0


@dataclass(frozen=True)
class Chain:
    """One axis; a part left at its default is not there.

    Parameters
    ----------
    gain
        Displacement at rest per voltage, without hysteresis and creep, k_v [m/V].
    modes
        The mechanics, at least one mode.
    driver_lag, sensor_lag
        Time constants [s].
    hysteresis
        In the voltage path.
    creep
        Pairs of share and time constant [s].
    force
        ``force(x, velocity)``: a smooth force on the mass over the stiffness [m].
    spring
        A hysteretic spring: its force over the stiffness is minus its h.
    """

    gain: float
    modes: tuple[Mode, ...]
    driver_lag: float = 0.0
    hysteresis: BoucWen | None = None
    creep: tuple[tuple[float, float], ...] = ()
    force: Callable[[float, float], float] | None = None
    spring: BoucWen | None = None
    sensor_lag: float = 0.0


@dataclass(frozen=True)
class Pid:
    """The incremental PID of eq (33) with back-calculation at the limits.

    Kp in V/m, Ti and Td in seconds, limits in volts.
    """

    Kp: float
    Ti: float = math.inf
    Td: float = 0.0
    limits: tuple[float, float] = (-math.inf, math.inf)


@dataclass(frozen=True)
class Solution:
    """What the chain does at the samples t_k = k period; one value per sample.

    Parameters
    ----------
    position, reading
        x and y [m].
    command
        u_k [V], as it leaves the controller: a delay comes after it.
    voltage, hysteresis
        v [V] and h [m]; where the voltage jumps at a sample, just after it.
    spring
        q, the displacement the hysteretic spring holds back [m].
    """

    position: Floats
    reading: Floats
    command: Floats
    voltage: Floats
    hysteresis: Floats
    spring: Floats


def solve(
    chain: Chain,
    command: Sequence[float] | Floats,
    period: float,
    between: Literal["hold", "linear"] = "hold",
    *,
    delay: float = 0.0,
    stroke: float = 1e-4,
    rtol: float = 1e-12,
) -> Solution:
    """Solve the open chain.

    Parameters
    ----------
    chain
        What is solved.
    command
        u_k at t_k [V].
    period
        Time between samples [s].
    between
        Whether a command is held until the next, or goes there in a straight line.
    delay
        How long after its time a command arrives [s].
    stroke
        A typical displacement [m]: absolute tolerances are a tenth of `rtol` of it.
    rtol
        Relative tolerance of each step.
    """
    run = _Run(chain, period, delay, between == "linear", stroke, rtol, [float(u) for u in command])
    for k in range(len(run.commands)):
        if k:
            run.cross(k - 1)
        run.record(k)
    return run.solution()


def solve_loop(
    chain: Chain,
    reference: Sequence[float] | Floats,
    period: float,
    pid: Pid,
    feedforward: Sequence[float] | Floats | None = None,
    *,
    delay: float = 0.0,
    stroke: float = 1e-4,
    rtol: float = 1e-12,
) -> Solution:
    """Solve the chain under a sampled PID that compares reading and `reference` [m]; commands are held.

    `feedforward` [V] is added to what the PID asks for, before the limits. The other parameters are those of `solve`.
    """
    run = _Run(chain, period, delay, False, stroke, rtol)
    ahead = np.zeros(len(reference)) if feedforward is None else np.asarray(feedforward, dtype=float)
    asked = last = last_but_one = 0.0
    for k, (wanted, given) in enumerate(zip(reference, ahead, strict=True)):
        if k:
            run.cross(k - 1)
        error = float(wanted) - run.reading
        bend = error - 2 * last + last_but_one
        asked += pid.Kp * (error - last + period / pid.Ti * error + pid.Td / period * bend)
        whole = float(given) + asked
        command = min(max(whole, pid.limits[0]), pid.limits[1])
        asked -= whole - command
        last, last_but_one = error, last
        run.commands.append(command)
        run.record(k)
    return run.solution()


@dataclass(frozen=True)
class _Ramp:
    """The voltage while the command is a straight line: u(t) = command + slope (t - start)."""

    start: float
    end: float
    command: float
    slope: float
    voltage_before: float
    lag: float

    def voltage(self, t: float) -> float:
        late = self.lag * self.slope
        return self.command + self.slope * (t - self.start) - late + self._behind(t)

    def rate(self, t: float) -> float:
        return self.slope - (self._behind(t) / self.lag if self.lag else 0.0)

    def _behind(self, t: float) -> float:
        """Return how far the voltage is off the straight line it tends to."""
        if not self.lag:
            return 0.0
        off = self.voltage_before - self.command + self.lag * self.slope
        return off * math.exp((self.start - t) / self.lag)

    def cuts(self) -> list[float]:
        """Return start and end, and between them the moment at which the voltage turns round, if it does."""
        steepness = self.slope * self.lag
        off = self._behind(self.start)
        if off and 0.0 < steepness / off < 1.0:
            turn = self.start - self.lag * math.log(steepness / off)
            if self.start < turn < self.end:
                return [self.start, turn, self.end]
        return [self.start, self.end]


@dataclass(frozen=True)
class _Edge:
    """The event that ends a branch: the sum of some states has left the branch's side by more than a hair."""

    name: str
    side: float
    states: slice
    hair: float
    terminal = True
    direction = -1.0

    def __call__(self, t: float, s: Floats) -> float:
        return self.side * float(s[self.states].sum()) + self.hair


@dataclass
class _Run:
    """A solution under way: the state at a moment, and what was kept at the samples before it."""

    chain: Chain
    period: float
    delay: float
    linear: bool
    stroke: float
    rtol: float
    commands: list[float] = field(default_factory=list)
    kept: list[tuple[float, ...]] = field(default_factory=list)
    voltage: float = 0.0
    sides: dict[str, float] = field(default_factory=lambda: {"h": 1.0, "speed": 1.0, "q": 1.0})

    def __post_init__(self) -> None:
        n_creep, n_modes = len(self.chain.creep), len(self.chain.modes)
        # The state is h, z_i, x_i, x_i', q, y; what is not there stays zero.
        self.z = slice(1, 1 + n_creep)
        self.x = slice(self.z.stop, self.z.stop + n_modes)
        self.dx = slice(self.x.stop, self.x.stop + n_modes)
        self.q, self.y = self.dx.stop, self.dx.stop + 1
        self.state: Floats = np.zeros(self.y + 1)
        self.creep = np.array(self.chain.creep).reshape(-1, 2).T
        self.w0, self.zeta, self.share = np.array([(m.w0, m.zeta, m.share) for m in self.chain.modes]).T
        self.atol = np.full(len(self.state), 0.1 * self.rtol * self.stroke)
        self.atol[self.dx] *= self.w0
        self.late, self.rest = divmod(self.delay / self.period, 1.0)
        if min(self.rest, 1.0 - self.rest) < 1e-9:  # whole samples but for rounding: no stretch of its own
            self.late, self.rest = float(round(self.delay / self.period)), 0.0

    @property
    def reading(self) -> float:
        """What the sensor reads now [m]."""
        return float(self.state[self.y] if self.chain.sensor_lag else self.state[self.x].sum())

    def cross(self, k: int) -> None:
        """Solve from sample k to the next one."""
        for ramp in self._ramps(k):
            self._jump(ramp)
            for start, end in itertools.pairwise(ramp.cuts()):
                self._glide(ramp, start, end)
            self.voltage = ramp.voltage(ramp.end)

    def record(self, k: int) -> None:
        """Keep what there is at sample k, whose command is known."""
        self._jump(next(self._ramps(k)))
        s = self.state
        self.kept.append((s[self.x].sum(), self.reading, self.commands[k], self.voltage, s[0], s[self.q]))

    def solution(self) -> Solution:
        """Return what was kept."""
        return Solution(*np.array(self.kept).reshape(-1, 6).T)

    def _ramps(self, k: int) -> Iterator[_Ramp]:
        """Yield the straight lines of the command, as it arrives, from sample k to the next."""
        start, end = k * self.period, (k + 1) * self.period
        switch = start + self.rest * self.period
        if self.rest:
            yield self._ramp(start, switch, int(k - self.late) - 1, 1.0 - self.rest)
        yield self._ramp(switch, end, int(k - self.late), 0.0)

    def _ramp(self, start: float, end: float, j: int, part: float) -> _Ramp:
        """Return the line that the command of sample j begins, from `part` of a period after it."""
        here = self.commands[j] if j >= 0 else 0.0
        there = self.commands[j + 1] if self.linear and 0 <= j < len(self.commands) - 1 else here
        slope = (there - here) / self.period
        return _Ramp(start, end, here + part * (there - here), slope, self.voltage, self.chain.driver_lag)

    def _jump(self, ramp: _Ramp) -> None:
        """Take the hysteresis along the straight path to where the voltage starts, reached at once without a lag."""
        if ramp.lag:
            return
        bw, target = self.chain.hysteresis, ramp.command
        rising = math.copysign(1.0, target - self.voltage)
        while bw and self.voltage != target:
            rates = self._slope(bw, rising, self.sides["h"])
            zero = _Edge("h", self.sides["h"], slice(0, 1), _HAIR * self.stroke)
            self.voltage, self.state[:1] = self._branch(rates, [zero], self.voltage, target, self.state[:1])
        self.voltage = target

    @staticmethod
    def _slope(bw: BoucWen, rising: float, side: float) -> Rates:
        """Return dh/dv on one branch."""
        return lambda v, h: [bw.slope(h[0], rising, side)]

    def _glide(self, ramp: _Ramp, start: float, end: float) -> None:
        """Solve a stretch in which the voltage does not turn round, branch by branch."""
        rising = math.copysign(1.0, ramp.rate(0.5 * (start + end)))
        while start < end:
            edges = []
            if self.chain.hysteresis:
                edges.append(_Edge("h", self.sides["h"], slice(0, 1), _HAIR * self.stroke))
            if self.chain.spring:
                edges.append(_Edge("q", self.sides["q"], slice(self.q, self.q + 1), _HAIR * self.stroke))
                edges.append(_Edge("speed", self.sides["speed"], self.dx, _HAIR * self.stroke * self.w0.max()))
            start, self.state = self._branch(self._rates(ramp, rising), edges, start, end, self.state)

    def _rates(self, ramp: _Ramp, rising: float) -> Rates:
        """Return the right-hand side on the present branch."""
        chain, side, q_side, speed_side = self.chain, self.sides["h"], self.sides["q"], self.sides["speed"]
        bw, spring, force = chain.hysteresis, chain.spring, chain.force
        shares, constants = self.creep
        stiffness, damping = self.w0**2, 2 * self.zeta * self.w0

        def rates(t: float, s: Floats) -> Floats:
            out = np.zeros_like(s)
            if bw:
                out[0] = bw.slope(s[0], rising, side) * ramp.rate(t)
            drive = chain.gain * ramp.voltage(t) - s[0]
            out[self.z] = (drive - s[self.z]) / constants
            x, speed = s[self.x].sum(), s[self.dx].sum()
            push = drive + shares @ s[self.z] - s[self.q] + (force(x, speed) if force else 0.0)
            out[self.x] = s[self.dx]
            out[self.dx] = stiffness * (self.share * push - s[self.x]) - damping * s[self.dx]
            if spring:
                out[self.q] = spring.slope(s[self.q], speed_side, q_side) * speed
            if chain.sensor_lag:
                out[self.y] = (x - s[self.y]) / chain.sensor_lag
            return out

        return rates

    def _branch(self, rates: Rates, edges: list[_Edge], start: float, end: float, s: Floats) -> tuple[float, Floats]:
        """Solve until the end or the first edge, which turns its branch; return where that is and the state there."""
        options: dict[str, Any] = {"method": "DOP853", "rtol": self.rtol, "atol": self.atol[: len(s)]}
        if self.chain.spring and len(s) > 1:  # the speed may change sign twice within a long step, unseen
            options["max_step"] = 0.25 / self.w0.max()
        found = solve_ivp(rates, (start, end), s, events=edges or None, **options)
        if found.status == 1:
            end, reached = min(
                (float(t[0]), edge.name) for t, edge in zip(found.t_events, edges, strict=True) if len(t)
            )
            # The moment is found on an interpolant, which is coarser than the steps: solve anew up to there.
            found = solve_ivp(rates, (start, end), s, **options)
            self.sides[reached] *= -1.0
        if found.status != 0:
            raise ArithmeticError(f"no solution from {start:g} to {end:g}: {found.message}")
        return end, found.y[:, -1]
