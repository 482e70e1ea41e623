"""The report: one HTML file that needs no network and prints on paper."""

import html
from collections.abc import Callable, Iterable, Mapping, Sequence

import pandas as pd
import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

from crashfuse.approaches import LABELS
from crashfuse.approaches.displacement_domain import measured_bias
from crashfuse.cache import Cache
from crashfuse.cae_model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.estimate import Estimate
from crashfuse.fits import coverage_table, fit_sentences, fit_table
from crashfuse.metrics import METRIC_LABELS, Metric, missing_sentences
from crashfuse.plots.displacement import bias_by_speed, over_displacement
from crashfuse.plots.pulses import overlay
from crashfuse.plots.ratings import rating_heatmap
from crashfuse.study import Fold, Study
from crashfuse.units import LB, MPH

_HELD_OUT = {
    "test": "Each test was left out in turn and predicted from all others.",
    "speed group": "Each test was left out together with all tests within 2 mph of it, and predicted from the rest.",
}
_STYLE = """
body { font: 15px/1.5 system-ui, "Segoe UI", sans-serif; color: #262a33; max-width: 62rem;
       margin: 2rem auto; padding: 0 1rem }
h1 { font-size: 1.7rem }
h2 { font-size: 1.25rem; margin-top: 2.2rem; border-bottom: 1px solid #d5d9e0 }
table { border-collapse: collapse; margin: .6rem 0; font-variant-numeric: tabular-nums }
th, td { padding: .2rem .8rem; border-bottom: 1px solid #e3e6ea; text-align: right }
th:first-child, td:first-child { text-align: left }
thead th { border-bottom: 2px solid #262a33 }
.notice { background: #fff4d6; border-left: 4px solid #d9a400; padding: .6rem 1rem }
.quiet { color: #5a6270 }
code { overflow-wrap: anywhere }
@media print { section { break-inside: avoid } h2 { break-after: avoid } body { margin: 0; max-width: none } }
"""

_OVER_DISPLACEMENT = (
    "<p>The same over displacement, up to maximum crush (the marks, with their 95 % interval). Between a curve and "
    "zero lies the energy that was absorbed, the same for all.</p>"
)


def study_report(study: Study, scores: pd.DataFrame, metrics: pd.DataFrame, record: Mapping[str, object]) -> str:
    """Report of a leave-one-test-out study as one HTML page.

    Parameters
    ----------
    study : Study
    scores, metrics : DataFrame
        As in ``scores.csv`` and ``metrics.csv``.
    record : mapping
        As in ``study.json``.
    """
    campaign = study.campaign
    window = max(study.config.windows_ms)
    mean = scores.groupby(["approach", "window_ms"], sort=False)["overall"].mean().unstack(sort=False)
    parts = [
        _data(campaign),
        "<h2>Result: mean rating over the held-out tests</h2>",
        f"<p>{_HELD_OUT[study.config.hold_out]} Overall rating by ISO/TS 18571 (1 is a "
        "perfect match; Excellent above 0.94, Good above 0.80, Fair above 0.58, else Poor); best in bold.</p>",
        _ratings(mean.set_axis([f"0–{w:g} ms" for w in mean.columns], axis=1)),
        f"<h2>Rating of every held-out test, 0–{window:g} ms</h2>",
        _figure(rating_heatmap({fold.held_out: _overall(fold, window) for fold in study.folds})),
        _coverage(study),
        _bias(campaign),
    ]
    for fold in study.folds:
        test = campaign.test(fold.held_out)
        table = scores[scores["held_out"] == fold.held_out].pivot_table("overall", "approach", "window_ms", sort=False)
        predictions = {estimate.approach: estimate.prediction for estimate in fold.estimates}
        parts += [
            f"<section><h2>Test {_text(test.id)}: {_text(test.condition)}</h2>",
            _figure(overlay(test.pulse, predictions, window_ms=window)),
            _OVER_DISPLACEMENT,
            _figure(over_displacement(test.pulse, predictions, speed_mps=test.condition.speed_mps)),
            _ratings(table.set_axis([f"0–{w:g} ms" for w in table.columns], axis=1)),
            _metrics(metrics[metrics["held_out"] == fold.held_out]),
            _notes(fold.estimates),
            _fits(fold.estimates),
            "</section>",
        ]
    parts.append(_provenance(record))
    return _page(f"{campaign.name}: leave-one-test-out study", campaign, parts)


def prediction_report(
    campaign: Campaign, estimates: Sequence[Estimate], metrics: pd.DataFrame, record: Mapping[str, object]
) -> str:
    """Report of a prediction at a new condition as one HTML page; parameters as in :func:`study_report`."""
    condition = estimates[0].prediction.condition
    predictions = {estimate.approach: estimate.prediction for estimate in estimates}
    parts = [
        f"<section><h2>Prediction at {_text(condition)}</h2>",
        "<p>Nothing was measured at this condition: there is no rating. A study of the same campaign tells how well "
        "the approaches predict tests that were left out.</p>",
        _figure(overlay(None, predictions)),
        _OVER_DISPLACEMENT,
        _figure(over_displacement(None, predictions, speed_mps=condition.speed_mps)),
        _metrics(metrics),
        _notes(estimates),
        _fits(estimates),
        "</section>",
        _data(campaign),
        _bias(campaign),
        _provenance(record),
    ]
    return _page(f"{campaign.name}: prediction at {condition}", campaign, parts)


def _overall(fold: Fold, window_ms: float) -> dict[str, float]:
    return {approach: ratings[window_ms].overall for approach, ratings in fold.ratings.items()}


