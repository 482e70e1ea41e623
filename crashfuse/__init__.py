"""crashfuse: fuse CAE crash pulses with a handful of physical tests, and prove how good the result is.

>>> import crashfuse
>>> campaign = crashfuse.load_campaign("sample_data")
>>> study = crashfuse.run_study(campaign, held_out=["T09"])
>>> study.fold("T09").ratings["displacement_domain"][60.0]
"""

import importlib
from typing import TYPE_CHECKING

from crashfuse.version import __version__

if TYPE_CHECKING:
    from crashfuse.campaign import Campaign
    from crashfuse.config import StudyConfig
    from crashfuse.energy import energy_crush
    from crashfuse.errors import CrashfuseError, DataError, UsageError
    from crashfuse.estimate import Fit, estimate_at, estimates_at
    from crashfuse.expected import expected_rating
    from crashfuse.formats.folder import load_campaign
    from crashfuse.metrics import pulse_metrics
    from crashfuse.models import load_model, save_model
    from crashfuse.next_test import ConditionRange, rank_next_tests
    from crashfuse.pulse import Condition, Pulse
    from crashfuse.rating import Rating, rate_iso18571
    from crashfuse.recommendation import recommend, recommend_for
    from crashfuse.report import prediction_report, study_report
    from crashfuse.results import write_prediction, write_study
    from crashfuse.study import Study, run_study
    from crashfuse.sweep import sweep_speed

_HOMES = {
    "Campaign": "campaign",
    "Condition": "pulse",
    "ConditionRange": "next_test",
    "CrashfuseError": "errors",
    "DataError": "errors",
    "Fit": "estimate",
    "Pulse": "pulse",
    "Rating": "rating",
    "Study": "study",
    "StudyConfig": "config",
    "UsageError": "errors",
    "energy_crush": "energy",
    "estimate_at": "estimate",
    "estimates_at": "estimate",
    "expected_rating": "expected",
    "load_campaign": "formats.folder",
    "load_model": "models",
    "prediction_report": "report",
    "pulse_metrics": "metrics",
    "rank_next_tests": "next_test",
    "rate_iso18571": "rating",
    "recommend": "recommendation",
    "recommend_for": "recommendation",
    "run_study": "study",
    "save_model": "models",
    "study_report": "report",
    "sweep_speed": "sweep",
    "write_prediction": "results",
    "write_study": "results",
}

__all__ = [
    "Campaign",
    "Condition",
    "ConditionRange",
    "CrashfuseError",
    "DataError",
    "Fit",
    "Pulse",
    "Rating",
    "Study",
    "StudyConfig",
    "UsageError",
    "__version__",
    "energy_crush",
    "estimate_at",
    "estimates_at",
    "expected_rating",
    "load_campaign",
    "load_model",
    "prediction_report",
    "pulse_metrics",
    "rank_next_tests",
    "rate_iso18571",
    "recommend",
    "recommend_for",
    "run_study",
    "save_model",
    "study_report",
    "sweep_speed",
    "write_prediction",
    "write_study",
]


def __getattr__(name: str) -> object:
    """Import a public name when it is first asked for: rating two pulses must not wait for torch."""
    if name not in _HOMES:
        raise AttributeError(f"module 'crashfuse' has no attribute {name!r}")
    return getattr(importlib.import_module(f"crashfuse.{_HOMES[name]}"), name)
