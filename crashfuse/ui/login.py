"""Log-in by an identity provider (OpenID Connect), on servers whose secrets file has a section ``[auth]``."""

import importlib.util
import threading
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import streamlit as st

from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.ui import journal
from crashfuse.ui.navigation import pages
from crashfuse.ui.text import plain
from crashfuse.ui.visitors import browser, logged_in, visitor

_SHARED = ("redirect_uri", "cookie_secret")
_OWN = ("client_id", "client_secret", "server_metadata_url")
_SHORTEST = 32  # characters of the secret that signs the cookies
_MOST_LINKS = 1000
_NOTED = "log-in noted"  # session key
_insisted = threading.Event()
_linking = threading.Lock()


def check(files: Sequence[str | Path], *, required: bool = False) -> bool:
    """Whether a secrets file asks for a log-in.

    Raises an error if one cannot be read or its log-in cannot work, for Streamlit would ask nobody to log in; with
    ``required``, also if none asks for it.
    """
    asked = [(path, auth) for path in map(Path, files) if path.is_file() and (auth := _auth_in(path)) is not None]
    for path, auth in asked:
        _check_section(path, auth)
    if required and not asked:
        expected = "a secrets file with a section [auth]"
        raise DataError(Problem(str(files[0]), expected, "none", "see the how-to on a team server"))
    if asked and importlib.util.find_spec("authlib") is None:
        raise UsageError('A log-in needs the extra "login": python -m pip install "crashfuse[login]".')
    return bool(asked)


def insist() -> None:
    """Ask for a log-in as long as this process runs, even if the secrets file is lost meanwhile."""
    _insisted.set()


def require(page: str) -> None:
    """On a server that asks for a log-in, show nothing but that to whoever has not logged in.

    A link to a page is remembered, and followed once they have.
    """
    auth = _asked_for()
    if not (auth or _insisted.is_set()):
        return
    if logged_in():
        if not st.session_state.get(_NOTED):
            st.session_state[_NOTED] = True
            journal.note(visitor(), "began a session")
            if not page and (link := _links().pop(browser(), None)) is not None:
                st.switch_page(pages()[link[0]], query_params=link[1])
        return
    if page:
        from crashfuse.ui import address  # takes seconds, and the server starts with this module

        with _linking:
            while len(_links()) >= _MOST_LINKS:
                _links().pop(next(iter(_links())))
            _links()[browser()] = page, address.given()
    st.title("crashfuse")
    st.markdown("This server is for people who are known to it." if auth else "Nobody can log in at the moment.")
    for provider in _providers(auth):
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
    """Page and choices that the last link in each browser asked for before the log-in."""
    return {}


def _log_out() -> None:
    journal.note(visitor(), "logged out")
    st.logout()


def _asked_for() -> dict[str, Any]:
    """The section ``[auth]`` of the server's secrets; empty if there is none."""
    if not st.secrets.load_if_toml_exists():
        return {}
    return dict(st.secrets.get("auth", {}))


def _providers(auth: dict[str, Any]) -> list[str | None]:
    """Names of the identity providers; None stands for the only one, which has no name."""
    if "client_id" in auth:
        return [None]
    return [name for name, value in auth.items() if hasattr(value, "keys") and "client_id" in value]


def _auth_in(path: Path) -> dict[str, Any] | None:
    """The section ``[auth]`` of a secrets file, if it has one."""
    try:
        auth = tomllib.loads(path.read_text(encoding="utf-8")).get("auth")
    except (OSError, ValueError) as error:
        raise DataError(Problem(str(path), "a TOML file that can be read", str(error), "correct it")) from error
    return auth if auth is None or isinstance(auth, dict) else {}


def _check_section(path: Path, auth: dict[str, Any]) -> None:
    wanted = [auth[name] for name in _providers(auth) if name] or [auth]
    lacking = [name for name in _SHARED if not auth.get(name)]
    lacking += [name for section in wanted for name in _OWN if not section.get(name)]
    where, advice = f"{path}, [auth]", "see the how-to on a team server"
    problems = [Problem(where, name, "none", advice) for name in dict.fromkeys(lacking)]
    if not lacking and not str(auth["redirect_uri"]).endswith("/oauth2callback"):
        expected = "the server's address with /oauth2callback"
        problems.append(Problem(where, expected, str(auth["redirect_uri"]), advice, "redirect_uri"))
    if not lacking and len(str(auth["cookie_secret"])) < _SHORTEST:
        expected, found = f"at least {_SHORTEST} random characters", f"{len(str(auth['cookie_secret']))}"
        problems.append(Problem(where, expected, found, advice, "cookie_secret"))
    if problems:
        raise DataError(problems)
