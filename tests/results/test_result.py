"""Every kind of result is shown by the same renderers."""

from collections.abc import Callable
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest

from crashfuse.campaign import Campaign
from crashfuse.results.certification import certification_result
from crashfuse.results.comparison import comparison_result
from crashfuse.results.display import Display
from crashfuse.results.files import RESULT_FILES, write_result
from crashfuse.results.planning import next_tests_result, speeds_table, sweep_result
from crashfuse.results.prediction import prediction_result
from crashfuse.results.render.figure_files import contents_of
from crashfuse.results.render.html import report
from crashfuse.results.render.text import lines
from crashfuse.results.result import Result
from crashfuse.results.study import study_result
from crashfuse.signals.metrics import checked_metrics
from crashfuse.signals.pulse import GRID_S
from crashfuse.study.history import StudyComparison
from crashfuse.units import KPH_KG
from tests.results.test_comparison import SECOND
from tests.results.test_units import certification, predicted, ranking, study, sweep
from tests.study.test_history import FIRST
from tests.study.test_history import study as past_study

KINDS: dict[str, Callable[[Campaign], Result]] = {
    "prediction": lambda campaign: prediction_result(predicted(campaign, campaign.tests[0])),
    "study": lambda campaign: study_result(study(campaign)),
    "comparison": lambda _: comparison_result(StudyComparison(past_study(FIRST), past_study(SECOND))),
    "sweep": lambda campaign: sweep_result(sweep(campaign)),
    "certification": lambda campaign: certification_result(certification(campaign)),
    "ranking of next tests": lambda campaign: next_tests_result(ranking(campaign)),
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_renderer_shows_every_kind(campaign: Campaign, kind: str) -> None:
    """Facts, answer in the reader's units, tables, figures in their order, and no file that is not of its kind."""
    result, display = KINDS[kind](replace(campaign, notice="Made up: of no car")), Display(system=KPH_KG)
    assert result.kind == kind
    assert {*result.files} < {*RESULT_FILES[kind]}
    html, printed = report(result, display), "\n".join(lines(result, display))
    slides, notebook = contents_of(result, display), result._repr_html_()
    assert html.contents == slides
    assert ("narrows the band of the bias (RMS) follows from" in html) is (kind == "ranking of next tests")
    assert html.count('class="plotly-graph-div"') == len(slides.figures) > 0
    assert kind == "comparison" or "Made up: of no car" in " ".join(result.notices)
    for notice in map(display.words, result.notices):
        assert (notice in slides.notices) is (notice not in slides.answers)
        assert all(notice in shown for shown in (printed, unescape(html), unescape(notebook)))
    assert not contents_of(replace(result, answer=result.notices, figures={}, parts={}), display).notices
    for sentence in map(display.words, result.answer):
        assert sentence in printed
        assert sentence in html
        assert sentence in slides.answers
    for subject, sentence in result.against.items():
        assert f"{subject}: {display.words(sentence)}" in slides.against
        assert all(display.words(sentence) in shown for shown in (printed, unescape(html)))
        assert subject in notebook
    for name in result.shown:
        for cell in result.tables[name].texts().iloc[0]:
            assert str(cell) in notebook
    assert slides.table[1] == tuple(result.tables[result.shown[0]].texts(display).iloc[0])


def test_the_report_that_is_written_is_in_the_readers_units(campaign: Campaign, tmp_path: Path) -> None:
    result, display = KINDS["sweep"](campaign), Display(system=KPH_KG)
    write_result(result, tmp_path, display)
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == report(result, display) != report(result)


def test_a_sweep_tells_what_its_last_approach_predicts(campaign: Campaign) -> None:
    """The most preferred one."""
    last = sweep(campaign)
    first = tuple(checked_metrics(-200 * np.exp(-GRID_S / 0.04), v0) for v0 in last.speeds_mps)
    both = replace(last, metrics={"lf_tcn": first, **last.metrics})
    assert speeds_table(both).texts().equals(speeds_table(last).texts())
