"""Tables of the numbers of studies, predictions and plans, as written to files and as read."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from itertools import chain

import numpy as np
import pandas as pd

from crashfuse.approaches.base import Prediction
from crashfuse.cae_library import QualityVerdict
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.condition_tables import listed
from crashfuse.condition import About, about_label
from crashfuse.results.table import CONDITION, PARTS, Column, Kind, Table, frame_of, of_condition
from crashfuse.signals.metrics import MAIN_METRICS, METRIC_UNITS, Metric
from crashfuse.study.estimate import Estimate
from crashfuse.study.repeatability import Repeatability
from crashfuse.study.study import Study
from crashfuse.units import KN, MS, G, Quantity, Sentence

IN_RANGE = "Inside the CAE runs' range"
_FOLDS = ("others", "apart")  # in names of columns: as most tests at about the speed fold, and as one that stands apart
_ENDS = ("value", "lower", "upper")
_CURVES = ("acceleration", "lower", "upper", "whole_lower", "whole_upper", *_FOLDS)
_MetricRows = Iterable[tuple[object, str, Sequence[Metric]]]


def scores_table(study: Study) -> pd.DataFrame:
    """Ratings with their parts, grade and basis, one row a held-out test, approach and window."""
    basis, to_ttzv = study.campaign.rating_basis, study.config.to_ttzv
    return pd.DataFrame(
        {"held_out": fold.held_out, "approach": approach, "window_ms": window, **asdict(rating), "basis": basis}
        | ({"ttzv_ms": fold.ttzv_ms, "overall_to_ttzv": fold.overall_to_ttzv(approach)} if to_ttzv else {})
        | fold.further(approach, window, study.config.also)
        for fold in study.folds
        for approach, ratings in fold.ratings.items()
        for window, rating in ratings.items()
    )


_ARCHIVE = (
    Column("Vehicle left out", source="vehicle"),
    Column("From tests", "number", form=".0f", source="n_tests"),
    Column("Predictions", "number", form=".0f", source="predicted"),
    Column("Rating", "number", form=".3f", source="rating"),
    Column("Rating without", "number", form=".3f", source="rating_without"),
    Column("In 95 % intervals", "share", "%", source="inside"),
    Column("In those without", "share", "%", source="inside_without"),
    Column("Width of intervals, without = 1", "number", form=".2f", source="width"),
)


def archive_table(record: pd.DataFrame) -> Table:
    """The record of an archive: each vehicle left out and predicted with the others and without."""
    return Table("archive", record, _ARCHIVE)


def studies_table(studies: Iterable[tuple[str, Study]]) -> pd.DataFrame:
    """Mean and lowest rating, one row a study, way of leaving tests out, approach and window."""
    parts = []
    for name, study in studies:
        for one in filter(None, (study, study.speed_groups)):
            config = one.config.split_configs[0]
            table = scores_table(one).groupby(["approach", "window_ms"], sort=False)["overall"]
            rows = table.agg(tests="size", mean="mean", least="min").reset_index()
            about = {"campaign": name, "preset": config.preset, "seed": config.seed, "left_out": config.leave_out}
            about["held_out"] = " ".join(fold.held_out for fold in one.folds)
            parts.append(rows.assign(**about)[[*about, *rows.columns]].assign(basis=one.campaign.rating_basis))
    return pd.concat(parts, ignore_index=True)


def pulses_table(estimates: Iterable[Estimate]) -> pd.DataFrame:
    """Predicted pulses at a new condition in ms and g, with both bands, empty where an approach has none."""
    return _pulses(("", estimate.approach, estimate) for estimate in estimates)


def study_pulses(study: Study) -> pd.DataFrame:
    """Pulses of every held-out test, measured (``test``) and predicted, see :func:`pulses_table`."""
    rows = []
    for fold in study.folds:
        rows.append((fold.held_out, "test", Prediction(fold.test.condition, fold.test.pulse.accel_mps2)))
        rows += [(fold.held_out, estimate.approach, estimate) for estimate in fold.estimates]
    return _pulses(rows)


def _pulses(rows: Iterable[tuple[str, str, Prediction]]) -> pd.DataFrame:
    parts = []
    for held_out, approach, prediction in rows:
        none = (np.full(prediction.time_s.size, np.nan),) * 2
        curves = prediction.accel_mps2, *(prediction.band() or none), *(prediction.whole_band() or none)
        of_time = {f"{name}_g": own / G for name, own in zip(_CURVES, (*curves, *prediction.folds_mps2), strict=False)}
        columns = {"held_out": held_out, "approach": approach, "time_ms": (prediction.time_s / MS).round(6)}
        parts.append(pd.DataFrame(columns | of_time))
    return pd.concat(parts, ignore_index=True)


def metrics_table(rows: _MetricRows, campaign: Campaign, first: str = "held_out") -> pd.DataFrame:
    """Pulse metrics, one per row, from (held-out test, or what else comes ``first``, approach or ``test``, metrics).

    Where tests fold in two ways, there are columns of both, ``others_…`` and ``apart_…``, and which test is ``apart``.
    """
    bases = campaign.metric_bases
    table = pd.DataFrame(
        {first: key, "approach": approach, "metric": m.name, **{end: getattr(m, end) for end in _ENDS}}
        | {"unit": m.unit, "basis": bases[m.name], **of_folds(m), "of_pulse": m.of_pulse}
        for key, approach, metrics in rows
        for m in metrics
    )
    table = table[[*table.columns.drop("of_pulse"), "of_pulse"]]
    return table.astype({name: float for name in table if str(name).endswith((*_ENDS, "of_pulse"))})


def of_folds(metric: Metric) -> dict[str, object]:
    """A metric in both ways to fold, by column; none if there is one."""
    folds = dict(zip(_FOLDS, metric.folds.values(), strict=False))
    values = {f"{way}_{end}": getattr(own, end) for way, own in folds.items() for end in _ENDS}
    return values | ({"apart": [*metric.folds][1]} if folds else {})


def metrics_shown(
    columns: Iterable[tuple[str, Sequence[Metric]]], campaign: Campaign, head: str = "Pulse metric", test: str = ""
) -> tuple[Table, Table]:
    """Metrics as rows, the main ones and the others; a column for each whose they are.

    The last that folds in two ways has columns of both. Intervals that miss what the ``test`` shows are marked.
    """
    shown = dict(columns)
    for who in [who for who, metrics in shown.items() if any(m.folds for m in metrics)][-1:]:
        for fold in shown[who][0].folds:
            shown[f"{who} if it folds as {fold}"] = [metric.folds[fold] for metric in shown[who]]
    measured = {metric.name: metric.value for metric in shown.get(test, ())}
    frame, of = interval_frame(shown), [Column(head, source="label", units="unit")]
    frame = frame.assign(label=frame.index.map(campaign.metric_headings), unit=frame.index.map(METRIC_UNITS))
    for who, metrics in shown.items():
        frame[f"{who} missed"] = [metric.holds(measured.get(metric.name)) is False for metric in metrics]
        kind: Kind = "interval" if frame[f"{who} lower"].notna().any() else "number"
        of.append(Column(who, kind, units="unit", unitless=".2f", marks=f"{who} missed", widest=1.0))
    is_main = frame.index.isin(MAIN_METRICS)
    return Table("metrics", frame[is_main], tuple(of)), Table("more metrics", frame[~is_main], tuple(of))


def interval_frame(columns: Mapping[str, Sequence[Metric]]) -> pd.DataFrame:
    """Metrics with their intervals in the columns that these have in a table, by name."""
    values = {
        f"{title}{end}": pd.Series([m.interval[place] for m in metrics], [m.name for m in metrics], float)
        for title, metrics in columns.items()
        for place, end in enumerate(PARTS["interval"])
    }
    return pd.DataFrame(values)


def study_metrics(study: Study) -> pd.DataFrame:
    """Pulse metrics of every held-out test as measured (``test``) and as predicted."""
    rows: list[tuple[object, str, Sequence[Metric]]] = []
    for fold in study.folds:
        rows.append((fold.held_out, "test", study.campaign.metrics_of(study.campaign.test(fold.held_out))))
        rows += [(fold.held_out, estimate.approach, estimate.metrics) for estimate in fold.estimates]
    return metrics_table(rows, study.campaign)


def tests_table(campaign: Campaign) -> Table:
    """Every test with its condition, where its CAE pulse comes from, and whether the CAE runs cover it."""
    rows = (
        {
            "Test": test.id,
            **of_condition(test.condition),
            "CAE pulse": campaign.cae.ids[run] if run is not None else "emulator",
            IN_RANGE: not campaign.cae.extrapolation(test.condition),
            **({} if test.cae_tuned is None else {"CAE tuned to it": test.cae_tuned}),
            **{about_label(name): value for name, value in test.about},
        }
        for test in campaign.tests
        for run in [campaign.cae.paired_run(test.condition)]
    )
    return Table.of("tests", rows, *CONDITION)


def about_table(campaign: Campaign) -> Table:
    """Where tests and CAE runs come from, as far as that is stated; empty if it is not."""
    rows = [(test.id, [test.about]) for test in campaign.tests if test.about]
    rows += [(f"{len(campaign.cae):,} CAE runs", list(campaign.cae.about))] if any(campaign.cae.about) else []
    return Table.of("origins", ({"Of": of, **about_cells(about)} for of, about in rows))


_WALLS = (
    Column("Test"),
    Column("Impulse of the barrier", "number", "kN s", ".2f"),
    Column("Mass × ΔV", "number", "kN s", ".2f"),
    Column("Ratio", "number", form=".3f"),
    Column("First loaded", "number", "ms"),
    Column("Deceleration later", "number", "ms"),
)


def wall_table(campaign: Campaign) -> Table:
    """The barrier's force beside mass and pulse of each test that has it; empty if none has."""
    beside = [(test, test.wall.beside(test.pulse.accel_mps2)) for test in campaign.tests if test.wall is not None]
    rows = [
        (test.id, wall.impulse_ns / KN, kg * wall.change_mps / KN, wall.share(kg), wall.begins_s / MS, wall.lag_s / MS)
        for test, wall in beside
        for kg in [test.condition.mass_kg]
    ]
    return Table("walls", pd.DataFrame(rows, columns=[column.title for column in _WALLS]), _WALLS)


