"""What the tests of the displacement domain share."""

from collections.abc import Iterator

import pytest
from threadpoolctl import threadpool_limits


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """Small matrices: more threads would only get in each other's way."""
    with threadpool_limits(1, user_api="blas"):
        yield
