"""Who is in front of a session: the person who has logged in, else the browser."""

import hashlib
import uuid
from collections.abc import Iterable
from dataclasses import dataclass

import streamlit as st

BROWSER = "crashfuse_browser"  # cookie with a random value, so that a browser is known again after a reload
_SESSION = "visitor"  # session key, where there is no cookie


@dataclass(frozen=True)
class Visitor:
    """Whom uploads, imports and jobs belong to.

    Parameters
    ----------
    key : str
        The same in all sessions of one person or browser; nobody else can guess it.
    name : str
        What others and the log may know: the e-mail address, or a short name of the browser.
    """

    key: str
    name: str


def visitor() -> Visitor:
    """Who is in front of this session."""
    if logged_in():
        person = st.user.to_dict()
        key = f"{person.get('iss')} {person.get('sub')}"
        return Visitor(key, str(person.get("email") or person.get("name") or person.get("sub")))
    key = browser()
    return Visitor(key, f"browser {hashlib.sha256(key.encode()).hexdigest()[:6]}")


def names(visitors: Iterable[Visitor]) -> str:
    """What others may know of them, in a line."""
    return " and ".join(sorted(visitor.name for visitor in visitors))


def browser() -> str:
    """The random value by which the browser is known; one for this session alone if it keeps no cookies."""
    return str(st.context.cookies.to_dict().get(BROWSER) or st.session_state.setdefault(_SESSION, uuid.uuid4().hex))


def logged_in() -> bool:
    """True if this server asks for a log-in, and the visitor has logged in."""
    return bool(st.user.to_dict().get("is_logged_in"))
