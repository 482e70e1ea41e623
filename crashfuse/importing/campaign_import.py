"""Import of foreign files into a campaign: read, ask which are CAE runs, settle, add."""

import re
import shlex
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import permutations
from pathlib import Path
from typing import NamedTuple, get_args

import numpy as np

from crashfuse.campaign_folder.condition_tables import Role, listed
from crashfuse.campaign_folder.copies import sensors_of_one_crash
from crashfuse.campaign_folder.editing import Added, Addition, add_to_campaign
from crashfuse.campaign_folder.settings import sound_settings
from crashfuse.crash_test import TUNED
from crashfuse.errors import DataError, Problem, UsageError, as_path, one_of, refusal, refuse_all, require_a
from crashfuse.importing.detection import Choices, UnknownUnit, delta_v
from crashfuse.importing.pulse_conversion import Lacking, Settled, joint_problems, missing_values, settle
from crashfuse.importing.sources import ColumnChoice, OneCrashOrSeveral, Reading, format_of, is_archive, iter_records
from crashfuse.readers.formats import FORMATS
from crashfuse.readers.record import Record
from crashfuse.readers.vocabulary import Travel, mentions, plain, speed, words
from crashfuse.signals.pulse import GRID_S
from crashfuse.units import MS, Sentence

_CAE, _TEST = words("run"), words("test")
_MANY = 20  # records in one file; nobody crashes as many vehicles
_ONE_SPEED = 1.05  # ratio of the changes of velocity of repeats; rebounds differ
_COLUMNS = re.compile(r"--(column|id|conditions)\b")  # options that say what the columns of a table are


class Label(NamedTuple):
    """What a record is called, and says of itself."""

    source: str
    id: str
    is_simulated: bool = False

    @classmethod
    def of(cls, record: Record) -> "Label":
        """The label of a record."""
        return cls(record.source, record.id, record.is_simulated)

    @property
    def file(self) -> str:
        """The file of the source, which may be a sheet of it."""
        return self.source.partition(": ")[0]

    def looks_like_cae(self, *, many: bool) -> bool:
        """By its own account, its sheet and id, else its file or their number."""
        is_cae, is_test = _named_as(f"{self.source.partition(': ')[2]} {self.id}")
        if self.is_simulated or is_cae != is_test:
            return self.is_simulated or is_cae
        is_cae, is_test = _named_as(self.file)
        return not is_test and (is_cae or many)


def _named_as(name: str) -> tuple[bool, bool]:
    text = plain(name)
    return _CAE.search(text) is not None or mentions(name, "simulation"), _TEST.search(text) is not None


def role_of(record: Record, role: Role, cae: Sequence[str]) -> Role:
    """A CAE run if its file, source or id is among ``cae``."""
    return "cae" if {Label.of(record).file, record.source, record.id} & set(cae) else role


def parts_of(records: Iterable[Label]) -> dict[str, bool]:
    """The parts of a source, and whether they look like CAE runs: files, or records of files with both."""
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


def _require_tests(source: str, records: Sequence[Label], usual: Role) -> None:
    parts = parts_of(records) if usual == "tests" else dict.fromkeys((label.file for label in records), True)
    runs = [name for name, is_cae in parts.items() if is_cae]
    simulated = [label.is_simulated for label in records]
    if not runs or all(simulated):
        return
    others = listed([name for name in parts if name not in runs])
    advice = f"name those that are (--cae {shlex.join(runs)})" if others else "say that they are (--as cae)"
    advice += ", or give --as tests" * (not others or not any(simulated))  # what is simulated by itself is no test
    found = f"what looks like CAE runs ({listed(runs)}){f' beside {others}' if others else ''}"
    raise refusal(source, "tests", found, advice)


