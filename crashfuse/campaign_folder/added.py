"""What was added to a campaign folder, in words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from crashfuse.campaign_folder.condition_tables import Role
from crashfuse.errors import printable

WHAT: Mapping[Role, tuple[str, str]] = {"tests": ("test", "tests"), "cae": ("CAE run", "CAE runs")}
"""One and many of each role, in words."""
_NAMED = 5  # ids


@dataclass(frozen=True, slots=True)
class Added:
    """What an addition came to: the ids that are new, and those that were there already, with the same pulse."""

    role: Role
    ids: tuple[str, ...]
    there: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Such as ``Added: 2 tests (T12, T13); 3 were there already``."""
        told = f"Added: {counted(len(self.ids), self.role)} ({named(self.ids)})"
        count = len(self.there)
        return told + (f"; {count} {'was' if count == 1 else 'were'} there already" if count else "")


def counted(number: int, role: Role) -> str:
    """A count of tests or CAE runs as text."""
    return f"{number:,} {WHAT[role][number != 1]}"


def named(ids: Sequence[str]) -> str:
    """Ids as text, the first and the last of many."""
    shown = [printable(run_id, 60) for run_id in (ids if len(ids) <= _NAMED else [ids[0], ids[-1]])]
    return (", " if len(ids) <= _NAMED else " to ").join(shown)
