"""A foreign format: the names of its files, its reader, and the axes along which it may hold motion."""

import importlib
import re
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Literal, get_args

from crashfuse.errors import CrashfuseError, DataError, Problem
from crashfuse.extensions import NO_FAULTS, said

if TYPE_CHECKING:
    from crashfuse.campaign_folder.condition_tables import Role
    from crashfuse.readers.record import Record

AXES = "xyz"
Travel = Literal["x", "-x", "y", "-y", "z", "-z"]
"""A direction of travel in the file's own axes."""
TRAVELS: tuple[Travel, ...] = get_args(Travel)


@dataclass(frozen=True, slots=True)
class Format:
    """A foreign format.

    Parameters
    ----------
    label : str
        Its name on the page and in messages.
    files : str
        Its files, as named in messages.
    names : str
        Regular expression for the whole file name, case ignored. For a test with many files it matches the file that
        represents the test.
    reader : str
        ``module:function``, imported on first use. The function takes the path of a file, folder or zip, returns a
        tuple of :class:`~crashfuse.readers.record.Record`, and raises a DataError for unusable input.
        Empty for tables: :mod:`crashfuse.importing.tables` reads them, because a user may assign columns.
    one_a_file : bool
        Whether each of these files is one test and the reader takes only one.
    role : {"tests", "cae"}
        The most likely role of its records.
    package : str
        The package that adds it; empty for ours.
    axes : bool
        Whether its files may hold motion along any axis. The reader, if there is one, then takes the direction of
        travel (:data:`~crashfuse.readers.format.Travel`) as a second argument; None: to be found.
    """

    label: str
    files: str
    names: str
    reader: str = ""
    one_a_file: bool = False
    role: "Role" = "tests"
    axes: bool = False
    package: str = ""

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
