"""A learning curve as a result: how ratings grow with tests, and what one more would buy."""

from dataclasses import asdict
from functools import partial

import pandas as pd

from crashfuse.approaches.registry import CLASSES, LABELS
from crashfuse.files.csv_text import csv_bytes
from crashfuse.results.campaign import campaign_result
from crashfuse.results.plots.learning import over_number_of_tests
from crashfuse.results.provenance import learning_curve_command, provenance
from crashfuse.results.render.text import json_bytes
from crashfuse.results.result import Figure, Result
from crashfuse.results.table import Column, Table
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.study.one_more_test import Cost, gains, one_more, sentences, summary

MEANING = "From parts of the tests, even over speed and at random, all others are predicted and rated."
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
    asked = curve.campaign, curve.config, curve.repeats, str(cost or "")
    return Result(
        kind="learning curve",
        title="how many tests are enough",
        campaign=curve.campaign,
        config=curve.config,
        command=partial(learning_curve_command, *asked),
        held_out=curve.campaign.test_ids,
        answer=answer,
        shown=() if steps.empty else ("gains",),
        sentences={"meaning": (MEANING,), "law": (ONE_MORE_MEANING,)},
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
