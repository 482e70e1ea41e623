"""A newcomer's first minutes: ``python benchmarks/first_run.py`` (needs Chromium).

With an empty cache: the time from opening the address to the page that introduces the tool, and from the click that
loads the sample to a rated comparison by the displacement domain and by every approach, using the buttons that the
pages offer.
"""

import tempfile
import time
from pathlib import Path

from dashboard import ROOT, browser, press, served, settled

_RATED_BY = {
    "rated by the displacement domain": ("CAE", "Displacement domain"),
    "rated by all approaches": ("CAE", "Displacement domain", "LF TCN", "Time domain", "Fused"),
}
STAGES = ("first page", "sample shown", *_RATED_BY)


def main() -> None:
    """Follow this route and print the times."""
    shown, *stages = first_minutes(ROOT).values()
    after = ", ".join(f"{stage} after {seconds:.1f} s" for stage, seconds in zip(STAGES[1:], stages, strict=True))
    print(f"First page: {shown:.1f} s. From the click on the sample on: {after}.")


def first_minutes(root: Path) -> dict[str, float]:
    """Seconds by stage in the dashboard of a checkout: to the first page, then each from the click on the sample on."""
    seconds = {}
    with (
        tempfile.TemporaryDirectory() as cache,
        served(root, CRASHFUSE_CACHE=cache) as dashboard,
        browser() as newcomer,
    ):
        start = time.perf_counter()
        newcomer.get(dashboard.address)
        seconds["first page"] = settled(newcomer, "crashfuse") - start
        press(newcomer, "Load the sample campaign")
        clicked = time.perf_counter()
        seconds["sample shown"] = settled(newcomer, "Sample") - clicked
        press(newcomer, "Next: predict test")
        for stage, labels in _RATED_BY.items():
            seconds[stage] = settled(newcomer, "Compare", rated=labels) - clicked
        if "Traceback" in dashboard.log:
            raise SystemExit(dashboard.log)
    return seconds


if __name__ == "__main__":
    main()
