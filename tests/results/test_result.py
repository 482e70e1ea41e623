"""Every kind of result is shown by the same renderers."""

from collections.abc import Callable
from html import unescape

import pytest

from crashfuse.campaign import Campaign
from crashfuse.results.certification import certification_result
from crashfuse.results.comparison import comparison_result
from crashfuse.results.display import Display
from crashfuse.results.files import RESULT_FILES
from crashfuse.results.planning import next_tests_result, sweep_result
from crashfuse.results.prediction import prediction_result
from crashfuse.results.render.figure_files import contents_of
from crashfuse.results.render.html import report
from crashfuse.results.render.text import lines
from crashfuse.results.result import Result
from crashfuse.results.study import study_result
from crashfuse.study.history import StudyComparison
from crashfuse.study.prediction import PredictedPulse
from crashfuse.units import KPH_KG
from tests.results.test_comparison import SECOND
from tests.results.test_report import CONFIG, estimate
from tests.results.test_units import certification, ranking, study, sweep
from tests.study.test_history import FIRST
from tests.study.test_history import study as past_study

KINDS: dict[str, Callable[[Campaign], Result]] = {
    "prediction": lambda campaign: prediction_result(PredictedPulse(campaign, (estimate(campaign.tests[0]),), CONFIG)),
    "study": lambda campaign: study_result(study(campaign)),
    "comparison": lambda _: comparison_result(StudyComparison(past_study(FIRST), past_study(SECOND))),
    "sweep": lambda campaign: sweep_result(sweep(campaign)),
    "certification": lambda campaign: certification_result(certification(campaign)),
    "ranking of next tests": lambda campaign: next_tests_result(ranking(campaign)),
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_renderer_shows_every_kind(campaign: Campaign, kind: str) -> None:
    """Its answer in the reader's units, its tables, its figures in their order, and no file that is not of its kind."""
    result, display = KINDS[kind](campaign), Display(system=KPH_KG)
    assert result.kind == kind
    assert {*result.files} < {*RESULT_FILES[kind]}
    html, printed = report(result, display), "\n".join(lines(result, display))
    slides, notebook = contents_of(result, display), result._repr_html_()
    assert html.contents == slides
    assert html.count('class="plotly-graph-div"') == len(slides.figures) > 0
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
