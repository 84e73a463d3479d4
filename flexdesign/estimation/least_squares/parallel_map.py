"""Simulations shared among threads: who asks for some of them makes them, too, and who has nothing to do helps.

A pool alone lets the asking thread sleep, and wakes it for every few milliseconds of work; and where several fits run
at the same time, the last one runs alone. Here a fit may ask within a fit, and gets what threads are idle.
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
    """A `map` in order for several threads, which may be called from what it calls; it returns a list.

    Parameters
    ----------
    pool
        As many threads.
    threads
        How many work at a time, that of the caller among them.
    """

    def __init__(self, pool: ThreadPoolExecutor, threads: int) -> None:
        self.pool, self.idle = pool, Semaphore(threads - 1)

    def __call__(self, function: Callable[[Of], Made], items: Iterable[Of]) -> list[Made]:
        """Return what the function makes of each; the caller works, and threads that are idle now help."""
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
        """Wait for others to end what they began, and return them; the place of this thread is meanwhile free.

        For one that has not begun there is nothing left to do. To wait for it might be to wait for ever: for a thread
        of the pool that itself waits for this one.
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
