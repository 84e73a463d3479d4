"""How long a full diagnosis takes: eight runs, 80 s at 1 kHz, the whole catalogue::

    python -m studies.benchmarks.diagnosis              # every case, a few minutes
    python -m studies.benchmarks.diagnosis creep        # one of them
    python -m studies.benchmarks.diagnosis 21100 30003  # cases of `studies.hidden_effect_trial`, on runs as long

The stage of named cases is that of `studies.hidden_effect_demo`, the simulator that of `studies.hidden_effect_trial`;
every run goes on for ten seconds. Timed is `flexdesign diagnose` as a user starts it, from the interpreter's start to
the written report. What Numba compiles is kept on disk: the first diagnosis after a change of the engine takes longer
by that.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from studies.hidden_effect_demo.__main__ import NOISE, NOMINAL, POLES, STAGE
from studies.hidden_effect_trial import cases, folder, recordings
from studies.hidden_effect_trial.effects import Stage, Values
from studies.hidden_effect_trial.recordings import PERIOD, Recording

#: Which of the trial's nine runs, and how long each is [s].
LEFT_OUT, LASTS = "sine", 10.0
#: What is hidden, by case.
HIDDEN: Mapping[str, Mapping[str, Values]] = {
    "nothing": {},
    "stress_stiffening": {"stress_stiffening": {"cubic": 0.03 / STAGE.stroke**2}},
    "creep": {"creep": {"per_decade": 0.015, "t0": 0.1}},
    "transport_delay": {"transport_delay": {"delay": 2.2e-3}},
    "prandtl_ishlinskii": {"prandtl_ishlinskii": {"weight": 0.05 * STAGE.gain, "reach": 30.0, "shape": 0.0}},
    "pair": {"creep": {"per_decade": 0.003, "t0": 0.1}, "stress_stiffening": {"cubic": 0.006 / STAGE.stroke**2}},
}


def runs(rng: np.random.Generator, stage: Stage, held: bool | None = None) -> tuple[Recording, ...]:
    """Return eight runs on a stage that go on for ten seconds, each drawn anew as often as that takes."""
    samples = round(LASTS / PERIOD)
    held = recordings.waits(rng) if held is None else held
    draws = [recordings.draw(rng, stage, held) for _ in range(8)]
    long = []
    for same in zip(*draws, strict=True):
        if same[0].name.partition("-")[2] == LEFT_OUT:
            continue
        command = np.concatenate([run.u[: run.n] for run in same])[: samples + 1]
        long.append(replace(same[0], u=command, turns=np.append(same[0].turns[:-1], command[0])))
    return tuple(long)


def time_diagnosis(case: cases.Case, here: Path) -> tuple[float, str]:
    """Return how long the diagnosis of a case takes [s], and what it says."""
    folder.write(case, here, here / "answer.toml")
    command = [sys.executable, "-m", "flexdesign", "diagnose", str(here / folder.MODEL), str(here / folder.RUNS)]
    began = time.perf_counter()
    subprocess.run([*command, "--out", str(here / "report")], check=True, capture_output=True)
    took = time.perf_counter() - began
    found = json.loads((here / "report" / "result.json").read_text(encoding="utf-8"))
    return took, " and ".join(effect["name"] for effect in found["effects"]) or found["verdict"]


def case_of(name: str) -> cases.Case:
    """Return a case by the name of what is hidden, or by its number in the trial."""
    if name.isdigit():
        return cases.make(int(name), drawn=runs)
    rng = np.random.default_rng(cases.SEED)
    driven = runs(rng, STAGE, held=False)
    return cases.record(rng, STAGE, NOMINAL, HIDDEN[name], driven, NOISE * STAGE.stroke, POLES)


def main(*names: str) -> None:
    """Print a line for every case."""
    for name in names or HIDDEN:
        case = case_of(name)
        with tempfile.TemporaryDirectory() as here:
            took, said = time_diagnosis(case, Path(here))
        seconds = sum(run.n for run in case.runs) * PERIOD
        hidden = f"{name}: {' and '.join(case.effects) or 'nothing'}" if name.isdigit() else name
        print(f"{len(case.runs)} runs, {seconds:.0f} s, hidden {hidden}: {took:.1f} s, said {said}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
