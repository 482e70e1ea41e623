"""Changes of a campaign folder, each kept with what it replaced, so that the last ones can be undone.

``.undo/`` in the folder has a folder for each change, numbered: ``change.json`` lists the files that were written or
removed, with SHA-256 before and after, and ``before/`` holds them as they were, as hard links where the disk allows:
files are replaced, never written in place, so keeping the old one costs no time.
"""

import hashlib
import json
import os
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from crashfuse.campaign_folder.sample_folder import is_sample
from crashfuse.errors import DataError, Problem, printable
from crashfuse.execution.cache import Cache
from crashfuse.files.atomic import new_folder

_HOME, _LIST, _BEFORE = ".undo", "change.json", "before"
_KEPT = 10  # changes; what older ones replaced is let go
_LARGEST = 32 << 20  # bytes of a list: some 100,000 files
# a folder may come from anywhere: nothing outside it, and nothing in it that is not a campaign's, is ever touched
_OF_A_CAMPAIGN = re.compile(r"(tests|cae)\.csv|campaign\.toml|(tests|cae)(_pulses|/[^/\\]+)\.(csv|parquet)")


@dataclass(frozen=True, slots=True)
class ChangedFile:
    """A file that a change wrote or removed, with its SHA-256 before and after; None where there was none."""

    name: str
    before: str | None
    after: str | None


@dataclass(frozen=True, slots=True)
class Change:
    """A change of a campaign folder.

    Parameters
    ----------
    number : int
        Increases from change to change.
    what : str
        A sentence without its full stop, such as ``Added: 2 tests (T12, T13)``.
    when : str
        Date and time, UTC.
    files : tuple of ChangedFile
        In the order in which they were written, in which each step leaves a campaign that can be read.
    """

    number: int
    what: str
    when: str
    files: tuple[ChangedFile, ...]


def changes(folder: Path) -> tuple[Change, ...]:
    """The changes of a campaign folder that are kept, the last one first."""
    found = [change for home in (folder / _HOME).glob("[0-9]*") if (change := _read(home)) is not None]
    return tuple(sorted(found, key=lambda change: -change.number))


@contextmanager
def taking_turns(folder: Path) -> Iterator[None]:
    """Let nobody else on this machine change a campaign folder meanwhile; the sample's own is refused."""
    if is_sample(folder):
        found, advice = "the sample's own", "save a copy of it first (crashfuse sample DIR), and edit that"
        raise DataError(Problem(str(folder), "a campaign folder of yours", found, advice))
    with Cache().alone("campaign", {"folder": str(folder.resolve())}):
        yield


@contextmanager
def changing(folder: Path, what: str) -> Iterator[Callable[[Path], None]]:
    """Record a change of a campaign folder; if it fails, everything is put back.

    Yields a function that has to be called with each file before it is replaced, made or removed, for the last of them
    to complete the change.
    """
    number = 1 + max((change.number for change in changes(folder)), default=0)
    home = folder / _HOME / f"{number:06d}"
    there: dict[str, bool] = {}
    try:
        with new_folder(home) as entry:

            def keep(path: Path) -> None:
                name = path.relative_to(folder).as_posix()
                if name not in there:
                    there[name] = path.is_file()
                    if there[name]:
                        _link(path, entry / _BEFORE / name)

            try:
                yield keep
                files = [ChangedFile(name, _digest(entry / _BEFORE / name), _digest(folder / name)) for name in there]
                change = Change(number, what, datetime.now(UTC).isoformat(timespec="seconds"), tuple(files))
                (entry / _LIST).write_text(json.dumps(asdict(change), indent=1), encoding="utf-8")
            except BaseException:
                for name, was_there in reversed(there.items()):
                    _put_back(folder, entry, name, was_there=was_there)
                raise
    except BaseException:
        _tidy(folder / _HOME)
        raise
    for old in changes(folder)[_KEPT:]:
        shutil.rmtree(folder / _HOME / f"{old.number:06d}", ignore_errors=True)


def undo(folder: Path) -> Change:
    """Undo the last change of a campaign folder: every file is again what it was, byte for byte.

    An interrupted undo can be repeated.

    Returns
    -------
    Change
        The change that was undone.

    Raises
    ------
    DataError
        If there is none, or if one of its files was changed since; the folder stays as it is.
    """
    with taking_turns(folder):
        last = next(iter(changes(folder)), None)
        if last is None:
            found, advice = "none that is recorded", "nothing has to be undone"
            raise DataError(Problem(str(folder), "a change that can be undone", found, advice))
        home = folder / _HOME / f"{last.number:06d}"
        waiting = [(file, now) for file in last.files if (now := _digest(folder / file.name)) != file.before]
        for file, now in waiting:
            _require(now, home, file, last.what)
        for file, _ in reversed(waiting):
            _put_back(folder, home, file.name, was_there=file.before is not None)
        shutil.rmtree(home)
        _tidy(folder / _HOME)
    return last


def _require(now: str | None, home: Path, file: ChangedFile, what: str) -> None:
    """Raise a DataError if a file, by its digest now, is not as a change left it, or what it replaced is gone."""
    expected = f"the file as it was after “{what}”"
    advice = f"put its rows and files right by hand; {_HOME}/{home.name}/{_BEFORE} has what was there before"
    if now != file.after:
        found = "none" if now is None else "another content" if file.after else "a file that was removed"
        raise DataError(Problem(file.name, expected, f"{found}: it was changed since", advice))
    if file.before is not None and _digest(home / _BEFORE / file.name) != file.before:
        kept, found = f"{_HOME}/{home.name}/{_BEFORE}/{file.name}", "none, or a damaged one"
        raise DataError(Problem(kept, "the file that was replaced", found, "put it right by hand"))


def _put_back(folder: Path, home: Path, name: str, *, was_there: bool) -> None:
    target = folder / name
    if was_there:
        target.parent.mkdir(exist_ok=True)
        (home / _BEFORE / name).replace(target)
    else:
        target.unlink(missing_ok=True)
        if target.parent != folder:
            _tidy(target.parent)


def _read(home: Path) -> Change | None:
    """The change recorded in a folder; None if it is not one that this module has written."""
    path = home / _LIST
    try:
        if home.is_symlink() or path.is_symlink() or path.stat().st_size > _LARGEST:
            return None
        told: Mapping[str, object] = json.loads(path.read_text(encoding="utf-8"))
        number, what, when, listed = (told[key] for key in ("number", "what", "when", "files"))
        if not isinstance(number, int) or home.name != f"{number:06d}" or not isinstance(listed, list):
            return None
        files = tuple(ChangedFile(*(each[key] for key in ("name", "before", "after"))) for each in listed)
        if not all(_is_sound(file) for file in files) or len({file.name for file in files}) != len(files):
            return None
        return Change(number, printable(str(what)), printable(str(when), 40), files)
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return None


def _is_sound(file: ChangedFile) -> bool:
    digests = all(
        digest is None or (isinstance(digest, str) and len(digest) == 64) for digest in (file.before, file.after)
    )
    return digests and isinstance(file.name, str) and _OF_A_CAMPAIGN.fullmatch(file.name) is not None


def _digest(path: Path) -> str | None:
    """SHA-256 of a file; None if there is none, or only a link to one."""
    if path.is_symlink() or not path.is_file():
        return None
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _link(path: Path, to: Path) -> None:
    """Keep a file under a second name: a hard link, or a copy where there are none."""
    to.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(path.resolve(), to)
    except OSError:
        shutil.copy2(path, to)


def _tidy(folder: Path) -> None:
    """Remove a folder that is empty."""
    with suppress(OSError):
        folder.rmdir()
