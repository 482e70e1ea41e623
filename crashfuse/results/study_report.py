"""Report of a study: how well each approach predicted every test that was left out, in short or in whole."""

import platform
from collections.abc import Mapping
from dataclasses import replace

import pandas as pd

from crashfuse.approaches.registry import LABELS, label_of
from crashfuse.crash_test import SPEED_STEP_MPS
from crashfuse.errors import UsageError, require_a
from crashfuse.results import rating_tables
from crashfuse.results.display import DEFAULT, Display
from crashfuse.results.fit_explanations import coverage_table, events_sentences, events_table, study_events
from crashfuse.results.past_results import comparison_means, left_out_in_words, studies_table
from crashfuse.results.plots.displacement import missing_force
from crashfuse.results.plots.ratings import rating_differences
from crashfuse.results.provenance import study_command
from crashfuse.results.render.figure_files import Report
from crashfuse.results.render.html import ReportOptions, details, render, render_in_frame
from crashfuse.results.result_tables import repeats_table
from crashfuse.signals.rating_explanation import rating_headline, rating_sentences
from crashfuse.study.comparison import StudyComparison
from crashfuse.study.facts import window_facts
from crashfuse.study.recommendation import Recommendation, recommend, recommend_without, worst_test
from crashfuse.study.study import Fold, Study
from crashfuse.units import speed
from crashfuse.version import __version__

_CAPTIONS = (
    (rating_tables.TABLE_3, "Table 3: the network before (LF) and after (MF) learning from the other tests"),
    (rating_tables.TABLE_5, "Table 5: the approaches against the raw CAE model"),
)


def study_report(study: Study, display: Display = DEFAULT, options: ReportOptions = ReportOptions()) -> Report:
    """HTML report of a study, means over all its tests; a UsageError if one to be shown was not left out."""
    require_a(Study, study, "crashfuse.run_study(campaign)")
    require_a(ReportOptions, options, "crashfuse.ReportOptions('short')")
    campaign, config = study.campaign, study.config
    held_out = [fold.held_out for fold in study.folds]
    if unknown := set(options.tests).difference(held_out):
        raise UsageError(f"The report cannot show {', '.join(sorted(unknown))}: the study did not leave it out.")
    if display.window_ms not in config.windows_ms:
        display = replace(display, window_ms=max(config.windows_ms))
    window, alone = display.window_ms, len(held_out) == 1
    worst, whole = worst_test(study, window), options.form == "whole"
    together = " with all tests at about its speed" if config.leave_out == "speed group" else ""
    verdict, heading, sentences = recommend(study).sentences, "The worst test", worst.sentences
    if alone:  # the verdict is the recommendation for this test, with how it came out
        advice = recommend_without(study, study.folds[0], window)
        after = advice.after(study.folds[0].ratings[advice.approach][window].overall)
        verdict = tuple(fact.sentence for fact in after)
        heading, sentences = "The test itself", tuple(fact.sentence for fact in worst.about_test)
    return render(
        "study" if whole else "short",
        f"test {held_out[0]} left out" if alone else f"study with each {config.split_configs[0].leave_out} left out",
        campaign,
        config,
        study_command(campaign, held_out, config, display.system),
        display,
        held_out,
        verdict=verdict,
        window=f"0–{window:g} ms",
        result=_result(study, display),
        notes=[(note.test, note.when, note.text) for note in options.notes if note.test in held_out],
        weak_spots=_weak_spots(study, recommend(study).approach),
        rated="Rating of the held-out test" if alone else "Mean rating over the held-out tests",
        left_out=f"{'The' if alone else 'Each'} test was left out{together} and predicted from the others.",
        worst_test={"heading": heading, "sentences": sentences},
        folds=[
            _fold(study, study.fold(test), options, display)
            for test in options.tests or (held_out if whole else [worst.test.id])
        ],
        answers=(),
        **(_whole(study, display) if whole else {}),
    )


def _whole(study: Study, display: Display) -> dict[str, object]:
    tables = [(caption, rating_tables.rating_table(study, rows)) for rows, caption in _CAPTIONS]
    held_out, events = [fold.held_out for fold in study.folds], study_events(study)
    return {
        "speed_groups": study.speed_groups and _result(study.speed_groups, display),
        "speed_step": speed(SPEED_STEP_MPS, form=".2g"),
        "repeats": repeats_table(study.repeatability, held_out, study.config.windows_ms),
        "paper_tables": [
            (caption, rating_tables.ratings_shown(table, "number")) for caption, table in tables if len(table)
        ],
        "spread": study.draw(figure="draws", display=display) if study.coverage else None,
        "band": study.coverage
        and {
            "tests": len(study.folds),
            "coverage": coverage_table(study.coverage),
            "curves": study.draw(figure="calibration", display=display),
        },
        "bias": study.campaign.draw("bias", display=display),
        "events": events
        and {
            "sentences": events_sentences(events),
            "table": events_table(events),
            "figure": missing_force(events, display),
        },
    }