def import_source(
    source: str | Path,
    out: str | Path,
    choices: Choices = Choices(),
    *,
    role: Role | None = None,
    cae: Sequence[str] = (),
    fmt: str | None = None,
    record_id: str | None = None,
    columns: Sequence[ColumnChoice] = (),
    conditions: str | Path | None = None,
    travel: Travel | None = None,
    cae_tuned: bool | None = None,
) -> tuple[Settled, ...]:
    """Add everything in a source to a campaign, or start a new one with it: all of it or, on any problem, nothing.

    Returns the records added, with the steps that led to them; not those that were there already. A DataError has every
    problem of every record.

    Parameters
    ----------
    source, fmt, columns, conditions, record_id, travel
        See :class:`crashfuse.importing.sources.Reading`; with a ``record_id`` columns are channels of one record.
    out : path
        The campaign folder. If its ``campaign.toml`` sets ``channel_filter_class``, records are added raw and uncut, to
        be filtered when the campaign is read.
    choices : Choices
        Settings for every record that replace detection.
    role : {"tests", "cae"}, optional
        What the records are. By default tests, which is asked if some files look like CAE runs, or all do.
    cae : sequence of str
        Files in the source, or ids, whose records are CAE runs, whatever the others are.
    cae_tuned : bool, optional
        Whether the CAE model was tuned to the tests; by default what a column ``cae_tuned`` says.
    """
    source, out = as_path(source, "the source"), as_path(out, "the campaign folder")
    conditions = None if conditions is None else Path(conditions)
    require_a(Choices, choices, "crashfuse.Choices()")
    cfc = sound_settings(out).channel_filter_class
    if cfc is not None and choices.channel_filter_class not in (None, cfc):
        raise UsageError(f"The campaign filters every record with CFC {cfc:g}; remove --channel-filter-class.")
    one_of("kind of record", role or "tests", dict.fromkeys(get_args(Role)))
    together = record_id is not None or bool(choices.channels)
    reading = Reading(source, fmt, tuple(columns), together, conditions, record_id, travel)
    problems, labels = list[Problem](), list[Label]()

    def labelled() -> Iterator[Record]:
        for record in iter_records(reading, problems):
            labels.append(Label.of(record))
            yield record

    settled: tuple[Settled, ...] = ()
    try:
        settled = settle_each(labelled(), problems, choices, role=role or "tests", cae=cae, raw=cfc is not None)
    except OneCrashOrSeveral as error:
        problems = list(error.problems)  # what each column lacks as a crash of its own is no question yet
        if role != "cae" and not cae and all(label.is_simulated for label in labels):
            found, advice = "simulated ones", "import them as CAE runs (--as cae)"
            problems.append(Problem(source.name, "measured accelerations", found, advice))
    except DataError as error:
        problems = [*error.problems, *problems]
    there = {name for label in labels for name in (label.file, label.source, label.id)}
    if absent := [name for name in cae if name not in there]:
        parts = dict.fromkeys([*(label.file for label in labels), *parts_of(labels)])
        raise UsageError(f"There is no file {listed(absent)} with records; there are {listed(parts)}.")
    if role is None and not cae and labels:
        # what each lacks as a test may be no question then
        _require_tests(source.name, labels, FORMATS[fmt or format_of(source)].role)
    alone = source.is_file() and not is_archive(source.name) and conditions is None
    if alone and any(_COLUMNS.search(problem.advice) for problem in problems):
        # the condition of a single table can only be given: ask for it along with its columns, and once
        problems = [problem for problem in problems if not isinstance(problem, Lacking)]
        problems += missing_values(source.name, record_id or source.stem, choices.stated)
    refuse_all(problems, source.name)
    added = {(part.role, run_id) for part in add_settled(out, settled, cae_tuned) for run_id in part.ids}
    return tuple(one for one in settled if (one.role, one.id) in added)


