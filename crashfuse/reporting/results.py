"""Writers of the files of a study, prediction, sweep, ranking or certification: tables, settings and report."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.notes import Note
from crashfuse.certification.certify import Certification
from crashfuse.certification.earlier import Earlier, read_earlier
from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.files.atomic import write_atomically
from crashfuse.files.csv_text import csv_bytes
from crashfuse.reporting.certification_record import certification_json
from crashfuse.reporting.certification_tables import (
    certification_table,
    changes_table,
    csv_as_given,
    track_record_table,
)
from crashfuse.reporting.exports import parquet_bytes
from crashfuse.reporting.outgoing_pulses import PULSE_FORMATS, PulseExport, PulseFiles
from crashfuse.reporting.planning import NextTests, SpeedSweep
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.predicted import PredictedPulse
from crashfuse.reporting.provenance import learning_curve_record, prediction_record, provenance, study_record
from crashfuse.reporting.report import (
    certification_report,
    learning_curve_report,
    next_test_report,
    prediction_report,
    study_report,
    sweep_report,
)
from crashfuse.reporting.report.page import ReportForm, ReportOptions
from crashfuse.study.config import StudyConfig, StudyPlan
from crashfuse.study.estimate import Estimate
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.study.one_more_test import Cost
from crashfuse.study.study import Study

Content = bytes | dict[str, bytes] | None
"""Of a file; of the files of a folder, by relative path; None if the result has no such file."""


@dataclass(frozen=True, slots=True)
class StudyRecord:
    """Content of ``study.json`` before a study ends: enough to continue one that was killed."""

    fingerprint: str
    held_out: tuple[str, ...]
    config: StudyConfig


def begin_study(folder: Path, plan: StudyPlan) -> None:
    """Record in ``study.json`` what is about to be computed, so that it can be resumed."""
    record = provenance(plan.campaign, plan.held_out, plan.config)
    write_atomically(folder / "study.json", _json({**record, "finished": False}))


def read_record(folder: Path) -> StudyRecord:
    """Read which study was being computed in this folder; raises if there is none or ``study.json`` is damaged."""
    path = folder / "study.json"
    if not path.is_file():
        raise UsageError(f"There is no study to resume in {folder}: it has no study.json. Leave out --resume.")
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        return StudyRecord(values["fingerprint"], tuple(values["held_out"]), StudyConfig.parse(values["config"]))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        advice = "start the study again without --resume"
        raise DataError(Problem(str(path), "the record of a study", f"{error!r}", advice)) from error


def write_study(
    study: Study, folder: str | Path, display: Display = DEFAULT, report: ReportOptions = ReportOptions()
) -> None:
    """Write the results of a study, its report in these units and this form.

    ``scores.csv``, ``pulses.csv``, ``metrics.csv``, ``report.html``; ``speed_groups.csv``, the scores with whole speed
    groups left out, if requested; and, last, ``study.json``.

    Raises
    ------
    OSError
        If the folder cannot be written.
    """
    _write(_STUDY, folder, study, display, report)


def write_prediction(
    prediction: PredictedPulse,
    folder: str | Path,
    display: Display = DEFAULT,
    export: PulseExport = PulseExport(),
    report: ReportForm = "whole",
) -> None:
    """Write the prediction at one new condition.

    ``pulses.csv`` and ``.parquet``, ``metrics.csv``, ``report.html``; the pulses for an occupant model in ``isomme/``,
    ``lsdyna/`` and ``radioss/``, whichever are asked for; and ``prediction.json`` with the condition, whether it lies
    outside the CAE runs, the expected rating, and how the fits went.

    Raises
    ------
    OSError
        If the folder cannot be written.
    UsageError
        If there are fewer draws than are to be exported.
    """
    _write(_PREDICTION, folder, prediction, export.files(prediction.campaign, prediction.estimates), display, report)


def write_sweep(sweep: SpeedSweep, folder: str | Path, display: Display = DEFAULT) -> None:
    """Write ``sweep.csv``, with the tests' own metrics, and ``report.html``."""
    _write(_SWEEP, folder, sweep, display)


def write_pulses(campaign: Campaign, estimates: Sequence[Estimate], folder: Path, export: PulseExport) -> None:
    """Write the pulses at one speed of a sweep for an occupant model, into a folder named by the speed in each format.

    Raises
    ------
    OSError
        If the folder cannot be written.
    UsageError
        If there are fewer draws than are to be exported.
    """
    speed = estimates[0].prediction.condition.speed_name
    for name, files in export.files(campaign, estimates).items():
        for path, content in files.items():
            write_atomically(folder / name / speed / path, content)


def write_next_tests(ranking: NextTests, folder: str | Path, display: Display = DEFAULT) -> None:
    """Write ``next_tests.csv``, the best first, and ``report.html``."""
    _write(_NEXT_TESTS, folder, ranking, display)


