"""Reader of ISO-MME, the exchange format of crash laboratories (ISO/TS 13499): a folder, or a zip of one.

::

    T1/T1.mme             descriptors of the test, one per line: ``Name of the descriptor      :value``
    T1/Channel/T1.chn     the list of channels: ``Name of channel 001         :10VEHC000000ACXD / Vehicle X``
    T1/Channel/T1.001     a channel: its descriptors in the same form, then one sample per line

Time is implicit (``Time of first sample`` and ``Sampling interval``, s), or a separate channel that a channel names as
its reference. ``NOVALUE`` means unknown.

A channel code has 16 characters, see :mod:`crashfuse.readers.channel_codes`.

Sources: ISO/TS 13499 with its related electronic documents A (descriptors) and B (channel codes), 1.6.2, as quoted by
the public packages pyisomme and sdata, which also show that laboratories write UTF-8, Windows-1252 and Latin-1.
"""

from collections.abc import Iterable
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path, PurePath, PurePosixPath

import numpy as np

from crashfuse.errors import DataError, Problem, collecting, printable
from crashfuse.files.archive import Budget, Limits, Member, refuse
from crashfuse.readers.credibility import Doubt, doubt_of
from crashfuse.readers.isomme_channels import NO_VALUE, Channel, IsommeTest, Pairs, first_of
from crashfuse.readers.members import as_text, is_numbered, opened_members
from crashfuse.readers.unit_spelling import UNITS, unit_named
from crashfuse.signals.pulse import FloatArray

_MOST_LINES = 2_000_000  # per file: 100 s at 20 kHz
_MOST_DESCRIPTORS = 10_000
_UNEVEN = 0.02  # of a step, in a time channel

ISOMME_LIMITS = Limits(total_bytes=256 << 20, member_bytes=64 << 20)
"""Size limits of a test; 300 channels of 60,000 samples are within them."""


def read_isomme(path: Path, limits: Limits = ISOMME_LIMITS) -> IsommeTest:
    """Read one ISO-MME test: its descriptors and all its channels.

    The path is its folder, its ``.mme`` file or a zip; films and pictures are skipped. A channel that is marked as
    failed and cannot be read has no samples. A DataError says that it is not an ISO-MME test, or which other channels
    contradict their headers.
    """
    with opened_members(path, _is_text, "an ISO-MME folder or zip", limits) as (members, budget):
        if path.suffix.lower() == ".mme" and path.is_file():
            members = [m for m in members if m.path.suffix.lower() != ".mme" or m.path == PurePosixPath(path.name)]
        return _read(members, path.name, budget)


def _read(members: Iterable[Member], name: str, budget: Budget) -> IsommeTest:
    files = [member for member in members if _is_text(member.path)]
    headers = [member for member in files if member.path.suffix.lower() == ".mme"]
    if len(headers) != 1:
        found = f"{len(headers)} of them" if headers else "none"
        raise DataError(Problem(name, "one .mme file", found, "choose the folder of one test"))
    home = headers[0].path.parent
    near = [member for member in files if member.path.parent == home or _is_channel_folder(member.path.parent, home)]
    listed = [
        pair
        for member in near
        if member.path.suffix.lower() == ".chn"
        for pair in _descriptors(_lines_in(member, budget), member.where)
    ]
    problems: list[Problem] = []
    channels: list[tuple[Channel, str | None]] = []
    clocks: dict[str, Channel] = {}
    numbered = [member for member in near if is_numbered(member.path)]
    for member in sorted(numbered, key=lambda member: int(member.path.suffix[1:])):
        with collecting(problems):
            channel, clock = _channel(member, listed, budget)
            channels.append((channel, clock))
            clocks |= {name: channel for name in (member.path.suffix[1:], channel.name, channel.code) if name}
    refuse(problems, name)
    if not channels:
        raise DataError(Problem(name, "channel files .001, .002 … in Channel/", "none", "export the channels too"))
    timed = tuple(_timed(channel, clocks.get(reference or "")) for channel, reference in channels)
    descriptors = _descriptors(_lines_in(headers[0], budget), headers[0].where)
    return IsommeTest(headers[0].path.stem, tuple(descriptors), timed)


