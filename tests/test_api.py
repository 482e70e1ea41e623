"""What the package promises to its users by name."""

import inspect
import re
from collections.abc import Callable

import numpy as np
import pytest

import crashfuse
from crashfuse import errors

NAMES = """

Cache Campaign Choices ColumnChoice Condition CrashTest CrashfuseError Criteria DataError Display EarlierPrediction
Estimate ExpectedRating Fit Fold Kinematics LearningCurve Matrix Metric Neighbour NextTests Note OccupantModel
PartialCondition PredictedPulse Prediction Preview Problem Pulse PulseExport QualityLimits Rating RatingChoices
RatingExplanation Recommendation ReportOptions SolverCurve SpeedSweep Study StudyConfig UsageError VehicleArchive
Verdicts Watch __version__ certify darkened energy_crush excursions_table explain_files explain_rating figure_table
humps_table import_source learn_archive learning_curve load_archive load_campaign load_model next_test predict
prediction_report preview_source pulse_metrics rate_channels rate_files rate_iso18571 rate_pairs rating_sentences
read_notes recommend run_study sample_folder save_model study_report sweep watching worst_test write_campaign
write_notes
"""


def test_the_public_names_are_these() -> None:
    """A name that comes or goes is a decision, not an accident."""
    assert crashfuse.__all__ == NAMES.split()


def test_every_public_name_can_be_imported_and_no_other() -> None:
    """Names are found when first asked for, as in any module."""
    assert all(getattr(crashfuse, name) is not None for name in crashfuse.__all__)
    assert not hasattr(crashfuse, "magic")


def test_all_errors_are_one_tree() -> None:
    """Catching the base catches everything that is raised on purpose."""
    kinds = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, Exception)]
    assert len(kinds) == 5
    assert all(issubclass(kind, crashfuse.CrashfuseError) for kind in kinds)


def test_types_that_public_calls_ask_for_are_public() -> None:
    """Whatever has to be made to call a function can be made from the public names."""
    public = {name: getattr(crashfuse, name) for name in crashfuse.__all__}
    called: list[tuple[str, Callable[..., object]]] = [
        (name, call) for name, call in public.items() if inspect.isfunction(call)
    ]
    settings = (crashfuse.Choices, crashfuse.RatingChoices, crashfuse.ReportOptions, crashfuse.PulseExport)
    called += [(kind.__name__, kind) for kind in settings]
    called += [
        (f"{kind.__name__}.{name}", call)
        for kind in (crashfuse.Study, crashfuse.PredictedPulse, crashfuse.Verdicts, crashfuse.LearningCurve)
        for name, call in inspect.getmembers(kind, inspect.isfunction)
        if not name.startswith("_") and name != "beside"
    ]
    for name, call in called:
        scope = vars(inspect.getmodule(call))
        for parameter in inspect.signature(call).parameters.values():
            for word in re.findall(r"[A-Z]\w+", str(parameter.annotation)):
                kind = scope.get(word)
                made = inspect.isclass(kind) and not issubclass(kind, dict) and not getattr(kind, "_is_protocol", False)
                assert not made or not kind.__module__.startswith("crashfuse") or word in public, f"{name}: {word}"


