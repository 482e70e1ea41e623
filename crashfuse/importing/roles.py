"""Which files of a source are CAE runs, where nobody has said it."""

import re
import shlex
from collections import Counter
from collections.abc import Iterable, Sequence

from crashfuse.campaign_folder.columns import listed
from crashfuse.campaign_folder.condition_tables import Role
from crashfuse.errors import Problem, UsageError

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


def look_like_cae(sources: Iterable[str], simulated: Iterable[str] = ()) -> tuple[str, ...]:
    """Files that look like CAE runs, by name or number of records; ``sources`` has that of each record.

    Those in ``simulated`` say so themselves, whatever their name.
    """
    files, certain = Counter(map(file_of, sources)), set(map(file_of, simulated))
    return tuple(
        name
        for name, n in files.items()
        if name in certain or (not _TEST.search(name) and (_CAE.search(name) or n >= _MANY))
    )


def which_are_tests(source: str, records: Sequence[str], usual: Role) -> list[Problem]:
    """The question which files are CAE runs, if any look like them.

    Parameters
    ----------
    source : str
        Its name.
    records : sequence of str
        The source of each record.
    usual : {"tests", "cae"}
        What files of this format are.
    """
    files = tuple(dict.fromkeys(map(file_of, records)))
    found = files if usual == "cae" else look_like_cae(records)
    if not found:
        return []
    names, others = listed(found), listed([name for name in files if name not in found])
    if not others:
        advice = "say that they are (--as cae), or that they are tests (--as tests)"
        return [Problem(source, "tests", f"nothing but what looks like CAE runs ({names})", advice)]
    advice = f"name the files of CAE runs (--cae {shlex.join(found)}), or say that all are tests (--as tests)"
    return [Problem(source, "tests", f"what looks like CAE runs ({names}) beside {others}", advice)]


def check_names(names: Sequence[str], sources: Iterable[str]) -> None:
    """Raise a UsageError if a file that is named is none of the source's with records."""
    there = dict.fromkeys(map(file_of, sources))
    if absent := [name for name in names if name not in there]:
        raise UsageError(f"There is no file {listed(absent)} with records; there are {listed(there)}.")
