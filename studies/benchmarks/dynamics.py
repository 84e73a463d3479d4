"""Speed and accuracy of `flexdesign.dynamics` and of SciPy at equal accuracy, and the time of the first use::

    python -m studies.benchmarks.dynamics             # a few minutes; timed over 2 s of signal
    python -m studies.benchmarks.dynamics 5           # timed over 5 s

Both sides are to reach 1e-6 of the stroke, measured over half a second against the event-located solution. There each
is given the setting that costs it least: the peer its method and tolerance (`dynamics_peer.best`), the engine its steps
in a sample. A second time of the engine's is that of choosing its steps by itself, all runs that it needs for that and
its error estimate included; a peer that is not given its tolerance has no such estimate. Wall times are the best of
several, taken in turns, so that what else the machine does meets both sides.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from flexdesign import effects
from flexdesign.dynamics.control.pid import PID, controller
from flexdesign.dynamics.signal_chain.chain import AxisChain, Oscillator
from flexdesign.dynamics.simulate import TOLERANCE, Loop, Response, Stage, simulate
from studies.benchmarks import dynamics_peer
from studies.benchmarks.dynamics_peer import CHAINS, COMMANDS, PERIOD, samples, trajectories

#: Over so long errors are measured and the peer's tolerance is chosen [s].
MEASURED = 0.5
#: Timings in turns; of a plain right-hand side, which takes minutes, only one.
TURNS = 5
#: A closed loop of all effects, from an interpreter that has imported nothing: the first run, then another chain.
FIRST_USE = """
import time
import numpy as np
from flexdesign import effects
from flexdesign.dynamics.control.pid import PID, controller
from flexdesign.dynamics.signal_chain.chain import AxisChain, Oscillator
from flexdesign.dynamics.simulate import Loop, Stage, simulate

def run(*names):
    given = [(e, {p.name: p.start for p in e.parameters}) for e in map(effects.find, names)]
    axis = AxisChain("x", 2e-6, (Oscillator(118.3, 0.0242),), tuple(given))
    loop = Loop(np.zeros(100), np.full(100, 1e-4), (controller(PID(1.5e4, 2e-3, 0.2e-3)),))
    begin = time.perf_counter()
    simulate(Stage((axis,), limits={"x": (-20.0, 150.0)}), {"x": loop}, 1e-3, delay=1e-3)
    return time.perf_counter() - begin

