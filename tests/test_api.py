"""What the package promises to its users by name."""

import inspect
import re
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from pkgutil import resolve_name

import numpy as np
import pandas as pd
import pytest

import crashfuse
from crashfuse import errors
from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign

NAMES = """
Cache Campaign Certification Choices ColumnChoice Condition CrashfuseError Criteria DataError Display EarlierPrediction
Fit Fold LearningCurve Matrix Note OccupantModel PartialCondition PredictedPulse Problem Pulse PulseExport QualityLimits
RatingChoices RatingExplanation ReportOptions Run SolverCurve Study StudyConfig UsageError Watch __version__ certify
explain_rating import_source learn_archive learning_curve load_archive load_campaign load_model next_test predict
preview_source pulse_metrics rate_channels rate_files rate_iso18571 rate_pairs rating_sentences read_notes recommend
recompute run_study sample_folder save_model study_report sweep watching with_decided worst_test write_campaign
write_notes
"""


def test_the_public_names_are_these() -> None:
    assert crashfuse.__all__ == NAMES.split()


def test_every_public_name_can_be_imported_and_no_other() -> None:
    assert all(getattr(crashfuse, name) is not None for name in crashfuse.__all__)
    assert not hasattr(crashfuse, "magic")


def test_all_errors_are_one_tree() -> None:
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
        for kind in (crashfuse.Study, crashfuse.PredictedPulse, crashfuse.Certification, crashfuse.LearningCurve)
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
PULSE, TWO = crashfuse.Pulse(TIME_S, BRAKING), np.ones((600, 2))
AT = partial(crashfuse.Condition.of, front_weight_kg=950.0, rear_weight_kg=700.0)
BARE = partial(crashfuse.Condition, front_weight_kg=950.0, rear_weight_kg=700.0)


def prediction() -> Prediction:
    """A prediction with two draws."""
    return Prediction(BARE(speed_mps=28.0), BRAKING, np.array([BRAKING, 0.9 * BRAKING]))


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
    "two units": (lambda: AT(speed_mph=35, speed_kmh=56), "speed_kmh does not end in one of these units"),
    "text for a speed": (lambda: BARE(speed_mps="15"), "speed_mps is a number"),  # type: ignore[arg-type]
    "a note": (lambda: crashfuse.ReportOptions(notes=["x"]), "takes a Note"),  # type: ignore[arg-type]
    "ms for s": (lambda: crashfuse.Pulse(1e3 * TIME_S, BRAKING), "0.08 ms are 8e-05 s"),
    "window as text": (lambda: crashfuse.rate_iso18571(BRAKING, BRAKING, dt_s=8e-5, window_ms="60"), "is a number"),  # type: ignore[arg-type]
    "a path": (lambda: crashfuse.rate_iso18571("a.csv", "b.csv", dt_s=8e-5), "expected an array of numbers"),  # type: ignore[arg-type]
    "a step of pulses": (lambda: crashfuse.rate_iso18571(PULSE, PULSE, dt_s=8e-5), "leave out"),
    "other sign": (lambda: crashfuse.pulse_metrics(-BRAKING, 28.0), "change its sign"),
    "g for m/s²": (lambda: crashfuse.pulse_metrics(BRAKING / 9.80665, 28.0), "if it is in g"),
    "mm/s² for m/s²": (lambda: crashfuse.pulse_metrics(BRAKING * 1e3, 28.0), "correct the unit"),
    "not finite": (lambda: crashfuse.pulse_metrics(np.nan * BRAKING, 28.0), "finite"),
    "draws": (lambda: crashfuse.pulse_metrics(BRAKING, 28.0, draws_mps2=np.ones((3, 7))), r"shape \(n_draws, 1250\)"),
    "per cent for a share": (lambda: prediction().band(95), "between 0 and 1, such as 0.95, not 95"),
    "a band upside down": (lambda: prediction().band(-0.95), "between 0 and 1"),
    "two curves at once": (lambda: crashfuse.rate_iso18571(TWO, TWO, dt_s=8e-5), "one dimension, found one of 600 × 2"),
    "no filter class": (lambda: crashfuse.Choices(channel_filter_class=61), '60, 180, 600, 1000 or "none", not 61'),
    "nor of a comparison": (lambda: crashfuse.RatingChoices(channel_filter_class=61), "not 61"),
    "no number": (lambda: BARE(speed_mps=np.nan), "not nan"),
    "factors": (lambda: BARE(speed_mps=9.0, factors={"drive": "AWD"}), "pairs of name and value"),  # type: ignore[arg-type]
    "no folder": (lambda: crashfuse.load_campaign(None), "The path of a campaign folder is text"),  # type: ignore[arg-type]
    "a share in per cent": (lambda: crashfuse.QualityLimits("mine", hourglass_share=5), "5 % is 0.05"),
    "no campaign": (lambda: crashfuse.Fit.of("campaign", "cae"), "takes a Campaign"),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("kind", WRONG)
def test_what_is_wrong_is_refused_where_it_is_given(kind: str) -> None:
    call, sentence = WRONG[kind]
    with pytest.raises(crashfuse.CrashfuseError, match=sentence):
        call()


