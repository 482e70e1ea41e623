"""Take the README's screenshots of the dashboard on the sample campaign: ``python docs/screenshots.py``.

Every page in the light theme, and Compare in the dark one too. With an empty cache everything is computed first.
"""

import shutil
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

from selenium import webdriver
from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.chrome.webdriver import WebDriver
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

DOCS = Path(__file__).resolve().parent
_VIEW = "campaign=sample&test=T09"
_FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage", "--hide-scrollbars"),
)
_SHOTS = {  # page, height that shows it, theme, button that starts the computation, text that marks its end
    "data": ("data", 1000, "light", None, "CAE model"),
    "train": ("train", 870, "light", "Train without", "Rated, "),
    "compare": ("compare", 1200, "light", "Predict test", "T09 left out:"),
    "study": ("study", 1240, "light", "Leave out each", "Use the"),
    "predict": ("predict", 1280, "light", "Predict", "Use the"),
    "certify": ("certify", 1100, "light", "Certify", "Validated domain"),
    "compare-dark": ("compare", 1200, "dark", None, "T09 left out:"),
}
_LONGEST_S = 1200.0


def main() -> None:
    """Start a dashboard, visit each page, and save it as ``docs/<name>.png``."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"http://127.0.0.1:{probe.getsockname()[1]}"
    command = [sys.executable, "-m", "streamlit", "run", "app.py", "--server.headless", "true"]
    command += ["--server.port", address.rpartition(":")[2]]
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as scratch,
        subprocess.Popen(command, cwd=DOCS.parent, stdout=subprocess.DEVNULL) as server,
    ):
        try:
            _wait_until_up(address)
            _visit(address, scratch)
        finally:
            server.terminate()


def _visit(address: str, scratch: str) -> None:
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    for flag in (*_FLAGS, f"--user-data-dir={scratch}/profile"):
        options.add_argument(flag)
    browser = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    try:
        for name, (page, height, theme, button, words) in _SHOTS.items():
            feature = {"name": "prefers-color-scheme", "value": theme}
            browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})
            size = {"width": 1440, "height": height, "deviceScaleFactor": 1, "mobile": False}
            browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
            browser.get(f"{address}/{page}{'&' if '?' in page else '?'}{_VIEW}")
            _compute(browser, button, words)
            time.sleep(4)  # until the figures have faded in
            browser.save_screenshot(str(DOCS / f"{name}.png"))
            print(f"docs/{name}.png", flush=True)
    finally:
        browser.quit()


def _compute(browser: WebDriver, button: str | None, words: str) -> None:
    """Press the button that starts the computation, unless it was done before, and wait for its end."""
    waiting = WebDriverWait(browser, _LONGEST_S, ignored_exceptions=[StaleElementReferenceException])
    pressed = False

    def shown(_: WebDriver) -> bool:
        nonlocal pressed
        text = browser.find_element(By.CSS_SELECTOR, '[data-testid="stMain"]').text
        if words in text and "still training" not in text:
            return True
        for element in browser.find_elements(By.CSS_SELECTOR, '[data-testid="stMain"] button') if not pressed else ():
            if button and button in element.text and element.is_enabled():
                element.click()
                pressed = True
                break
        return False

    waiting.until(shown)


def _wait_until_up(address: str) -> None:
    for _ in range(600):
        try:
            with urllib.request.urlopen(f"{address}/_stcore/health", timeout=5):  # noqa: S310 - it is ours
                return
        except OSError:
            time.sleep(0.1)
    raise SystemExit("The server did not start.")


if __name__ == "__main__":
    main()