def _channel(member: Member, listed: Pairs, budget: Budget) -> tuple[Channel, str | None]:
    """One channel, and the code of its time channel, if any."""
    lines, where = _lines_in(member, budget), member.where
    end = next((row for row, line in enumerate(lines) if line.strip() and ":" not in line), len(lines))
    header = _descriptors(lines[:end], where)
    status = first_of(header, "Data status") or ""
    values: FloatArray = np.empty(0)
    with suppress(DataError) if doubt_of(status) == Doubt.FAILED else nullcontext():
        values = _samples(lines[end:], header, where)
    interval = _seconds_in(header, "Sampling interval", where)
    if interval is not None and interval <= 0:
        raise DataError(Problem(where, "a number above 0", f"{interval:g}", "correct the header", "Sampling interval"))
    code, _, name = (first_of(listed, f"Name of channel {member.path.suffix[1:]}") or "").partition("/")
    channel = Channel(
        code=first_of(header, "Channel code") or code.strip(),
        name=first_of(header, "Name of the channel") or name.strip(),
        unit=first_of(header, "Unit") or "",
        values=values,
        interval_s=interval,
        start_s=_seconds_in(header, "Time of first sample", where),
        comments=tuple(value for name, value in header if name.lower() == "comments"),
        source=first_of(header, "Data source") or "",
        status=status,
    )
    implicit = (first_of(header, "Reference channel") or "").lower() == "implicit"
    return channel, None if implicit else first_of(header, "Reference channel name")


def _samples(lines: list[str], header: Pairs, where: str) -> FloatArray:
    """The samples, as many as the header says."""
    values, count = _numbers(lines, where), _number_in(header, "Number of samples", where)
    if count is not None and count != values.size:
        expected = f"{count:g} samples, as its header says"
        raise DataError(Problem(where, expected, f"{values.size}", "export the channel again"))
    return values


def _timed(channel: Channel, clock: Channel | None) -> Channel:
    """The channel with the sampling of its time channel, if that is even and of equal length."""
    if clock is None or clock.values.shape != channel.values.shape or clock.values.size < 2:
        return channel
    time_s = clock.values * UNITS["time"][unit_named(clock.unit, "time") or "s"]
    steps = np.diff(time_s)
    mean = float(steps.mean())
    if not (mean > 0 and np.abs(steps - mean).max() <= _UNEVEN * mean):
        return replace(channel, interval_s=None)
    return replace(channel, interval_s=mean, start_s=float(time_s[0]))


def _lines_in(member: Member, budget: Budget) -> list[str]:
    text = as_text(member.content(budget)).replace("\r\n", "\n").replace("\r", "\n")
    if text.count("\n") > _MOST_LINES:
        raise DataError(Problem(member.where, f"at most {_MOST_LINES} lines", "more", "export a shorter record"))
    return text.split("\n")  # splitlines() would also split at the … of Windows-1252 read as Latin-1


def _descriptors(lines: list[str], where: str) -> list[tuple[str, str]]:
    """Descriptor names and values, without those that have no value."""
    if len(lines) > _MOST_DESCRIPTORS:
        expected = f"at most {_MOST_DESCRIPTORS} descriptors"
        raise DataError(Problem(where, expected, f"{len(lines)}", "export the test again"))
    parts = [line.partition(":") for line in lines if ":" in line]
    if not parts:
        raise DataError(Problem(where, "lines of the form Name :value", "none", "export the test again"))
    pairs = [(name.strip(), value.strip()) for name, _, value in parts]
    return [(name, value) for name, value in pairs if value.upper() not in ("", NO_VALUE)]


def _numbers(lines: Iterable[str], where: str) -> FloatArray:
    cells = (cell for line in lines if (cell := line.strip()))
    try:
        values = np.array([np.nan if cell.upper() == NO_VALUE else float(cell) for cell in cells], dtype=np.float64)
    except ValueError as error:
        found = printable(str(error).rpartition(":")[2].strip())
        expected = "one number a line after the header"
        raise DataError(Problem(where, expected, found, "export the channel again")) from None
    if np.isinf(values).any():
        raise DataError(Problem(where, "finite numbers", "an infinite one", "export the channel again"))
    return values


def _number_in(header: Pairs, name: str, where: str) -> float | None:
    if (text := first_of(header, name)) is None:
        return None
    try:
        value = float(text.split()[0])  # "0.0001 s" occurs in practice
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise DataError(Problem(where, "a number", printable(text), "correct the header", name))
    return value


def _seconds_in(header: Pairs, name: str, where: str) -> float | None:
    """A time in s, the unit defined by the format unless the value names another."""
    value = _number_in(header, name, where)
    unit = (first_of(header, name) or "").split()[1:]
    if value is None or not unit:
        return value
    known = unit_named(unit[0], "time")
    if known is None:
        raise DataError(Problem(where, "a time in s or ms", printable(unit[0]), "correct the header", name))
    return value * UNITS["time"][known]


def _is_channel_folder(path: PurePath, home: PurePath) -> bool:
    return path.parent == home and path.name.lower() == "channel"


def _is_text(path: PurePath) -> bool:
    return path.suffix.lower() in (".mme", ".chn") or is_numbered(path)
