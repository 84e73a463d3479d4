"""Cases diagnosed as they are and without one part, in processes; a folder of outcomes for each part."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path

from studies.ablation.parts import Part, chosen, switched_off, watching
from studies.hidden_effect_trial import trial
from studies.hidden_effect_trial.trial import Outcome

#: Which parts acted in a case, a line of JSON for each; and the folder of the diagnoses with all of them.
ACTED, AS_IS = "acted.jsonl", "as-is"


@dataclass(frozen=True, eq=False)
class Ablation:
    """Outcomes of cases with all parts, and without one.

    Parameters
    ----------
    as_is
        With all parts, by number of the case.
    acted
        Keys of the parts that acted in a case, by its number.
    without
        Without a part, by its key and by number of the case; only of cases where it acted.
    """

    as_is: dict[int, Outcome]
    acted: dict[int, frozenset[str]]
    without: dict[str, dict[int, Outcome]]


def diagnose_watched(number: int, out: Path, seconds: float, seed: int) -> tuple[Outcome, frozenset[str]]:
    """Diagnose a case with all parts; return which of them acted, too."""
    with watching() as acted:
        outcome = trial.run_case(number, out, seconds, seed)
    return outcome, frozenset(acted)


def diagnose_without(key: str, number: int, out: Path, seconds: float, seed: int) -> Outcome:
    """Diagnose a case without one part."""
    (part,) = chosen(key)
    with switched_off(part):
        return trial.run_case(number, out, seconds, seed)


def run(
    numbers: Sequence[int],
    parts: Sequence[Part],
    most: int,
    out: Path,
    jobs: int,
    seed: int,
    say: Callable[[str], None],
) -> Ablation:
    """Diagnose cases with all parts, then without each part the first of those where it acted.

    Parameters
    ----------
    numbers, seed
        Of the cases.
    parts
        What is switched off.
    most
        Largest number of cases for each part.
    out
        Folder of what comes of it.
    jobs
        Number of processes.
    say
        Receives every finished case, and the time left.
    """
    seconds = trial.settings().seconds
    acted, as_is = read_acted(out), _read(out / AS_IS, seed)
    left = [number for number in numbers if number not in as_is or number not in acted]
    with trial.worker_pool(jobs) as pool:
        progress = Progress(len(left), say)
        waiting = {pool.submit(diagnose_watched, n, out, seconds, seed): n for n in left}
        for future in as_completed(waiting):
            outcome, keys = future.result()
            line = {"number": outcome.number, "acted": sorted(keys), "source": outcome.source}
            trial.append_line(out / ACTED, line)
            trial.append_outcome(outcome, out / AS_IS)
            as_is[outcome.number], acted[outcome.number] = outcome, keys
            progress.end(f"with all parts, {outcome.number}: {trial.outcome_text(outcome)}")
        without = {part.key: _read(out / part.key, seed) for part in parts}
        wanted = {part.key: [n for n in numbers if part.key in acted[n]][:most] for part in parts}
        asked = [(key, n) for key, ns in wanted.items() for n in ns if n not in without[key]]
        progress = Progress(len(asked), say)
        pairs = {pool.submit(diagnose_without, key, n, out, seconds, seed): key for key, n in asked}
        for each in as_completed(pairs):
            key, outcome = pairs[each], each.result()
            trial.append_outcome(outcome, out / key)
            without[key][outcome.number] = outcome
            progress.end(f"without {key}, {outcome.number}: {trial.outcome_text(outcome)}")
    made = {key: {n: without[key][n] for n in ns} for key, ns in wanted.items()}
    return Ablation({n: as_is[n] for n in numbers}, {n: acted[n] for n in numbers}, made)


def read_acted(out: Path) -> dict[int, frozenset[str]]:
    """Return which parts acted in the cases of this package that are done."""
    source, stored = trial.source(), trial.read_lines(out / ACTED)
    return {each["number"]: frozenset(each["acted"]) for each in stored if each["source"] == source}


def _read(folder: Path, seed: int) -> dict[int, Outcome]:
    source = trial.source()
    return {number: each for number, each in trial.read_outcomes(folder, seed).items() if each.source == source}


class Progress:
    """Says each finished diagnosis, and about how long the others take."""

    def __init__(self, count: int, say: Callable[[str], None]) -> None:
        self.count, self.done, self.say, self.began = count, 0, say, time.perf_counter()

    def end(self, text: str) -> None:
        """Say what a diagnosis gave, and about how long the others take."""
        self.done += 1
        rest = (time.perf_counter() - self.began) / self.done * (self.count - self.done) / 60.0
        self.say(f"{self.done:4d}/{self.count}  {text}  [about {rest:.0f} min left]")
