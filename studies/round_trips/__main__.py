"""The command ``python -m studies.round_trips``.

For every effect of the catalogue that one axis shows, the stage of Lin et al. (2019) is simulated with it as
``flexdesign simulate --runs`` does: without feedback, through the standard experiments. Noise is added, and the
recordings are diagnosed with the stage model that lacks the effect. The program is on both sides, so that this tests
its conventions; an independent simulator is that of ``studies.hidden_effect_trial``.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from flexdesign import effects
from flexdesign.core import versions
from flexdesign.diagnosis import Diagnosis, diagnose
from flexdesign.diagnosis.effect_selection.candidates import candidates
from flexdesign.diagnosis.preparation.dataset import OF_NOISE
from flexdesign.dynamics import stage_model
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.experiments import simulation, standard_experiments
from flexdesign.dynamics.stage_dynamics import stack_range
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.measurements import recordings as runs

Array = NDArray[np.float64]
STAGE, AXIS = "lin2019_stage", "x"
#: The sensor's steps are left out: they would hide what is smaller.
WITHOUT_STEPS = [f'axis.{axis}.sensor.resolution="0 um"' for axis in "xyz"]
#: Noise that is added [m].
NOISE = 20e-9
#: An effect should not be named if the calibrated model without it is off by less, rms, over the noise: what gain,
#: damping, natural frequency and initial conditions imitate, no recording shows. The threshold of the diagnosis.
SEEN = OF_NOISE
#: What the description of the recordings says of their commands, which are held.
BETWEEN = ("hold", "unsaid")


@dataclass(frozen=True)
class Outcome:
    """What was said of an effect.

    Parameters
    ----------
    effect, between
        What was hidden, and whether it was said that commands are held between samples.
    size, missed
        How far the effect moves the readings, and how far off the calibrated model without it is, rms, over the noise.
        The noise is known here, and taken out.
    verdict, named
        The answer; confounded effects are in one string.
    values, is_right, holds
        True and found values, whether the answer is right, and whether the intervals hold the truth.
    """

    effect: str
    between: str
    size: float
    missed: float
    verdict: str
    named: tuple[str, ...]
    values: str
    is_right: bool
    holds: bool | None


def names() -> list[str]:
    """Return the effects that an axis alone can show in runs without a payload."""
    axis = stage_model.read(STAGE, WITHOUT_STEPS).axes[AXIS]
    plain = AxisDynamics(AXIS, replace(axis, effects={}), stack_range(axis)[1])
    return [c.name for c in candidates(plain) if not c.after and c.name not in axis.effects]


def with_effect(model: StageModel, name: str) -> tuple[StageModel, dict[str, float]]:
    """Return a stage with an effect at the strength of the catalogue, and the numbers of the effect."""
    axis = model.axes[AXIS]
    dynamics = AxisDynamics(AXIS, axis, stack_range(axis)[1], delay=model.controller.delay)
    added = dynamics.with_effect(effects.find(name), name)
    before = {p.name: p.start for p in dynamics.parameters()}
    numbers = {p.name: float(p.start or 0.0) for p in added.parameters() if p.start != before.get(p.name)}
    timing = replace(model.controller, delay=added.delay)
    return replace(model, axes={**model.axes, AXIS: added.axis}, controller=timing), numbers


def recordings(model: StageModel) -> dict[str, tuple[Array, Array, Array]]:
    """Return time [s], command [V] and reading [m] of the standard experiments, by name, without noise."""
    plan = standard_experiments.plan(model)
    of_axis = [each for each in plan.experiments if AXIS in each.axes]
    open_loop = [each.model_copy(update={"controllers": ("open loop",)}) for each in of_axis]
    found = simulation.run(model, {}, replace(plan, experiments=tuple(open_loop)), lambda _: None)
    made = {}
    for case in found.cases:
        every = max(1, round(1 / (model.controller.rate * case.response.time[1])))
        command = case.response.command[0, ::every]
        reading = case.response.reading[0, ::every]
        made[case.experiment.name.replace(" ", "_")] = np.arange(len(command)) / model.controller.rate, command, reading
    return made


def round_trip(name: str, between: str, seed: int) -> Outcome:
    """Simulate a stage with an effect, and diagnose its recordings."""
    plain = stage_model.read(STAGE, WITHOUT_STEPS)
    hidden, numbers = with_effect(plain, name)
    seen, without, rng = recordings(hidden), recordings(plain), np.random.default_rng(seed)
    noise = {run: NOISE * rng.standard_normal(len(reading)) for run, (_, _, reading) in seen.items()}
    moved = rms([seen[run][2] - without[run][2] for run in seen])
    with TemporaryDirectory() as folder:
        tables = []
        for run, (time, command, reading) in seen.items():
            file = f"{run}.csv"
            runs.write_run(Path(folder) / file, time, {"u [V]": command, f"{AXIS} [um]": reading + noise[run]})
            tables.append(f'[[run]]\nfile = "{file}"\nbetween_samples = "hold"\n')
        if between == "hold":
            (Path(folder) / "measurements.toml").write_text("\n".join(tables), encoding="utf-8")
        found = diagnose(plain, runs.read_recordings([Path(folder)]), axis=AXIS)
    residuals = found.residuals_by_run["calibrated"]
    missed = rms([np.asarray(residual, dtype=np.float64) - noise[run] for run, residual in residuals.items()])
    return outcome(name, between, moved / NOISE, missed / NOISE, numbers, found)


def rms(parts: Sequence[Array]) -> float:
    """Return the root mean square of signals, each less its mean; gaps are left out."""
    return float(np.sqrt(np.nanmean(np.concatenate([part - np.nanmean(part) for part in parts]) ** 2)))


def outcome(
    name: str, between: str, size: float, missed: float, numbers: dict[str, float], found: Diagnosis
) -> Outcome:
    """Compare the answer with what was hidden."""
    groups = {group[0]: group for group in found.confusable}
    named = tuple(" or ".join(groups.get(each.name, (each.name,))) for each in found.effects)
    is_right = len(named) == 1 and name in named[0].split(" or ") if missed >= SEEN else not named
    estimates = {v.parameter.name: v for each in found.effects for v in each.values if each.name == name}
    shared = [key for key in estimates if key in numbers]
    holds = None
    if shared:
        holds = all(
            (interval := estimates[key].interval) is None or interval[0] <= numbers[key] <= interval[1]
            for key in shared
        )
    values = "; ".join(
        f"{key} {numbers[key]:.4g}: {estimates[key].value:.5g} {estimates[key].interval}" for key in shared
    )
    return Outcome(name, between, size, missed, found.verdict, named, values, is_right, holds)


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the round trips, print one line for each, and write the table."""
    parser = argparse.ArgumentParser(prog="python -m studies.round_trips", description=__doc__)
    parser.add_argument("effects", nargs="*", choices=[*names(), []], metavar="effect", help="all by default")
    parser.add_argument("--between", choices=BETWEEN, default="hold", help="what is said of held commands")
    parser.add_argument("--seed", type=int, default=1, help="of the noise")
    parser.add_argument("--out", type=Path, default=Path("reports/round_trips"), help="folder of the table")
    given = parser.parse_args(arguments)
    outcomes = []
    for name in given.effects or names():
        made = round_trip(name, given.between, given.seed)
        outcomes.append(made)
        said = f"{made.verdict}: {' and '.join(made.named) or 'none'}"
        print(
            f"{name:32} {made.size:8.3g} x noise, {made.missed:8.3g} after calibration  "
            f"{'right' if made.is_right else 'WRONG'}  {said}  {made.values}",
            flush=True,
        )
    given.out.mkdir(parents=True, exist_ok=True)
    result = {"noise": NOISE, "seed": given.seed, "versions": versions.installed(), "rows": [vars(o) for o in outcomes]}
    (given.out / "result.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
