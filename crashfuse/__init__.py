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
    from crashfuse.errors import CrashfuseError, DataError, UsageError
    from crashfuse.estimate import Fit, estimate_at
    from crashfuse.formats.folder import load_campaign
    from crashfuse.models import load_model, save_model
    from crashfuse.pulse import Condition, Pulse
    from crashfuse.rating import Rating, rate_iso18571
    from crashfuse.results import write_prediction, write_study
    from crashfuse.study import Study, run_study

_HOMES = {
    "Campaign": "campaign",
    "Condition": "pulse",
    "CrashfuseError": "errors",
    "DataError": "errors",
    "Fit": "estimate",
    "Pulse": "pulse",
    "Rating": "rating",
    "Study": "study",
    "StudyConfig": "config",
    "UsageError": "errors",
    "estimate_at": "estimate",
    "load_campaign": "formats.folder",
    "load_model": "models",
    "rate_iso18571": "rating",
    "run_study": "study",
    "save_model": "models",
    "write_prediction": "results",
    "write_study": "results",
}

__all__ = [
    "Campaign",
    "Condition",
    "CrashfuseError",
    "DataError",
    "Fit",
    "Pulse",
    "Rating",
    "Study",
    "StudyConfig",
    "UsageError",
    "__version__",
    "estimate_at",
    "load_campaign",
    "load_model",
    "rate_iso18571",
    "run_study",
    "save_model",
    "write_prediction",
    "write_study",
]


def __getattr__(name: str) -> object:
    """Import a public name when it is first asked for: rating two pulses must not wait for torch."""
    if name not in _HOMES:
        raise AttributeError(f"module 'crashfuse' has no attribute {name!r}")
    return getattr(importlib.import_module(f"crashfuse.{_HOMES[name]}"), name)
