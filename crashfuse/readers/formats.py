"""The foreign formats: file names, label and reader of each.

A new format needs a module with a function that reads a path into records, and one line in :data:`_OURS`; detection,
``crashfuse import --format``, the messages and the page use that line. Formats of other packages are imported with it.
"""

import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import PurePath

from crashfuse.extensions import Extended
from crashfuse.readers.format import Format

_HERE = "crashfuse.readers"

TABLES = "csv"  # the format whose files may accompany those of any other format

_OURS = {
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
}


def _checked(_: str, found: object, package: str) -> Format:
    if not isinstance(found, Format):
        raise ValueError("expected a crashfuse.readers.format.Format")
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
