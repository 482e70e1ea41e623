"""Freed memory goes back to the system."""

import sys

import pytest

from crashfuse.execution import memory


def test_memory_can_be_given_back_anywhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """With glibc it returns what is free; with another C library nothing is done."""
    memory.give_back()
    monkeypatch.setattr(sys, "platform", "win32")
    memory._glibc.cache_clear()
    memory.share_one_heap()
    memory.give_back()
    memory._glibc.cache_clear()
