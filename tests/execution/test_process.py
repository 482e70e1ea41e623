"""Linear algebra with one thread, as long as anyone wants it; freed memory goes back to the system."""

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from crashfuse.execution import process
from crashfuse.execution.process import one_thread, one_thread_throughout


def test_memory_can_be_given_back_anywhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """With glibc it returns what is free; with another C library nothing is done."""
    process.give_back()
    monkeypatch.setattr(sys, "platform", "win32")
    process._glibc.cache_clear()
    process.share_one_heap()
    process.give_back()
    process._glibc.cache_clear()


def _threads() -> set[int]:
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


@pytest.mark.parametrize("limit", [one_thread, one_thread_throughout])
def test_who_leaves_first_does_not_end_it_for_others(limit: Callable[[], AbstractContextManager[None]]) -> None:
    with threadpool_limits(2, user_api="blas"):
        before, first, second = _threads(), ExitStack(), ExitStack()
        first.enter_context(limit())
        second.enter_context(limit())
        first.close()
        assert _threads() == {1}
        second.close()
        assert _threads() == before
