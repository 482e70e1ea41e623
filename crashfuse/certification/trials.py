"""Trials of a campaign: which tests are left out, and what their verdicts were beside what was measured."""

from crashfuse.approaches.registry import BASELINE
from crashfuse.campaign import Campaign
from crashfuse.certification.criteria import Criteria
from crashfuse.certification.domain import Domain
from crashfuse.certification.forecast import Forecast, quantity
from crashfuse.certification.forecasts import Asked
from crashfuse.certification.track_record import LeftOut, TrackRecord, Trial
from crashfuse.certification.verdict import judge


def left_out(campaign: Campaign) -> list[tuple[str, LeftOut, tuple[str, ...]]]:
    """Each test with what is left out with it: nothing else, or its speed group if other tests remain."""
    if len(campaign.tests) < 2:
        return []
    groups = [(test, campaign.speed_group(test)) for test in campaign.test_ids]
    return [
        *((test, "test", (test,)) for test in campaign.test_ids),
        *((test, "speed group", group) for test, group in groups if len(group) < len(campaign.tests)),
    ]


def record_of(campaign: Campaign, criteria: Criteria, approach: str, forecasts: dict[Asked, Forecast]) -> TrackRecord:
    """Compare the verdicts on left-out tests, each from the others alone, with what was measured."""
    trials = []
    for test_id, way, held_out in left_out(campaign):
        test, domain = campaign.test(test_id), Domain.of(campaign.without(held_out), for_record=True)
        own, cae = (forecasts[Asked(held_out, name, test.condition)] for name in (approach, BASELINE))
        for verdict in judge(own, test.condition, criteria, domain.exceeded_by(test.condition)):
            criterion = verdict.criterion
            measured = own.measured(criterion, test, campaign.occupant)
            baseline = cae.distributions[quantity(criterion)] if criterion.window_ms is None else None
            raw = None if baseline is None else baseline.probability(criterion.at_least, criterion.at_most)
            if measured is not None:
                trials.append(Trial(test_id, way, verdict, measured, raw))
    return TrackRecord(tuple(trials))
