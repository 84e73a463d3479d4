"""Cases under changed constants: which, in processes, a line of a file for each, to go on where it stopped."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

from flexdesign.core import subprocess_call
from studies.hidden_effect_trial import cases, trial
from studies.hidden_effect_trial.effects import CATALOGUE, OUTSIDE
from studies.hidden_effect_trial.folder import Answer
from studies.hidden_effect_trial.scoring import Diagnosed, invented, is_right
from studies.sensitivity.constants import CONSTANTS, Constant, changed

#: What came of it, a line of JSON for each case and setting.
ENDED = "settings.jsonl"
#: Half a value and twice.
FACTORS = (0.5, 2.0)
#: How many of twelve cases miss nothing, one effect, and one that no catalogue holds.
NOTHING, SINGLE, STRANGE = 4, 6, 2
#: Effects and mechanisms outside the catalogue in turn: of every socket, those that are quickly diagnosed; a payload is
#: found by the prior.
SINGLES = ("creep", "payload_mass", "stress_stiffening", "driver_bandwidth", "sensor_drift", "electrostriction")
OUTSIDES = ("quadratic_sensor", "telegraph_jump", "contact_spring", "backlash")


@dataclass(frozen=True)
class Setting:
    """A case to be diagnosed with one constant at a factor of its value; with an empty key as it is."""

    key: str
    factor: float
    number: int


@dataclass(frozen=True)
class Ended:
    """What came of a setting.

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
    def setting(self) -> Setting:
        """Which setting it is."""
        return Setting(self.key, self.factor, self.number)


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


def all_of(constants: Sequence[Constant], sample: Sequence[int]) -> list[Setting]:
    """Return all settings, first all cases with every constant as it is; values that stay as they are are left out."""
    settings = [Setting("", 1.0, number) for number in sample]
    for each in constants:
        for factor in (factor for factor in FACTORS if each.value(factor) != each.value()):
            settings += [Setting(each.key, factor, number) for number in sample]
    return settings


def one(setting: Setting, out: Path, seconds: float, seed: int) -> Ended:
    """Diagnose a case under a setting."""
    if not setting.key:
        return _ended(setting, 1.0, trial.one(setting.number, out, seconds, seed))
    (constant,) = (each for each in CONSTANTS if each.key == setting.key)
    value = constant.value(setting.factor)
    with changed(constant, value):
        return _ended(setting, value, trial.one(setting.number, out, seconds, seed))


def _ended(setting: Setting, value: float, outcome: trial.Outcome) -> Ended:
    answer, found = outcome.answer, outcome.found
    right = found is not None and is_right(answer, found)
    names = 0 if found is None else false_names(answer, found)
    seconds = 0.0 if found is None else found.seconds
    said = trial.described(outcome)
    return Ended(
        setting.key, setting.factor, value, setting.number, answer.kind, right, names, said, seconds, outcome.source
    )


def false_names(answer: Answer, found: Diagnosed) -> int:
    """Return how many effects are named that are not there; a right name for what no catalogue holds is none."""
    if answer.kind == "outside":
        return 0 if is_right(answer, found) else len(found.named)
    return len(invented(answer, found))


def keep(ended: Ended, out: Path) -> None:
    """Add what came of a setting to the file; what a killed process leaves of a line is passed over."""
    out.mkdir(parents=True, exist_ok=True)
    with (out / ENDED).open("ab+") as file:
        file.seek(-1 if file.tell() else 0, os.SEEK_END)
        torn = file.read(1) not in (b"", b"\n")
        file.write(b"\n" * torn + json.dumps(asdict(ended)).encode() + b"\n")


def kept(out: Path, source: str) -> dict[Setting, Ended]:
    """Return what came of settings before, with this package and these values of the constants."""
    try:
        lines = (out / ENDED).read_text(encoding="utf-8").splitlines()
    except OSError:
        return {}
    found = dict[Setting, Ended]()
    for line in lines:
        try:
            ended = Ended(**json.loads(line))
        except (ValueError, TypeError):
            continue
        if ended.source == source:
            found[ended.setting] = ended
    return found


def run(
    settings: Sequence[Setting], out: Path, jobs: int, seconds: float, seed: int, say: Callable[[str], None]
) -> list[Ended]:
    """Diagnose cases under settings in processes, all but those that are done.

    Parameters
    ----------
    settings
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
    known = kept(out, trial.source())
    left = [each for each in settings if each not in known]
    say(f"seed {seed}: {len(settings) - len(left)} of {len(settings)} diagnoses are done already")
    for number in dict.fromkeys(each.number for each in left):  # before several processes ask for it
        trial.drawn(number, out, seed)
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"
    began = time.perf_counter()
    with ProcessPoolExecutor(max(1, jobs), get_context("spawn"), initializer=subprocess_call.end_with_parent) as pool:
        waiting = [pool.submit(one, each, out, seconds, seed) for each in left]
        for count, future in enumerate(as_completed(waiting), start=1):
            ended = future.result()
            keep(ended, out)
            known[ended.setting] = ended
            rest = (time.perf_counter() - began) / count * (len(left) - count) / 60.0
            at = f"{ended.key} = {ended.value:.3g}" if ended.key else "as it is"
            verdict = "right" if ended.right else "WRONG"
            say(f"{count:4d}/{len(left)}  {at}, {ended.number}: {verdict}: {ended.said}  [about {rest:.0f} min left]")
    return [known[each] for each in settings]
