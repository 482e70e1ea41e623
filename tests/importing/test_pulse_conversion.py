"""From record to pulse: what is found is true, what a user says overrules it, and every step is told."""

from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
import pytest

from crashfuse.errors import DataError, UsageError
from crashfuse.importing import Choices, Settled, settle
from crashfuse.importing.detection import UnknownUnit
from crashfuse.readers.lsdyna import read_lsdyna
from crashfuse.readers.nhtsa import read_nhtsa
from crashfuse.readers.record import PartialCondition, Record, RecordedChannel
from crashfuse.signals.filters import CFC60_NOISE, cfc_filter, noise_share
from crashfuse.signals.pulse import FloatArray, Kinematics
from crashfuse.units import KPH, MS, G, signed
from tests.conftest import SHARED, needs_shared, problems_of
from tests.importing import crashes
from tests.importing.crashes import CONDITION, CRUSH_M, PEAK_MPS2, SPEED_MPS, STOP_S, channel, clock, record

TIME_S = clock()
PULSE_G = crashes.half_sine_g(TIME_S)
RAW_G = PULSE_G + crashes.ringing_g(TIME_S)


def motion(settled: Settled) -> Kinematics:
    return settled.pulse.kinematics(settled.condition.speed_mps)


def signal(time_s: FloatArray, values: FloatArray, cutoff_hz: float | None = None, **of: PartialCondition) -> Record:
    return record(RecordedChannel("X", "X", time_s, values, "g", cutoff_hz), **of)


def steps_with(settled: Settled, text: str) -> list[str]:
    return [step for step in settled.steps if text in step]


@pytest.mark.parametrize(
    ("scale", "unit", "found"),
    [
        (1.0, "g", ("g", "negative")),
        (-1.0, "g", ("g", "positive")),
        (G, "m/s²", ("m/s²", "negative")),
        (1e3 * G, "mm/s²", ("mm/s²", "negative")),
        (1e-3 * G, "mm/ms²", ("mm/ms²", "negative")),
        (1.0, None, ("g", "negative")),
        (-G, None, ("m/s²", "positive")),
        (1e3 * G, None, ("mm/s²", "negative")),
    ],
)
def test_unit_and_sign_are_found(scale: float, unit: str | None, found: tuple[str, str]) -> None:
    settled = settle(record(channel(scale=scale, unit=unit)))
    assert (settled.unit, settled.deceleration_sign) == found
    assert settled.pulse.time_s[0] == 0
    assert settled.pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=1e-3)
    assert motion(settled).t0_s == pytest.approx(STOP_S, abs=1e-5)
    assert motion(settled).displacement_m.max() == pytest.approx(CRUSH_M, rel=1e-3)
    assert any(f"Unit {found[0]}" in step for step in settled.steps)


def test_a_unit_that_contradicts_the_speed_is_refused_until_the_user_says_so() -> None:
    """Numbers in m/s² under a label g are caught by the change of velocity; the right unit is named."""
    mislabelled = record(channel(scale=G, unit="g"))
    with pytest.raises(DataError, match="check the unit: m/s² would fit"):
        settle(mislabelled)
    settled = settle(mislabelled, Choices(unit="m/s²"))
    assert settled.pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=1e-3)
    with pytest.raises(UsageError, match="no unit 'furlong'"):
        settle(mislabelled, Choices(unit="furlong"))
    with pytest.raises(DataError, match="positive deceleration, as chosen"):
        settle(record(channel()), Choices(deceleration_sign="positive"))


def test_time_zero_is_the_files_own_where_it_has_one() -> None:
    assert settle(record(channel())).time_zero_s == 0.0
    assert settle(replace(record(channel(start_s=0.0)), own_time_zero="by definition")).time_zero_s == 0.0
    assert settle(record(channel()), Choices(time_zero_s=1 * MS)).time_zero_s == 1 * MS


@pytest.mark.parametrize("lead_s", [0.0, 0.002, 0.03, 0.5])
def test_time_zero_is_found_by_its_onset_where_a_test_began_recording_early(lead_s: float) -> None:
    """A test whose clock runs from 0 is moved to the onset of deceleration, to 1.5 ms; a short lead stays as it is."""
    time_s = clock(0.0, 0.3 + lead_s)
    settled = settle(signal(time_s, crashes.half_sine_g(time_s - lead_s)))
    assert settled.time_zero_s == pytest.approx(lead_s if lead_s > 0.01 else 0.0, abs=1.5 * MS)
    assert steps_with(settled, "Time zero at")


