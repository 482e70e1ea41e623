"""The rating of ISO/TS 18571 against closed forms, published scores and an independent implementation."""

import csv
import os
import tracemalloc
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from crashfuse.errors import DataError, UsageError
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import Rating, best_shifts, grade, graded, rate_iso18571, rate_many, rate_windows
from tests.conftest import DATA, SHARED, needs_shared

DT_S = 1e-4
SCORES = ("overall", "corridor", "phase", "magnitude", "slope")
OWN = DATA / "iso18571"
FURTHER = SHARED / "vectors" / "iso18571"


def scores(rating: Rating) -> FloatArray:
    """The five numbers of a rating, shape (5,)."""
    return np.array([getattr(rating, name) for name in SCORES])


def table(path: Path) -> dict[str, dict[str, str]]:
    with path.open() as stream:
        return {row["case"]: row for row in csv.DictReader(stream)}


EXPECTED = table(OWN / "expected.csv")
OURS = [case for case in EXPECTED if (OWN / f"{case}.csv").is_file()]
OTHERS = [pytest.param(case, marks=needs_shared) for case in EXPECTED if case not in OURS]


def curves(case: str) -> tuple[FloatArray, FloatArray]:
    folder = OWN if case in OURS else FURTHER
    _, reference, comparison = np.loadtxt(folder / f"{case}.csv", delimiter=",", skiprows=1, unpack=True)
    return reference, comparison


@pytest.mark.parametrize("case", [*OURS, *OTHERS])
def test_vector_scores_agree(case: str) -> None:
    reference, comparison = curves(case)
    expected = [float(EXPECTED[case][name]) for name in SCORES]
    np.testing.assert_allclose(scores(rate_iso18571(reference, comparison, dt_s=DT_S)), expected, rtol=0, atol=1e-9)


def test_annex_of_the_standard() -> None:
    """The 42 cases of ISO/TS 18571:2024 reach their published scores within 0.001."""
    if "CRASHFUSE_ISO18571_ANNEX" not in os.environ:
        pytest.skip(
            "the standard's curves belong to ISO; to run this test, set CRASHFUSE_ISO18571_ANNEX to a folder with "
            "one <case>.csv (time_s, reference, comparison) for each case of tests/data/iso18571/annex_expected.csv"
        )
    folder = Path(os.environ["CRASHFUSE_ISO18571_ANNEX"])
    wrong = {}
    for case, row in table(OWN / "annex_expected.csv").items():
        time_s, reference, comparison = np.loadtxt(folder / f"{case}.csv", delimiter=",", skiprows=1, unpack=True)
        dt_s = (time_s[-1] - time_s[0]) / (time_s.size - 1)
        found = scores(rate_iso18571(reference, comparison, dt_s=dt_s))
        published = [float(value) for name, value in row.items() if name != "case"]
        if np.abs(found - published).max() > 0.001 + 5e-5:  # published with four digits
            wrong[case] = found, published
    assert not wrong


