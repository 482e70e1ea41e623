"""A newcomer's first minutes: ``python benchmarks/first_run.py`` (needs Chromium).

With an empty cache: the time from opening the address to the page that introduces the tool, and from the click that
loads the sample to a rated comparison of every approach, using the buttons that the pages offer.
"""

import tempfile
import time

from dashboard import browser, press, served, settled, wait_for
from selenium.webdriver.common.by import By


def main() -> None:
    """Follow this route and print the times."""
    with tempfile.TemporaryDirectory() as cache, served(CRASHFUSE_CACHE=cache) as dashboard, browser() as newcomer:
        start = time.perf_counter()
        newcomer.get(dashboard.address)
        shown = settled(newcomer, "crashfuse")
        press(newcomer, "Load the sample campaign")
        clicked = time.perf_counter()
        loaded = settled(newcomer, "Sample")
        newcomer.find_element(By.PARTIAL_LINK_TEXT, "Next: predict test").click()
        press(newcomer, "Predict test")
        wait_for(newcomer, "Pulse metrics")
        rated = settled(newcomer, "Compare", rated=True)
        print(f"First page: {shown - start:.1f} s. From the click on: the sample shown after {loaded - clicked:.1f} s,")
        print(f"a rated comparison of all approaches after {rated - clicked:.1f} s.")
        print(f"Tracebacks in the log: {dashboard.log.count('Traceback')}.")


if __name__ == "__main__":
    main()
