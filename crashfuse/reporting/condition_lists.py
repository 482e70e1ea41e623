"""Conditions of a matrix in a sentence: a few one by one, many as ranges of neighbouring rows that share an answer."""

from collections.abc import Iterable, Mapping
from itertools import groupby

ONE_BY_ONE = 6  # conditions, or fewer
_RANGES = 8


def listed_conditions(rows: Iterable[str], answers: Mapping[str, str], file: str = "certification.csv") -> str:
    """Conditions, each with its answer in brackets if there is one: ``M01 to M08, M11 (crush); M09 (peak)``.

    Parameters
    ----------
    rows : iterable of str
        Ids of the conditions in the order of the matrix.
    answers : mapping of str to str
        By the id of each condition that is told; of many, the answer that most of them share is told first.
    file : str
        Which file has those that are left out.
    """
    if len(answers) <= ONE_BY_ONE:
        return ", ".join(_with_answer(i, own) for i, own in answers.items())
    ranges: dict[str, list[list[str]]] = {}
    for answer, ids in groupby(rows, answers.get):
        if answer is not None:
            ranges.setdefault(answer, []).append(list(ids))
    told, left, room = [], len(answers), _RANGES
    for answer, own in sorted(ranges.items(), key=lambda item: -sum(map(len, item[1]))):
        if shown := own[:room]:
            told.append(_with_answer(", ".join(map(_range, shown)), answer))
        room -= len(shown)
        left -= sum(map(len, shown))
    listed = "; ".join(told)
    return f"{len(answers):,} conditions, {listed} and {left:,} more, all in {file}" if left else listed


def _range(ids: list[str]) -> str:
    return ", ".join(ids) if len(ids) < 3 else f"{ids[0]} to {ids[-1]}"


def _with_answer(conditions: str, answer: str) -> str:
    return f"{conditions} ({answer})" if answer else conditions
