"""Sentences of one kind in one file, ``data/golden/<kind>.txt``, which a person reads when it changes."""

import os
from collections.abc import Iterable

from tests.conftest import DATA


def assert_golden(kind: str, sentences: Iterable[str]) -> None:
    """Compare sentences with the file; ``CRASHFUSE_REWRITE_GOLDEN=1`` writes it instead."""
    path, text = DATA / "golden" / f"{kind}.txt", "\n".join(sentences) + "\n"
    if os.environ.get("CRASHFUSE_REWRITE_GOLDEN"):
        path.write_text(text, encoding="utf-8")
    assert text == path.read_text(encoding="utf-8")
