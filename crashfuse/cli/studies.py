"""The commands that leave tests out (one study, or a series), list studies, and compare two."""

import argparse
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd

from crashfuse.approaches.registry import label_of
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.notes import read_notes
from crashfuse.certification.criteria import read_criteria
from crashfuse.certification.verdict import with_decided
from crashfuse.cli import output
from crashfuse.cli.models import given_settings, settings
from crashfuse.cli.output import claim, opened, require_output, say_written, writing
from crashfuse.errors import UsageError
from crashfuse.execution.training_progress import watching
from crashfuse.files.atomic import write_atomically
from crashfuse.files.csv_text import csv_bytes, read_csv_table
from crashfuse.results.comparison import comparison_result, history_table, read_study
from crashfuse.results.display import DEFAULT
from crashfuse.results.files import begin_study, read_begun, write_result
from crashfuse.results.planning import learning_curve_result
from crashfuse.results.render.html import ReportOptions, report
from crashfuse.results.render.text import lines
from crashfuse.results.result_tables import studies_table
from crashfuse.results.study import study_result
from crashfuse.study import learning_curve as curves
from crashfuse.study.config import StudyConfig, StudyPlan
from crashfuse.study.history import PastResult, StudyComparison, keep, past_results
from crashfuse.study.one_more_test import Cost
from crashfuse.study.running import run_study

_SHOWN = ["Id", "Date (UTC)", "Campaign", "What", "Note", "Settings", "Recommended", "Mean rating", "Worst test"]


@dataclass(frozen=True)
class _Run:
    name: str
    out: Path
    plan: StudyPlan
    report: ReportOptions


def study(arguments: argparse.Namespace) -> None:
    """Leave tests out, predict and rate them, for each campaign, preset and seed."""
    runs = _runs(arguments)  # errors in the last run are reported before the first is computed
    if len(runs) == 1:
        _finish(runs[0], arguments)
        say_written(arguments.out, "study")
        return
    tables: list[pd.DataFrame] = []
    for number, run in enumerate(runs, start=1):
        print(f"Study {number} of {len(runs)}: {run.out.relative_to(arguments.out)}", flush=True)
        tables.append(_finish(run, arguments))
        _write_series(arguments.out, tables)
    print(f"\nMean rating over 0–{tables[0]['window_ms'].max():g} ms, each test left out, range over the seeds")
    print(_summary(tables))
    print(f"Written to {arguments.out}: studies.csv, and each study in a folder of its own")


def _runs(arguments: argparse.Namespace) -> list[_Run]:
    given = given_settings(arguments)
    several = {name: [{name: x} for x in dict.fromkeys(given.pop(name, ()))] or [{}] for name in ("preset", "seed")}
    ways = [{**given, **preset, **seed} for preset, seed in product(*several.values())]
    folders = _named(arguments.campaigns)
    alone = len(folders) == len(ways) == 1
    for folder in folders.values():
        require_output(arguments.out, folder, "study" if alone else "series of studies")
    claim(arguments, arguments.out)
    runs = []
    for name, folder in folders.items():
        campaign = load_campaign(folder, arguments.archive)
        report = ReportOptions(arguments.report, notes=read_notes(folder))
        for way in ways:
            out = arguments.out
            if not alone:
                out = out / name / f"{way.get('preset', 'fast')}-seed-{way.get('seed', 0)}"
                require_output(out, folder, "study")
                claim(arguments, out)
            # in a series that was killed, some may not have been started
            resume = arguments.resume and (alone or (out / "study.json").is_file())
            plan = _plan(campaign, way, arguments.held_out or (), out if resume else None)
            runs.append(_Run(name, out, plan, report))
    return runs


def _plan(campaign: Campaign, given: Mapping[str, Any], held_out: Sequence[str], resumed: Path | None) -> StudyPlan:
    if resumed is None:
        whole = not held_out and given.get("preset") != "paper"  # a paper-preset fit takes minutes, or a GPU
        return StudyPlan(campaign, StudyConfig(**{"leave_out": "both" if whole else "test", **given}), tuple(held_out))
    fingerprint, noted, begun = read_begun(resumed)
    asked = StudyConfig(**given)
    differing = [name for name in given if getattr(begun, name) != getattr(asked, name)]
    differing += ["held_out"] * (tuple(held_out) not in ((), noted))
    differing += ["the campaign's data"] * (fingerprint != campaign.fingerprint)
    if differing:
        raise UsageError(f"{resumed} was begun with other settings: {', '.join(differing)}; leave out --resume.")
    config = replace(begun, to_ttzv=asked.to_ttzv or begun.to_ttzv)  # of which nothing is computed
    return StudyPlan(campaign, config, noted)


