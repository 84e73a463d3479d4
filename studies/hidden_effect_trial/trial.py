"""Running the trial: cases side by side in processes, a line of a file for each, to go on where it stopped."""

from __future__ import annotations

import hashlib
import json
import math
import os
import signal
import time
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from flexdesign.core import subprocess_call
from studies.hidden_effect_trial import cases, imperfect
from studies.hidden_effect_trial import folder as folders
from studies.hidden_effect_trial.folder import Answer
from studies.hidden_effect_trial.scoring import Diagnosed, group_of, is_right

#: The file that says what is run, and the folder of what comes out.
SETTINGS = Path(__file__).resolve().parent.parent / "hidden_effect_trial.toml"
OUT = Path("reports/hidden_effect_trial")
#: What came of the cases, a line of JSON for each; of several of one case the last counts.
OUTCOMES = "outcomes.jsonl"
#: What a case is made by; when it changes, cases are made anew.
_MAKERS = (
    "curves", "kernel", "effects", "recordings", "faults", "bench", "detection", "confusion", "cases", "imperfect",
    "folder",
)  # fmt: skip
#: What of the package no diagnosis imports: its changes leave outcomes what they are.
NOT_IMPORTED = ("api", "cli", "fem", "report", "testing", "workbench", "workflows")


@dataclass(frozen=True)
class Outcome:
    """What came of a case.

    Parameters
    ----------
    number
        Of the case.
    answer
        What was hidden.
    found
        What was said; None if it could not be diagnosed.
    error
        Why not; empty otherwise.
    source
        Fingerprint of the package that said it.
    """

    number: int
    answer: Answer
    found: Diagnosed | None
    error: str
    source: str


@dataclass(frozen=True)
class Settings:
    """What ``hidden_effect_trial.toml`` says: cases by kind, those for continuous integration and for the slow
    tests, processes, seconds.

    Of imperfect benches and of rough models, how many cases belong to each effect, and how many have nothing missing.
    """

    counts: dict[str, int]
    ci: tuple[int, ...]
    guard: tuple[int, ...]
    jobs: int
    seconds: float
    imperfect: dict[str, int]
    rough: dict[str, int]

    def sample(self, count: int) -> Settings:
        """Return the settings of a stratified sample: `count` cases of each single effect, others in proportion.

        Cases are drawn one by one from their numbers, so that the first of each stratum are a random sample of it.
        """

        def part(counts: dict[str, int]) -> dict[str, int]:
            share = count / counts["single"]
            return {kind: math.ceil(round(share * number, 9)) for kind, number in counts.items()}

        return replace(self, counts=part(self.counts), imperfect=part(self.imperfect), rough=part(self.rough))

    def imperfect_numbers(self, only: str | None = None, count: int | None = None) -> list[int]:
        """Return the numbers of cases on imperfect benches, all or of one kind, effect or structural error."""
        found = imperfect.numbers(self.imperfect["single"], self.imperfect["none"], only)
        if not found:
            raise ValueError(f"there is no effect and no structural error {only}; errors: {', '.join(imperfect.KINDS)}")
        return found[:count]

    def rough_numbers(self, only: str | None = None, count: int | None = None) -> list[int]:
        """Return the numbers of cases with rough models, all, of one kind or effect, or the first `count`."""
        return self.numbers(only, count, rough=True)

    def numbers(self, only: str | None = None, count: int | None = None, rough: bool = False) -> list[int]:
        """Return the numbers of all cases, of one kind or effect, or the first `count` of each kind."""
        counts = self.rough if rough else self.counts
        everything = {kind: cases.numbers(kind, number, rough) for kind, number in counts.items()}
        found = [n for kind, numbers in everything.items() if only in (None, kind) for n in numbers]
        if only not in (None, *counts):
            about = [n for kind, numbers in everything.items() if kind not in ("none", "pair") for n in numbers]
            found = [n for n in about if cases.hidden_in(n) == only]
        if not found:
            raise ValueError(f"there is no kind of case and no effect {only}; kinds: {', '.join(counts)}")
        return found[:count] if count is not None else found


