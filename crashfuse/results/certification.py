"""A certification as a result: the answer at every planned test, what speaks against it, evidence and files."""

from collections.abc import Sequence
from datetime import UTC, datetime
from functools import partial
from typing import Unpack

from crashfuse.campaign_folder.notes import Note
from crashfuse.certification.certify import Certification
from crashfuse.errors import one_of
from crashfuse.files.csv_text import csv_bytes
from crashfuse.results.campaign import campaign_result
from crashfuse.results.certification_facts import PLACES, against, answer, exceptions, sentences
from crashfuse.results.certification_record import certification_json
from crashfuse.results.certification_tables import certification_table, csv_as_given, makers_of_tables
from crashfuse.results.credibility import credibility_rows, credibility_table
from crashfuse.results.display import Display, DisplayOptions
from crashfuse.results.drawing import Drawing
from crashfuse.results.plots.certification import (
    planned_scales,
    record_figure,
    reliability,
    validated_domain,
    verdict_matrix,
)
from crashfuse.results.provenance import certify_command
from crashfuse.results.result import Deferred, Figure, ForReading, Result
from crashfuse.results.result_tables import repeats_table
from crashfuse.results.table import Table
from crashfuse.study.repeatability import repeatability

_CONDITIONS, _CONDITIONS_OF_MANY = 14, 10  # of a sheet at the height it has on paper; of several, two fill a page
_CRITERIA = 2  # of a sheet
_MOST_SHEETS = 20
_SHEET = ["Activity", "Factor", "Question", "What the data say", "Source"]


def certification_result(certification: Certification, notes: Sequence[Note] = ()) -> Result:
    """A certification, with what became of an earlier one if it is beside one, and readers' notes on its tests."""
    campaign, config, criteria = certification.campaign, certification.config, certification.criteria
    reading = partial(ForReading, usual=campaign.units)

    def repeats() -> Table:
        known = repeatability(campaign, config.windows_ms, seed=config.seed)
        return repeats_table(known, campaign.test_ids, config.windows_ms) or Table.of("repeats", ())

    return Result(
        kind="certification",
        title="certification by analysis",
        campaign=campaign,
        config=config,
        command=partial(certify_command, certification),
        held_out=campaign.test_ids,
        answer=answer(certification),
        against=against(certification),
        shown=("planned", "counts"),
        sentences={place: sentences(certification, place) for place in PLACES},
        tables=Deferred(
            **makers_of_tables(certification),
            credibility=lambda: Table.of("credibility", credibility_rows(certification).set_axis(_SHEET, axis=1)),
            repeats=repeats,
        ),
        figures=_figures(certification),
        parts={"data": (campaign_result(campaign),)},
        values={
            "date": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
            "key": certification.key,
            "n_conditions": len(certification.matrix.ids),
            "quantities": list(dict.fromkeys(criterion.label for criterion in criteria.items)),
            "confidence": criteria.confidence,
            "costs": criteria.costs,
            "exceptions": exceptions(certification),
            "notes": [(note.test, note.when, note.text) for note in notes],
            "earlier": certification.since and certification.since.earlier,
        },
        files={
            "certification.csv": reading(lambda units: csv_as_given(certification_table(certification, units))),
            "track_record.csv": lambda: csv_bytes(certification.track_record),
            "credibility.csv": reading(lambda units: csv_bytes(credibility_table(certification, units))),
            "certification.json": lambda: certification_json(certification),
        },
    )


def _figures(certification: Certification) -> dict[str, Figure]:
    record, n = certification.record, len(certification.matrix.ids)
    domain, matrix = partial(validated_domain, certification), partial(verdict_matrix, certification)
    size = _CONDITIONS if n <= _CONDITIONS else _CONDITIONS_OF_MANY
    scales = [partial(planned_scales, certification, part=slice(i, i + size)) for i in range(0, n, size)]
    close = Figure("How close each planned test is", partial(planned_scales, certification), is_answer=True)
    figures = {"planned": close._replace(sheets=tuple(scales[:_MOST_SHEETS]))}
    figures["domain"] = Figure("Validated domain, and the conditions in it", domain)
    if record.trials:
        judged = [criterion for criterion in certification.criteria.items if record.of(criterion)]
        parts = [judged[i : i + _CRITERIA] for i in range(0, len(judged), _CRITERIA)]
        draw, *sheets = (partial(record_figure, record, some) for some in (judged, *parts))
        figures["record"] = Figure("Evidence from left-out tests", draw, sheets=tuple(sheets))
        figures["reliability"] = Figure("Do the probabilities come true?", lambda _: reliability(record))
    sheets = [partial(matrix, part=slice(i, i + size)) for i in range(0, n, size)]
    if n > size * _MOST_SHEETS:
        sheets = [partial(matrix, words=False)]
    figures["verdicts"] = Figure("Verdicts", matrix, is_answer=True, sheets=tuple(sheets))
    return figures


def certification_figure(certification: Certification, figure: str, **display: Unpack[DisplayOptions]) -> Drawing:
    """A figure of a certification, see :meth:`Certification.plot`."""
    shown = Display.of(certification.campaign.units, **display)
    return one_of("figure of verdicts", figure, _figures(certification)).draw(shown)
