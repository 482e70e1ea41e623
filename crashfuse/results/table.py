"""A table of results as data: numbers, and what has to be known of each column to show them.

Units, sign and words are chosen by whoever renders it, from a :class:`~crashfuse.results.display.Display`.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, Self

import numpy as np
import pandas as pd

from crashfuse import views
from crashfuse.condition import Condition
from crashfuse.results.display import DEFAULT, Display
from crashfuse.signals.rating import grade, rating_text
from crashfuse.units import LB, MPH, interval_texts, number, probability_text, unbroken

Kind = Literal[
    "text", "number", "spread", "share", "interval", "range", "estimate", "difference", "pair", "grade", "probability"
]
VAGUE = "[–]"  # in place of an interval that says nothing
PARTS: Mapping[str, tuple[str, ...]] = {
    "interval": ("", " lower", " upper"),
    "grade": ("", " grade"),
    "pair": ("", " test", " difference"),
}
"""Ends of the headings of a kind's columns where each number has its own."""


class Cell(NamedTuple):
    """A cell as shown: its value; what stands behind that, such as an interval; both in :data:`PARTS`."""

    value: str
    detail: str = ""
    parts: tuple[str, ...] = ()
    is_marked: bool = False

    @property
    def text(self) -> str:
        """All of it."""
        return f"{self.value} {self.detail}" if self.detail else self.value

    @property
    def unbroken(self) -> str:
        """All of it; a line may end before the detail alone."""
        parts = self.value, self.detail
        return " ".join("\N{NO-BREAK SPACE}".join(own.split()) for own in parts) if self.detail else unbroken(self.text)


@dataclass(frozen=True, slots=True)
class Column:
    """What a column means: its title, which has no unit, and how its numbers are shown.

    ``spread`` is a half width, ``share`` one of 1, shown in per cent, ``difference`` that of what is shown, ``pair`` a
    value, what was measured, and their difference. The ends of an interval are infinite where open.
    """

    title: str
    kind: Kind = "text"
    unit: str = ""  # of the numbers in the frame
    form: str = ".1f"
    source: str = ""  # the frame's column, by default that of the title
    units: str = ""  # the frame's column with the unit of each row
    unitless: str = ""  # format of rows without a unit, if another one
    widest: float = np.inf  # an interval wider than so many times its value says nothing: readers see a dash
    ends_form: str = ""  # of an interval's ends, if not as the value
    further: tuple[str, ...] = ()  # columns of an interval's ends, an estimate's error, what a difference subtracts
    marks: str = ""  # the frame's column that says which cells stand out
    missing: str = "–"
    flips: bool = False  # the sign is that of the acceleration, which a reader chooses
    confidence: float = 1.0  # beside which probabilities have more digits

    @property
    def is_numeric(self) -> bool:
        """Whether cells are numbers, to stand at the right; ratings with grades are not."""
        return self.kind not in ("text", "grade")

    def heading(self, display: Display) -> str:
        """The title with the reader's unit."""
        sign = "± " if self.kind == "spread" else ""
        title = display.words(self.title)
        return f"{title} ({sign}{display.units.unit(self.unit)})" if self.unit else title

    def cell(self, row: Mapping[Any, Any], display: Display) -> Cell:
        """A row's cell, in the reader's unit."""
        return self._cell(row, display)._replace(is_marked=bool(self.marks and row[self.marks]))

    def _cell(self, row: Mapping[Any, Any], display: Display) -> Cell:
        name, unit = self.source or self.title, row[self.units] if self.units else self.unit
        value, form = row.get(name), self.form if unit or not self.units else self.unitless or self.form
        if self.kind == "text":
            missing = value is None or value != value  # not a number
            words = ("no", "yes")[value] if isinstance(value, bool) else display.words(value)
            return Cell(self.missing if missing else display.title(words, unit))
        factor = display.units.factor(unit) * (-1 if self.flips and display.deceleration else 1)
        factor *= 100 if self.kind == "share" else 1

        def text(value: float | None, form: str = form) -> str | None:
            return None if value is None or not np.isfinite(value) else number(float(value) * factor, form)

        further = [row.get(own) for own in self.further or (f"{name} lower", f"{name} upper")]
        ends = [text(end, self.ends_form or form) for end in further]
        main = text(value)
        if self.kind == "interval":
            is_open = any(end is not None and np.isinf(end) for end in further)
            shown, detail = interval_texts(main, ends[0], ends[1], is_open=is_open)
            width = float(further[1] or 0) - float(further[0] or 0)
            if None not in (value, *ends) and width > self.widest * abs(float(value or 0)):
                detail = VAGUE
            return Cell(shown, detail, tuple(end or "" for end in (main, *ends)))
        if self.kind == "range" and None not in ends:
            return Cell("–".join(map(str, ends)))
        if main is None or value is None:
            return Cell(self.missing, parts=("",) * len(PARTS.get(self.kind, ())))
        if self.kind == "grade":
            return Cell(rating_text(value), grade(value), (rating_text(value), grade(value)))
        if self.kind == "probability":
            return Cell(probability_text(value, self.confidence))
        if self.kind in ("difference", "pair"):
            base = np.nan if further[0] is None else further[0]
            shown_difference = float(format(value * factor, form)) - float(format(base * factor, form))
            difference = self.missing if np.isnan(base) else number(shown_difference, f"+{form}")
            parts = (main, ends[0] or self.missing, difference)
            return Cell(difference) if self.kind == "difference" else Cell(" / ".join(parts[:2]), difference, parts)
        if self.kind == "estimate" and (error := text(further[0], form.removeprefix("+"))) is not None:
            return Cell(f"{main} ± {error}")
        return Cell(f"{main} %" if self.kind == "share" and not unit else main)