def _data(campaign: Campaign) -> str:
    pairs = {
        test.id: "emulator" if (run := campaign.cae.paired_run(test.condition)) is None else campaign.cae.ids[run]
        for test in campaign.tests
    }
    rows = pd.DataFrame(
        {
            "Test": test.id,
            "Speed (mph)": f"{test.condition.speed_mps / MPH:.1f}",
            "Front weight (lb)": f"{test.condition.front_weight_kg / LB:.0f}",
            "Rear weight (lb)": f"{test.condition.rear_weight_kg / LB:.0f}",
            **dict(test.condition.factors),
            "CAE pulse": pairs[test.id],
        }
        for test in campaign.tests
    )
    warnings = "".join(f"<p class=quiet>{_text(warning)}</p>" for warning in campaign.warnings)
    return f"<h2>Data: {len(campaign.tests)} tests, {len(campaign.cae):,} CAE runs</h2>{_table(rows)}{warnings}"


def _bias(campaign: Campaign) -> str:
    """What the CAE model got wrong in every test, by speed; its emulator is in the cache by now."""
    model = CaeModel(cache=Cache()).fit(campaign.cae)
    figure = bias_by_speed(campaign.tests, [measured_bias(test, model) for test in campaign.tests])
    return (
        "<section><h2>What the CAE model gets wrong, by speed</h2><p>What has to be added to the CAE model to get each "
        f"test, over displacement. The steep ends are where a vehicle stops.</p>{_figure(figure)}</section>"
    )


def _ratings(table: pd.DataFrame) -> str:
    """Approach by window, the best of each window in bold."""
    shown = pd.DataFrame(
        {
            window: [f"<b>{value:.3f}</b>" if value == column.max() else f"{value:.3f}" for value in column]
            for window, column in table.items()
        }
    )
    shown.insert(0, "Approach", [LABELS[str(name)] for name in table.index])
    return _table(shown, escape=False)


def _metrics(metrics: pd.DataFrame) -> str:
    """Metric by approach; where there are draws the 95 % interval stands in brackets."""
    columns: dict[str, list[Metric]] = {}
    for row in metrics.itertuples():
        value, lower, upper = (None if pd.isna(x) else float(x) for x in (row.value, row.lower, row.upper))
        metric = Metric(row.metric, value, lower, upper, row.unit)
        columns.setdefault(LABELS.get(row.approach, "Measured"), []).append(metric)
    table = pd.DataFrame(
        {
            who: {f"{METRIC_LABELS[metric.name]} ({metric.unit})": metric.text for metric in own}
            for who, own in columns.items()
        }
    )
    table.insert(0, "Pulse metric", table.index)
    said = "".join(f"<p class=quiet>{_text(sentence)}</p>" for sentence in missing_sentences(columns.items()))
    return _table(table) + said


def _notes(estimates: Iterable[Estimate]) -> str:
    notes: dict[str, list[str]] = {}
    for estimate in estimates:
        for note in estimate.prediction.notes:
            notes.setdefault(note, []).append(LABELS[estimate.approach])
    return "".join(f"<p class=quiet>{_text(', '.join(who))}: {_text(note)}</p>" for note, who in notes.items())


def _coverage(study: Study) -> str:
    if not study.coverage:
        return ""
    return (
        "<section><h2>What the 95 % band is worth</h2><p>How much of the held-out tests lies inside it. With "
        f"{len(study.folds)} tests no more can be promised than these counts.</p>"
        f"{_table(coverage_table(study.coverage))}</section>"
    )


def _fits(estimates: Iterable[Estimate]) -> str:
    """How the fits of models with hyperparameters went, for those who want to know."""
    parts = []
    for estimate in estimates:
        if sentences := fit_sentences(estimate.state):
            said = "".join(f"<p>{_text(sentence)}</p>" for sentence in sentences)
            summary = f"How the fit went: {_text(LABELS[estimate.approach])}"
            parts.append(f"<details><summary>{summary}</summary>{said}{_table(fit_table(estimate.state))}</details>")
    return "".join(parts)


def _provenance(record: Mapping[str, object]) -> str:
    rows = [
        ("Campaign fingerprint (SHA-256)", record["fingerprint"]),
        ("crashfuse", record["crashfuse"]),
        ("Python, platform", f"{record['python']}, {record['platform']}"),
        ("Packages", _pairs(record["packages"])),
        ("Seed and settings", _pairs(record["config"])),
    ]
    if "seconds" in record:
        rows.append(("Seconds", _pairs(record["seconds"])))
    items = "".join(f"<tr><td>{_text(name)}</td><td><code>{_text(value)}</code></td></tr>" for name, value in rows)
    return f"<section><h2>Where this comes from</h2><table>{items}</table></section>"


def _pairs(values: object) -> str:
    return (
        ", ".join(f"{name} {value}" for name, value in values.items()) if isinstance(values, Mapping) else str(values)
    )


def _table(table: pd.DataFrame, *, escape: bool = True) -> str:
    clean: Callable[[object], str] = _text if escape else str
    head = "".join(f"<th>{_text(column)}</th>" for column in table.columns)
    body = "".join("<tr>" + "".join(f"<td>{clean(cell)}</td>" for cell in row) + "</tr>" for row in table.to_numpy())
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _figure(figure: go.Figure) -> str:
    text: str = figure.to_html(
        full_html=False, include_plotlyjs=False, config={"displaylogo": False, "responsive": True}
    )
    return text


def _text(value: object) -> str:
    return html.escape(str(value))


def _page(title: str, campaign: Campaign, parts: Sequence[str]) -> str:
    notice = f"<p class=notice>{_text(campaign.notice)}</p>" if campaign.notice else ""
    return (
        f"<!doctype html><html lang=en><head><meta charset=utf-8><title>{_text(title)}</title><style>{_STYLE}</style>"
        f"<script>{get_plotlyjs()}</script></head><body><h1>{_text(title)}</h1>{notice}{''.join(parts)}</body></html>\n"
    )
