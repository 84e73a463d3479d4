"""The command ``python -m studies.hidden_effect_demo``."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from studies.hidden_effect_trial import cases, folder, recordings
from studies.hidden_effect_trial.cases import Case
from studies.hidden_effect_trial.detection import Complement, State, columns, contribution
from studies.hidden_effect_trial.effects import Stage

HERE = Path(__file__).resolve().parent
#: The stage of Lin et al. (2019) with the damping that it shows, and what its model states instead: wrong within what
#: it says of itself.
STAGE = Stage(gain=1.98e-6, omega=2.0 * math.pi * 118.3, zeta=0.0242, a=0.46e-6, b=0.0165, c=0.004, volts=100.0)
NOMINAL = replace(STAGE, gain=2.1e-6, omega=1.012 * STAGE.omega, zeta=0.03, a=0.42e-6, b=0.018, c=0.0035)
#: Guides that stretch as they bend: at full stroke they pull back three hundredths harder.
EFFECTS = {"stress_stiffening": {"cubic": 0.03 / STAGE.stroke**2}}
#: Noise over stroke, and its one pole.
NOISE, POLES = 1e-4, (0.8,)
#: Which of the trial's nine runs are kept.
RUNS = ("quiet", "multisine-high", "multisine-low", "triangle", "decaying-sine", "random-levels")


def make() -> Case:
    """Return the recordings and what is behind them."""
    rng = np.random.default_rng(cases.SEED)
    drawn = recordings.draw(rng, STAGE, held=False)
    kept = [run for run in drawn if run.name.partition("-")[2] in RUNS]
    runs = tuple(replace(run, name=f"{i}-{run.name.partition('-')[2]}") for i, run in enumerate(kept, start=1))
    case = cases.record(rng, STAGE, NOMINAL, EFFECTS, runs, NOISE * STAGE.stroke, POLES)
    complement = Complement(columns(State(STAGE, {}, runs), NOMINAL))
    shown = complement.residual(contribution(STAGE, EFFECTS, "stress_stiffening", runs))[0] / case.noise
    # Full digits are no one's business: what is hidden stands in the file as it was put in.
    return replace(case, ratio={"stress_stiffening": float(f"{shown:.3g}")}, groups={"stress_stiffening": ()})


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the recordings."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.hidden_effect_demo", description="Recordings of a stage with a hidden effect"
    )
    parser.add_argument("--out", type=Path, default=HERE, help="folder of the recordings")
    out = parser.parse_args(arguments).out
    folder.write(make(), out, out / "answer.toml")
    print(out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
