"""An earlier certification is read from its JSON with every number, and from nothing else."""

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crashfuse.certification.criteria import criteria_of, criteria_text
from crashfuse.certification.earlier import FILE, parse_earlier, read_earlier
from crashfuse.certification.verdict import EarlierVerdict
from crashfuse.errors import DataError
from crashfuse.reporting.certification_record import _criterion
from crashfuse.signals.metrics import METRIC_UNITS
from crashfuse.signals.occupant import USUAL_OCCUPANT
from crashfuse.units import LB, MPH
from tests.conftest import problems_of

RECORD: dict[str, Any] = {
    "date": "2026-11-24T12:00:00+00:00",
    "settings": {"campaign": "Sedan", "approach": "Fused", "seed": "3"},
    "tests_sha256": {"T1": "a1", "T2": "b2"},
    "criteria": {
        "confidence": 0.9,
        "criterion": [
            {"name": "crush", "metric": "max_crush", "at_most": 600.0},
            {"name": "good", "metric": "rating", "window_ms": 60.0, "at_least": 0.8},
        ],
    },
    "matrix": [
        {"id": "A", "speed_mph": 20, "front_weight_lb": 2000, "rear_weight_lb": 1500, "drive": "FWD"},
        {"id": "B", "speed_mph": 30, "front_weight_lb": 2000, "rear_weight_lb": 1500, "drive": ""},
    ],
    "run": {"B": {"T2": {"crush": 510.0, "good": None}}},
    "cells": {
        "A": {"crush": ["met", 0.98, 400.0, 500.0], "good": ["met", 0.92, 0.7, 1.0]},
        "B": {"crush": ["open", 0.6, None, 610.0], "good": ["outside", None, None, None]},
    },
    "waived": {"A": {"at_least": 0.9, "probability": 0.91, "at_most": 0.92}},
}
TRIAL: dict[str, Any] = {
    "test": "T1",
    "condition": "20mph 2000lb 1500lb",
    "criterion": {"metric": "peak", "at_most": 40.0},
    "said": ["met", 0.97, 30.0, 38.0],
    "measured": 41.0,
}


def changed(at: tuple[object, ...], value: object) -> bytes:
    """The record with another value at a place."""
    record = json.loads(json.dumps(RECORD))
    part = record
    for key in at[:-1]:
        part = part[key]
    part[at[-1]] = value
    return json.dumps(record).encode()


