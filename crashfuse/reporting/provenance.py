"""Provenance of a result: data, settings, versions, and the command that reproduces it."""

import platform
from collections.abc import Sequence
from dataclasses import asdict, replace
from importlib import metadata

from crashfuse.approaches.registry import APPROACHES, LABELS
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.signals.pulse import FloatArray
from crashfuse.study.config import StudyConfig
from crashfuse.version import __version__
from crashfuse.wording import MPH_LB, SYSTEMS, UnitSystem

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
        "warnings": list(campaign.remarks),
        "held_out": list(held_out),
        "seed": config.seed,
        "config": asdict(config),
    }


def study_command(campaign: Campaign, held_out: Sequence[str], config: StudyConfig, units: UnitSystem = MPH_LB) -> str:
    """The command line that reproduces a study; the reader fills in the folders."""
    tests = "" if tuple(held_out) == campaign.test_ids else f" --held-out {' '.join(map(_quoted, held_out))}"
    windows = " ".join(f"{window:g}" for window in config.windows_ms)
    way = config.leave_out.replace(" ", "-")
    settings = f"{_settings(config)} --windows-ms {windows} --leave-out {way}{_units(units)}"
    return f"crashfuse study CAMPAIGN --out DIR{tests}{settings}"


def prediction_command(condition: Condition, config: StudyConfig, units: UnitSystem = MPH_LB) -> str:
    """The command line that reproduces a prediction."""
    at = _axes(units, condition)
    return f"crashfuse predict CAMPAIGN{at}{_factors(condition)} --out DIR{_settings(config)}{_units(units)}"


def sweep_command(condition: Condition, speeds_mps: FloatArray, config: StudyConfig, units: UnitSystem = MPH_LB) -> str:
    """The command line that reproduces a sweep."""
    speeds, *weights = _AXES
    ends = [replace(condition, speed_mps=float(speed)) for speed in speeds_mps[[0, -1]]]
    at = _axes(units, *ends, only=[speeds]) + _axes(units, condition, only=weights)
    return f"crashfuse sweep CAMPAIGN{at}{_factors(condition)} --out DIR{_settings(config)}{_units(units)}"


def next_test_command(low: Condition, high: Condition, config: StudyConfig, units: UnitSystem = MPH_LB) -> str:
    """The command line that reproduces a ranking of next tests over a range, on the usual grid."""
    over = f"{_axes(units, low, high)}{_factors(low)}"
    return f"crashfuse next-test CAMPAIGN{over} --out DIR --seed {config.seed}{_units(units)}"


def certification_settings(campaign: Campaign, config: StudyConfig, confidence: float) -> dict[str, str]:
    """What decides the verdicts of a certification besides tests, criteria and matrix, by names that readers know."""
    approach = config.approaches[0]
    return {
        "campaign": campaign.name,
        "version": __version__,
        "approach": LABELS.get(approach, approach),
        "preset": config.preset,
        "seed": str(config.seed),
        "confidence": f"{confidence:g}",
        "CAE runs": f"{len(campaign.cae):,}, fingerprint {campaign.cae.fingerprint[:12]}",
        "tests' filter class": campaign.filter_class or "not given",
        "occupant model": campaign.occupant.words,
    }


def certify_command(config: StudyConfig, units: UnitSystem = MPH_LB, *, since: bool = False) -> str:
    """The command line that reproduces a certification from its criteria and matrix as files."""
    files = "--criteria criteria.toml --matrix matrix.csv" + " --since EARLIER" * since
    return f"crashfuse certify CAMPAIGN {files} --out DIR{_settings(config)}{_units(units)}"


def learning_curve_command(config: StudyConfig, repeats: int, cost: str, units: UnitSystem = MPH_LB) -> str:
    """The command line that reproduces a learning curve."""
    windows = " ".join(f"{window:g}" for window in config.windows_ms)
    approaches = f" --approach {' '.join(config.approaches)}"
    settings = f"{approaches} --seed {config.seed} --windows-ms {windows} --repeats {repeats}"
    price = f" --cost-per-test {_quoted(cost)}" if cost else ""
    return f"crashfuse learning-curve CAMPAIGN --out DIR{settings}{price}{_units(units)}"


_AXES = {"speed": "speed_mps", "front-weight": "front_weight_kg", "rear-weight": "rear_weight_kg"}


def _axes(units: UnitSystem, *conditions: Condition, only: Sequence[str] = tuple(_AXES)) -> str:
    """Options for speed and weights, each with its value at these conditions."""
    said = ""
    for axis in only:
        unit = "mph" if axis == "speed" else "lb"
        in_si, ending = units.in_si(unit), units.unit(unit).replace("km/h", "kph")
        values = (f"{getattr(condition, _AXES[axis]) / in_si:.10g}" for condition in conditions)
        said += f" --{axis}-{ending} {' '.join(values)}"
    return said


def _units(units: UnitSystem) -> str:
    """The option for the units of the report."""
    return f" --units {next(name for name, own in SYSTEMS.items() if own == units)}"


def _factors(condition: Condition) -> str:
    factors = [_quoted(f"{name}={value}") for name, value in condition.factors if value]
    return f" --factor {' '.join(factors)}" if factors else ""


def _settings(config: StudyConfig) -> str:
    approaches = "" if config.approaches == APPROACHES else f" --approach {' '.join(config.approaches)}"
    return f"{approaches} --preset {config.preset} --seed {config.seed} --device {config.device}"


def _quoted(text: str) -> str:
    return text if text.replace("_", "").replace("-", "").replace("=", "").isalnum() else f'"{text}"'
