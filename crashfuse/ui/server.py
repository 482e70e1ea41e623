"""The dashboard's server, and its first seconds: a frame is painted at once, what takes long imported meanwhile."""

import os
import secrets
import signal
import sys
import webbrowser
from collections.abc import AsyncIterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import asynccontextmanager, suppress
from functools import cache
from importlib import import_module
from pathlib import Path

import streamlit as st
from click import Abort, echo
from starlette.datastructures import MutableHeaders
from starlette.middleware import Middleware
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose
from streamlit import net_util
from streamlit.runtime.pages_manager import PagesManager
from streamlit.web.cli import main
from streamlit.web.server.starlette.starlette_websocket import is_host_allowed

from crashfuse.errors import OUT_OF_MEMORY, CrashfuseError, out_of_memory
from crashfuse.execution.visitors import LOG, Refusals, begin_log, check_login
from crashfuse.ui.kit import visitors
from crashfuse.ui.kit.navigation import navigate
from crashfuse.ui.kit.text import plain
from crashfuse.ui.kit.visitors import BROWSER

_PACKAGE = Path(__file__).resolve().parents[1]
_PLACES = (_PACKAGE / "dashboard", _PACKAGE.parent)  # in an installed wheel, in a checkout
_HOSTS = ("localhost", "127.0.0.1")  # else a page elsewhere reaches the server under a name of its own (DNS rebinding)
_POLICY = {  # no page around this one, and nothing that this one shows, a laboratory's text say, fetches from elsewhere
    "X-Frame-Options": "DENY",
    "Content-Security-Policy": "frame-ancestors 'none'; default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'",
}
_A_YEAR_S = 365 * 24 * 3600
_ANOTHER_NAME = PlainTextResponse(
    "crashfuse does not answer under this name. If it should, start it with crashfuse app --allow-host NAME, or add "
    "the name to server.allowedHosts in .streamlit/config.toml.",
    403,
)
_NOTHING = PlainTextResponse("", 404)
_ANOTHER_ORIGIN = WebSocketClose(1008)  # against the policy; before it is open, the server answers 403
# on refusing a page of another origin, Streamlit would ask a server on the network for this machine's address
net_util._external_ip = ""
# else the first session would run a linked page without app.py
PagesManager.uses_pages_directory = False
_SLOW = (  # what the pages need; most of the time is that of SciPy, Plotly and pandas
    "crashfuse.ui.kit.frame",
    "crashfuse.results.render",
    "crashfuse.ui.data",
    "pandas.io.formats.style",
    "streamlit.elements.plotly_chart",
)


def launch(
    port: int,
    campaign: Path | None = None,
    *,
    roots: Sequence[Path] = (),
    hosts: Sequence[str] = (),
    secrets: Path | None = None,
    log: Path | None = None,
) -> None:
    """Serve the dashboard on 127.0.0.1, and under the names of a proxy (``hosts``), until interrupted.

    Pages open and write to the ``roots`` alone, if any; people log in if ``secrets`` has a section ``[auth]``.
    Raises a DataError if nobody could log in, an OSError if the log cannot be written.
    """
    if secrets is not None:
        check_login([secrets], required=True)
    if log is not None:
        log.open("a").close()
    given = {"CRASHFUSE_CACHE": os.environ.get("CRASHFUSE_CACHE"), "CRASHFUSE_CAMPAIGN": campaign, LOG: log}
    os.environ |= {name: str(Path(path).resolve()) for name, path in given.items() if path is not None}
    if roots:
        os.environ[visitors.ROOTS] = "\n".join(str(root.resolve()) for root in roots)
    options = [  # includes the security settings of config.toml, which the user's own settings can't override here
        ("server.address", "127.0.0.1"),
        ("server.port", port),
        ("server.showEmailPrompt", "false"),
        ("server.enableXsrfProtection", "true"),
        ("server.enableCORS", "true"),
        ("server.enableAgentApi", "false"),
        ("browser.gatherUsageStats", "false"),
        ("client.showErrorDetails", "none"),
        ("client.showSidebarNavigation", "false"),
        ("logger.hideWelcomeMessage", "true"),
        *(("server.allowedHosts", host) for host in (*_HOSTS, *hosts)),
    ]
    if secrets is not None:
        options.append(("secrets.files", secrets.resolve()))
    os.chdir(next(place for place in _PLACES if (place / "app.py").is_file()))  # the folder with the pages and settings
    echo(f"The dashboard is at http://127.0.0.1:{port}. Ctrl-C ends it.")
    with suppress(Abort):  # Ctrl-C
        main(["run", "app.py", *(f"--{name}={value}" for name, value in options)], standalone_mode=False)


