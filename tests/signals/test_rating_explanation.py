"""What a rating is made of, against pulses of known shift, scale and excursion, and against the rating itself."""

import numpy as np
import pytest

from crashfuse.signals.pulse import FloatArray, Pulse
from crashfuse.signals.rating import MAX_SHIFT, RATING_DT_S, corridor_values, rate_windows
from crashfuse.signals.rating_explanation import counterparts, explain_rating, humps, rating_sentences
from crashfuse.units import G, UnitSystem
from tests.golden import assert_golden
from tests.signals.test_rating import random_pairs

TIME_S = np.arange(1000) * RATING_DT_S
STEP_S = RATING_DT_S


def pulse(values: FloatArray) -> Pulse:
    """A pulse of 100 ms at the rate of the rating."""
    return Pulse(TIME_S, values)


def bump(centre_ms: float, height: float, width_ms: float = 5.0) -> FloatArray:
    curve: FloatArray = -height * np.exp(-0.5 * ((TIME_S * 1e3 - centre_ms) / width_ms) ** 2)
    return curve


TEST = bump(15, 200) + bump(33, 250) + bump(50, 220)
"""Three humps; between them the test almost lets go."""


@pytest.mark.parametrize("late_ms", [3.0, -3.0])
def test_a_pulse_shifted_by_3_ms_is_3_ms_late_or_early(late_ms: float) -> None:
    found = explain_rating(pulse(TEST), pulse(np.interp(TIME_S - late_ms / 1e3, TIME_S, TEST)), 70.0)
    assert found.shift_s == pytest.approx(late_ms / 1e3)
    assert not found.at_limit
    assert found.rating.phase == pytest.approx(1 - 3 / 14)
    assert [hump.late_s for hump in found.humps] == pytest.approx([late_ms / 1e3] * 3)
    np.testing.assert_allclose(found.shifted.comparison, found.shifted.reference, atol=1e-9)
    assert found.rating.magnitude == pytest.approx(1)


def test_only_the_hump_that_comes_late_is_late_and_gains_by_the_shift() -> None:
    """The third of three comes 4 ms late; a shift towards it costs correlation at the others."""
    found = explain_rating(pulse(TEST), pulse(bump(15, 200) + bump(33, 250) + bump(54, 220)), 70.0)
    assert [hump.late_s for hump in found.humps] == pytest.approx([0, 0, 4e-3], abs=2e-4)
    assert found.shift_s > 0
    assert max(found.humps, key=lambda hump: hump.shift_gain) is found.humps[2]


def test_a_hump_that_the_comparison_lacks_has_no_counterpart() -> None:
    found = explain_rating(pulse(TEST), pulse(bump(15, 200) + bump(33, 250)), 70.0)
    assert [hump.counterpart_s is None for hump in found.humps] == [False, False, True]
    worst = max(found.humps, key=lambda hump: hump.magnitude_share)
    assert worst is found.humps[2]
    assert worst.difference_mps2 < 0


def test_a_scaled_pulse_loses_magnitude_by_its_factor_and_no_phase() -> None:
    """A sine 10 % too strong: the standard's relative errors are 0.1 where warping cannot help, at most."""
    found = explain_rating(pulse(TEST), pulse(1.1 * TEST), 70.0)
    assert found.shift_s == 0
    assert found.slopes.error == pytest.approx(0.1)
    assert 0 < found.warped.error <= 0.1 + 1e-12
    assert all(hump.difference_mps2 > 0 for hump in found.humps)


def test_leaving_the_corridor_in_a_known_interval_is_told_with_what_it_costs() -> None:
    """20 to 25 ms off by 40 % of the largest value, 40 to 42 ms by 60 %: a parabola there, nothing here."""
    largest = np.abs(TEST[:700]).max()
    off = np.where((TIME_S >= 0.0199999) & (TIME_S < 0.0249999), 0.4 * largest, 0.0)
    off -= np.where((TIME_S >= 0.0399999) & (TIME_S < 0.0419999), 0.6 * largest, 0.0)
    found = explain_rating(pulse(TEST), pulse(TEST + off), 70.0)
    first, second = found.excursions
    assert (first.begin_s, first.end_s, second.begin_s, second.end_s) == pytest.approx((0.020, 0.025, 0.040, 0.042))
    assert (first.difference_mps2, second.difference_mps2) == pytest.approx((0.4 * largest, -0.6 * largest))
    assert (first.beyond_outer, second.beyond_outer) == (False, True)
    assert first.loss == pytest.approx(0.4 * (1 - (0.1 / 0.45) ** 2) * 5 / 70)
    assert second.loss == pytest.approx(0.4 * 2 / 70)
    assert found.losses["corridor"] == pytest.approx(first.loss + second.loss)
    assert (found.inner_mps2, found.outer_mps2) == pytest.approx((0.05 * largest, 0.5 * largest))


