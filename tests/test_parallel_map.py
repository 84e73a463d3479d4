"""A map shared among threads: what a plain one gives, also within itself, and no thread that idles beside work."""

import threading

import pytest

from flexdesign.core.parallel_map import shared_pool

#: Longer than any of these takes; what waits so long waits for ever.
FOR_EVER = 30.0


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_a_shared_map_is_a_map(threads: int) -> None:
    with shared_pool(threads) as each:
        assert each(lambda x: x * x, range(20)) == [x * x for x in range(20)]
        assert each(lambda x: x, []) == []


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_within_itself_it_is_a_map_too(threads: int) -> None:
    with shared_pool(threads) as each:
        found = each(lambda x: sum(each(lambda y: x * y, range(5))), range(20))
    assert found == [10 * x for x in range(20)]


def test_nobody_waits_for_who_cannot_begin() -> None:
    meetings = [threading.Barrier(2, timeout=FOR_EVER) for _ in range(2)]

    def work(depth: int, asked: threading.Thread) -> None:
        if depth == len(meetings):
            return
        meetings[depth].wait()
        if threading.current_thread() is not asked:
            # Comes in once who asked has ended, and waits: its place is free, but no thread of the pool.
            with each.idle:
                me = threading.current_thread()
            each(lambda _: work(depth + 1, me), range(2))

    asking = threading.current_thread()
    with shared_pool(2) as each:
        each(lambda _: work(0, asking), range(2))  # would never return


def test_so_many_threads_work_at_a_time() -> None:
    meeting = threading.Barrier(3, timeout=FOR_EVER)
    with shared_pool(3) as each:
        each(lambda _: meeting.wait(), range(6))  # passes only where three wait at once
    with shared_pool(3) as each:
        busy, most, lock = 0, 0, threading.Lock()

        def count(_: int) -> None:
            nonlocal busy, most
            with lock:
                busy, most = busy + 1, max(most, busy + 1)
            threading.Event().wait(0.002)
            with lock:
                busy -= 1

        each(lambda _: each(count, range(8)), range(8))
    assert most == 3


def test_who_has_ended_helps_who_has_not() -> None:
    ended, meeting = threading.Event(), threading.Barrier(2, timeout=FOR_EVER)

    def has_met() -> bool:
        inner = threading.Barrier(2, timeout=0.2)  # passes only where two wait at once
        try:
            each(lambda _: inner.wait(), range(2))
        except threading.BrokenBarrierError:
            return False
        return True

    def work(item: int) -> None:
        if item == 0:
            ended.set()
            return
        assert ended.wait(FOR_EVER)
        while not has_met():  # until the other thread has ended its own work
            pass

    with shared_pool(2) as each:
        each(lambda _: meeting.wait(), range(2))
        each(work, range(2))


def test_an_error_ends_it_and_is_told() -> None:
    begun = list[int]()

    def fail(item: int) -> None:
        begun.append(item)
        if item == 3:
            raise ValueError("three")

    for threads in (1, 2):
        begun.clear()
        with shared_pool(threads) as each, pytest.raises(ValueError, match="three"):
            each(fail, range(1000))
        assert threads > 1 or begun == [0, 1, 2, 3]
        with shared_pool(threads) as each:  # and the next map works
            with pytest.raises(ValueError, match="three"):
                each(fail, range(1000))
            assert each(abs, [-1, -2]) == [1, 2]
