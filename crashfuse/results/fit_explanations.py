"""What fits have learned: their quality, the reliability of their bands, and what to mend in the CAE model."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, fields
from functools import partial
from typing import Any

import pandas as pd

from crashfuse.approaches.calibration import Calibration
from crashfuse.approaches.displacement_domain.events import CaeEvent, CaeEvents, cae_events
from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.results.display import Display
from crashfuse.results.plots.displacement import missing_force
from crashfuse.results.result import Figure, Result
from crashfuse.results.result_tables import metrics_shown
from crashfuse.results.table import Column, Table, frame_of
from crashfuse.signals.metrics import MAIN_METRICS, METRIC_LABELS, Metric, in_sentence, missing_sentences
from crashfuse.study.estimate import Estimate
from crashfuse.study.study import Study
from crashfuse.units import IN_SI, MS, Quantity, Sentence, joined, number, statements

_HEADINGS = {"accel": "a(t) up to TTZV", "velocity": "v(t) up to TTZV", "rebound": "a(t) after TTZV"}
_COUNTS = {"crush": "Maximum crush", "peak": "Peak deceleration", "whole": "Whole pulse, 0–60 ms"}
_SAME = 0.02  # differences of a metric up to here are not told: others are what repeats scatter


def coverage_table(coverage: Mapping[str, Calibration]) -> Table:
    """One row per approach: shares of time inside the band, and counts of tests."""
    rows = (
        {
            "Approach": LABELS[name],
            **{heading: calibration.share(column) for column, heading in _HEADINGS.items()},
            **{title: f"{calibration.count(column)} of {len(calibration.tests)}" for column, title in _COUNTS.items()},
        }
        for name, calibration in coverage.items()
    )
    return Table.of("coverage", rows, *(Column(heading, "share", form=".0f") for heading in _HEADINGS.values()))


_FIT = (
    Column("Hyperparameter", source="name"),
    Column("Value", "number", units="unit", form=".3g", source="value"),
    Column("Known to a factor of", "number", form=".2f", source="spread"),
    Column("At its bound", source="touched"),
)
_LENGTHS = (  # of the bias model, by part: of what, in which unit, and in which readers have it
    ("by speed", "v0", "m/s", "mph"),
    ("by weight", "front weight", "kg", "lb"),
    ("by weight", "rear weight", "kg", "lb"),
    ("stop by speed", "v0", "m/s", "mph"),
)
_WITH_UNIT = {f"{part}, length in {of} in {si}": (f"{part}, length in {of}", unit) for part, of, si, unit in _LENGTHS}


def fit_table(approach: str, state: Mapping[str, Any]) -> Table:
    """Hyperparameters of a bias model and their uncertainty; empty for an approach without any."""
    spread, touched, rows = state.get("spread_factors", {}), state.get("touched_bounds", []), []
    for name, value in state.get("hyperparameters", {}).items():
        row = {"name": name, "value": value, "spread": spread.get(name), "touched": name in touched, "unit": ""}
        if name in _WITH_UNIT:
            quantity, unit = _WITH_UNIT[name]
            shown = Sentence("{} in {}", quantity, Quantity((), unit))
            row |= {"name": shown, "value": value / IN_SI[unit], "unit": unit}
        rows.append(row)
    return Table(f"fit of {approach}", frame_of(rows), _FIT)


def fit_sentences(state: Mapping[str, Any]) -> list[str]:
    """Sentences on an approach's fit and the reliability of its band; empty without a fit."""
    check = state.get("band_check") or {}
    values = {name: state.get(name) for name in ("points", "bias_rms_g", "factors", "members", "weights", "penalty")}
    values["verdict"] = _VERDICTS[state["dead"]] if "hyperparameters" in state else None
    values["misfit"] = state.get("left_out_delta_v_misfit")
    if len(densities := state.get("left_out_log_density", {})) > 1:
        values["densities"] = [f"{name} {Quantity((value,), '', '.0f')}" for name, value in densities.items()]
        values["factors"] = state["factors"] or "none"
    if equal := state.get("weights_at_equal_bands"):
        values["equal"] = [f"{name} {weight:.2f}" for name, weight in equal.items()]
    band = check | {"short": "too little" if check and not check["holds"] else None}
    told = [statements(_OF_FIT, values), statements(_BAND, band)]
    return [sentence for sentence in told if sentence]


_VERDICTS = {False: "more than noise", True: "no more than noise: treat the result as uncorrected"}
_OF_FIT = (
    "Fitted to {points} points of a bias of {bias_rms_g} RMS; it explains {verdict}.",
    "Factors: {factors}; log predictive density of left-out tests (higher is better): {densities}.",
    "Fine-tuning: {members} networks of {weights:,} weights; {penalty:g} of the increments are a test's own. ΔV of "
    "left-out tests was met to {misfit:.1%} of impact speed.",
    "Weights at equally wide bands, by left-out tests: {equal}.",
)
_BAND = (
    "The band, scaled by {widening:g} for {left_out_tests} left-out tests, holds a(t) {accel_inside:.0%} and v(t) "
    "{velocity_inside:.0%} of the time up to TTZV; crush in {crush_inside} tests, peak in {peak_inside}.",
    "After TTZV it is scaled by {late_widening:g}.",
    "After TTZV it holds a(t) {rebound_inside:.0%} of the time.",
    "That is {short} for a 95 % band.",
)


