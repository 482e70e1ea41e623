"""Memory that has been freed but that the C library keeps: up to a third of a process that trains networks.

glibc has a heap for each thread that allocates, and hands what is free in them back late or never. Other C libraries
keep less, and nothing is done there.
"""

import ctypes
import sys
from functools import cache

_ARENA_MAX = -8  # parameter of mallopt, in <malloc.h>


@cache
def _glibc() -> ctypes.CDLL | None:
    library = ctypes.CDLL(None) if sys.platform == "linux" else None
    return library if library is not None and hasattr(library, "malloc_trim") else None


def share_one_heap() -> None:
    """Let all further threads of this process allocate from the first one's heap; for the process as a whole."""
    if (library := _glibc()) is not None:
        library.mallopt(_ARENA_MAX, 1)


def give_back() -> None:
    """Return what is free to the system, in some milliseconds."""
    if (library := _glibc()) is not None:
        library.malloc_trim(0)
