"""What is said of studies: all sentences of one kind in one file, which a person reads when it changes."""

from collections.abc import Iterator
from dataclasses import replace

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.signals.sensor_faults import SensorFault
from crashfuse.study.facts import departure_fact
from crashfuse.study.history import StudyComparison
from crashfuse.study.one_more_test import Cost, sentences
from crashfuse.study.outliers import Departure
from crashfuse.study.planning import weights_sentence
from crashfuse.study.recommendation import account, recommend, recommend_for, worst_test
from crashfuse.study.repeatability import Repeatability
from crashfuse.study.study import Study
from crashfuse.units import G
from tests.golden import assert_golden
from tests.study import test_history, test_one_more_test, test_recommendation


def accounts(campaign: Campaign) -> Iterator[str]:
    """Of a test that disappoints, one with a failed sensor, one with and without its neighbours, one unasked."""
    sound = test_recommendation.fold(campaign, "T3", 0.5, 0.99)
    failed = replace(sound, test=replace(sound.test, faults=(SensorFault("spike", 0.03, 0.03, 60 * G, 2.0),)))
    unasked = replace(sound, estimates=tuple(replace(own, left_out_mps2={}) for own in sound.estimates))
    config = test_recommendation.CONFIG
    yield from account(campaign, config, sound).sentences
    yield from account(campaign, config, failed, without_neighbours=0.91).sentences
    yield account(campaign, config, unasked, approach="cae").sentences[0]
    groups = Study(campaign, replace(config, leave_out="speed group"), (sound,))
    yield from worst_test(groups, approach="displacement_domain").sentences
    apart = Departure("A", ("B", "C", "D"), 15.0, 60.0, (3.0, 4.0), (1.0, 2.5), (0.5, 0.7), (0.8, 0.9))
    yield from (departure_fact(own).sentence for own in (apart, replace(apart, ratings=(0.5, 0.85))))


def recommendations(campaign: Campaign) -> Iterator[str]:
    """For a campaign, for a test before and after it was run, and where the paper alone advises."""
    make = test_recommendation.study
    both = make(campaign, {"cae": 0.6, "displacement_domain": 0.97, "fused": 0.97})
    groups = replace(both, config=replace(both.config, leave_out="speed group"), folds=both.folds[:2])
    for view in (replace(both, speed_groups=groups), groups):
        yield from recommend(view).sentences
    yield from recommend(make(campaign, {"cae": 0.97, "displacement_domain": 0.9})).sentences
    single = make(campaign, {"cae": 0.9, "time_domain": 0.99})
    yield from recommend(replace(single, folds=single.folds[:1])).sentences
    rest, test = campaign.without(["T2"]), campaign.test("T2")
    low = [test_recommendation.estimate(name, rest, test, 0.3) for name in ("cae", "fused")]
    yield from recommend_for(low, rest, test.condition).sentences
    yield from recommend_for([replace(own, left_out_mps2={}) for own in low], rest, test.condition).sentences
    yield from recommend_for(low, campaign.without(["T1", "T2", "T3"]), test.condition).sentences


def comparisons() -> Iterator[str]:
    """Of a clear gain and loss, a lucky one, one test alone; cautions on data, basis and ways."""
    make, first = test_history.study, test_history.FIRST
    steady = {test: rating + 0.02 + 0.001 * i for i, (test, rating) in enumerate(first.items())}
    yield from StudyComparison(make(steady), make(first)).sentences()
    yield from StudyComparison(make(first), make({}, ratings={"T1": {"fused": {60.0: 0.8}}}, fingerprint="b")).cautions
    for second in (steady, {**first, "T4": 0.68}, {"T1": 0.9, "T9": 0.1}):
        compared = StudyComparison(make(first), make(second, fingerprint="b", basis="CFC 60"))
        yield from (*compared.sentences(), *compared.cautions)
    raw = test_history.raw
    for changed in ({"T1": 0.5, "T2": 0.6}, {"T1": 0.6, "T2": 0.6}):
        yield from StudyComparison(raw({"T1": 0.5, "T2": 0.5}), raw(changed, fingerprint="b")).cautions


def curves(campaign: Campaign) -> Iterator[str]:
    """Of a learning curve that gains, one that is level, one that falls, one too short, one that learns nothing."""
    make, sizes = test_one_more_test.curve_of, (1, 2, 3, 4, 6, 8)
    cost, gaining = Cost(60000.0, "EUR"), make(campaign, lambda s, t: 0.95 - 0.5 / s + 0.01 * (t - 4), sizes)
    yield from sentences(gaining, cost)
    yield from sentences(make(campaign, lambda s, t: min(s, 4) * 0.1 + 0.001 * ((s * 7 + t) % 3), sizes), cost)
    yield from sentences(make(campaign, lambda s, t: 0.9 + 0.1 / s + 0.001 * t, sizes), cost)
    yield from sentences(make(campaign, test_one_more_test.law, (1, 2, 3)))
    yield from sentences(replace(gaining, config=replace(gaining.config, approaches=("cae",))))


def test_what_is_said_of_studies(campaign: Campaign) -> None:
    repeat = Repeatability(0.95, 0.91, 0.97, ("T8", "T9"))
    weights = weights_sentence(Condition.of(speed_mph=30, front_weight_lb=2050, rear_weight_lb=1500), campaign.tests)
    parts = {
        "account": accounts(campaign),
        "recommendation": recommendations(campaign),
        "comparison": comparisons(),
        "learning curve": curves(campaign),
        "repeat": [own.sentence(0.85, "Fused") for own in (repeat, replace(repeat, repeats=()))],
        "sweep": [weights],
    }
    assert_golden("study", [line for name, lines in parts.items() for line in (f"== {name}", *map(str, lines))])