def whole_sentences(estimates: Iterable[Estimate]) -> list[str]:
    """How many left-out tests lie inside each approach's band of whole pulses, if any: a sentence."""
    states: dict[str, Any] = {LABELS[own.approach]: own.state.get("band_check") for own in estimates}
    counts = {who: (check["whole_inside"], check["left_out_tests"]) for who, check in states.items() if check}
    return [whole_sentence(counts)] if counts else []


def whole_sentence(counts: Mapping[str, tuple[int, int]]) -> str:
    """How many left-out tests lie inside bands of whole pulses, by band or way left out."""
    shown = ", ".join(f"{key} {inside} of {n}" for key, (inside, n) in counts.items())
    return f"Nine of ten left-out tests should lie inside as a whole (0–60 ms): {shown}."


def metric_remarks(columns: Sequence[tuple[str, Sequence[Metric]]]) -> tuple[list[str], list[str]]:
    """Sentences on metrics that are missing or not the averaged pulse's: main ones, others."""

    def of(is_main: bool) -> list[str]:
        shown = [(who, [metric for metric in own if (metric.name in MAIN_METRICS) is is_main]) for who, own in columns]
        return [*missing_sentences(shown), *(text for who, own in shown if (text := _averaged(who, own)))]

    return of(True), of(False)


def _averaged(who: str, metrics: Sequence[Metric]) -> str:
    away = {m.name: m.of_pulse / m.value - 1 for m in metrics if m.drawn and m.value and m.of_pulse is not None}
    told = {in_sentence(METRIC_LABELS[name]): x for name, x in away.items() if abs(x) > _SAME}
    texts = [f"{label} {number(100 * x, '+.0f')} %" for label, x in told.items()]
    return f"{who}: values are those of a single test; the averaged pulse has {', '.join(texts)}." if texts else ""


MEASURED = "Measured"  # heading of what was measured, beside the approaches


def estimates_result(
    campaign: Campaign, estimates: Sequence[Estimate], test: CrashTest | None = None, known: Sequence[str] = ()
) -> Result:
    """Metrics by approach (and of the test), notes not yet ``known``, and fits."""
    columns = [] if test is None else [(MEASURED, campaign.metrics_of(test))]
    columns += [(LABELS[estimate.approach], estimate.metrics) for estimate in estimates]
    of_test = "" if test is None else f", {test.id}"  # on paper the table may begin a page
    metrics, more_metrics = metrics_shown(columns, campaign, f"Pulse metric{of_test}", MEASURED)
    missing, more_missing = metric_remarks(columns)
    makers: dict[str, list[str]] = {}
    for estimate in estimates:
        for note in estimate.notes:
            makers.setdefault(note, []).append(LABELS[estimate.approach])
    remarks = (joined([", ".join(who), note], ": ") for note, who in makers.items() if note not in known)
    fits = {estimate: tuple(fit_sentences(estimate.state)) for estimate in estimates}
    return Result(
        kind="estimates",
        title="Estimates",
        campaign=campaign,
        sentences={
            "whole": tuple(whole_sentences(estimates)),
            "remarks": (*missing, *remarks),
            "more_missing": tuple(more_missing),
        },
        tables={"metrics": metrics, "more_metrics": more_metrics},
        parts={
            "fits": tuple(
                Result(
                    kind="fit",
                    title=LABELS[estimate.approach],
                    sentences={"fit": sentences},
                    tables={"hyperparameters": fit_table(estimate.approach, estimate.state)},
                )
                for estimate, sentences in fits.items()
                if sentences
            )
        },
    )


_MM, _KN = 1e-3, 1e3
_SHOWN = {"_m": ("_mm", _MM), "_s": ("_ms", MS), "_n": ("_kn", _KN)}
_LEARNS = {"displacement_domain", "fused"}  # approaches that rest on this bias
_NAMED, _WORTH_NAMING = 3, 0.05  # events in sentences; share of what is lost
_SUPERLATIVES = {"fast": "fastest", "slow": "slowest", "heavy": "heaviest", "light": "lightest"}