def write_certification(
    certification: Certification,
    folder: str | Path,
    display: Display = DEFAULT,
    since: str | Path | Earlier | None = None,
    notes: Sequence[Note] = (),
) -> None:
    """Write ``certification.csv``, ``track_record.csv``, ``report.html`` and, last, ``certification.json``.

    ``since`` is an earlier certification's ``certification.json``, or its folder: ``changes.csv`` and the report then
    tell what became of it. ``notes`` on the campaign's tests stand in the report.

    Raises
    ------
    OSError
        If the folder cannot be written.
    DataError
        If there is no such earlier certification.
    """
    earlier = read_earlier(Path(since)) if isinstance(since, str | Path) else since
    _write(_CERTIFICATION, folder, certification if earlier is None else certification.beside(earlier), display, notes)


def write_learning_curve(
    curve: LearningCurve, folder: str | Path, display: Display = DEFAULT, cost: Cost | None = None
) -> None:
    """Write ``learning_curve.csv``, ``report.html`` and, last, ``learning_curve.json``; cost is that of one test.

    Raises
    ------
    OSError
        If the folder cannot be written.
    """
    _write(_LEARNING_CURVE, folder, curve, cost, display)


def _write(files: Mapping[str, Callable[..., Content]], folder: str | Path, *result: object) -> None:
    for name, make in files.items():
        content = make(*result)
        for path, own in (content if isinstance(content, dict) else {"": content}).items():
            if own is not None:
                write_atomically(Path(folder, name, path), own)


def _json(values: Mapping[str, object]) -> bytes:
    return (json.dumps(values, indent=2, ensure_ascii=False) + "\n").encode()


_STUDY: Mapping[str, Callable[[Study, Display, ReportOptions], Content]] = {
    "scores.csv": lambda study, *_: csv_bytes(study.scores),
    "speed_groups.csv": lambda study, *_: None if study.speed_groups is None else csv_bytes(study.speed_groups.scores),
    "pulses.csv": lambda study, *_: csv_bytes(study.pulses),
    "metrics.csv": lambda study, *_: csv_bytes(study.metrics),
    "report.html": lambda *result: study_report(*result).encode(),
    "study.json": lambda study, *_: _json(study_record(study)),
}
_PREDICTION: Mapping[str, Callable[[PredictedPulse, PulseFiles, Display, ReportForm], Content]] = {
    "pulses.csv": lambda prediction, *_: csv_bytes(prediction.pulses),
    "pulses.parquet": lambda prediction, *_: parquet_bytes(prediction.pulses),
    "metrics.csv": lambda prediction, *_: csv_bytes(prediction.metrics),
    "report.html": lambda prediction, _, display, form: prediction_report(
        prediction.campaign, prediction.estimates, prediction.config, display, form=form
    ).encode(),
    **{f"{name}/": (lambda *result, name=name: result[1].get(name)) for name in PULSE_FORMATS},
    "prediction.json": lambda prediction, *_: _json(
        prediction_record(prediction.campaign, prediction.estimates, prediction.config)
    ),
}
_SWEEP: Mapping[str, Callable[[SpeedSweep, Display], Content]] = {
    "report.html": lambda sweep, display: sweep_report(sweep, display).encode(),
    "sweep.csv": lambda sweep, *_: csv_bytes(sweep.table),
}
_NEXT_TESTS: Mapping[str, Callable[[NextTests, Display], Content]] = {
    "report.html": lambda ranking, display: next_test_report(ranking, display).encode(),
    "next_tests.csv": lambda ranking, *_: csv_bytes(ranking.table),
}
_CERTIFICATION: Mapping[str, Callable[[Certification, Display, Sequence[Note]], Content]] = {
    "certification.csv": lambda certification, *_: csv_as_given(certification_table(certification)),
    "track_record.csv": lambda certification, *_: csv_bytes(track_record_table(certification)),
    "changes.csv": lambda certification, *_: (
        None if certification.since is None else csv_as_given(changes_table(certification))
    ),
    "report.html": lambda *result: certification_report(*result).encode(),
    "certification.json": lambda certification, *_: certification_json(certification),
}
_LEARNING_CURVE: Mapping[str, Callable[[LearningCurve, Cost | None, Display], Content]] = {
    "learning_curve.csv": lambda curve, *_: csv_bytes(curve.table),
    "report.html": lambda *result: learning_curve_report(*result).encode(),
    "learning_curve.json": lambda *result: _json(learning_curve_record(*result[:2])),
}
RESULT_FILES = {
    "series of studies": ("studies.csv",),
    "study": tuple(_STUDY),
    "prediction": tuple(_PREDICTION),
    "sweep": (*(f"{name}/" for name in PULSE_FORMATS), *_SWEEP),
    "ranking of next tests": tuple(_NEXT_TESTS),
    "certification": tuple(_CERTIFICATION),
    "learning curve": tuple(_LEARNING_CURVE),
}
"""Files and folders of each kind of result, some of which may be missing; the last, written last, tells the kind."""
