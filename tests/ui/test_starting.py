"""The first seconds of a server."""

import gc
import threading

import pytest

from crashfuse.ui import starting
from tests.test_imports import loaded


def test_the_server_starts_before_anything_slow_is_imported() -> None:
    """Neither PyTorch nor SciPy, scikit-learn or pandas: they are imported while the first page's frame is painted."""
    (found,) = loaded("import sys, crashfuse.ui.server, crashfuse.ui.launch; print(*sys.modules)")
    assert found
    assert not {"torch", "scipy", "sklearn", "pandas"} & found


def test_nobody_looks_for_garbage_in_what_was_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    """That took 0.2 s of every dozenth answer."""
    for name, value in {"_imported": None, "_SLOW": (), "_NEXT": "json"}.items():
        monkeypatch.setattr(starting, name, value)
    starting.start_importing().result()
    for thread in threading.enumerate():
        if thread.name == "crashfuse-imports":
            thread.join()
    try:
        assert gc.get_freeze_count() > 10_000
    finally:
        gc.unfreeze()