def test_one_thing_stands_for_a_series_of_it() -> None:
    one = crashfuse.StudyConfig(approaches="cae", windows_ms=60)  # type: ignore[arg-type]
    assert one == crashfuse.StudyConfig(approaches=["cae", "cae"], windows_ms=[60.0])  # type: ignore[arg-type]
    assert hash(one) == hash(crashfuse.StudyConfig(approaches=("cae",), windows_ms=(60.0,)))


UNFIT = (None, object(), "x", 0, -1.0, 1e300, np.nan, np.inf, True, ["x"], {"a": 1}, np.zeros((3, 4)))
CALLS: dict[str, tuple[str, ...]] = {  # and their arguments, the first of which is the one that matters
    **dict.fromkeys(("rate_iso18571", "explain_rating"), ("reference", "comparison", "dt_s", "window_ms")),
    **dict.fromkeys(
        ("rate_files", "rate_channels", "importing.ratings.explain_files"), ("reference", "comparison", "windows_ms")
    ),
    **dict.fromkeys(("results.rating_tables.humps_table", "results.rating_tables.excursions_table"), ("explanation",)),
    "rating_sentences": ("explanation",),
    **dict.fromkeys(("recommend", "study_report"), ("study",)),
    "results.drawing.figure_table": ("figure",),
    "rate_pairs": ("table", "windows_ms"),
    "pulse_metrics": ("accel_mps2", "speed_mps", "dt_s", "draws_mps2", "occupant"),
    "load_campaign": ("path",),
    "load_archive": ("path",),
    "load_model": ("path", "campaign"),
    "save_model": ("fit", "campaign", "path"),
    "learn_archive": ("campaigns",),
    "import_source": ("source", "out"),
    "preview_source": ("source",),
    "write_campaign": ("campaign", "folder"),
    "read_notes": ("folder",),
    "write_notes": ("folder", "notes"),
    "predict": ("campaign", "condition", "approach", "config"),
    "certify": ("campaign", "criteria", "matrix", "approach", "config", "costs"),
    "run_study": ("campaign", "config", "held_out"),
    "learning_curve": ("campaign", "config"),
    "sweep": ("campaign", "condition", "approach", "config"),
    "next_test": ("campaign", "config"),
    "worst_test": ("study", "window_ms", "approach"),
    "results.prediction.prediction_result": ("prediction",),
    "Condition": ("speed_mps", "front_weight_kg", "rear_weight_kg", "factors"),
    "Pulse": ("time_s", "accel_mps2"),
    "Matrix": ("ids", "conditions"),
    "Cache": ("folder",),
    "Note": ("test", "text", "start_ms"),
    "QualityLimits": ("name", "hourglass_share"),
    "ColumnChoice": ("column", "role", "unit"),
    "PartialCondition": ("speed_mps", "mass_kg"),
    "Choices": ("channels", "unit", "gap_m", "channel_filter_class"),
    "RatingChoices": ("channels", "channel_filter_class"),
    "StudyConfig": ("approaches", "preset", "seed", "windows_ms", "leave_out", "device"),
}


@pytest.fixture(scope="module")
def sound(campaign: Campaign, shared_cache: Path) -> dict[str, object]:
    """What each argument may be."""
    condition, run = campaign.tests[0].condition, crashfuse.Run(crashfuse.Cache(shared_cache))
    texts = {"approach": "cae", "test": "T1", "text": "x", "column": "a", "role": "time", "name": "x"}
    numbers = {"dt_s": 8e-5, "window_ms": 40.0, "speed_mps": 28.0, "front_weight_kg": 950.0, "rear_weight_kg": 700.0}
    pulses = {"accel_mps2": BRAKING, "time_s": TIME_S, **dict.fromkeys(("reference", "comparison"), BRAKING)}
    series = {"windows_ms": (40.0,), "criteria": [{"metric": "peak", "at_most": 30.0}], "ids": ("A",), "notes": []}
    conditions = {"condition": condition, "conditions": (condition,), "matrix": pd.DataFrame()}
    config = crashfuse.StudyConfig(("cae",))
    made = {"campaign": campaign, "config": config, "fit": crashfuse.Fit.of(campaign, "cae", config, run)}
    study = crashfuse.run_study(campaign, held_out=["T1"], approaches=["cae"], workers=1, cache=run.cache)
    return {**texts, **numbers, **pulses, **series, **conditions, **made, "study": study}


@pytest.mark.usefixtures("one_cache")
@pytest.mark.parametrize("name", CALLS)
def test_whatever_is_given_is_taken_or_refused_in_a_sentence(
    name: str, sound: dict[str, object], campaign_on_disk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    paths = dict.fromkeys(("folder", "path", "source", "out", "table"), tmp_path / "none")
    arguments = CALLS[name]
    given = {argument: value for argument, value in (sound | paths).items() if argument in arguments}
    if name.endswith(("_files", "_channels")):
        given |= dict.fromkeys(("reference", "comparison"), campaign_on_disk / "tests" / "T1.csv")
    for argument in arguments:
        for unfit in UNFIT:
            with suppress(crashfuse.CrashfuseError):
                resolve_name(f"crashfuse.{name}")(**given | {argument: unfit})
