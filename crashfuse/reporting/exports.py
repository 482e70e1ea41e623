"""Predicted pulses in formats for other programs: Parquet, and ISO-MME for an occupant model."""

import io
from collections.abc import Sequence

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.errors import UsageError
from crashfuse.readers.isomme_channels import Channel, IsommeTest
from crashfuse.reporting.isomme_writer import isomme_files
from crashfuse.signals.pulse import DT_S, FloatArray, kinematics
from crashfuse.study.estimate import Estimate
from crashfuse.version import __version__

_FILTER_LETTERS = {1000.0: "A", 600.0: "B", 180.0: "C", 60.0: "D"}
_SPECIAL = "S"  # ISO-MME code, explained in the channel's header
_BOUNDS = (("lower", "01"), ("upper", "02"))


def parquet_bytes(table: pd.DataFrame) -> bytes:
    """Return a table as a Parquet file: float64 at full precision, text as dictionaries, empty cells as nulls."""
    arrow = pa.Table.from_pandas(table, preserve_index=False).replace_schema_metadata(None)
    for at, field in enumerate(arrow.schema):
        if pa.types.is_string(field.type) or pa.types.is_large_string(field.type):
            arrow = arrow.set_column(at, field.name, arrow.column(at).cast(pa.string()).dictionary_encode())
    stream = io.BytesIO()
    pq.write_table(arrow, stream, compression="zstd")
    return stream.getvalue()


def isomme_prediction(campaign: Campaign, estimates: Sequence[Estimate], name: str = "prediction") -> dict[str, bytes]:
    """The prediction at one condition as an ISO-MME test, whose header states that it is not a measurement.

    Holds the vehicle's X channels of each approach: acceleration (``AC``), bounds of its central 95 % interval if it
    has any, and velocity (``VA``) and displacement (``DV``) integrated from the acceleration. In a code such as
    ``10VEHC000201ACXD`` the second fine location numbers the approaches in order, the third is 00 for the pulse,
    01 for the lower and 02 for the upper bound; the channel's name and comments say so too. The filter class is that
    of the campaign's records (D: CFC 60), or S if they were used as they are. Codes: ISO/TS 13499, see
    :mod:`crashfuse.readers.isomme`.

    Returns
    -------
    dict of str to bytes
        Content by relative path, below a folder with the test's name.

    Raises
    ------
    UsageError
        If there is no estimate, or they are at different conditions.
    """
    conditions = {estimate.prediction.condition for estimate in estimates}
    if len(conditions) != 1:
        raise UsageError(f"An ISO-MME test has one condition, not {len(conditions)}.")
    condition = conditions.pop()
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
        (
            "Comments",
            f"Predicted by crashfuse {__version__} from the campaign {campaign.name}, its CAE runs and tests.",
        ),
        ("Comments", campaign.notice),
        ("Comments", "SHA-256 of the campaign, in two parts:"),
        ("Comments", campaign.fingerprint[:32]),
        ("Comments", campaign.fingerprint[32:]),
        ("Comments", f"Approaches: {', '.join(estimate.approach for estimate in estimates)}."),
        ("Comments", f"Condition: {condition}."),
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
    channels = [
        channel for number, one in enumerate(estimates, start=1) for channel in _channels(number, one, campaign)
    ]
    kept = [(key, value) for key, value in descriptors if value or key != "Comments"]
    return isomme_files(IsommeTest(name, kept, tuple(channels)))


def _channels(number: int, estimate: Estimate, campaign: Campaign) -> list[Channel]:
    """The channels of the approach with this number in the list."""
    prediction, label = estimate.prediction, LABELS[estimate.approach]
    pulse = np.asarray(prediction.accel_mps2, dtype=np.float64)
    motion = kinematics(pulse, prediction.condition.speed_mps, DT_S)
    cfc = campaign.channel_filter_class
    letter = _FILTER_LETTERS.get(cfc or 0.0, _SPECIAL)
    records = "taken as they are" if cfc is None else f"filtered with CFC {cfc:g}"
    comments = (
        f"Predicted by the approach {estimate.approach}, not measured.",
        f"From records {records}, and as band-limited as these.",
        *prediction.notes,
    )

    def channel(code: str, name: str, unit: str, values: FloatArray, comment: str = "") -> Channel:
        whole_code = f"10VEHC00{number:02d}{code}X{letter}"
        said = (comment, *comments) if comment else comments
        return Channel(whole_code, f"{label}: {name}", unit, values, DT_S, comments=said, source="simulation")

    bound = "bound of the central 95 % interval at each time by itself: not a pulse that may occur."
    return [
        channel("00AC", "acceleration X", "m/(s*s)", pulse),
        *(
            channel(f"{part}AC", f"{side} 95 % bound", "m/(s*s)", values, f"The {side} {bound}")
            for (side, part), values in zip(_BOUNDS, prediction.band() or (), strict=False)
        ),
        channel("00VA", "velocity X", "m/s", motion.velocity_mps, "Integrated from the acceleration."),
        channel("00DV", "displacement X", "m", motion.displacement_m, "Integrated from the velocity."),
    ]
