"""The peer of the speed benchmark: the same signal chains by SciPy's `solve_ivp`, as fast as we could make it.

`CHAINS` and `COMMANDS` hold the numbers that both sides take. `solve` is the peer, with a compiled right-hand side or a
plain one, and `reference` the event-located solution for the error of both::

    python -m studies.benchmarks.dynamics_peer             # the fastest method that reaches 1e-6 of the stroke
    python -m studies.benchmarks.dynamics_peer 10          # timed over 10 s instead of 2 s

What makes the peer fast: a right-hand side compiled by Numba, one for each kind of chain, so that none carries states
it does not need; the method and the tolerance that cost least at the accuracy asked for; an open loop either straight
through or started anew at each sample, whichever is faster; and, where it starts anew, a first step as long as the last
one was, which saves the search for it. A closed loop has to start anew: its command is known no earlier. SciPy's older
`odeint` is timed as well: the same LSODA with less Python around it.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import cache
from itertools import product
from math import pi
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.integrate import odeint, solve_ivp

Floats = NDArray[np.float64]
Rates = Callable[..., Any]

PERIOD = 1e-3  # s, of samples everywhere
STROKE = 2e-4  # m: scales absolute tolerances

#: One axis of the paper's stage, Lin et al. (2019), in SI; n = 1, and creep has a state for each of four decades.
#: 118.3 Hz and 0.0242 are what its printed gains (34) ask for. k_v is such that the steady loop from 0 to 120 V spans
#: the printed 238 um. Creep, cubic stiffening (5 % at 200 um) and sensor are plausible, not printed.
_OSCILLATOR = {"w0": 2 * pi * 118.3, "zeta": 0.0242, "k_v": 2.2946721502715446e-6}
_LAG = {**_OSCILLATOR, "driver_bandwidth": 500.0}
_HYSTERESIS = {**_LAG, "a": 0.46e-6, "b": 0.0165, "c": 0.004, "n": 1.0}
_FULL = {
    **_HYSTERESIS,
    "creep": ((0.018, 0.1), (0.018, 1.0), (0.018, 10.0), (0.018, 100.0)),
    "kappa": 0.05 / 200e-6**2,
    "sensor_bandwidth": 1000.0,
}
_FAST = {**_FULL, "driver_bandwidth": 2000.0}
_Z = {**_FULL, "w0": 2 * pi * 133.0, "zeta": 0.099, "k_v": 1.9e-6}
#: The loop: PID (33), the delay from reading to command, and a reference on the way from 0 to `travel` and back.
_LOOP = {"Kp": 1.5e4, "Ti": 2e-3, "Td": 0.2e-3, "u_min": -20.0, "u_max": 150.0, "delay": PERIOD}
_REFERENCE = {"travel": 200e-6, "frequency": 5.0}

#: Chains by name: the axes (each a table of SI numbers; what it does not name is not there), and the loop if closed.
CHAINS: dict[str, dict[str, Any]] = {
    "oscillator": {"axes": (_OSCILLATOR,)},
    "lag + oscillator": {"axes": (_LAG,)},
    "lag + Bouc-Wen + oscillator": {"axes": (_HYSTERESIS,)},
    "full": {"axes": (_FULL,)},
    "full, 2 kHz driver": {"axes": (_FAST,)},
    "full, closed loop": {"axes": (_FULL,), "loop": _LOOP, "reference": _REFERENCE},
    "three axes, closed loop": {"axes": (_FULL, _FULL, _Z), "loop": _LOOP, "reference": _REFERENCE},
}


def multisine(t: Floats) -> Floats:
    """Return 60 +- 40 V: lines from 7 to 151 Hz, 6 Hz apart, of equal amplitude and random phase [V]."""
    phases = 2 * pi * np.random.default_rng(2019).random(25)
    lines = np.arange(7.0, 152.0, 6.0)

    def wave(t: Floats) -> Floats:
        return np.asarray(np.sin(2 * pi * lines[:, None] * t + phases[:, None]).sum(axis=0))

    largest = np.abs(wave(np.arange(0.0, 1.0, PERIOD))).max()  # all lines repeat after 1 s
    return np.asarray(60 + 40 * wave(t) / largest)


#: Commands of the open chains by name: u(t) [V] at the samples, and whether it is held between them.
COMMANDS: dict[str, tuple[Callable[[Floats], Floats], bool]] = {
    "multisine": (multisine, False),
    "sine": (lambda t: 60 - 60 * np.cos(2 * pi * 5 * t), False),
    "step": (lambda t: np.full_like(t, 50.0), True),
}


def samples(seconds: float) -> Floats:
    """Return the times of the samples [s]."""
    return np.asarray(np.arange(round(seconds / PERIOD) + 1) * PERIOD, dtype=float)


def trajectories(chain_name: str, t: Floats) -> Floats:
    """Return what the axes of a closed loop shall follow [m], axes x samples: sines, each 1 Hz above the last."""
    chain = CHAINS[chain_name]
    frequencies = chain["reference"]["frequency"] + np.arange(len(chain["axes"]))[:, None]
    return np.asarray(chain["reference"]["travel"] / 2 * (1 - np.cos(2 * pi * frequencies * t)))


# --- right-hand sides -------------------------------------------------------------------------------------------------
# s: states; u: commands of each axis at the samples, straight lines between them; p: constants of each axis.


def oscillator(t: float, s: Floats, u: Floats, period: float, p: Floats) -> Floats:
    """Return the rates of x, x'."""
    k = min(int(t / period), u.shape[1] - 2)
    command = u[0, k] + (t / period - k) * (u[0, k + 1] - u[0, k])
    out = np.empty(2)
    out[0] = s[1]
    out[1] = p[0, 0] * (p[0, 2] * command - s[0]) - p[0, 1] * s[1]
    return out


