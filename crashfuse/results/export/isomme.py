"""Writer of ISO-MME tests: :mod:`crashfuse.readers.isomme` reads the files back to the same numbers."""

from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from textwrap import wrap

import numpy as np

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.readers.isomme import NO_VALUE, Channel, IsommeTest, Pairs
from crashfuse.signals.pulse import DT_S, FloatArray, kinematics
from crashfuse.version import __version__

_NAME_WIDTH, _VALUE_WIDTH = 28, 51  # with the colon, the 80 characters allowed in a line


def isomme_files(test: IsommeTest) -> dict[str, bytes]:
    """Write a test as ISO-MME files at full precision: content by relative path, in folder order."""
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
        *((name, "") for name in ("Laboratory channel code", "Customer channel code")),
        ("Channel code", channel.code),
        *(("Comments", comment) for comment in channel.comments),
        ("Location", channel.code),
        ("Dimension", channel.code[12:14]),
        ("Direction", channel.code[14:15]),
        ("Channel frequency class", channel.filter_class),
        ("Unit", channel.unit),
        *((name, "") for name in ("Reference system", "Transducer type", "Pre-filter type", "Cut off frequency")),
        *((name, "") for name in ("Channel amplitude class", "Bit resolution")),
        ("Reference channel", "implicit" if channel.interval_s is not None else ""),
        ("Reference channel name", ""),
        ("Data source", channel.source),
        ("Data status", channel.status or ("ok" if whole else "questionable data")),
        ("Number of samples", str(channel.values.size)),
    ]
    times = {"Sampling interval": channel.interval_s, "Time of first sample": channel.start_s}
    return [*header, *((name, repr(time_s)) for name, time_s in times.items() if time_s is not None)]


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


_FILTER_LETTERS = {1000.0: "A", 600.0: "B", 180.0: "C", 60.0: "D"}
_SPECIAL = "S"  # ISO-MME code, explained in the channel's header


def isomme_pulse(
    campaign: Campaign,
    condition: Condition,
    accel_mps2: FloatArray,
    name: str,
    location: str,
    comments: Sequence[str],
    *,
    moves: bool = True,
) -> dict[str, bytes]:
    """One pulse as an ISO-MME test: channels AC, and VE and DV if it ``moves``, in X; content by relative path.

    The filter class is that of the campaign's records (D: CFC 60; S if used as they are). Codes: ISO/TS 13499.
    """
    descriptors = [
        ("Data format edition number", "1.6"),
        ("Laboratory name", f"none: predicted by crashfuse {__version__}"),
        ("Laboratory test ref. number", name),
        ("Customer name", ""),
        ("Title", f"Prediction for {campaign.name}"),
        ("Medium No./number of media", "1/1"),
        ("Timestamp", ""),
        ("Type of the test", "Full frontal barrier"),
        ("Subtype of the test", "Prediction, no vehicle was crashed"),
        ("Regulation", ""),
        ("Date of the test", ""),
        *(("Comments", comment) for comment in comments),
        ("Number of test objects", "1"),
        ("Name of test object 1", campaign.name),
        ("Velocity test object 1", f"{condition.speed_mps:.6g}"),
        ("Mass test object 1", f"{condition.mass_kg:.6g}"),
        ("Driver position object 1", ""),
        ("Impact side test object 1", "FR"),
        ("Type of test object 1", ""),
        (".Front weight test object 1", f"{condition.front_weight_kg:.6g}"),
        (".Rear weight test object 1", f"{condition.rear_weight_kg:.6g}"),
    ]
    cfc = campaign.channel_filter_class
    motion = kinematics(accel_mps2, condition.speed_mps, DT_S)
    signals = (
        ("AC", "acceleration X", "m/(s*s)", accel_mps2, ()),
        ("VE", "velocity X", "m/s", motion.velocity_mps, ("Integrated from the acceleration.",)),
        ("DV", "displacement X", "m", motion.displacement_m, ("Integrated from the velocity.",)),
    )
    letter = _FILTER_LETTERS.get(cfc or 0.0, _SPECIAL)
    predicted = partial(Channel, source="simulation", filter_class="" if cfc is None else f"{cfc:g}")
    channels = tuple(
        predicted(
            f"{location}{dimension}X{letter}", f"{name}: {signal}", unit, values, DT_S, comments=(*own, *comments)
        )
        for dimension, signal, unit, values, own in signals[: 3 if moves else 1]
    )
    return isomme_files(IsommeTest(name, descriptors, channels))
