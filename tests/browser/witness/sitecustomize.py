"""Run by every Python that a dashboard of the tests starts: notes what it looks up, and lets it fail on request.

The folder ``CRASHFUSE_WITNESS`` has a file ``lookups`` once a name was looked up. While it has a file ``memory``, jobs
run out of memory where they touch the cache; while it has a file ``kills``, they take two processes, which are killed.
"""

import os
import signal
import sys
import threading
from pathlib import Path

_FOLDER, _CACHE = Path(os.environ["CRASHFUSE_WITNESS"]), os.environ["CRASHFUSE_CACHE"]
_LOOPBACK = (None, "127.0.0.1", b"127.0.0.1", "localhost", b"localhost")
_CORES = os.environ.get("LOKY_MAX_CPU_COUNT", str(os.cpu_count()))
_IS_WORKER = any("popen_loky" in part for part in sys.orig_argv)


def _watch(event: str, about: tuple[object, ...]) -> None:
    """Hear of whatever this process does (PEP 578)."""
    if event == "socket.getaddrinfo" and about[0] not in _LOOPBACK:
        (_FOLDER / "lookups").write_text(repr(about), encoding="utf-8")
    elif event == "open" and str(about[0]).startswith(_CACHE):
        if _IS_WORKER and (_FOLDER / "kills").exists():
            os.kill(os.getpid(), signal.SIGKILL)
        if threading.current_thread().name == "crashfuse-jobs":
            if (_FOLDER / "memory").exists():
                raise MemoryError
            os.environ["LOKY_MAX_CPU_COUNT"] = "2" if (_FOLDER / "kills").exists() else _CORES


sys.addaudithook(_watch)