def lag_oscillator(t: float, s: Floats, u: Floats, period: float, p: Floats) -> Floats:
    """Return the rates of x, x', v."""
    k = min(int(t / period), u.shape[1] - 2)
    command = u[0, k] + (t / period - k) * (u[0, k + 1] - u[0, k])
    out = np.empty(3)
    out[0] = s[1]
    out[1] = p[0, 0] * (p[0, 2] * s[2] - s[0]) - p[0, 1] * s[1]
    out[2] = p[0, 3] * (command - s[2])
    return out


def hysteretic(t: float, s: Floats, u: Floats, period: float, p: Floats) -> Floats:
    """Return the rates of x, x', v, h."""
    k = min(int(t / period), u.shape[1] - 2)
    command = u[0, k] + (t / period - k) * (u[0, k + 1] - u[0, k])
    out = np.empty(4)
    dv = p[0, 3] * (command - s[2])
    out[0] = s[1]
    out[1] = p[0, 0] * (p[0, 2] * s[2] - s[3] - s[0]) - p[0, 1] * s[1]
    out[2] = dv
    out[3] = p[0, 4] * dv - p[0, 5] * abs(dv) * s[3] - p[0, 6] * dv * abs(s[3])
    return out


def full(t: float, s: Floats, u: Floats, period: float, p: Floats) -> Floats:
    """Return the rates of x, x', v, h, four states of creep and the reading, for each axis."""
    k = min(int(t / period), u.shape[1] - 2)
    out = np.empty(s.size)
    for axis in range(u.shape[0]):
        i = 9 * axis
        x, v, h = s[i], s[i + 2], s[i + 3]
        command = u[axis, k] + (t / period - k) * (u[axis, k + 1] - u[axis, k])
        dv = p[axis, 3] * (command - v)
        drive = p[axis, 2] * v - h
        d = drive + p[axis, 9] * s[i + 4] + p[axis, 11] * s[i + 5] + p[axis, 13] * s[i + 6] + p[axis, 15] * s[i + 7]
        out[i] = s[i + 1]
        out[i + 1] = p[axis, 0] * (d - p[axis, 7] * x * x * x - x) - p[axis, 1] * s[i + 1]
        out[i + 2] = dv
        out[i + 3] = p[axis, 4] * dv - p[axis, 5] * abs(dv) * h - p[axis, 6] * dv * abs(h)
        out[i + 4] = p[axis, 10] * (drive - s[i + 4])
        out[i + 5] = p[axis, 12] * (drive - s[i + 5])
        out[i + 6] = p[axis, 14] * (drive - s[i + 6])
        out[i + 7] = p[axis, 16] * (drive - s[i + 7])
        out[i + 8] = p[axis, 8] * (x - s[i + 8])
    return out


#: Right-hand sides by the part of an axis that distinguishes them, with the number of states.
_KINDS: tuple[tuple[str, Rates, int], ...] = (
    ("creep", full, 9),
    ("a", hysteretic, 4),
    ("driver_bandwidth", lag_oscillator, 3),
    ("w0", oscillator, 2),
)


@cache
def _compile(rates: Rates) -> Rates:
    """Return the compiled function; compiling it is not timed."""
    function: Rates = njit(rates)
    return function


def _constants(axis: dict[str, Any]) -> list[float]:
    """Return an axis as the row that the right-hand sides read."""
    row = [axis["w0"] ** 2, 2 * axis["zeta"] * axis["w0"], axis["k_v"], 2 * pi * axis.get("driver_bandwidth", 0.0)]
    row += [axis.get(name, 0.0) for name in ("a", "b", "c", "kappa")] + [2 * pi * axis.get("sensor_bandwidth", 0.0)]
    for share, constant in axis.get("creep", ()):
        row += [share, 1 / constant]
    return row


