"""Recordings of others, diagnosed with all parts and without each that acts in them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from time import process_time
from typing import Any

from flexdesign.report import comparison_text, render
from flexdesign.report.diagnosis import diagnosis_text
from flexdesign.report.document import Document, Section, Table
from studies.ablation.ablation import Progress
from studies.ablation.parts import Part, chosen, switched_off, watching
from studies.hidden_effect_trial import trial
from studies.real_recordings.__main__ import RECORDINGS, Recording, diagnose_recording

#: What is kept: one diagnosis a line.
KEPT = "recordings.jsonl"
#: A part is said to matter to an error that differs by more than this share without it.
SAME_ERROR = 0.01
#: A diagnosis without a part is given up after this time [s].
LONGEST = 300.0


@dataclass(frozen=True)
class Answer:
    """What was said of a recording.

    Parameters
    ----------
    title, without
        The recording, and the part that was switched off; empty if none was.
    named
        The effects that were named, the verdict where there are none, or that it did not end, as text.
    error
        Rms residual of the validation runs with them, SI.
    error_text
        The same with its unit.
    seconds
        Of the processor.
    acted
        Keys of the parts that acted; only of a diagnosis with all of them.
    """

    title: str
    without: str
    named: str
    error: float
    error_text: str
    seconds: float
    acted: tuple[str, ...] = ()

    def differs(self, other: Answer) -> bool:
        """Tell whether another answer names something else, or predicts with another error."""
        return self.named != other.named or abs(other.error - self.error) > SAME_ERROR * self.error

    def __str__(self) -> str:
        return ", ".join(filter(None, (self.named, self.error_text)))


def answer(recording: Recording, folder: Path, without: str = "") -> Answer:
    """Diagnose a recording, without a part if one is named."""
    began = process_time()
    with ExitStack() as stack:
        acted = set[str]()
        if without:
            (part,) = chosen(without)
            stack.enter_context(switched_off(part))
            stack.enter_context(trial.no_longer_than(LONGEST))
        else:
            acted = stack.enter_context(watching())
        try:
            found = diagnose_recording(recording, folder / recording.folder)
        except TimeoutError:
            return Answer(recording.title, without, f"no end in {LONGEST:g} s", math.inf, "", process_time() - began)
    named = " and ".join(diagnosis_text.effect_name(each.name) for each in found.effects) or found.verdict
    text = comparison_text.error(diagnosis_text.response(found), found.error)
    return Answer(recording.title, without, named, found.error, text, process_time() - began, tuple(sorted(acted)))


def find(folder: Path) -> list[Recording]:
    """Return the recordings that a folder holds.

    Raises
    ------
    ValueError
        If it holds none.
    """
    there = [recording for recording in RECORDINGS if (folder / recording.folder).is_dir()]
    if not there:
        raise ValueError(f"{folder} holds none of {', '.join(recording.folder for recording in RECORDINGS)}")
    return there


def run(
    there: Sequence[Recording],
    folder: Path,
    parts: Sequence[Part],
    out: Path,
    jobs: int,
    say: Callable[[str], None],
) -> list[Answer]:
    """Diagnose recordings of a folder, with all parts and without each that acts; return all answers."""
    source, keys = trial.source(), {part.key for part in parts}
    kept = [each for each in trial.read_lines(out / KEPT) if each.pop("source") == source]
    answers = {(each["title"], each["without"]): Answer(**each | {"acted": tuple(each["acted"])}) for each in kept}
    with trial.worker_pool(jobs) as pool:
        for is_whole in (True, False):
            asked = [
                (recording, without)
                for recording in there
                for without in ([""] if is_whole else sorted(keys.intersection(answers[recording.title, ""].acted)))
            ]
            pending = [
                pool.submit(answer, r, folder, without) for r, without in asked if (r.title, without) not in answers
            ]
            progress = Progress(len(pending), say)
            for future in as_completed(pending):
                made = future.result()
                trial.append_line(out / KEPT, asdict(made) | {"source": source})
                answers[made.title, made.without] = made
                progress.end(f"{made.title}, without {made.without or 'nothing'}: {made}")
    return [each for each in answers.values() if each.without in ("", *keys)]


def write(answers: Sequence[Answer], parts: Sequence[Part], out: Path) -> list[str]:
    """Write the report into a folder; return its table, a line for each part."""
    whole = {each.title: each for each in answers if not each.without}
    without = {(each.title, each.without): each for each in answers if each.without}
    rows = [["all parts", "", *map(str, whole.values())]]
    rows += [
        [part.key, part.does, *(_cell(each, without.get((title, part.key))) for title, each in whole.items())]
        for part in parts
    ]
    heads = ["part", "what it does", *whole]
    texts = [
        "What is named, and the rms error of the validation runs with it. A dash: the part does not act. Same: "
        f"the same effects, and an error within {100 * SAME_ERROR:.0f} %."
    ]
    result: dict[str, Any] = {"answers": [asdict(each) for each in answers]}
    render.write(
        out,
        Document(
            "Ablation of the diagnosis: recordings of others",
            [f"{len(whole)} recordings with all parts, and without each part that acts in them."],
            [Section("Parts", texts, [Table(heads, rows)])],
        ),
        result,
        {},
    )
    return ["  ".join([row[0], *row[2:]]) for row in rows]


def _cell(whole: Answer, without: Answer | None) -> str:
    if without is None:
        return "–"
    return str(without) if whole.differs(without) else "same"
