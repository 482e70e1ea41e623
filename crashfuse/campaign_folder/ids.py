"""Ids of tests and CAE runs: they name files, on every platform, and stand in tables that spreadsheets open."""

import re
import unicodedata

from crashfuse.errors import printable
from crashfuse.files.archive import name_trouble

_WILD = re.compile(r'[*?|<>"]')  # Windows keeps these for itself
_UNSAFE = re.compile(r'[/\\:*?|<>"]')
_FORMULA = ("=", "+", "-", "@")
_LONGEST = 180  # bytes of an id made of a foreign name


def id_trouble(run_id: str) -> tuple[str, str, str] | None:
    """Expected, found and advice for an id that is not a valid file name or would be a spreadsheet formula."""
    if not run_id:
        return "an id in each row", "an empty cell", "name the row"
    found = repr(printable(run_id, 60))
    unsafe = ("", "a slash", "") if "/" in run_id else name_trouble(run_id)
    if unsafe is None and (wild := _WILD.search(run_id)):
        unsafe = ("", f"the character {wild[0]}", "")
    if unsafe is not None:
        return "an id that can name a file", f"{found}, {unsafe[1]}", "rename it"
    if run_id.startswith(_FORMULA):
        return "an id that no spreadsheet takes for a formula", found, "let it begin with a letter or a digit"
    return None


def folded(name: str) -> str:
    """A name as seen by a file system that ignores case and Unicode normalisation."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def same_name(run_id: str, other: str) -> tuple[str, str, str]:
    """Expected, found and advice for an id that names the same file as another."""
    if run_id == other:
        return "each id once", f"{printable(run_id, 60)!r} a second time", "rename or remove the row"
    told = f"{printable(run_id, 60)!r} beside {printable(other, 60)!r}"
    return "ids that differ by more than capitals or the form of their accents", told, "rename one of them"


def safe_id(name: str) -> str:
    """An id as near as can be to a foreign name, such as that of a file."""
    plain = "".join(char if char.isprintable() else "_" for char in unicodedata.normalize("NFC", name))
    plain = (
        _UNSAFE.sub("_", plain).encode("utf-8", "replace")[:_LONGEST].decode("utf-8", "ignore").strip(" ").rstrip(". ")
    )
    if plain.startswith(_FORMULA):
        plain = f"_{plain[1:]}"
    if plain and id_trouble(plain) is not None:  # the name of a device
        plain = f"_{plain}"
    return plain or "record"
