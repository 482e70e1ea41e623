"""What to plan, as results: pulse metrics over impact speed, and a ranking of the tests to run next."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial

import pandas as pd

from crashfuse.approaches.registry import CLASSES, LABELS
from crashfuse.files.csv_text import csv_bytes
from crashfuse.results.campaign import campaign_result
from crashfuse.results.plots.conditions import next_tests_figure, sweep_figure
from crashfuse.results.plots.learning import over_number_of_tests
from crashfuse.results.provenance import learning_curve_command, next_test_command, provenance, sweep_command
from crashfuse.results.render.text import json_bytes
from crashfuse.results.result import Figure, Result
from crashfuse.results.result_tables import metrics_table
from crashfuse.results.table import CONDITION, PARTS, Column, Table, of_condition
from crashfuse.signals.metrics import MAIN_METRICS, METRIC_LABELS, METRIC_UNITS, Metric
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.study.one_more_test import Cost, gains, one_more, sentences, summary
from crashfuse.study.planning import BEST, NextTests, SpeedSweep, weights_sentence
from crashfuse.units import LB, MPH, G, Quantity, Sentence, joined, speed

MEANING = "How a test narrows the band of the bias (RMS) follows from where it is, not from what it measures."
_MOST = 20  # ranked tests of a report
_TOLD = {"max_crush": "crush", "peak": "peak", "olc": "OLC"}


def sweep_result(sweep: SpeedSweep) -> Result:
    """A sweep over speed, with a figure for each main metric."""
    campaign = sweep.campaign
    return Result(
        kind="sweep",
        title="pulse metrics over impact speed",
        campaign=campaign,
        config=sweep.config,
        command=partial(sweep_command, campaign, sweep.condition, sweep.speeds_mps, sweep.config),
        answer=(*_ends(sweep), weights_sentence(sweep.condition, campaign.tests)),
        shown=("speeds",),
        sentences={name: tuple(sweep.missing(name)) for name in MAIN_METRICS},
        tables={"speeds": speeds_table(sweep)},
        figures={name: Figure(METRIC_LABELS[name], partial(sweep_figure, sweep, name)) for name in MAIN_METRICS},
        parts={"data": (campaign_result(campaign),)},
        files={"sweep.csv": lambda: csv_bytes(sweep.table)},
    )


def _ends(sweep: SpeedSweep) -> Iterator[Sentence]:
    approach, told = [*sweep.metrics][-1], []
    for name, title in _TOLD.items():
        first, *_, last = sweep.over_speed(approach, name)
        if first.value is not None and last.value is not None:
            values = Quantity((first.value, last.value), METRIC_UNITS[name], ".0f", " to ")
            told.append(Sentence("{} {}", title, values))
    if told:
        speeds = speed(sweep.speeds_mps[0], sweep.speeds_mps[-1], between=" to ")
        yield Sentence("{} by {}: {}.", speeds, CLASSES[approach].in_words, joined(told, ", "))


def next_tests_result(ranking: NextTests) -> Result:
    """A ranking of next tests."""
    over, best = ranking.over, next_tests_table(ranking)
    now, then = (Quantity((rms / G,), "g", ".2f") for rms in (ranking.before_mps2, ranking.after_mps2[0]))
    gains = "Run a test at {} next: over {} to {} it narrows the band most, from ± {} to ± {}."
    return Result(
        kind="ranking of next tests",
        template="next_test",
        title="which test next",
        campaign=ranking.campaign,
        config=ranking.config,
        command=partial(next_test_command, over.low, over.high, ranking.config),
        answer=(*ranking.repeats, Sentence(gains, ranking.conditions[0], over.low, over.high, now, then)),
        shown=("best",),
        sentences={"meaning": (MEANING,)},
        tables={"best": best.head(BEST), "more": best.head(_MOST)},
        figures={"gains": Figure("Gain of each candidate", partial(next_tests_figure, ranking))},
        values={"ranked": len(ranking.conditions)},
        parts={"data": (campaign_result(ranking.campaign),)},
        files={"next_tests.csv": lambda: csv_bytes(ranking.table)},
    )


def sweep_table(sweep: SpeedSweep) -> pd.DataFrame:
    """Pulse metrics at every speed, then those of the tests, which have their own weights."""
    campaign = sweep.campaign
    rows: list[tuple[object, str, Sequence[Metric]]] = [
        (speed_mps / MPH, approach, metrics)
        for approach, at_speeds in sweep.metrics.items()
        for speed_mps, metrics in zip(sweep.speeds_mps.tolist(), at_speeds, strict=True)
    ]
    rows += [(test.condition.speed_mps / MPH, "test", campaign.metrics_of(test)) for test in campaign.tests]
    return metrics_table(rows, campaign, "speed_mph")


def speeds_table(sweep: SpeedSweep) -> Table:
    """The main metrics by a sweep's last approach, with intervals, one row a speed."""
    shown, headings = [*sweep.metrics][-1], sweep.campaign.metric_headings
    values = {
        f"{headings[name]}{end}": [metric.interval[place] for metric in sweep.over_speed(shown, name)]
        for name in MAIN_METRICS
        for place, end in enumerate(PARTS["interval"])
    }
    frame = pd.DataFrame({"Speed": [*map(speed, sweep.speeds_mps.tolist())], **values})
    columns = (Column(headings[name], "interval", METRIC_UNITS[name]) for name in MAIN_METRICS)
    return Table("sweep", frame, (Column("Speed"), *columns))