def _result(study: Study, display: Display) -> dict[str, object]:
    heatmap = study.draw(display=display) if len(study.folds) > 1 else None
    return {"means": rating_tables.ratings_shown(rating_tables.mean_values(study), "number"), "heatmap": heatmap}


def _fold(study: Study, fold: Fold, options: ReportOptions, display: Display) -> Mapping[str, object]:
    test, window = study.campaign.test(fold.held_out), display.window_ms
    notes = [note for note in options.notes if note.test == test.id]
    advice, repeat = recommend_without(study, fold, window), study.repeats(window).get(test.id)
    rating = fold.ratings[advice.approach][window]
    shown: dict[str, object] = {
        "test": test,
        "advice": advice.sentences if len(study.folds) > 1 else (),
        "outcome": rating,
        "beyond": [fact.sentence for fact in window_facts(test, window)],
        "repeat": repeat and repeat.sentence(rating.overall, LABELS[advice.approach]),
        "motion": study.draw(test.id, notes=notes, display=display),
        "details": details(study.campaign, fold.estimates, test, said=advice.sentences),
    }
    if options.form == "short":
        return shown
    overall = {
        name: {f"0–{window:g} ms": rated[window].overall for window in study.config.windows_ms}
        | ({rating_tables.TTZV_COLUMN: fold.overall_to_ttzv(name)} if study.config.to_ttzv else {})
        for name, rated in fold.ratings.items()
    }
    return shown | {
        "notes": [(note.when, note.text) for note in notes],
        "ratings": rating_tables.ratings_shown(pd.DataFrame.from_dict(overall, orient="index"), "number"),
        "further": rating_tables.further_table(study, fold, window),
        "over_displacement": study.draw(test.id, "displacement", display=display),
        "why": _why(study, fold, advice, display),
    }


def _why(study: Study, fold: Fold, advice: Recommendation, display: Display) -> dict[str, object]:
    window, expected = display.window_ms, advice.expected
    rating, explanation = fold.ratings[advice.approach][window].overall, fold.explained(advice.approach, window)
    missed = expected is not None and expected.is_missed_by(rating)
    drawn = missed or fold.held_out == worst_test(study, window).test.id
    _, *parts = rating_sentences(explanation).values()
    return {
        "outcome": expected.outcome(rating) if expected is not None and len(study.folds) > 1 else None,
        "overall": rating_headline(explanation),  # its reason is among the parts
        "parts": parts,
        "curves": study.draw(fold.held_out, "rating", approaches=[advice.approach], display=display) if drawn else None,
    }


def _weak_spots(study: Study, approach: str) -> list[str]:
    window = max(study.config.windows_ms)
    poor = [fold.held_out for fold in study.folds if fold.ratings[approach][window].grade in ("Fair", "Poor")]
    outside = [test.id for test in study.campaign.tests if study.campaign.cae.extrapolation(test.condition)]
    spots = {
        f"Rated below Good in this study ({LABELS[approach]}, 0–{window:g} ms)": poor,
        "Outside the range of the CAE runs": outside,
    }
    return [f"{what}: {', '.join(tests)}." for what, tests in spots.items() if tests]


def comparison_report(compared: StudyComparison, display: Display = DEFAULT) -> Report:
    """HTML report of two studies: which one rates higher, in which tests, by how much, and what they are."""
    first, second = compared.first, compared.second
    window = compared.window(display.window_ms)
    names = dict.fromkeys([first.campaign, second.campaign])
    return render_in_frame(
        "comparison",
        f"{' and '.join(names)}: two studies compared",
        display,
        window=f"0–{window:g} ms",
        basis=first.basis,
        studies=studies_table(first, second),
        cautions=compared.cautions,
        ways=[
            {
                "label": left_out_in_words(way),
                "sentences": compared.sentences(window, way),
                "means": comparison_means(compared, window, way),
                "figure": rating_differences(compared, window, way),
            }
            for way in compared.ways
        ],
        origin={
            "Command": f"crashfuse compare {first.id} {second.id} --report FILE",
            "Campaign fingerprints (SHA-256)": " ".join(dict.fromkeys([first.fingerprint, second.fingerprint])),
            "Approaches": ", ".join(label_of(name) for name in compared.ratings["approach"].unique()),
            "crashfuse": __version__,
            "Python, platform": f"{platform.python_version()}, {platform.platform()}",
        },
    )
