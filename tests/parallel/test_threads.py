"""Work on threads: in order, on several, and inside of each other."""

from __future__ import annotations

import threading

import pytest

from gpusim.parallel.threads import ahead, shared


@pytest.mark.parametrize("share", [shared, ahead])
def test_results_come_in_order_from_several_threads(
    monkeypatch: pytest.MonkeyPatch, share: object
) -> None:
    monkeypatch.setattr("gpusim.parallel.threads.processors", lambda: 2)
    both = threading.Barrier(2, timeout=20)

    def work(item: int) -> tuple[int, str]:
        both.wait()  # one thread alone would wait for ever
        return item * item, threading.current_thread().name

    found = list(share(work, [3, 1]))  # type: ignore[operator]
    assert [value for value, _ in found] == [9, 1]
    assert len({name for _, name in found}) == 2


def test_shared_work_may_share_its_own() -> None:
    """With all threads waiting for work that they themselves would have to do, it would hang."""

    def outer(item: int) -> list[int]:
        return shared(lambda more: item + more, [10, 20, 30])

    done: list[list[list[int]]] = []
    thread = threading.Thread(target=lambda: done.append(shared(outer, range(8))), daemon=True)
    thread.start()
    thread.join(20.0)
    assert done == [[[i + 10, i + 20, i + 30] for i in range(8)]]
