"""Report of a study: how well each approach predicted every test that was left out."""

import html

import pandas as pd

from crashfuse.approaches.calibration import LEVELS
from crashfuse.approaches.registry import LABELS
from crashfuse.reporting.fit_explanations import coverage_table
from crashfuse.reporting.paper_tables import TABLE_3, TABLE_5, best, rating_table
from crashfuse.reporting.plots.calibration import calibration_curves
from crashfuse.reporting.plots.displacement import over_displacement
from crashfuse.reporting.plots.pulses import motion
from crashfuse.reporting.plots.ratings import rating_heatmap, rating_spread
from crashfuse.reporting.provenance import provenance, study_command
from crashfuse.reporting.report.page import figure, page, paragraphs, section, table, text
from crashfuse.reporting.report.sections import (
    OVER_DISPLACEMENT,
    bias,
    data,
    fits,
    limits,
    method,
    metrics,
    notes,
    origin,
)
from crashfuse.signals.metrics import pulse_metrics
from crashfuse.study.fold import Fold
from crashfuse.study.recommendation import recommend, recommend_for
from crashfuse.study.study import Study

_RATING = (
    "Overall rating by ISO/TS 18571: 1 is a perfect match; Excellent above 0.94, Good above 0.80, Fair above 0.58, "
    "else Poor. The best is in bold."
)
_CONTENTS = {
    "result": "Result",
    "tables": "Tables by test",
    "band": "Band",
    "data": "Data",
    "method": "Method",
    "bias": "Bias",
    "tests": "Each test",
    "limits": "Limits",
    "origin": "Origin",
}


def study_report(study: Study) -> str:
    """Report of a study as one HTML page.

    Parameters
    ----------
    study : Study
    """
    campaign, config, verdict = study.campaign, study.config, recommend(study)
    links = "".join(f'<a href="#{name}">{title}</a>' for name, title in _CONTENTS.items())
    held_out = [fold.held_out for fold in study.folds]
    parts = [
        f"<nav>{links}</nav>",
        f"<div class=verdict>{paragraphs(verdict.sentences)}</div>",
        _result(study),
        _tables(study),
        _band(study),
        data(campaign),
        method(config),
        bias(campaign),
        '<div id="tests"></div>',
        *(_test(study, fold) for fold in study.folds),
        limits(campaign, _weak_spots(study, verdict.approach)),
        paragraphs(["How each fit went is folded away on the screen, not printed; it is in study.json too."], "quiet"),
        origin(provenance(campaign, held_out, config), study_command(campaign, held_out, config)),
    ]
    left_out = "speed group" if config.hold_out == "speed group" else "test"
    return page(f"{campaign.name}: study with each {left_out} left out", campaign, parts)


def _result(study: Study) -> str:
    window = max(study.config.windows_ms)
    how = "Each test was left out in turn and predicted from all others."
    if study.config.hold_out == "speed group":
        how = "Each test was left out together with all tests at about its speed, and predicted from the rest."
    groups = study.speed_groups
    return section(
        "Result: mean rating over the held-out tests",
        paragraphs([f"{how} Nothing that predicts a test sees its pulse. {_RATING}"]),
        _means(study),
        f"<h3>Every held-out test, 0–{window:g} ms</h3>",
        figure(rating_heatmap({fold.held_out: _overall(fold, window) for fold in study.folds})),
        ""
        if groups is None
        else "<h3>A whole speed group left out</h3><p>The harder question: each test is predicted without any other at "
        f"about its speed (less than 2 mph to the next).</p>{_means(groups)}"
        + figure(rating_heatmap({fold.held_out: _overall(fold, window) for fold in groups.folds})),
        name="result",
    )


def _means(study: Study) -> str:
    windows = {window: f"0–{window:g} ms" for window in study.config.windows_ms}
    means = pd.DataFrame(
        {label: {name: study.mean_rating(name, w) for name in study.config.approaches} for w, label in windows.items()}
    )
    bold = means.round(3) == means.round(3).max()
    return _rating_rows(means, bold, {"Approach": [LABELS[name] for name in means.index]})


