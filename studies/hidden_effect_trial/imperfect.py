"""Cases on imperfect benches: each recording has a structural error that no effect of the catalogue describes.

Stages, effects and recordings are drawn as in `cases`; the hidden effect is the main one, at least `MAIN` times as
large as the structural error. Numbers say what is hidden and which kind of error the bench has.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from studies.hidden_effect_trial import bench, cases, confusion, faults, recordings
from studies.hidden_effect_trial.cases import FINEST, SEED, TESTING, VISIBLE_RATIO, Case
from studies.hidden_effect_trial.detection import State
from studies.hidden_effect_trial.effects import CATALOGUE, SMOOTH_FRICTION, Stage, Values
from studies.hidden_effect_trial.faults import KINDS, Fault
from studies.hidden_effect_trial.recordings import Recording

Array = NDArray[np.float64]
#: What may be hidden: the catalogue, and friction by another law.
HIDDEN = (*CATALOGUE, SMOOTH_FRICTION)
#: First numbers: of the cases with an effect, hundred belong to each; of those with nothing missing.
FIRST_SINGLE, FIRST_NONE, END = 60000, 70000, 80000
#: Root mean square of a structural error, in strokes; every run's mean taken off, as an offset is no error.
STRUCTURAL = (1e-4, 3e-3)
#: A hidden effect is at least this multiple: what of it shows, against the whole structural error.
MAIN = 4.0
#: An effect of the catalogue, with everything else fitted again, leaves at least this share of a structural error, rms:
#: it explains less than a fifth of its squares. Else it would describe a part of it.
STRANGE = 0.9
#: Steps in a sample while the size of a structural error is looked for, and attempts to draw a case.
ROUGH, ATTEMPTS = 20, 200


def holds(number: int) -> bool:
    """Tell whether a number is one of an imperfect bench."""
    return FIRST_SINGLE <= number < END


def hidden_in(number: int) -> str:
    """Return the effect that is hidden in a case; empty if nothing is.

    Raises
    ------
    ValueError
        If no case has this number.
    """
    place = (number - FIRST_SINGLE) // 100
    if not holds(number) or (number < FIRST_NONE and place >= len(HIDDEN)):
        raise ValueError(f"there is no case {number}")
    return HIDDEN[place].name if number < FIRST_NONE else ""


def fault_in(number: int) -> str:
    """Return the kind of the bench's structural error: each effect meets one after the other, beginning elsewhere."""
    return KINDS[(number % 100 + (number - FIRST_SINGLE) // 100) % len(KINDS)]


def numbers(single: int, none: int, only: str | None = None) -> list[int]:
    """Return the numbers of `single` cases of each effect, and with nothing missing.

    Parameters
    ----------
    single, none
        How many.
    only
        "single", "none", an effect, or a kind of structural error.
    """
    every = [FIRST_SINGLE + 100 * i + k for i in range(len(HIDDEN)) for k in range(single)]
    every += range(FIRST_NONE, FIRST_NONE + none)
    about = {n: ("single" if hidden_in(n) else "none", hidden_in(n), fault_in(n)) for n in every}
    return [n for n in every if only is None or only in about[n]]


def make(number: int, seed: int = SEED) -> Case:
    """Return a case, with its run for testing.

    Raises
    ------
    ValueError
        If no case has this number.
    """
    hidden_in(number)
    for attempt in range(ATTEMPTS):
        found = _attempt(number, seed, attempt)
        if found is not None:
            return found
    raise RuntimeError(f"case {number} of seed {seed} could not be drawn")


def _attempt(number: int, seed: int, attempt: int) -> Case | None:
    rng = np.random.default_rng([seed, number, attempt])
    stage, names = cases.draw_stage(rng), tuple(name for name in (hidden_in(number),) if name)
    lumped, poles = bool(rng.random() < 0.5), cases.draw_poles(rng)
    noise = stage.stroke * _log(rng, *cases.NOISE)
    target = stage.stroke * _log(rng, *STRUCTURAL)
    # Coarse steps show at jumps, which a command has that waits between samples; straight ones they would only smooth.
    held = True if fault_in(number) == "coarse_steps" else None
    nine = recordings.draw(rng, stage, False if "rate_dependent_hysteresis" in names else held)
    nominal = cases.draw_nominal(rng, stage, names)
    effects: dict[str, Values] = {}
    if names:
        found = cases.draw_effects(rng, "single", names, stage, nominal, nine, noise, 1.1 * MAIN * target)
        if found is None or found.get("quantisation", {}).get("step", 0.0) > 0.02 * stage.stroke:
            return None
        effects = found
    bare = replace(stage, a=0.0) if "bouc_wen" in effects else stage
    testing = recordings.draw_test(np.random.default_rng([seed, number, TESTING]), stage, nine[0].held)
    runs = (*nine, testing)
    fault = _fault(rng, fault_in(number), bare, effects, runs, target)
    if fault is None:
        return None
    clean = bench.readings(bare, effects, runs)
    flawed = bench.readings(bare, effects, runs, fault=fault)
    size = rms(flawed, clean)
    state = State(bare, effects, nine)
    shown = {name: cases.effect_residual(state, name, nominal) for name in effects}
    if not STRUCTURAL[0] <= size / stage.stroke <= STRUCTURAL[1] or not all(
        each >= max(MAIN * size, VISIBLE_RATIO[0] * noise) for each in shown.values()
    ):
        return None
    strange = np.concatenate([y - x for y, x in zip(flawed[:-1], clean[:-1], strict=True)])
    if confusion.nearest(state, strange, nominal)[1] < STRANGE:
        return None
    recorded = _record(rng, flawed, noise, poles, effects.get("quantisation", {}).get("step", FINEST * stage.stroke))
    kept = {
        role: [y - x for run, y, x in zip(runs, recorded, clean, strict=True) if run.role == role] for role in ROLES
    }
    floors = {role: float(np.sqrt(np.mean(np.concatenate(left) ** 2))) for role, left in kept.items()}
    unexplained = math.hypot(noise, size)
    groups = {
        name: confusion.substitutes(state, name, nominal, unexplained)[0] if name != "quantisation" else ()
        for name in effects
    }
    return Case(
        number, "single" if names else "none", bare, nominal, lumped, effects, runs, recorded, noise, poles,
        floors["test"], {name: each / noise for name, each in shown.items()}, groups, floors["validate"], seed,
        fault.kind, size,
    )  # fmt: skip


#: Roles of runs that are not fitted.
ROLES = ("validate", "test")


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def _fault(
    rng: np.random.Generator,
    kind: str,
    stage: Stage,
    effects: dict[str, Values],
    runs: tuple[Recording, ...],
    size: float,
) -> Fault | None:
    """Return a structural error of about a size, in its root mean square over all runs [m]."""
    sound = bench.readings(stage, effects, runs, ROUGH)
    if not all(np.isfinite(y).all() for y in sound):
        return None
    positions = np.concatenate([y - run.offset for run, y in zip(runs, sound, strict=True)])
    return faults.draw_fault(
        rng, kind, positions, size, lambda fault: rms(bench.readings(stage, effects, runs, ROUGH, fault), sound)
    )


def rms(flawed: list[Array], clean: list[Array]) -> float:
    """Return the root mean square of a structural error over all runs, the mean of each taken off [m]."""
    left = [y - x for y, x in zip(flawed, clean, strict=True)]
    return float(np.sqrt(np.mean(np.concatenate([each - each.mean() for each in left]) ** 2)))


def _record(
    rng: np.random.Generator, flawed: list[Array], noise: float, poles: tuple[float, ...], step: float
) -> tuple[Array, ...]:
    """Return readings with noise, in steps."""
    noisy = [y + bench.noise(rng, len(y), noise, poles) for y in flawed]
    return tuple(step * np.round(y / step) for y in noisy)