# --- the peer ---------------------------------------------------------------------------------------------------------


def solve(
    chain_name: str,
    seconds: float,
    rtol: float,
    *,
    command: str = "multisine",
    method: str = "DOP853",
    anew: bool = True,
    compiled: bool = True,
) -> tuple[Floats, float]:
    """Solve a chain of `CHAINS` from rest.

    Parameters
    ----------
    chain_name
        Which one.
    seconds
        How long; samples lie `PERIOD` apart, the first at t = 0.
    rtol
        Relative tolerance; absolute ones are that part of `STROKE` and of what goes with it.
    command
        What drives an open chain, of `COMMANDS`.
    method
        Of `solve_ivp`, or ``"odeint"``.
    anew
        Whether an open chain is started anew at every sample; a closed one always is.
    compiled
        Whether the right-hand side is compiled.

    Returns
    -------
    tuple
        Positions at the samples [m], axes x samples, and the wall time without compilation [s].
    """
    chain = CHAINS[chain_name]
    rates, n = next((rates, n) for part, rates, n in _KINDS if part in chain["axes"][0])
    p = np.array([_constants(axis) for axis in chain["axes"]])
    s = np.zeros(n * len(p))
    t = samples(seconds)
    scales = np.full((len(p), n), STROKE)
    scales[:, 1] *= p[:, 0] ** 0.5
    scales[:, 2:3] = 100.0  # V
    options = {"method": method, "rtol": rtol, "atol": rtol * scales.ravel()}
    if compiled:
        rates = _compile(rates)
        rates(0.0, s, np.zeros((len(p), 2)), PERIOD, p)
    begin = time.perf_counter()
    if "loop" in chain:
        found = _simulate_closed_loop(chain["loop"], trajectories(chain_name, t), rates, s, p, options)
    else:
        function, held = COMMANDS[command]
        u = function(t)[None, :]
        found = _straight(rates, s, t, u, p, options) if held or not anew else _anew(rates, s, u, p, options)
    return found[:, ::n].T, time.perf_counter() - begin


def _straight(rates: Rates, s: Floats, t: Floats, u: Floats, p: Floats, options: dict[str, Any]) -> Floats:
    """Return the states at the samples, samples x states, from one solution over all of them."""
    if options["method"] == "odeint":
        return _odeint(rates, s, t, u, p, options)
    found = solve_ivp(rates, (0.0, t[-1]), s, t_eval=t, args=(u, PERIOD, p), **options)
    return np.asarray(found.y.T)


def _odeint(rates: Rates, s: Floats, t: Floats, u: Floats, p: Floats, options: dict[str, Any]) -> Floats:
    tolerances = {"rtol": options["rtol"], "atol": options["atol"], "mxstep": 100_000}
    return np.asarray(odeint(rates, s, t, args=(u, PERIOD, p), tfirst=True, **tolerances))


def _anew(rates: Rates, s: Floats, u: Floats, p: Floats, options: dict[str, Any]) -> Floats:
    """Return the states at the samples, a solution from each to the next."""
    pieces = _pieces(rates, s, p, options)
    next(pieces)
    return np.array([s, *(pieces.send(u[:, k : k + 2]) for k in range(u.shape[1] - 1))])


def _simulate_closed_loop(
    loop: dict[str, float], wanted: Floats, rates: Rates, s: Floats, p: Floats, options: dict[str, Any]
) -> Floats:
    """Return the states at the samples under the PID; a command takes effect one sample after its reading."""
    pieces = _pieces(rates, s, p, options)
    next(pieces)
    found = [s]
    u, asked, last, last_but_one = np.zeros((4, len(p)))
    for k in range(wanted.shape[1] - 1):
        error = wanted[:, k] - s[8::9]
        bend = error - 2 * last + last_but_one
        asked = asked + loop["Kp"] * (error - last + PERIOD / loop["Ti"] * error + loop["Td"] / PERIOD * bend)
        held = u
        u = asked = np.clip(asked, loop["u_min"], loop["u_max"])  # back-calculation: what was cut off is forgotten
        last, last_but_one = error, last
        s = pieces.send(np.column_stack((held, held)))
        found.append(s)
    return np.array(found)


