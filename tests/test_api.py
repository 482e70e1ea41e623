"""What the package promises to its users by name."""

import crashfuse
from crashfuse import errors


def test_the_public_names_are_these() -> None:
    """A name that comes or goes is a decision, not an accident."""
    assert crashfuse.__all__ == [
        "Campaign",
        "Condition",
        "ConditionRange",
        "CrashfuseError",
        "DataError",
        "Display",
        "Fit",
        "LearningCurve",
        "NextTests",
        "Note",
        "PredictedPulse",
        "Preview",
        "Pulse",
        "PulseExport",
        "Rating",
        "RatingChoices",
        "RatingExplanation",
        "ReportOptions",
        "SolverCurve",
        "SpeedSweep",
        "Study",
        "StudyConfig",
        "UsageError",
        "Verdicts",
        "__version__",
        "certify",
        "darkened",
        "energy_crush",
        "estimate_at",
        "estimates_at",
        "excursions_table",
        "expected_rating",
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
        "rank_next_tests",
        "rate_channels",
        "rate_files",
        "rate_iso18571",
        "rate_pairs",
        "rating_sentences",
        "read_notes",
        "recommend",
        "recommend_for",
        "run_study",
        "sample_folder",
        "save_model",
        "study_report",
        "sweep",
        "sweep_speed",
        "watching",
        "worst_test",
        "write_campaign",
        "write_certification",
        "write_learning_curve",
        "write_notes",
        "write_prediction",
        "write_study",
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