def _tables(study: Study) -> str:
    parts = []
    captions = (
        (TABLE_3, "Table 3: the network before (LF) and after (MF) it has seen the other tests"),
        (TABLE_5, "Table 5: the approaches against the raw CAE model"),
    )
    for rows, caption in captions:
        found = rating_table(study, rows)
        if len(found):
            names = {level: found.index.get_level_values(level) for level in ("Test", "Approach")}
            parts += [f"<h3>{text(caption)}</h3>", _rating_rows(found, best(found), names)]
    spread = study.rating_spread(max(study.config.windows_ms))
    if any(spread.values()):
        parts += [
            "<h3>How sure the ratings are</h3><p>Marks: the rating of the expected pulse. Lines: where the ratings of "
            "95 % of single pulses drawn from the band lie, each rated against the same test. A single draw has every "
            "wiggle in another place, so it rates lower than the expected pulse.</p>",
            figure(rating_spread(spread)),
        ]
    return section("Ratings by test, in the form of the paper's tables", *parts, name="tables")


def _rating_rows(values: pd.DataFrame, bold: pd.DataFrame, names: dict[str, object]) -> str:
    shown = pd.DataFrame(
        {
            column: [f"<b>{x:.3f}</b>" if b else f"{x:.3f}" for x, b in zip(values[column], bold[column], strict=True)]
            for column in values
        }
    )
    for place, (heading, cells) in enumerate(names.items()):
        shown.insert(place, heading, [html.escape(str(cell)) for cell in cells])  # type: ignore[attr-defined]
    return table(shown, escape=False, kind="ratings" if len(names) > 1 else "")


def _band(study: Study) -> str:
    if not study.coverage:
        return ""
    n = len(study.folds)
    return section(
        "What the 95 % band is worth",
        paragraphs(
            [f"How much of the held-out tests lies inside it. With {n} tests no more can be promised than these."]
        ),
        table(coverage_table(study.coverage)),
        "<p>The same for every level from 5 to 95 %, a(t) up to t0: above the diagonal a band is wider than it need "
        "be, below it too narrow.</p>",
        figure(calibration_curves(LEVELS, study.reliability)),
        name="band",
    )


def _test(study: Study, fold: Fold) -> str:
    test = study.campaign.test(fold.held_out)
    window = max(study.config.windows_ms)
    predictions = {estimate.approach: estimate.prediction for estimate in fold.estimates}
    speed = test.condition.speed_mps
    advice = recommend_for(fold.estimates, study.config.rest(study.campaign, test.id), test.condition, window)
    found = fold.ratings[advice.approach][window]
    outcome = f"It then rated {found.overall:.3f} ({found.grade})."
    measured = pulse_metrics(test.pulse.accel_mps2, speed, dt_s=test.pulse.dt_s)
    ratings = pd.DataFrame(
        {f"0–{w:g} ms": {name: own[w].overall for name, own in fold.ratings.items()} for w in study.config.windows_ms}
    )
    bold = ratings.round(3) == ratings.round(3).max()
    return section(
        f"Test {test.id}: {test.condition}",
        "<h3>Recommended before it was run</h3>",
        paragraphs([*advice.sentences, outcome]),
        figure(motion(test.pulse, predictions, speed_mps=speed, window_ms=window)),
        _rating_rows(ratings, bold, {"Approach": [LABELS[name] for name in ratings.index]}),
        OVER_DISPLACEMENT,
        figure(over_displacement(test.pulse, predictions, speed_mps=speed)),
        metrics([("Measured", measured), *((LABELS[e.approach], e.metrics) for e in fold.estimates)]),
        notes(fold.estimates),
        fits(fold.estimates),
        kind="test",
    )


def _overall(fold: Fold, window_ms: float) -> dict[str, float]:
    return {approach: ratings[window_ms].overall for approach, ratings in fold.ratings.items()}


def _weak_spots(study: Study, chosen: str) -> list[str]:
    """Tests that the recommended approach did not predict well, and those outside the CAE runs."""
    window = max(study.config.windows_ms)
    poor = [fold.held_out for fold in study.folds if fold.ratings[chosen][window].grade in ("Fair", "Poor")]
    outside = [test.id for test in study.campaign.tests if study.campaign.cae.extrapolation(test.condition)]
    said = []
    if poor:
        said.append(f"Less than Good in this study: {', '.join(poor)} ({LABELS[chosen]}, 0–{window:g} ms).")
    if outside:
        said.append(f"Outside the range of the CAE runs: {', '.join(outside)}.")
    return said
