"""The foreign formats, one line each: how its files are named, what it is called, what reads it.

A new format is a module with a function that reads a path into records, and one line of :data:`FORMATS`; recognition,
``crashfuse import --format``, the messages and the page follow.
"""

import importlib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from crashfuse.campaign_folder.condition_tables import Role
    from crashfuse.readers.record import Record


@dataclass(frozen=True, slots=True)
class Format:
    """A foreign format.

    Parameters
    ----------
    label : str
        What the page and messages call it.
    files : str
        Its files, as messages name them.
    names : str
        Regular expression that the whole name of such a file matches, whatever its capitals. Of a test of many files
        it is the one that stands for the test.
    reader : str
        ``module:function``, imported when it is asked for. The function takes the path of a file, folder or zip,
        returns a tuple of :class:`~crashfuse.readers.record.Record`, and raises a DataError for whatever is unfit.
        Empty for tables: :mod:`crashfuse.importing.joined_tables` reads them, as a user may say what is in a column.
    one_a_file : bool
        Whether each of these files is one test and the reader takes no more than one.
    role : {"tests", "cae"}
        What its records most likely are.
    """

    label: str
    files: str
    names: str
    reader: str = ""
    one_a_file: bool = False
    role: "Role" = "tests"

    def has(self, path: PurePath) -> bool:
        """Whether a file is of this format by its name."""
        return re.fullmatch(self.names, path.name, re.IGNORECASE | re.DOTALL) is not None

    def read(self, path: Path) -> "tuple[Record, ...]":
        """Read the records in a file, folder or zip; a DataError says what is wrong with it."""
        module, _, function = self.reader.partition(":")
        records: tuple[Record, ...] = getattr(importlib.import_module(module), function)(path)
        return records


_HERE = "crashfuse.readers"

TABLES = "csv"
"""The format whose files may lie beside those of any other."""

FORMATS = {
    "nhtsa": Format("NHTSA", ".EV5", r".*\.ev5", f"{_HERE}.nhtsa:read_nhtsa", one_a_file=True),
    "isomme": Format("ISO-MME", ".mme", r".*\.mme", f"{_HERE}.isomme_record:read_isomme_record", one_a_file=True),
    "lsdyna": Format(
        "LS-DYNA",
        "binout, nodout",
        r"binout[^.]*|nodout[^.]*(\.(txt|asc))?",
        f"{_HERE}.lsdyna.runs:read_lsdyna",
        role="cae",
    ),
    "tdms": Format("TDMS", ".tdms", r".*\.tdms", f"{_HERE}.tdms:read_tdms"),
    TABLES: Format("tables", ".csv, .txt, .xlsx …", r".*\.(csv|tsv|txt|asc|dat|xls[xm]?)"),
}
"""Formats by their names on the command line."""


def formats_of(paths: Iterable[PurePath]) -> list[str]:
    """Names of the formats that files are of, by their own names; tables last."""
    files = list(paths)
    found = [name for name, each in FORMATS.items() if any(map(each.has, files))]
    return sorted(found, key=TABLES.__eq__)


def all_formats() -> str:
    """All formats in a line, for people: NHTSA (.EV5), ISO-MME (.mme), ...."""
    return ", ".join(f"{each.label} ({each.files})" for each in FORMATS.values())
