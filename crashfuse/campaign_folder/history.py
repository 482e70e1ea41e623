"""Changes of a campaign folder: all or nothing, and each kept with what it replaced, so that it can be undone.

``.undo/`` has a numbered folder for each change, with a list of its files (SHA-256 before and after) and those that it
replaced in ``before/``, as hard links where the disk allows: files are never written in place. The list is named
``begun.json`` until after the last file, then ``change.json``. Whoever comes upon a change that has begun and whose
process is gone puts its files back; an undo makes of a change one that has only begun.
"""

import getpass
import hashlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from crashfuse.errors import DataError, printable, refusal, refuse_if
from crashfuse.execution.cache import default_folder
from crashfuse.files.atomic import NAME, flush, name_target, replacing, share, sole_writer

_HOME, _BEGUN, _LIST, _BEFORE, _AFTER = ".undo", "begun.json", "change.json", "before", "after"
SHIPPED = Path(__file__).parents[2] / "sample_data"
_KEPT = 10  # changes; what older ones replaced is let go
_LARGEST = 32 << 20  # bytes of a list: some 100,000 files
_PATIENCE_S = 20.0  # to wait for another who changes the folder
# a folder may come from anywhere: nothing outside it, and nothing in it that is not a campaign's, is ever touched
_OF_A_CAMPAIGN = re.compile(
    r"(tests|cae|matrix)\.csv|(campaign|criteria)\.toml|archive\.cfa|(tests|cae)(_pulses|_wall|/[^/\\]+)\.(csv|parquet)"
)
_author: ContextVar[str] = ContextVar("author", default="")


@dataclass(frozen=True, slots=True)
class ChangedFile:
    """A file that a change wrote or removed, with its SHA-256 before and after; None where there was none."""

    name: str
    before: str | None
    after: str | None


@dataclass(frozen=True, slots=True)
class Change:
    """A change of a campaign folder."""

    number: int  # increasing
    what: str  # a sentence without its full stop
    when: str  # in UTC
    files: tuple[ChangedFile, ...]  # in the order of writing: each step leaves a campaign that can be read
    author: str = ""

    def __str__(self) -> str:
        by = f" by {self.author}" if self.author else ""
        return f"“{self.what}”{by}, {self.when[:16].replace('T', ' at ')} UTC"


def changes(folder: Path) -> tuple[Change, ...]:
    """The changes of a campaign folder that are kept, the last one first; damaged ones are passed over."""
    read = (_read(home / _LIST) for home in reversed(_entries(folder)))
    return tuple(change for change in read if change is not None)


@contextmanager
def changed_by(author: str) -> Iterator[None]:
    """Context of changes by somebody else than the user of this process."""
    token = _author.set(author)
    try:
        yield
    finally:
        _author.reset(token)


@contextmanager
def taking_turns(folder: Path) -> Iterator[None]:
    """Let nobody else change a campaign folder meanwhile, and find it without half a change; else a DataError."""
    refuse_if(is_sample(folder), str(folder), "a folder of yours", "the sample", "copy it (crashfuse sample DIR)")
    with sole_writer(folder, _PATIENCE_S):
        for home in reversed(_entries(folder)):
            if (home / _BEGUN).exists():
                _put_back(folder, home)
            elif not (home / _LIST).exists() and ((home / _AFTER).exists() or not (home / _BEFORE).exists()):
                _discard(home)  # it never began
        for gone in _entries(folder, "*.gone"):
            shutil.rmtree(gone, ignore_errors=True)
        yield


def settle(folder: Path) -> None:
    """Put back what an interrupted change left in a campaign folder, before it is read; a DataError if it can't be."""
    if any((home / _BEGUN).exists() for home in _entries(folder)):
        try:
            with taking_turns(folder):
                pass
        except OSError as error:
            trouble = "finished changes", "an interrupted one", "open it where it can be written"
            raise refusal(str(folder), *trouble) from error


def is_vacant(folder: Path) -> bool:
    """Whether there is nothing in a folder but what is kept of changes, or no such folder."""
    settle(folder)
    return not folder.is_dir() or all(path.name in (_HOME, NAME) for path in folder.iterdir())


