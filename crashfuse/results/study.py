"""A study as a result: how well each approach predicted every test that was left out, in short or in whole."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from crashfuse.approaches.registry import LABELS
from crashfuse.errors import UsageError, require_a
from crashfuse.files.csv_text import csv_bytes
from crashfuse.results import rating_tables
from crashfuse.results.campaign import campaign_result
from crashfuse.results.display import DEFAULT, Display
from crashfuse.results.drawing import Drawing
from crashfuse.results.fit_explanations import bias_result, coverage_table, estimates_result, events_window_ms
from crashfuse.results.provenance import fit_record, provenance, recommendation_record, study_command
from crashfuse.results.render.figure_files import Report
from crashfuse.results.render.html import ReportOptions, report
from crashfuse.results.render.text import json_bytes
from crashfuse.results.result import Content, Deferred, Figure, Result
from crashfuse.results.result_tables import repeats_table
from crashfuse.results.table import Column, Table
from crashfuse.signals.rating import graded
from crashfuse.signals.rating_explanation import rating_headline, rating_sentences
from crashfuse.study.facts import campaign_facts, window_facts
from crashfuse.study.recommendation import Account, recommend, recommend_without, study_facts, worst_test
from crashfuse.study.repeatability import Repeatability
from crashfuse.study.study import Fold, Study
from crashfuse.units import Sentence, joined, speed

_PAPER_TABLES: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "table_3": ("Table 3: the network before (LF) and after (MF) learning from the other tests", rating_tables.TABLE_3),
    "table_5": ("Table 5: the approaches against the raw CAE model", rating_tables.TABLE_5),
}
_LEFT_OUT = {"test": "A test left out", "speed group": "A speed left out"}
_WAYS = {"test": "left out alone", "speed group": "left out with all tests at about its speed"}


def study_report(study: Study, display: Display = DEFAULT, options: ReportOptions = ReportOptions()) -> Report:
    """HTML report of a study; a UsageError if a test to be shown was not left out."""
    return report(study_result(study, options, display.window_ms), display)


def study_result(study: Study, options: ReportOptions = ReportOptions(), window_ms: float | None = None) -> Result:
    """A study over a window (by default the longest), its report's tests as parts."""
    require_a(Study, study, "crashfuse.run_study(campaign)")
    require_a(ReportOptions, options, "crashfuse.ReportOptions('short')")
    campaign, config, held_out = study.campaign, study.config, tuple(fold.held_out for fold in study.folds)
    if unknown := set(options.tests).difference(held_out):
        raise UsageError(f"The report cannot show {', '.join(sorted(unknown))}: the study did not leave it out.")
    window = window_ms if window_ms in config.windows_ms else max(config.windows_ms)
    alone, whole, way = len(held_out) == 1, options.form == "whole", _WAYS[_way(study)]
    worst, verdict = worst_test(study, window), recommend(study).facts
    heading, about = "The worst test", worst.sentences
    if alone:  # the verdict is the recommendation for this test, with how it came out
        advice = recommend_without(study, study.folds[0], window)
        verdict = advice.after(study.folds[0].ratings[advice.approach][window].overall)
        heading, about = "The test itself", tuple(fact.sentence for fact in worst.about_test)
    known = {fact.sentence for fact in campaign_facts(campaign)}
    left_out = f"{'The' if alone else 'Each'} test was {way} and predicted from the others"
    tests = options.tests or (held_out if whole else (worst.test.id,))
    of_campaign: dict[str, Callable[[], tuple[Result, ...]]] = {
        "data": lambda: (campaign_result(campaign),),
        "bias": lambda: (bias_result(campaign, events_window_ms(study)),),
    }
    return Result(
        kind="study",
        template="study" if whole else "short",
        title=f"test {held_out[0]} left out" if alone else f"study with each {_way(study)} left out",
        campaign=campaign,
        config=config,
        command=partial(study_command, campaign, held_out, config),
        held_out=held_out,
        answer=(*(fact.sentence for fact in verdict), f"{left_out}, rated by {campaign.rating_basis}."),
        shown=("means",) if study.speed_groups is None else ("means", "speed_groups"),
        sentences={
            "remarks": tuple(text for text in about if text not in known),
            "weak_spots": tuple(_weak_spots(study, recommend(study).approach)),
        },
        tables=_tables(study),
        figures=_figures(study, window, whole=whole),
        parts=Deferred(
            **(of_campaign if whole else {}),
            folds=lambda: tuple(_fold(study, study.fold(test), window, options) for test in tests),
        ),
        values={
            "remarks": heading,
            "window": f"0–{window:g} ms",
            "notes": [(note.test, note.when, note.text) for note in options.notes if note.test in held_out],
        },
        files=study_files(study),
    )


