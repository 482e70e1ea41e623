"""Provenance of a result: data, settings, versions, and the command that reproduces it."""

import platform
import shlex
from collections.abc import Sequence
from dataclasses import asdict, replace
from importlib import metadata

from crashfuse.approaches.registry import APPROACHES, label_of
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import ARCHIVE
from crashfuse.certification.certify import Certification
from crashfuse.certification.forecasts import SEEDS
from crashfuse.condition import Condition
from crashfuse.results.result_tables import about_cells
from crashfuse.signals.pulse import FloatArray
from crashfuse.study.config import TO_TTZV, StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.facts import campaign_facts
from crashfuse.study.recommendation import Recommendation
from crashfuse.units import MASS, MPH_LB, SPEED, SYSTEMS, UnitSystem, read_out
from crashfuse.version import COMPUTING, __version__

_PACKAGES = (*COMPUTING, "pandas", "plotly")


def provenance(campaign: Campaign, held_out: Sequence[str], config: StudyConfig) -> dict[str, object]:
    """Everything needed to reproduce a result, as plain JSON values."""
    return {
        "crashfuse": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "packages": {name: metadata.version(name) for name in _PACKAGES},
        "campaign": campaign.name,
        "notice": campaign.notice,
        "fingerprint": campaign.fingerprint,
        "channel_filter_class": campaign.channel_filter_class,
        "rating": campaign.rating_basis,
        "occupant": asdict(campaign.occupant),
        "cae_runs": len(campaign.cae),
        "cae_sha256": campaign.cae.fingerprint,
        "cae_about": about_cells(campaign.cae.about),
        "tests": list(campaign.test_ids),
        "archive": past_vehicles(campaign),
        "warnings": list(campaign.remarks),
        "facts": [fact.record for fact in campaign_facts(campaign)],
        "held_out": list(held_out),
        "seed": config.seed,
        "config": {name: value for name, value in asdict(config).items() if name != "preset" or config.under_preset},
    }


def past_vehicles(campaign: Campaign) -> str:
    """The archive that teaches a campaign, in a line; empty for none."""
    prior = campaign.prior
    return "" if prior is None else f"{read_out(prior.vehicles)}; SHA-256 {prior.fingerprint[:12]}"


def study_command(campaign: Campaign, held_out: Sequence[str], config: StudyConfig, units: UnitSystem = MPH_LB) -> str:
    """The command line that reproduces a study; the reader fills in the folders."""
    tests = [] if tuple(held_out) == campaign.test_ids else ["--held-out", *held_out]
    leave_out = ["--leave-out", config.leave_out.replace(" ", "-"), *(["--also", *config.also] if config.also else [])]
    return _command("study", [*tests, *_settings(config), *_windows(config), *leave_out, *_archive(campaign)], units)


def prediction_command(
    campaign: Campaign, condition: Condition, config: StudyConfig, units: UnitSystem = MPH_LB
) -> str:
    """The command line that reproduces a prediction."""
    settings = [*_settings(config), *_archive(campaign)]
    return _command("predict", [*_axes(units, condition), *_factors(condition), *settings], units)


def sweep_command(
    campaign: Campaign, condition: Condition, speeds_mps: FloatArray, config: StudyConfig, units: UnitSystem = MPH_LB
) -> str:
    """The command line that reproduces a sweep."""
    speeds, *weights = _AXES
    ends = [replace(condition, speed_mps=float(speed)) for speed in speeds_mps[[0, -1]]]
    at = [*_axes(units, *ends, only=[speeds]), *_axes(units, condition, only=weights)]
    return _command("sweep", [*at, *_factors(condition), *_settings(config), *_archive(campaign)], units)


def next_test_command(low: Condition, high: Condition, config: StudyConfig, units: UnitSystem = MPH_LB) -> str:
    """The command line that reproduces a ranking of next tests."""
    return _command("next-test", [*_axes(units, low, high), *_factors(low), "--seed", str(config.seed)], units)


