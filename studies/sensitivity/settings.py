"""Cases under changed constants: which, in processes, a line of a file for each, to go on where it stopped."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from dataclasses import asdict, dataclass
from pathlib import Path

from studies.hidden_effect_trial import cases, trial
from studies.hidden_effect_trial.effects import CATALOGUE, OUTSIDE
from studies.hidden_effect_trial.folder import Answer
from studies.hidden_effect_trial.scoring import Diagnosed, false_effects, is_right
from studies.sensitivity.constants import CONSTANTS, Constant, override_constant

#: What came of it, a line of JSON for each case and variation.
OUTCOMES = "settings.jsonl"
#: Half a value and twice.
FACTORS = (0.5, 2.0)
#: How many of twelve cases miss nothing, one effect, and one that no catalogue holds.
NOTHING, SINGLE, STRANGE = 4, 6, 2
#: Effects and mechanisms outside the catalogue in turn: of every socket, those that are quickly diagnosed; a payload is
#: found by the prior.
SINGLES = ("creep", "payload_mass", "stress_stiffening", "driver_bandwidth", "sensor_drift", "electrostriction")
OUTSIDES = ("quadratic_sensor", "telegraph_jump", "contact_spring", "backlash")


@dataclass(frozen=True)
class Variation:
    """A case to be diagnosed with one constant at a factor of its value; with an empty key as it is."""

    key: str
    factor: float
    number: int


@dataclass(frozen=True)
class VariationOutcome:
    """What came of a variation.

    Parameters
    ----------
    key, factor, value, number
        Constant, factor, its value then, and the case.
    kind
        Of the case.
    right, false_names
        Whether the verdict is right, and how many effects are named that are not there.
    said
        What was hidden and what was said, or the error.
    seconds
        How long it took; zero after an error.
    source
        Fingerprint of the package.
    """

    key: str
    factor: float
    value: float
    number: int
    kind: str
    right: bool
    false_names: int
    said: str
    seconds: float
    source: str

    @property
    def variation(self) -> Variation:
        """Which variation it is."""
        return Variation(self.key, self.factor, self.number)


def numbers(count: int) -> list[int]:
    """Return a stratified sample of cases of the trial: a third without an effect, half with one, a sixth outside.

    >>> numbers(12)
    [10000, 10001, 10002, 10003, 20000, 21500, 20900, 20100, 22000, 20500, 40000, 40400]
    """
    whole = NOTHING + SINGLE + STRANGE
    nothing, strange = (round(count * part / whole) for part in (NOTHING, STRANGE))
    places = {hidden.name: 100 * i for kinds in (CATALOGUE, OUTSIDE) for i, hidden in enumerate(kinds)}

    def in_turn(names: Sequence[str], first: int, wanted: int) -> list[int]:
        return [first + places[names[k % len(names)]] + k // len(names) for k in range(wanted)]

    return [
        *range(cases.FIRST["none"], cases.FIRST["none"] + nothing),
        *in_turn(SINGLES, cases.FIRST["single"], max(count - nothing - strange, 0)),
        *in_turn(OUTSIDES, cases.FIRST["outside"], strange),
    ]


def variations(constants: Sequence[Constant], sample: Sequence[int]) -> list[Variation]:
    """Return all variations, first all cases with unchanged constants; values that no factor changes are left out."""
    found = [Variation("", 1.0, number) for number in sample]
    for each in constants:
        for factor in (factor for factor in FACTORS if each.value(factor) != each.value()):
            found += [Variation(each.key, factor, number) for number in sample]
    return found


def run_variation(variation: Variation, out: Path, seconds: float, seed: int) -> VariationOutcome:
    """Diagnose a case with a changed constant."""
    if not variation.key:
        return _outcome_of(variation, 1.0, trial.run_case(variation.number, out, seconds, seed))
    (constant,) = (each for each in CONSTANTS if each.key == variation.key)
    value = constant.value(variation.factor)
    with override_constant(constant, value):
        return _outcome_of(variation, value, trial.run_case(variation.number, out, seconds, seed))


def _outcome_of(variation: Variation, value: float, outcome: trial.Outcome) -> VariationOutcome:
    answer, found = outcome.answer, outcome.found
    right = found is not None and is_right(answer, found)
    names = 0 if found is None else false_names(answer, found)
    seconds = 0.0 if found is None else found.seconds
    said = trial.outcome_text(outcome)
    return VariationOutcome(
        variation.key,
        variation.factor,
        value,
        variation.number,
        answer.kind,
        right,
        names,
        said,
        seconds,
        outcome.source,
    )


def false_names(answer: Answer, found: Diagnosed) -> int:
    """Return how many effects are named that are not there; a right name for what no catalogue holds is none."""
    if answer.kind == "outside":
        return 0 if is_right(answer, found) else len(found.named)
    return len(false_effects(answer, found))


def append_outcome(outcome: VariationOutcome, out: Path) -> None:
    """Add what came of a variation to the file."""
    trial.append_line(out / OUTCOMES, asdict(outcome))


def read_outcomes(out: Path, source: str) -> dict[Variation, VariationOutcome]:
    """Return what came of variations before, with this package and these values of the constants."""
    found = dict[Variation, VariationOutcome]()
    for stored in trial.read_lines(out / OUTCOMES):
        try:
            outcome = VariationOutcome(**stored)
        except TypeError:
            continue
        if outcome.source == source:
            found[outcome.variation] = outcome
    return found


def run(
    asked: Sequence[Variation], out: Path, jobs: int, seconds: float, seed: int, say: Callable[[str], None]
) -> list[VariationOutcome]:
    """Diagnose cases with changed constants in processes, all but those that are done.

    Parameters
    ----------
    asked
        What is asked for.
    out
        Folder of what comes of it.
    jobs
        Number of processes.
    seconds
        A case that takes longer is an error.
    seed
        Of the cases.
    say
        Receives every step, and the time left.
    """
    known = read_outcomes(out, trial.source())
    left = [each for each in asked if each not in known]
    say(f"seed {seed}: {len(asked) - len(left)} of {len(asked)} diagnoses are done already")
    for number in dict.fromkeys(each.number for each in left):  # before several processes ask for it
        trial.make_case(number, out, seed)
    began = time.perf_counter()
    with trial.worker_pool(jobs) as pool:
        waiting = [pool.submit(run_variation, each, out, seconds, seed) for each in left]
        for count, future in enumerate(as_completed(waiting), start=1):
            outcome = future.result()
            append_outcome(outcome, out)
            known[outcome.variation] = outcome
            rest = (time.perf_counter() - began) / count * (len(left) - count) / 60.0
            at = f"{outcome.key} = {outcome.value:.3g}" if outcome.key else "as it is"
            verdict = "right" if outcome.right else "WRONG"
            say(
                f"{count:4d}/{len(left)}  {at}, {outcome.number}: {verdict}: {outcome.said}  "
                f"[about {rest:.0f} min left]"
            )
    return [known[each] for each in asked]
