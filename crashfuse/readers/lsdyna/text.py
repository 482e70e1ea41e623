"""LS-DYNA's files as text: lines of bounded length, numbers as Fortran writes them."""

import re
from collections.abc import Iterable, Iterator

from crashfuse.errors import DataError, Problem, printable

_LONGEST_LINE = 1 << 16
_NO_EXPONENT_LETTER = re.compile(r"(?<=[\d.])([-+])")


def lines_of(chunks: Iterable[bytes], where: str) -> Iterator[bytes]:
    """Yield the lines of a file that comes in chunks."""
    rest = b""
    for chunk in chunks:
        *whole, rest = (rest + chunk).split(b"\n")
        yield from whole
        if len(rest) > _LONGEST_LINE:
            raise DataError(Problem(where, "lines of text", "one without an end", f"choose the {where} of a run"))
    if rest:
        yield rest


def number(text: str, where: str) -> float:
    """Read a number as written by Fortran: 1.2E-03, 1.2D-03, and 1.2-103 for three-digit exponents."""
    plain = text.upper().replace("D", "E")
    try:
        return float(plain if "E" in plain else _NO_EXPONENT_LETTER.sub(r"E\1", plain))
    except ValueError:
        found = repr(printable(text, 40))
        raise DataError(Problem(where, "numbers", found, "copy it again from the run")) from None