def test_everything_that_is_compared_is_read(tmp_path: Path) -> None:
    """Of the file as of its folder: conditions in SI, criteria, verdicts, tests, settings and the file's digest."""
    (tmp_path / FILE).write_text(json.dumps(RECORD))
    earlier = read_earlier(tmp_path)
    assert earlier.matrix.ids == ("A", "B")
    assert earlier.matrix.conditions[0].vector.tolist() == pytest.approx([20 * MPH, 2000 * LB, 1500 * LB])
    assert earlier.matrix.conditions[0].factors == (("drive", "FWD"),)
    assert [own.limits for own in earlier.criteria.items] == ["at most 600 mm", "at least 0.80"]
    assert earlier.verdicts[1] == (
        EarlierVerdict("open", 0.6, None, 610.0),
        EarlierVerdict("outside", None, None, None),
    )
    assert earlier.tests == {"T1": "a1", "T2": "b2"}
    assert earlier.run == RECORD["run"]
    assert earlier.occupant == USUAL_OCCUPANT
    assert earlier.settings["approach"] == "Fused"
    assert earlier.date == "2026-11-24 12:00 UTC"
    assert earlier.waived == ("A",)
    assert read_earlier(tmp_path / FILE).digest == earlier.digest != parse_earlier(changed(("run",), {})).digest
    assert len(repr(earlier)) < 100


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"[]",
        b"[" * 100_000,
        b'{"study": 1}',
        changed(("cells",), {}),
        changed(("cells", "A", "crush"), ["met", 1.5, 1.0, 2.0]),
        changed(("cells", "A", "crush"), ["met", float("nan"), 1.0, 2.0]),
        changed(("cells", "A", "crush"), ["perhaps", 0.5, 1.0, 2.0]),
        changed(("cells", "A", "crush"), ["met", 0.5, "1", 2.0]),
        changed(("cells", "A", "crush"), ["met"]),
        changed(("cells", "A", "crush"), ["met", True, 1.0, 2.0]),
        changed(("cells", "A", "crush"), ["met", 0.5, 2.0, 1.0]),
        changed(("cells", "A", "crush"), ["met", 0.5, 10**400, None]),
        changed(("matrix", 0, "speed_mph"), -20),
        changed(("matrix", 0, "id"), "<b>\n"),
        changed(("matrix",), []),
        changed(("matrix", 1, "id"), "A"),
        changed(("matrix", 0, "speed_mph"), 10**400),
        changed(("matrix", 0, "speed_mph"), 1e308),
        changed(("matrix", 0, "speed_kph"), 30),
        changed(("tests_sha256",), {"\x1b[31m": "a"}),
        changed(("tests_sha256",), "T01"),
        changed(("tests_sha256", "T1"), 7),
        changed(("settings", "seed"), 0),
        changed(("settings", "seed"), {"a": 1}),
        changed(("settings", "campaign"), "a\x1b]0;x\x07\nSigned: certified"),
        changed(("settings", "campaign"), "x" * 1000),
        changed(("settings", "campaign"), "\ud800"),
        changed(("date",), None),
        changed(("date",), "yesterday"),
        changed(("run",), []),
        changed(("run", "B", "T2", "crush"), "510"),
        changed(("run", "B"), {"<b>\n": {}}),
        changed(("occupant",), {"olc_free_flight_mm": -1}),
        changed(("occupant",), [65, 235]),
        changed(("since",), {"verdicts": [{"test": "T1"}]}),
        changed(("since",), {"verdicts": [dict(TRIAL, measured="1")]}),
        changed(("since",), {"verdicts": [dict(TRIAL, condition="fast")]}),
        changed(("since",), {"verdicts": [dict(TRIAL, said=["right", 0.9, 1.0, 2.0])]}),
        changed(("since",), {"verdicts": [dict(TRIAL, test="\x1b")]}),
        changed(("since",), {"waived": {"T3": 1}}),
        changed(("since",), {"gone": [{"test": "T0", "sha256": "c3", "condition": "fast", "measured": {}}]}),
        changed(("criteria", "criterion"), [{"metric": "colour", "at_most": 1}]),
    ],
)
def test_another_file_is_one_sentence(content: bytes) -> None:
    """Whatever is wrong with it, what is expected and what to do is told in a line."""
    (problem,) = problems_of(lambda: parse_earlier(content))
    assert str(problem).startswith(f"{FILE}: expected the record of a certification, found ")
    assert "that crashfuse certify writes" in str(problem)
    assert str(problem).isprintable()


NUMBERS = st.floats(0, allow_nan=False, allow_infinity=False) | st.integers(0, 10**15)


@given(metric=st.sampled_from([*METRIC_UNITS]), limits=st.tuples(NUMBERS, NUMBERS), name=st.text(max_size=100))
def test_whatever_limit_was_judged_is_read_again(metric: str, limits: tuple[float, float], name: str) -> None:
    """A crush of at most 0.4 mm, too, if its unit was stated: in the record, among its trials, and in criteria.toml."""
    named = {"name": name} if name.strip() and name.isprintable() else {}
    stated = {"metric": metric, "unit": METRIC_UNITS[metric], "at_least": min(limits), "at_most": max(limits)}
    found = criteria_of([{**named, **stated}])
    (criterion,) = found.items
    record = json.loads(json.dumps(RECORD))
    record["criteria"]["criterion"] = [_criterion(criterion)]
    record["cells"] = {i: {criterion.name: ["met", 0.98, 1.0, 2.0]} for i in record["cells"]}
    record["run"], record["since"] = {}, {"verdicts": [dict(TRIAL, criterion=_criterion(criterion))]}
    earlier = parse_earlier(json.dumps(record).encode())
    assert earlier.criteria.items == tuple(trial.verdict.criterion for trial in earlier.trials) == found.items
    written = tomllib.loads(criteria_text(found))
    assert criteria_of(written["criterion"], written["confidence"]).items == found.items


def test_no_file_and_a_huge_one_are_told_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder without it, too."""
    for path in (tmp_path, tmp_path / "other.json"):
        with pytest.raises(DataError, match="expected the record of a certification, found no such file"):
            read_earlier(path)
    (tmp_path / FILE).write_text(json.dumps(RECORD))
    monkeypatch.setattr("crashfuse.certification.seal._LARGEST", 10)
    with pytest.raises(DataError, match="found 0 MB"):
        read_earlier(tmp_path)
