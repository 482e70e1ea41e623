"""What a reviewer has to know against the verdicts of a certification, by subject."""

from collections.abc import Iterator, Mapping, Sequence

from crashfuse.certification.certify import Certification
from crashfuse.certification.changes import Changes
from crashfuse.certification.track_record import TrackRecord
from crashfuse.reporting.certification_changes import gone_sentences, narrow_sentence, turned_by_the_move, wrong_since
from crashfuse.reporting.evidence_sentences import (
    brier_sentence,
    interval_sentence,
    is_too_narrow,
    listed,
    listed_conditions,
    record_sentence,
    waived_sentence,
    wrong_sentences,
)
from crashfuse.study.facts import campaign_facts, departures_near
from crashfuse.wording import Sentence, joined, read_out

UNSUPPORTED = "Criteria whose record does not support the confidence"
UNTOUCHED = "Criteria whose limit no left-out test came near"
NOT_GIVEN, NOT_TOGETHER = "Conditions without a factor that the tests have", "Factors that no test has together"
FEW = "Criteria whose own record does not support the confidence alone"
NOT_USED = "Tests that are not used"
APART = "Tests that stand apart"
NOT_USUAL = "Criteria by another occupant model than the usual one"
MOVED = "Verdicts on tests run since that depend on how these were moved to their conditions"
WRONG_SINCE, NARROW_SINCE = "Verdicts that tests run since contradict", "Intervals that tests run since contradict"


def exceptions(certification: Certification) -> dict[str, tuple[str, ...]]:
    """Everything that a reviewer has to know against the verdicts, by subject; subjects without any are left out."""
    confidence, record = certification.criteria.confidence, certification.record
    saved = record.saved(certification.criteria)
    changes = None if certification.since is None else Changes.of(certification)
    supports = {criterion.name: record.support(criterion) for criterion in certification.criteria.items}
    short = {name: s for name, own in supports.items() if (s := own.shortfall(confidence)) is not None}
    weak = reservations(certification)
    domain = certification.domain
    why = {i: own for i, c in certification.matrix.items if (own := domain.exceeded_by(c))}
    outside = domain.too_few_tests or tuple(joined([i, joined(own)], ": ") for i, own in why.items())
    found = {
        APART: tuple(
            fact.sentence for fact in campaign_facts(certification.campaign) if fact.code == "test.stands_apart"
        ),
        "Warnings about the campaign": certification.campaign.remarks,
        "Conditions outside the validated domain": outside,
        NOT_GIVEN: tuple(_without_factor(certification)),
        NOT_TOGETHER: tuple(_new_together(certification)),
        "Open, because recordings end too early to predict": tuple(
            f"{i}: {', '.join(unknown)}."
            for i, own in certification.of_word("open").items()
            if (unknown := [verdict.criterion.name for verdict in own if verdict.probability is None])
        ),
        "Tests outside the range of the CAE runs": tuple(
            joined([test.id, joined(notes)], ": ")
            for test in certification.campaign.tests
            if (notes := certification.campaign.cae.extrapolation(test.condition))
        ),
        NOT_USUAL: tuple(_by_own_occupant(certification)),
        NOT_USED: tuple(_not_used(certification)),
        WRONG_SINCE: () if changes is None else tuple(wrong_since(changes)),
        MOVED: () if changes is None else tuple(turned_by_the_move(changes)),
        NARROW_SINCE: () if changes is None else tuple(narrow_sentence(changes)),
        "Wrong verdicts on left-out tests": tuple(wrong_sentences(record)),
        "Intervals that left-out tests contradict": (
            tuple(interval_sentence(record)) if is_too_narrow(*record.intervals) else ()
        ),
        "Probabilities that left-out tests contradict": tuple(
            f"{own.low:g} to {own.high:g}, {own.probability:.3f} on average: {round(own.met * own.n)} of {own.n} met "
            f"it (exact 95 % bounds {own.lower:.3f} to {own.upper:.3f})."
            for own in record.reliability
            if not own.holds
        ),
        "Probabilities no better than those of the raw CAE": tuple(brier_sentence(record)) if _no_gain(record) else (),
        UNSUPPORTED: _grouped(short),
        UNTOUCHED: _grouped({name: s for name, s in weak.items() if record.trials and not supports[name].near}),
        FEW: _grouped({name: s for name, s in weak.items() if name not in short and supports[name].near}),
        "Whole tests": ()
        if saved or not certification.waived
        else tuple(waived_sentence(record, certification.criteria)),
        "No record": () if record.trials else (record_sentence(record),),
    }
    return {subject: sentences for subject, sentences in found.items() if sentences}


