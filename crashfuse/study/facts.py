"""Facts that whoever reads a result has to know, of a campaign and of a condition: found once, shown wherever it is."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from crashfuse.approaches.neighbours import doubtful_tests
from crashfuse.campaign import Campaign
from crashfuse.condition import ABOUT, Condition
from crashfuse.crash_test import CrashTest
from crashfuse.execution.cache import remembered
from crashfuse.files.toml_text import package_data
from crashfuse.signals.metrics import checked_metrics
from crashfuse.study.config import has_speed_groups
from crashfuse.study.outliers import Departure, departures, departures_near
from crashfuse.units import G, Sentence, joined, statements

CATALOGUE: Mapping[str, list[str]] = package_data(__file__)
"""By code, the most important first: a label for a badge, and sentences; those with a value that is not known go."""


@dataclass(frozen=True, slots=True)
class Fact:
    """A fact: its code, and the values that its sentence is made of."""

    code: str  # of the catalogue of its kind of result
    values: Mapping[str, object] = field(default_factory=dict)  # as JSON has them; units end the names
    about: tuple[str, ...] = ()  # ids of tests, conditions or criteria; none: all
    catalogue: ClassVar[Mapping[str, list[str]]] = CATALOGUE

    @property
    def sentence(self) -> Sentence:
        """The fact in words, with its subject, its size and what to do."""
        return statements(self.catalogue[self.code][1:], {"about": self.about, **self.values})

    @property
    def label(self) -> str:
        """Its subject in two or three words, for a badge."""
        return statements(self.catalogue[self.code][:1], {"about": self.about, **self.values})

    @property
    def record(self) -> dict[str, object]:
        """The fact as JSON values."""
        return {"code": self.code, "about": list(self.about), **self.values, "sentence": str(self.sentence)}


def by_importance(facts: Iterable[Fact], catalogue: Iterable[str] = CATALOGUE) -> tuple[Fact, ...]:
    """Facts in the order of a catalogue; of one code, as they come."""
    order = [*catalogue]
    return tuple(sorted(facts, key=lambda fact: order.index(fact.code)))


def distinct(facts: Iterable[Fact]) -> tuple[Fact, ...]:
    """The facts without those that say the same again."""
    first: dict[str, Fact] = {}
    for fact in facts:
        first.setdefault(fact.sentence, fact)
    return tuple(first.values())


@remembered
def campaign_facts(campaign: Campaign) -> tuple[Fact, ...]:
    """Facts of a campaign, the most important one first."""
    return by_importance(_campaign_facts(campaign))


def condition_facts(campaign: Campaign, condition: Condition) -> tuple[Fact, ...]:
    """What stands apart or is in doubt near a condition, what is extrapolated."""
    apart = [departure_fact(departure) for departure in departures_near(campaign, condition, at_nearest=True)]
    doubtful = [doubt_fact(test) for test in doubtful_tests(campaign, condition)]
    return (*apart, *doubtful, *extrapolation_facts(campaign, condition))


def doubt_fact(test: CrashTest) -> Fact:
    """That a test's sensor failed, and how."""
    return Fact("test.in_doubt", {"faults": joined([fault.text for fault in test.faults], "; ")}, (test.id,))


def extrapolation_facts(campaign: Campaign, condition: Condition) -> tuple[Fact, ...]:
    """In what a condition lies outside the CAE runs."""
    return tuple(Fact("condition.extrapolated", {"sentence": text}) for text in campaign.cae.extrapolation(condition))


def window_facts(test: CrashTest, window_ms: float) -> tuple[Fact, ...]:
    """Whether the rated window of a test lacks its peak or time of zero velocity."""
    metrics = {m.name: m for m in checked_metrics(test.pulse.accel_mps2, test.condition.speed_mps)}
    peak_g, peak_ms, ttzv_ms = (metrics[name].value for name in ("peak", "peak_time", "t0"))
    late = ["the peak"] * (peak_ms is not None and peak_ms >= window_ms)
    late += ["zero velocity"] * (ttzv_ms is None or ttzv_ms >= window_ms)
    values = {"window_ms": window_ms, "beyond": late, "peak_g": peak_g, "peak_ms": peak_ms, "ttzv_ms": ttzv_ms}
    return (Fact("test.beyond_window", values, (test.id,)),) if late else ()


def _campaign_facts(campaign: Campaign) -> Iterator[Fact]:
    yield from map(departure_fact, departures(campaign))
    if any(test.cae_tuned for test in campaign.tests):
        yield tuning_fact(campaign)
    if (n := len(campaign.tests)) > 1 and not has_speed_groups(campaign):
        yield Fact("tests.one_speed", {"n_tests": n, "speed_mps": campaign.tests[0].condition.speed_mps})
    of_runs = zip(campaign.cae.ids, campaign.cae.about, strict=False)  # none, where nothing is recorded
    ends = {run: dict(about).get(f"{ABOUT}termination") for run, about in of_runs}
    if odd := {run: str(end) for run, end in ends.items() if end not in ("normal", None)}:
        pairs = {test.id: campaign.cae.paired_run(test.condition) for test in campaign.tests}
        tests = [test for test, run in pairs.items() if run is not None and campaign.cae.ids[run] in odd]
        yield Fact("cae.ended_otherwise", {"runs": odd, "paired_tests": tests})
    if (quality := campaign.quality).failing:
        counts = {"failing": list(quality.failing), "failed": len(quality.failing), "runs": quality.runs}
        yield Fact("cae.runs_fail", {**counts, "quality": joined([quality.summary, *quality.named])})
    if ids := [test_id for test_id, _ in campaign.unused]:
        reasons = [campaign.reason_of(test_id) for test_id in ids]
        yield Fact("tests.left_out_of_use", {"tests": ids, "reasons": reasons, "sentence": campaign.remarks[0]})
    if (prior := campaign.prior) is not None:
        archive = {"vehicles": list(prior.vehicles), "taken_out": prior.taken_out, "sha256": prior.fingerprint}
        yield Fact("campaign.archive", {**archive, "n_vehicles": len(prior.vehicles), "sentence": prior.sentence})
    for warning in campaign.warnings:
        yield Fact("campaign.warning", {"sentence": warning})
    if campaign.notice:
        yield Fact("campaign.notice", {"label": campaign.notice_label, "sentence": campaign.notice})


def tuning_fact(campaign: Campaign) -> Fact:
    """Which tests the CAE model was tuned to, and of which that is not stated."""
    by_word = {word: [test.id for test in campaign.tests if test.cae_tuned is word] for word in (True, None)}
    undeclared = "any test" if len(by_word[None]) == len(campaign.tests) else by_word[None]
    return Fact("tests.cae_tuned", {"tuned": by_word[True], "unknown": by_word[None], "undeclared": undeclared})


def departure_fact(departure: Departure) -> Fact:
    """How far a test differs from its neighbours: it stands apart, or is like them."""
    values = {
        "neighbours": list(departure.neighbours),
        "speed_mps": departure.speed_mps,
        "differs_by_g": min(departure.bias_mps2) / G,
        "others_differ_by_g": max(departure.bias_between_mps2) / G,
        "best_rating": max(departure.ratings),
        "lowest_rating_of_others": min(departure.ratings_between),
        "alone": list(departure.alone),
    }
    return Fact("test.stands_apart" if departure.apart else "test.alike", values, (departure.test,))
