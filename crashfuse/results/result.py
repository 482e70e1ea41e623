"""A result as data: what page, terminal, notebook, report and slides show without knowing its kind.

The module of a kind says which sentences, tables, figures and files it has; units are chosen when it is shown.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Generic, NamedTuple, Self, TypeVar

from crashfuse import views
from crashfuse.campaign import Campaign
from crashfuse.results.display import Display
from crashfuse.results.drawing import Drawing
from crashfuse.results.table import Table
from crashfuse.study.config import StudyConfig
from crashfuse.study.facts import Fact, campaign_facts
from crashfuse.units import UnitSystem, joined

T = TypeVar("T")
Content = bytes | str | Mapping[str, bytes] | None
"""Of a file; of a folder's files, by relative path; None: there is no such file."""


class Deferred(Mapping[str, T], Generic[T]):
    """Values by name, in order, each made when it is first asked for."""

    def __init__(self, **makers: Callable[[], T]) -> None:
        self._makers, self._made = makers, dict[str, T]()

    def __getitem__(self, name: str) -> T:
        if name not in self._made:
            self._made[name] = self._makers[name]()
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._makers)

    def __len__(self) -> int:
        return len(self._makers)


@dataclass(frozen=True)
class ForReading:
    """A file with sentences, which are in some units; by default, those of the campaign."""

    make: Callable[[UnitSystem], Content]
    usual: UnitSystem

    def __call__(self) -> Content:
        """In the usual units."""
        return self.make(self.usual)


class Figure(NamedTuple):
    """A drawing under its title."""

    title: str
    draw: Callable[[Display], Drawing]
    is_answer: bool = False  # what was asked, so the first of the slides
    sheets: tuple[Callable[[Display], Drawing], ...] = ()  # its parts on paper, if one page cannot hold it

    @property
    def drawn(self) -> tuple[Callable[[Display], Drawing], ...]:
        """What paper and slides show of it."""
        return self.sheets or (self.draw,)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Result:
    """What a computation came to.

    Parameters
    ----------
    kind : str
        Names its files (:data:`crashfuse.results.files.RESULT_FILES`) and, unless it has another, its ``template``.
    title : str
        Its subject; of a part, the heading of its section.
    campaign : Campaign, optional
        The one that it is of, whose name stands before its title.
    command : callable
        The command line that reproduces it, in units of the reader.
    answer : tuple of str
        What was asked, in sentences that come first in every medium.
    cautions : tuple of str
        What has to be known besides the facts of its campaign.
    against : mapping
        What speaks most against the answer, by subject.
    shown : tuple of str
        Names of the tables that answer, too, in terminal and notebook.
    sentences, tables, figures, parts, values : mapping
        All else that its report has, by names in the template; parts are results, values are plain words and numbers.
        Sentences named ``remarks`` end what a terminal prints.
    files : mapping
        Files by name, in the units of the contract; those of a :class:`ForReading` in units of the reader.
    """

    kind: str
    title: str
    campaign: Campaign | None = None
    config: StudyConfig = StudyConfig()
    command: Callable[[UnitSystem], str] = lambda _: ""
    held_out: tuple[str, ...] = ()
    answer: tuple[str, ...] = ()
    cautions: tuple[str, ...] = ()
    against: Mapping[str, str] = field(default_factory=dict)
    shown: tuple[str, ...] = ()
    sentences: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    tables: Mapping[str, Table] = field(default_factory=dict)
    figures: Mapping[str, Figure] = field(default_factory=dict)
    parts: Mapping[str, tuple[Self, ...]] = field(default_factory=dict)
    values: Mapping[str, object] = field(default_factory=dict)
    files: Mapping[str, Callable[[], Content]] = field(default_factory=dict)
    template: str = ""

    @property
    def heading(self) -> str:
        """Whose it is, and its title."""
        return self.title if self.campaign is None else joined([self.campaign.name, self.title], ": ")

    @property
    def usual_display(self) -> Display:
        """In the units of its campaign."""
        return Display() if self.campaign is None else Display(system=self.campaign.units)

    @property
    def facts(self) -> tuple[Fact, ...]:
        """What has to be known of the data."""
        return () if self.campaign is None else campaign_facts(self.campaign)

    @property
    def notices(self) -> tuple[str, ...]:
        """All that has to be known, in sentences."""
        return *(fact.sentence for fact in self.facts), *self.cautions

    def files_in(self, system: UnitSystem) -> dict[str, Callable[[], Content]]:
        """Its files, sentences in these units."""
        reading = {name: replace(own, usual=system) for name, own in self.files.items() if isinstance(own, ForReading)}
        return {**self.files, **reading}

    def all_figures(self) -> Iterator[Figure]:
        """Figures, sheet by sheet, and those of parts, under the titles of both."""
        for figure in self.figures.values():
            yield from (figure._replace(draw=draw, sheets=()) for draw in figure.drawn)
        for part in (part for parts in self.parts.values() for part in parts):
            for figure in part.all_figures():
                yield figure._replace(title=joined([part.title, figure.title], ": "))

    def _repr_html_(self) -> str:
        return views.result_html(self)
