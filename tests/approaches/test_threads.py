"""Torch with one thread, as long as anyone wants it."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import pytest
import torch

from crashfuse.approaches.threads import single_thread


@pytest.fixture(autouse=True)
def two_threads() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


def in_a_new_thread() -> int:
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(torch.get_num_threads).result()


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_who_leaves_first_does_not_end_it_for_others(order: tuple[int, int]) -> None:
    """Two jobs compute at once: each has one thread until it leaves; in the end all is as before, for others too."""
    with ThreadPoolExecutor(1) as one, ThreadPoolExecutor(1) as other:
        threads, contexts = (one, other), (ExitStack(), ExitStack())
        for thread in threads:
            assert thread.submit(torch.get_num_threads).result() == 2
        for thread, context in zip(threads, contexts, strict=True):
            thread.submit(context.enter_context, single_thread()).result()
        first, last = order
        threads[first].submit(contexts[first].close).result()
        assert threads[last].submit(torch.get_num_threads).result() == 1
        assert in_a_new_thread() == 1
        threads[last].submit(contexts[last].close).result()
        assert [thread.submit(torch.get_num_threads).result() for thread in threads] == [2, 2]
    assert (torch.get_num_threads(), in_a_new_thread()) == (2, 2)


def test_one_within_another_and_an_error_end_it() -> None:
    with single_thread():
        with pytest.raises(ZeroDivisionError), single_thread():
            _ = 1 // 0
        assert torch.get_num_threads() == 1
    assert (torch.get_num_threads(), in_a_new_thread()) == (2, 2)
