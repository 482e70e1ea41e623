"""What the dashboard's server adds to Streamlit's, whichever command starts it."""

import asyncio
import secrets
import signal
import sys
import time
import webbrowser
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, cast

import streamlit as st
from starlette.datastructures import MutableHeaders
from starlette.middleware import Middleware
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose
from streamlit import net_util
from streamlit.runtime import Runtime
from streamlit.runtime.pages_manager import PagesManager
from streamlit.web.server.starlette.starlette_websocket import is_host_allowed

from crashfuse.errors import OUT_OF_MEMORY, CrashfuseError, out_of_memory
from crashfuse.execution.process import share_one_heap
from crashfuse.ui import journal, login
from crashfuse.ui.starting import start_importing
from crashfuse.ui.text import plain
from crashfuse.ui.visitors import BROWSER

if TYPE_CHECKING:
    from streamlit.runtime.memory_uploaded_file_manager import MemoryUploadedFileManager

_POLICY = {  # no page around this one, and nothing that this one shows, a laboratory's text say, fetches from elsewhere
    "X-Frame-Options": "DENY",
    "Content-Security-Policy": "frame-ancestors 'none'; default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'; "
    "connect-src 'self' data: blob: ws: wss:",  # older browsers do not count a WebSocket as 'self'
}
_LOOK_S, _PATIENCE_S = 5.0, 20.0  # for tabs that were closed, and for their browser to come back
_A_YEAR_S = 365 * 24 * 3600
_ANOTHER_NAME = PlainTextResponse(
    "crashfuse does not answer under this name. If it should, start it with crashfuse app --allow-host NAME, or add "
    "the name to server.allowedHosts in .streamlit/config.toml.",
    403,
)
_ANOTHER_ORIGIN = WebSocketClose(1008)  # against the policy; before it is open, the server answers 403

# on refusing a page of another origin, Streamlit would ask a server on the network for this machine's address
net_util._external_ip = ""
# else the first session would run a linked page without app.py
PagesManager.uses_pages_directory = False


class Guard:
    """Lets no other page embed the dashboard, so that nobody clicks in it unknowingly, and names each browser.

    Nor do its pages fetch anything from other servers.

    Of other names than the allowed ones Streamlit refuses the WebSocket only; here all is refused, and why is said. It
    lets in any page of this machine, whichever program serves it; here the WebSocket is for pages of this server alone.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._refusals = journal.Refusals()

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
    """Whether a WebSocket is asked for by a page of this server, by one of a configured origin, or by no browser."""
    host, origin = map(connection.headers.get, ("host", "origin"))
    known = {own.strip() for own in st.get_option("server.corsAllowedOrigins")}
    return origin is None or origin in known or origin.partition("://")[2] == host


async def _forget_closed_tabs() -> None:
    """Free what lies in upload fields of tabs that were closed: Streamlit keeps it until it is asked about something.

    A browser that was cut off for some seconds finds it again.
    """
    gone: dict[str, float] = {}
    while True:
        await asyncio.sleep(_LOOK_S)
        runtime, now = Runtime.instance(), time.monotonic()
        files = cast("MemoryUploadedFileManager", runtime.uploaded_file_mgr)
        absent = [session for session in list(files.file_storage) if not runtime.is_active_session(session)]
        gone = {session: gone.get(session, now) for session in absent}
        for session in [session for session, since in gone.items() if now - since >= _PATIENCE_S]:
            files.remove_session_files(session)


@asynccontextmanager
async def lifespan(_: object) -> AsyncIterator[None]:
    """As the server starts, import what pages need, and open the browser as ``streamlit run`` does for scripts."""
    start_importing()
    forgetting = asyncio.create_task(_forget_closed_tabs())
    if not st.get_option("server.headless"):
        address = st.get_option("browser.serverAddress") or "localhost"
        webbrowser.open(f"http://{address}:{st.get_option('server.port')}")
    yield
    forgetting.cancel()


def tell(error: Exception) -> bool:
    """Say in a sentence what stopped a page: memory, data, the cache; what is a fault is Streamlit's to show."""
    if not (out_of_memory(error) or isinstance(error, CrashfuseError)):
        return False
    st.error(OUT_OF_MEMORY if out_of_memory(error) else plain(error), icon=":material/error:")
    return True


def prepare() -> tuple[Middleware, ...]:
    """Begin the log, and check the log-in; returns what every request goes through.

    A server whose log-in is set up wrongly does not start, for it would let in everybody.
    """
    try:
        journal.begin()
        if login.check(st.get_option("secrets.files")):
            login.insist()
    except (CrashfuseError, OSError) as error:
        sys.exit(f"crashfuse: {error}")
    _end_as_by_ctrl_c()
    share_one_heap()
    return (Middleware(Guard),)


def _end_as_by_ctrl_c() -> None:
    """Let the signal that ends a service do what Ctrl-C does: Python then deletes uploads and other temporary files."""
    handler = signal.getsignal(signal.SIGTERM)
    if callable(handler):  # uvicorn's own, which would raise SIGTERM once more, now fatal
        signal.signal(signal.SIGTERM, lambda _, frame: handler(signal.SIGINT, frame))
