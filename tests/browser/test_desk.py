"""Safe on any desk: other sites, other people, and servers that ask who someone is."""

import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from crashfuse.files.archive import zipped
from tests.browser.conftest import SIDEBAR, TABLE, Server, User, serve
from tests.browser.identity_provider import CLIENT, SECRET, identity_provider
from tests.campaign_folder.test_uploads import spoil
from tests.conftest import content_of

_KNOCK = """
const socket = new WebSocket(arguments[0] + "/_stcore/stream", ["streamlit"]);
socket.onopen = () => arguments[1]("open");
socket.onerror = () => arguments[1]("refused");
"""


_RESULTS = "return document.querySelector('[data-testid=\"stDataFrame\"]')?.textContent ?? ''"


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the base class's name
        """Nothing is logged."""


@contextmanager
def another_site(folder: Path, page: str) -> Iterator[str]:
    """A page under another origin; gives its address."""
    (folder / "index.html").write_text(page, encoding="utf-8")
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(folder))) as site:
        threading.Thread(target=site.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{site.server_address[1]}/"
        site.shutdown()


def test_another_site_embeds_nothing_and_an_upload_is_seen_by_its_owner_and_whoever_has_the_link(
    small_server: Server, user: User, campaign_on_disk: Path, tmp_path: Path
) -> None:
    """Its frame stays empty; by itself the same address shows the page, under another name a sentence and no page.

    Files spoilt in eight ways are eight rows, which say which file; after that the good zip takes its place.

    After Escape or a reload it is still theirs, with what was computed of it; another browser lists neither.
    """
    user.browser.get(small_server.address.replace("127.0.0.1", "evil.localhost") + "/data")  # which resolves to it, too
    user.sees("crashfuse does not answer under this name.", "body")
    assert user.browser.execute_async_script(_KNOCK, small_server.address.replace("http", "ws")) == "refused"
    assert not (small_server.witness / "lookups").exists()
    user.browser.get_log("performance")  # type: ignore[no-untyped-call] # no foreign host
    frame = f'<iframe src="{small_server.address}/data" width="900" height="700"></iframe>'
    with another_site(tmp_path, frame) as site:
        user.browser.get(site)
        user.browser.switch_to.frame(user.find("iframe"))
        user.wait(lambda: user.browser.execute_script("return document.readyState") == "complete")
        assert user.browser.find_elements(By.CSS_SELECTOR, "#root") == []
        user.browser.switch_to.default_content()
    user.open(small_server, "data")
    user.find("#root")
    folder = shutil.copytree(campaign_on_disk, tmp_path / "car")
    told = spoil(folder)
    spoilt = tmp_path / "spoilt.zip"
    spoilt.write_bytes(zipped(content_of(folder)))

    def upload(file: Path) -> None:
        user.open(small_server, "data")
        user.press("Open another campaign")
        user.uploads(file)
        user.press("Open upload")

    def listed() -> str:
        user.press("", f'{SIDEBAR} [data-testid="stSelectbox"] input')
        return " ".join(user.wait(lambda: user.texts('[role="option"]')))

    dropped = tmp_path / "secret-car.zip"
    files = {**content_of(campaign_on_disk), "campaign.toml": b'unused = ["T4"]'}  # other data than all can see
    dropped.write_bytes(zipped({f"secret-car/{path}": file for path, file in files.items()}))
    upload(spoilt)
    user.sees(f"cannot be used: {len(told)} problems")
    problems = user.find(TABLE, "What to do")
    assert "T2.csv" in problems.text
    assert len(problems.find_elements(By.CSS_SELECTOR, "tbody tr")) == len(told)
    upload(dropped)
    user.sees("secret-car", "h1")
    link = user.browser.current_url
    listed()
    user.browser.switch_to.active_element.send_keys(Keys.ESCAPE)  # which keeps what is open
    user.go("Train")
    assert "campaign=secret-car" in user.browser.current_url
    user.open(small_server, "data")
    assert "secret-car (upload" in listed()
    name = dict(parse_qsl(urlsplit(link).query))["campaign"]
    user.open(small_server, "study", campaign=name, approaches="cae", seed="5")
    user.press("Leave out each of 3 tests")
    user.sees("Mean over the tests")
    user.wait(lambda: not user.all("button", "Cancel"))  # of parts, too, there is a mean
    user.open(small_server, "study", campaign=name, study_tab="Past results")
    user.wait(lambda: "study of 3 tests" in user.browser.execute_script(_RESULTS), "Nothing listed it.", 20)

    user.becomes_another()
    user.open(small_server, "data")
    user.sees("CAE runs")
    assert "secret-car" not in listed()
    user.browser.get(link)
    user.sees("secret-car", "h1")


def test_a_server_with_a_log_in_shows_nothing_before(user: User, campaign_on_disk: Path, tmp_path: Path) -> None:
    """No name of a campaign; then the page of the link with its choices, who it is, and the same after a reload."""
    secrets = tmp_path / "secrets.toml"
    log = tmp_path / "log"
    with identity_provider() as metadata:
        secrets.write_text(
            '[auth]\nredirect_uri = "http://127.0.0.1:{port}/oauth2callback"\n'
            f'cookie_secret = "{"0123456789" * 4}"\nclient_id = "{CLIENT}"\nclient_secret = "{SECRET}"\n'
            f'server_metadata_url = "{metadata}"\n',
            encoding="utf-8",
        )
        asked = ["--campaign", str(campaign_on_disk), "--login", str(secrets), "--log", str(log)]
        asked += ["--root", str(campaign_on_disk)]
        view = {
            "campaign": campaign_on_disk.name,
            "test": "T1",
            "train_tab": "Diagnostics",
            "seed": "3",
            "approaches": "cae",
        }
        with serve(tmp_path, None, *asked) as server:
            user.open(server, "train", **view)
            user.find("button", "Log in")
            assert campaign_on_disk.name not in user.browser.page_source.replace(user.browser.current_url, "")
            assert not user.all('[data-testid="stSelectbox"]')
            user.press("Log in")
            user.press("anna@example.com", "a")
            user.sees("anna@example.com", SIDEBAR)
            user.sees("of what was learned without")
            asked_for = urlsplit(user.browser.current_url)
            assert (asked_for.path, dict(parse_qsl(asked_for.query))) == ("/train", view)
            user.browser.refresh()
            user.sees("anna@example.com", SIDEBAR)
            user.open(server, "data")
            user.press("Open another campaign")
            user.fill("A folder or file on this computer", str(tmp_path))
            user.press("Open folder")
            user.sees("cannot be used")
            user.press("Log out")
            user.find("button", "Log in")
            assert not user.all('[data-testid="stSelectbox"]')
            user.press("Log in")
            user.press("ben@example.com", "a")
            user.sees("ben@example.com", SIDEBAR)
    told = log.read_text(encoding="utf-8")
    assert "anna@example.com: began a session" in told
    assert f"anna@example.com: was refused {tmp_path}" in told
    assert "anna@example.com: logged out" in told
