"""How long the steps of a computation take on a usual computer, so that the time left can be told from the start.

Measured on two cores of a laptop, with the sample campaign. Only proportions matter: the pace of another computer shows
in the first seconds (:mod:`crashfuse.execution.time_left`).
"""

from collections.abc import Set

from crashfuse.approaches.registry import CLASSES
from crashfuse.campaign import Campaign
from crashfuse.study.config import StudyConfig

REPEATABILITY_S = 0.5  # of one test
EARLY_S = 0.95  # one of many fits without the tests left out, and what it predicts, by an approach without networks
LATE_S = 0.65  # the same once the networks are trained

_EMULATOR = {"CAE emulator": 1.2}
_TRAINING_S = {"fast": 10.0, "paper": 4 * 3600.0}


def shared_steps(approaches: Set[str], config: StudyConfig) -> dict[str, float]:
    """What all fits to the same CAE runs share: the emulator and, where approaches need them, the networks."""
    return _EMULATOR | _networks(approaches, config)


def fit_steps(approaches: Set[str], campaign: Campaign, config: StudyConfig) -> dict[str, float]:
    """Fitting these approaches to a campaign, one after the other, those without networks first."""
    n = len(campaign.tests)
    domain, tuning, mixture = {}, {}, {}
    if approaches & {"displacement_domain", "fused"}:
        domain = {"Bias model": 0.8, "Check of the band": 0.25 * n}
    if approaches & {"time_domain", "fused"}:
        tuning = {"Fine-tuning on tests": 0.5, "Checking the band on left-out tests": 0.08 * n}
    if "fused" in approaches:
        mixture = {"Weights of the mixture": 0.8}
    return _EMULATOR | domain | _networks(approaches, config) | tuning | mixture


def _networks(approaches: Set[str], config: StudyConfig) -> dict[str, float]:
    names = {name for name in approaches if CLASSES[name].trains_networks}
    training = {"Training LF TCN": _TRAINING_S[config.preset]} if names else {}
    return training | ({"Derivatives of the LF networks": 1.0} if names - {"lf_tcn"} else {})
