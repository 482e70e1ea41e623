"""An earlier certification, read from its ``certification.json``."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from crashfuse.campaign_folder.ids import id_trouble
from crashfuse.campaign_folder.occupant_settings import occupant_settings
from crashfuse.certification.criteria_file import criteria_of, is_number
from crashfuse.certification.earlier import FILE, Earlier, EarlierVerdict, Outcomes
from crashfuse.certification.gone import Gone
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import Trial
from crashfuse.certification.verdict import WORDS, Word
from crashfuse.condition import Condition
from crashfuse.errors import CrashfuseError, DataError, Problem, printable
from crashfuse.signals.occupant import OccupantModel
from crashfuse.study.estimate import is_beyond

_LARGEST = 64 << 20  # bytes
_LONGEST = 200  # characters of a setting
_WRONG = ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError, CrashfuseError


def read_earlier(path: Path) -> Earlier:
    """Read ``certification.json``, or the one in this folder.

    Raises
    ------
    DataError
        If it is not such a file.
    """
    path = path / FILE if path.is_dir() else path
    try:
        if path.stat().st_size > _LARGEST:
            raise _no_such_file(path, "at most 64 MB", f"{path.stat().st_size / 2**20:.0f} MB")
        content = path.read_bytes()
    except OSError as error:
        raise _no_such_file(path, "this file", error.strerror or "none that can be read") from None
    return parse_earlier(content, path)


def parse_earlier(content: bytes, path: Path = Path(FILE)) -> Earlier:
    """The same of a file's content; ``path`` is named where it is wrong."""
    try:
        return _of(json.loads(content), hashlib.sha256(content).hexdigest())
    except _WRONG:
        expected = "the record of a certification"
        found = "another file, or a damaged one" if content.strip() else "an empty file"
        raise _no_such_file(path, expected, found) from None


def _of(values: dict[str, Any], digest: str) -> Earlier:
    rows, cells, before = [dict(row) for row in values["matrix"]], values["cells"], values.get("since", {})
    criteria = criteria_of(values["criteria"]["criterion"], values["criteria"]["confidence"])
    matrix = Matrix(_ids(row.pop("id") for row in rows), tuple(Condition.of(**row) for row in rows))
    if any(map(is_beyond, matrix.conditions)):
        raise ValueError("a condition beyond any test")
    return Earlier(
        digest,
        tuple(map(_text, filter(None, (before.get("sha256"), *before.get("before", ()))))),
        f"{datetime.fromisoformat(values['date']).astimezone(UTC):%Y-%m-%d %H:%M} UTC",
        {"campaign": "another vehicle", **{name: _text(own) for name, own in values["settings"].items()}},
        dict(zip(_ids(values["tests_sha256"]), map(_text, values["tests_sha256"].values()), strict=True)),
        criteria,
        matrix,
        _occupant(values),
        tuple(_trial(**own) for own in before.get("verdicts", ())),
        {_text(name): _outcomes(tests) for name, tests in before.get("waived_and_tested", {}).items()},
        tuple(_gone(**own) for own in before.get("gone", ())),
        {i: _shown(tests) for i, tests in values["run"].items() if i in matrix.ids},
        tuple(tuple(_verdict(*cells[i][own.name]) for own in criteria.items) for i in matrix.ids),
    )


def _text(value: object) -> str:
    if not isinstance(value, str) or printable(value, _LONGEST) != value:
        raise ValueError("no text of one line")
    return value


def _ids(ids: Iterable[str]) -> tuple[str, ...]:
    checked = tuple(ids)
    if any(map(id_trouble, checked)) or len(set(checked)) < len(checked):
        raise ValueError("no ids, or one twice")
    return checked


def _trial(
    test: str, condition: str, criterion: dict[str, Any], said: list[Any], measured: float, shift: float = 0.0
) -> Trial:
    (limit,) = criteria_of([criterion]).items
    if not is_number(measured) or not is_number(shift) or id_trouble(test):
        raise ValueError("no measured value of a test")
    return _verdict(*said).trial(test, Condition.parse(condition), limit, float(measured), float(shift))


def _outcomes(tests: dict[str, dict[str, list[str]]]) -> Outcomes:
    each = [(tuple(map(_text, own["missed"])), tuple(map(_text, own["unknown"]))) for own in tests.values()]
    return dict(zip(_ids(tests), each, strict=True))


def _gone(test: str, sha256: str, condition: str, measured: dict[str, float | None]) -> Gone:
    (shown,) = _shown({test: measured}).values()
    return Gone(test, _text(sha256), Condition.parse(condition), shown)


def _occupant(values: dict[str, Any]) -> OccupantModel:
    problems: list[Problem] = []
    found = occupant_settings({"occupant": values.get("occupant", {})}, problems)
    if problems:
        raise ValueError("no occupant model")
    return found


def _shown(tests: dict[str, dict[str, float | None]]) -> Mapping[str, Mapping[str, float | None]]:
    """What tests at a condition showed, by criterion."""
    found = dict(zip(_ids(tests), ({_text(name): v for name, v in own.items()} for own in tests.values()), strict=True))
    if not all(value is None or is_number(value) for own in found.values() for value in own.values()):
        raise ValueError("no number")
    return found


def _verdict(word: Word, probability: float | None, lower: float | None, upper: float | None) -> EarlierVerdict:
    numbers = [own for own in (probability, lower, upper) if own is not None]
    if word not in WORDS or not all(map(is_number, numbers)):
        raise ValueError("no verdict")
    if not 0 <= (probability or 0) <= 1 or (lower is not None and upper is not None and lower > upper):
        raise ValueError("no probability, or no interval")
    return EarlierVerdict(word, probability, lower, upper)


def _no_such_file(path: Path, expected: str, found: str) -> DataError:
    advice = f"give the {FILE} of a certification, as crashfuse certify and the page Certify write it"
    return DataError(Problem(path.name, expected, found, advice))