def settle_each(
    records: Iterable[Record],
    problems: list[Problem],
    choices: Choices = Choices(),
    *,
    role: Role = "tests",
    cae: Sequence[str] = (),
    raw: bool = False,
    tolerant: bool = False,
) -> tuple[Settled, ...]:
    """Settle all records that can be, append problems of others; ``tolerant``: of invalid choices, too."""
    settled, unclear = dict[int, Settled](), dict[int, Record]()
    refused, ids = list[Problem](), list[str]()

    def attempt(place: int, record: Record) -> None:
        try:
            settled[place] = settle(record, choices, role=role_of(record, role, cae), raw=raw)
        except DataError as error:
            if place not in unclear and any(isinstance(problem, UnknownUnit) for problem in error.problems):
                unclear[place] = record
            else:
                refused.extend(_named(record, problem) for problem in error.problems)
        except UsageError as error:
            if not tolerant:
                raise
            refused.append(Problem(record.source, f"choices that fit {record.id}", error.args[0], "choose otherwise"))

    for place, record in enumerate(records):
        ids.append(record.id)
        attempt(place, record)
    others = tuple(settled.values())
    for place, record in unclear.items():
        attempt(place, _in_their_unit(record, others))
    problems += joint_problems(refused) if len(ids) > 1 else refused
    given_once = choices.condition.speed_mps is not None
    whole = _of_one_crash([settled[place] for place in sorted(settled)], given_once=given_once)
    if not given_once:
        return whole
    changes = [abs(delta_v(one.pulse.time_s, one.pulse.accel_mps2)) for one in whole] or [0.0]
    template = f"Careful: one speed for all {len(whole)} records, but changes of velocity of {{}}."
    notes = [Sentence(template, speed(min(changes), max(changes)))] * (max(changes) > _ONE_SPEED * min(changes))
    return tuple(replace(one, steps=(*one.steps, *notes)) for one in whole)


def _in_their_unit(record: Record, others: Sequence[Settled]) -> Record:
    units = [one.unit for one in others if one.source == record.source] or [one.unit for one in others]
    if len(set(units)) != 1:
        return record
    by = f"{len(units)} records beside it"
    channels = (one if one.unit else replace(one, unit=units[0], unit_from=by) for one in record.channels)
    return replace(record, channels=tuple(channels))


def _of_one_crash(settled: Sequence[Settled], *, given_once: bool) -> tuple[Settled, ...]:
    tests = [one for one in settled if one.role == "tests"]
    accel = np.array([np.interp(GRID_S, one.pulse.time_s, one.pulse.accel_mps2, right=0.0) for one in tests])
    ids, conditions, about = [one.id for one in tests], [one.condition for one in tests], [one.about for one in tests]
    others: dict[str, list[str]] = {}
    for *pair, share in sensors_of_one_crash(ids, conditions, accel, about, given_once=given_once):
        for one, other in permutations(ids[int(place)] for place in pair):
            others.setdefault(one, []).append(f"{other} (alike to {100 * share:.0f} %)")
    told = "Careful: at one condition with {}; import one of them if they are sensors of one crash."
    notes = {name: (told.format(listed(alike)),) for name, alike in others.items()}
    return tuple(replace(one, steps=(*one.steps, *notes.get(one.id, ()))) for one in settled)


def add_settled(out: Path, settled: Sequence[Settled], cae_tuned: bool | None = None) -> tuple[Added, ...]:
    """Add settled records to a campaign, or start a new one with them: all or, on any problem, none."""
    additions: dict[Role, list[Addition]] = {}
    for one in settled:
        tuned = [("cae_tuned", TUNED[cae_tuned])] if cae_tuned is not None and one.role == "tests" else []
        addition = Addition(one.id, one.condition, one.pulse, _entry(one), one.quality, (*tuned, *one.about), one.wall)
        additions.setdefault(one.role, []).append(addition)
    return add_to_campaign(out, additions)


def _named(record: Record, problem: Problem) -> Problem:
    is_named = re.search(rf"(?<!\w){re.escape(record.id)}(?!\w)", f"{problem.where} {problem.expected}")
    return problem if is_named else replace(problem, where=f"{problem.where}, {record.id}")


def _entry(settled: Settled) -> dict[str, str | float | Sequence[str]]:
    cfc = "none" if settled.channel_filter_class is None else settled.channel_filter_class
    entry = {name: getattr(settled, name) for name in ("source", "channels", "unit", "deceleration_sign")}
    return entry | {"time_zero_ms": settled.time_zero_s / MS, "channel_filter_class": cfc, "steps": settled.steps}
