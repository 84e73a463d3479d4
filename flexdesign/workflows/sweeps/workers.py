"""Who does the work of a sweep: processes of this machine, or the workers of a cluster; any of them may die."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.context import SpawnContext, SpawnProcess
from types import ModuleType
from typing import Any, Protocol

from threadpoolctl import threadpool_limits

from flexdesign.core import foreign_code, subprocess_call
from flexdesign.core.errors import InputError
from flexdesign.workflows.sweeps.evaluators import EvaluationRequest, evaluate_all
from flexdesign.workflows.sweeps.results import Results


class Workers(Protocol):
    """Who does the work.

    Attributes
    ----------
    window
        How many batches they are given at a time.
    died
        What is raised for a batch whose process died.
    """

    window: int
    died: type[Exception]

    def submit(self, batch: Sequence[EvaluationRequest]) -> Future[Results]:
        """Hand over a batch."""

    def alone(self, request: EvaluationRequest) -> Results:
        """Return the answer to a question that may be deadly."""

    def lost(self, waiting: dict[Future[Results], Sequence[EvaluationRequest]]) -> list[Sequence[EvaluationRequest]]:
        """Return, and take out, the batches that were lost with another; what comes next finds new processes."""

    def close(self) -> None:
        """End the work; what they are at is lost."""


class Processes:
    """Processes of this machine, each with one thread for linear algebra."""

    died: type[Exception] = BrokenProcessPool

    def __init__(self, jobs: int) -> None:
        self._jobs, self.window, self._pool = jobs, 2 * jobs, _pool(jobs)

    def submit(self, batch: Sequence[EvaluationRequest]) -> Future[Results]:
        """Hand over a batch."""
        return self._pool.submit(evaluate_all, batch)

    def alone(self, request: EvaluationRequest) -> Results:
        """Return the answer to a question that may be deadly."""
        pool = _pool(1)
        try:
            return pool.submit(evaluate_all, [request]).result()
        finally:
            _end(pool)

    def lost(self, waiting: dict[Future[Results], Sequence[EvaluationRequest]]) -> list[Sequence[EvaluationRequest]]:
        """Return, and take out, the batches that were lost with another."""
        batches = list(waiting.values())  # whoever dies takes the whole pool along
        waiting.clear()
        _end(self._pool)
        self._pool = _pool(self._jobs)
        return batches

    def close(self) -> None:
        """End the work."""
        _end(self._pool)


class _Process(SpawnProcess):
    """A process that leaves the user's script alone.

    `multiprocessing` runs the script of the parent in each new process, which needs none of it: the script would sweep
    again where it has no guard, and a script from stdin cannot be found.
    """

    @staticmethod
    def _Popen(process: Any) -> Any:
        script = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            return SpawnProcess._Popen(process)
        finally:
            sys.modules["__main__"] = script


class _Context(SpawnContext):
    Process = _Process


def _pool(jobs: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(jobs, mp_context=_Context(), initializer=_begin)


def _begin() -> None:
    subprocess_call.end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the sweep itself gets the signal, and ends its processes
    threadpool_limits(1)


def _end(pool: ProcessPoolExecutor) -> None:
    processes = list((pool._processes or {}).values())  # an interrupted sweep waits for nobody
    pool.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.terminate()


class Cluster:
    """The workers of a Dask scheduler, which hands a case on when a worker dies, and gives it up after the fourth."""

    window = 1000

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client, KilledWorker
        except ImportError:
            remedy = "needs Dask: pip install 'flexdesign[cluster]'"
            raise InputError("command line", "--scheduler", address, remedy) from None
        try:
            self._client = Client(address)
        except (OSError, ValueError) as error:
            remedy = f"no scheduler answers there ({error}); give the address that dask scheduler prints"
            raise InputError("command line", "--scheduler", address, remedy) from None
        self._executor = self._client.get_executor(pure=False)
        self.died: type[Exception] = KilledWorker

    def submit(self, batch: Sequence[EvaluationRequest]) -> Future[Results]:
        """Hand over a batch."""
        future: Future[Results] = self._executor.submit(_on_a_worker, batch, foreign_code.is_forbidden())
        return future

    def alone(self, request: EvaluationRequest) -> Results:
        """Return the answer to a question that may be deadly."""
        return self.submit([request]).result()

    def lost(self, waiting: dict[Future[Results], Sequence[EvaluationRequest]]) -> list[Sequence[EvaluationRequest]]:
        """Return, and take out, the batches that were lost with another."""
        return []  # a batch dies by itself

    def close(self) -> None:
        """End the work."""
        self._executor.shutdown(wait=False)
        self._client.close()


def _on_a_worker(batch: Sequence[EvaluationRequest], without_code: bool) -> Results:
    """Return the answers of a batch; a worker does not inherit the environment in which code was forbidden."""
    with threadpool_limits(1), foreign_code.forbidden(without_code):
        return evaluate_all(batch)
