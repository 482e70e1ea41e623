"""How results show themselves in a notebook: a small table under a line of words."""

import re
from collections.abc import Sequence
from html import escape

import pandas as pd

from crashfuse.campaign import Campaign
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.rating_tables import mean_values, ratings_shown
from crashfuse.reporting.table import Table
from crashfuse.study.facts import campaign_facts, distinct
from crashfuse.study.recommendation import SPEED_GROUPS, recommend
from crashfuse.study.study import Study
from crashfuse.units import speed

_MOST_ROWS = 30
_NUMBER = re.compile(r"[<>≤≥+−-]?[\d.]+(e[+-]\d+)?|–|")


def card(title: str, table: Table | pd.DataFrame, notes: Sequence[str] = (), display: Display = DEFAULT) -> str:
    """HTML of a small table under a title, with sentences below it; everything in it is text."""
    shown = table.head(_MOST_ROWS)
    if len(table) > _MOST_ROWS:
        notes = (f"The first {_MOST_ROWS} of {len(table)} rows.", *notes)
    below = "".join(f"<div>{escape(note)}</div>" for note in notes if note)
    if isinstance(shown, Table):
        columns = [
            _cells(heading, column.is_numeric, [cell.text for cell in cells])
            for heading, (column, cells) in shown.cells(display).items()
        ]
    else:
        columns = [_column(str(name), shown[name]) for name in shown]
    head, *rows = (f"<tr>{''.join(cells)}</tr>" for cells in zip(*columns, strict=True))
    return f"<div><b>{escape(title)}</b><table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table>{below}</div>"


def _column(name: str, values: pd.Series) -> list[str]:
    """Heading and cells, numbers at the right and text at the left: Jupyter would have all at the right."""
    texts = ["–" if pd.isna(value) else f"{value:.4g}" if isinstance(value, float) else str(value) for value in values]
    return _cells(name, all(map(_NUMBER.fullmatch, texts)), texts)


def _cells(name: str, is_numeric: bool, texts: Sequence[str]) -> list[str]:
    side = "right" if is_numeric else "left"
    return [
        f'<th style="text-align: {side}">{escape(name)}</th>',
        *(f'<td style="text-align: {side}; white-space: nowrap">{escape(text)}</td>' for text in texts),
    ]


def campaign_html(campaign: Campaign) -> str:
    """What a campaign holds: the tests' conditions, how many CAE runs, what is worth knowing."""
    display = Display(system=campaign.units)
    speeds, *_ = zip(*campaign.cae.range, strict=True)
    runs = f"{len(campaign.cae):,} CAE runs at {display.words(speed(*speeds))}"
    rows = (
        {"Test": test.id, **display.columns(test.condition), **{n.capitalize(): v for n, v in test.condition.factors}}
        for test in campaign.tests
    )
    return card(
        f"{campaign.name}: {len(campaign.tests)} tests",
        pd.DataFrame(rows),
        (f"{runs}; fingerprint {campaign.fingerprint[:12]}.", *facts_words(campaign, display)),
    )


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
