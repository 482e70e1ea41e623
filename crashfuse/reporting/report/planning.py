"""Reports for whoever plans the next test: metrics over speed, and which test would narrow the band most."""

from collections.abc import Sequence

from crashfuse.campaign import Campaign
from crashfuse.reporting.plots.next_test import next_tests
from crashfuse.reporting.plots.sweep import sweep_figure
from crashfuse.reporting.provenance import next_test_command, provenance, sweep_command
from crashfuse.reporting.report.page import figure, page, paragraphs, section, table
from crashfuse.reporting.report.sections import data, limits, method, origin
from crashfuse.signals.metrics import METRIC_LABELS
from crashfuse.study.config import StudyConfig
from crashfuse.study.next_test import ConditionRange, NextTest, next_tests_table
from crashfuse.study.sweep import Sweep, missing_over_speed, weights_sentence

_SHOWN = 20

NEXT_TEST_MEANING = (
    "Where the band is widest and a test would tell most is known before it is run: the variance of a Gaussian process "
    "depends on where tests are, not on what they measure. The band is that of the displacement domain's bias, root "
    "mean square over the range and over displacement; a test narrows it by what it tells of its neighbourhood, as far "
    "as tests repeat."
)


def sweep_report(campaign: Campaign, sweeps: Sequence[Sweep], config: StudyConfig) -> str:
    """Report of a sweep over speed as one HTML page, a figure for each metric."""
    condition, speeds = sweeps[0].condition, sweeps[0].speeds_mps
    parts = [paragraphs([weights_sentence(condition, campaign.tests)])]
    for name, label in METRIC_LABELS.items():
        shown = figure(sweep_figure(sweeps, name, campaign))
        parts.append(section(label, shown, paragraphs(missing_over_speed(sweeps, name), "quiet")))
    origins = provenance(campaign, (), config), sweep_command(condition, speeds, config)
    parts += [data(campaign), method(config), limits(campaign), origin(*origins)]
    return page(f"{campaign.name}: pulse metrics over impact speed", campaign, parts)


def next_test_report(campaign: Campaign, over: ConditionRange, ranked: Sequence[NextTest], config: StudyConfig) -> str:
    """Report of a ranking of next tests as one HTML page."""
    parts = [
        paragraphs([f"Over {over.low} to {over.high}, all conditions between them counted alike.", NEXT_TEST_MEANING]),
        figure(next_tests(ranked, campaign.tests)),
        section(f"The best {min(len(ranked), _SHOWN)} of {len(ranked)}", table(next_tests_table(ranked[:_SHOWN]))),
        data(campaign),
        limits(campaign),
        origin(provenance(campaign, (), config), next_test_command(over.low, over.high, config)),
    ]
    return page(f"{campaign.name}: which test next", campaign, parts)
