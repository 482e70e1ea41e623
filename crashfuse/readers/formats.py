"""The foreign formats: file names, label and reader of each.

A new format needs a module with a function that reads a path into records, and one line in :data:`_OURS`; detection,
``crashfuse import --format``, the messages and the page use that line. Formats of other packages are imported with it.
"""

import importlib
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from crashfuse.errors import CrashfuseError, refusal
from crashfuse.extensions import NO_FAULTS, Extended, said
from crashfuse.readers.vocabulary import Travel

if TYPE_CHECKING:
    from crashfuse.campaign_folder.condition_tables import Role
    from crashfuse.readers.record import Record


@dataclass(frozen=True, slots=True)
class Format:
    """A foreign format.

    ``names`` is a regular expression for the whole file name, case ignored; for a test with many files it matches the
    one that represents the test. ``reader`` is ``module:function``, imported on first use: the function takes the path
    of a file, folder or zip (and with ``axes`` the direction of travel, or None), returns a tuple of
    :class:`~crashfuse.readers.record.Record`, and raises a DataError for unusable input.
    """

    label: str  # on the page and in messages
    files: str  # its files, as named in messages
    names: str
    reader: str = ""  # empty for tables, which crashfuse.importing.sources reads
    one_a_file: bool = False  # each of these files is one test, and the reader takes only one
    role: "Role" = "tests"  # the likeliest of its records
    axes: bool = False  # its files may hold motion along any axis
    package: str = ""  # that adds it; empty for ours

    def has(self, path: PurePath) -> bool:
        """Whether the name of a file is of this format."""
        return re.fullmatch(self.names, path.name, re.IGNORECASE | re.DOTALL) is not None

    def read(self, path: Path, travel: Travel | None = None) -> "tuple[Record, ...]":
        """Read the records in a file, folder or zip; raise a DataError if it is unusable."""
        module, _, function = self.reader.partition(":")
        try:
            read = getattr(importlib.import_module(module), function)
            records: tuple[Record, ...] = read(path, *([travel] if self.axes else []))
        except BaseException as error:
            if not self.package or isinstance(error, (CrashfuseError, OSError, *NO_FAULTS)):
                raise
            found = f"the reader of the package {self.package} failed: {said(error)}"
            raise refusal(path.name, self.label, found.rstrip("."), "use another format") from error
        return records


_HERE = "crashfuse.readers"

TABLES = "csv"  # the format whose files may accompany those of any other format

_LSDYNA = r"(.+\.)?(binout[^.]*|nodout[^.]*(\.(txt|asc))?)"
_RADIOSS = r"(?!.*(nodout|binout|glstat)).*[^.]T\d\d[a-i]?|.+_\d{4}(_[a-i])?\.thy"
_OURS = {
    "nhtsa": Format("NHTSA", ".EV5", r".*\.ev5", f"{_HERE}.nhtsa:read_nhtsa", one_a_file=True),
    "isomme": Format("ISO-MME", ".mme", r".*\.mme", f"{_HERE}.isomme:read_isomme_record", one_a_file=True),
    "lsdyna": Format("LS-DYNA", "binout, nodout", _LSDYNA, f"{_HERE}.lsdyna:read_lsdyna", role="cae", axes=True),
    "radioss": Format("Radioss", "T01 or its .csv", _RADIOSS, f"{_HERE}.radioss:read_radioss", role="cae", axes=True),
    "tdms": Format("TDMS", ".tdms", r".*\.tdms", f"{_HERE}.tdms:read_tdms"),
    TABLES: Format("tables", ".csv, .txt, .lvm, .xlsx …", r".*\.(csv|tsv|txt|asc|dat|rpt|lvm|xls[xm]?)", axes=True),
}


def _checked(_: str, found: object, package: str) -> Format:
    if not isinstance(found, Format):
        raise ValueError("expected a crashfuse.readers.formats.Format")
    re.compile(found.names)
    return replace(found, package=package)


FORMATS = Extended(_OURS, "crashfuse.readers", "reader", _checked)
"""All formats by their command-line names; those that other packages add come last."""


def formats_of(paths: Iterable[PurePath]) -> list[str]:
    """The formats found among files, judged by file name; tables last."""
    files = list(paths)
    return sorted((name for name, each in FORMATS.items() if any(map(each.has, files))), key=TABLES.__eq__)


def all_formats() -> str:
    """All formats in one line, for display: NHTSA (.EV5), ISO-MME (.mme), ...."""
    return ", ".join(f"{each.label} ({each.files})" for each in FORMATS.values())