def about_cells(about: Sequence[About]) -> dict[str, str]:
    """What is stated of where rows come from, each value with the number of its rows."""
    counts: dict[str, Counter[str]] = {}
    for name, value in chain.from_iterable(about):
        counts.setdefault(about_label(name).capitalize(), Counter())[value] += 1
    if len(about) == 1:
        return {name: next(iter(values)) for name, values in counts.items()}
    return {name: listed(f"{v} ({n})" for v, n in values.most_common()) for name, values in counts.items()}


_OF = {
    "energy change": ("energy at the start", "≤"),
    "hourglass energy": ("largest internal energy", "<"),
    "added mass": ("mass at the start", "<"),
}


def quality_table(verdict: QualityVerdict) -> Table:
    """What the solver says of the CAE runs, one row a quantity; empty if nothing is recorded."""
    frame = frame_of(
        {
            **row,
            "label": f"{row['quantity'].capitalize()}, largest",
            "of": of,
            "limit": None if pd.isna(limit) else Sentence(f"{sign} {{}}", Quantity((100 * limit,), "", "g")),
            "worst_run": row["worst_run"] or None,
        }
        for row in verdict.table.to_dict("records")
        for (of, sign), limit in [(_OF[row["quantity"]], row["limit"])]
    )
    counts = {"Pass": "passed", "Fail": "failed", "Not recorded": "not_recorded"}
    columns = (
        Column("Quantity", source="label"),
        Column("In % of", source="of"),
        Column("Limit (%)", source="limit", missing="none"),
        *(Column(title, "number", form=",.0f", source=name) for title, name in counts.items()),
        Column("At worst", "share", "%", ".3g", source="worst"),
        Column("In run", source="worst_run"),
    )
    table = Table("quality", frame, columns)
    return table if verdict.limits is not None else table.without("Pass", "Fail")


def repeats_table(
    found: Mapping[str, Mapping[float, Repeatability]], tests: Sequence[str], windows_ms: Sequence[float]
) -> Table | None:
    """What a repeat of each of these tests would rate, by window, with its interval; None if nothing is known."""
    known = {test: found.get(test, {}) for test in tests}
    if not any(window in own for own in known.values() for window in windows_ms):
        return None
    rows = []
    for test, own in known.items():
        row: dict[str, object] = {"Test": test}
        for window in windows_ms:
            values = (own[window].value, own[window].lower, own[window].upper) if window in own else [None] * 3
            row |= {f"0–{window:g} ms{end}": value for end, value in zip(PARTS["interval"], values, strict=True)}
        repeats = next(iter(own.values())).repeats if own else ()
        rows.append(row | {"Repeats among the tests": ", ".join(repeats) or "none"})
    windows = (Column(f"0–{window:g} ms", "interval", form=".3f", ends_form=".2f") for window in windows_ms)
    return Table.of("repeats", rows, *windows)