@contextmanager
def changing(folder: Path, what: str, check: Callable[[], None] = lambda: None) -> Iterator[Callable[[Path], Path]]:
    """Change files of a campaign folder, all of them or none, while it is one's turn.

    Yields a function that takes a file of the folder and returns the path to write its new content to; if nothing is
    written there, the file is removed. Files are replaced in the order asked for; if ``check`` then raises, put back.
    """
    home = folder / _HOME / f"{1 + max((int(home.name) for home in _entries(folder)), default=0):06d}"
    names: list[str] = []

    def new(path: Path) -> Path:
        names.append(path.relative_to(folder).as_posix())
        target = home / _AFTER / names[-1]
        target.parent.mkdir(parents=True, exist_ok=True)
        return target

    _require_inside(folder, home)
    try:
        yield new
        _begin(folder, home, what, names)
        _move(home / _AFTER, folder, names)
        check()
        (home / _BEGUN).rename(home / _LIST)
    except BaseException as error:
        name_target(error, home, folder)
        with suppress(OSError, DataError):  # the next one who opens the folder tries again
            if (home / _BEGUN).exists():
                _put_back(folder, home)
            elif not (home / _LIST).exists():
                _discard(home)
        raise
    shutil.rmtree(home / _AFTER, ignore_errors=True)
    with suppress(OSError):
        flush(home)
        for old in _entries(folder)[:-_KEPT]:
            _discard(old)


def undo(folder: Path, last: Change | None = None) -> Change:
    """Undo the last change of a campaign folder, the one that is meant; it is returned.

    A DataError leaves the folder as it is: there is none, or it or one of its files was changed since.
    """
    with taking_turns(folder):
        change = next(iter(changes(folder)), None)
        if change is None:
            raise refusal(str(folder), "a change that can be undone", "none", "nothing has to be undone")
        if last is not None and change != last:
            raise refusal(str(folder), f"“{last.what}” as last change", f"{change}", "undo that first")
        home = folder / _HOME / f"{change.number:06d}"
        _waiting(folder, home, change)
        (home / _LIST).rename(home / _BEGUN)
        _put_back(folder, home)
    return change


def sample_folder() -> Path:
    """The folder of the sample campaign, which is written first if it is not shipped."""
    if (SHIPPED / "tests.csv").is_file():
        return SHIPPED
    folder = default_folder() / "sample"
    if not (folder / "tests.csv").is_file():
        from crashfuse.synthetic.sample import write_sample

        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.parent) as scratch:
            write_sample(Path(scratch) / "sample")
            (Path(scratch) / "sample").rename(folder)  # all or nothing
    return folder


def is_sample(folder: Path) -> bool:
    """Whether a folder is the sample's or lies inside it: it is never changed."""
    folder, samples = folder.resolve(), (SHIPPED, default_folder() / "sample")
    return bool({folder, *folder.parents} & {sample.resolve() for sample in samples})


def _begin(folder: Path, home: Path, what: str, names: Sequence[str]) -> None:
    for name in names:
        _require_inside(folder, folder / name)
        if (folder / name).is_file():
            replaced = home / _BEFORE / name
            replaced.parent.mkdir(parents=True, exist_ok=True)
            try:
                os.link((folder / name).resolve(), replaced)
            except OSError:
                shutil.copy2(folder / name, replaced)
    files = tuple(ChangedFile(name, _digest(home / _BEFORE / name), _digest(home / _AFTER / name)) for name in names)
    now = datetime.now(UTC).isoformat(timespec="seconds")
    author = _author.get()
    if not author:
        with suppress(OSError, KeyError, ImportError):  # a container may have no user
            author = getpass.getuser()
    content = json.dumps(asdict(Change(int(home.name), what, now, files, author)), indent=1).encode()
    if len(content) > _LARGEST or not all(map(_is_sound, files)):
        raise refusal(str(folder), "files of a campaign", "too many, or other names", "rename or split them")
    table = next((folder / name for name in ("tests.csv", "cae.csv") if (folder / name).is_file()), None)
    for path in (home.parent, home, *home.rglob("*")):
        if path.is_dir():
            share(path, folder)
    for name in names:  # who shares the folder can read what is new in it, whatever the umask of this process
        share(home / _AFTER / name, folder / name if table is None or (folder / name).is_file() else table)
    for path in sorted(home.rglob("*"), reverse=True):  # the inner ones first
        flush(path)
    with replacing(home / _BEGUN, table) as list_of_files:
        list_of_files.write_bytes(content)
    for path in (home, home.parent, folder):
        flush(path)


