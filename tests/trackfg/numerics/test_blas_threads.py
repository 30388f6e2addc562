from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest
from threadpoolctl import ThreadpoolController, threadpool_limits

from trackfg.numerics.blas_threads import one_thread


def threads() -> set[int]:
    """The numbers of threads of the loaded BLAS libraries."""
    return {library["num_threads"] for library in ThreadpoolController().select(user_api="blas").info()}


@pytest.fixture(autouse=True)
def two_threads() -> Iterator[None]:
    with threadpool_limits(2, user_api="blas"):
        yield


def test_one_thread_inside_and_as_before_outside() -> None:
    assert threads() == {2}
    with one_thread():
        with one_thread():
            assert threads() == {1}
        assert threads() == {1}
    assert threads() == {2}


def test_threads_that_overlap_leave_the_number_as_it_was() -> None:
    """The first to come leaves first."""
    entered, left = threading.Event(), threading.Event()
    inside: set[int] = set()

    def second() -> None:
        with one_thread():
            inside.update(threads())
            entered.set()
            left.wait(10.0)

    other = threading.Thread(target=second)
    with one_thread():
        other.start()
        assert entered.wait(10.0)
    left.set()
    other.join()
    assert inside == {1}
    assert threads() == {2}