def _pieces(rates: Rates, s: Floats, p: Floats, options: dict[str, Any]) -> Any:
    """Solve from one sample to the next for each command sent, axes x its two ends; a generator."""
    first, ends = None, np.array([0.0, PERIOD])
    while True:
        u = yield s
        if options["method"] == "odeint":
            s = _odeint(rates, s, ends, u, p, options)[-1]
            continue
        piece = solve_ivp(rates, ends, s, args=(u, PERIOD, p), first_step=first, **options)
        s, first = piece.y[:, -1], min(np.diff(piece.t).max(), PERIOD)


# --- how wrong it is --------------------------------------------------------------------------------------------------


def reference(chain_name: str, seconds: float, command: str = "multisine") -> Floats:
    """Return the positions [m], axes x samples, of the event-located solution (`tests.reference.chains`)."""
    from tests.reference import chains

    chain, t = CHAINS[chain_name], samples(seconds)
    if "loop" not in chain:
        function, held = COMMANDS[command]
        between: Any = "hold" if held else "linear"
        return np.array([chains.solve(_chain(axis), function(t), PERIOD, between).position for axis in chain["axes"]])
    loop = chain["loop"]
    pid = chains.Pid(loop["Kp"], loop["Ti"], loop["Td"], (loop["u_min"], loop["u_max"]))
    pairs = zip(chain["axes"], trajectories(chain_name, t), strict=True)
    solved = [chains.solve_loop(_chain(axis), wanted, PERIOD, pid, delay=loop["delay"]) for axis, wanted in pairs]
    return np.array([found.position for found in solved])


def _chain(axis: dict[str, Any]) -> Any:
    """Return an axis as the reference describes it."""
    from tests.reference.chains import BoucWen, Chain, Mode

    lags = [1 / (2 * pi * axis[name]) if name in axis else 0.0 for name in ("driver_bandwidth", "sensor_bandwidth")]
    return Chain(
        gain=axis["k_v"],
        modes=(Mode(axis["w0"], axis["zeta"]),),
        driver_lag=lags[0],
        hysteresis=BoucWen(axis["a"], axis["b"], axis["c"], axis["n"]) if "a" in axis else None,
        creep=axis.get("creep", ()),
        force=(lambda x, speed: -axis["kappa"] * x**3) if "kappa" in axis else None,
        sensor_lag=lags[1],
    )


def error(found: Floats, right: Floats) -> float:
    """Return the largest error over the stroke, the worst of the axes."""
    return float((np.abs(found - right).max(axis=1) / np.ptp(right, axis=1)).max())


def best(
    chain_name: str,
    command: str = "multisine",
    wanted: float = 1e-6,
    seconds: float = 0.5,
    methods: tuple[str, ...] = ("RK45", "DOP853", "LSODA"),
) -> dict[str, Any]:
    """Return the fastest way to an error of at most `wanted` of the stroke: arguments of `solve`, "error" and "wall".

    Each method, straight through and anew at every sample, takes the loosest tolerance, of three a decade, that is good
    enough over `seconds`.
    """
    right = reference(chain_name, seconds, command)
    choice = "loop" not in CHAINS[chain_name] and not COMMANDS[command][1]
    ways = []
    for method, anew in product(methods, (True, False) if choice else (True,)):
        for rtol in 10.0 ** -np.arange(3.0, 12.0, 1 / 3):
            way: dict[str, Any] = {"rtol": float(rtol), "command": command, "method": method, "anew": anew}
            found, wall = solve(chain_name, seconds, **way)
            if (wrong := error(found, right)) <= wanted:
                again = solve(chain_name, seconds, **way)[1]
                ways.append({**way, "error": wrong, "wall": min(wall, again)})
                break
    return min(ways, key=lambda way: float(way["wall"]))


def main(seconds: float = 2.0) -> None:
    """Print the fastest way for every chain, and its wall times with a compiled and a plain right-hand side."""
    print(f"seconds for {seconds:g} s of signal at 1e-6 of the stroke")
    print(
        f"{'chain':28} {'command':10} {'method':7} {'rtol':>6} {'error':>8} {'compiled':>9} {'plain':>9} {'odeint':>9}"
    )
    for chain_name, chain in CHAINS.items():
        for command in ("multisine",) if "loop" in chain else COMMANDS:
            way = best(chain_name, command)
            rivals = [way, {**way, "compiled": False}, best(chain_name, command, methods=("odeint",))]
            walls = []
            for rival in rivals:
                arguments = {name: value for name, value in rival.items() if name not in ("error", "wall")}
                walls.append(solve(chain_name, seconds, **arguments)[1])
            driven = "reference" if "loop" in chain else command
            print(f"{chain_name:28} {driven:10} {way['method']:7} {way['rtol']:6.0e} {way['error']:8.1e}", end=" ")
            print(" ".join(f"{wall:9.3f}" for wall in walls), flush=True)


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