def test_a_raw_record_is_filtered_whole_before_it_is_cut() -> None:
    """The ringing goes; the result is CFC 60 of the whole record, cut, not CFC 60 of the cut."""
    settled = settle(signal(TIME_S, RAW_G, 2800.0))
    expected = cfc_filter(RAW_G, cfc=60, dt_s=1e-4)[np.searchsorted(TIME_S, -1e-9) :] * G
    assert settled.channel_filter_class == 60
    np.testing.assert_allclose(settled.pulse.accel_mps2[:1000], expected[:1000], atol=1e-6)
    assert motion(settled).t0_s == pytest.approx(STOP_S, abs=1e-4)
    assert steps_with(settled, "Filtered with CFC 60, the whole record")


def test_what_is_filtered_already_is_not_filtered_again() -> None:
    smooth = signal(TIME_S, cfc_filter(RAW_G, cfc=60, dt_s=1e-4))
    for filtered in (signal(TIME_S, RAW_G, 100.0), smooth, record(channel(rate_hz=2000))):
        assert settle(filtered).channel_filter_class is None
    noisy = signal(TIME_S, RAW_G)
    assert settle(noisy).channel_filter_class == 60
    assert settle(noisy, Choices(channel_filter_class=180)).channel_filter_class == 180
    unfiltered = settle(noisy, Choices(channel_filter_class="none"))
    assert unfiltered.channel_filter_class is None
    np.testing.assert_allclose(unfiltered.pulse.accel_mps2[:100] / G, RAW_G[500:600], atol=1e-6)


@pytest.mark.parametrize(("noise_g", "again"), [(0.0, None), (0.1, 60.0), (0.2, 60.0), (0.3, 60.0)])
def test_noise_that_cfc_60_would_take_away_is_no_filtered_record(noise_g: float, again: float | None) -> None:
    """Noise of 4 g leaves 0.02 g above 250 Hz after CFC 60: a tenth of a g is more, though a 100,000th of the power."""
    rng = np.random.default_rng(0)
    smooth = cfc_filter(PULSE_G + 4 * rng.standard_normal(TIME_S.size), cfc=60, dt_s=1e-4)
    noisy = np.round(smooth, 1) + noise_g * rng.standard_normal(TIME_S.size)
    assert settle(signal(TIME_S, noisy)).channel_filter_class == again


@needs_shared
def test_a_barrier_test_keeps_its_class() -> None:
    """After CFC 60 it is left as it is, rounded, cut, padded or slowly sampled; after CFC 180 it is not."""
    (camry,) = read_nhtsa(SHARED / "real" / "nhtsa_10146_camry2018")
    raw = next(one for one in camry.channels if one.name == "93")
    time_s, step = raw.time_s, float(raw.time_s[1] - raw.time_s[0])
    smooth = cfc_filter(raw.values, cfc=60, dt_s=step)

    def noise(values: FloatArray, part: slice = slice(None)) -> float:
        return noise_share(values[part], dt_s=float(np.diff(time_s[part])[0]))

    crash, slow = slice(*np.searchsorted(time_s, [0.0, 0.1]).tolist()), slice(None, None, round(1e-3 / step))
    left = (noise(smooth), noise(smooth.round(1)), noise(smooth, crash), noise(smooth, slow))
    assert max(left) < 0.8 * CFC60_NOISE
    assert noise(np.where(time_s > 0.08, 0.0, smooth)) < CFC60_NOISE
    assert min(noise(cfc_filter(raw.values, cfc=cfc, dt_s=step)) for cfc in (180, 600)) > CFC60_NOISE


def test_what_reads_something_before_contact_is_pointed_out() -> None:
    """A zero offset is told in g, signed, and warned of from 0.3 g on; without 10 ms before contact, nothing is."""
    time_s, text = clock(-0.02, 0.1), "before contact it reads"
    for offset_g, careful in ((0.1, False), (-0.4, True), (1.0, True)):
        (told,) = steps_with(settle(signal(time_s, -(crashes.half_sine_g(time_s) + offset_g))), text)
        assert f"{signed(offset_g, 2)} g" in told
        assert told.startswith("Careful") == careful
    assert not steps_with(settle(record(channel(start_s=-0.005))), text)


