"""Content of ``certification.json``: what makes a certification again, its counts and what its record says."""

from dataclasses import asdict
from datetime import UTC, datetime

from crashfuse.certification.certify import Certification
from crashfuse.certification.criteria import Criterion
from crashfuse.certification.earlier import LaterTests
from crashfuse.certification.track_record import WrongShare, trial_bounds
from crashfuse.results.certification_facts import exceptions, facts, outcomes, sentences
from crashfuse.results.certification_tables import counts_frame, matrix_table, record_counts, share_columns
from crashfuse.results.provenance import certification_settings, certify_command, provenance
from crashfuse.results.render.text import json_bytes
from crashfuse.units import LB, MPH


def certification_json(certification: Certification) -> bytes:
    """The file, with what became of an earlier certification if it is beside one."""
    record = certification_record(certification)
    if certification.since is not None:
        record["since"] = _since(certification, certification.since)
    return json_bytes(record)


def _since(certification: Certification, since: LaterTests) -> dict[str, object]:
    bounds = outcomes(since)
    return {
        "sha256": since.earlier.digest,
        "date": since.earlier.date,
        "new_tests": since.new,
        "decided": {**share_columns(bounds["verdicts"]), "tests": bounds["tests"].n},
        "bounds": {unit: share.at_most for unit, share in bounds.items()},
        "verdicts": [
            {
                "test": trial.held_out,
                "condition": trial.verdict.condition.text,
                "criterion": _criterion(trial.verdict.criterion),
                "said": tuple(getattr(trial.verdict, name) for name in ("word", "probability", "lower", "upper")),
                "measured": trial.measured,
                "shift": trial.shift,
            }
            for trial in since.trials
        ],
        "sentences": sentences(certification, "since"),
    }


def certification_record(certification: Certification) -> dict[str, object]:
    """Versions, settings, criteria and matrix as used, counts of verdicts and of wrong ones with bounds, as JSON."""
    campaign, record, config = certification.campaign, certification.record, certification.config
    criteria, domain, costs = certification.criteria, certification.domain, certification.criteria.costs
    counts = counts_frame(certification).set_index("criterion")
    brier, (tests, saved, wrong) = record.brier or (None, None), record.waived(criteria)
    (inside, intervals), (inside_outside, outside) = record.intervals, record.intervals_outside
    with_runs = certification.record_with_runs
    return {
        **provenance(campaign, campaign.test_ids, config),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "settings": certification_settings(campaign, config, criteria.confidence),
        "cae_tuned": {test.id: test.cae_tuned for test in campaign.tests if test.cae_tuned is not None},
        "about": {test.id: dict(test.about) for test in campaign.tests if test.about},
        "tests_sha256": {test.id: test.digest for test in campaign.tests},
        "command": certify_command(certification, campaign.units),
        "seconds": {key: round(value, 3) for key, value in certification.seconds.items()},
        "criteria": {
            "confidence": criteria.confidence,
            **({} if costs is None else {"confidence_by_costs": criteria.declared is None, "costs": asdict(costs)}),
            "criterion": [_criterion(criterion) for criterion in criteria.items],
        },
        **({"costs": _costs(certification)} if costs else {}),
        "matrix": matrix_table(certification.matrix).to_dict("records"),
        "cells": {
            i: {own.criterion.name: (own.word, own.probability, own.lower, own.upper) for own in row}
            for i, row in certification.rows.items()
        },
        "monte_carlo": {
            i: {
                "seeds": max(len(own.chances) for own in row),
                "error": {own.criterion.name: round(own.error, 4) for own in row},
            }
            for i, row in certification.rows.items()
        },
        "run": {
            i: {test: {own.criterion.name: own.run[test] for own in certification.rows[i]} for test in tests_there}
            for i, tests_there in certification.run.items()
        },
        "domain": {
            "tests": domain.n_tests,
            "speeds_mph": [speed / MPH for speed in domain.speeds_mps],
            "inside_left_out": domain.inside,
            "between_tests_mph": domain.reach_mps / MPH,
            "below_slowest_mph": domain.below_mps / MPH,
            "above_fastest_mph": domain.above_mps / MPH,
            "mass_lb": [mass / LB for mass in domain.checked_masses_kg],
            "tested_mass_lb": [mass / LB for mass in domain.tested_kg],
            "factors": {name: list(values) for name, values in domain.factors.items()},
        },
        "verdicts": certification.n_by_word,
        "answers": certification.answers,
        "waived": {i: met._asdict() for i, met in certification.waived.items()},
        "saved": dict(zip(("n", "tests"), certification.saved, strict=True)),
        "counted_once": certification.counted_once,
        "uncertain": {i: met._asdict() for i, met in certification.uncertain.items()},
        "run_first": certification.run_first,
        "bounds": {unit: share.at_most for unit, share in record.bounds().items()},
        "track_record": {
            **record_counts(record),
            "decided_tests": share_columns(record.bounds()["tests"]),
            "waived": {"tests": tests, **share_columns(WrongShare(wrong, saved))},
            "saved": {test: list(ways) for test, ways in record.saved(criteria).items()},
            "near_limit": share_columns(record.near_limit.bounds()["verdicts"]),
            "intervals": {"n": intervals, "inside": inside},
            "intervals_outside": {"n": outside, "inside": inside_outside},
            "tuned": {unit: share_columns(share) for unit, share in trial_bounds(record.tuned).items()},
            "whole_pulses": {way: {"n": n, "inside": inside} for way, (inside, n) in record.whole_pulses.items()},
            **({} if with_runs is None else {"with_paired_runs": record_counts(with_runs)}),
            "brier": brier[0],
            "brier_raw_cae": brier[1],
            "reliability": [{**asdict(own), "holds": own.holds} for own in record.reliability],
        },
        "by_criterion": {
            own.name: {
                "verdicts": {str(word): int(n) for word, n in counts.loc[own.name].drop("limit").items()},
                "track_record": record_counts(record, own),
                "support": {**asdict(support), "confidence": round(support.confidence, 4)},
            }
            for own in criteria.items
            for support in [record.support(own)]
        },
        "sentences": sentences(certification, "summary"),
        "exceptions": exceptions(certification),
    }


def _costs(certification: Certification) -> dict[str, object]:
    by_code = {fact.code: fact.values for fact in facts(certification)}
    return {
        name: {key: value for key, value in by_code[code].items() if not isinstance(value, str)}
        for name, code in (("confidence", "costs.confidence"), ("saving", "costs.saving"))
        if code in by_code
    }


def _criterion(criterion: Criterion) -> dict[str, object]:
    return {key: value for key, value in asdict(criterion).items() if value is not None}
