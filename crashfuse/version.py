"""The version, in one place; and those of all else that determines the numbers."""

import platform
from collections.abc import Mapping
from functools import cache
from importlib import metadata

__version__ = "0.1.0"

COMPUTING = ("numpy", "scipy", "scikit-learn", "torch")
"""The packages that compute: another version of one of them may change a result."""


@cache
def versions() -> Mapping[str, str]:
    """Versions of everything that determines the numbers, by name: Python's, ours and those that compute."""
    python = ".".join(platform.python_version_tuple()[:2])
    return {"Python": python, "crashfuse": __version__, **{name: metadata.version(name) for name in COMPUTING}}
