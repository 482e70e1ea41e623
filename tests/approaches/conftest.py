"""What the tests of the approaches share."""

from collections.abc import Iterator

import pytest
from threadpoolctl import threadpool_limits


@pytest.fixture
def one_thread() -> Iterator[None]:
    """Small matrices: more threads would only get in each other's way."""
    with threadpool_limits(1):
        yield
