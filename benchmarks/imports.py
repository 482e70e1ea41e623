"""What a script waits for before it does anything: ``python benchmarks/imports.py``.

Each statement runs in a fresh process under ``python -X importtime``, three times; the fastest counts. Printed are the
seconds that its imports take, how many modules it loads, and which of the heavy packages are among them.
"""

import re
import subprocess
import sys

HEAVY = ("numpy", "scipy", "pandas", "sklearn", "pyarrow", "torch", "plotly", "streamlit")
STATEMENTS = {
    "import crashfuse": "import crashfuse",
    "rate two pulses": "from crashfuse import rate_iso18571",
    "load a campaign": "from crashfuse import load_campaign",
    "predict": "from crashfuse import predict",
    "run a study": "from crashfuse import run_study",
}
_ROUNDS = 3
_LINE = re.compile(r"import time:\s+(?P<own_us>\d+) \|\s+\d+ \|\s+(?P<module>\S+)")


def main() -> None:
    """Print a line for each statement."""
    bare = min(imported("pass") for _ in range(_ROUNDS))[0]
    for name, statement in STATEMENTS.items():
        seconds, modules = min(imported(statement) for _ in range(_ROUNDS))
        heavy = [package for package in HEAVY if package in modules]
        print(f"{name:18} {seconds - bare:6.3f} s  {len(modules):5} modules  {', '.join(heavy) or 'none of the heavy'}")


def imported(statement: str) -> tuple[float, list[str]]:
    """Seconds that the imports of a statement take in a fresh process, and the modules."""
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-c", statement], check=True, capture_output=True, text=True
    )
    lines = list(_LINE.finditer(done.stderr))
    return sum(int(line["own_us"]) for line in lines) / 1e6, sorted(line["module"] for line in lines)


if __name__ == "__main__":
    main()
