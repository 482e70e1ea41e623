"""No test of the import waits for the disk."""

import pytest


@pytest.fixture(autouse=True)
def no_wait_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a machine that loses its power would lose, no test looks for: it is a third of the time of an import."""
    monkeypatch.setattr("os.fsync", lambda _: None)