def random_pairs(rng: np.random.Generator, rounds: int, longest: int) -> Iterator[tuple[str, FloatArray, FloatArray]]:
    """Smooth, rough, shifted and tie-rich pairs of 100 samples or more."""

    def smooth(n: int, width: int) -> FloatArray:
        return np.convolve(rng.normal(size=n + width - 1), np.hanning(width + 2)[1:-1], "valid")

    for _ in range(rounds):
        n = int(rng.integers(100, longest))
        x = np.arange(n)
        t = 100 * smooth(n, int(rng.integers(3, 80)))
        c = t + rng.uniform(0, 100) * smooth(n, int(rng.integers(3, 80)))
        period, phase, scale = rng.integers(10, n), rng.uniform(-1, 1), rng.uniform(0.5, 1.5)
        sine, late = np.sin(2 * np.pi * x / period), np.sin(2 * np.pi * x / period + phase)
        yield "smooth", t, c
        yield "shifted", t, np.interp(x + rng.integers(-n // 5 - 5, n // 5 + 5), x, c)
        yield "exactly shifted", t, np.roll(t, rng.integers(-n // 5, n // 5))
        yield "quantised", np.round(t / 20) * 20, np.round(c / 20) * 20
        yield "sinusoids", sine, scale * late
        yield "proportional sinusoids", sine, scale * sine
        yield "quantised sinusoids", np.round(8 * sine), np.round(8 * late)
        yield "square waves", np.sign(sine + 1e-9), 0.9 * np.sign(late + 1e-9)
        yield "proportional, any sign", t, rng.uniform(-2, 2) * t
        yield "flat in part", np.where(x < n // 2, 0, t), np.where(x > n // 3, 0, c)
        yield "large offset", 1e-6 * t + 1000, 1e-6 * c + 1000
        yield "zero comparison", t, np.zeros(n)


@pytest.mark.slow  # to import and compile the other one takes most of it
def test_independent_implementation_agrees() -> None:
    """Random pairs, rich in ties or not, score as the public package objective-rating-metrics scores them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its own, and those of what it imports
        from objective_rating_metrics.rating import ISO18571

        for name, t, c in random_pairs(np.random.default_rng(18571), rounds=6, longest=500):
            time_s = np.arange(t.size) * DT_S
            oracle = ISO18571(np.column_stack([time_s, t]), np.column_stack([time_s, c]), dt=DT_S)
            found = rate_iso18571(t, c, dt_s=DT_S)
            for score in SCORES:
                expected = getattr(oracle, f"{score}_rating")(-1)
                assert getattr(found, score) == pytest.approx(expected, rel=0, abs=1e-9), (name, score)


def bell(centre: float, n: int = 600) -> FloatArray:
    """A pulse that is practically zero 200 samples from its centre, shape (n,)."""
    return -np.exp(-(((np.arange(n) - centre) / 30) ** 2))


def test_identical_curves_score_exactly_one() -> None:
    """A curve against itself is 1 in every score to the bit, even where later shifts fit it just as well."""
    rng = np.random.default_rng(0)
    for curve in (bell(250), rng.normal(size=317), *(np.sin(2 * np.pi / p * np.arange(263)) for p in range(5, 50))):
        assert rate_iso18571(curve, curve, dt_s=DT_S) == Rating(1.0, 1.0, 1.0, 1.0, 1.0, "Excellent")


@pytest.mark.parametrize("shift", [-120, -119, -60, -1, 1, 17, 120])
def test_pure_shift_loses_phase_alone(shift: int) -> None:
    """A curve that comes m of N samples late or early has phase (0.2 N − m)/(0.2 N); shape scores stay 1."""
    rating = rate_iso18571(bell(300), bell(300 + shift), dt_s=DT_S)
    assert rating.phase == pytest.approx(1 - abs(shift) / 120, abs=1e-12)
    assert (rating.magnitude, rating.slope) == pytest.approx((1, 1), abs=1e-3)


def test_equal_fit_prefers_the_left_shift() -> None:
    """Two shifts, left and right, that fit equally well: the slope is that of the curve moved left; else the better."""
    reference, comparison = np.zeros(261), np.zeros(261)  # overlaps of 256: correlations are equal to the last bit
    reference[130] = 1
    comparison[[125, 135]] = 1  # either may meet the reference's spike, 5 samples off
    comparison[[4, 260]] = 1 / 16  # either move cuts one of these off; only a move to the left leaves one on the end
    spike, spike_on_the_end = 2 / 9, 1 + 1 / 2 + 3 / 10 + 3 / 14 + 1 / 6 + 1 / 18  # sums of the smoothed slopes
    rating = rate_iso18571(reference, comparison, dt_s=DT_S)
    assert rating.phase == pytest.approx(1 - 5 / (0.2 * 261))
    assert rating.slope == pytest.approx(1 - (spike + spike_on_the_end / 16) / spike / 2)
    for higher, shift in ((125, -5), (135, 5)):  # by too little for a Fourier transform
        assert best_shifts(reference, (comparison + 1e-12 * (np.arange(261) == higher))[None]).tolist() == [shift]


def test_a_shift_is_found_where_others_leave_a_flat_overlap() -> None:
    """A spike near the start is cut off by shifts to the right of more than 20 samples: nothing correlates there."""
    reference, comparison = np.zeros((2, 300))
    reference[20], comparison[35] = 1, 1
    rating = rate_iso18571(reference, comparison, dt_s=DT_S)
    assert (rating.phase, rating.magnitude, rating.slope) == pytest.approx((1 - 15 / 60, 1, 1))


@pytest.mark.parametrize(("overall", "name"), [(1, "Excellent"), (0.9401, "Excellent"), (0.94, "Good"), (0.80, "Fair")])
def test_grades_need_more_than_their_limit(overall: float, name: str) -> None:
    assert grade(overall) == name
    assert (grade(0.5801), grade(0.58), grade(0)) == ("Fair", "Poor", "Poor")


def test_a_rating_beside_a_limit_is_told_with_the_digit_that_decides() -> None:
    """Two cells of 0.800, one Good and one Fair, would contradict each other."""
    shown = [graded(overall) for overall in (0.800439, 0.799906, 0.80, 0.8712)]
    assert shown == ["0.8004 Good", "0.800 Fair", "0.800 Fair", "0.871 Good"]


def test_unit_does_not_matter() -> None:
    """In g, in m/s² and in units a trillion times smaller, the scores are the same."""
    t, c = np.cumsum(np.random.default_rng(1).normal(size=(2, 400)), axis=1)
    in_g = scores(rate_iso18571(t, c, dt_s=DT_S))
    for unit in (9.80665, 1e12):
        np.testing.assert_allclose(scores(rate_iso18571(unit * t, unit * c, dt_s=DT_S)), in_g, atol=1e-9)


@pytest.mark.parametrize("rate_hz", [2500, 12_500, 20_000])
def test_other_sampling_rates_are_interpolated(rate_hz: int) -> None:
    """Polygons with corners every 2 ms are the same curves at any of these rates, and rate the same over 60 ms."""
    corners_s = np.arange(0, 0.063, 0.002)
    levels = np.random.default_rng(2).normal(size=(2, corners_s.size))
    levels[:, -2:] = levels[:, [-3]]  # flat at the end, where a coarse record has no next sample to interpolate to

    def rated(hz: int) -> Rating:
        time_s = np.arange(round(0.06 * hz)) / hz
        return rate_iso18571(*(np.interp(time_s, corners_s, level) for level in levels), dt_s=1 / hz)

    np.testing.assert_allclose(scores(rated(rate_hz)), scores(rated(10_000)), atol=1e-6)


def test_windows_cut_both_pulses_on_a_common_grid() -> None:
    """Pulses on different grids rate as their interpolations to 10 kHz, cut to 10 samples a millisecond."""
    time_s = np.arange(-100, 2000) / 20_000
    reference = Pulse(GRID_S, -300 * np.sin(np.pi * GRID_S / 0.09))
    comparison = Pulse(time_s, -280 * np.sin(np.pi * (time_s - 0.002) / 0.085))
    ratings = rate_windows(reference, comparison, [20, 62.5])
    assert list(ratings) == [20.0, 62.5]
    for window_ms, rating in ratings.items():
        grid_s = np.arange(round(10 * window_ms)) * DT_S
        curves = [np.interp(grid_s, pulse.time_s, pulse.accel_mps2) for pulse in (reference, comparison)]
        assert rating == rate_iso18571(*curves, dt_s=DT_S)


def test_arrays_and_pulses_rate_alike_over_a_window() -> None:
    """A window cuts arrays as it cuts pulses, which are rated over 60 ms unless another is asked for."""
    reference, comparison = bell(250, 700), 0.8 * bell(262, 700)
    pulses = [Pulse(np.arange(700) * DT_S, curve) for curve in (reference, comparison)]
    for window_ms, n in ((None, 600), (60.0, 600), (40.0, 400)):
        rating = rate_iso18571(reference[:n], comparison[:n], dt_s=DT_S)
        assert rate_iso18571(pulses[0], pulses[1], window_ms) == rating
        assert rate_iso18571(reference, comparison, dt_s=DT_S, window_ms=n / 10) == rating
    with pytest.raises(UsageError, match="dt_s"):
        rate_iso18571(pulses[0], comparison, dt_s=DT_S)
    with pytest.raises(UsageError, match="dt_s"):
        rate_iso18571(reference, comparison)
    with pytest.raises(UsageError, match=r"in ms: 20, not 0\.02"):
        rate_windows(pulses[0], pulses[1], [20])[0.02]


def test_many_curves_rate_as_one_by_one() -> None:
    rng = np.random.default_rng(3)
    reference = bell(250) + 0.3 * bell(420)
    comparisons = np.array([bell(250 + rng.normal() * 20) + rng.normal() * bell(400) for _ in range(40)])
    comparisons[7], comparisons[8] = reference, 0
    for rating, comparison in zip(rate_many(reference, comparisons, dt_s=DT_S), comparisons, strict=True):
        np.testing.assert_allclose(scores(rating), scores(rate_iso18571(reference, comparison, dt_s=DT_S)), atol=1e-12)
    assert rate_many(reference, comparisons[:0], dt_s=DT_S) == []


@pytest.mark.slow
def test_memory_of_a_batch_is_bounded() -> None:
    """250 curves that share one shift would take 140 MB to warp at once; blocks keep it under 100 MB."""
    comparisons = bell(250) * np.linspace(0.8, 1.2, 250)[:, None]
    tracemalloc.start()
    try:
        rate_many(bell(250), comparisons, dt_s=DT_S)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 100e6


@pytest.mark.parametrize("level", [0.0, 0.1, -3.0])
def test_flat_comparison_is_poor_and_well_defined(level: float) -> None:
    """A prediction that never moves correlates with nothing: no shift, half the slope, no magnitude, never NaN."""
    rating = rate_iso18571(bell(250), np.full(600, level), dt_s=DT_S)
    assert np.isfinite(scores(rating)).all()
    assert (rating.phase, rating.magnitude, rating.slope) == (1, 0, 0.5)


def nan_at(index: int) -> FloatArray:
    curve = bell(250).copy()
    curve[index] = np.nan
    return curve


@pytest.mark.parametrize(
    ("rate", "message"),
    [
        (lambda: rate_iso18571(np.zeros(600), bell(250), dt_s=DT_S), "reference: .* a curve that varies, found 0"),
        (lambda: rate_iso18571(np.full(600, -5.0), bell(250), dt_s=DT_S), "reference: .* found -5 throughout"),
        (lambda: rate_iso18571(nan_at(3), bell(250), dt_s=DT_S), "reference: .* found nan at sample 3"),
        (lambda: rate_iso18571(bell(250), nan_at(599), dt_s=DT_S), "comparison: .* found nan at sample 599"),
        (lambda: rate_many(bell(250), np.array([bell(9), nan_at(1)]), dt_s=DT_S), "comparison: .* nan at sample 1"),
        (lambda: rate_iso18571(bell(250), 1e200 * bell(250), dt_s=DT_S), "expected finite numbers, found -"),
        (lambda: rate_iso18571(bell(20, 99), bell(20, 99), dt_s=DT_S), "window: expected at least 10 ms, found 9.9 ms"),
        (lambda: rate_iso18571(bell(250), bell(250), dt_s=0.0), "dt_s: expected a time step above 0, in s, found 0"),
        (lambda: rate_iso18571(bell(250), bell(250), dt_s=0.08), "dt_s: .* found 0.08, .* 0.08 ms are 8e-05 s"),
        (lambda: rate_iso18571(bell(250), bell(250), dt_s=DT_S, window_ms=80), "reference: .* 0–80 ms, found 0–60 ms"),
        (lambda: rate_iso18571(bell(250), bell(250, 599), dt_s=DT_S), "comparison: .* 600 samples, found 599"),
        (lambda: rate_iso18571(bell(250), np.ones((2, 600)), dt_s=DT_S), "comparison: .* found 2 × 600"),
        (lambda: rate_iso18571(np.array(1.0), np.array(1.0), dt_s=DT_S), "reference: .* found a single number"),
        (lambda: windows(120), "reference: expected a record over 0–120 ms, found 0–100 ms"),
        (lambda: windows(60, begin_s=0.01), "comparison: expected a record over 0–60 ms, found 10–110 ms"),
        (lambda: windows(5), "window: expected at least 10 ms, found 5 ms"),
    ],
)
def test_what_cannot_be_rated_is_refused_in_one_sentence(rate: Callable[[], object], message: str) -> None:
    """Flat references, holes, short windows, unequal lengths and windows beyond the record say what is wrong."""
    with pytest.raises(DataError, match=message) as caught:
        rate()
    assert len(caught.value.problems) == 1
    assert "\n" not in str(caught.value)


def windows(window_ms: float, begin_s: float = 0.0) -> object:
    """Rate two pulses of 100 ms, of which the second begins later."""
    return rate_windows(Pulse(GRID_S, np.sin(60 * GRID_S)), Pulse(GRID_S + begin_s, np.sin(60 * GRID_S)), [window_ms])