def settings(path: Path = SETTINGS) -> Settings:
    """Read the trial's settings."""
    stored = tomllib.loads(path.read_text(encoding="utf-8"))
    return Settings(
        stored["cases"],
        tuple(stored["ci"]["numbers"]),
        tuple(stored["guard"]["numbers"]),
        stored["run"]["jobs"],
        stored["run"]["seconds"],
        stored["imperfect"],
        stored["rough"],
    )


def fingerprint(folder: Path, paths: Iterable[Path]) -> str:
    """Return a hash of files in a folder: of their names there and of what they hold."""
    total = hashlib.sha256()
    for path in paths:
        total.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes())
    return total.hexdigest()[:12]


def folder_of(out: Path, seed: int, kind: str = "") -> Path:
    """Return the folder of a seed: what comes of different seeds, of imperfect benches or rough models, never mixes."""
    return out / (f"{kind}-seed-{seed}" if kind else f"seed-{seed}")


def make_case(number: int, out: Path, seed: int = cases.SEED) -> tuple[Path, Answer]:
    """Return the folder of a case and its answer; they are made if this version of the trial has not yet."""
    here = Path(__file__).parent
    made = out / "drawn" / fingerprint(here, [here / f"{name}.py" for name in _MAKERS])
    on_imperfect = imperfect.holds(number)
    name = f"{'imperfect' if on_imperfect else cases.kind_of(number)}-{number}"
    folder, answer = made / name, made / "answers" / f"{name}.toml"
    if not answer.is_file():  # written last
        case = imperfect.make(number, seed) if on_imperfect else cases.add_test_run(cases.make(number, seed))
        folders.write(case, folder, answer)
    return folder, folders.read_answer(answer)


def run_case(number: int, out: Path, seconds: float = 0.0, seed: int = cases.SEED) -> Outcome:
    """Make and diagnose a case."""
    from studies.hidden_effect_trial import subject

    folder, answer = make_case(number, out, seed)
    found, error = None, ""
    try:
        with no_longer_than(seconds):
            found = subject.diagnose(folder, answer)
    except Exception as problem:  # whatever it is, the other cases go on, and the report names it
        error = f"{type(problem).__name__}: {problem}"
    return Outcome(number, answer, found, error, source())


def source() -> str:
    """Return the fingerprint of what is on trial: the package but for what no diagnosis imports."""
    import flexdesign

    package = Path(flexdesign.__file__).parent
    on_trial = (each for each in sorted(package.rglob("*.py")) if _top(each, package) not in NOT_IMPORTED)
    return fingerprint(package, on_trial)


def _top(module: Path, package: Path) -> str:
    return module.relative_to(package).parts[0].removesuffix(".py")


class no_longer_than:
    """Raises TimeoutError in this process after some seconds; 0 for never."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds if hasattr(signal, "SIGALRM") else 0.0

    def __enter__(self) -> None:
        if self.seconds:
            signal.signal(signal.SIGALRM, self._late)
            signal.setitimer(signal.ITIMER_REAL, self.seconds)

    def __exit__(self, *_: object) -> None:
        if self.seconds:
            signal.setitimer(signal.ITIMER_REAL, 0.0)

    def _late(self, *_: object) -> None:
        raise TimeoutError(f"took longer than {self.seconds:g} s")


def append_outcome(outcome: Outcome, out: Path) -> None:
    """Add what came of a case to the file of outcomes."""
    append_line(out / OUTCOMES, asdict(outcome))


def append_line(path: Path, values: Mapping[str, Any]) -> None:
    """Add a line of JSON to a file; what a killed process left of a line there ends first."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("ab+") as file:
        file.seek(-1 if file.tell() else 0, os.SEEK_END)
        torn = file.read(1) not in (b"", b"\n")
        file.write(b"\n" * torn + json.dumps(values).encode() + b"\n")


