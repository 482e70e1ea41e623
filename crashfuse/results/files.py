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
from crashfuse.results.display import Display
from crashfuse.results.export.outgoing_pulses import PULSE_FORMATS, PulseExport
from crashfuse.results.provenance import provenance
from crashfuse.results.render.html import report
from crashfuse.results.render.text import json_bytes
from crashfuse.results.result import Content, Result
from crashfuse.study.config import StudyConfig, StudyPlan
from crashfuse.study.estimate import Estimate
from crashfuse.units import UnitSystem


def begin_study(folder: Path, plan: StudyPlan) -> None:
    """Record in ``study.json`` what is about to be computed, so that it can be resumed."""
    record = provenance(plan.campaign, plan.held_out, plan.config)
    write_atomically(folder / "study.json", json_bytes({**record, "finished": False}))


def read_begun(folder: Path) -> tuple[str, tuple[str, ...], StudyConfig]:
    """Fingerprint, held-out tests and settings of a study begun here; raises if none is."""
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
    shown = result.usual_display if display is None else display
    made: dict[str, Callable[[], Content]] = {**result.files_in(shown.system), REPORT: lambda: report(result, shown)}
    for name in filter(made.__contains__, RESULT_FILES[result.kind]):
        content = made[name]()
        for path, data in (content if isinstance(content, Mapping) else {"": content}).items():
            if data is not None:
                write_atomically(folder / name / path, data.encode() if isinstance(data, str) else data)


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


def write_pulses(
    campaign: Campaign, folder: Path, export: PulseExport, system: UnitSystem, estimates: Sequence[Estimate]
) -> None:
    """Write the pulses at one speed of a sweep, into a folder by format and speed."""
    speed = estimates[0].condition.speed_name
    for name, files in export.files(campaign, estimates, units=system).items():
        for path, content in files.items():
            write_atomically(folder / name / speed / path, content)


REPORT = "report.html"
RESULT_FILES = {
    "series of studies": ("studies.csv",),
    "study": ("scores.csv", "speed_groups.csv", "pulses.csv", "metrics.csv", "cae_events.csv", REPORT, "study.json"),
    "comparison": (REPORT, "comparison.csv"),
    "certification": (
        *(SEAL, REVIEW, "certification.csv", "track_record.csv", "credibility.csv", REPORT, "certification.json"),
    ),
    "prediction": (
        *("pulses.csv", "pulses.parquet", "metrics.csv", REPORT),
        *(f"{name}/" for name in PULSE_FORMATS),
        "prediction.json",
    ),
    "sweep": (*(f"{name}/" for name in PULSE_FORMATS), REPORT, "sweep.csv"),
    "ranking of next tests": (REPORT, "next_tests.csv"),
    "learning curve": ("learning_curve.csv", REPORT, "learning_curve.json"),
}
"""Files and folders of each kind of result, some of which may be missing; the last, written last, tells the kind."""
