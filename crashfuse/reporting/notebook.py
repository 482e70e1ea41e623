"""How results show themselves in a notebook: a line of words, a small table, the figure of a page."""

from collections.abc import Sequence
from html import escape
from typing import Any

import pandas as pd
import plotly.graph_objects as go

from crashfuse.campaign import Campaign
from crashfuse.errors import UsageError
from crashfuse.reporting.paper_tables import mean_ratings
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.plots.pulses import motion
from crashfuse.study.study import Study
from crashfuse.wording import KPH_KG, speed

_MOST_ROWS = 30


def card(title: str, table: pd.DataFrame, notes: Sequence[str] = ()) -> str:
    """HTML of a small table of text under a title, with sentences below it; everything in it is text."""
    shown = table.head(_MOST_ROWS)
    if len(table) > _MOST_ROWS:
        notes = (f"The first {_MOST_ROWS} of {len(table)} rows.", *notes)
    below = "".join(f"<div>{escape(note)}</div>" for note in notes if note)
    return f"<div><b>{escape(title)}</b>{shown.to_html(index=False, border=0)}{below}</div>"


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


def plot_fold(study: Study, held_out: str, approaches: Sequence[str], **display: Any) -> go.Figure:  # noqa: ANN401
    """A held-out test with its predictions over time, see :meth:`Study.plot`."""
    fold = study.fold(held_out)
    if unknown := [name for name in approaches if name not in study.config.approaches]:
        raise UsageError(f"The study has no approach {unknown[0]!r}; it has {', '.join(study.config.approaches)}.")
    predictions = {
        each.approach: each.prediction for each in fold.estimates if not approaches or each.approach in approaches
    }
    return motion(fold.test.pulse, predictions, fold.test.condition.speed_mps, Display(**display))
