"""Which files of a source are CAE runs, where nobody has said it."""

import re
import shlex
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from crashfuse.campaign_folder.columns import listed
from crashfuse.campaign_folder.condition_tables import Role
from crashfuse.errors import Problem, UsageError
from crashfuse.readers.credibility import names_a_simulation
from crashfuse.readers.record import Record

_CAE = re.compile(r"(?<![a-z])runs?(?![a-z])", re.IGNORECASE)
_TEST = re.compile(
    r"(?<![a-z])(tests?|versuche?|essais?|measure(d|ments?)|messung(en)?|gemessen|nhtsa|barrier)(?![a-z])",
    re.IGNORECASE,
)
_MANY = 20  # records in one file; nobody crashes as many vehicles


class Label(NamedTuple):
    """What tells whether a record is a test or a CAE run: its source, its id, and what it says of itself."""

    source: str
    id: str
    is_simulated: bool = False

    @classmethod
    def of(cls, record: Record) -> "Label":
        """The label of a record."""
        return cls(record.source, record.id, record.is_simulated)

    @property
    def file(self) -> str:
        """The file, by the source, which may be a sheet of the file."""
        return self.source.partition(": ")[0]

    def looks_like_cae(self, *, many: bool) -> bool:
        """Whether it looks like a CAE run, by its own account, its sheet and id, or else its file or their number."""
        name = f"{self.source.partition(': ')[2]} {self.id}"
        if self.is_simulated or _is_named_cae(name) != _is_named_test(name):
            return self.is_simulated or _is_named_cae(name)
        return not _is_named_test(self.file) and (_is_named_cae(self.file) or many)


def role_of(record: Record, role: Role, cae: Sequence[str]) -> Role:
    """What a record is: a CAE run if its file, source or id is among ``cae``, else what all are taken as."""
    return "cae" if {Label.of(record).file, record.source, record.id} & set(cae) else role


def parts_of(records: Iterable[Label]) -> dict[str, bool]:
    """The parts of a source by their names, and whether they look like CAE runs.

    A part is a file, or if not all in it are alike, a record by its id, or by its source if the id occurs twice.
    """
    files: dict[str, list[Label]] = {}
    for record in records:
        files.setdefault(record.file, []).append(record)
    parts: dict[str, bool] = {}
    for file, labels in files.items():
        looks = [label.looks_like_cae(many=len(labels) >= _MANY) for label in labels]
        ids = Counter(label.id for label in labels)
        names = [label.id if ids[label.id] == 1 else label.source for label in labels]
        parts |= {file: looks[0]} if len(set(looks)) == 1 else dict(zip(names, looks, strict=True))
    return parts


def _is_named_cae(name: str) -> bool:
    return _CAE.search(name) is not None or names_a_simulation(name)


def _is_named_test(name: str) -> bool:
    return _TEST.search(name) is not None


def which_are_tests(source: str, records: Sequence[Label], usual: Role) -> list[Problem]:
    """The question which files are CAE runs, if any look like them; none if all say so themselves.

    Parameters
    ----------
    source : str
        Its name.
    records : sequence of Label
    usual : {"tests", "cae"}
        What files of this format are.
    """
    if records and all(label.is_simulated for label in records):
        return []
    parts = parts_of(records) if usual == "tests" else dict.fromkeys((label.file for label in records), True)
    found = [name for name, is_cae in parts.items() if is_cae]
    if not found:
        return []
    names, others = listed(found), listed([name for name in parts if name not in found])
    if not others:
        advice = "say that they are (--as cae), or that they are tests (--as tests)"
        return [Problem(source, "tests", f"nothing but what looks like CAE runs ({names})", advice)]
    advice = f"name those that are CAE runs (--cae {shlex.join(found)})"
    if not any(label.is_simulated for label in records):
        advice += ", or say that all are tests (--as tests)"
    return [Problem(source, "tests", f"what looks like CAE runs ({names}) beside {others}", advice)]


def check_names(names: Sequence[str], records: Sequence[Label]) -> None:
    """Raise a UsageError if something that is named is no file or record of the source."""
    there = {name for label in records for name in (label.file, label.source, label.id)}
    if absent := [name for name in names if name not in there]:
        parts = dict.fromkeys([*(label.file for label in records), *parts_of(records)])
        raise UsageError(f"There is no file {listed(absent)} with records; there are {listed(parts)}.")
