"""Files of a study, prediction, sweep, ranking, learning curve or certification: tables, settings and report."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from crashfuse.approaches.registry import CLASSES
from crashfuse.campaign import Campaign
from crashfuse.certification.seal import REVIEW, SEAL
from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.files.atomic import write_atomically, written_together
from crashfuse.files.csv_text import csv_bytes
from crashfuse.results import certification_tables as tables
from crashfuse.results import prediction_report as reports
from crashfuse.results.certification_record import certification_json
from crashfuse.results.certification_report import certification_report
from crashfuse.results.credibility import credibility_table
from crashfuse.results.display import Display
from crashfuse.results.export.outgoing_pulses import PULSE_FORMATS, PulseExport
from crashfuse.results.fit_explanations import events_frame, study_events
from crashfuse.results.provenance import prediction_record, provenance, study_record
from crashfuse.results.render.html import report
from crashfuse.results.render.text import json_bytes, parquet_bytes
from crashfuse.results.result import Content, Result
from crashfuse.results.study_report import study_report
from crashfuse.study.config import StudyConfig, StudyPlan
from crashfuse.study.estimate import Estimate


def begin_study(folder: Path, plan: StudyPlan) -> None:
    """Record in ``study.json`` what is about to be computed, so that it can be resumed."""
    record = provenance(plan.campaign, plan.held_out, plan.config)
    write_atomically(folder / "study.json", json_bytes({**record, "finished": False}))


def read_begun(folder: Path) -> tuple[str, tuple[str, ...], StudyConfig]:
    """Fingerprint, held-out tests and settings of the study that was begun here; raises if none is, or no longer."""
    path = folder / "study.json"
    if not path.is_file():
        raise UsageError(f"There is no study to resume in {folder}: it has no study.json. Leave out --resume.")
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        return values["fingerprint"], tuple(values["held_out"]), StudyConfig.parse(values["config"])
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        advice = "start the study again without --resume"
        raise DataError(Problem(str(path), "the record of a study", f"{error!r}", advice)) from error


def write_result(result: Result, folder: str | Path, display: Display | None = None) -> None:
    """Replace what a folder holds of this kind of result, by its files and its report."""
    with replaced(result.kind, Path(folder)) as staging:
        write_files(result, staging, display)


def write_files(result: Result, folder: Path, display: Display | None = None) -> None:
    """Write the files of a result and its report, in their order."""
    made: dict[str, Callable[[], Content]] = {**result.files, REPORT: lambda: report(result, display)}
    for name in filter(made.__contains__, RESULT_FILES[result.kind]):
        content = made[name]()
        for path, data in (content if isinstance(content, Mapping) else {"": content}).items():
            if data is not None:
                write_atomically(folder / name / path, data.encode() if isinstance(data, str) else data)


def write_old(kind: str, folder: str | Path, *result: object) -> None:  # until all kinds are results
    """Replace what a folder holds of a kind of result; what follows is what each of its files is made of."""
    with replaced(kind, Path(folder)) as staging:
        for name, make in _FILES[kind].items():
            content = make(*result)
            for path, data in (content if isinstance(content, Mapping) else {"": content}).items():
                if data is not None:
                    write_atomically(staging / name / path, data.encode() if isinstance(data, str) else data)


@contextmanager
def replaced(kind: str, folder: Path) -> Iterator[Path]:
    """A folder to write a result into, whose files then take the place of all files of an older one of this kind.

    The record goes first and comes last: wherever the machine stops, no record stands beside files of another result.
    Files that are not named as this program names its results stay.
    """
    *others, record = RESULT_FILES[kind]
    of_pulses = tuple(f"{name}_" for name in CLASSES.declared)
    with written_together(folder, last=record) as staging:
        yield staging
        (folder / record).unlink(missing_ok=True)
        places = [place for name in others for place in (folder / name, *(folder / name).rglob("*"))]
        for path in filter(Path.is_file, places):
            parts = path.relative_to(folder).parts
            is_ours = len(parts) == 1 or any(part.startswith(of_pulses) for part in parts)
            if is_ours and not staging.joinpath(*parts).exists():
                path.unlink()
        for empty in sorted(filter(Path.is_dir, places), reverse=True):  # the inner ones first
            with suppress(OSError):  # it still holds something
                empty.rmdir()


def write_pulses(campaign: Campaign, folder: Path, export: PulseExport, estimates: Sequence[Estimate]) -> None:
    """Write the pulses at one speed of a sweep for an occupant model, into a folder by format and speed."""
    speed = estimates[0].condition.speed_name
    for name, files in export.files(campaign, estimates).items():
        for path, content in files.items():
            write_atomically(folder / name / speed / path, content)


_FILES: Mapping[str, Mapping[str, Callable[..., Content]]] = {
    "study": {  # of the study, the display and the options of the report
        "scores.csv": lambda study, *_: csv_bytes(study.scores),
        "speed_groups.csv": lambda study, *_: study.speed_groups and csv_bytes(study.speed_groups.scores),
        "pulses.csv": lambda study, *_: csv_bytes(study.pulses),
        "metrics.csv": lambda study, *_: csv_bytes(study.metrics),
        "cae_events.csv": lambda study, *_: csv_bytes(events_frame(found)) if (found := study_events(study)) else None,
        "report.html": study_report,
        "study.json": lambda study, *_: json_bytes(study_record(study)),
    },
    "prediction": {  # of the prediction, its outgoing pulses, the display and the form of the report
        "pulses.csv": lambda prediction, *_: csv_bytes(prediction.pulses),
        "pulses.parquet": lambda prediction, *_: parquet_bytes(prediction.pulses),
        "metrics.csv": lambda prediction, *_: csv_bytes(prediction.metrics),
        "report.html": lambda own, _, display, form: reports.prediction_report(own, display, form=form),
        **{f"{name}/": (lambda _, pulses, *_rest, name=name: pulses.get(name)) for name in PULSE_FORMATS},
        "prediction.json": lambda own, *_: json_bytes(prediction_record(own)),
    },
    "certification": {  # of the certification, the display and notes
        "certification.csv": lambda certification, *_: tables.csv_as_given(tables.certification_table(certification)),
        "track_record.csv": lambda certification, *_: csv_bytes(tables.track_record_table(certification)),
        "credibility.csv": lambda certification, *_: csv_bytes(credibility_table(certification)),
        "report.html": certification_report,
        "certification.json": lambda certification, *_: certification_json(certification),
    },
}

REPORT = "report.html"
RESULT_FILES = {
    "series of studies": ("studies.csv",),
    **{kind: tuple(files) for kind, files in _FILES.items()},
    "certification": (SEAL, REVIEW, *_FILES["certification"]),
    "sweep": (*(f"{name}/" for name in PULSE_FORMATS), REPORT, "sweep.csv"),
    "ranking of next tests": (REPORT, "next_tests.csv"),
    "learning curve": ("learning_curve.csv", REPORT, "learning_curve.json"),
}
"""Files and folders of each kind of result, some of which may be missing; the last, written last, tells the kind."""
