"""The folder that a command writes its results to: looked at before anything is computed.

A folder holds results of one kind. Once new ones are written, what older ones of the same kind had beyond them (speed
groups that the new study was not asked for, say) is removed, so that nothing stale lies beside what is new. Results of
another kind are never touched: the command refuses their folder.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from crashfuse.errors import UsageError

_KINDS = {
    "series of studies": ("studies.csv", ()),
    "study": ("study.json", ("scores.csv", "speed_groups.csv", "pulses.csv", "metrics.csv", "report.html")),
    "prediction": ("prediction.json", ("pulses.csv", "pulses.parquet", "metrics.csv", "report.html", "isomme/**/*")),
    "sweep": ("sweep.csv", ("report.html",)),
    "ranking of next tests": ("next_tests.csv", ("report.html",)),
}
"""Each kind of result: the file that it is known by, and patterns of what else belongs to it."""


def require_output(out: Path, campaign: Path, kind: str | None = None) -> None:
    """Refuse a folder that results of this kind cannot or should not be written to.

    Raises
    ------
    UsageError
        If it is a campaign, lies in the campaign, holds results of another kind, or cannot be written.
    """
    if out.resolve().is_relative_to(campaign.resolve()):
        raise UsageError(
            f"Results do not belong in the campaign folder {campaign}; name a folder outside it for --out."
        )
    if any((out / table).exists() for table in ("tests.csv", "cae.csv")):
        raise UsageError(f"{out} is a campaign folder; name another for --out.")
    for other, (mark, _) in _KINDS.items():
        if kind not in (None, other) and (out / mark).exists():
            raise UsageError(f"{out} holds a {other} ({mark}); name another folder for the {kind}.")
    there = next(path for path in (out.resolve(), *out.resolve().parents) if path.exists())
    if not there.is_dir():
        raise UsageError(f"{there} is a file, not a folder; name another folder for --out.")
    if not os.access(there, os.W_OK | os.X_OK):
        raise UsageError(f"Nothing can be written to {there}; name another folder for --out.")


@contextmanager
def replacing(out: Path, kind: str) -> Iterator[None]:
    """Write results of this kind in this context; what it leaves as it was of older ones is removed at its end."""
    mark, parts = _KINDS[kind]
    older = [path for part in parts for path in out.glob(part) if path.is_file()] if (out / mark).is_file() else []
    stamps = {path: path.stat() for path in older}
    yield
    for path, stamp in stamps.items():
        if path.exists() and (path.stat().st_ino, path.stat().st_mtime_ns) == (stamp.st_ino, stamp.st_mtime_ns):
            path.unlink()