def _without_factor(certification: Certification) -> Iterator[str]:
    """Which conditions do not name a factor, and what their verdicts are then on."""
    for name in certification.domain.factors:
        some = [i for i, c in certification.matrix.items if not dict(c.factors).get(name)]
        if some:
            yield (
                f"{_listed(certification, some)}: no {name} is given, so the verdicts are on a vehicle of which it is "
                "not known, not on the least favourable one; name it to have its own."
            )


def _new_together(certification: Certification) -> Iterator[str]:
    """Which conditions have factors of which each was tested, but never with the others."""
    found: dict[str, list[str]] = {}
    for i, together in _together(certification).items():
        found.setdefault(together, []).append(i)
    for together, some in found.items():
        yield f"{_listed(certification, some)}: no test has {together}; each was tested with another."


def _listed(certification: Certification, some: Sequence[str]) -> str:
    return listed_conditions(certification.matrix.ids, dict.fromkeys(some, ""))


def _together(certification: Certification) -> dict[str, str]:
    """The factors of conditions of which each was tested, but never with the others."""
    tested, known = (
        [dict(test.condition.factors) for test in certification.campaign.tests],
        certification.domain.factors,
    )
    found = {}
    for i, condition in certification.matrix.items:
        given = {name: value for name, value in condition.factors if value and name in known}
        each = all(value in known[name] for name, value in given.items())
        if each and not any(given.items() <= own.items() for own in tested):
            found[i] = ", ".join(f"{name} {value}" for name, value in given.items())
    return found


def _by_own_occupant(certification: Certification) -> Iterator[str]:
    """Which criteria rest on the campaign's own occupant model."""
    occupant = certification.campaign.occupant
    words = {"olc": occupant.olc_words, "vpi": occupant.vpi_words}
    for own in certification.criteria.items:
        if said := words.get(own.metric, ""):
            yield f"{own.name}: by {said}, as campaign.toml has it, so it is no number to compare with others'."


def _not_used(certification: Certification) -> Iterator[str]:
    """Tests at conditions of the matrix that nothing learned from."""
    since = certification.since
    told = set() if since is None else {own.test for own in since.gone_runs}
    planned, unused = dict(certification.matrix.items), dict(certification.campaign.unused)

    def off(i: str, name: str) -> str:
        own = unused.get(name)
        return "" if own is None or own.is_at(planned[i]) else Sentence("; at {}", own)

    for i, names in _unused_at(certification).items():
        if unknown := [name for name in names if name not in told]:
            reasons = [
                Sentence("{} ({}{})", name, certification.campaign.reason_of(name), off(i, name)) for name in unknown
            ]
            said = "{}: {} was run there and is left out of use; what it showed is not in the verdicts."
            yield Sentence(said, i, listed(reasons))
    if since is not None:
        yield from gone_sentences(since)


def _unused_at(certification: Certification) -> dict[str, list[str]]:
    """Tests that were run at conditions of the matrix and that are not used, by the id of the condition."""
    matrix, since, found = certification.matrix, certification.since, {}
    for (i, condition), unused in zip(matrix.items, matrix.run(certification.campaign.unused), strict=True):
        gone = () if since is None else since.gone_at(condition)
        used = certification.campaign.test_ids
        others = (f"{own.test} with another record" if own.test in used else own.test for own in gone)
        if names := dict.fromkeys((*unused, *others)):
            found[i] = list(names)
    return found


def reserved(certification: Certification) -> dict[str, list[str]]:
    """What has to be known of a condition wherever it is named, in a few words each, by its id."""
    found: dict[str, list[str]] = {}
    for i, condition in certification.matrix.items:
        given = {name for name, value in condition.factors if value}
        if missing := [f"{name} not given" for name in certification.domain.factors if name not in given]:
            found.setdefault(i, []).extend(missing)
    for i, together in _together(certification).items():
        found.setdefault(i, []).append(f"{together} in no test together")
    for i, condition in certification.matrix.items:
        if apart := [departure.test for departure in departures_near(certification.campaign, condition)]:
            found.setdefault(i, []).append(f"{read_out(apart)} stands apart there")
    for i, names in _unused_at(certification).items():
        found.setdefault(i, []).append(f"run as {listed(names)}, not used")
    return found


def _grouped(sentences: Mapping[str, str]) -> tuple[str, ...]:
    """Each sentence once, after the names that it is about."""
    names: dict[str, list[str]] = {}
    for name, sentence in sentences.items():
        names.setdefault(sentence, []).append(name)
    return tuple(joined([", ".join(own), sentence], ": ") for sentence, own in names.items())


def _no_gain(record: TrackRecord) -> bool:
    return record.brier is not None and record.brier[0] >= record.brier[1]


def reservations(certification: Certification) -> dict[str, str]:
    """Why the record says little of a criterion by itself, by its name, where it does."""
    record, criteria = certification.record, certification.criteria
    told = {own.name: record.support(own).reservation(criteria.confidence) for own in criteria.items}
    return {name: sentence for name, sentence in told.items() if sentence is not None}
