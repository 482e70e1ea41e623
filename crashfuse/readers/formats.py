"""The foreign formats: file names, label and reader of each.

A new format needs a module with a function that reads a path into records, and one line in :data:`FORMATS`; detection,
``crashfuse import --format``, the messages and the page use that line. Formats of other packages are imported with it.
"""

import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import PurePath

from crashfuse.extensions import Broken, load
from crashfuse.readers.format import Format

_HERE = "crashfuse.readers"

TABLES = "csv"  # the format whose files may accompany those of any other format

FORMATS = {
    "nhtsa": Format("NHTSA", ".EV5", r".*\.ev5", f"{_HERE}.nhtsa:read_nhtsa", one_a_file=True),
    "isomme": Format("ISO-MME", ".mme", r".*\.mme", f"{_HERE}.isomme:read_isomme_record", one_a_file=True),
    "lsdyna": Format(
        "LS-DYNA",
        "binout, nodout",
        r"(.+\.)?(binout[^.]*|nodout[^.]*(\.(txt|asc))?)",
        f"{_HERE}.lsdyna:read_lsdyna",
        role="cae",
        axes=True,
    ),
    "radioss": Format(
        "Radioss",
        "T01 or its .csv",
        r"(?!.*(nodout|binout|glstat)).*[^.]T\d\d[a-i]?|.+_\d{4}(_[a-i])?\.thy",
        f"{_HERE}.radioss:read_radioss",
        role="cae",
        axes=True,
    ),
    "tdms": Format("TDMS", ".tdms", r".*\.tdms", f"{_HERE}.tdms:read_tdms"),
    TABLES: Format("tables", ".csv, .txt, .lvm, .xlsx …", r".*\.(csv|tsv|txt|asc|dat|rpt|lvm|xls[xm]?)", axes=True),
}  # the formats by their command-line names; those that other packages add (``crashfuse.readers``) come last


def _checked(name: str, found: object) -> Format:
    if not isinstance(found, Format):
        raise ValueError("expected a crashfuse.readers.format.Format")
    if name in FORMATS:
        raise ValueError("crashfuse has a format of this name")
    re.compile(found.names)
    return found


BROKEN_FORMATS: dict[str, str] = {}  # formats of other packages that cannot be used: whose fault that is, and why

for _loaded in load("crashfuse.readers", "reader", _checked):
    if isinstance(_loaded, Broken):
        BROKEN_FORMATS[_loaded.name] = _loaded.sentence
    else:
        FORMATS[_loaded[0]] = replace(_loaded[1], package=_loaded[2])


def formats_of(paths: Iterable[PurePath]) -> list[str]:
    """The formats found among files, judged by file name; tables last."""
    files = list(paths)
    return sorted((name for name, each in FORMATS.items() if any(map(each.has, files))), key=TABLES.__eq__)


def all_formats() -> str:
    """All formats in one line, for display: NHTSA (.EV5), ISO-MME (.mme), ...."""
    return ", ".join(f"{each.label} ({each.files})" for each in FORMATS.values())
