"""A table of results as data: numbers, and what has to be known of each column to show them.

Units, sign and words are chosen by whoever renders it, from a :class:`~crashfuse.reporting.plots.display.Display`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple, Self

import numpy as np
import pandas as pd

from crashfuse import views
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.signals.rating import grade, rating_text
from crashfuse.units import interval_texts, number, probability_text, unbroken

Kind = Literal[
    "text", "number", "spread", "share", "interval", "range", "estimate", "difference", "grade", "probability"
]
PARTS: Mapping[str, tuple[str, ...]] = {"interval": ("", " lower", " upper"), "grade": ("", " grade")}
"""Ends of the headings of a kind's columns where each number has its own."""
_RATIO = ".2f"  # of rows without a unit where others have one


class Cell(NamedTuple):
    """A cell as shown: its value; what stands behind that, such as an interval; both in :data:`PARTS`."""

    value: str
    detail: str = ""
    parts: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """All of it."""
        return f"{self.value} {self.detail}" if self.detail else self.value

    @property
    def unbroken(self) -> str:
        """All of it, in which no line ends within the detail or between a number and its unit."""
        return unbroken(self.text) if not self.detail else self.text.replace(" ", "\N{NO-BREAK SPACE}")


@dataclass(frozen=True, slots=True)
class Column:
    """What a column means.

    Parameters
    ----------
    title : str
        Its heading, without unit.
    kind : str
        ``text``: words, sentences with quantities, yes or no. ``spread``: a half width. ``share``: of 1, shown in per
        cent. ``estimate``: with its standard error. ``difference``: of what is shown.
    unit, units : str
        That of the numbers in the frame; or the frame's column that has the unit of each row.
    form, ends_form : str
        Format of its numbers; of the ends of its intervals, if another one.
    source : str
        Name of the frame's column, by default the title.
    further : tuple of str
        Names of those with the ends of an interval (infinite where open) or a range, by default ``… lower`` and ``…
        upper``, with the error of an estimate, or with what a difference subtracts.
    missing : str
        What stands where there is no value.
    flips : bool
        Whether its sign is that of the acceleration, which a reader chooses.
    confidence : float
        Beside which probabilities have more digits.
    """

    title: str
    kind: Kind = "text"
    unit: str = ""
    form: str = ".1f"
    source: str = ""
    units: str = ""
    ends_form: str = ""
    further: tuple[str, ...] = ()
    missing: str = "–"
    flips: bool = False
    confidence: float = 1.0

    @property
    def is_numeric(self) -> bool:
        """Whether its cells are numbers, to stand at the right; a rating with its grade stays in line."""
        return self.kind not in ("text", "grade")

    def heading(self, display: Display) -> str:
        """The title with the reader's unit."""
        sign = "± " if self.kind == "spread" else ""
        return f"{self.title} ({sign}{display.units.unit(self.unit)})" if self.unit else self.title

    def cell(self, row: Mapping[Any, Any], display: Display) -> Cell:
        """A row's cell, in the reader's unit."""
        name, unit = self.source or self.title, row[self.units] if self.units else self.unit
        value, form = row.get(name), _RATIO if self.units and not unit else self.form
        if self.kind == "text":
            shown = _words(value, display) or self.missing
            return Cell(display.title(shown, unit) if unit else shown)
        factor = display.units.factor(unit) * (-1 if self.flips and display.deceleration else 1)
        factor *= 100 if self.kind == "share" else 1

        def text(value: float | None, form: str = form) -> str | None:
            return None if value is None or not np.isfinite(value) else number(value * factor, form)

        further = [row.get(own) for own in self.further or (f"{name} lower", f"{name} upper")]
        ends = [text(end, self.ends_form or form) for end in further]
        main = text(value)
        if self.kind == "interval":
            is_open = any(end is not None and np.isinf(end) for end in further)
            return Cell(*interval_texts(main, *ends, is_open), tuple(end or "" for end in (main, *ends)))
        if self.kind == "range" and None not in ends:
            return Cell("–".join(map(str, ends)))
        if main is None or value is None:
            return Cell(self.missing, parts=("", "") if self.kind == "grade" else ())
        if self.kind == "grade":
            return Cell(rating_text(value), grade(value), (rating_text(value), grade(value)))
        if self.kind == "probability":
            return Cell(probability_text(value, self.confidence))
        if self.kind == "difference":
            first, second = (float(format(one * factor, form)) for one in (value, further[0]))
            return Cell(self.missing if np.isnan(second) else number(first - second, f"+{form}"))
        if self.kind == "estimate" and (error := text(further[0], form.removeprefix("+"))) is not None:
            return Cell(f"{main} ± {error}")
        return Cell(f"{main} %" if self.kind == "share" and not unit else main)


def _words(value: object, display: Display) -> str:
    if value is None or value != value:  # not a number
        return ""
    return ("no", "yes")[value] if isinstance(value, bool) else display.words(value)


@dataclass(frozen=True, eq=False)
class Table:
    """A table of results; ``frame`` has its numbers, in SI or the units of the files.

    ``marked`` has the rows that stand out, by the titles of their columns.
    """

    name: str
    frame: pd.DataFrame
    columns: tuple[Column, ...]
    marked: Mapping[str, Sequence[bool]] = field(default_factory=dict)

    @classmethod
    def of_texts(cls, name: str, frame: pd.DataFrame) -> Self:
        """A table of words alone, whose headings are the frame's."""
        return cls(name, frame, tuple(Column(str(title)) for title in frame))

    @property
    def empty(self) -> bool:
        """Whether it has no row."""
        return self.frame.empty

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

    def _repr_html_(self) -> str:
        return views.card(self.name, self)