def test_channels_are_averaged_chosen_or_left_out() -> None:
    left, right, dead = channel("L", 1.05), channel("R", 0.95), channel("D", 0.1)
    assert settle(record(left, right)).pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=1e-3)
    without = settle(record(left, right, dead))
    assert without.channels == ("L", "R")
    assert steps_with(without, "unlike the others: D")
    chosen = settle(record(left, right), Choices(channels=("R",)))
    assert chosen.pulse.accel_mps2.min() == pytest.approx(-0.95 * PEAK_MPS2, rel=1e-3)
    with pytest.raises(UsageError, match=r"no channel Q in T1.test; it has L \(Sensor L\), R"):
        settle(record(left, right), Choices(channels=("Q",)))
    for other, told in ((channel("R", rate_hz=5000), "sampled alike"), (channel("R", unit=None), "of one unit")):
        with pytest.raises(DataError, match=f"channels {told}"):
            settle(record(left, other))
    with pytest.raises(DataError, match="that is the vehicle's pulse"):
        settle(replace(record(left), proposed=()))


@pytest.mark.parametrize("scales", [(0.65, 1.0), (1.0, -1.0), (0.65, 1.0, 0.66, 1.01), (0.7, 1.0, 1.4)])
def test_channels_without_a_majority_are_refused_until_the_user_chooses(scales: tuple[float, ...]) -> None:
    """Nobody can tell which of two saw the crash: each is told with its change of velocity, none is averaged away."""
    channels = [channel(f"C{number}", scale) for number, scale in enumerate(scales)]
    with pytest.raises(DataError, match=r"channels of T1 that agree, found C0: .* km/h .* C1: .*--channel"):
        settle(record(*channels))
    with pytest.raises(DataError, match=r"channels of T1 that agree, found C0: integral −?[0-9.]+ \(unit not"):
        settle(record(*(replace(one, unit=None) for one in channels)))
    assert settle(record(*channels), Choices(channels=("C1",))).channels == ("C1",)


def test_a_pulse_that_will_be_refused_asks_for_no_weights_first() -> None:
    """What is wrong is said along with what is missing; of a unit that the speed may tell, the speed alone is asked."""
    unweighed = record(channel(scale=0.3), condition=PartialCondition(SPEED_MPS))
    weights, change = problems_of(lambda: settle(unweighed))
    assert weights.expected == "the weights on both axles of T1"
    assert change.expected.startswith("a change of velocity near the impact speed")
    unknown = record(channel(unit=None), condition=PartialCondition(None, None, 950.0, 750.0))
    assert not [problem for problem in problems_of(lambda: settle(unknown)) if isinstance(problem, UnknownUnit)]
    untold = record(channel(scale=0.02, unit=None), condition=PartialCondition(SPEED_MPS))
    assert [problem for problem in problems_of(lambda: settle(untold)) if isinstance(problem, UnknownUnit)]


@pytest.mark.parametrize(
    ("name", "label", "typed"),
    [
        ("10SEATLERE00ACXP#1", "ch 93", "10SEATLERE00ACXP#1 (ch 93)"),
        ("Acc  X   (g)", "Acc X", "Acc X (g)"),
        ("Acc  X   (g)", "Acc X", "Acc X"),
        ("93", "LEFT REAR\tX", "93 (LEFT REAR\\tX)"),
    ],
)
def test_a_channel_has_the_name_that_is_printed(name: str, label: str, typed: str) -> None:
    wanted, other = replace(channel(name), label=label), channel("Y", 2.0)
    found = replace(record(wanted, other), proposed=())
    assert found.chosen([typed]) == (wanted,)
    assert " ".join(found.listed.split()).startswith(typed)
    with pytest.raises(UsageError, match=r"no channel Acc Z in T1\.test; it has "):
        found.chosen(["Acc Z"])


def test_a_vehicle_that_does_not_stop_is_pointed_out() -> None:
    """0.9 times the pulse leaves 1 % of the speed: how far it has come by 100 ms is told, in closed form."""
    settled = settle(record(channel(scale=0.9)))
    after = np.linspace(0, 0.1, 100_001)
    speed = SPEED_MPS + np.concatenate([[0], np.cumsum(0.9 * G * crashes.half_sine_g(after)[1:] * 1e-6)])
    moved_mm = float(np.trapezoid(speed, after)) * 1e3
    assert f"it has moved {moved_mm:.0f} mm by then and has 0.6 km/h (0.3 mph) left at 200 ms" in settled.steps[-1]
    assert settle(record(channel(scale=0.9)), role="cae").steps[-1] == settled.steps[-1]


