"""Accuracy of the predictions: ``python benchmarks/accuracy.py CAMPAIGN …`` (default: the sample).

Each test is left out in turn, alone and with its whole speed group. *Gap closed* is the share of the distance from the
raw CAE to 0.975, a fixed yardstick; *change* is the lowest of all tests against the raw CAE. *A repeat* is what a
second test at the same condition rates against the first: estimated from how the tests scatter, and measured where
there are repeats: in a folder ``repeats`` of the campaign, named as the files in ``tests``, or from the generator
of the sample.
The effect of the tests on the network is shown in the form of the paper's Table 3. Last comes a table of all campaigns.
"""

import argparse
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.reporting.rating_tables import TABLE_3, best, rating_table
from crashfuse.signals.pulse import Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.study.config import LeaveOut, StudyConfig
from crashfuse.study.recommendation import recommend, recommend_for
from crashfuse.study.running import run_study
from crashfuse.study.study import Study
from crashfuse.synthetic.sample import sample_campaign
from crashfuse.wording import signed

_YARDSTICK = 0.975
_WINDOW_MS = 60.0
_MORE_SAMPLES = range(1, 9)  # seeds
_SHOWN = ("cae", "time_domain", "displacement_domain", "fused")


def main() -> None:
    """Run the studies and print Markdown tables."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("campaigns", type=Path, nargs="*", default=[Path("sample_data")])
    ways: tuple[LeaveOut, ...] = ("test", "speed group")
    rows = []
    for folder in arguments.parse_args().campaigns:
        campaign = load_campaign(folder)
        for leave_out in ways:
            study = run_study(campaign, StudyConfig(leave_out=leave_out))
            print(f"\n### {campaign.name}, one {leave_out} left out\n")
            _print_summary(study)
            if leave_out == "test":
                repeats = _repeats(folder, campaign, study)
                _print_repeats(study, repeats)
                _print_tests(study)
                _print_table_3(study)
            else:
                repeats = {}
            _print_recommendations(study)
            rows.append(_row(study, repeats))
    print("\n### All campaigns, 0–60 ms\n")
    labels = [LABELS[name] for name in _SHOWN]
    header = ["campaign", "left out", "tests", "CAE runs", *labels, "a repeat", "fused: gap closed", "worst", "change"]
    print(f"| {' | '.join(header)} |\n|---|---|{'---:|' * (len(header) - 2)}\n" + "\n".join(rows))


def _row(study: Study, repeats: dict[str, dict[float, float]]) -> str:
    """A campaign's row in the last table; the repeat is the measured one if there is any, for the same tests."""
    means = [f"{study.mean_rating(name, _WINDOW_MS):.3f}" for name in _SHOWN]
    raw, fused = _overall(study, "cae"), _overall(study, "fused")
    gap = (fused.mean() - raw.mean()) / (_YARDSTICK - raw.mean())
    repeat = "–"
    if (estimated := study.mean_repeat(_WINDOW_MS)) is not None:
        repeat = f"{estimated:.3f} (estimated)"
    if repeats:
        measured = np.mean([own[_WINDOW_MS] for own in repeats.values()])
        beside = np.mean([study.fold(test).ratings["fused"][_WINDOW_MS].overall for test in repeats])
        repeat = f"{measured:.3f} ({len(repeats)} tests, on which fused rates {beside:.3f})"
    cells = [study.campaign.name, study.config.leave_out, str(len(study.folds)), str(len(study.campaign.cae)), *means]
    return (
        f"| {' | '.join([*cells, repeat, f'{gap:.2f}', f'{fused.min():.3f}', f'{signed((fused - raw).min(), 3)}'])} |"
    )


def _repeats(folder: Path, campaign: Campaign, study: Study) -> dict[str, dict[float, float]]:
    """Mean rating of the repeats of each test that has any, by window in ms."""
    if (folder / "repeats").is_dir():
        with TemporaryDirectory() as scratch:
            copied = Path(shutil.copytree(folder, Path(scratch) / "campaign"))
            for repeated in (copied / "repeats").iterdir():
                shutil.copy(repeated, copied / "tests" / repeated.name)
            again = [load_campaign(copied)]
    else:
        is_sample = campaign.fingerprint == load_campaign(Path("sample_data")).fingerprint
        again = [sample_campaign(seed) for seed in _MORE_SAMPLES] if is_sample else []
    windows, found = study.config.windows_ms, {}
    for test in campaign.tests:
        pulses = [other.test(test.id).pulse for other in again]
        others = [rate_windows(test.pulse, pulse, windows) for pulse in pulses if _differ(pulse, test.pulse)]
        if others:
            found[test.id] = {window: float(np.mean([own[window].overall for own in others])) for window in windows}
    return found


def _differ(one: Pulse, other: Pulse) -> bool:
    return not np.array_equal(one.accel_mps2, other.accel_mps2)