def next_tests_file(ranking: NextTests) -> pd.DataFrame:
    """Ranked tests in the columns of ``next_tests.csv``, one row each."""
    after, gains = ranking.after_mps2.tolist(), ranking.gains.tolist()  # Python and NumPy round otherwise
    rows = zip(ranking.conditions, after, gains, ranking.extrapolated, strict=True)
    return pd.DataFrame(
        {
            "rank": rank,
            "speed (mph)": round(condition.speed_mps / MPH, 1),
            "front weight (lb)": round(condition.front_weight_kg / LB),
            "rear weight (lb)": round(condition.rear_weight_kg / LB),
            **dict(condition.factors),
            "band now (± g)": round(ranking.before_mps2 / G, 2),
            "band then (± g)": round(after / G, 2),
            "gain (%)": round(100 * gain, 1),
            "extrapolation": "yes" if extrapolated else "no",
        }
        for rank, (condition, after, gain, extrapolated) in enumerate(rows, start=1)
    )


def next_tests_table(ranking: NextTests) -> Table:
    """The ranked tests, with the ranking criterion first."""
    frame = pd.DataFrame([of_condition(condition) for condition in ranking.conditions]).assign(
        **{"Rank": range(1, len(ranking.conditions) + 1), "Gain": ranking.gains, "Extrapolation": ranking.extrapolated},
        **{"Band now": ranking.before_mps2 / G, "Band then": ranking.after_mps2 / G},
    )
    v0, *weights = CONDITION
    columns = (
        *(Column("Rank", "number", form=".0f"), v0, Column("Gain", "share", "%"), Column("Extrapolation")),
        *(*weights, *(Column(name.capitalize(), source=name) for name, _ in ranking.conditions[0].factors)),
        *(Column(name, "spread", "g", ".2f") for name in ("Band now", "Band then")),
    )
    return Table("next tests", frame, columns)


CURVE_MEANING = "From parts of the tests, even over speed and at random, all others are predicted and rated."
ONE_MORE_MEANING = "One more test: rating = limit − a / n (least squares); the interval covers exponents from 0.5 to 2."


def learning_curve_result(curve: LearningCurve, cost: Cost | str | None = None) -> Result:
    """A learning curve; with the cost of a test, ``60,000 EUR`` say, also what a hundredth of rating costs."""
    cost = Cost.of(cost) if isinstance(cost, str) else cost
    answer = sentences(curve, cost)
    record = {
        **provenance(curve.campaign, curve.campaign.test_ids, curve.config),
        "repeats": curve.repeats,
        "seconds": round(curve.seconds, 3),
        "approach": curve.judged,
        "sentences": list(answer),
        "gains": [asdict(gain) for gain in gains(curve)],
        "one_more_test": (more := one_more(curve)) and asdict(more),
        "cost_per_test": cost and asdict(cost),
    }
    steps = gains_table(curve, cost)
    return Result(
        kind="learning curve",
        title="how many tests are enough",
        campaign=curve.campaign,
        config=curve.config,
        command=partial(learning_curve_command, curve.campaign, curve.config, curve.repeats, str(cost or "")),
        held_out=curve.campaign.test_ids,
        answer=answer,
        shown=() if steps.empty else ("gains",),
        sentences={"meaning": (CURVE_MEANING,), "law": (ONE_MORE_MEANING,)},
        tables={"gains": steps, "means": curve_table(curve)},
        figures={"curve": Figure("Rating over the number of tests", partial(over_number_of_tests, curve))},
        parts={"data": (campaign_result(curve.campaign),)},
        files={"learning_curve.csv": lambda: csv_bytes(curve.table), "learning_curve.json": lambda: json_bytes(record)},
    )


def gains_table(curve: LearningCurve, cost: Cost | None = None) -> Table:
    """Gains of the judged approach; the cost of a hundredth only for gains above their error."""
    frame = pd.DataFrame(
        {
            **asdict(step),
            "steps": f"{step.before} → {step.after}",
            "per_test": step.per_test,
            "cost": cost.times(0.01 / step.per_test) if cost is not None and step.is_clear else None,
        }
        for step in gains(curve)
    )
    columns = (
        Column("Tests", source="steps"),
        Column("Gain of rating", "estimate", form="+.3f", source="gain", further=("error",)),
        Column("Per test", "number", form="+.4f", source="per_test"),
        *([] if cost is None else [Column("Cost of 0.01", source="cost")]),
    )
    return Table("gains", frame, columns)


_CHOICES = {"even": "evenly", "random": "at random"}


def curve_table(curve: LearningCurve) -> Table:
    """The summary of the approaches that learn from tests."""
    frame = summary(curve)
    frame = frame[[CLASSES[name].learns_from_tests for name in frame["approach"]]]
    inside = frame["inside"].where(frame["half_width_g"].notna())
    frame = frame.assign(label=frame["approach"].map(LABELS), chosen=frame["choice"].map(_CHOICES), inside=inside)
    columns = (
        Column("Approach", source="label"),
        Column("Tests", "number", form=".0f", source="n_tests"),
        Column("Chosen", source="chosen"),
        Column("Predictions", "number", form=".0f", source="predictions"),
        Column("Rating", "estimate", form=".3f", source="rating", further=("error",)),
        Column("80 % within", "range", form=".2f", further=("low", "high")),
        Column("a(t) in band", "share", "%", ".0f", source="inside"),
        Column("Band", "spread", "g", source="half_width_g"),
        *([Column("Decided", "share", "%", ".0f", source="decided")] if "decided" in frame else []),
    )
    return Table("learning curve", frame, columns)
