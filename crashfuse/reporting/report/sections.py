"""Sections that reports of studies and of predictions share: data, method, limits, where it comes from."""

from collections.abc import Iterable, Mapping, Sequence

import pandas as pd

from crashfuse.approaches.displacement_domain.approach import measured_bias
from crashfuse.approaches.registry import CLASSES, LABELS
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.execution.cache import Cache
from crashfuse.reporting.fit_explanations import fit_sentences, fit_table
from crashfuse.reporting.plots.bias import bias_by_speed
from crashfuse.reporting.report.page import bullets, figure, pairs_table, paragraphs, section, table, text
from crashfuse.signals.metrics import METRIC_LABELS, Metric, missing_sentences
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.units import LB, MPH

OVER_DISPLACEMENT = (
    "<p>The same over displacement, up to maximum crush (the marks, with their 95 % interval). Between a curve and "
    "zero lies the energy that was absorbed, the same for all.</p>"
)

_CHECKS = (
    "every record evenly sampled, at 1 kHz or more, from contact at 0 ms to at least 60 ms and to the vehicle's stop",
    "units taken from the columns' names; braking negative; the change of velocity about that of the impact speed",
    "every table complete: no cell empty or not a number, no id twice, a pulse for each row",
)

_LIMITS = (
    "Full-frontal rigid-barrier pulses of one vehicle: nothing is said of other crash modes or vehicles.",
    "A condition whose speed has no neighbour among the tests is extrapolated, whatever its band.",
    "The rating compares pulses of vehicle X acceleration; it says nothing of intrusion, pitch or yaw.",
)


def data(campaign: Campaign) -> str:
    """The tests with their conditions and CAE pulses, the library's range, and what was checked."""
    rows = []
    for test in campaign.tests:
        run = campaign.cae.paired_run(test.condition)
        rows.append(
            {
                "Test": test.id,
                "Speed (mph)": f"{test.condition.speed_mps / MPH:.1f}",
                "Front weight (lb)": f"{test.condition.front_weight_kg / LB:.0f}",
                "Rear weight (lb)": f"{test.condition.rear_weight_kg / LB:.0f}",
                **dict(test.condition.factors),
                "CAE pulse": "emulator" if run is None else campaign.cae.ids[run],
                "Inside the CAE runs' range": "no" if campaign.cae.extrapolation(test.condition) else "yes",
            }
        )
    low, high = campaign.cae.vectors.min(axis=0), campaign.cae.vectors.max(axis=0)
    library = (
        f"CAE runs: {low[0] / MPH:.1f}–{high[0] / MPH:.1f} mph, front {low[1] / LB:.0f}–{high[1] / LB:.0f} lb, "
        f"rear {low[2] / LB:.0f}–{high[2] / LB:.0f} lb."
    )
    cfc = campaign.channel_filter_class
    filtering = "not filtered further" if cfc is None else f"filtered whole with CFC {cfc:g} (SAE J211-1)"
    return section(
        f"Data: {len(campaign.tests)} tests, {len(campaign.cae):,} CAE runs",
        table(pd.DataFrame(rows).fillna("–")),
        paragraphs([library]),
        f"<p>Checked when it was read, and found to hold: {text('; '.join(_CHECKS))}. Records were {text(filtering)} "
        "and brought to 12.5 kHz over 0–100 ms.</p>",
        paragraphs(campaign.warnings, "quiet"),
        name="data",
    )


def method(config: StudyConfig) -> str:
    """What each approach does, in a sentence, and the settings."""
    chosen = [CLASSES[name] for name in config.approaches]
    own = "".join(f"<li><b>{text(each.label)}</b>: {text(each.description)}</li>" for each in chosen)
    preset = {"fast": "fast (ours)", "paper": "paper (Tables 2 and 4 as published)"}[config.preset]
    settings = f"Preset {preset}, seed {config.seed}, device {config.device}."
    return section(
        "Method and settings",
        "<p>Zeng et al., <i>Machine learning enabled fusion of CAE data and test data for vehicle crashworthiness "
        "performance evaluation by analysis</i>, Structural and Multidisciplinary Optimization 66 (2023); equations "
        "are numbered as there. Ratings by ISO/TS 18571.</p>",
        f"<ul>{own}</ul>",
        paragraphs([settings]),
        name="method",
    )


def bias(campaign: Campaign) -> str:
    """What the CAE model got wrong in every test, by speed; its emulator is in the cache by now."""
    model = CaeModel(cache=Cache()).fit(campaign.cae)
    drawn = bias_by_speed(campaign.tests, [measured_bias(test, model) for test in campaign.tests])
    return section(
        "What the CAE model gets wrong, by speed",
        "<p>What has to be added to the CAE model to get each test, over displacement. The steep ends are where a "
        "vehicle stops.</p>",
        figure(drawn),
        name="bias",
    )


def limits(campaign: Campaign, extra: Iterable[str] = ()) -> str:
    """What none of this says."""
    n = len(campaign.tests)
    promise = (
        f'With {n} tests no calibration can promise more than {n} of {n + 1}: read "95 % model band" with the counts.'
    )
    return section("Limits", bullets([*_LIMITS, promise, *extra]), name="limits")


def metrics(columns: Sequence[tuple[str, Sequence[Metric]]]) -> str:
    """Metric by column (the test, an approach); where there are draws the 95 % interval stands in brackets."""
    frame = pd.DataFrame(
        {who: {f"{METRIC_LABELS[metric.name]} ({metric.unit})": metric.text for metric in own} for who, own in columns}
    )
    frame.insert(0, "Pulse metric", frame.index)
    return table(frame) + paragraphs(missing_sentences(columns), "quiet")


def notes(estimates: Iterable[Estimate]) -> str:
    """Remarks of the approaches, each once with those who make it."""
    makers: dict[str, list[str]] = {}
    for estimate in estimates:
        for note in estimate.prediction.notes:
            makers.setdefault(note, []).append(LABELS[estimate.approach])
    return paragraphs((f"{', '.join(who)}: {note}" for note, who in makers.items()), "quiet")


def fits(estimates: Iterable[Estimate]) -> str:
    """How the fits of models with hyperparameters went, for those who want to know."""
    parts = []
    for estimate in estimates:
        if sentences := fit_sentences(estimate.state):
            summary = f"How the fit went: {text(LABELS[estimate.approach])}"
            hyperparameters = fit_table(estimate.state)
            shown = "" if hyperparameters.empty else table(hyperparameters)
            parts.append(f"<details><summary>{summary}</summary>{paragraphs(sentences)}{shown}</details>")
    return "".join(parts)


def origin(record: Mapping[str, object], command: str) -> str:
    """Versions, fingerprint, seed, and the command that makes it again."""
    rows = {
        "Made again by": command,
        "Campaign fingerprint (SHA-256)": record["fingerprint"],
        "crashfuse": record["crashfuse"],
        "Python, platform": f"{record['python']}, {record['platform']}",
        "Packages": record["packages"],
        "Seed and settings": record["config"],
    }
    again = "Same data, command and versions give the same numbers; CAMPAIGN and DIR are folders of your own."
    return section("Where this comes from", pairs_table(rows), paragraphs([again], "quiet"), name="origin")
