"""The first seconds of a server."""

import subprocess
import sys


def test_the_server_starts_before_anything_slow_is_imported() -> None:
    """Neither PyTorch nor SciPy, scikit-learn or pandas: they are imported while the first page's frame is painted."""
    modules = "sys, crashfuse.ui.server, crashfuse.ui.launch"
    program = f"import {modules}; print({{'torch', 'scipy', 'sklearn', 'pandas'}} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert done.stdout.strip() == "set()"
