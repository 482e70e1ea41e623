"""What the package promises to its users by name."""

import inspect
import re
from collections.abc import Callable

import crashfuse
from crashfuse import errors


def test_the_public_names_are_these() -> None:
    """A name that comes or goes is a decision, not an accident."""
    assert crashfuse.__all__ == [
        "Cache",
        "Campaign",
        "Choices",
        "ColumnChoice",
        "Condition",
        "CrashTest",
        "CrashfuseError",
        "Criteria",
        "DataError",
        "Display",
        "EarlierPrediction",
        "Estimate",
        "ExpectedRating",
        "Fit",
        "Fold",
        "Kinematics",
        "LearningCurve",
        "Matrix",
        "Metric",
        "Neighbour",
        "NextTests",
        "Note",
        "OccupantModel",
        "PartialCondition",
        "PredictedPulse",
        "Prediction",
        "Preview",
        "Problem",
        "Pulse",
        "PulseExport",
        "QualityLimits",
        "Rating",
        "RatingChoices",
        "RatingExplanation",
        "Recommendation",
        "ReportOptions",
        "SolverCurve",
        "SpeedSweep",
        "Study",
        "StudyConfig",
        "UsageError",
        "Verdicts",
        "Watch",
        "__version__",
        "certify",
        "darkened",
        "energy_crush",
        "excursions_table",
        "explain_files",
        "explain_rating",
        "figure_table",
        "humps_table",
        "import_source",
        "learning_curve",
        "load_campaign",
        "load_model",
        "next_test",
        "predict",
        "prediction_report",
        "preview_source",
        "pulse_metrics",
        "rate_channels",
        "rate_files",
        "rate_iso18571",
        "rate_pairs",
        "rating_sentences",
        "read_notes",
        "recommend",
        "run_study",
        "sample_folder",
        "save_model",
        "study_report",
        "sweep",
        "watching",
        "worst_test",
        "write_campaign",
        "write_notes",
    ]


def test_every_public_name_can_be_imported() -> None:
    """Names are found when first asked for."""
    assert all(getattr(crashfuse, name) is not None for name in crashfuse.__all__)


def test_an_unknown_name_is_an_attribute_error() -> None:
    """Lazy import behaves as any module does."""
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