run("driver_bandwidth", "bouc_wen", "creep", "stress_stiffening", "sensor_bandwidth")
print(run("bouc_wen", "sensor_bandwidth"))
"""


def axis_chain(name: str, axis: Mapping[str, Any]) -> AxisChain:
    """Return an axis of `dynamics_peer.CHAINS` as the engine takes it."""
    given = {
        "driver_bandwidth": {"bandwidth": axis.get("driver_bandwidth", math.inf)},
        "bouc_wen": {key: axis.get(key, 0.0) for key in ("a", "b", "c", "n")},
        "stress_stiffening": {"cubic": axis.get("kappa", 0.0)},
        "sensor_bandwidth": {"bandwidth": axis.get("sensor_bandwidth", math.inf)},
    }
    if "creep" in axis:
        given["creep"] = dict(zip(("per_decade", "t0"), axis["creep"][0], strict=True))
    mode = Oscillator(axis["w0"] / (2 * math.pi), axis["zeta"])
    return AxisChain(name, axis["k_v"], (mode,), tuple((effects.find(key), values) for key, values in given.items()))


def make_runner(chain_name: str, seconds: float, command: str = "multisine") -> Callable[..., Response]:
    """Return what runs a chain of `dynamics_peer.CHAINS` from rest; its options are those of `simulate`."""
    table, t = CHAINS[chain_name], samples(seconds)
    axes = tuple(axis_chain(name, axis) for name, axis in zip("xyz", table["axes"], strict=False))
    if "loop" not in table:
        function, held = COMMANDS[command]
        loops = {axis.name: Loop(function(t)) for axis in axes}
        return partial(simulate, Stage(axes), loops, PERIOD, between_samples="hold" if held else "linear")
    loop = table["loop"]
    pid = controller(PID(loop["Kp"], loop["Ti"], loop["Td"]))
    wanted = zip(axes, trajectories(chain_name, t), strict=True)
    loops = {axis.name: Loop(np.zeros(len(t)), reference, (pid,)) for axis, reference in wanted}
    limits = {axis.name: (loop["u_min"], loop["u_max"]) for axis in axes}
    return partial(simulate, Stage(axes, limits=limits), loops, PERIOD, delay=loop["delay"])


def wall(action: Callable[[], object]) -> float:
    """Return how long something takes [s]."""
    begin = time.perf_counter()
    action()
    return time.perf_counter() - begin


def compare_with_peer(seconds: float) -> None:
    """Print for every chain and command the errors of both sides, their wall times, and the ratios of these."""
    print(
        f"wall time for {seconds:g} s of signal at {TOLERANCE:g} of the stroke, and how many times the engine's it is"
    )
    print(
        f"{'chain':28}{'command':11}{'steps':>5}{'error':>9}{'wall':>10}{'choosing':>13}   {'peer':7}{'error':>9}"
        f"{'compiled':>11}{'plain':>18}{'odeint':>18}"
    )
    for chain_name, chain in CHAINS.items():
        for command in ("multisine",) if "loop" in chain else COMMANDS:
            right = dynamics_peer.reference(chain_name, MEASURED, command)
            steps, wrong = fewest_steps(chain_name, command, right)
            run = make_runner(chain_name, seconds, command)
            way = dynamics_peer.best(chain_name, command, TOLERANCE, MEASURED)
            odeint = dynamics_peer.best(chain_name, command, TOLERANCE, MEASURED, ("odeint",))
            ours, choosing, compiled, old = [], [], [], []
            for _ in range(TURNS):
                ours.append(wall(partial(run, substeps=steps)))
                choosing.append(wall(run))
                compiled.append(_peer(chain_name, seconds, way))
                old.append(_peer(chain_name, seconds, odeint))
            plain = _peer(chain_name, seconds, {**way, "compiled": False})
            best = min(ours)
            print(
                f"{chain_name:28}{'reference' if 'loop' in chain else command:11}"
                f"{steps:5}{wrong:9.1e}{1e3 * best:7.2f} ms{1e3 * min(choosing):10.2f} ms"
                f"   {way['method']:7}{way['error']:9.1e}",
                *(f"{peer:8.3f} s {peer / best:5.0f} x" for peer in (min(compiled), plain, min(old))),
                flush=True,
            )


def fewest_steps(chain_name: str, command: str, right: Any) -> tuple[int, float]:
    """Return the smallest power of two of steps that reaches the tolerance, and its error."""
    steps, run = 1, make_runner(chain_name, MEASURED, command)
    while (wrong := dynamics_peer.error(run(substeps=steps).motion, right)) > TOLERANCE:
        steps *= 2
    return steps, wrong


def _peer(chain_name: str, seconds: float, way: Mapping[str, Any]) -> float:
    arguments = {name: value for name, value in way.items() if name not in ("error", "wall")}
    return dynamics_peer.solve(chain_name, seconds, **arguments)[1]


def a_minute_of_closed_loop() -> None:
    """Print how long 60 s of closed loop at 1 kHz take."""
    for chain_name in ("full, closed loop", "three axes, closed loop"):
        run = make_runner(chain_name, 60.0)
        walls = [wall(run) for _ in range(TURNS)]
        found = run()
        print(
            f"60 s of {chain_name}: {min(walls):.3f} s, {found.substeps} steps in a sample, "
            f"estimated error {found.error:.1e} of the span"
        )


def first_use() -> None:
    """Print how long a new interpreter takes to its first result, nothing compiled before, and everything."""
    with tempfile.TemporaryDirectory() as empty:
        for what in ("nothing compiled before", "compiled before", "compiled before"):
            begin = time.perf_counter()
            environment = {**os.environ, "NUMBA_CACHE_DIR": empty}
            done = subprocess.run(
                [sys.executable, "-c", FIRST_USE], env=environment, check=True, capture_output=True, text=True
            )
            took = time.perf_counter() - begin
            print(f"first use, {what}: {took:.2f} s; then another chain: {1e3 * float(done.stdout):.1f} ms")


def main(seconds: float = 2.0) -> None:
    """Print everything."""
    first_use()
    a_minute_of_closed_loop()
    compare_with_peer(seconds)


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