def _put_back(folder: Path, home: Path) -> None:
    change = _read(home / _BEGUN)
    if change is None:
        where = f"{_HOME}/{home.name}/{_BEGUN}"
        raise refusal(where, "the list of an interrupted change", "a damaged one", _by_hand(home))
    _move(home / _BEFORE, folder, [*reversed(_waiting(folder, home, change))])
    for file in change.files:
        if "/" in file.name:
            _tidy((folder / file.name).parent)
    _discard(home)


def _move(source: Path, folder: Path, names: Sequence[str]) -> None:
    """Files that are not in ``source`` are removed from the campaign folder."""
    parents = {folder: None}
    for name in names:
        target = folder / name
        if (source / name).exists():
            if not target.parent.exists():
                target.parent.mkdir()
                share(target.parent, folder)
            (source / name).replace(target)
        else:
            target.unlink(missing_ok=True)
        parents[target.parent] = None
    for parent in reversed(parents):
        if parent != folder:
            _tidy(parent)
        if parent.is_dir():
            flush(parent)


def _waiting(folder: Path, home: Path, change: Change) -> list[str]:
    """The files that are still as a change left them."""
    waiting = []
    for file in change.files:
        kept = home / _BEFORE / file.name
        for path in (folder / file.name, kept):
            _require_inside(folder, path)
        if (now := _digest(folder / file.name)) == file.before:
            continue
        waiting.append(file.name)
        if now != file.after:
            expected = f"the file as it was after “{change.what}”"
            raise refusal(file.name, expected, "one that was changed since", _by_hand(home))
        if file.before is not None and (kept.is_symlink() or _digest(kept) != file.before):
            where, found = kept.relative_to(folder).as_posix(), "none, or a damaged one"
            raise refusal(where, "the file that was replaced", found, _by_hand(home))
    return waiting


def _by_hand(home: Path) -> str:
    kept = f"{_HOME}/{home.name}"
    return f"compare the campaign with {kept}/{_BEFORE}, put it right, then remove {kept}"


def _entries(folder: Path, names: str = "[0-9]" * 6) -> list[Path]:
    home = folder / _HOME
    return [] if home.is_symlink() else sorted(path for path in home.glob(names) if path.is_dir())


def _read(path: Path) -> Change | None:
    try:
        if path.parent.is_symlink() or path.is_symlink() or path.stat().st_size > _LARGEST:
            return None
        values = json.loads(path.read_text(encoding="utf-8"))
        files = tuple(ChangedFile(**row) for row in values["files"])
        if not all(map(_is_sound, files)) or len({file.name for file in files}) != len(files):
            return None
        what, when = printable(str(values["what"])), printable(str(values["when"]), 40)
        return Change(int(path.parent.name), what, when, files, printable(str(values.get("author", "")), 100))
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return None


def _is_sound(file: ChangedFile) -> bool:
    digests = (digest for digest in (file.before, file.after) if digest is not None)
    are_digests = all(isinstance(digest, str) and len(digest) == 64 for digest in digests)
    return are_digests and isinstance(file.name, str) and _OF_A_CAMPAIGN.fullmatch(file.name) is not None


def _require_inside(folder: Path, path: Path) -> None:
    """Behind a link to another folder lie files that may be anybody's."""
    if not path.parent.resolve().is_relative_to(folder.resolve()):
        where = path.parent.relative_to(folder).as_posix()
        raise refusal(where, "a folder in the campaign's", "a link to one elsewhere", "put files there")


def _digest(path: Path) -> str | None:
    if not path.is_file():
        return None
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _discard(home: Path) -> None:
    with suppress(OSError):  # such as one of its files being open on Windows
        home = home.rename(home.with_suffix(".gone"))
    for name in (_BEGUN, _LIST):
        (home / name).unlink(missing_ok=True)
    shutil.rmtree(home, ignore_errors=True)
    _tidy(home.parent)


def _tidy(folder: Path) -> None:
    with suppress(OSError):
        folder.rmdir()