def _print_repeats(study: Study, repeats: dict[str, dict[float, float]]) -> None:
    """Lines below the summary: what repeats rate."""
    windows = study.config.windows_ms
    estimated = [study.mean_repeat(window) for window in windows]
    cells = " | ".join("–" if mean is None else f"{mean:.3f}" for mean in estimated)
    print(f"| A repeat, estimated | {cells} | – | – | – | – |")
    if repeats:
        means = " | ".join(f"{np.mean([own[window] for own in repeats.values()]):.3f}" for window in windows)
        lowest = min(own[_WINDOW_MS] for own in repeats.values())
        print(f"| A repeat, measured ({', '.join(repeats)}) | {means} | {lowest:.3f} | – | – | – |")


def _print_summary(study: Study) -> None:
    inside = "inside the 95 % band: a, v, a after TTZV, crush, peak"
    print(f"| | 0–20 ms | 0–40 ms | 0–60 ms | worst | gap closed | change | {inside} |")
    print("|---|---:|---:|---:|---:|---:|---:|---|")
    raw = _overall(study, "cae")
    for approach in study.config.approaches:
        means = " | ".join(f"{study.mean_rating(approach, window):.3f}" for window in study.config.windows_ms)
        scores = _overall(study, approach)
        gap = (scores.mean() - raw.mean()) / (_YARDSTICK - raw.mean())
        print(
            f"| {LABELS[approach]} | {means} | {scores.min():.3f} | {gap:.2f} | {signed((scores - raw).min(), 3)} "
            f"| {_coverage(study, approach)} |"
        )


def _print_tests(study: Study) -> None:
    windows = study.config.windows_ms
    print(f"\nBy test and window, {' / '.join(f'0–{window:g}' for window in windows)} ms:\n")
    print("| | " + " | ".join(LABELS[approach] for approach in study.config.approaches) + " |")
    print("|---|" + "---:|" * len(study.config.approaches))
    for fold in study.folds:
        scores = (
            " / ".join(f"{fold.ratings[approach][window].overall:.3f}" for window in windows)
            for approach in study.config.approaches
        )
        print(f"| {fold.held_out} | " + " | ".join(scores) + " |")


def _print_table_3(study: Study) -> None:
    table = rating_table(study, TABLE_3)
    marked = best(table)
    print("\n| Test | ISO score | " + " | ".join(table.columns) + " |")
    print("|---|---|" + "---:|" * len(table.columns))
    for row in table.index:
        cells = (f"**{x:.3f}**" if top else f"{x:.3f}" for x, top in zip(table.loc[row], marked.loc[row], strict=True))
        print(f"| {' | '.join(row)} | {' | '.join(cells)} |")


def _print_recommendations(study: Study) -> None:
    """Print the recommendation for each test before it was run, the expected rating and the actual one."""
    rows, errors, surprises = [], [], []
    for fold in study.folds:
        condition = study.campaign.test(fold.held_out).condition
        rest = study.config.training_campaign(study.campaign, fold.held_out)
        advice = recommend_for(fold.estimates, rest, condition, _WINDOW_MS)
        rated = fold.ratings[advice.approach][_WINDOW_MS].overall
        if (expected := advice.expected) is None:
            continue
        errors.append(expected.median - rated)
        surprises.append(expected.surprise(rated))
        cells = LABELS[advice.approach], f"{expected.median:.3f}", expected.range, f"{rated:.3f}", surprises[-1]
        rows.append(f"| {fold.held_out} | {' | '.join(cells)} |")
    if study.config.leave_out == "test":
        print("\n| Test | recommended | expected | likely | rated | |\n|---|---|---:|---:|---:|---|")
        print("\n".join(rows))
    likely, no_surprise = surprises.count("as expected"), sum("far" not in each for each in surprises)
    print(
        f"\nThe expected rating is {signed(float(np.mean(errors)), 3)} off on average, "
        f"{np.abs(errors).mean():.3f} in size. Of {len(errors)} tests {likely} came out inside the likely range "
        f"(80 %), {no_surprise} inside the central 95 %."
    )
    if study.config.leave_out == "test":
        print("\n" + "\n".join(recommend(study).sentences))


def _overall(study: Study, approach: str) -> np.ndarray:
    return np.array([fold.ratings[approach][_WINDOW_MS].overall for fold in study.folds])


def _coverage(study: Study, approach: str) -> str:
    """Shares of time inside the band: a(t), v(t) up to TTZV, a(t) after it; counts of tests: maximum crush, peak."""
    found = study.coverage.get(approach)
    if found is None:
        return "–"
    shares = ", ".join(f"{found.share(name):.2f}" for name in ("accel", "velocity", "rebound"))
    return f"{shares}, {found.count('crush')} and {found.count('peak')} of {len(found.tests)}"


if __name__ == "__main__":
    main()