def _way(study: Study) -> str:
    return study.config.split_configs[0].leave_out


def means_table(study: Study) -> Table:
    """Mean rating of each approach over each window with its grade."""
    of = "Rating of the held-out test," if len(study.folds) == 1 else "Mean rating over the held-out tests, each"
    return replace(rating_tables.ratings_shown(rating_tables.mean_values(study)), name=f"{of} {_WAYS[_way(study)]}")


def quality_table(study: Study, window_ms: float) -> Table:
    """How good predictions are, in the mean and worst test: a test left out, a speed."""
    rows = []
    for view in filter(None, (study, study.speed_groups)):
        approach = recommend(view).approach
        rated = {fold.held_out: fold.ratings[approach][window_ms].overall for fold in view.folds}
        grades = {"Mean": float(np.mean([*rated.values()])), "Worst": min(rated.values())}
        worst = {"Worst test": min(rated, key=rated.__getitem__), "Approach": LABELS[approach]}
        rows.append({"How good is a prediction?": _LEFT_OUT[_way(view)], **grades, **worst})
    return Table.of("quality", rows, Column("Mean", "grade"), Column("Worst", "grade"))


def quality_of(account: Account, repeat: Repeatability | None) -> dict[Sentence, Sentence]:
    """How good a prediction is, by what was left out, and what a repeat would rate."""
    test, expected, rated = account.test, account.expected, graded(account.rating)
    at_its_speed = Sentence("All at {} left out", speed(test.condition.speed_mps))
    if expected is not None:
        rated = f"{rated}, {expected.surprise(account.rating)} ({expected.range})"
    lines = {at_its_speed if account.with_group else Sentence("{} left out", test.id): Sentence("{}.", rated)}
    if not account.with_group:
        without = "not computed yet, see Study" if account.neighbours else "the same"
        if account.without_neighbours is not None:
            without = graded(account.without_neighbours)
        lines[at_its_speed] = Sentence("{}.", without)
    if repeat is not None and repeat.repeats:
        lines[Sentence("A repeat of {}", test.id)] = Sentence("{}.", repeat.text)
    return lines


def _tables(study: Study) -> dict[str, Table]:
    tables, groups = {"means": means_table(study)}, study.speed_groups
    if groups is not None:
        tables["speed_groups"] = means_table(groups)
    for name, (caption, rows) in _PAPER_TABLES.items():
        if len(ratings := rating_tables.rating_table(study, rows)):
            tables[name] = replace(rating_tables.ratings_shown(ratings, "number"), name=caption)
    held_out = [fold.held_out for fold in study.folds]
    if (repeats := repeats_table(study.repeatability, held_out, study.config.windows_ms)) is not None:
        tables["repeats"] = repeats
    if study.coverage:
        tables["coverage"] = coverage_table(study.coverage)
    return tables


def _figures(study: Study, window: float, *, whole: bool) -> dict[str, Figure]:
    figures, groups, over = {}, study.speed_groups, f"0–{window:g} ms"
    if len(study.folds) > 1:
        figures["ratings"] = Figure(f"Every held-out test, {over}", _drawn(window, study.draw), is_answer=True)
    if whole and groups is not None and len(groups.folds) > 1:
        figures["speed_groups"] = Figure("A whole speed group left out", _drawn(window, groups.draw), is_answer=True)
    if whole and study.coverage:
        spread, calibration = (partial(study.draw, figure=name) for name in ("draws", "calibration"))
        figures["spread"] = Figure(f"How sure the ratings are, {over}", _drawn(window, spread))
        figures["calibration"] = Figure("What the 95 % band is worth", _drawn(window, calibration))
    return figures


def _drawn(window: float, draw: Callable[..., Drawing]) -> Callable[[Display], Drawing]:
    return lambda display: draw(display=replace(display, window_ms=window))


