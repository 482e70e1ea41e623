"""What was computed on this machine: a small record of every study and prediction, kept beside the cache.

A record holds ratings and settings, no pulses.
"""

import hashlib
import json
import logging
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from math import isfinite
from pathlib import Path
from typing import Any, Self

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import DataError, Problem, UsageError, printable
from crashfuse.execution.cache import default_folder
from crashfuse.files.atomic import sole_writer, write_atomically
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.recommendation import recommend, recommend_for
from crashfuse.study.study import Study

Ratings = Mapping[str, Mapping[str, Mapping[float, float]]]
"""Overall ratings by held-out test, approach and window in ms."""

log = logging.getLogger(__name__)

MOST = 300  # records that are kept; the oldest make room
LONGEST_NOTE = 200  # characters

_LARGEST = 1_000_000  # bytes of a record; one of 40 tests has 40,000
_PATIENCE_S = 10.0  # to wait for another process that writes a record
_DATE = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00")


@dataclass(frozen=True)
class PastResult:
    """A study, or a prediction at a condition, that was computed before."""

    campaign: str
    fingerprint: str  # SHA-256 of the campaign's content
    config: StudyConfig
    basis: str  # what its ratings rest on
    approach: str  # the recommended one
    date: str  # UTC
    ratings: Ratings = field(default_factory=dict)  # of a study
    speed_groups: Ratings = field(default_factory=dict)  # with whole speed groups left out, if both were asked for
    condition: Condition | None = None  # of a prediction
    expected: str = ""  # rating to expect of a prediction: "0.78 to 0.93"
    note: str = ""

    @classmethod
    def of_study(cls, study: Study) -> Self:
        """The record of a finished study."""
        campaign, groups = study.campaign, study.speed_groups
        return cls(
            campaign=campaign.name,
            fingerprint=campaign.fingerprint,
            config=study.config,
            basis=campaign.rating_basis,
            approach=recommend(study).approach,
            date=_now(),
            ratings=_overall(study),
            speed_groups={} if groups is None else _overall(groups),
        )

    @classmethod
    def of_prediction(cls, campaign: Campaign, estimates: Sequence[Estimate], config: StudyConfig) -> Self:
        """The record of a prediction by several approaches at one condition."""
        condition = estimates[0].condition
        advice = recommend_for(estimates, campaign, condition)
        return cls(
            campaign=campaign.name,
            fingerprint=campaign.fingerprint,
            config=config,
            basis=campaign.rating_basis,
            approach=advice.approach,
            date=_now(),
            condition=condition,
            expected="" if advice.expected is None else advice.expected.range,
        )

    @property
    def id(self) -> str:
        """Twelve hexadecimal digits, equal for equal data, question and settings: a repetition replaces the record."""
        settings = asdict(self.config)
        del settings["to_ttzv"], settings["also"]  # of which nothing is kept
        asked = [self.fingerprint, settings, sorted(self.ratings), self.condition and self.condition.text]
        return hashlib.sha256(json.dumps(asked).encode()).hexdigest()[:12]

    @property
    def tests(self) -> tuple[str, ...]:
        """The tests that were held out in turn; none of a prediction."""
        return tuple(self.ratings)

    @property
    def by_way(self) -> dict[str, Ratings]:
        """Ratings by the way in which tests were left out: ``test``, or ``speed group``."""
        ways = self.config.split_configs
        return {ways[0].leave_out: self.ratings, **({ways[-1].leave_out: self.speed_groups} if len(ways) > 1 else {})}

    @property
    def windows_ms(self) -> tuple[float, ...]:
        """Windows over which it was rated."""
        return tuple(sorted({w for test in self.ratings.values() for by_window in test.values() for w in by_window}))

    def mean(self, approach: str, window_ms: float) -> float:
        """Mean rating over the tests."""
        overall = [test[approach][window_ms] for test in self.ratings.values()]
        return sum(overall) / len(overall)

    def worst(self, approach: str, window_ms: float) -> tuple[str, float]:
        """The test that was predicted worst, and its rating."""
        overall = {test_id: test[approach][window_ms] for test_id, test in self.ratings.items()}
        return min(overall.items(), key=lambda rated: rated[1])