def test_uneven_sampling_is_made_even_and_gaps_are_refused() -> None:
    jitter = TIME_S + np.random.default_rng(0).uniform(-1e-5, 1e-5, TIME_S.size)
    settled = settle(signal(jitter, crashes.half_sine_g(jitter)))
    assert steps_with(settled, "sampled unevenly")
    assert motion(settled).t0_s == pytest.approx(STOP_S, abs=3e-5)
    for time_s, told in (
        (clock(rate_hz=500), "at least 1000 samples a second"),
        (np.delete(TIME_S, slice(600, 650)), r"a step of 5\.1 ms among steps of 0\.1 ms"),
        (TIME_S[::-1], r"time that increases.* found 299\.9 ms in sample 2, after 300 ms"),
        (np.append(TIME_S[:-1], 1e306), r"times in s of a crash, found 1e\+306"),
        (np.round(TIME_S, 3), r"found −50 ms in sample 2, after −50 ms"),
    ):
        with pytest.raises(DataError, match=told):
            settle(signal(time_s, crashes.half_sine_g(np.sort(time_s))), role="cae")


def test_missing_samples_are_cut_at_the_ends_told_and_refused_amid() -> None:
    """A record padded with nothing is used where it has something; rows may lack, a hole in the crash is no pulse."""
    place = np.arange(TIME_S.size)
    whole = settle(signal(TIME_S, np.where((place < 10) | (place >= TIME_S.size - 50), np.nan, PULSE_G)))
    assert motion(whole).t0_s == pytest.approx(STOP_S, abs=1e-5)
    kept = np.delete(TIME_S, [700, 900, 902])
    settled = settle(signal(kept, crashes.half_sine_g(kept)))
    assert "Careful: X lacks 3 of 3501 samples, the first after 19.9 ms; interpolated." in settled.steps
    with pytest.raises(DataError, match="samples without one"):
        settle(signal(TIME_S, np.where(place == 700, np.nan, PULSE_G)))


@pytest.mark.parametrize("role", ["tests", "cae"])
def test_a_record_that_ends_before_its_crash_says_when(role: Literal["tests", "cae"]) -> None:
    """None of these is taken; of one that has 60 ms, what is left of the half sine's speed is told."""
    for end_ms in (30, 55, 60):
        (problem,) = problems_of(partial(settle, record(channel(start_s=0.0, end_s=end_ms * MS)), role=role))
        assert f"{end_ms} ms" in problem.found
    closed = SPEED_MPS - PEAK_MPS2 * crashes.DURATION_S / np.pi * (1 - np.cos(np.pi * 60 * MS / crashes.DURATION_S))
    assert f"{closed / KPH:.1f} km/h" in problem.found


def test_a_record_that_ends_after_the_stop_is_taken_with_a_warning() -> None:
    (told,) = steps_with(settle(record(channel(end_s=0.075)), role="cae"), "record ends")
    assert told.startswith("Careful: the record ends 75 ms after contact at −6.7 g")
    assert not steps_with(settle(record(channel(end_s=0.1)), role="cae"), "record ends")


def test_a_cae_run_at_standstill_is_taken() -> None:
    """A library may start at 0 mph, where no change of velocity can tell anything: there is only noise to compare."""
    still = record(channel(scale=0.0), condition=replace(CONDITION, speed_mps=0.0))
    assert settle(still, role="cae").condition.speed_mps == 0
    with pytest.raises(DataError, match="an impact speed of T1 above 0"):
        settle(still)
    noise = 1e-3 * np.random.default_rng(0).standard_normal((2, TIME_S.size))
    nodes = [RecordedChannel(str(number), "node", TIME_S, values, "g") for number, values in enumerate(noise)]
    assert settle(record(*nodes, condition=still.condition), role="cae").channels == ("0", "1")


