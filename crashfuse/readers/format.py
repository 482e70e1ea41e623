"""A foreign format: the names of its files, and its reader."""

import importlib
import re
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from crashfuse.errors import CrashfuseError, DataError, Problem
from crashfuse.extensions import NO_FAULTS, said
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
    reader: str = ""  # empty for tables, which crashfuse.importing.tables reads
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
            raise DataError(Problem(path.name, self.label, found.rstrip("."), "use another format")) from error
        return records