def _pairs() -> list[tuple[str, FloatArray, FloatArray]]:
    return list(random_pairs(np.random.default_rng(7), rounds=1, longest=300))


@pytest.mark.parametrize(("name", "t", "c"), _pairs(), ids=[name for name, *_ in _pairs()])
def test_summed_up_again_the_parts_give_the_rating_to_the_last_digit(name: str, t: FloatArray, c: FloatArray) -> None:
    window_ms = t.size * STEP_S * 1e3
    one, other = (Pulse(np.arange(t.size) * STEP_S, values) for values in (t, c))
    found = explain_rating(one, other, window_ms)
    rating = rate_windows(one, other, [window_ms])[window_ms]
    assert found.rating == rating, name
    curves = found.compared
    assert corridor_values(curves.reference, curves.comparison[None]).mean(axis=-1)[0] == rating.corridor
    limit = MAX_SHIFT * t.size
    assert max((limit - abs(round(found.shift_s / STEP_S))) / limit, 0.0) == rating.phase
    assert max((0.5 - found.warped.error) / 0.5, 0.0) == rating.magnitude
    # the standard's slope has a norm of 0 only for a flat stretch, which no pair here ends up with
    assert max((2 - found.slopes.error) / 2, 0.0) == pytest.approx(rating.slope, rel=0, abs=1e-15)
    assert 1 - sum(found.losses.values()) == pytest.approx(rating.overall, rel=0, abs=1e-15)
    assert sum(own.loss for own in found.excursions) == pytest.approx(found.losses["corridor"], abs=1e-12)
    if found.humps:
        assert sum(hump.shift_gain for hump in found.humps) >= -1e-12  # the shift was the best
        for shares in ([h.magnitude_share for h in found.humps], [h.slope_share for h in found.humps]):
            assert sum(shares) == pytest.approx(1) or sum(shares) == 0


def bumps(*centres_ms: float, height: float = 200.0) -> FloatArray:
    """Braking in humps of 4 ms at these times."""
    return np.asarray(np.sum([bump(centre_ms, height, 4.0) for centre_ms in centres_ms], axis=0)[:600])


def test_peaks_are_where_the_humps_are_and_valleys_half_way_between() -> None:
    for curve in (bumps(15, 35), -bumps(15, 35)):
        first, second = humps(curve)
        assert (first.begin, first.peak, second.peak, second.end) == (0, 150, 350, 600)
        assert first.end == second.begin == pytest.approx(250, abs=1)


def test_a_ripple_is_no_hump_and_a_rise_has_none() -> None:
    assert [hump.peak for hump in humps(bumps(15) + bumps(40, height=15.0))] == [150]
    assert humps(np.linspace(0.0, -1.0, 600)) == ()


def test_each_hump_finds_the_same_one_moved() -> None:
    """2 ms early, at its time, 3 ms late; and one of the three is missing."""
    found = counterparts(bumps(12, 30, 48), bumps(10, 30, 51))
    assert [found[number].peak for number in range(3)] == pytest.approx([100, 300, 510], abs=1)
    assert set(counterparts(bumps(12, 30, 48), bumps(12, 30))) == {0, 1}


CASES = {
    "3 ms late": np.interp(TIME_S - 0.003, TIME_S, TEST),
    "the second of three humps 4 ms early, the third not at all": bump(15, 200) + bump(29, 250),
    "10 g too weak from 20 to 25 ms": TEST + np.where((TIME_S > 0.01995) & (TIME_S < 0.02495), 10 * G, 0.0),
    "equal": TEST,
}


def test_each_fault_is_told() -> None:
    told = {name: rating_sentences(explain_rating(pulse(TEST), pulse(own), 70.0)) for name, own in CASES.items()}
    assert_golden(
        "rating_sentences", (f"{name}: {part}: {said}" for name, of in told.items() for part, said in of.items())
    )
    text = told["10 g too weak from 20 to 25 ms"]["corridor"]
    assert text.in_units(UnitSystem(acceleration="m/s²")).endswith("where it is up to 98.1 m/s² too weak.")
