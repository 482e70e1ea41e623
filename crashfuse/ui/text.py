"""Text from strangers on a page: a file's name, a cell, a campaign's own words."""

import string

_MARKS = {ord(char): f"\\{char}" for char in string.punctuation}


def plain(text: str) -> str:
    """Text that Markdown shows as it is, on one line: no link, image, formula, icon or HTML comes of it."""
    return " ".join(text.split()).translate(_MARKS)