def read_lines(path: Path) -> list[dict[str, Any]]:
    """Return the lines that `append_line` added; none without a file, and without what a killed process left of one."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError:
        return []
    found = list[dict[str, Any]]()
    for line in lines:
        with suppress(ValueError):
            found.append(json.loads(line))
    return found


def worker_pool(jobs: int) -> ProcessPoolExecutor:
    """Return a pool of processes, at least one, which end with this one.

    One thread in each: the linear algebra is small, and the other cores have cases of their own.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"
    return ProcessPoolExecutor(max(1, jobs), get_context("spawn"), initializer=subprocess_call.end_with_parent)


def read_outcomes(out: Path, seed: int = cases.SEED) -> dict[int, Outcome]:
    """Return what came of a seed's cases before, by number, but for those whose last outcome is an error."""
    found: dict[int, Outcome | None] = {}
    for stored in read_lines(out / OUTCOMES):
        try:
            found[stored["number"]] = _outcome(stored) if not stored["error"] else None
        except (ValueError, KeyError, TypeError):
            continue
    return {number: each for number, each in found.items() if each is not None and each.answer.seed == seed}


def _outcome(stored: dict[str, Any]) -> Outcome:
    answer, found = stored["answer"], stored["found"]
    answer["groups"] = {name: tuple(others) for name, others in answer["groups"].items()}
    found["named"], found["groups"] = tuple(found["named"]), tuple(tuple(group) for group in found["groups"])
    found["inside"] = {name: (bool(hit), float(width)) for name, (hit, width) in found["inside"].items()}
    return Outcome(stored["number"], Answer(**answer), Diagnosed(**found), stored["error"], stored["source"])


def run(
    numbers: Sequence[int],
    out: Path,
    jobs: int,
    seconds: float,
    say: Callable[[str], None],
    fresh: bool = False,
    seed: int = cases.SEED,
) -> list[Outcome]:
    """Run cases in processes, all but those that are done.

    Parameters
    ----------
    numbers
        Of the cases.
    out
        Folder of what comes of it.
    jobs
        Number of processes.
    seconds
        A case that takes longer is an error.
    say
        Receives every finished case, and the time left.
    fresh
        Whether what is done is done again.
    seed
        Of all cases.
    """
    known = {} if fresh else read_outcomes(out, seed)
    done = {n: known[n] for n in numbers if n in known}
    left = [n for n in numbers if n not in done]
    if done:
        say(f"{len(done)} of {len(numbers)} cases are done already")
    if not left:
        return [done[n] for n in numbers]
    began = time.perf_counter()
    with worker_pool(jobs) as pool:
        waiting = {pool.submit(run_case, n, out, seconds, seed): n for n in left}
        for count, future in enumerate(as_completed(waiting), start=1):
            outcome = future.result()
            append_outcome(outcome, out)
            done[outcome.number] = outcome
            rest = (time.perf_counter() - began) / count * (len(left) - count)
            said = outcome.error or (
                f"{'right' if outcome.found and is_right(outcome.answer, outcome.found) else 'WRONG'}: "
                f"{outcome_text(outcome)}"
            )
            name = f"{outcome.answer.kind}-{outcome.number}"
            say(f"{len(done):4d}/{len(numbers)}  {name:15s} {said}  [{_time(rest)} left]")
    return [done[n] for n in numbers]


def outcome_text(outcome: Outcome) -> str:
    """Return in a line what was hidden and what was said."""
    answer, found = outcome.answer, outcome.found
    hidden = ", ".join(f"{name} at {answer.ratio.get(name, math.nan):.3g}" for name in answer.effects) or "nothing"
    if answer.fault:
        hidden += f", {answer.fault} of {100.0 * answer.structural / answer.stroke:.2g} % of stroke"
    if found is None:
        return f"{hidden} -> {outcome.error}"
    groups = [" or ".join(group_of(found, name)) for name in found.named]
    left = f", {100.0 * found.remainder / answer.stroke:.2g} % of stroke remain" if found.remainder else ""
    return f"{hidden} -> {found.verdict}{': ' if groups else ''}{' and '.join(groups)}{left}"


def _time(seconds: float) -> str:
    minutes = round(seconds / 60.0)
    return f"{minutes // 60} h {minutes % 60:02d} min" if minutes >= 60 else f"{minutes} min" if minutes else "seconds"