TIME_S = np.arange(1250) * 8e-5
BRAKING = -680.0 * np.sin(np.pi * TIME_S / 0.07) * (TIME_S < 0.07)  # takes 30.3 m/s away, so it stops a vehicle at 28
WRONG: dict[str, tuple[Callable[[], object], str]] = {
    "sign": (lambda: crashfuse.SolverCurve("mm-s-t", deceleration_sign="Positive"), "did you mean positive"),  # type: ignore[arg-type]
    "text for a number": (lambda: crashfuse.SolverCurve("mm-s-t", start_s="0.01"), "start_s is a number"),  # type: ignore[arg-type]
    "curve": (lambda: crashfuse.PulseExport("lsdyna", curve="mm-s-t"), "takes a SolverCurve"),  # type: ignore[arg-type]
    "seed": (lambda: crashfuse.PulseExport(draws=2, seed=-1), "seed of draws is 0 or more"),
    "no series": (lambda: crashfuse.StudyConfig(approaches=5), "There is no approach 5"),  # type: ignore[arg-type]
    "window in s": (lambda: crashfuse.Display(window_ms=0.06), "choose 10 to 100 ms"),
    "yes and no": (lambda: crashfuse.Display(deceleration="no"), "takes a bool"),  # type: ignore[arg-type]
    "m for mm": (lambda: crashfuse.OccupantModel(olc_free_flight_mm=0.065), "write 65"),
    "mm for m": (lambda: crashfuse.Choices(gap_m=390), "from 0 to 10 m, not 390"),
    "no condition": (lambda: crashfuse.Choices(condition="35 mph"), "takes a PartialCondition"),  # type: ignore[arg-type]
    "role": (lambda: crashfuse.ColumnChoice("Zeit", "zeit"), "There is no role of a column"),  # type: ignore[arg-type]
    "two units": (
        lambda: crashfuse.Condition.of(speed_mph=35, speed_kmh=56, front_weight_kg=950, rear_weight_kg=700),
        "speed_kmh does not end in one of these units",
    ),
    "text for a speed": (
        lambda: crashfuse.Condition(speed_mps="15", front_weight_kg=950, rear_weight_kg=700),  # type: ignore[arg-type]
        "speed_mps is a number",
    ),
    "a note": (lambda: crashfuse.ReportOptions(notes=["x"]), "takes a Note"),  # type: ignore[arg-type]
    "ms for s": (lambda: crashfuse.Pulse(1e3 * TIME_S, BRAKING), "0.08 ms are 8e-05 s"),
    "window as text": (lambda: crashfuse.rate_iso18571(BRAKING, BRAKING, dt_s=8e-5, window_ms="60"), "is a number"),  # type: ignore[arg-type]
    "a path": (lambda: crashfuse.rate_iso18571("a.csv", "b.csv", dt_s=8e-5), "expected an array of numbers"),  # type: ignore[arg-type]
    "a step of pulses": (
        lambda: crashfuse.rate_iso18571(*2 * [crashfuse.Pulse(TIME_S, BRAKING)], dt_s=8e-5),
        "leave out",
    ),
    "mph for m/s": (lambda: crashfuse.energy_crush(BRAKING, 28 / 0.44704), "62.6342 mph are 28 m/s"),
    "no speed": (lambda: crashfuse.energy_crush(BRAKING, -28.0), "a number above 0"),
    "another grid": (lambda: crashfuse.energy_crush(BRAKING[:1000], 28.0), "1250 samples"),
    "other sign": (lambda: crashfuse.pulse_metrics(-BRAKING, 28.0), "change its sign"),
    "g for m/s²": (lambda: crashfuse.pulse_metrics(BRAKING / 9.80665, 28.0), "if it is in g"),
    "mm/s² for m/s²": (lambda: crashfuse.pulse_metrics(BRAKING * 1e3, 28.0), "correct the unit"),
    "not finite": (lambda: crashfuse.pulse_metrics(np.nan * BRAKING, 28.0), "finite"),
    "draws": (lambda: crashfuse.pulse_metrics(BRAKING, 28.0, draws_mps2=np.ones((3, 7))), r"shape \(n_draws, 1250\)"),
    "no campaign": (lambda: crashfuse.Fit.of("campaign", "cae"), "takes a Campaign"),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("kind", WRONG)
def test_what_is_wrong_is_refused_where_it_is_given(kind: str) -> None:
    """With the likely unit or the nearest word, and no other exception."""
    call, sentence = WRONG[kind]
    with pytest.raises(crashfuse.CrashfuseError, match=sentence):
        call()


def test_one_thing_stands_for_a_series_of_it() -> None:
    """A name, a window; equal settings are equal, however they are given."""
    one = crashfuse.StudyConfig(approaches="cae", windows_ms=60)  # type: ignore[arg-type]
    assert one == crashfuse.StudyConfig(approaches=["cae", "cae"], windows_ms=[60.0])  # type: ignore[arg-type]
    assert hash(one) == hash(crashfuse.StudyConfig(approaches=("cae",), windows_ms=(60.0,)))
