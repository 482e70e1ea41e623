"""Report of a certification: what a review asks for, from the intended use to the signatures."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime

import pandas as pd
import plotly.graph_objects as go

from crashfuse.campaign_folder.notes import Note
from crashfuse.certification.certify import Certification
from crashfuse.certification.changes import Changes
from crashfuse.certification.criteria import Criterion
from crashfuse.certification.track_record import TrackRecord
from crashfuse.certification.verdict import WORDS
from crashfuse.reporting.certification_changes import change_sentences, shown_changes
from crashfuse.reporting.certification_exceptions import exceptions
from crashfuse.reporting.certification_sentences import summary
from crashfuse.reporting.certification_tables import (
    ANSWER,
    answer_texts,
    counts_table,
    record_shown,
    trials_shown,
    verdicts_shown,
)
from crashfuse.reporting.evidence_sentences import (
    brier_sentence,
    domain_sentences,
    interval_sentence,
    record_sentence,
    waived_sentence,
)
from crashfuse.reporting.plots.certification import verdict_matrix
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.provenance import certify_command
from crashfuse.reporting.report.page import render
from crashfuse.reporting.report.sections import repeats_table
from crashfuse.reporting.verdicts import Verdicts
from crashfuse.study.repeatability import repeatability
from crashfuse.wording import probability_text, unbroken

_MOST_ROWS = 1000  # of a table; all of them are in the CSV files
_CONDITIONS, _CONDITIONS_OF_MANY = 14, 10  # in a figure at the height it has on paper; of several, two fill a page
_CRITERIA_A_FIGURE = 2
_MOST_FIGURES = 20


def certification_report(certification: Certification, display: Display = DEFAULT, notes: Sequence[Note] = ()) -> str:
    """HTML report of a certification, made for paper; with what became of an earlier one, if it is beside one.

    ``notes`` are those on the campaign's tests, also on those that are left out of use.
    """
    changes = None if certification.since is None else Changes.of(certification)
    campaign, criteria, record = certification.campaign, certification.criteria, certification.record
    shown, windows_ms = Verdicts(certification), certification.config.windows_ms
    repeats = repeatability(campaign, windows_ms, seed=certification.config.seed)
    return render(
        "certification",
        "certification by analysis",
        campaign,
        certification.config,
        certify_command(certification.config, display.system, since=changes is not None),
        display,
        campaign.test_ids,
        date=f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
        words=WORDS,
        summary=summary(certification),
        n_conditions=len(certification.matrix.ids),
        quantities=list(dict.fromkeys(criterion.label for criterion in criteria.items)),
        notes=[(note.test, note.when, note.text) for note in notes],
        repeats=repeats_table(repeats, campaign.test_ids, windows_ms),
        domain=domain_sentences(certification.domain),
        domain_figure=shown.plot("domain", display=display),
        conditions=_shortened(_conditions(certification, display), "certification.csv"),
        confidence=criteria.confidence,
        criteria=_criteria(criteria.items, display),
        occupant=_occupant(certification),
        counts=counts_table(certification, display.units).rename(columns={"criterion": "Criterion", "limit": "Limit"}),
        matrix_figures=list(_matrix_figures(certification, display)),
        verdict_rows=_shortened(verdicts_shown(certification, display).drop(columns="Limit"), "certification.csv"),
        changes=() if changes is None else change_sentences(changes),
        earlier=None if changes is None else changes.earlier,
        changed=None if changes is None else _shortened(shown_changes(changes, display), "changes.csv"),
        record=[record_sentence(record), *waived_sentence(record, criteria)],
        record_figures=list(_record_figures(certification, display)),
        record_counts=record_shown(certification, display),
        evidence=[*interval_sentence(record), *brier_sentence(record)],
        reliability=shown.plot("reliability"),
        bins=_bins(record),
        trials=_shortened(trials_shown(record, criteria.confidence, display), "track_record.csv"),
        exceptions=exceptions(certification),
        open_cells=_shortened(_open_cells(certification, display), "certification.csv"),
    )


def _shortened(table: pd.DataFrame, file: str) -> dict[str, object]:
    """The first rows of a table, and what is left out in words."""
    left = len(table) - _MOST_ROWS
    return {"rows": table.head(_MOST_ROWS), "left": [f"{left:,} more rows are in {file}."] if left > 0 else []}


def _conditions(certification: Certification, display: Display) -> pd.DataFrame:
    matrix, domain = certification.matrix, certification.domain
    answers, all_met = answer_texts(certification), certification.waived | certification.uncertain
    confidence = certification.criteria.confidence
    return pd.DataFrame(
        {
            "Condition": i,
            **display.columns(condition),
            **dict(condition.factors),
            "Validated domain": "outside" if domain.outside(condition) else "inside",
            ANSWER: answers[i],
            "All met at once": f"≥ {probability_text(all_met[i][0], confidence)}" if i in all_met else "–",
        }
        for i, condition in matrix.items
    )


def _criteria(criteria: Sequence[Criterion], display: Display) -> pd.DataFrame:
    """The criteria; if the reader's units are not those that limits are declared in, in both."""
    table = pd.DataFrame(
        {
            "Criterion": own.name,
            "Quantity": own.label,
            "Limit": display.words(own.limits),
            "As declared": str(own.limits),
        }
        for own in criteria
    )
    return table if (table["Limit"] != table["As declared"]).any() else table.drop(columns="As declared")