def _named(campaigns: Sequence[Path]) -> dict[str, Path]:
    named: dict[str, Path] = {}
    for resolved, folder in {path.resolve(): path for path in campaigns}.items():
        name, number = resolved.name, 1
        while name in named:
            number += 1
            name = f"{resolved.name}-{number}"
        named[name] = folder
    return named


def _finish(run: _Run, arguments: argparse.Namespace) -> pd.DataFrame:
    plan = run.plan
    with writing(run.out):
        begin_study(run.out, plan)
    with watching() as watch:
        where = {"workers": arguments.workers, "scheduler": arguments.scheduler}
        study = run_study(plan.campaign, plan.config, held_out=plan.held_out, watch=watch, **where)
    display = output.display_of(arguments, plan.campaign)
    with writing(run.out):
        study.write(run.out, report=run.report, display=display)
    keep(PastResult.of_study(study))
    print(*lines(study_result(study), display), sep="\n")
    return studies_table([(run.name, study)])


def _write_series(folder: Path, tables: Sequence[pd.DataFrame]) -> None:
    study = ["campaign", "preset", "seed"]
    fresh, path = pd.concat(tables), folder / "studies.csv"
    kept = fresh.iloc[:0]
    with suppress(OSError, ValueError, KeyError):  # there is none, or it can't be read
        older = read_csv_table(path, fresh.select_dtypes("number").columns)
        kept = older[~pd.MultiIndex.from_frame(older[study]).isin(pd.MultiIndex.from_frame(fresh[study]))]
    with writing(folder):
        write_atomically(path, csv_bytes(pd.concat([kept, fresh] if len(kept) else [fresh])))


def _summary(tables: Sequence[pd.DataFrame]) -> str:
    table = pd.concat(tables)
    table = table[(table["window_ms"] == table["window_ms"].max()) & (table["left_out"] == table["left_out"].iloc[0])]
    means = table.groupby(["campaign", "preset", "approach"], sort=False)["mean"]
    ranges = means.agg(lambda x: f"{x.min():.3f}" if x.min() == x.max() else f"{x.min():.3f}–{x.max():.3f}")
    return str(ranges.unstack(sort=False).rename(columns=label_of).to_string())


def learning_curve(arguments: argparse.Namespace) -> None:
    """Predict tests from 1, 2, 3 … of the others, and say what one more test would buy."""
    cost = None if arguments.cost_per_test is None else Cost.of(arguments.cost_per_test)
    config = settings(arguments, curves.CURVE_CONFIG)
    campaign, display = opened(arguments, "learning curve")
    file = arguments.criteria or arguments.campaign / "criteria.toml"
    criteria = read_criteria(file) if arguments.criteria or file.is_file() else None
    repeats = curves.REPEATS if arguments.repeats is None else arguments.repeats
    with watching() as watch:
        where = {"workers": arguments.workers, "scheduler": arguments.scheduler}
        curve = curves.learning_curve(campaign, config, repeats=repeats, watch=watch, **where)
    if criteria is not None:
        curve = with_decided(curve, criteria)
    result = learning_curve_result(curve, cost)
    with writing(arguments.out):
        write_result(result, arguments.out, display)
    output.say(result, display, arguments.out)


def past_studies(arguments: argparse.Namespace) -> None:  # noqa: ARG001 - it has none
    """List studies and predictions of this machine, the latest first."""
    if not (results := past_results()):
        print("Nothing was computed on this machine yet.")
        return
    table = history_table(results).texts()
    print(table[[name for name in _SHOWN if name in table]].to_string(index=False))


def compare(arguments: argparse.Namespace) -> None:
    """Say which of two studies rates better, and by how much."""
    compared = StudyComparison(_past_study(arguments.first), _past_study(arguments.second))
    if arguments.report is not None:
        if (path := arguments.report).is_dir():
            raise UsageError(f"{path} is a folder; name a file for --report.")
        output.require_writable(path.parent, "--report")
        write_atomically(path, report(comparison_result(compared)).encode())
        print(f"Written to {path}")
        return
    if arguments.csv:
        print(csv_bytes(compared.ratings).decode(), end="")
        return
    result = comparison_result(compared)
    for way in result.parts["ways"]:
        print(way.title, *lines(way, DEFAULT), sep="\n")
    print(*result.cautions, sep="\n", end="\n" * bool(result.cautions))


def _past_study(name: str) -> PastResult:
    if Path(name).is_dir():
        return read_study(Path(name))
    found = next((result for result in past_results() if result.id == name and result.tests), None)
    if found is None:
        raise UsageError(f"{name} is neither a folder with a study nor the id of one: crashfuse studies lists them.")
    return found
