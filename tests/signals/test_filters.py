"""The CFC filter against its closed-form gain, published vectors and a real record."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from crashfuse.errors import CrashfuseError, DataError, UsageError
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import FloatArray
from tests.conftest import DATA, SHARED, needs_shared

OWN = DATA / "cfc"
FURTHER = SHARED / "vectors" / "cfc"
VECTORS = [
    OWN / "synth_12p5kHz.csv",
    pytest.param(FURTHER / "cfc_vectors_synth_12p5kHz.csv", marks=needs_shared),
    pytest.param(FURTHER / "cfc_vectors_nhtsa10146_ch093_10kHz.csv", marks=needs_shared),
]
CLASSES = (60, 180, 600, 1000)
SETTLED_S = {60: 0.025, 180: 0.010, 600: 0.003, 1000: 0.003}  # how far the choice of padding reaches into a record


@pytest.mark.parametrize("cfc", CLASSES)
@pytest.mark.parametrize("path", VECTORS, ids=lambda path: path.stem)
def test_vectors_agree(path: Path, cfc: int) -> None:
    """Away from the ends, where padding decides, outputs equal the SAE J211-1 vectors to 1e-6 g."""
    table = np.genfromtxt(path, delimiter=",", names=True)
    dt_s = (table["t_s"][-1] - table["t_s"][0]) / (table.size - 1)
    found = cfc_filter(table["raw_g"], cfc=cfc, dt_s=dt_s)
    inside = slice(round(SETTLED_S[cfc] / dt_s), -round(SETTLED_S[cfc] / dt_s))
    np.testing.assert_allclose(found[inside], table[f"cfc{cfc}_saeJ211_filtfilt"][inside], rtol=0, atol=1e-6)


@pytest.mark.parametrize("cfc", CLASSES)
@pytest.mark.parametrize("share", [0.25, 1.0, 2.0])
def test_gain_of_a_sinusoid_is_the_butterworth_gain_squared(cfc: int, share: float) -> None:
    """A sinusoid at frequency f leaves with gain 1/(1 + r⁴), r = tan(π f/fs)/tan(π 2.0775 CFC/fs), and no delay."""
    dt_s = 2e-5
    frequency = share * 2.0775 * cfc
    signal = np.sin(2 * np.pi * frequency * np.arange(0, 0.5, dt_s))
    ratio = np.tan(np.pi * frequency * dt_s) / np.tan(np.pi * 2.0775 * cfc * dt_s)
    middle = slice(10_000, 15_000)
    found = cfc_filter(signal, cfc=cfc, dt_s=dt_s)[middle]
    np.testing.assert_allclose(found, signal[middle] / (1 + ratio**4), atol=1e-9)


def test_constant_and_ramp_pass_unchanged_to_the_ends() -> None:
    """What does not curve is not filtered: a constant and a ramp come out as they went in."""
    ramp = np.linspace(-3, 5, 1250)
    np.testing.assert_allclose(cfc_filter(np.full(1250, -9.8), cfc=60, dt_s=8e-5), -9.8, rtol=1e-9)
    np.testing.assert_allclose(cfc_filter(ramp, cfc=180, dt_s=8e-5), ramp, atol=1e-9)


def test_each_row_of_a_batch_is_filtered_as_if_alone() -> None:
    signals = np.random.default_rng(1).normal(size=(2, 3, 1250)).astype(np.float32)
    batch = cfc_filter(signals, cfc=60, dt_s=8e-5)
    assert batch.shape == (2, 3, 1250)
    np.testing.assert_array_equal(batch[1, 2], cfc_filter(signals[1, 2].astype(float), cfc=60, dt_s=8e-5))


def with_hole() -> FloatArray:
    record = np.zeros(1000)
    record[7] = np.nan
    return record


@pytest.mark.parametrize(
    ("apply", "error", "message"),
    [
        (lambda: cfc_filter(np.zeros(9999), cfc=1000, dt_s=1.1e-4), DataError, "at least 10000 samples a second"),
        (lambda: cfc_filter(np.zeros(100), cfc=60, dt_s=1e-4), DataError, "a record longer than 10 ms, found 10 ms"),
        (lambda: cfc_filter(with_hole(), cfc=60, dt_s=1e-4), DataError, "finite numbers, found NaN or infinity"),
        (lambda: cfc_filter(np.zeros(1000), cfc=0, dt_s=1e-4), UsageError, "no channel filter class 0"),
    ],
)
def test_what_cannot_be_filtered_is_refused_in_one_sentence(
    apply: Callable[[], object], error: type[CrashfuseError], message: str
) -> None:
    with pytest.raises(error, match=message) as caught:
        apply()
    assert "\n" not in str(caught.value)
    cfc_filter(np.zeros(1000), cfc=1000, dt_s=1e-4)  # ten samples a second per unit of class are enough
