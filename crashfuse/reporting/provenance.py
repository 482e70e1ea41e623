"""Provenance of a result: data, settings, versions, and the command that reproduces it."""

import platform
from collections.abc import Sequence
from dataclasses import asdict
from importlib import metadata

from crashfuse.approaches.registry import APPROACHES
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.signals.pulse import FloatArray
from crashfuse.study.config import StudyConfig
from crashfuse.units import LB, MPH
from crashfuse.version import __version__

_PACKAGES = ("numpy", "scipy", "scikit-learn", "torch", "pandas", "plotly")


def provenance(campaign: Campaign, held_out: Sequence[str], config: StudyConfig) -> dict[str, object]:
    """Everything needed to reproduce a result, as plain JSON values."""
    versions = {name: metadata.version(name) for name in _PACKAGES}
    return {
        "crashfuse": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "packages": versions,
        "campaign": campaign.name,
        "notice": campaign.notice,
        "fingerprint": campaign.fingerprint,
        "channel_filter_class": campaign.channel_filter_class,
        "rating": campaign.rating_basis,
        "occupant": asdict(campaign.occupant),
        "cae_runs": len(campaign.cae),
        "tests": list(campaign.test_ids),
        "warnings": list(campaign.warnings),
        "held_out": list(held_out),
        "seed": config.seed,
        "config": asdict(config),
    }


def study_command(campaign: Campaign, held_out: Sequence[str], config: StudyConfig) -> str:
    """The command line that reproduces a study; the reader fills in the folders."""
    tests = "" if tuple(held_out) == campaign.test_ids else f" --held-out {' '.join(map(_quoted, held_out))}"
    windows = " ".join(f"{window:g}" for window in config.windows_ms)
    way = config.leave_out.replace(" ", "-")
    return f"crashfuse study CAMPAIGN --out DIR{tests}{_settings(config)} --windows-ms {windows} --leave-out {way}"


def prediction_command(condition: Condition, config: StudyConfig) -> str:
    """The command line that reproduces a prediction."""
    speed = f" --speed-mph {condition.speed_mps / MPH:.10g}"
    return f"crashfuse predict CAMPAIGN{speed}{_vehicle(condition)} --out DIR{_settings(config)}"


def sweep_command(condition: Condition, speeds_mps: FloatArray, config: StudyConfig) -> str:
    """The command line that reproduces a sweep."""
    speeds = f" --speed-mph {speeds_mps[0] / MPH:.10g} {speeds_mps[-1] / MPH:.10g}"
    return f"crashfuse sweep CAMPAIGN{speeds}{_vehicle(condition)} --out DIR{_settings(config)}"


def next_test_command(low: Condition, high: Condition, config: StudyConfig) -> str:
    """The command line that reproduces a ranking of next tests over a range, on the usual grid."""
    flags = (("--speed-mph", MPH), ("--front-weight-lb", LB), ("--rear-weight-lb", LB))
    limits = zip(flags, low.vector.tolist(), high.vector.tolist(), strict=True)
    over = "".join(f" {flag} {a / unit:.10g} {b / unit:.10g}" for (flag, unit), a, b in limits)
    return f"crashfuse next-test CAMPAIGN{over}{_factors(low)} --out DIR --seed {config.seed}"


def certify_command(config: StudyConfig) -> str:
    """The command line that reproduces a certification from its criteria and matrix as files."""
    return f"crashfuse certify CAMPAIGN --criteria criteria.toml --matrix matrix.csv --out DIR{_settings(config)}"


def learning_curve_command(config: StudyConfig, repeats: int, cost: str) -> str:
    """The command line that reproduces a learning curve."""
    windows = " ".join(f"{window:g}" for window in config.windows_ms)
    approaches = f" --approach {' '.join(config.approaches)}"
    settings = f"{approaches} --seed {config.seed} --windows-ms {windows} --repeats {repeats}"
    price = f" --cost-per-test {_quoted(cost)}" if cost else ""
    return f"crashfuse learning-curve CAMPAIGN --out DIR{settings}{price}"


def _vehicle(condition: Condition) -> str:
    front, rear = condition.front_weight_kg / LB, condition.rear_weight_kg / LB
    return f" --front-weight-lb {front:.10g} --rear-weight-lb {rear:.10g}{_factors(condition)}"


def _factors(condition: Condition) -> str:
    factors = [_quoted(f"{name}={value}") for name, value in condition.factors if value]
    return f" --factor {' '.join(factors)}" if factors else ""


def _settings(config: StudyConfig) -> str:
    approaches = "" if config.approaches == APPROACHES else f" --approach {' '.join(config.approaches)}"
    return f"{approaches} --preset {config.preset} --seed {config.seed} --device {config.device}"


def _quoted(text: str) -> str:
    return text if text.replace("_", "").replace("-", "").replace("=", "").isalnum() else f'"{text}"'
