"""How results show themselves in a notebook: a small table under a line of words."""

from collections.abc import Sequence
from html import escape

from crashfuse.campaign import Campaign
from crashfuse.results.display import DEFAULT, Display
from crashfuse.results.rating_tables import mean_values, ratings_shown
from crashfuse.results.result import Result
from crashfuse.results.table import Cell, Column, Table
from crashfuse.study.facts import campaign_facts, distinct
from crashfuse.study.recommendation import SPEED_GROUPS, recommend
from crashfuse.study.study import Study

_MOST_ROWS = 30


def card(title: str, table: Table, notes: Sequence[str] = (), display: Display = DEFAULT) -> str:
    """HTML of a small table under a title, with sentences below it; everything in it is text."""
    if len(table) > _MOST_ROWS:
        notes = (f"The first {_MOST_ROWS} of {len(table)} rows.", *notes)
    below = "".join(f"<div>{escape(note)}</div>" for note in notes if note)
    columns = [_column(heading, *own) for heading, own in table.head(_MOST_ROWS).cells(display).items()]
    head, *rows = (f"<tr>{''.join(cells)}</tr>" for cells in zip(*columns, strict=True))
    return f"<div><b>{escape(title)}</b><table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table>{below}</div>"


def result_html(result: Result) -> str:
    """A result in a notebook: what answers, and what has to be known of the data."""
    display = Display(system=result.campaign.units)
    table = result.tables[result.shown[0]] if result.shown else Table.of("nothing", ())
    notes = [display.words(text) for text in (*result.answer, *(fact.sentence for fact in result.facts))]
    return card(f"{result.campaign.name}: {display.words(result.title)}", table, notes, display)


def _column(heading: str, column: Column, cells: Sequence[Cell]) -> list[str]:
    """Heading and cells, numbers at the right and text at the left: Jupyter would have all at the right."""
    side = "right" if column.is_numeric else "left"
    return [
        f'<th style="text-align: {side}">{escape(heading)}</th>',
        *(f'<td style="text-align: {side}; white-space: nowrap">{escape(cell.text)}</td>' for cell in cells),
    ]


def study_html(study: Study) -> str:
    """The mean rating of each approach over each window with its grade, and what a repeat of the tests would rate."""
    tests, display = ", ".join(fold.held_out for fold in study.folds), Display(system=study.campaign.units)
    facts = distinct([*recommend(study).facts, *campaign_facts(study.campaign)])
    shown = [display.words(fact.sentence) for fact in facts if fact.code != SPEED_GROUPS]  # which the table has not
    notes = (f"{study.campaign.rating_basis}.", *shown)
    return card(f"{study.campaign.name}: left out {tests}", ratings_shown(mean_values(study)), notes)


def facts_words(campaign: Campaign, display: Display) -> tuple[str, ...]:
    """What has to be known of a campaign, in the reader's units."""
    return tuple(display.words(fact.sentence) for fact in campaign_facts(campaign))
