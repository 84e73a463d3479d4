"""A sweep under way: cases that are missing go to processes or to a cluster, answers are kept as they come."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

from threadpoolctl import threadpool_limits

from flexdesign import part as parts
from flexdesign import refinement, versions
from flexdesign.cache import content_key
from flexdesign.design import read as read_design
from flexdesign.errors import InputError
from flexdesign.sweeps import choosing
from flexdesign.sweeps.answers import Answers
from flexdesign.sweeps.evaluators import Question, answers
from flexdesign.sweeps.plan import SweepPlan, settings_of
from flexdesign.sweeps.sampling import Case
from flexdesign.sweeps.store import Store

Progress = Callable[[str], None]
Submit = Callable[[Sequence[Question]], "Future[Answers]"]
#: A batch is what about so many seconds of work are, and no more cases than these.
BATCH = {"pseudo-rigid": 2000, "analytic": 100, "fem": 1}
#: A batch whose process died is tried again so often, case by case.
AGAIN = 1
#: Why a case has no answer whose process died.
DIED = "the process that solved it died (out of memory, or killed)"


@dataclass(frozen=True)
class Sweep:
    """A sweep that is done.

    Parameters
    ----------
    plan
        What was asked.
    cases, answers
        All cases in order, and what was said of each.
    computed
        How many of them this run had to compute.
    seconds
        How long it took.
    """

    plan: SweepPlan
    cases: Sequence[Case]
    answers: Answers
    computed: int
    seconds: float

    @property
    def failed(self) -> list[int]:
        """The places of the cases without an answer."""
        return [i for i, error in enumerate(self.answers.errors) if error]


def run(
    plan: SweepPlan, store: Store, *, jobs: int = 2, scheduler: str = "", progress: Progress = lambda _: None
) -> Sweep:
    """Run a sweep: compute what the store does not have.

    Parameters
    ----------
    plan
        What to do.
    store
        Where answers are looked up and kept.
    jobs
        Processes at a time on this machine.
    scheduler
        Address of a Dask scheduler, whose workers see the same files; none uses processes of this machine.
    progress
        Told what is going on.

    Raises
    ------
    InputError
        If the scheduler cannot be reached, or answers cannot be kept. KeyboardInterrupt ends it; what is done is kept.
    """
    began = time.perf_counter()
    progress("looking up what is known")
    cases = plan.cases()
    questions = asked(plan, cases)
    store.refresh()
    todo = list({q.key: q for q in questions if q.key not in store}.values())
    if todo:
        size = max(1, min(BATCH[plan.evaluator], -(-len(todo) // (4 * jobs))))
        batches = [todo[i : i + size] for i in range(0, len(todo), size)]
        with _workers(jobs, scheduler) as submit:
            _compute(batches, submit, store, progress, known=len(questions) - len(todo))
        store.refresh()
    found = store.find([question.key for question in questions])
    choosing.refuse_unknown(found, plan.limits, plan.aims, plan.file)
    return Sweep(plan, cases, found, len(todo), time.perf_counter() - began)


def asked(plan: SweepPlan, cases: Sequence[Case]) -> list[Question]:
    """Return the question of each case; its key holds all that the answer depends on, the code among it."""
    factors = {factor.key: factor for factor in plan.factors}
    file, mesh = plan.design.file.resolve(), plan.mesh.model_dump()
    code = content_key(_code(plan), plan.evaluator, mesh if plan.evaluator == "fem" else {})
    roots = dict[tuple[str, ...], str]()
    made = []
    for case in cases:
        overrides, dimensions = settings_of(case, factors)
        overrides = (*plan.overrides, *overrides)
        if overrides not in roots:
            roots[overrides] = content_key(code, _root(plan, overrides))
        key = content_key(roots[overrides], sorted(dimensions.items()))
        made.append(Question(key, file, overrides, dimensions, plan.evaluator, mesh))
    return made


def _root(plan: SweepPlan, overrides: Sequence[str]) -> list[object]:
    """Return what a design is, but for the dimensions that vary; where it cannot be read, what was asked."""
    try:
        design = read_design(plan.design.file, overrides)
    except InputError as error:
        return [list(overrides), str(error)]
    drive = design.actuator.model_dump() if design.actuator else {}
    return [dict(design.dimensions), repr(design.material), drive, design.effects]


def _code(plan: SweepPlan) -> list[object]:
    """Return what the answers depend on besides the design: the part, the engine and the libraries."""
    source = parts.file_of(plan.design.part_class).read_text(encoding="utf-8")
    return [source, refinement.engine(), versions.installed(refinement.LIBRARIES)]


def _compute(
    batches: Sequence[Sequence[Question]], submit: Submit, store: Store, progress: Progress, known: int
) -> None:
    """Have batches computed, and keep each as it comes; what dies is tried again, case by case, and then recorded."""
    total, done, failed, began = known + sum(map(len, batches)), known, 0, time.perf_counter()
    waiting: dict[Future[Answers], tuple[Sequence[Question], int]] = {submit(b): (b, 0) for b in batches}
    while waiting:
        for future in as_completed(list(waiting)):
            batch, tries = waiting.pop(future)
            try:
                found = future.result()
            except Exception as error:
                if not _has_died(error):
                    raise
                if tries < AGAIN or len(batch) > 1:
                    waiting |= {submit([question]): ([question], tries + 1) for question in batch}
                    continue
                found = Answers.of([((), DIED, 0.0)])
            store.keep([question.key for question in batch], found)
            done, failed = done + len(found), failed + sum(map(bool, found.errors))
            rate = (done - known) / (time.perf_counter() - began)
            left = (total - done) / rate
            words = f"{done} of {total} cases" + (f", {failed} failed" if failed else "")
            progress(f"{words}, {_span(left)} left" if done < total else words)


def _has_died(error: Exception) -> bool:
    return isinstance(error, BrokenProcessPool) or type(error).__name__ == "KilledWorker"


def _span(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"


@contextmanager
def _workers(jobs: int, scheduler: str) -> Iterator[Submit]:
    """Give what hands a batch to a worker."""
    if scheduler:
        with _cluster(scheduler) as to_cluster:
            yield to_cluster
        return
    pools = [_Pool(jobs)]

    def submit(batch: Sequence[Question]) -> Future[Answers]:
        try:
            return pools[-1].submit(batch)
        except BrokenProcessPool:
            pools.append(_Pool(1))  # one at a time: whoever dies takes no other along
            return pools[-1].submit(batch)

    try:
        yield submit
    finally:
        for pool in pools:
            pool.shutdown()


class _Pool:
    """Processes of this machine, each with one thread for linear algebra."""

    def __init__(self, jobs: int) -> None:
        self._pool = ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=_begin)

    def submit(self, batch: Sequence[Question]) -> Future[Answers]:
        return self._pool.submit(answers, batch)

    def shutdown(self) -> None:
        """End the processes; what they are at is lost, what is kept stays."""
        processes = list((self._pool._processes or {}).values())  # an interrupted sweep waits for nobody
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()


def _begin() -> None:
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the sweep itself is told, and ends its processes
    threadpool_limits(1)


@contextmanager
def _cluster(address: str) -> Iterator[Any]:
    """Give what hands a batch to the workers of a Dask scheduler, which give a case up when it killed four of them."""
    try:
        from distributed import Client
    except ImportError:
        remedy = "needs Dask: pip install 'flexdesign[cluster]'"
        raise InputError("command line", "--scheduler", address, remedy) from None
    try:
        client = Client(address, timeout="20s")
    except (OSError, ValueError) as error:
        remedy = f"no scheduler answers there ({error}); give the address that dask scheduler prints"
        raise InputError("command line", "--scheduler", address, remedy) from None
    with client, client.get_executor(pure=False) as executor:
        yield lambda batch: executor.submit(_answers_alone, batch)


def _answers_alone(batch: Sequence[Question]) -> Answers:
    with threadpool_limits(1):
        return answers(batch)
