"""A channel of a TDMS file with its time: from its own properties, or from a channel of time beside it."""

from collections.abc import Mapping

import numpy as np

from crashfuse.errors import DataError, Problem, printable
from crashfuse.readers.credibility import is_simulated
from crashfuse.readers.nhtsa_sensors import number_in
from crashfuse.readers.record import RecordedChannel
from crashfuse.readers.tdms_container import TdmsChannel, TdmsFile
from crashfuse.readers.unit_spelling import UNITS, unit_named
from crashfuse.signals.pulse import FloatArray

MOST_CHANNELS = 200
"""Limit of a test's channels that could be its pulse."""

Told = Mapping[str, str | float]
"""The properties of a channel, its group and its file."""


def text_of(said: Told, name: str) -> str:
    """A property as text; empty if there is none."""
    value = said.get(name, "")
    return value.strip() if isinstance(value, str) else f"{value:g}"


def number_of(said: Told, name: str) -> float:
    """A property as a number above 0; otherwise 0."""
    return number_in(said.get(name, 0.0))


def waveform(
    file: TdmsFile,
    channel: TdmsChannel,
    said: Told,
    name: str,
    label: str,
    where: str,
    clock: FloatArray | None = None,
) -> RecordedChannel:
    """A channel with the even time of its own properties, else with this clock.

    Raises
    ------
    DataError
        If it has neither, or no samples.
    """
    increment, start = number_of(said, "wf_increment"), said.get("wf_start_offset", 0.0)
    values = file.values(channel)
    if increment > 0 and isinstance(start, float) and values.size >= 2:
        unit_s = UNITS["time"][unit_named(text_of(said, "wf_xunit_string"), "time") or "s"]
        clock = unit_s * (start + increment * np.arange(values.size))
    if clock is None or clock.size != values.size:
        expected, found = "samples and the time between them (wf_increment)", f"{values.size} samples without it"
        advice = "export it as a waveform, or with a channel of time beside it"
        raise DataError(Problem(f"{where}: {printable(channel.name)}", expected, found, advice))
    unit = unit_named(text_of(said, "unit_string") or text_of(said, "inst_yunits"), "acceleration")
    return RecordedChannel(
        name,
        printable(label),
        clock,
        values,
        unit,
        number_of(said, "inst_prefil") or None,
        origin=_descriptor(said, "data source") or (channel.group if is_simulated(channel.group) else ""),
        status=_descriptor(said, "data status"),
    )


def _descriptor(said: Told, name: str) -> str:
    """A descriptor of ISO-MME, which programs that convert it keep as a property, blanks or not."""
    return text_of(said, name) or text_of(said, name.replace(" ", "_"))
