"""What goes on to other programs: nothing is lost, and a prediction says that it is one."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import UsageError
from crashfuse.readers.isomme import read_isomme
from crashfuse.readers.isomme_channels import Channel
from crashfuse.reporting.exports import isomme_prediction, parquet_bytes
from crashfuse.reporting.result_tables import pulses_table
from crashfuse.signals.pulse import GRID_S
from crashfuse.study.estimate import Estimate

SPEED_MPS, T0_S = 15.0, 0.06
CONDITION = Condition(SPEED_MPS, 950.0, 700.5)


@pytest.fixture
def estimates() -> list[Estimate]:
    """Two approaches at one condition, one with draws: a constant deceleration that stops the vehicle at t0."""
    pulse = np.where(GRID_S <= T0_S, -SPEED_MPS / T0_S, 0.0)
    draws = pulse + np.linspace(-30, 30, 201)[:, None]
    note = "Extrapolation: the front weight 2237 lb lies outside the CAE runs' 1922–2185 lb."
    return [
        Estimate("cae", Prediction(CONDITION, pulse * 1.1), {}, 0.1),
        Estimate("displacement_domain", Prediction(CONDITION, pulse, draws, (note,)), {}, 0.2),
    ]


def channels_of(files: dict[str, bytes], folder: Path) -> dict[str, Channel]:
    """The channels of a written test, by code."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    read = read_isomme(folder / "prediction").channels
    found = {channel.code: channel for channel in read}
    assert len(found) == len(read), "each code once"
    return found


def test_parquet_keeps_every_digit_and_every_empty_cell(estimates: list[Estimate]) -> None:
    """Columns, order, floats to the bit and missing bands come back; text is kept as dictionaries."""
    table = pulses_table([("", estimate) for estimate in estimates])
    content = parquet_bytes(table)
    again = pd.read_parquet(io.BytesIO(content)).astype({"held_out": "str", "approach": "str"})
    pd.testing.assert_frame_equal(again, table.reset_index(drop=True), check_exact=True)
    arrow = pq.read_table(io.BytesIO(content))
    assert {str(field.type) for field in arrow.schema if field.name not in ("held_out", "approach")} == {"double"}
    assert all(pa.types.is_dictionary(arrow.schema.field(name).type) for name in ("held_out", "approach"))
    assert arrow.column("lower_g").null_count == GRID_S.size
    assert pq.ParquetFile(io.BytesIO(content)).metadata.row_group(0).column(2).compression == "ZSTD"


def test_a_predicted_pulse_goes_out_as_iso_mme(campaign: Campaign, estimates: list[Estimate], tmp_path: Path) -> None:
    """Each approach has its acceleration, its bounds where it has draws, and what follows by integration."""
    found = channels_of(isomme_prediction(campaign, estimates), tmp_path)
    assert {code: channel.unit for code, channel in found.items()} == {
        "10VEHC000100ACXS": "m/(s*s)",
        "10VEHC000100VAXS": "m/s",
        "10VEHC000100DVXS": "m",
        "10VEHC000200ACXS": "m/(s*s)",
        "10VEHC000201ACXS": "m/(s*s)",
        "10VEHC000202ACXS": "m/(s*s)",
        "10VEHC000200VAXS": "m/s",
        "10VEHC000200DVXS": "m",
    }
    for channel in found.values():
        assert (channel.start_s, channel.interval_s, channel.values.size) == (0.0, 1 / 12_500, 1250)
    prediction = estimates[1].prediction
    np.testing.assert_array_equal(found["10VEHC000200ACXS"].values, prediction.accel_mps2)
    lower, upper = (found[f"10VEHC00020{n}ACXS"].values for n in (1, 2))
    np.testing.assert_allclose(upper - lower, 0.95 * 60)
    np.testing.assert_allclose((upper + lower) / 2, prediction.accel_mps2)
    velocity, displacement = found["10VEHC000200VAXS"].values, found["10VEHC000200DVXS"].values
    assert velocity[0] == SPEED_MPS
    assert velocity[GRID_S > T0_S + 1e-4] == pytest.approx(0.0, abs=0.02)
    assert displacement.max() == pytest.approx(SPEED_MPS * T0_S / 2, rel=1e-3)


def test_the_files_say_that_nothing_was_measured(campaign: Campaign, estimates: list[Estimate], tmp_path: Path) -> None:
    """Header and channels name crashfuse, campaign, fingerprint, approach and notes; speed in m/s, masses in kg."""
    named = replace(campaign, name="Tiny\nDate of the test :2024-01-01", channel_filter_class=60.0)
    channels = channels_of(isomme_prediction(named, estimates), tmp_path)
    test = read_isomme(tmp_path / "prediction")
    comments = [value for name, value in test.descriptors if name == "Comments"]
    assert test.descriptor("Subtype of the test") == "Prediction, no vehicle was crashed"
    assert test.descriptor("Date of the test") is None
    assert campaign.fingerprint in "".join(comments)
    assert "Approaches: cae, displacement_domain." in " ".join(comments)
    assert test.descriptor("Velocity test object 1") == "15"
    assert test.descriptor("Mass test object 1") == "1650.5"
    assert test.descriptor(".Rear weight test object 1") == "700.5"
    for channel in channels.values():
        assert channel.source == "simulation"
        assert "not measured" in " ".join(channel.comments)
        assert channel.code[-1] == "D", "filtered with CFC 60"
    assert "Extrapolation: the front weight 2237 lb" in " ".join(channels["10VEHC000200ACXD"].comments)
    assert "not a pulse that may occur" in " ".join(channels["10VEHC000202ACXD"].comments)


def test_one_folder_holds_one_condition(campaign: Campaign, estimates: list[Estimate]) -> None:
    """Predictions at two conditions, or none at all, make no test."""
    other = replace(estimates[0], prediction=Prediction(replace(CONDITION, speed_mps=10.0), GRID_S))
    for wrong in ([], [*estimates, other]):
        with pytest.raises(UsageError, match="one condition"):
            isomme_prediction(campaign, wrong)
