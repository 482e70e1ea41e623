"""Part of a study's report on why a test is rated as it is, and how the expectation came out."""

from crashfuse.reporting.plots.display import Display
from crashfuse.signals.rating_sentences import rating_headline, rating_sentences
from crashfuse.study.account import worst_test
from crashfuse.study.fold import Fold
from crashfuse.study.recommendation import Recommendation
from crashfuse.study.study import Study


def why(study: Study, fold: Fold, advice: Recommendation, display: Display) -> dict[str, object]:
    """How the expectation came out, what the rating of the recommended approach is made of, and its curves.

    These are drawn for the worst test, and for those that came out below what was expected.
    """
    window_ms = display.window_ms
    rating = fold.ratings[advice.approach][window_ms].overall
    explanation = fold.explained(advice.approach, window_ms)
    missed = advice.expected is not None and advice.expected.is_missed_by(rating)
    drawn = missed or fold.held_out == worst_test(study, window_ms).test.id
    _, *parts = rating_sentences(explanation).values()
    return {
        "outcome": advice.expected.outcome(rating) if advice.expected is not None and len(study.folds) > 1 else None,
        "overall": rating_headline(explanation),  # its reason is among the parts
        "parts": parts,
        "curves": study.plot(fold.held_out, "rating", approaches=[advice.approach], display=display) if drawn else None,
    }
