"""One thread in BLAS around batches of small products, whoever asks and in whatever order."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.parallel import blas_threads
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.parallel.processes import in_copies
from tests.support.measure_images import Waves
from tests.support.two_blas_threads import two_blas_threads

CONTROLLER = blas_threads._controller()


def numbers() -> list[int]:
    return [one["num_threads"] for one in CONTROLLER.info() if one["user_api"] == "blas"]


@pytest.fixture(autouse=True)
def two_threads() -> Iterator[None]:
    with two_blas_threads():
        yield


def test_users_inside_of_each_other_and_of_other_threads() -> None:
    before = numbers()
    seen: list[list[int]] = []
    inside, leave = threading.Event(), threading.Event()

    def other() -> None:
        with one_blas_thread():
            inside.set()
            leave.wait(10)
            seen.append(numbers())

    thread = threading.Thread(target=other)
    with one_blas_thread(), one_blas_thread():
        thread.start()
        assert inside.wait(10)
        seen.append(numbers())
    leave.set()
    thread.join()
    assert seen == [[1] * len(before)] * 2
    assert numbers() == before
    assert max(before) == 2


def test_a_copy_of_the_process_can_use_it() -> None:
    def work(number: int) -> list[int]:
        with one_blas_thread():
            return numbers()

    with one_blas_thread():
        assert in_copies(work, 2) == [[1] * len(numbers())] * 2


def test_it_is_cheap() -> None:
    with one_blas_thread():
        pass
    started = time.process_time()
    for _ in range(100):
        with one_blas_thread():
            pass
    assert time.process_time() - started <= 0.2


@pytest.mark.parametrize("what", ["dic", "strain", "render"])
def test_batches_run_in_one_thread(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int] = []

    def spied(name: str) -> None:
        function = getattr(np, name)

        def call(*args: Any, **kwargs: Any) -> Any:
            seen.extend(numbers())
            return function(*args, **kwargs)

        monkeypatch.setattr(np, name, call)

    image = Waves(2).at(*np.indices((41, 57), dtype=np.float64))
    result = gs.measure.dic(image, image, subset=15, step=4)
    camera = gs.Camera(57, 33, K=[[50, 0, 28], [0, 50, 16], [0, 0, 1]])
    square = np.array([[-1.0, -1, 2], [1, -1, 2], [1, 1, 2], [-1, 1, 2]])
    body = gs.Surface(square, [[0, 2, 1], [0, 3, 2]], gs.paint.Plain(0.4))
    spied("einsum" if what != "render" else "concatenate")
    if what == "dic":
        gs.measure.dic(image, image, subset=15, step=9)
    elif what == "strain":
        gs.measure.strain(result, window=5)
    else:
        gs.render([body], camera, backend="numpy")
    assert seen
    assert set(seen) == {1}
