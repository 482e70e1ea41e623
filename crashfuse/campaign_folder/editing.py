"""Editing a campaign folder: tests left out of use or taken out, and copies to edit.

Each edit is all or nothing, and :func:`crashfuse.campaign_folder.history.undo` takes it back.
"""

import csv
import io
import re
import shutil
import tomllib
from collections.abc import Mapping, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import Any

from crashfuse.campaign_folder.added import named
from crashfuse.campaign_folder.condition_tables import read_what_can_be
from crashfuse.campaign_folder.folder import FILES
from crashfuse.campaign_folder.history import changing, settle, taking_turns
from crashfuse.campaign_folder.settings import read_settings, reason
from crashfuse.campaign_folder.tidy_tables import append_to_table
from crashfuse.errors import DataError, Problem, UsageError, printable
from crashfuse.files.atomic import new_folder
from crashfuse.files.toml_text import toml_text

_STRING = r""" "(?:[^"\\\n]|\\.)*" | '[^'\n]*' """
_START = re.compile(r"^unused[ \t]*=", re.M)
_MOST_STARTS = 5  # what looks like one in texts; for each the file is read once more
_LIST = re.compile(
    rf"""
    ^unused[ \t]*=[ \t]*
    (?: \[ (?: {_STRING} | \#[^\n]*\n | [^]"'\#] )* \] | \{{ (?: {_STRING} | [^}}"'\n] )* \}} )
    [ \t]* (?: \#[^\n]* )? \r? (?: \n | \Z )
    """,
    re.M | re.X,
)
_ENDINGS = ("csv", "parquet")


def leave_out(folder: Path, ids: Sequence[str], why: str = "") -> str:
    """Leave tests of a campaign out of use: they stay in the folder, but nothing learns from them or rates them.

    ``unused`` in ``campaign.toml`` lists them, with the reason if one is given. A test whose record is damaged can be
    left out, too.

    Returns
    -------
    str
        What was done, a sentence without its full stop.

    Raises
    ------
    UsageError
        If there is no such test, it is left out already, or none would stay in use.
    DataError
        If the campaign's files cannot be edited, or it is the sample; nothing is changed.
    """
    with taking_turns(folder):
        known, unused = _tests(folder)
        _require(ids, [test_id for test_id in known if test_id not in unused], "in use")
        _require_one_in_use(known, {*unused, *ids})
        return _set_why(folder, known, unused, ids, why)


def say_why(folder: Path, test_id: str, why: str) -> str:
    """Give a test that is left out of use another reason, or none; otherwise as :func:`leave_out`."""
    with taking_turns(folder):
        known, unused = _tests(folder)
        _require([test_id], list(unused), "left out of use")
        return _set_why(folder, known, unused, [test_id], why)


def use_again(folder: Path, ids: Sequence[str]) -> str:
    """Use tests again that were left out of use; otherwise as :func:`leave_out`."""
    with taking_turns(folder):
        known, unused = _tests(folder)
        _require(ids, list(unused), "left out of use")
        rest = {test_id: why for test_id, why in unused.items() if test_id not in ids}
        return _set_unused(folder, known, rest, f"In use again: {named(ids)}")


def remove_tests(folder: Path, ids: Sequence[str]) -> str:
    """Take tests out of a campaign folder, rows and pulses; otherwise as :func:`leave_out`."""
    with taking_turns(folder):
        known, unused = _tests(folder)
        _require(ids, known, "there")
        _require_one_in_use(known, {*unused, *ids})
        table, settings = folder / "tests.csv", folder / "campaign.toml"
        told = f"Taken out: {named(ids)}"
        with changing(folder, told) as new:
            if {*ids} & {*unused}:
                rest = {test_id: why for test_id, why in unused.items() if test_id not in ids}
                _write_unused(settings, rest, new(settings))
            new(table).write_bytes(_without_rows(table.read_bytes().decode("utf-8-sig"), ids).encode())
            for path in (folder / f"tests_pulses.{ending}" for ending in _ENDINGS):
                if path.is_file():
                    append_to_table(path, new(path), [], without=ids)
            for path in (folder / "tests" / f"{test_id}.{ending}" for test_id in ids for ending in _ENDINGS):
                if path.is_file():
                    new(path)  # without a content
        return told


