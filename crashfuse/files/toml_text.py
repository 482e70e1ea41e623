"""TOML text: bounded reading of files that nobody should trust, and values as they are written and told."""

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from crashfuse.errors import printable, refusal, refuse_if
from crashfuse.files.csv_text import text_from

_LINE = 100
_MOST_PARTS = 20  # of a dotted key; time and memory of parsing one grow with the square of their number
_PART = r"""(?>[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
_LONG_KEY = re.compile(rf"(?<![\w-]){_PART}(?>[ \t]*+\.[ \t]*+{_PART}){{{_MOST_PARTS}}}")
_MOST_MARKS = 200_000  # dots and opening brackets: a part of a key, or a table, takes a kilobyte
_LONGEST_WORD = 1000  # of characters that are in no text; a longer number takes a hundred bytes for each
_LONG_WORD = re.compile(rf"[=,\[]\s*+[\w.+-]{{{_LONGEST_WORD}}}")
_NUMBERS = f"numbers of fewer than {_LONGEST_WORD} characters"
_LONGEST_INT = 64  # bits; Python refuses to write the longest that a file can hold


def package_data(module: str, name: str = "") -> dict[str, Any]:
    """What a TOML file of ours has that stands beside a module (its ``__file__``), under its name or another."""
    path = Path(module).with_suffix(".toml")
    return tomllib.loads((path.with_name(name) if name else path).read_text(encoding="utf-8"))


def read_toml(path: Path, most_mib: int, advice: str) -> dict[str, Any]:
    """Read a file; a DataError says what is wrong with it, with this advice if it is larger than that."""
    try:
        with text_from(path, path.name) as stream:
            text = stream.read((most_mib << 20) + 1)
        refuse_if(len(text) > most_mib << 20, path.name, f"a file of at most {most_mib} MiB", "more", advice)
        for pattern, most in ((_LONG_KEY, f"keys of at most {_MOST_PARTS} parts"), (_LONG_WORD, _NUMBERS)):
            if match := pattern.search(text):
                row = text.count("\n", 0, match.start()) + 1
                raise refusal(path.name, most, printable(match.group(), 60), "correct it", row=row)
        if text.count(".") + text.count("[") > _MOST_MARKS:
            raise refusal(path.name, f"at most {_MOST_MARKS:,} dots and brackets", "more", advice)
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        found = "brackets too deep" if isinstance(error, RecursionError) else str(error)
        raise refusal(path.name, "a TOML file in UTF-8", found, "correct the file") from error


def toml_text(value: str | float | Sequence[str] | Mapping[str, str]) -> str:
    """A value as TOML: JSON strings are valid TOML except for one character."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{toml_text(key)} = {toml_text(text)}' for key, text in value.items())}}}"
    items = [toml_text(item) for item in value]
    line = f"[{', '.join(items)}]"
    return line if len(line) < _LINE else "[\n" + "".join(f"    {item},\n" for item in items) + "]"


def shown(value: object) -> str:
    """A value that was read, as text for messages, safe for numbers of any size and tables of any depth."""
    plain = isinstance(value, str | float) or (isinstance(value, int) and value.bit_length() <= _LONGEST_INT)
    return printable(repr(value), 60) if plain else f"a value of type {type(value).__name__}"
