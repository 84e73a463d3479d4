"""Cases: a stage model that is wrong in a known way, recordings of the stage it means, and the sealed answer.

Case i of a seed is always the same: its number says its kind, and with the seed it seeds everything that is drawn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from studies.hidden_effect_trial import bench, confusion, recordings
from studies.hidden_effect_trial.detection import PRIOR_SIGMA, Complement, State, columns, contribution, strength_for
from studies.hidden_effect_trial.effects import BY_NAME, CATALOGUE, OUTSIDE, Stage, Values
from studies.hidden_effect_trial.recordings import PERIOD, Recording

Array = NDArray[np.float64]
#: Draws the runs on a stage, as `recordings.draw` does.
DrawRuns = Callable[[np.random.Generator, Stage, bool | None], tuple[Recording, ...]]
#: The seed on which the package's constants were chosen: its rates are those of a training set. Other seeds give rates
#: on cases that no choice has seen.
SEED = 20191
#: Stands in the place of the number of attempts where the run for testing is drawn, from a generator of its own.
TESTING = 1000
#: First number of each kind; of single and faint cases hundred belong to an effect, of those outside hundred to a kind.
FIRST = {"none": 10000, "single": 20000, "pair": 30000, "outside": 40000, "faint": 50000}
#: The same of cases whose stage model is rough; and by how much that is off, as standard deviations of logarithms.
ROUGH_FIRST = {"single": 80000, "none": 90000}
ROUGH_SIGMA = {"omega": 0.16, "gain": 0.2}
#: Effect-to-noise ratios: where an effect shows, where it cannot, and outside the catalogue.
VISIBLE_RATIO, FAINT_RATIO, OUTSIDE_RATIO = (1.0, 30.0), (0.02, 0.1), (3.0, 30.0)
#: Root mean square of the noise, in strokes.
NOISE = (1e-4, 1e-3)
#: Resolution of the sensor where it is no matter, in strokes.
FINEST = 1e-6
#: How many standard deviations a resonance that is a finding lies from the prior.
FINDING = (4.0, 8.0)
#: A common delay shows if it is longer than triggers are uncertain [s].
DELAYS = (0.7e-3, 4e-3)
#: Effects that change what is known of the resonance.
RESONANCE = ("payload_mass", "stiffness_loss")
#: Where faint effects make no sense: these are drawn by themselves, and none of them can be faint but by its number.
NEVER_FAINT = (*RESONANCE, "bouc_wen", "quantisation")


@dataclass(frozen=True, eq=False)
class Case:
    """A case.

    Parameters
    ----------
    number, kind
        Its number, and "none", "single", "pair", "faint" or "outside".
    stage, nominal
        The true base, and what the stage model states.
    lumped
        Whether the stage model states mass and stiffness, rather than the natural frequency.
    effects
        What is hidden, values in SI.
    runs
        What was driven.
    readings
        What was recorded, with noise [m].
    noise
        Root mean square of the noise [m].
    poles
        Coefficients of its autoregression.
    floor
        Root mean square over the run for testing of what no model can predict [m]; over the validation runs where
        there is none.
    ratio
        Effect to noise, by effect.
    groups
        By effect, those in the catalogue that can replace it on the runs that are fitted or used to choose.
    validation_floor
        As `floor`, over the validation runs [m]; None where nothing is for testing.
    seed
        Of all cases.
    fault, structural
        Kind and root mean square of the bench's structural error [m]; none but on imperfect benches.
    """

    number: int
    kind: str
    stage: Stage
    nominal: Stage
    lumped: bool
    effects: Mapping[str, Values]
    runs: tuple[Recording, ...]
    readings: tuple[Array, ...]
    noise: float
    poles: tuple[float, ...]
    floor: float
    ratio: Mapping[str, float] = field(default_factory=dict)
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    validation_floor: float | None = None
    seed: int = SEED
    fault: str = ""
    structural: float = 0.0

    @property
    def name(self) -> str:
        """Its kind and number."""
        return f"{self.kind}-{self.number}"


def kind_of(number: int) -> str:
    """Return the kind of a case.

    Raises
    ------
    ValueError
        If no case has this number.
    """
    every = (*FIRST.items(), *ROUGH_FIRST.items())
    kind, place = next(((kind, number - first) for kind, first in every if first <= number < first + 10000), ("", 0))
    if not kind or (kind in ("single", "faint") and place >= 100 * len(CATALOGUE)):
        raise ValueError(f"there is no case {number}")
    if kind == "single" and is_rough(number) and hidden_in(number) in RESONANCE:
        raise ValueError(f"there is no case {number}")
    if (kind == "outside" and place >= 100 * len(OUTSIDE)) or (kind == "faint" and hidden_in(number) in NEVER_FAINT):
        raise ValueError(f"there is no case {number}")
    return kind


def is_rough(number: int) -> bool:
    """Tell whether the stage model of a case is off by tens of percent, and says so."""
    return number >= ROUGH_FIRST["single"]


def hidden_in(number: int) -> str:
    """Return the effect that a single, faint or outside case is about."""
    kinds = OUTSIDE if number // 10000 == 4 else CATALOGUE
    return kinds[number % 10000 // 100].name


def numbers(kind: str, count: int, rough: bool = False) -> list[int]:
    """Return the first `count` numbers of a kind; for each effect `count`, where a case is about one.

    Of rough models none lacks what is within their own uncertainty.
    """
    first = (ROUGH_FIRST if rough else FIRST)[kind]
    if kind in ("none", "pair"):
        return list(range(first, first + count))
    kinds = [e.name for e in (OUTSIDE if kind == "outside" else CATALOGUE)]
    never = NEVER_FAINT if kind == "faint" else RESONANCE if rough else ()
    about = [i for i, name in enumerate(kinds) if name not in never]
    return [first + 100 * i + k for i in about for k in range(count)]


def make(number: int, seed: int = SEED, drawn: DrawRuns = recordings.draw) -> Case:
    """Return a case, on the trial's recordings or on others; without a run for testing, see `add_test_run`.

    Raises
    ------
    ValueError
        If no case has this number.
    """
    kind = kind_of(number)
    for attempt in range(50):
        rng = np.random.default_rng([seed, number, attempt])
        found = _attempt(rng, number, kind, drawn)
        if found is not None:
            return replace(found, seed=seed)
    raise RuntimeError(f"case {number} of seed {seed} could not be drawn")


def add_test_run(case: Case) -> Case:
    """Return a case with one more run, for testing: what else was drawn stays as it is."""
    rng = np.random.default_rng([case.seed, case.number, TESTING])
    run = recordings.draw_test(rng, case.stage, case.runs[0].held)
    one = record(rng, case.stage, case.nominal, case.effects, (run,), case.noise, case.poles)
    return replace(
        case,
        runs=(*case.runs, run),
        readings=(*case.readings, *one.readings),
        floor=one.floor,
        validation_floor=case.floor,
    )


def _attempt(rng: np.random.Generator, number: int, kind: str, drawn: DrawRuns) -> Case | None:
    stage = draw_stage(rng)
    lumped = bool(rng.random() < 0.5)
    poles, noise = draw_poles(rng), stage.stroke * float(np.exp(rng.uniform(*map(math.log, NOISE))))
    names = _names(rng, number, kind)
    held = False if "rate_dependent_hysteresis" in names else None
    runs = drawn(rng, stage, held)
    nominal = draw_nominal(rng, stage, names, is_rough(number))
    effects: dict[str, Values] = {}
    if names:
        found = draw_effects(rng, kind, names, stage, nominal, runs, noise)
        if found is None:
            return None
        effects = found
    bare = replace(stage, a=0.0) if "bouc_wen" in effects else stage
    case = record(rng, bare, nominal, effects, runs, noise, poles)
    case = replace(case, number=number, kind=kind, lumped=lumped)
    return _with_ratios(case) if effects else case


def record(
    rng: np.random.Generator,
    stage: Stage,
    nominal: Stage,
    effects: Mapping[str, Values],
    runs: tuple[Recording, ...],
    noise: float,
    poles: tuple[float, ...],
) -> Case:
    """Return a case of what a stage with effects reads in some runs; see `Case` for what is given."""
    clean = bench.readings(stage, effects, runs)
    recorded = [y + bench.noise(rng, len(y), noise, poles) for y in clean]
    step = effects.get("quantisation", {}).get("step", FINEST * stage.stroke)
    recorded = [step * np.round(y / step) for y in recorded]
    held_out = [y - x for run, y, x in zip(runs, recorded, clean, strict=True) if run.role != "identify"]
    floor = float(np.sqrt(np.mean(np.concatenate(held_out) ** 2)))
    return Case(0, "single", stage, nominal, True, effects, runs, tuple(recorded), noise, poles, floor)


# --- what is drawn --------------------------------------------------------------------------------------------------


def draw_stage(rng: np.random.Generator) -> Stage:
    """Return the base of a bench."""
    volts = float(rng.choice([60.0, 100.0, 120.0, 150.0]))
    gain = float(np.exp(rng.uniform(math.log(0.8e-6), math.log(3e-6))))
    b = rng.uniform(1.0, 2.5) / volts
    return Stage(
        gain=gain,
        omega=2.0 * math.pi * rng.uniform(60.0, 200.0),
        zeta=rng.uniform(0.02, 0.05),
        a=gain * rng.uniform(0.12, 0.28),
        b=b,
        c=b * rng.uniform(0.05, 0.4),
        volts=volts,
    )


def _truncated_normal(rng: np.random.Generator, sigma: float) -> float:
    """Return a Gaussian number, cut at two standard deviations."""
    while abs(value := float(rng.normal())) > 2.0:
        pass
    return sigma * value


def draw_nominal(rng: np.random.Generator, stage: Stage, names: tuple[str, ...], rough: bool = False) -> Stage:
    """Return what the stage model states: off by what it says of its uncertainty, or by up to a fifth."""
    off = {name: 1.0 + rng.uniform(-0.2, 0.2) for name in ("zeta", "gain", "a", "b", "c")}
    off["gain"] = 1.0 + _truncated_normal(rng, PRIOR_SIGMA["gain"])
    off["omega"] = math.sqrt((1.0 + _truncated_normal(rng, 0.03)) / (1.0 + _truncated_normal(rng, 0.02)))
    if rough:
        off |= {name: math.exp(_truncated_normal(rng, sigma)) for name, sigma in ROUGH_SIGMA.items()}
    values = {name: getattr(stage, name) * factor for name, factor in off.items()}
    if "bouc_wen" in names:
        values["a"] = 0.0
    return replace(stage, **values)


def draw_poles(rng: np.random.Generator) -> tuple[float, ...]:
    """Return the coefficients of the noise: none, of one pole, or of a pair that peaks somewhere."""
    kind = rng.integers(3)
    if kind == 0:
        return ()
    if kind == 1:
        return (float(1.0 - np.exp(rng.uniform(math.log(0.02), math.log(0.4)))),)
    radius, angle = rng.uniform(0.5, 0.95), 2.0 * math.pi * PERIOD * rng.uniform(5.0, 200.0)
    return float(2.0 * radius * math.cos(angle)), float(-(radius**2))


def _names(rng: np.random.Generator, number: int, kind: str) -> tuple[str, ...]:
    if kind == "none":
        return ()
    if kind != "pair":
        return (hidden_in(number),)
    # Two that are no limits of one another: a resonance that is wrong already takes the bounds of the base.
    known = [effect.name for effect in CATALOGUE if effect.name != "bouc_wen"]
    while True:
        pair = tuple(sorted(str(name) for name in rng.choice(known, 2, replace=False)))
        if not any(set(pair) <= set(alike) for alike in CONFOUNDED):
            return pair


#: Effects that are so alike that two of them are no pair: on such runs either takes the place of both.
CONFOUNDED = (
    ("driver_bandwidth", "sensor_bandwidth", "transport_delay"),
    ("payload_mass", "stiffness_loss"),
    ("electrostriction", "stroke_dependent_amplification", "quadratic_stiffness"),
    ("driver_slew", "driver_bandwidth"),
    ("prandtl_ishlinskii", "rate_dependent_hysteresis", "asymmetric_hysteresis"),
    ("mains_hum", "base_motion"),
)


def draw_effects(
    rng: np.random.Generator,
    kind: str,
    names: tuple[str, ...],
    stage: Stage,
    nominal: Stage,
    runs: tuple[Recording, ...],
    noise: float,
    least: float = 0.0,
) -> dict[str, Values] | None:
    """Return the hidden effects with their values; None if they cannot be as strong as drawn.

    Parameters
    ----------
    rng
        Draws them.
    kind, names
        Of the case, and of the effects.
    stage, nominal, runs, noise
        As in `Case`.
    least
        What an effect adds to the readings beyond what a fit of the base can imitate is at least this, rms [m].
    """
    low, high = {"faint": FAINT_RATIO, "outside": OUTSIDE_RATIO}.get(kind, VISIBLE_RATIO)
    ratios = {name: float(np.exp(rng.uniform(math.log(low), math.log(high)))) for name in names}
    wanted = {name: max(ratio * noise, least) for name, ratio in ratios.items()}
    found: dict[str, Values] = {}
    for name in sorted(names, key=lambda name: name not in RESONANCE):  # what changes the resonance comes first
        hidden = BY_NAME[name]
        constants = hidden.constants(rng, stage)
        if own := _direct_values(rng, name, constants, stage, nominal, wanted[name], kind):
            found[name] = own
            continue
        complement = Complement(columns(State(stage, found, runs), nominal, loops="bouc_wen" not in names))
        strength = strength_for(wanted[name], name, constants, stage, found, runs, complement)
        if strength is None:
            return None
        found[name] = strength[0]
    return found


def _direct_values(
    rng: np.random.Generator, name: str, constants: Values, stage: Stage, nominal: Stage, wanted: float, kind: str
) -> Values | None:
    """Return the values of an effect whose strength is not found by searching."""
    if name in RESONANCE:
        # Mass and stiffness beyond what is known of them; the effect lowers the frequency, whichever way it was off.
        ratio = nominal.omega / stage.omega * (1.0 - rng.uniform(*FINDING) * PRIOR_SIGMA["omega"])
        return {"ratio": ratio**-2 - 1.0 if name == "payload_mass" else 1.0 - ratio**2}
    if name == "transport_delay" and kind != "faint":
        return {"delay": float(np.exp(rng.uniform(*np.log(DELAYS))))}
    if name == "quantisation":
        return {"step": wanted * math.sqrt(12.0)}
    return {"a": stage.a, **constants} if name == "bouc_wen" else None


# --- what is judged -------------------------------------------------------------------------------------------------


def effect_residual(state: State, name: str, nominal: Stage) -> float:
    """Return what an effect adds that no fit of the base can imitate, rms [m]; NaN if it tears the stage apart."""
    if name == "quantisation":
        return state.effects[name]["step"] / math.sqrt(12.0)
    part = contribution(state.stage, state.effects, name, state.runs)
    if not np.isfinite(part).all():
        return math.nan
    others = {other: values for other, values in state.effects.items() if other != name}
    base = State(state.stage, others, state.runs)
    return Complement(columns(base, nominal, loops="bouc_wen" not in state.effects)).residual(part)[0]


def _with_ratios(case: Case) -> Case | None:
    """Return the case with effect-to-noise ratios and groups; None if what is hidden does not show as it should."""
    state = State(case.stage, case.effects, case.runs)
    ratio = {name: effect_residual(state, name, case.nominal) / case.noise for name in case.effects}
    if not all(math.isfinite(each) for each in ratio.values()):
        return None
    if case.kind in ("single", "pair") and min(ratio.values()) < VISIBLE_RATIO[0]:
        return None
    if case.kind == "faint":
        return replace(case, ratio=ratio)
    if case.kind == "outside":
        _, nearest = confusion.substitutes(state, next(iter(case.effects)), case.nominal, case.noise, polish=False)
        # Something that an effect of the catalogue explains is not outside it.
        return replace(case, ratio=ratio) if nearest > max(case.noise, 0.3 * min(ratio.values()) * case.noise) else None
    groups = {
        name: confusion.substitutes(state, name, case.nominal, case.noise)[0] if name != "quantisation" else ()
        for name in case.effects
    }
    return replace(case, ratio=ratio, groups=groups)