def keep(result: PastResult) -> None:
    """Keep a record among those of this machine; where nothing can be written, none is kept.

    A result that is computed again keeps its date and its note.
    """
    folder = _home()
    try:
        with sole_writer(folder, _PATIENCE_S):
            before = _read(folder / f"{result.id}.json")
            if before is not None:
                result = replace(result, note=result.note or before.note)
                if replace(before, date=result.date) == result:
                    return
            _write(result, folder)
    except (OSError, DataError) as error:
        log.warning("Results could not be kept in %s: %s", folder, error)


def annotate(result: PastResult, note: str) -> None:
    """Write a note on a result that is kept; a DataError if it no longer is, or has another note since."""
    text = printable(" ".join(note.split())[:LONGEST_NOTE], LONGEST_NOTE)
    with sole_writer(_home(), _PATIENCE_S):
        before = _read(_home() / f"{result.id}.json")
        if before is None:
            kept, found = "a result that is kept", "one that was forgotten since"
            raise DataError(Problem(result.campaign, kept, found, "compute it again"))
        if before.note not in (result.note, text):
            found = f"“{before.note}”, which was written since"
            raise DataError(Problem(result.campaign, f"the note “{result.note}”", found, "write yours again"))
        _write(replace(before, note=text), _home())


def _write(result: PastResult, folder: Path) -> None:
    values = {**asdict(result), "condition": result.condition and result.condition.text}
    write_atomically(folder / f"{result.id}.json", json.dumps(values, ensure_ascii=False).encode())
    with suppress(OSError):  # a record was forgotten between two looks
        files = sorted((path.stat().st_mtime, path) for path in folder.glob("*.json"))
        for _, oldest in files[: max(len(files) - MOST, 0)]:
            oldest.unlink()


def past_results() -> list[PastResult]:
    """All that was kept, the latest first; what is no record, or is damaged, is passed over."""
    records = [_read(path) for path in _home().glob("*.json")]
    results = [record for record in records if record is not None]
    return sorted(results, key=lambda result: result.date, reverse=True)[:MOST]


def parsed(values: Mapping[str, Any]) -> PastResult:
    """A record from plain JSON values; a ValueError, TypeError, KeyError or UsageError if it is none."""
    names = ("campaign", "fingerprint", "basis", "approach", "date")
    texts = {name: values[name] for name in names}
    if not all(isinstance(text, str) for text in texts.values()) or not _DATE.fullmatch(texts["date"]):
        raise ValueError("no texts, or no date")
    condition = None if values["condition"] is None else Condition.parse(values["condition"])
    expected = values["expected"] or ""
    if not isinstance(expected, str):
        raise ValueError("no expectation")  # or of an earlier version
    ratings, groups = (_ratings(values[name], texts["approach"]) for name in ("ratings", "speed_groups"))
    if not ratings and condition is None:
        raise ValueError("neither a study nor a prediction")
    return PastResult(
        **texts,
        config=StudyConfig.parse(values["config"]),
        ratings=ratings,
        speed_groups=groups,
        condition=condition,
        expected=expected,
        note=printable(str(values.get("note", "")), LONGEST_NOTE),
    )


def _read(path: Path) -> PastResult | None:
    try:
        if path.stat().st_size <= _LARGEST:
            return parsed(json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        pass
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError, UsageError) as error:
        log.info("%s is no record of a result: %r", path.name, error)
    return None


def _ratings(values: Mapping[str, Any], approach: str) -> Ratings:
    ratings = {
        test: {name: {float(w): float(r) for w, r in by_window.items()} for name, by_window in by_approach.items()}
        for test, by_approach in values.items()
    }
    kinds = {tuple((name, *windows) for name, windows in by_approach.items()) for by_approach in ratings.values()}
    if len(kinds) > 1 or any(not by_approach.get(approach) for by_approach in ratings.values()):
        raise ValueError("ratings that differ in their approaches or windows")
    if not all(isfinite(r) for test in ratings.values() for by_window in test.values() for r in by_window.values()):
        raise ValueError("a rating that is no number")
    return ratings


def _overall(study: Study) -> Ratings:
    return {
        fold.held_out: {
            name: {window: round(rating.overall, 6) for window, rating in by_window.items()}
            for name, by_window in fold.ratings.items()
        }
        for fold in study.folds
    }


def _home() -> Path:
    return default_folder() / "history"


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