CONDITION = (
    Column("Speed", "number", "mph", source="speed_mph"),
    Column("Front weight", "number", "lb", ".0f", source="front_weight_lb"),
    Column("Rear weight", "number", "lb", ".0f", source="rear_weight_lb"),
)


def of_condition(condition: Condition) -> dict[str, object]:
    """What :data:`CONDITION` and its factors take of a condition."""
    weights = {"front_weight_lb": condition.front_weight_kg / LB, "rear_weight_lb": condition.rear_weight_kg / LB}
    return {"speed_mph": condition.speed_mps / MPH, **weights, **dict(condition.factors)}


def frame_of(rows: Iterable[Mapping[str, object]]) -> pd.DataFrame:
    """Rows as a frame; sentences keep their units: pandas would make plain strings of them."""
    frame = pd.DataFrame(rows, dtype=object)
    types = {name: set(map(type, frame[name])) for name in frame}
    floats, others = {float, np.float64}, {int, type(None)}
    return frame.astype({name: float for name, own in types.items() if own & floats and own <= floats | others})


@dataclass(frozen=True, eq=False)
class Table:
    """A table of results; ``frame`` has its numbers, in SI or the units of the files."""

    name: str
    frame: pd.DataFrame
    columns: tuple[Column, ...]

    @classmethod
    def of(cls, name: str, rows: pd.DataFrame | Iterable[Mapping[str, object]], *columns: Column) -> Self:
        """A table of rows; what has no column among these is words, headed by its name."""
        frame = rows if isinstance(rows, pd.DataFrame) else frame_of(rows)
        known = {column.source or column.title: column for column in columns}
        ends = {f"{name} {end}" for name in known for end in ("lower", "upper")}
        return cls(name, frame, tuple(known.get(own, Column(str(own))) for own in frame if own not in ends))

    @property
    def empty(self) -> bool:
        """Whether it has no row."""
        return not len(self.frame)

    @property
    def is_marked(self) -> bool:
        """Whether any of its cells stands out."""
        marks = [column.marks for column in self.columns if column.marks]
        return bool(np.any(self.frame[marks].to_numpy()))

    def __len__(self) -> int:
        return len(self.frame)

    def head(self, n: int) -> Self:
        """The first rows."""
        return replace(self, frame=self.frame.head(n))

    def without(self, *titles: str) -> Self:
        """The table without some of its columns."""
        return replace(self, columns=tuple(column for column in self.columns if column.title not in titles))

    def cells(self, display: Display = DEFAULT) -> dict[str, tuple[Column, list[Cell]]]:
        """The columns as shown, by their headings."""
        rows = self.frame.to_dict("records")
        return {own.heading(display): (own, [own.cell(row, display) for row in rows]) for own in self.columns}

    def texts(self, display: Display = DEFAULT) -> pd.DataFrame:
        """The table as words."""
        columns = self.cells(display).items()
        return pd.DataFrame({heading: [cell.text for cell in cells] for heading, (_, cells) in columns}, dtype=object)

    def to_string(self, display: Display = DEFAULT) -> str:
        """The table as lines, for a terminal."""
        return str(self.texts(display).to_string(index=False))

    def _repr_html_(self) -> str:
        return views.card(self.name, self)