def bias_result(campaign: Campaign, window_ms: float | None = None) -> Result:
    """What the CAE model gets wrong; with a window, what to mend first."""
    figures = {"bias": Figure("Bias over displacement", lambda display: campaign.draw("bias", display=display))}
    sentences, tables = dict[str, tuple[str, ...]](), dict[str, Table]()
    if window_ms is not None:
        found = cae_events(campaign, window_ms)
        figures["events"] = Figure("What to mend in the CAE model", partial(missing_force, found))
        sentences["events"], tables["events"] = tuple(events_sentences(found)), events_table(found)
    title = "What the CAE model gets wrong, by speed"
    return Result(kind="bias", title=title, campaign=campaign, sentences=sentences, tables=tables, figures=figures)


def events_window_ms(study: Study) -> float | None:
    """The window over which mended events are rated; None if the study has not learned the bias."""
    return max(study.config.windows_ms) if _LEARNS.intersection(study.config.approaches) else None


def campaign_events(campaign: Campaign, window_ms: float) -> pd.DataFrame:
    """See :meth:`Campaign.cae_events`."""
    return events_frame(cae_events(campaign, float(Display(window_ms).window_ms)))


def events_frame(found: CaeEvents) -> pd.DataFrame:
    """One row an event, the most expensive first, as in ``cae_events.csv`` (see *Read the report*)."""
    frame = pd.DataFrame(map(asdict, found.events), columns=[field.name for field in fields(CaeEvent)])
    for ending, (shown, unit) in _SHOWN.items():
        names = [name for name in frame if name.endswith(ending)]
        frame[names] = (frame[names] / unit).round(6)
        frame = frame.rename(columns={name: name.removesuffix(ending) + shown for name in names})
    frame[["tests", "reached"]] = frame[["tests", "reached"]].map(" ".join)
    frame.insert(0, "rank", range(1, len(frame) + 1))
    return frame.assign(rating_cae=found.rating_cae, rating_mended=found.rating_mended, window_ms=found.window_ms)


_EVENTS = (
    Column("Rank", "number", form=".0f", source="rank"),
    Column("Crush", "range", "mm", ".0f", further=("from_mm", "to_mm")),
    Column("Time (ms)", source="time"),
    Column("The CAE model is", source="size"),
    Column("95 %", "range", "kN", ".0f", further=("least", "most")),
    Column("Probability", "probability", source="probability"),
    Column("Tests", source="which"),
    Column("Rating, this alone mended", "number", form=".3f", source="rating_alone"),
)


def events_table(found: CaeEvents) -> Table:
    """The events, one row each."""
    rows = [
        {
            "time": Sentence("{} in {}", Quantity((event.from_s / MS, event.to_s / MS), ""), event.timed_in),
            "size": _size(event),
            "which": _which(event),
            **dict(zip(("least", "most"), _ends_kn(event), strict=True)),
        }
        for event in found.events
    ]
    return Table("CAE events", events_frame(found).join(frame_of(rows)), _EVENTS)


def events_sentences(found: CaeEvents) -> list[str]:
    """What to mend first, and what that is worth."""
    named = [event for event in found.events[:_NAMED] if event.share >= _WORTH_NAMING]
    worth = {name: getattr(found, name) for name in ("rating_cae", "window_ms", "n_rated", "rating_all")}
    best = max(found.events, key=lambda event: event.rating_alone, default=None)
    worth["mended"] = found.rating_mended if found.events else None
    if best is not None and best.rating_alone > found.rating_mended:
        worth |= {"best": _range(best), "alone": best.rating_alone}
    return [
        *(
            f"{_range(e)}: {_size(e)} ({Quantity(_ends_kn(e), '', '.0f')}) in {_which(e)} tests; mended alone: rating "
            f"{e.rating_alone:.3f}."
            for e in named
        ),
        *([] if named else ["In no range of crush do two tests agree and would mending raise the rating."]),
        statements(_WORTH, worth),
    ]


_WORTH = (
    "The CAE model rates {rating_cae:.3f} over 0–{window_ms:g} ms (mean of {n_rated} tests).",
    "With all of this mended: {mended:.3f}.",
    "That is less than with {best} alone ({alone:.3f}), as errors at other crush cancel a part of it.",
    "Without its bias over displacement: {rating_all:.3f}.",
)


def _range(event: CaeEvent) -> Quantity:
    return Quantity((event.from_m / _MM, event.to_m / _MM), "mm", ".0f")


def _size(event: CaeEvent) -> str:
    return f"{abs(event.force_n) / _KN:.0f} kN too {'soft' if event.force_n > 0 else 'stiff'}"


def _ends_kn(event: CaeEvent) -> tuple[float, float]:
    lower, upper = (event.lower_n, event.upper_n) if event.force_n > 0 else (-event.upper_n, -event.lower_n)
    return lower / _KN, upper / _KN


def _which(event: CaeEvent) -> str:
    shown, reached = len(event.tests), len(event.reached)
    if shown == reached:
        return f"all {reached}"
    extreme = _SUPERLATIVES.get(event.conditions)
    return f"the {shown} {extreme} of {reached}" if extreme else f"{shown} of {reached}"
