"""Facts that whoever reads a result has to know, of a campaign and of a condition: found once, shown wherever it is."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from crashfuse.approaches.neighbours import doubtful_tests
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.condition_tables import listed
from crashfuse.condition import ABOUT, Condition
from crashfuse.crash_test import CrashTest
from crashfuse.execution.cache import remembered
from crashfuse.signals.metrics import checked_metrics
from crashfuse.study.outliers import Departure, departures, departures_near
from crashfuse.units import G, Sentence, acceleration, joined, read_out

IMPORTANCE = (
    *("test.stands_apart", "test.in_doubt", "test.beyond_window"),
    *("tests.cae_tuned", "condition.extrapolated", "cae.ended_otherwise", "cae.runs_fail"),
    *("tests.left_out_of_use", "campaign.archive", "campaign.warning", "campaign.notice"),
)
"""Codes of facts, the most important one first: the order in which pages, reports and files have them."""


@dataclass(frozen=True, slots=True)
class Fact:
    """A fact with its sentence, and the values that it rests on."""

    code: str  # one of IMPORTANCE, or of the catalogue of a kind of result
    sentence: str  # with its subject, its size and what to do
    label: str = ""  # in two or three words, for a badge
    values: Mapping[str, object] = field(default_factory=dict)  # as JSON has them; units end the names

    @property
    def record(self) -> dict[str, object]:
        """The fact as JSON values."""
        return {"code": self.code, **self.values, "sentence": str(self.sentence)}


def by_importance(facts: Iterable[Fact], order: Sequence[str] = IMPORTANCE) -> tuple[Fact, ...]:
    """Facts in the order of their codes; of one code, as they come."""
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
    """Facts of a prediction at a condition: what stands apart or is in doubt near it, what is extrapolated."""
    apart = [departure_fact(departure) for departure in departures_near(campaign, condition, at_nearest=True)]
    doubtful = [Fact("test.in_doubt", text, "Test in doubt") for text in doubtful_tests(campaign, condition)]
    return (*apart, *doubtful, *extrapolation_facts(campaign, condition))


def extrapolation_facts(campaign: Campaign, condition: Condition) -> tuple[Fact, ...]:
    """In what a condition lies outside the CAE runs."""
    texts = campaign.cae.extrapolation(condition)
    return tuple(Fact("condition.extrapolated", text, "Extrapolation") for text in texts)


def window_facts(test: CrashTest, window_ms: float) -> tuple[Fact, ...]:
    """What the rated window of a test does not hold: its peak, its time of zero velocity."""
    metrics = {m.name: m for m in checked_metrics(test.pulse.accel_mps2, test.condition.speed_mps)}
    peak_g, peak_ms, ttzv_ms = (metrics[name].value for name in ("peak", "peak_time", "t0"))
    late: list[str] = []
    if peak_g is not None and peak_ms is not None and peak_ms >= window_ms:
        late.append(Sentence(f"the peak, {{}} at {peak_ms:.1f} ms,", acceleration(peak_g * G)))
    if ttzv_ms is None or ttzv_ms >= window_ms:
        late.append(f"zero velocity, {'after the record' if ttzv_ms is None else f'at {ttzv_ms:.1f} ms'},")
    if not late:
        return ()
    verb = "is" if len(late) == 1 else "are"
    what = joined(late, " and ")
    sentence = Sentence(f"{{}}: {{}} {verb} not in the rated window, 0–{window_ms:g} ms.", test.id, what)
    values = {"test": test.id, "window_ms": window_ms, "peak_g": peak_g, "peak_ms": peak_ms, "ttzv_ms": ttzv_ms}
    return (Fact("test.beyond_window", sentence, "Beyond the window", values),)


def _campaign_facts(campaign: Campaign) -> Iterator[Fact]:
    yield from map(departure_fact, departures(campaign))
    if any(test.cae_tuned for test in campaign.tests):
        yield tuning_fact(campaign)
    of_runs = zip(campaign.cae.ids, campaign.cae.about, strict=False)  # none, where nothing is recorded
    ends = {run: dict(about).get(f"{ABOUT}termination") for run, about in of_runs}
    if odd := {run: str(end) for run, end in ends.items() if end not in ("normal", None)}:
        pairs = {test.id: campaign.cae.paired_run(test.condition) for test in campaign.tests}
        tests = [test for test, run in pairs.items() if run is not None and campaign.cae.ids[run] in odd]
        resting = f"tests paired with them: {listed(tests) or 'none'}"
        runs = listed(f"{run} ({end})" for run, end in odd.items())
        sentence = f"CAE runs that did not end normally: {runs}; {resting}. Run them again, or leave them out."
        label = f"{len(odd)} CAE runs did not end normally"
        yield Fact("cae.ended_otherwise", sentence, label, {"runs": odd, "paired_tests": tests})
    quality = campaign.quality
    if quality.failing:
        sentence = joined([quality.summary, *quality.named])
        failing = {"failing": list(quality.failing), "runs": quality.runs}
        yield Fact("cae.runs_fail", sentence, f"{len(quality.failing)} of {quality.runs} CAE runs fail", failing)
    if campaign.unused:
        ids = [test_id for test_id, _ in campaign.unused]
        reasons = {"tests": ids, "reasons": [campaign.reason_of(test_id) for test_id in ids]}
        yield Fact("tests.left_out_of_use", campaign.remarks[0], f"without {', '.join(ids)}", reasons)
    if (prior := campaign.prior) is not None:
        values = {"vehicles": list(prior.vehicles), "taken_out": prior.taken_out, "sha256": prior.fingerprint}
        label = f"Archive of {len(prior.vehicles)} vehicles"
        yield Fact("campaign.archive", prior.sentence, label, values)
    for warning in campaign.warnings:
        yield Fact("campaign.warning", warning, "Warning")
    if campaign.notice:
        yield Fact("campaign.notice", campaign.notice, campaign.notice.partition(":")[0])


def tuning_fact(campaign: Campaign) -> Fact:
    """Which tests the CAE model was tuned to, and of which that is not said."""
    tuned = [test.id for test in campaign.tests if test.cae_tuned]
    unknown = [test.id for test in campaign.tests if test.cae_tuned is None]
    sentences = []
    if tuned:
        sentences.append(
            f"The CAE model was tuned to {read_out(tuned)}: predictions of tests that it has seen prove little, and "
            "support no verdict."
        )
    if unknown:
        of = "the tests" if len(unknown) == len(campaign.tests) else read_out(unknown)
        sentences.append(f"Whether the CAE model was tuned to {of} is not said (column cae_tuned of tests.csv).")
    label = f"CAE model tuned to {', '.join(tuned)}" if tuned else "Tuning not said"
    return Fact("tests.cae_tuned", joined(sentences), label, {"tuned": tuned, "unknown": unknown})


def departure_fact(departure: Departure) -> Fact:
    """How far a test differs from its neighbours: it stands apart, or is like them."""
    values = {
        "test": departure.test,
        "neighbours": list(departure.neighbours),
        "speed_mps": departure.speed_mps,
        "differs_by_g": min(departure.bias_mps2) / G,
        "others_differ_by_g": max(departure.bias_between_mps2) / G,
        "best_rating": max(departure.ratings),
        "lowest_rating_of_others": min(departure.ratings_between),
    }
    code, label = ("test.stands_apart", "stands apart") if departure.apart else ("test.alike", "is like its neighbours")
    return Fact(code, departure.sentence, f"{departure.test} {label}", values)