@pytest.mark.parametrize("condition", [PartialCondition(), PartialCondition(SPEED_MPS), CONDITION])
@pytest.mark.parametrize(("start_s", "lead_s"), [(-0.02, 0.0), (0.0, 0.03), (-0.05, 0.0)])
def test_a_record_too_short_in_itself_is_told_whatever_else_is_lacking(
    condition: PartialCondition, start_s: float, lead_s: float
) -> None:
    """40 ms from contact are too few with 60 ms and more before it, whether speed and weights are known or not."""
    time_s = clock(start_s, 0.04 + lead_s)
    one = signal(time_s, crashes.half_sine_g(time_s - lead_s), condition=condition)
    *lacking, short = problems_of(lambda: settle(one))
    assert len(lacking) == (condition.speed_mps is None) + (condition.mass_kg is None)
    assert short.expected.startswith("at least 60 ms from contact")
    assert float(short.found.split()[0]) == pytest.approx(40, abs=2)


def test_a_record_that_ends_while_the_vehicle_moves_fast_has_lost_its_end_not_its_speed() -> None:
    """62 ms of 120 ms: half of the speed is left, and what is doubted is the end, unless another unit fits."""
    time_s = clock(end_s=0.062)
    for one, told in (
        (
            signal(time_s, crashes.half_sine_g(time_s / 1.5) / 1.5),
            r"has stopped, or 100 ms, found \d+\.\d km/h .* left at its end, 62 ms",
        ),
        (signal(TIME_S, PULSE_G / 2), r"near the impact speed of 56\.0 km/h .* found a change of 30\.8 km/h"),
        (record(replace(channel(end_s=0.075), unit="m/s²")), "check the unit: g would fit"),
    ):
        with pytest.raises(DataError, match=told):
            settle(one)


def test_a_channel_whose_sensor_failed_is_left_out_beside_a_sound_one() -> None:
    sound, failed = channel("L"), channel("R")
    within = (failed.time_s >= 30 * MS) & (failed.time_s < 35 * MS)
    failed = replace(failed, values=np.where(within, 0.0, failed.values))
    settled = settle(record(sound, failed))
    assert settled.channels == ("L",)
    assert motion(settled).displacement_m.max() == pytest.approx(CRUSH_M, rel=1e-3)
    (step,) = steps_with(settled, "its signal is lost from 30.0 to 34.9 ms")
    assert step.startswith("Left out")
    for kept in (settle(record(failed)), settle(record(sound, failed), Choices(channels=("L", "R")))):
        assert "R" in kept.channels
        assert steps_with(kept, "Careful: R: its signal is lost")
    assert not steps_with(settle(record(failed), role="cae"), "signal")


@pytest.mark.parametrize("gap_mm", [100, 200, 450])
@pytest.mark.parametrize("speed_kph", [30.0, 64.0])
def test_a_gap_before_the_barrier_is_told_and_taken_out(gap_mm: int, speed_kph: float) -> None:
    """Of a CAE run, whatever its speed; a run without one is left as it is, and so is one that begins before."""
    condition, time_s = replace(CONDITION, speed_mps=speed_kph * KPH), clock(start_s=0.0)
    lasts_s = gap_mm * MS / (speed_kph * KPH)  # mm in m, as ms in s

    def run(after_s: float) -> Record:
        return signal(time_s, crashes.half_sine_g(time_s - after_s) * speed_kph / 56, condition=condition)

    (careful,) = steps_with(settle(run(lasts_s), role="cae"), "--gap-mm")
    assert int(careful.partition("--gap-mm ")[2].partition(")")[0]) == pytest.approx(gap_mm, abs=4)
    taken_out = Choices(gap_m=gap_mm * MS)
    for after_s, choices in ((lasts_s, taken_out), (0.0, taken_out), (0.0, Choices())):
        settled = settle(run(after_s), choices, role="cae")
        assert settled.time_zero_s == pytest.approx(after_s)
        assert not steps_with(settled, "--gap-mm")
    assert settle(run(lasts_s), Choices(gap_m=3 * gap_mm * MS), role="cae").time_zero_s == 0


@needs_shared
def test_a_run_of_a_solver_that_begins_before_the_barrier() -> None:
    """200 mm at 8.33 m/s: 24 ms later it is what the run would be at the barrier."""
    (record,) = read_lsdyna(SHARED / "real" / "formats" / "lsdyna_gap")
    choices = Choices(condition=PartialCondition(mass_kg=1500.0), front_share=0.58)
    (careful,) = steps_with(settle(record, choices, role="cae"), "--gap-mm")
    assert "moves 208 mm" in careful
    settled = settle(record, replace(choices, gap_m=0.2), role="cae")
    assert settled.time_zero_s == pytest.approx(0.024, abs=1e-5)
    assert motion(settled).t0_s == pytest.approx(0.0658, abs=2e-4)
