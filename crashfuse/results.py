"""The files that a study and a prediction write: tables, settings and report, each whole or not at all."""

import json
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign
from crashfuse.config import StudyConfig
from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.estimate import Estimate
from crashfuse.files import write_atomically
from crashfuse.metrics import Metric, pulse_metrics
from crashfuse.report import prediction_report, study_report
from crashfuse.study import Study
from crashfuse.units import MS, G
from crashfuse.version import __version__

_PACKAGES = ("numpy", "scipy", "scikit-learn", "torch", "pandas", "plotly")


def scores_table(study: Study) -> pd.DataFrame:
    """One row a held-out test, approach and window: overall rating, its four parts, its grade."""
    return pd.DataFrame(
        {"held_out": fold.held_out, "approach": approach, "window_ms": window, **asdict(rating)}
        for fold in study.folds
        for approach, ratings in fold.ratings.items()
        for window, rating in ratings.items()
    )


def pulses_table(estimates: Iterable[tuple[str, Estimate]]) -> pd.DataFrame:
    """Predicted pulses in ms and g with the central 95 % band, empty where an approach has none.

    Parameters
    ----------
    estimates : iterable of (str, Estimate)
        With the id of the held-out test, or an empty text for a new condition.
    """
    return pd.concat(
        [_pulse_rows(held_out, estimate.approach, estimate.prediction) for held_out, estimate in estimates]
    )


def metrics_table(rows: Iterable[tuple[str, str, Sequence[Metric]]]) -> pd.DataFrame:
    """Pulse metrics, one row each, from (held-out test, approach or ``test``, metrics)."""
    return pd.DataFrame(
        [
            {
                "held_out": held_out,
                "approach": approach,
                "metric": metric.name,
                "value": metric.value,
                "lower": metric.lower,
                "upper": metric.upper,
                "unit": metric.unit,
            }
            for held_out, approach, metrics in rows
            for metric in metrics
        ],
        columns=["held_out", "approach", "metric", "value", "lower", "upper", "unit"],
    )


def study_metrics(study: Study) -> pd.DataFrame:
    """Pulse metrics of every held-out test as measured (``test``) and as predicted."""
    rows: list[tuple[str, str, Sequence[Metric]]] = []
    for fold in study.folds:
        test = study.campaign.test(fold.held_out)
        measured = pulse_metrics(test.pulse.accel_mps2, test.condition.speed_mps, dt_s=test.pulse.dt_s)
        rows.append((fold.held_out, "test", measured))
        rows.extend((fold.held_out, estimate.approach, estimate.metrics) for estimate in fold.estimates)
    return metrics_table(rows)


@dataclass(frozen=True, slots=True)
class StudyRecord:
    """What ``study.json`` says of a study before it ends: enough to continue one that was killed."""

    fingerprint: str
    held_out: tuple[str, ...]
    config: StudyConfig


def begin_study(folder: Path, campaign: Campaign, held_out: Sequence[str], config: StudyConfig) -> None:
    """Note in ``study.json`` what is about to be computed, so that it can be resumed."""
    _write_json(folder / "study.json", {**_provenance(campaign, held_out, config), "finished": False})


def read_record(folder: Path) -> StudyRecord:
    """Read what was being computed in this folder.

    Raises
    ------
    UsageError
        If the folder holds no study.
    DataError
        If its ``study.json`` is damaged.
    """
    path = folder / "study.json"
    if not path.is_file():
        raise UsageError(f"There is no study to resume in {folder}: it has no study.json. Leave out --resume.")
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        settings: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in values["config"].items()
        }
        return StudyRecord(
            values["fingerprint"],
            tuple(values["held_out"]),
            StudyConfig(**settings),
        )
    except (ValueError, KeyError, TypeError) as error:
        advice = "start the study again without --resume"
        raise DataError(Problem(str(path), "the record of a study", f"{error!r}", advice)) from error


