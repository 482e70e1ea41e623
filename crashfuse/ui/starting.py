"""The first seconds of a server: a frame is painted at once, and what takes long to import is imported meanwhile.

This module itself imports nothing that takes long.
"""

import gc
import sys
import threading
from concurrent.futures import Future
from importlib import import_module

import streamlit as st

from crashfuse.ui.navigation import navigate

_SLOW = (  # what the pages need; most of the time is that of SciPy, Plotly and pandas
    "crashfuse.ui.frame",
    "crashfuse.reporting.report",
    "crashfuse.ui.explanations",
    "crashfuse.ui.opening",
    "pandas.io.formats.style",
    "streamlit.elements.plotly_chart",
)
_NEXT = "torch"  # what a first prediction needs: it takes as long again
_PREDICTS = "crashfuse.study.estimate"
_SWITCH_S = 5e-4  # while importing: the server's own threads wait for the interpreter a tenth of the usual time

_lock = threading.Lock()
_imported: Future[None] | None = None


def start_importing() -> Future[None]:
    """Import what the pages need in the background, once; the future is done when all is there."""
    global _imported
    with _lock:
        if _imported is None:
            _imported = Future()
            threading.Thread(target=_import, args=(_imported,), name="crashfuse-imports", daemon=True).start()
        return _imported


def _import(done: Future[None]) -> None:
    usual = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH_S)
    try:
        for name in _SLOW:
            import_module(name)
    except BaseException as error:  # the page that waits raises it
        done.set_exception(error)
    else:
        done.set_result(None)
        import_module(_NEXT)
    finally:
        sys.setswitchinterval(usual)
    from crashfuse.execution.code_digest import code_digest
    from crashfuse.ui.uploads import sweep

    sweep()
    code_digest(_PREDICTS)  # while the first page is read: the first prediction of a new version need not wait
    gc.freeze()  # what was imported is never garbage: to look for some in it took 0.2 s every dozen answers


def run() -> None:
    """Set up the window and run the page given in the address, once everything it needs is imported."""
    page = navigate()
    imported = start_importing()
    if not imported.done():
        st.title(page.title)
        st.markdown(":material/hourglass_top: Starting …")
        imported.result()  # waits
        st.rerun()
    from crashfuse.ui.frame import route

    route(page)
