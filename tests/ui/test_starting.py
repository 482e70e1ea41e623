"""The first seconds of a server."""

from tests.test_imports import loaded


def test_the_server_starts_before_anything_slow_is_imported() -> None:
    """Neither PyTorch nor SciPy, scikit-learn or pandas: they are imported while the first page's frame is painted."""
    assert not {"torch", "scipy", "sklearn", "pandas"} & loaded("import crashfuse.ui.server, crashfuse.ui.launch")
