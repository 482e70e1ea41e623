"""The first seconds of a server."""

from tests.test_imports import loaded


def test_the_server_starts_before_anything_slow_is_imported() -> None:
    """Neither PyTorch nor SciPy, scikit-learn or pandas: they are imported while the first page's frame is painted."""
    (found,) = loaded("import sys, crashfuse.ui.server, crashfuse.ui.launch; print(*sys.modules)")
    assert found
    assert not {"torch", "scipy", "sklearn", "pandas"} & found
