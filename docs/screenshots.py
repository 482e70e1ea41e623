"""Take the README's screenshots of the dashboard on the sample campaign: ``python docs/screenshots.py``."""

import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from selenium import webdriver
from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

DOCS = Path(__file__).resolve().parent
_FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage"),
)
_PAGES = {  # the height that shows a page, the button that begins what it shows, the words that end it
    "data": (1500, None, "CAE model"),
    "train": (1000, None, "Start"),
    "compare": (1750, "Predict test", "Pulse metrics"),
    "study": (1100, "Leave out each", "Rating of each test"),
    "predict": (1700, "Predict", "Pulse metrics"),
}


def main() -> None:
    """Start a dashboard with an empty cache, visit each page, and save it as ``docs/<page>.png``."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with tempfile.TemporaryDirectory() as scratch:
        environment = {**os.environ, "CRASHFUSE_CACHE": f"{scratch}/cache", "STREAMLIT_SERVER_HEADLESS": "true"}
        command = [sys.executable, "-m", "crashfuse", "app", "--port", str(port), "--campaign", "sample_data"]
        with subprocess.Popen(command, cwd=DOCS.parent, env=environment, stdout=subprocess.DEVNULL) as server:
            try:
                time.sleep(5)
                _visit(f"http://127.0.0.1:{port}", scratch)
            finally:
                server.terminate()


def _visit(address: str, scratch: str) -> None:
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    for flag in (*_FLAGS, f"--user-data-dir={scratch}/profile"):
        options.add_argument(flag)
    browser = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    waiting = WebDriverWait(browser, 500, ignored_exceptions=[StaleElementReferenceException])
    for page, (height, button, words) in _PAGES.items():
        browser.set_window_size(1440, height)
        browser.get(f"{address}/{page}?held_out=T09+%C2%B7+35.1+mph")
        if button:
            waiting.until(lambda b, label=button: _press(b, label))
        waiting.until(lambda b, shown=words: shown in b.find_element(By.CSS_SELECTOR, '[data-testid="stMain"]').text)
        time.sleep(4)  # figures fade in
        browser.save_screenshot(str(DOCS / f"{page}.png"))
    browser.quit()


def _press(browser: webdriver.Chrome, label: str) -> bool:
    for button in browser.find_elements(By.CSS_SELECTOR, '[data-testid="stMain"] button'):
        if label in button.text and button.is_enabled():
            button.click()
            return True
    return False


if __name__ == "__main__":
    main()
