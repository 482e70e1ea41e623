"""Foreign files into a campaign: read, settle, add.

>>> from crashfuse.importing import Choices, import_source
>>> import_source(Path("v10146"), Path("camry"))                                  # doctest: +SKIP
>>> import_source(Path("v10146"), Path("camry"), Choices(channels=("93", "94")))  # doctest: +SKIP
"""

import tomllib
from collections.abc import Sequence
from pathlib import Path

from crashfuse.campaign_folder.writer import Addition, add_to_campaign
from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.execution.cache import Cache
from crashfuse.files.archive import refuse
from crashfuse.importing.choices import Choices, Role
from crashfuse.importing.draft import named
from crashfuse.importing.joined_tables import ColumnChoice
from crashfuse.importing.settle import Settled, settle
from crashfuse.importing.sources import Format, each_record, format_of, read_records
from crashfuse.units import MS

__all__ = [
    "Choices",
    "ColumnChoice",
    "Format",
    "Role",
    "Settled",
    "add_settled",
    "format_of",
    "import_source",
    "own_filter_class",
    "read_records",
    "settle",
]


def import_source(
    source: Path,
    out: Path,
    choices: Choices = Choices(),
    *,
    role: Role = "tests",
    fmt: Format | None = None,
    record_id: str | None = None,
    columns: Sequence[ColumnChoice] = (),
    conditions: Path | None = None,
) -> tuple[Settled, ...]:
    """Add everything in a source to a campaign, or begin one with it: all of it or, if anything is wrong, nothing.

    Parameters
    ----------
    source : Path
        A file, a folder of one test or of several, or a zip.
    out : Path
        The campaign folder. If its ``campaign.toml`` sets ``channel_filter_class``, records go in raw and whole, to be
        filtered with the others when the campaign is read; else they are filtered here.
    choices : Choices
        What is not to be left to be detected; it holds for every record of the source.
    role : {"tests", "cae"}
    fmt : Format, optional
        By default what the names in the source say.
    record_id : str, optional
        Id for the one record in the source; columns of a table are then channels of one record.
    columns, conditions
        See :func:`read_records`.

    Returns
    -------
    tuple of Settled
        What was added, each with the steps that led to it; ``campaign.toml`` tells them, too.

    Raises
    ------
    DataError
        With every problem of every record; the campaign is as it was.
    UsageError
        If a choice does not exist.
    """
    together = record_id is not None or bool(choices.channels)
    own = own_filter_class(out)
    if own is not None and choices.channel_filter_class not in (None, own):
        raise UsageError(f"The campaign filters every record with CFC {own:g}; leave the class to it.")
    raw = own is not None
    settled: list[Settled] = []
    problems: list[Problem] = []
    for record in each_record(
        source, problems, fmt, columns=columns, together=together, conditions=conditions, record_id=record_id
    ):
        try:
            settled.append(settle(record, choices, role=role, raw=raw))
        except DataError as error:
            problems += [named(record, problem) for problem in error.problems]
    refuse(problems, source.name)
    add_settled(out, settled, role=role)
    return tuple(settled)


def add_settled(out: Path, settled: Sequence[Settled], *, role: Role = "tests") -> None:
    """Add settled records to a campaign, or begin one with them: all of them or, if anything is wrong, none.

    Parameters
    ----------
    out : Path
        The campaign folder; for one that filters its records itself (:func:`own_filter_class`) they are settled raw.
    settled : sequence of Settled
    role : {"tests", "cae"}

    Raises
    ------
    DataError
        If an id is there already or cannot name a file; the campaign is as it was.
    OSError
        If it cannot be written.
    """
    additions = [Addition(one.id, one.condition, one.pulse, _told(one)) for one in settled]
    with Cache().alone("campaign", {"folder": str(out.resolve())}):  # of two that add to its table, one comes second
        add_to_campaign(out, role, additions)


def own_filter_class(folder: Path) -> float | None:
    """The class with which a campaign filters all its records when it is read; None if it does not.

    Raises
    ------
    DataError
        If its ``campaign.toml`` is unsound.
    """
    path = folder / "campaign.toml"
    try:
        settings = tomllib.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise DataError(Problem(path.name, "a TOML file in UTF-8", str(error), "correct the file first")) from None
    own = settings.get("channel_filter_class", "none")
    return None if own == "none" else own


def _told(settled: Settled) -> dict[str, str | float | Sequence[str]]:
    """What campaign.toml says of a record."""
    cfc = settled.channel_filter_class
    return {
        "source": settled.source,
        "channels": settled.channels,
        "unit": settled.unit,
        "braking": settled.braking,
        "time_zero_ms": settled.time_zero_s / MS,
        "channel_filter_class": "none" if cfc is None else cfc,
        "steps": settled.steps,
    }