class Guard:
    """Lets no other page embed the dashboard, nor its pages fetch from elsewhere, and names each browser."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._refusals = Refusals()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        if scope["type"] == "websocket":
            app = self._app
            if not _is_own_page(connection):
                self._refusals.note(connection.headers["origin"], connection.headers.get("host"))
                app = _ANOTHER_ORIGIN
            await app(scope, receive, send)
            return
        is_known = BROWSER in connection.cookies
        app = self._app if is_host_allowed(connection.headers.get("host")) else _ANOTHER_NAME
        if scope["path"].rstrip("/").endswith("/_stcore/metrics"):  # of memory and sessions, which concern no visitor
            app = _NOTHING

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.update(_POLICY)
                if not is_known and headers.get("content-type", "").startswith("text/html"):
                    secure = "; Secure" if scope["scheme"] == "https" else ""
                    cookie = f"{BROWSER}={secrets.token_urlsafe()}; Path=/; Max-Age={_A_YEAR_S}; HttpOnly; SameSite=Lax"
                    headers.append("Set-Cookie", cookie + secure)
            await send(message)

        await app(scope, receive, guarded)


def _is_own_page(connection: HTTPConnection) -> bool:
    host, origin = map(connection.headers.get, ("host", "origin"))
    origins = {name.strip() for name in st.get_option("server.corsAllowedOrigins")}
    return origin is None or origin in origins or origin.partition("://")[2] == host


@asynccontextmanager
async def lifespan(_: object) -> AsyncIterator[None]:
    """As the server starts, import what pages need, and open the browser as ``streamlit run`` does for scripts."""
    start_importing()
    if not st.get_option("server.headless"):
        address = st.get_option("browser.serverAddress") or "localhost"
        webbrowser.open(f"http://{address}:{st.get_option('server.port')}")
    yield


def tell(error: Exception) -> bool:
    """Say in a sentence what stopped a page: memory, data, the cache; faults are Streamlit's to show."""
    if not (out_of_memory(error) or isinstance(error, CrashfuseError)):
        return False
    st.error(OUT_OF_MEMORY if out_of_memory(error) else plain(error), icon=":material/error:")
    return True


def prepare() -> tuple[Middleware, ...]:
    """Begin the log, check the log-in, without which no server starts; returns what requests go through."""
    try:
        begin_log()
        if check_login(st.get_option("secrets.files")):
            visitors.login_insisted.set()
    except (CrashfuseError, OSError) as error:
        sys.exit(f"crashfuse: {error}")
    handler = signal.getsignal(signal.SIGTERM)
    if callable(handler):  # uvicorn's own would raise SIGTERM once more, now fatal; by Ctrl-C uploads are deleted
        signal.signal(signal.SIGTERM, lambda _, frame: handler(signal.SIGINT, frame))
    return (Middleware(Guard),)


@cache
def start_importing() -> tuple[Future[None], Future[None]]:
    """Import in the background, once, what the pages need, and then what a first prediction needs."""
    background = ThreadPoolExecutor(1, "crashfuse-imports")
    started = background.submit(_import_pages), background.submit(_import_training)
    background.shutdown(wait=False)
    return started


def _import_pages() -> None:
    from crashfuse.execution.run import share_one_heap

    share_one_heap()
    for name in _SLOW:
        import_module(name)


def _import_training() -> None:
    import_module("torch")
    from crashfuse.ui.kit.uploads import sweep_uploads

    sweep_uploads()


def run() -> None:
    """Run the page given in the address, once everything it needs is imported."""
    page = navigate()
    imported, _ = start_importing()
    if not imported.done():
        st.title(page.title)
        st.markdown(":material/hourglass_top: Starting …")
        imported.result()  # waits
        st.rerun()
    from crashfuse.ui.kit.frame import route

    route(page)
