"""Foreign files as an import would take them, before anything is added."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Unpack, get_args

from crashfuse import views
from crashfuse.campaign_folder.condition_tables import Role
from crashfuse.errors import Problem, as_path, one_of, require_a
from crashfuse.importing import ColumnChoice, Reading, Settled, read_records, settle_each
from crashfuse.importing.detection import Choices
from crashfuse.readers.record import Record
from crashfuse.readers.vocabulary import Travel
from crashfuse.results.display import Display, DisplayOptions
from crashfuse.results.drawing import Drawing
from crashfuse.results.plots.pulses import imported_pulse
from crashfuse.results.render.text import card
from crashfuse.results.table import Column, Table
from crashfuse.units import MS, counted


@dataclass(frozen=True, eq=False, repr=False)
class Preview:
    """A record of foreign files, and what comes of it."""

    record: Record
    choices: Choices
    settled: Settled | None  # with every step from the record to it; None if there are problems
    problems: tuple[Problem, ...] = ()  # what has to be given or corrected first

    def draw(self, **display: Unpack[DisplayOptions]) -> Drawing:
        """The pulse over its channels; with problems the channels alone, as they are in the file."""
        known = {channel.name: channel for channel in self.record.channels}
        names = self.settled.channels if self.settled is not None else self.choices.channels or self.record.proposed
        channels = [known[name] for name in names if name in known] or self.record.channels
        return imported_pulse(channels, self.settled, Display.of(**display))

    plot = views.as_plotly(draw)
    """The same as a Plotly figure."""

    def __repr__(self) -> str:
        comes = counted(len(self.problems), "problem") if self.settled is None else str(self.settled.condition)
        return f"<Preview of {self.record.id!r}: {comes}>"

    def _repr_html_(self) -> str:
        if (own := self.settled) is None:
            rows = ({"Channel": channel.shown, "Unit": channel.unit or ""} for channel in self.record.channels)
            title = f"{self.record.id}: not yet to be imported"
            return card(title, Table.of("channels", rows), [*map(str, self.problems)])
        row = {
            "Channels": ", ".join(own.channels),
            "Unit": own.unit,
            "Deceleration": own.deceleration_sign,
            "Time zero": own.time_zero_s / MS,
            "Filtered here": "none" if own.channel_filter_class is None else f"CFC {own.channel_filter_class:g}",
        }
        zero = Column("Time zero", "number", "ms", ".4g")
        return card(f"{own.id}: {own.condition}", Table.of("preview", [row], zero), own.steps)


def preview_source(
    source: str | Path,
    choices: Choices = Choices(),
    *,
    role: Role = "tests",
    fmt: str | None = None,
    record_id: str | None = None,
    columns: Sequence[ColumnChoice] = (),
    conditions: str | Path | None = None,
    travel: Travel | None = None,
) -> tuple[Preview, ...]:
    """What :func:`crashfuse.import_source` would add with the same arguments, one preview a record."""
    one_of("kind of record", role, dict.fromkeys(get_args(Role)))
    require_a(Choices, choices, "crashfuse.Choices()")
    together = record_id is not None or bool(choices.channels)
    table = None if conditions is None else Path(conditions)
    reading = Reading(as_path(source, "the source"), fmt, tuple(columns), together, table, record_id, travel)
    previews = []
    for record in read_records(reading):
        problems: list[Problem] = []
        settled = settle_each([record], problems, choices, role=role)
        previews.append(Preview(record, choices, settled[0] if settled else None, tuple(problems)))
    return tuple(previews)
