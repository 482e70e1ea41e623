"""Tabs of a page: a row of names, of which only the open one is computed."""

from collections.abc import Callable, Mapping
from typing import TypeVar

from crashfuse.ui.figures import choose

T = TypeVar("T")


def show_tabs(tabs: Mapping[str, Callable[[T], None]], subject: T, key: str) -> None:
    """Let the user choose a tab by its label, the first by default, and show it alone; ``key`` holds the choice."""
    tabs[choose("Tab", list(tabs), key=key)](subject)
