"""Writer of ISO-MME tests: :mod:`crashfuse.readers.isomme` reads the files back to the same numbers."""

from collections.abc import Iterable, Iterator
from textwrap import wrap

import numpy as np

from crashfuse.readers.isomme_channels import NO_VALUE, Channel, IsommeTest, Pairs

_NAME_WIDTH, _VALUE_WIDTH = 28, 51  # with the colon, the 80 characters allowed in a line


def isomme_files(test: IsommeTest) -> dict[str, bytes]:
    """Write a test as ISO-MME files: content by relative path (with ``/``), in folder order.

    Long comments are split over several lines of at most 80 characters. Samples are written at full precision.
    """
    folder = f"{test.name}/Channel/{test.name}"
    listed = [("Instrumentation standard", ""), ("Number of channels", str(len(test.channels)))]
    channels = {}
    for number, channel in enumerate(test.channels, start=1):
        listed.append((f"Name of channel {number:03d}", f"{channel.code} / {channel.name}"))
        samples = [NO_VALUE if np.isnan(value) else repr(value) for value in channel.values.tolist()]
        channels[f"{folder}.{number:03d}"] = _encoded([*_lines(_channel_header(channel)), *samples])
    return {
        f"{test.name}/{test.name}.mme": _encoded(_lines(test.descriptors)),
        f"{folder}.chn": _encoded(_lines(listed)),
        **channels,
    }


def _channel_header(channel: Channel) -> list[tuple[str, str]]:
    whole = not np.isnan(channel.values).any()
    header = [
        ("Test object number", channel.code[:1]),
        ("Name of the channel", channel.name),
        ("Laboratory channel code", ""),
        ("Customer channel code", ""),
        ("Channel code", channel.code),
        *(("Comments", comment) for comment in channel.comments),
        ("Location", channel.code),
        ("Dimension", channel.code[12:14]),
        ("Direction", channel.code[14:15]),
        ("Channel frequency class", channel.filter_class),
        ("Unit", channel.unit),
        ("Reference system", ""),
        ("Transducer type", ""),
        ("Pre-filter type", ""),
        ("Cut off frequency", ""),
        ("Channel amplitude class", ""),
        ("Bit resolution", ""),
        ("Reference channel", "implicit" if channel.interval_s is not None else ""),
        ("Reference channel name", ""),
        ("Data source", channel.source),
        ("Data status", channel.status or ("ok" if whole else "questionable data")),
        ("Number of samples", str(channel.values.size)),
    ]
    if channel.interval_s is not None:
        header.append(("Sampling interval", repr(channel.interval_s)))
    if channel.start_s is not None:
        header.append(("Time of first sample", repr(channel.start_s)))
    return header


def _lines(descriptors: Pairs) -> Iterator[str]:
    for name, value in descriptors:
        flat = " ".join(value.split())  # a line break in a name would start another descriptor
        for part in (wrap(flat, _VALUE_WIDTH, break_on_hyphens=False) if name == "Comments" else [flat]) or [""]:
            yield f"{name:<{_NAME_WIDTH}}:{part or NO_VALUE}"


def _encoded(lines: Iterable[str]) -> bytes:
    text = "".join(f"{line}\r\n" for line in lines)
    try:
        return text.encode("latin-1")  # the standard's character set
    except UnicodeEncodeError:
        return text.encode("utf-8", "replace")
