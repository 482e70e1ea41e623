"""A predicted pulse as an ISO-MME test, whose header states that it is not a measurement."""

from collections.abc import Sequence

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.readers.isomme_channels import Channel, IsommeTest
from crashfuse.reporting.isomme_writer import isomme_files
from crashfuse.signals.pulse import DT_S, FloatArray, kinematics
from crashfuse.version import __version__

_FILTER_LETTERS = {1000.0: "A", 600.0: "B", 180.0: "C", 60.0: "D"}
_SPECIAL = "S"  # ISO-MME code, explained in the channel's header


def isomme_pulse(
    campaign: Campaign,
    condition: Condition,
    accel_mps2: FloatArray,
    name: str,
    location: str,
    comments: Sequence[str],
) -> dict[str, bytes]:
    """One pulse as an ISO-MME test of three channels at a location: AC, VE and DV in X.

    Velocity and displacement are integrated from the acceleration. The filter class, in the code and in the header, is
    that of the campaign's records (D: CFC 60); the code ends in S if they were used as they are. Codes: ISO/TS 13499,
    see :mod:`crashfuse.readers.isomme`.

    Parameters
    ----------
    name : str
        Name of the test, its folder and its files.
    location : str
        The first 12 characters of the channel codes.
    comments : sequence of str
        What the headers of the test and of each channel say about it.

    Returns
    -------
    dict of str to bytes
        Content by relative path, below a folder with the test's name.
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
    channels = tuple(
        Channel(
            f"{location}{dimension}X{letter}",
            f"{name}: {signal}",
            unit,
            values,
            DT_S,
            comments=(*own, *comments),
            source="simulation",
            filter_class="" if cfc is None else f"{cfc:g}",
        )
        for dimension, signal, unit, values, own in signals
    )
    return isomme_files(IsommeTest(name, descriptors, channels))
