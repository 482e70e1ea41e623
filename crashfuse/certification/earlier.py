"""An earlier certification, as its ``certification.json`` tells it: what was said of which conditions."""

import hashlib
import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Self

from crashfuse.campaign_folder.ids import id_trouble
from crashfuse.certification.criteria import Criteria
from crashfuse.certification.criteria_file import criteria_of
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.verdict import WORDS, Word
from crashfuse.condition import Condition
from crashfuse.errors import CrashfuseError, DataError, Problem

FILE = "certification.json"
"""The file that an earlier certification is read from."""

_LARGEST = 64 << 20  # bytes


class EarlierVerdict(NamedTuple):
    """What was said of one criterion at one condition: as in :class:`crashfuse.certification.verdict.Verdict`."""

    word: Word
    probability: float | None
    lower: float | None
    upper: float | None

    @property
    def decided(self) -> bool:
        """Whether no test was needed to tell."""
        return self.word in ("met", "not met")

    def holds(self, value: float) -> bool | None:
        """Whether the 95 % interval holds a value; None if it was not known."""
        if self.lower is None and self.upper is None:
            return None
        return (self.lower is None or self.lower <= value) and (self.upper is None or value <= self.upper)


@dataclass(frozen=True, eq=False)
class Earlier:
    """An earlier certification.

    Attributes
    ----------
    digest : str
        SHA-256 of its file.
    settings : dict of str to object
        Campaign, version, approach, preset and seed.
    tests : tuple of str
        Those that it learned from.
    verdicts : tuple of tuple of EarlierVerdict
        By condition of its matrix, then by criterion.
    """

    digest: str
    settings: dict[str, object]
    tests: tuple[str, ...]
    criteria: Criteria
    matrix: Matrix
    run: dict[str, tuple[str, ...]]
    verdicts: tuple[tuple[EarlierVerdict, ...], ...]

    def __repr__(self) -> str:
        return f"<Earlier certification of {len(self.matrix.ids)} conditions from {len(self.tests)} tests>"

    @property
    def waived(self) -> tuple[str, ...]:
        """Conditions that needed no test, as every criterion was met, and had none."""
        rows = zip(self.matrix.ids, self.verdicts, strict=True)
        return tuple(i for i, row in rows if i not in self.run and all(own.word == "met" for own in row))

    @classmethod
    def read(cls, path: Path) -> Self:
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
        return cls.parse(content, path)

    @classmethod
    def parse(cls, content: bytes, path: Path = Path(FILE)) -> Self:
        """The same of a file's content; ``path`` is named where it is wrong."""
        try:
            return cls._of(json.loads(content), hashlib.sha256(content).hexdigest())
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError, CrashfuseError):
            raise _no_such_file(path, "the record of a certification", "another file, or a damaged one") from None

    @classmethod
    def _of(cls, values: dict[str, Any], digest: str) -> Self:
        criteria = criteria_of(values["criteria"]["criterion"], values["criteria"]["confidence"])
        rows = [dict(row) for row in values["matrix"]]
        matrix = Matrix(_ids(row.pop("id") for row in rows), tuple(Condition.of(**row) for row in rows))
        cells, config = values["cells"], values["config"]
        return cls(
            digest,
            {
                "campaign": values["campaign"],
                "version": values["crashfuse"],
                "approach": config["approaches"][0],
                **{name: config[name] for name in ("preset", "seed")},
            },
            _ids(values["tests"]),
            criteria,
            matrix,
            {i: _ids(values["run"][i]) for i in matrix.ids if i in values["run"]},
            tuple(tuple(_verdict(*cells[i][own.name]) for own in criteria.items) for i in matrix.ids),
        )


def _ids(ids: Iterable[str]) -> tuple[str, ...]:
    checked = tuple(ids)
    if trouble := next(filter(None, map(id_trouble, checked)), None):
        raise ValueError(f"expected {trouble[0]}, found {trouble[1]}")
    return checked


def _verdict(word: Word, probability: float | None, lower: float | None, upper: float | None) -> EarlierVerdict:
    numbers = [own for own in (probability, lower, upper) if own is not None]
    if word not in WORDS or not (probability is None or 0 <= probability <= 1) or not all(map(math.isfinite, numbers)):
        raise ValueError(f"a verdict {word} with probability {probability}")
    return EarlierVerdict(word, probability, lower, upper)


def _no_such_file(path: Path, expected: str, found: str) -> DataError:
    advice = f"give the {FILE}, or its folder, that crashfuse certify wrote"
    return DataError(Problem(path.name, expected, found, advice))
