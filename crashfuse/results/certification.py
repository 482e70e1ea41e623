"""A certification as a result: the answer at every planned test, what speaks against it, evidence and files."""

from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from functools import partial
from typing import Unpack

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.registry import BASELINE
from crashfuse.campaign_folder.notes import Note
from crashfuse.certification.certify import Certification
from crashfuse.certification.criteria import Criterion
from crashfuse.certification.earlier import LaterTests
from crashfuse.certification.track_record import WrongShare, trial_bounds
from crashfuse.crash_test import CrashTest
from crashfuse.errors import one_of
from crashfuse.files.csv_text import csv_bytes
from crashfuse.results import certification_facts as said
from crashfuse.results import certification_tables as tables
from crashfuse.results.campaign import campaign_result
from crashfuse.results.credibility import credibility_rows, credibility_table
from crashfuse.results.display import Display, DisplayOptions
from crashfuse.results.drawing import Drawing
from crashfuse.results.plots import certification as plots
from crashfuse.results.plots import pulses
from crashfuse.results.provenance import certification_settings, certify_command, provenance
from crashfuse.results.render.text import json_bytes
from crashfuse.results.result import Deferred, Figure, ForReading, Result
from crashfuse.results.result_tables import repeats_table
from crashfuse.results.table import Table
from crashfuse.study.repeatability import repeatability
from crashfuse.units import LB, MPH, Sentence, joined

_CONDITIONS, _CONDITIONS_OF_MANY = 14, 10  # of a sheet at the height it has on paper; of several, two fill a page
_CRITERIA = 2  # of a sheet
_MOST_SHEETS = 20
_SHEET = ["Activity", "Factor", "Question", "Basis", "What the data say", "Source"]


def certification_result(certification: Certification, notes: Sequence[Note] = ()) -> Result:
    """A certification, what became of an earlier one, and readers' notes."""
    campaign, config, criteria = certification.campaign, certification.config, certification.criteria
    reading = partial(ForReading, usual=campaign.units)

    def repeats() -> Table:
        known = repeatability(campaign, config.windows_ms, seed=config.seed)
        return repeats_table(known, campaign.test_ids, config.windows_ms) or Table.of("repeats", ())

    def credibility() -> Table:
        rows = credibility_rows(certification)
        rows.loc[rows.duplicated("factor"), ["activity", "factor", "question"]] = ""
        return Table.of("credibility", rows.set_axis(_SHEET, axis=1))

    told: dict[str, tuple[str, ...]] = {place: said.sentences(certification, place) for place in said.PLACES}
    told["verdicts"] += (criteria.scatter,)
    limits = Sentence("Limits: {}.", joined([Sentence("{} {}", own.name, own.limits) for own in criteria.items], ", "))
    sealed = f"Sealed by the key {certification.key}." if certification.key else "Not sealed."
    return Result(
        kind="certification",
        title="certification by analysis",
        campaign=campaign,
        config=config,
        command=partial(certify_command, certification),
        held_out=campaign.test_ids,
        answer=said.answer(certification),
        against=said.against(certification),
        shown=("planned", "counts"),
        sentences={**told, "limits": (limits,), "evidence": (*told["record"][:2], campaign.quality.checks, sealed)},
        tables=Deferred(**tables.makers_of_tables(certification), credibility=credibility, repeats=repeats),
        figures=_figures(certification),
        parts={"data": (campaign_result(campaign),), "left_out": _left_out(certification)},
        values={
            "date": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
            "key": certification.key,
            "n_conditions": len(certification.matrix.ids),
            "quantities": list(dict.fromkeys(criterion.label for criterion in criteria.items)),
            "confidence": criteria.confidence,
            "costs": criteria.costs,
            "exceptions": said.exceptions(certification),
            "notes": [(note.test, note.when, note.text) for note in notes],
            "earlier": certification.since and certification.since.earlier,
        },
        files={
            "certification.csv": reading(
                lambda units: tables.csv_as_given(tables.certification_table(certification, units))
            ),
            "track_record.csv": lambda: csv_bytes(certification.track_record),
            "credibility.csv": reading(lambda units: csv_bytes(credibility_table(certification, units))),
            "certification.json": lambda: certification_json(certification),
        },
    )


def _figures(certification: Certification) -> dict[str, Figure]:
    record, n = certification.record, len(certification.matrix.ids)
    domain, matrix = partial(plots.validated_domain, certification), partial(plots.verdict_matrix, certification)
    size = _CONDITIONS if n <= _CONDITIONS else _CONDITIONS_OF_MANY
    scales = [partial(plots.planned_scales, certification, part=slice(i, i + size)) for i in range(0, n, size)]
    close = Figure("How close each planned test is", partial(plots.planned_scales, certification), is_answer=True)
    figures = {"planned": close._replace(sheets=tuple(scales[:_MOST_SHEETS]))}
    figures["domain"] = Figure("Validated domain, and the conditions in it", domain)
    if record.trials:
        judged = [criterion for criterion in certification.criteria.items if record.of(criterion)]
        parts = [judged[i : i + _CRITERIA] for i in range(0, len(judged), _CRITERIA)]
        draw, *sheets = (partial(plots.record_figure, record, some) for some in (judged, *parts))
        figures["record"] = Figure("Evidence from left-out tests", draw, sheets=tuple(sheets))
        figures["reliability"] = Figure("Do the probabilities come true?", lambda _: plots.reliability(record))
    sheets = [partial(matrix, part=slice(i, i + size)) for i in range(0, n, size)]
    if n > size * _MOST_SHEETS:
        sheets = [partial(matrix, words=False)]
    figures["verdicts"] = Figure("Verdicts", matrix, is_answer=True, sheets=tuple(sheets))
    return figures