def certification_settings(campaign: Campaign, config: StudyConfig, confidence: float) -> dict[str, str]:
    """What decides a certification's verdicts besides tests, criteria and matrix."""
    return {
        "campaign": campaign.name,
        "version": __version__,
        "approach": label_of(config.approaches[0]),
        **({"preset": config.preset} if config.under_preset else {}),
        "seeds": " and ".join(map(str, SEEDS)),
        "confidence": f"{confidence:g}",
        "CAE runs": f"{len(campaign.cae):,}, fingerprint {campaign.cae.fingerprint[:12]}",
        "tests' filter class": campaign.filter_class or "not given",
        "occupant model": campaign.occupant.words,
        "archive of past vehicles": past_vehicles(campaign) or "none",
    }


def certify_command(certification: Certification, units: UnitSystem = MPH_LB) -> str:
    """The command line that reproduces a certification from its criteria and matrix as files."""
    costs, options = certification.criteria.costs, ["--criteria", "criteria.toml", "--matrix", "matrix.csv"]
    options += ["--since", "EARLIER"] * (certification.since is not None) + ["--seal", "KEY"] * bool(certification.key)
    options += [] if costs is None else ["--costs", f"{costs.test:.10g}", f"{costs.wrong_answer:.10g}"]
    options += ["--robustness"] * any(own.left_out for own in certification.variants)
    options += _settings(certification.config, ("device",))
    return _command("certify", [*options, *_archive(certification.campaign)], units)


def learning_curve_command(
    campaign: Campaign, config: StudyConfig, repeats: int, cost: str, units: UnitSystem = MPH_LB
) -> str:
    """The command line that reproduces a learning curve."""
    settings = ["--approach", *config.approaches, "--seed", str(config.seed), *_windows(config), *_archive(campaign)]
    price = ["--cost-per-test", cost] if cost else []
    return _command("learning-curve", [*settings, "--repeats", str(repeats), *price], units)


_AXES = {"speed": "speed_mps", "front-weight": "front_weight_kg", "rear-weight": "rear_weight_kg"}


def _command(name: str, options: Sequence[str], units: UnitSystem) -> str:
    system = next(name for name, own in SYSTEMS.items() if own == units)
    return shlex.join(["crashfuse", name, "CAMPAIGN", "--out", "DIR", *options, "--units", system])


def _axes(units: UnitSystem, *conditions: Condition, only: Sequence[str] = tuple(_AXES)) -> list[str]:
    options: list[str] = []
    for axis, ending in zip(_AXES, units.endings, strict=True):
        if axis in only:
            values = [getattr(condition, _AXES[axis]) / (SPEED | MASS)[ending] for condition in conditions]
            options += [f"--{axis}-{ending}", *(f"{value:.10g}" for value in values)]
    return options


def _factors(condition: Condition) -> list[str]:
    return [f"--factor={name}={value}" for name, value in condition.factors if value]  # names may begin with a dash


def _settings(config: StudyConfig, others: Sequence[str] = ("seed", "device")) -> list[str]:
    approaches = [] if config.approaches == APPROACHES else ["--approach", *config.approaches]
    preset = ["--preset", config.preset] if config.under_preset else []
    return [*approaches, *preset, *(text for name in others for text in (f"--{name}", str(getattr(config, name))))]


def _archive(campaign: Campaign) -> list[str]:
    return [] if campaign.prior is None else ["--archive", ARCHIVE]


def _windows(config: StudyConfig) -> list[str]:
    return ["--windows-ms", *(f"{window:g}" for window in config.windows_ms), *[TO_TTZV] * config.to_ttzv]


def recommendation_record(advice: Recommendation) -> dict[str, object]:
    """A recommendation as plain JSON values."""
    return {
        "approach": advice.approach,
        "sentences": list(advice.sentences),
        "expected_rating": advice.expected and asdict(advice.expected),
    }


def fit_record(estimate: Estimate) -> dict[str, object]:
    """How an approach was fitted, as plain JSON values."""
    return {
        "approach": estimate.approach,
        "seconds": round(estimate.seconds, 3),
        "notes": list(estimate.notes),
        "state": estimate.state,
    }
