"""How results show themselves in a notebook: a small table under a line of words."""

from collections.abc import Sequence
from html import escape

from crashfuse.campaign import Campaign
from crashfuse.results.display import DEFAULT, Display
from crashfuse.results.render.text import against_lines
from crashfuse.results.result import Result
from crashfuse.results.table import Cell, Column, Table
from crashfuse.study.facts import campaign_facts

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
    display = result.usual_display
    table = result.tables[result.shown[0]] if result.shown else Table.of("nothing", ())
    told = dict.fromkeys(map(display.words, (*result.answer, *result.notices)))
    notes = [*told, *against_lines(result, display)]
    return card(display.words(result.heading), table, notes, display)


def _column(heading: str, column: Column, cells: Sequence[Cell]) -> list[str]:
    """Heading and cells, numbers at the right and text at the left: Jupyter would have all at the right."""
    side = "right" if column.is_numeric else "left"
    return [
        f'<th style="text-align: {side}">{escape(heading)}</th>',
        *(f'<td style="text-align: {side}; white-space: nowrap">{escape(cell.text)}</td>' for cell in cells),
    ]


def facts_words(campaign: Campaign, display: Display) -> tuple[str, ...]:
    """What has to be known of a campaign, in the reader's units."""
    return tuple(display.words(fact.sentence) for fact in campaign_facts(campaign))