def write_study(study: Study, folder: str | Path) -> None:
    """Write ``scores.csv``, ``pulses.csv``, ``metrics.csv``, ``report.html`` and, last, ``study.json``.

    Raises
    ------
    OSError
        If the folder cannot be written.
    """
    folder = Path(folder)
    named = [(fold.held_out, estimate) for fold in study.folds for estimate in fold.estimates]
    scores, metrics = scores_table(study), study_metrics(study)
    _write_csv(folder / "scores.csv", scores)
    _write_csv(folder / "pulses.csv", pulses_table(named))
    _write_csv(folder / "metrics.csv", metrics)
    held_out = [fold.held_out for fold in study.folds]
    record = {
        **_provenance(study.campaign, held_out, study.config),
        "finished": True,
        "seconds": {key: round(value, 3) for key, value in study.seconds.items()},
        "coverage": {name: found.counts for name, found in study.coverage.items()},
        "fits": [{"held_out": held_out, **_fit_record(estimate)} for held_out, estimate in named],
    }
    write_atomically(folder / "report.html", study_report(study, scores, metrics, record).encode())
    _write_json(folder / "study.json", record)


def write_prediction(
    campaign: Campaign, estimates: Sequence[Estimate], config: StudyConfig, folder: str | Path
) -> pd.DataFrame:
    """Write what is predicted at one new condition; returns the metrics.

    ``pulses.csv``, ``metrics.csv``, ``report.html``, and ``prediction.json`` with the condition, whether it lies
    outside the CAE runs, and how the fits went.

    Raises
    ------
    OSError
        If the folder cannot be written.
    """
    folder = Path(folder)
    metrics = metrics_table(("", estimate.approach, estimate.metrics) for estimate in estimates)
    _write_csv(folder / "pulses.csv", pulses_table(("", estimate) for estimate in estimates))
    _write_csv(folder / "metrics.csv", metrics)
    condition = estimates[0].prediction.condition
    record = {
        **_provenance(campaign, (), config),
        "condition": asdict(condition),
        "extrapolation": list(campaign.cae.extrapolation(condition)),
        "fits": [_fit_record(estimate) for estimate in estimates],
    }
    write_atomically(folder / "report.html", prediction_report(campaign, estimates, metrics, record).encode())
    _write_json(folder / "prediction.json", record)
    return metrics


def _pulse_rows(held_out: str, approach: str, prediction: Prediction) -> pd.DataFrame:
    lower, upper = prediction.band() or (np.full(prediction.time_s.size, np.nan),) * 2
    return pd.DataFrame(
        {
            "held_out": held_out,
            "approach": approach,
            "time_ms": (prediction.time_s / MS).round(6),
            "acceleration_g": prediction.accel_mps2 / G,
            "lower_g": lower / G,
            "upper_g": upper / G,
        }
    )


def _provenance(campaign: Campaign, held_out: Sequence[str], config: StudyConfig) -> dict[str, object]:
    versions = {name: metadata.version(name) for name in _PACKAGES}
    return {
        "crashfuse": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "packages": versions,
        "campaign": campaign.name,
        "notice": campaign.notice,
        "fingerprint": campaign.fingerprint,
        "cae_runs": len(campaign.cae),
        "tests": list(campaign.test_ids),
        "warnings": list(campaign.warnings),
        "held_out": list(held_out),
        "seed": config.seed,
        "config": asdict(config),
    }


def _fit_record(estimate: Estimate) -> dict[str, object]:
    return {
        "approach": estimate.approach,
        "seconds": round(estimate.seconds, 3),
        "notes": list(estimate.prediction.notes),
        "state": estimate.state,
    }


def _write_csv(path: Path, table: pd.DataFrame) -> None:
    write_atomically(path, table.to_csv(index=False, float_format="%.6g", lineterminator="\n").encode())


def _write_json(path: Path, values: Mapping[str, object]) -> None:
    write_atomically(path, (json.dumps(values, indent=2, ensure_ascii=False) + "\n").encode())