def _occupant(certification: Certification) -> list[str]:
    """The occupant model behind limits on OLC and VPI, if there are any."""
    own, metrics = certification.campaign.occupant, {criterion.metric for criterion in certification.criteria.items}
    olc = f"OLC: free flight of {own.olc_free_flight_mm:g} mm, restraint over {own.olc_restraint_mm:g} mm."
    vpi = f"VPI: slack of {own.vpi_slack_mm:g} mm, spring of {own.vpi_stiffness_npm:g} N/m for 1 kg."
    return [words for metric, words in (("olc", olc), ("vpi", vpi)) if metric in metrics]


def _matrix_figures(certification: Certification, display: Display) -> Iterator[go.Figure]:
    """The matrix in parts, slow before fast; if it would take too many, as a single figure of colours."""
    n = len(certification.matrix.ids)
    size = _CONDITIONS if n <= _CONDITIONS else _CONDITIONS_OF_MANY
    if n > size * _MOST_FIGURES:
        return iter([verdict_matrix(certification, display, words=False)])
    return (verdict_matrix(certification, display, slice(i, i + size)) for i in range(0, n, size))


def _record_figures(certification: Certification, display: Display) -> Iterator[go.Figure]:
    """The record in parts of some criteria each."""
    record, criteria = certification.record, certification.criteria.items
    for i in range(0, len(criteria), _CRITERIA_A_FIGURE):
        some = criteria[i : i + _CRITERIA_A_FIGURE]
        trials = tuple(trial for trial in record.trials if trial.verdict.criterion in some)
        if trials:
            yield Verdicts(replace(certification, record=TrackRecord(trials))).plot("record", display=display)


def _bins(record: TrackRecord) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "Probability given": f"{own.low:g}–{own.high:g}",
            "On average": f"{own.probability:.3f}",
            "Verdicts": own.n,
            "Met": f"{own.met:.3f}",
            "95 % bounds": f"{own.lower:.3f}–{own.upper:.3f}",
            "Within them": "yes" if own.holds else "no",
        }
        for own in record.reliability
    )


def _open_cells(certification: Certification, display: Display) -> pd.DataFrame:
    """Open verdicts with the distance of the limit from the expected value, the nearest limit first."""
    rows, confidence = [], certification.criteria.confidence
    for i, own in certification.cells:
        if own.word != "open" or own.probability is None:
            continue
        margin = None if own.value is None else own.criterion.margin(own.value)
        half_width = None if own.lower is None or own.upper is None else (own.upper - own.lower) / 2
        share = margin / half_width if margin is not None and half_width else float("inf")
        row = {
            "Condition": i,
            "Criterion": own.criterion.name,
            "Limit": display.words(own.criterion.limits),
            "Expected": unbroken(display.words(own.criterion.shown(own.value))),
            "Distance": unbroken(display.words(own.criterion.shown(margin))),
            "In half widths of the interval": f"{share:.2f}" if math.isfinite(share) else "–",
            "Probability": probability_text(own.probability, confidence),
        }
        rows.append((share, row))
    return pd.DataFrame(row for _, row in sorted(rows, key=lambda each: each[0]))