def _fold(study: Study, fold: Fold, window: float, options: ReportOptions) -> Result:
    test, several = fold.test, len(study.folds) > 1
    notes = [note for note in options.notes if note.test == test.id]
    advice, repeat = recommend_without(study, fold, window), study.repeatability.get(test.id, {}).get(window)
    rating, explanation = fold.ratings[advice.approach][window], fold.explained(advice.approach, window)
    expected, (_, *parts) = advice.expected, rating_sentences(explanation).values()
    outcome = [f"It then rated {rating.overall:.3f} ({rating.grade}) over 0–{window:g} ms."] if several else []
    outcome += [repeat.sentence(rating.overall, LABELS[advice.approach])] if repeat is not None else []
    came_out = [expected.outcome(rating.overall)] if expected is not None and several else []
    about = estimates_result(study.campaign, fold.estimates, test, advice.sentences)
    draw, further = partial(study.draw, test.id), rating_tables.further_table(study, fold, window)
    figures = {"motion": Figure("Pulses over time", _drawn(window, partial(draw, notes=notes)), not several)}
    if options.form == "whole":
        missed = expected is not None and expected.is_missed_by(rating.overall)
        if missed or test.id == worst_test(study, window).test.id:
            by_part = partial(draw, "rating", approaches=[advice.approach])
            figures["rating"] = Figure("Why it is rated as it is", _drawn(window, by_part))
        figures["displacement"] = Figure("Over displacement", _drawn(window, partial(draw, "displacement")))
    return replace(
        about,
        kind="fold",
        title=Sentence("Test {}: {}", test.id, test.condition),
        sentences={
            **about.sentences,
            "advice": advice.sentences if several else (),
            "outcome": (joined(outcome),) if outcome else (),
            "beyond": tuple(fact.sentence for fact in window_facts(test, window)),
            "why": (joined([*came_out, rating_headline(explanation)]),),  # its reason is among the parts
            "rating_parts": tuple(parts),
        },
        tables={**about.tables, "ratings": _ratings_of_test(study, fold), "further": further},
        figures=figures,
        values={"notes": [(note.when, note.text) for note in notes]},
    )


def _ratings_of_test(study: Study, fold: Fold) -> Table:
    overall = {
        name: {f"0–{window:g} ms": rated[window].overall for window in study.config.windows_ms}
        | ({rating_tables.TTZV_COLUMN: fold.overall_to_ttzv(name)} if study.config.to_ttzv else {})
        for name, rated in fold.ratings.items()
    }
    return rating_tables.ratings_shown(pd.DataFrame.from_dict(overall, orient="index"), "number")


def _weak_spots(study: Study, approach: str) -> list[str]:
    window = max(study.config.windows_ms)
    poor = [fold.held_out for fold in study.folds if fold.ratings[approach][window].grade in ("Fair", "Poor")]
    outside = [test.id for test in study.campaign.tests if study.campaign.cae.extrapolation(test.condition)]
    spots = {
        f"Rated below Good in this study ({LABELS[approach]}, 0–{window:g} ms)": poor,
        "Outside the range of the CAE runs": outside,
    }
    return [f"{what}: {', '.join(tests)}." for what, tests in spots.items() if tests]


def study_files(study: Study) -> dict[str, Callable[[], Content]]:
    """The files of a study by their names, without its report."""
    groups, window_ms = study.speed_groups, events_window_ms(study)
    return {
        "scores.csv": lambda: csv_bytes(study.scores),
        **({} if groups is None else {"speed_groups.csv": lambda: csv_bytes(groups.scores)}),
        "pulses.csv": lambda: csv_bytes(study.pulses),
        "metrics.csv": lambda: csv_bytes(study.metrics),
        **({} if window_ms is None else {"cae_events.csv": lambda: csv_bytes(study.campaign.cae_events(window_ms))}),
        "study.json": lambda: json_bytes(study_record(study)),
    }


def study_record(study: Study) -> dict[str, object]:
    """``study.json`` of a finished study."""
    campaign, config, groups = study.campaign, study.config, study.speed_groups
    window = max(config.windows_ms)
    tests = {}
    for fold in study.folds:
        advice = recommend_without(study, fold, window)
        rating = fold.ratings[advice.approach][window].overall
        tests[fold.held_out] = {
            **recommendation_record(advice),
            "rating": rating,
            "outcome": advice.expected and advice.expected.outcome(rating),
            "why": rating_sentences(fold.explained(advice.approach, window))["overall"],
        }
    verdict = recommend(study)
    return {
        **provenance(campaign, [fold.held_out for fold in study.folds], config),
        "facts": [fact.record for fact in study_facts(study)],
        "finished": True,
        "seconds": {key: round(value, 3) for key, value in study.seconds.items()},
        "recommendation": {
            "campaign": {"approach": verdict.approach, "sentences": list(verdict.sentences)},
            "tests": tests,
        },
        "coverage": {name: coverage.counts for name, coverage in study.coverage.items()},
        "speed_groups": groups
        and {
            "mean_rating": {name: round(groups.mean_rating(name, window), 4) for name in config.approaches},
            "coverage": {name: coverage.counts for name, coverage in groups.coverage.items()},
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
            {"held_out": fold.held_out, **fit_record(estimate)} for fold in study.folds for estimate in fold.estimates
        ],
    }
