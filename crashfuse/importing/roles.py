"""Which files of a source are CAE runs, where tests and CAE runs lie together."""

import re
from collections import Counter
from collections.abc import Iterable, Sequence

from crashfuse.campaign_folder.columns import listed
from crashfuse.campaign_folder.condition_tables import Role
from crashfuse.errors import Problem, UsageError
from crashfuse.readers.record import quoted

_CAE = re.compile(
    r"(?<![a-z])(cae|fe[am]?|sim(ul\w*)?s?|runs?|ls-?dyna|radioss|abaqus|pam-?crash|(be)?rechnung(en)?)(?![a-z])",
    re.IGNORECASE,
)
_TEST = re.compile(r"(?<![a-z])(tests?|versuche?|essais?|nhtsa|barrier)(?![a-z])", re.IGNORECASE)
_MANY = 20  # records in one file; nobody crashes as many vehicles


def file_of(source: str) -> str:
    """The file of a record, by its source, which may be a sheet of the file."""
    return source.partition(": ")[0]


def role_of(source: str, role: Role, cae: Sequence[str]) -> Role:
    """What a record is: a CAE run if its file is among ``cae``, else what all are taken as."""
    return "cae" if file_of(source) in cae else role


def look_like_cae(sources: Iterable[str]) -> tuple[str, ...]:
    """Files that look like CAE runs, by name or number of records, beside others that do not; else none.

    Parameters
    ----------
    sources : iterable of str
        The source of each record.
    """
    files = Counter(map(file_of, sources))
    found = tuple(name for name, n in files.items() if not _TEST.search(name) and (_CAE.search(name) or n >= _MANY))
    return found if len(found) < len(files) else ()


def which_are_tests(source: str, records: Sequence[str]) -> list[Problem]:
    """The question which files are CAE runs, if some look like them and others do not; ``records`` are sources."""
    if not (found := look_like_cae(records)):
        return []
    names, others = (
        listed(found),
        listed(dict.fromkeys(name for each in records if (name := file_of(each)) not in found)),
    )
    advice = (
        f"name the files of CAE runs (--cae {' '.join(map(quoted, found))}), or say that all are tests (--as tests)"
    )
    return [Problem(source, "tests", f"what looks like CAE runs ({names}) beside {others}", advice)]


def check_names(names: Sequence[str], sources: Iterable[str]) -> None:
    """Raise a UsageError if a file that is named is none of the source's with records."""
    there = dict.fromkeys(map(file_of, sources))
    if absent := [name for name in names if name not in there]:
        raise UsageError(f"There is no file {listed(absent)} with records; there are {listed(there)}.")
