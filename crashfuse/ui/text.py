"""Untrusted text on a page: a file's name, a table cell, the texts of a campaign."""

import string

_MARKS = {ord(char): f"\\{char}" for char in string.punctuation}


def plain(text: str) -> str:
    """Text that Markdown shows literally, on one line: no links, images, formulas, icons or HTML."""
    return " ".join(text.split()).translate(_MARKS)
