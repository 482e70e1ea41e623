"""Who is in front of a session: who logged in, if the secrets have ``[auth]`` (OpenID Connect), else the browser."""

import hashlib
import json
import threading
import uuid
from contextlib import suppress
from typing import Any

import streamlit as st

from crashfuse.errors import DataError
from crashfuse.execution.cache import default_folder
from crashfuse.execution.visitors import Visitor, note_in_log, providers
from crashfuse.files.atomic import sole_writer, write_atomically
from crashfuse.ui.kit.navigation import pages
from crashfuse.ui.kit.text import plain

BROWSER = "crashfuse_browser"  # cookie with a random value, so that a browser is known again after a reload
_SESSION = "visitor"  # session key, where there is no cookie
ROOTS = "CRASHFUSE_ROOT"  # environment variable: folders that pages may open and write to, one a line
_MOST_LINKS = 1000
_NOTED = "log-in noted"  # session key
_KEPT, _MOST_VISITORS = "visitors.json", 200  # what they want in every session; the latest of them
_LARGEST = 1 << 20  # bytes of the file
_PATIENCE_S = 5.0  # to wait for another who writes it
login_insisted = threading.Event()  # while this process runs, even if the secrets file is lost meanwhile
_linking = threading.Lock()


def visitor() -> Visitor:
    """Who is in front of this session."""
    if logged_in():
        person = st.user.to_dict()
        key = f"{person.get('iss')} {person.get('sub')}"
        return Visitor(key, str(person.get("email") or person.get("name") or person.get("sub")))
    key = browser()
    return Visitor(key, f"browser {hashlib.sha256(key.encode()).hexdigest()[:6]}")


def browser() -> str:
    """The random value by which the browser is known, or, without cookies, this session."""
    return str(st.context.cookies.to_dict().get(BROWSER) or st.session_state.setdefault(_SESSION, uuid.uuid4().hex))


def logged_in() -> bool:
    """True if this server asks for a log-in, and the visitor has logged in."""
    return bool(st.user.to_dict().get("is_logged_in"))


def kept_for_visitor() -> dict[str, list[str]]:
    """What the visitor wants in every session, as an address has it."""
    mine = _kept().get(short_key(), {})
    return {key: [str(text) for text in texts] for key, texts in mine.items() if texts and isinstance(texts, list)}


def keep_for_visitor(key: str, *texts: str) -> None:
    """Keep it in the cache folder, for this visitor alone; whatever goes wrong, it is only not kept."""
    with suppress(OSError, DataError), sole_writer(default_folder(), _PATIENCE_S):
        mine = kept_for_visitor() | {key: [*texts]}
        others = [(who, theirs) for who, theirs in _kept().items() if who != short_key()]
        kept = dict([*others[1 - _MOST_VISITORS :], (short_key(), mine)])
        write_atomically(default_folder() / _KEPT, json.dumps(kept).encode())


def _kept() -> dict[str, dict[str, Any]]:
    file, known = default_folder() / _KEPT, None
    with suppress(OSError, ValueError, RecursionError):  # there is none, or it is damaged
        known = json.loads(file.read_text(encoding="utf-8")) if file.stat().st_size <= _LARGEST else None
    return {who: own for who, own in known.items() if isinstance(own, dict)} if isinstance(known, dict) else {}


def short_key() -> str:
    """What stands for the visitor in the file: nobody can guess them by it."""
    return hashlib.sha256(visitor().key.encode()).hexdigest()[:16]


def require_login(page: str) -> None:
    """Where a log-in is asked for, show nothing else before it; a link to a page is followed after it."""
    auth: dict[str, Any] = dict(st.secrets.get("auth", {})) if st.secrets.load_if_toml_exists() else {}
    if not (auth or login_insisted.is_set()):
        return
    if logged_in():
        if not st.session_state.get(_NOTED):
            st.session_state[_NOTED] = True
            note_in_log(visitor(), "began a session")
            if not page and (link := _links().pop(browser(), None)) is not None:
                st.switch_page(pages()[link[0]], query_params=link[1])
        return
    if page:
        from crashfuse.ui.kit import address  # takes seconds, and the server starts with this module

        with _linking:
            while len(_links()) >= _MOST_LINKS:
                _links().pop(next(iter(_links())))
            _links()[browser()] = page, address.given()
    st.title("crashfuse")
    st.markdown("This server is for people who are known to it." if auth else "Nobody can log in at the moment.")
    for provider in providers(auth):
        name = f" with {provider}" if provider else ""
        st.button(f"Log in{plain(name)}", type="primary", icon=":material/login:", on_click=st.login, args=(provider,))
    st.stop()


def show_account() -> None:
    """Show who has logged in, and let them log out."""
    if logged_in():
        st.caption(f":material/person: {plain(visitor().name)}")
        st.button("Log out", icon=":material/logout:", on_click=_log_out)


@st.cache_resource
def _links() -> dict[str, tuple[str, dict[str, list[str]]]]:
    return {}


def _log_out() -> None:
    note_in_log(visitor(), "logged out")
    st.logout()