def copy_campaign(folder: Path, to: Path) -> None:
    """Copy the files of a campaign folder, byte for byte, into a new one.

    Raises
    ------
    DataError
        If there is something in the new folder already.
    OSError
        If reading or writing fails; nothing is left behind.
    """
    settle(folder)
    with new_folder(to) as home:
        tables = [folder / f"{role}_pulses.{ending}" for role in ("tests", "cae") for ending in _ENDINGS]
        singles = [
            path for role in ("tests", "cae") for ending in _ENDINGS for path in folder.glob(f"{role}/*.{ending}")
        ]
        for path in (*(folder / name for name in FILES), *tables, *singles):
            if path.is_file():
                target = home / path.relative_to(folder)
                target.parent.mkdir(exist_ok=True)
                shutil.copyfile(path, target)


def _tests(folder: Path) -> tuple[tuple[str, ...], Mapping[str, str]]:
    """The ids of all tests in the folder, whatever is wrong with their data, and why some are left out of use."""
    problems: list[Problem] = []
    settings = read_settings(folder, problems, [])
    if problems:
        raise DataError(problems)
    table = read_what_can_be(folder / "tests.csv", "tests", problems)
    if table is None:
        raise DataError(problems)
    return table.ids, settings.unused


def _require(ids: Sequence[str], allowed: Sequence[str], what: str) -> None:
    """Raise a UsageError if one of the ids is not allowed."""
    for test_id in ids:
        if test_id not in allowed:
            listed = ", ".join(printable(other, 60) for other in allowed) or "none"
            raise UsageError(f"There is no test {printable(test_id, 60)!r} that is {what}; there is {listed}.")


def _require_one_in_use(known: Sequence[str], unused: set[str]) -> None:
    if {*known} <= unused:
        raise UsageError("At least one test has to stay in use.")


def _set_why(folder: Path, known: Sequence[str], unused: Mapping[str, str], ids: Sequence[str], why: str) -> str:
    why = reason(why)
    told = f"Left out of use: {named(ids)}{f' ({why})' if why else ''}"
    if all(unused.get(test_id) == why for test_id in ids):
        return told  # nothing that could be undone
    return _set_unused(folder, known, {**unused, **dict.fromkeys(ids, why)}, told)


def _set_unused(folder: Path, known: Sequence[str], unused: Mapping[str, str], told: str) -> str:
    path = folder / "campaign.toml"
    with changing(folder, told) as new:
        _write_unused(path, {test_id: unused[test_id] for test_id in known if test_id in unused}, new(path))
    return told


def _write_unused(path: Path, unused: Mapping[str, str], to: Path) -> None:
    """Set ``unused`` in a campaign.toml, and leave every other byte of it; without any setting, none is written."""
    value = unused if any(unused.values()) else list(unused)
    text = path.read_bytes().decode("utf-8-sig") if path.is_file() else ""
    line = f"unused = {toml_text(value)}\n" if value else ""
    wanted = {key: own for key, own in tomllib.loads(text).items() if key != "unused"}
    if value:
        wanted["unused"] = value
    # the first line: before any table, whose setting it would be
    starts = islice(_START.finditer(text), _MOST_STARTS)
    lists = (own for start in starts if (own := _LIST.match(text, start.start())))
    edits = chain([line + text], (line + text[: own.start()] + text[own.end() :] for own in lists))
    new = next((edit for edit in edits if _values(edit) == wanted), None)  # what looks like it may be in a text
    if new is None:
        expected, found = "unused = [...] or {...} at the start of a line", "another form"
        raise DataError(Problem(path.name, expected, found, f"set it by hand: unused = {toml_text(value)}"))
    if new:
        to.write_bytes(new.encode())


def _values(text: str) -> dict[str, Any] | None:
    """The settings in a text; None if it is no TOML."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return None


def _without_rows(text: str, ids: Sequence[str]) -> str:
    """The text of a condition table without the rows of these ids; the other lines stay to the byte."""
    lines = io.StringIO(text, newline="").readlines()
    reader = csv.reader(lines, skipinitialspace=True)
    at = [cell.strip() for cell in next(reader)].index("id")
    kept, start = lines[: reader.line_num], reader.line_num
    for cells in reader:
        if len(cells) <= at or cells[at].strip() not in ids:
            kept += lines[start : reader.line_num]
        start = reader.line_num
    return "".join(kept)
