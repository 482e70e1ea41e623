"""How results show themselves in a notebook: a small table under a line of words."""

from collections.abc import Sequence
from html import escape

import pandas as pd

from crashfuse.campaign import Campaign
from crashfuse.reporting.paper_tables import mean_ratings
from crashfuse.study.study import Study
from crashfuse.wording import KPH_KG, speed

_MOST_ROWS = 30


def card(title: str, table: pd.DataFrame, notes: Sequence[str] = ()) -> str:
    """HTML of a small table of text under a title, with sentences below it; everything in it is text."""
    shown = table.head(_MOST_ROWS)
    if len(table) > _MOST_ROWS:
        notes = (f"The first {_MOST_ROWS} of {len(table)} rows.", *notes)
    below = "".join(f"<div>{escape(note)}</div>" for note in notes if note)
    rows = shown.to_html(index=False, border=0, justify="left", float_format="{:.4g}".format)
    return f"<div><b>{escape(title)}</b>{rows}{below}</div>"


def campaign_html(campaign: Campaign) -> str:
    """What a campaign holds: the tests' conditions, how many CAE runs, what is worth knowing."""
    speeds, *_ = zip(*campaign.cae.range, strict=True)
    said = speed(*speeds)
    runs = f"{len(campaign.cae):,} CAE runs at {said} ({said.in_units(KPH_KG)})"
    title = f"{campaign.name}: {len(campaign.tests)} tests"
    return card(
        title,
        campaign.tests_frame,
        (f"{runs}; fingerprint {campaign.fingerprint[:12]}.", campaign.notice, *campaign.remarks),
    )


def study_html(study: Study) -> str:
    """The mean rating of each approach over each window with its grade, and what a repeat of the tests would rate."""
    tests = ", ".join(fold.held_out for fold in study.folds)
    return card(f"{study.campaign.name}: left out {tests}", mean_ratings(study), (f"{study.campaign.rating_basis}.",))
