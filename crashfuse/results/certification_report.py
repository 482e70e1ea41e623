"""Report of a certification: what a review asks for, from the intended use to the signatures."""

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime

from crashfuse.campaign_folder.notes import Note
from crashfuse.certification.certify import Certification
from crashfuse.certification.verdict import WORDS
from crashfuse.results.certification_facts import PLACES, exceptions, sentences
from crashfuse.results.certification_tables import SHOWN
from crashfuse.results.credibility import credibility_table
from crashfuse.results.display import DEFAULT, Display
from crashfuse.results.drawing import Drawing
from crashfuse.results.plots.certification import record_figure, reliability, validated_domain, verdict_matrix
from crashfuse.results.provenance import certify_command
from crashfuse.results.render.figure_files import Report
from crashfuse.results.render.html import render
from crashfuse.results.result_tables import repeats_table
from crashfuse.results.table import Table
from crashfuse.results.verdicts import planned_table
from crashfuse.study.repeatability import repeatability

_MOST_ROWS = 1000  # of a table; all of them are in the CSV files
_CONDITIONS, _CONDITIONS_OF_MANY = 14, 10  # in a figure at the height it has on paper; of several, two fill a page
_CRITERIA_A_FIGURE = 2
_MOST_FIGURES = 20
_SHEET = ["Activity", "Factor", "Question", "What the data say", "Source"]
_FILES = {"trials": "track_record.csv", "since": "track_record.csv"}  # that have all rows; else certification.csv


def certification_report(
    certification: Certification, display: Display = DEFAULT, notes: Sequence[Note] = ()
) -> Report:
    """HTML report of a certification, made for paper; with what became of an earlier one, if it is beside one."""
    campaign, criteria, windows_ms = certification.campaign, certification.criteria, certification.config.windows_ms
    since, judged = certification.since, [own for own in criteria.items if certification.record.of(own)]
    repeats = repeatability(campaign, windows_ms, seed=certification.config.seed)
    tables = {
        name: {"rows": table.head(_MOST_ROWS), "left": [f"{left:,} more rows are in {file}."] if left > 0 else []}
        for name, make in {"conditions": planned_table, **SHOWN}.items()
        if name != "since" or since is not None
        for table, file in [(make(certification, display), _FILES.get(name, "certification.csv"))]
        for left in [len(table) - _MOST_ROWS]
    }
    command = certify_command(certification, display.system)
    origin = campaign, certification.config, command, display, campaign.test_ids
    return render(
        "certification",
        "certification by analysis",
        *origin,
        date=f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
        key=certification.key,
        words=WORDS,
        answers=sentences(certification, "answer"),
        said={place: sentences(certification, place) for place in PLACES},
        exceptions=exceptions(certification),
        table_of=tables,
        credibility=Table.of("credibility", credibility_table(certification, display).set_axis(_SHEET, axis=1)),
        n_conditions=len(certification.matrix.ids),
        quantities=list(dict.fromkeys(criterion.label for criterion in criteria.items)),
        notes=[(note.test, note.when, note.text) for note in notes],
        repeats=repeats_table(repeats, campaign.test_ids, windows_ms),
        confidence=criteria.confidence,
        costs=criteria.costs,
        earlier=None if since is None else since.earlier,
        domain_figure=validated_domain(certification, display),
        matrix_figures=list(_matrix_figures(certification, display)),
        record_figures=[
            record_figure(certification.record, judged[i : i + _CRITERIA_A_FIGURE], display)
            for i in range(0, len(judged), _CRITERIA_A_FIGURE)
        ],
        reliability=reliability(certification.record),
    )


def _matrix_figures(certification: Certification, display: Display) -> Iterator[Drawing]:
    """The matrix in parts, slow before fast; if it would take too many, as a single figure of colours."""
    n = len(certification.matrix.ids)
    size = _CONDITIONS if n <= _CONDITIONS else _CONDITIONS_OF_MANY
    if n > size * _MOST_FIGURES:
        return iter([verdict_matrix(certification, display, words=False)])
    return (verdict_matrix(certification, display, slice(i, i + size)) for i in range(0, n, size))
