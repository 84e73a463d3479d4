"""A parallel map that may be nested: the calling thread works, too, and idle threads help.

With a pool alone the calling thread sleeps, and is woken for every few milliseconds of work; and if several fits run at
the same time, the last one runs alone. Here a fit that runs in the map may itself call the map, and idle threads help.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from threading import Semaphore
from typing import TypeVar

Of = TypeVar("Of")
Made = TypeVar("Made")


class ParallelMap:
    """A `map` over several threads that keeps the order, may be nested, and returns a list.

    Parameters
    ----------
    pool
        The pool, of `threads` threads.
    threads
        Number of threads that work at a time, with that of the caller.
    """

    def __init__(self, pool: ThreadPoolExecutor, threads: int) -> None:
        self.pool, self.idle = pool, Semaphore(threads - 1)

    def __call__(self, function: Callable[[Of], Made], items: Iterable[Of]) -> list[Made]:
        """Return the results for all items; the calling thread works, and idle threads help."""
        given = list(items)
        made, places = dict[int, Made](), iter(range(len(given)))

        def work() -> None:
            try:
                for place in places:  # one iterator for all: each takes the next
                    made[place] = function(given[place])
            finally:  # after an error nobody begins anything more
                deque(places, maxlen=0)

        def help_out() -> None:
            try:
                work()
            finally:
                self.idle.release()

        helping = list[Future[None]]()
        while len(helping) < len(given) - 1 and self.idle.acquire(blocking=False):
            helping.append(self.pool.submit(help_out))
        try:
            work()
        finally:
            helped = self._wait_for(helping)
        for each in helped:
            each.result()
        return [made[place] for place in range(len(given))]

    def _wait_for(self, helping: list[Future[None]]) -> list[Future[None]]:
        """Wait for the helpers that have begun, and return them; meanwhile another thread may take this one's place.

        Helpers that have not begun are cancelled, as no work is left. To wait for one could be a deadlock: a thread of
        the pool may itself wait for this one.
        """
        begun = [each for each in helping if not each.cancel()]
        for _ in range(len(helping) - len(begun)):
            self.idle.release()
        if any(not each.done() for each in begun):
            self.idle.release()
            wait(begun)
            self.idle.acquire()
        return begun


@contextmanager
def shared_pool(threads: int) -> Iterator[ParallelMap]:
    """Yield a map that runs in a number of threads, at least one."""
    pool = ThreadPoolExecutor(threads)
    try:
        yield ParallelMap(pool, threads)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
