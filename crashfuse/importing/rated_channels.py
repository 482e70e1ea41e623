"""Ratings of whole ISO-MME tests, channel by channel, as they are in the files."""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from crashfuse.errors import DataError, Problem, printable
from crashfuse.importing.rated_files import WINDOWS_MS, Curve, rated, ratings_table, reason
from crashfuse.readers.credibility import Doubt, doubt_of
from crashfuse.readers.isomme import read_isomme
from crashfuse.readers.isomme_channels import Channel
from crashfuse.signals.pulse import Pulse

_CLASSES = {"A": "CFC 1000", "B": "CFC 600", "C": "CFC 180", "D": "CFC 60", "0": "unfiltered", "P": "prefiltered"}


def rate_channels(
    reference: str | Path, comparison: str | Path, windows_ms: Sequence[float] = WINDOWS_MS
) -> pd.DataFrame:
    """Rate every channel of one ISO-MME test against the channel of the other that has the same code.

    Of several channels with one code, the n-th is rated against the n-th.

    Parameters
    ----------
    reference, comparison : str or Path
        A test's folder, its ``.mme`` file, or a zip of it.
    windows_ms : sequence of float
        Rated are 0 to each of these, in ms.

    Returns
    -------
    DataFrame
        Columns :data:`~crashfuse.importing.rated_files.COLUMNS`, one row for each channel and window; a channel that
        cannot be rated, or is marked as failed, has one row, with a note; one of questionable quality is noted.

    Raises
    ------
    DataError
        If one of them is no ISO-MME test, or they have no channel in common.
    """
    reference, comparison = Path(reference), Path(comparison)
    sides = [_channels(path) for path in (reference, comparison)]
    if not set(sides[0]) & set(sides[1]):
        found = "codes that occur in one of them only"
        raise DataError(Problem(comparison.name, f"channels of {reference.name}", found, "rate their pulses instead"))
    rows: list[dict[str, object]] = []
    for key in [key for key in sides[0] if key in sides[1]] + [key for key in sides[0] if key not in sides[1]]:
        one, other = sides[0][key], sides[1].get(key)
        name = key[0] if key[1] == 1 else f"{key[0]} ({key[1]})"
        try:
            rows += [{"channel": name, **row} for row in _rows(one, other, windows_ms)]
        except DataError as error:
            rows.append({"channel": name, "note": reason(error)})
    rows += [{"channel": key[0], "note": "only in the comparison"} for key in sides[1] if key not in sides[0]]
    return ratings_table(rows).assign(reference=str(reference), comparison=str(comparison))


def _rows(one: Channel, other: Channel | None, windows_ms: Sequence[float]) -> Iterator[dict[str, object]]:
    if other is None:
        yield {"note": "only in the reference"}
        return
    if one.unit != other.unit:
        raise DataError(
            Problem(one.code, f"the reference's unit, {one.unit or 'none'}", other.unit or "none", "convert")
        )
    doubts = [
        (doubt_of(channel.status), side, channel.status)
        for side, channel in (("reference", one), ("comparison", other))
    ]
    note = "; ".join(f"the {side} marks it {printable(status)!r}" for doubt, side, status in doubts if doubt)
    if max(doubts)[0] == Doubt.FAILED:
        yield {"note": note}
        return
    yield from ({**row, "note": note} for row in rated(_signal(one), _signal(other), windows_ms))


def _channels(path: Path) -> dict[tuple[str, int], Channel]:
    """The channels of a test by code and number among those with that code."""
    count: Counter[str] = Counter()
    found: dict[tuple[str, int], Channel] = {}
    for channel in read_isomme(path).channels:
        code = channel.code.upper()
        if code:
            count[code] += 1
            found[code, count[code]] = channel
    return found


def _signal(channel: Channel) -> Curve:
    """A channel of any quantity, in its own unit."""
    if channel.interval_s is None or channel.values.size < 2:
        raise DataError(Problem(channel.code, "an evenly sampled signal", "no sampling interval", "export it again"))
    time_s = (channel.start_s or 0.0) + np.arange(channel.values.size) * channel.interval_s
    return Curve(Pulse(time_s, channel.values), _CLASSES.get(channel.code[-1:].upper(), "filter class unknown"))
