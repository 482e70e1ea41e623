"""Provenance of a result: data, settings, versions, and the command that reproduces it."""

import platform
import shlex
from collections.abc import Sequence
from dataclasses import asdict, replace
from importlib import metadata

from crashfuse.approaches.neighbours import nearest_sentences
from crashfuse.approaches.registry import APPROACHES, label_of
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import ARCHIVE
from crashfuse.certification.certify import Certification
from crashfuse.certification.forecasts import SEEDS
from crashfuse.condition import Condition
from crashfuse.signals.pulse import FloatArray
from crashfuse.signals.rating_explanation import rating_sentences
from crashfuse.study.config import TO_TTZV, StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.facts import campaign_facts, condition_facts, distinct
from crashfuse.study.prediction import PredictedPulse
from crashfuse.study.recommendation import Recommendation, recommend, recommend_without, study_facts
from crashfuse.study.study import Study
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
    """The command line that reproduces a ranking of next tests over a range, on the usual grid."""
    return _command("next-test", [*_axes(units, low, high), *_factors(low), "--seed", str(config.seed)], units)


def certification_settings(campaign: Campaign, config: StudyConfig, confidence: float) -> dict[str, str]:
    """What decides the verdicts of a certification besides tests, criteria and matrix, by names that readers know."""
    approach = config.approaches[0]
    return {
        "campaign": campaign.name,
        "version": __version__,
        "approach": label_of(approach),
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
    """A command line to be pasted into a shell, which takes every word of it as it is."""
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


def study_record(study: Study) -> dict[str, object]:
    """``study.json`` of a finished study."""
    campaign, config, groups = study.campaign, study.config, study.speed_groups
    window = max(config.windows_ms)
    tests = {}
    for fold in study.folds:
        advice = recommend_without(study, fold, window)
        rating = fold.ratings[advice.approach][window].overall
        tests[fold.held_out] = {
            **_recommendation(advice),
            "rating": rating,
            "outcome": advice.expected and advice.expected.outcome(rating),
            "why": rating_sentences(fold.explained(advice.approach, window))["overall"],
        }
    verdict = recommend(study)
    return {
        **provenance(campaign, [fold.held_out for fold in study.folds], config),
        "facts": [fact.record for fact in study_facts(study)],
        "finished": True,
        "seconds": {key: round(value, 3) for key, value in study.seconds.items()},
        "recommendation": {
            "campaign": {"approach": verdict.approach, "sentences": list(verdict.sentences)},
            "tests": tests,
        },
        "coverage": {name: coverage.counts for name, coverage in study.coverage.items()},
        "speed_groups": groups
        and {
            "mean_rating": {name: round(groups.mean_rating(name, window), 4) for name in config.approaches},
            "coverage": {name: coverage.counts for name, coverage in groups.coverage.items()},
        },
        "rating_intervals": {
            fold.held_out: {
                name: {f"{w:g}": [round(end, 4) for end in fold.rating_interval(name, w)] for w in config.windows_ms}
                for name in fold.with_band
            }
            for fold in study.folds
        },
        "repeatability": {
            fold.held_out: {
                f"{w:g}": {end: round(getattr(repeat, end), 4) for end in ("value", "lower", "upper")}
                for w, repeat in study.repeatability.get(fold.held_out, {}).items()
            }
            for fold in study.folds
        },
        "fits": [
            {"held_out": fold.held_out, **_fit_record(estimate)} for fold in study.folds for estimate in fold.estimates
        ],
    }


def prediction_record(prediction: PredictedPulse) -> dict[str, object]:
    """``prediction.json``."""
    campaign, condition, recommended = prediction.campaign, prediction.condition, prediction.recommendation
    advice = _recommendation(recommended)
    expected = advice.pop("expected_rating")
    here = distinct([*condition_facts(campaign, condition), *recommended.facts])
    return {
        **provenance(campaign, (), prediction.config),
        "condition": {k: v for k, v in asdict(condition).items() if k != "units"},
        "extrapolation": list(campaign.cae.extrapolation(condition)),
        "facts_here": [fact.record for fact in here],
        "nearest": list(nearest_sentences(campaign, condition)),
        "recommendation": advice,
        "expected_rating": expected,
        "fits": [_fit_record(estimate) for estimate in prediction.estimates],
    }


def _recommendation(advice: Recommendation) -> dict[str, object]:
    return {
        "approach": advice.approach,
        "sentences": list(advice.sentences),
        "expected_rating": advice.expected and asdict(advice.expected),
    }


def _fit_record(estimate: Estimate) -> dict[str, object]:
    return {
        "approach": estimate.approach,
        "seconds": round(estimate.seconds, 3),
        "notes": list(estimate.notes),
        "state": estimate.state,
    }
