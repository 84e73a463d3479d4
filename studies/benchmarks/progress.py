"""How well a diagnosis says how long is left, and the typical times that it says it by::

    python -m studies.benchmarks.progress              # some cases of the trial, some minutes
    python -m studies.benchmarks.progress 20004 30003  # these cases

For every case the stages of the diagnosis are timed, in processor time of one thread; then its words are given to
`flexdesign.diagnosis.progress.Progress` again, at these times, and what it says is compared with what was true. The
last lines are the medians of the stages over the first screening: `TYPICAL` of that module.
"""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from flexdesign import diagnosis
from flexdesign.diagnosis.progress import ENDING, SCREENING, SECOND_SCREENING, TYPICAL, Progress, duration_text
from flexdesign.dynamics.stage_model import reading
from flexdesign.measurements import recordings
from studies.hidden_effect_trial import cases, folder

#: Cases without an effect, with one of several kinds, with two, and outside the catalogue.
CASES = (10002, 10010, 20004, 20300, 21101, 30003, 40400)


@dataclass(frozen=True)
class Message:
    """What was said, and when [s]."""

    at: float
    text: str


@dataclass(frozen=True)
class Estimate:
    """A stage, when it began [s], how long was left then as it was said [s], and in truth [s]."""

    stage: str
    at: float
    predicted: float | None
    true: float


def messages_of(number: int, seed: int = cases.SEED) -> list[Message]:
    """Return the words of the diagnosis of a case of the trial; the last one is its end."""
    with tempfile.TemporaryDirectory() as scratch:
        here = Path(scratch)
        folder.write(cases.make(number, seed), here, here / "answer.toml")
        model, recorded = reading.read(here / folder.MODEL), recordings.read_runs([here / folder.RUNS])
    began, words = time.process_time(), list[Message]()

    def say(text: str) -> None:
        words.append(Message(time.process_time() - began, text))

    diagnosis.diagnose(model, recorded, threads=1, progress=say)
    say("")
    return words


def estimates(words: list[Message]) -> list[Estimate]:
    """Return what is said at the beginning of each stage of a diagnosis, and what was true."""
    now, found = 0.0, list[Estimate]()
    progress = Progress(lambda _: None, lambda: now)
    stage = progress.stage
    for word in words[:-1]:
        now = word.at
        progress(word.text)
        if progress.stage != stage:
            stage = progress.stage
            found.append(Estimate(stage, now, progress.left(), words[-1].at - now))
    return found


def stage_durations(words: list[Message]) -> dict[str, float]:
    """Return how long each stage took after the first screening, over that; the last one if an effect was added."""
    found = estimates(words)
    ends = [*(each.at for each in found[1:]), words[-1].at]
    took = dict[str, float]()
    for each, end in zip(found, ends, strict=True):
        took[each.stage] = took.get(each.stage, 0.0) + end - each.at
    if SECOND_SCREENING not in took:
        del took[ENDING]
    return {stage: took[stage] / took[SCREENING] for stage in TYPICAL if stage in took}


def main(*numbers: str) -> None:
    """Print a line for every stage of every case, then what they come to."""
    every, ratios = list[dict[str, float]](), list[float]()
    for number in map(int, numbers or CASES):
        words = messages_of(number)
        every.append(stage_durations(words))
        for each in estimates(words):
            if each.predicted is not None:
                print(
                    f"{number}, {each.stage}: {duration_text(each.predicted)}, {each.predicted:.1f} s; "
                    f"in truth {each.true:.1f} s"
                )
                ratios.append(each.true / each.predicted)
    if ratios:
        inside = sum(1 / 3 <= ratio <= 3 for ratio in ratios)
        print(f"truth over estimate: {min(ratios):.2g} to {max(ratios):.2g}, {inside} of {len(ratios)} within 3 times")
    for stage in TYPICAL:
        if took := [each[stage] for each in every if stage in each]:
            print(f"{stage}: {median(took):.2g} ({min(took):.2g} to {max(took):.2g}) of the first screening")


if __name__ == "__main__":
    main(*sys.argv[1:])