def _left_out(certification: Certification) -> tuple[Result, ...]:
    campaign, approach = certification.campaign, certification.config.approaches[0]
    names = {**tables.PULSE_OF, BASELINE: BASELINE, **({} if approach == BASELINE else {"test": approach})}

    def overlay(test: CrashTest, display: Display) -> Drawing:
        made = tables.left_out_pulses(certification)[test.id].items()
        drawn = {names[way]: Prediction(test.condition, accel_mps2.mean(axis=0)) for way, accel_mps2 in made}
        return pulses.overlay(test, drawn, display)

    def part(test: CrashTest) -> Result:
        figure = Figure("test, CAE model and prediction", partial(overlay, test))
        return Result(kind="left-out test", title=f"{test.id}, left out", figures={"overlay": figure})

    left_out = dict.fromkeys(test for test, _ in certification.record.predicted_mps2)
    return tuple(part(campaign.test(test)) for test in left_out)


def certification_figure(certification: Certification, figure: str, **display: Unpack[DisplayOptions]) -> Drawing:
    """A figure of a certification, see :meth:`Certification.plot`."""
    shown = Display.of(certification.campaign.units, **display)
    return one_of("figure of verdicts", figure, _figures(certification)).draw(shown)


def certification_json(certification: Certification) -> bytes:
    """The file, with what became of an earlier certification, if any."""
    record = certification_record(certification)
    if certification.since is not None:
        record["since"] = _since(certification, certification.since)
    return json_bytes(record)


def _since(certification: Certification, since: LaterTests) -> dict[str, object]:
    bounds = said.outcomes(since)
    return {
        "sha256": since.earlier.digest,
        "date": since.earlier.date,
        "new_tests": since.new,
        "decided": {**tables.share_columns(bounds["verdicts"]), "tests": bounds["tests"].n},
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
        "sentences": said.sentences(certification, "since"),
    }


def certification_record(certification: Certification) -> dict[str, object]:
    """Versions, settings, criteria, matrix, and counts of verdicts with bounds, as JSON."""
    campaign, record, config = certification.campaign, certification.record, certification.config
    criteria, domain, costs = certification.criteria, certification.domain, certification.criteria.costs
    counts = tables.counts_frame(certification).set_index("criterion")
    brier, (tests, saved, wrong) = record.brier or (None, None), record.waived(criteria)
    (inside, intervals), (inside_outside, outside) = record.intervals, record.intervals_outside
    with_runs, rows = certification.record_with_runs, certification.rows.items()
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
            **({"tolerances": asdict(criteria.tolerances)} if criteria.tolerances else {}),
            "criterion": [_criterion(criterion) for criterion in criteria.items],
        },
        **({"costs": _costs(certification)} if costs else {}),
        "matrix": tables.matrix_table(certification.matrix).to_dict("records"),
        "cells": {i: {v.criterion.name: (v.word, v.probability, v.lower, v.upper) for v in row} for i, row in rows},
        "monte_carlo": {
            i: {
                "seeds": max(len(v.chances) for v in row),
                "error": {v.criterion.name: round(v.error, 4) for v in row},
                "interval": {v.criterion.name: v.probability_interval for v in row},
            }
            for i, row in rows
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
        "spot_check": said.spot_check(certification),
        "bounds": {unit: share.at_most for unit, share in record.bounds().items()},
        "track_record": {
            "near_limit": tables.share_columns(record.near_limit.bounds()["verdicts"]),
            **tables.record_counts(record),
            "decided_tests": tables.share_columns(record.bounds()["tests"]),
            "waived": {"tests": tests, **tables.share_columns(WrongShare(wrong, saved))},
            "saved": {test: list(ways) for test, ways in record.saved(criteria).items()},
            "intervals": {"n": intervals, "inside": inside},
            "intervals_outside": {"n": outside, "inside": inside_outside},
            "ratings": tables.left_out_ratings(certification).frame.to_dict("records"),
            "tuned": {unit: tables.share_columns(share) for unit, share in trial_bounds(record.tuned).items()},
            "whole_pulses": {way: {"n": n, "inside": inside} for way, (inside, n) in record.whole_pulses.items()},
            **({} if with_runs is None else {"with_paired_runs": tables.record_counts(with_runs)}),
            "brier": brier[0],
            "brier_raw_cae": brier[1],
            "reliability": [{**asdict(own), "holds": own.holds} for own in record.reliability],
        },
        "by_criterion": {
            own.name: {
                "verdicts": {str(word): int(n) for word, n in counts.loc[own.name].drop("limit").items()},
                "track_record": tables.record_counts(record, own),
                "support": {**asdict(support), "confidence": round(support.confidence, 4)},
            }
            for own in criteria.items
            for support in [record.support(own)]
        },
        "sentences": said.sentences(certification, "summary"),
        "exceptions": said.exceptions(certification),
    }


def _costs(certification: Certification) -> dict[str, object]:
    return {
        fact.code.removeprefix("costs."): {key: v for key, v in fact.values.items() if not isinstance(v, str)}
        for fact in said.facts(certification)
        if fact.code.startswith("costs.")
    }


def _criterion(criterion: Criterion) -> dict[str, object]:
    return {k: v for k, v in {**asdict(criterion), "unit": criterion.unit or None}.items() if v is not None}
