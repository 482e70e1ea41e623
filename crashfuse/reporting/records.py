"""What a study, a prediction and a learning curve leave beside their tables, as plain JSON values."""

from collections.abc import Sequence
from dataclasses import asdict

from crashfuse.approaches.nearness import nearest_sentences
from crashfuse.campaign import Campaign
from crashfuse.reporting.provenance import provenance
from crashfuse.signals.rating_sentences import rating_sentences
from crashfuse.study.account import worst_test
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.facts import condition_facts
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.study.one_more_test import Cost, gains, one_more, sentences
from crashfuse.study.recommendation import recommend, recommend_for, recommend_without
from crashfuse.study.study import Study


def study_record(study: Study) -> dict[str, object]:
    """``study.json`` of a finished study."""
    campaign, config = study.campaign, study.config
    window = max(config.windows_ms)
    tests = {}
    for fold in study.folds:
        advice = recommend_without(study, fold, window)
        rating = fold.ratings[advice.approach][window].overall
        tests[fold.held_out] = {
            "approach": advice.approach,
            "sentences": list(advice.sentences),
            "expected_rating": None if advice.expected is None else asdict(advice.expected),
            "rating": rating,
            "outcome": None if advice.expected is None else advice.expected.outcome(rating),
            "why": rating_sentences(fold.explained(advice.approach, window))["overall"],
        }
    verdict, worst = recommend(study), worst_test(study)
    return {
        **provenance(campaign, [fold.held_out for fold in study.folds], config),
        "finished": True,
        "seconds": {key: round(value, 3) for key, value in study.seconds.items()},
        "recommendation": {
            "campaign": {"approach": verdict.approach, "sentences": list(verdict.sentences)},
            "tests": tests,
        },
        "worst_test": {
            "id": worst.test.id,
            "approach": worst.approach,
            "rating": worst.rating,
            "without_neighbours": worst.without_neighbours,
            "departure": None if worst.departure is None else asdict(worst.departure),
            "stands_apart": None if worst.departure is None else worst.departure.apart,
            "sentences": list(worst.sentences),
        },
        "coverage": {name: found.counts for name, found in study.coverage.items()},
        "speed_groups": None
        if (groups := study.speed_groups) is None
        else {
            "mean_rating": {name: round(groups.mean_rating(name, window), 4) for name in config.approaches},
            "coverage": {name: found.counts for name, found in groups.coverage.items()},
        },
        "rating_intervals": {
            fold.held_out: {
                name: {f"{w:g}": [round(end, 4) for end in fold.rating_interval(name, w)] for w in config.windows_ms}
                for name in fold.with_band
            }
            for fold in study.folds
        },
        "repeatability": {
            fold.held_out: {
                f"{w:g}": {end: round(getattr(repeat, end), 4) for end in ("value", "lower", "upper")}
                for w, repeat in study.repeatability.get(fold.held_out, {}).items()
            }
            for fold in study.folds
        },
        "fits": [
            {"held_out": fold.held_out, **_fit_record(estimate)} for fold in study.folds for estimate in fold.estimates
        ],
    }


def prediction_record(campaign: Campaign, estimates: Sequence[Estimate], config: StudyConfig) -> dict[str, object]:
    """``prediction.json``."""
    condition = estimates[0].prediction.condition
    advice = recommend_for(estimates, campaign, condition)
    return {
        **provenance(campaign, (), config),
        "condition": {k: v for k, v in asdict(condition).items() if k != "units"},
        "extrapolation": list(campaign.cae.extrapolation(condition)),
        "facts_here": [fact.record for fact in condition_facts(campaign, condition)],
        "nearest": list(nearest_sentences(campaign, condition)),
        "recommendation": {"approach": advice.approach, "sentences": list(advice.sentences)},
        "expected_rating": None if advice.expected is None else asdict(advice.expected),
        "fits": [_fit_record(estimate) for estimate in estimates],
    }


def learning_curve_record(curve: LearningCurve, cost: Cost | None) -> dict[str, object]:
    """``learning_curve.json``."""
    more = one_more(curve)
    return {
        **provenance(curve.campaign, curve.campaign.test_ids, curve.config),
        "repeats": curve.repeats,
        "seconds": round(curve.seconds, 3),
        "approach": curve.judged,
        "sentences": list(sentences(curve, cost)),
        "gains": [asdict(gain) for gain in gains(curve)],
        "one_more_test": None if more is None else asdict(more),
        "cost_per_test": None if cost is None else asdict(cost),
    }


def _fit_record(estimate: Estimate) -> dict[str, object]:
    return {
        "approach": estimate.approach,
        "seconds": round(estimate.seconds, 3),
        "notes": list(estimate.prediction.notes),
        "state": estimate.state,
    }
