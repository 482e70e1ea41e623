"""Accuracy of the predictions: ``python benchmarks/accuracy.py CAMPAIGN … [--data docs/data]`` (default: the sample).

Each test is left out in turn, alone and with its whole speed group. *Gap closed* is the share of the distance from the
raw CAE to 0.975, a fixed yardstick; *change* is the lowest of all tests against the raw CAE. *A second test* is what a
repeat at the same condition rates against the first, where there are repeats: in a folder ``repeats`` of the campaign,
named as the files in ``tests``, or from the generator of the sample.
With ``--data`` the tables are written as CSV; those in ``docs/data`` are what the documentation shows.
"""

import argparse
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
from tables import add_data_option, write

from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.signals.pulse import Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.study.config import LeaveOut, StudyConfig
from crashfuse.study.recommendation import crps_g, recommend_for
from crashfuse.study.running import run_study
from crashfuse.study.study import Study
from crashfuse.synthetic.sample import sample_campaign
from crashfuse.units import signed

_YARDSTICK = 0.975
_WINDOW_MS = 60.0
_MORE_SAMPLES = range(1, 9)  # seeds
_SHOWN = {  # columns of the campaign's means
    **{"cae": "raw CAE", "lf_tcn": "LF TCN", "time_domain": "time domain"},
    **{"displacement_domain": "displacement domain", "fused": "fused"},
}


def main() -> None:
    """Run the studies, print their tables and write them."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("campaigns", type=Path, nargs="*", default=[Path("sample_data")])
    add_data_option(arguments)
    chosen = arguments.parse_args()
    tables: dict[str, list[dict[str, object]]] = {}
    ways: tuple[LeaveOut, ...] = ("test", "speed group")
    for folder in chosen.campaigns:
        campaign = load_campaign(folder)
        for way in ways:
            study = run_study(campaign, StudyConfig(leave_out=way))
            repeats = _repeats(folder, campaign, study) if way == "test" else {}
            expected, errors = _expected(study)
            about = {"campaign": campaign.name.partition(" (")[0], "left out": way}
            for name, rows in {
                "accuracy": [_means(study, repeats) | _account(expected, errors)],
                "accuracy_approaches": _approaches(study, repeats),
                "accuracy_tests": _tests(study),
                "accuracy_expected": expected,
            }.items():
                tables.setdefault(name, []).extend(about | row for row in rows)
    for name, rows in tables.items():
        table = pd.DataFrame(rows).fillna("")
        print(f"\n{name}\n{table.to_string(index=False)}")
        if chosen.data is not None:
            write(table, chosen.data / f"{name}.csv")


def _means(study: Study, repeats: dict[str, dict[float, float]]) -> dict[str, object]:
    """A campaign's means; a second test only if there is any."""
    raw, fused = _overall(study, "cae"), _overall(study, "fused")
    second = None
    if repeats:
        second = f"{np.mean([own[_WINDOW_MS] for own in repeats.values()]):.3f}"
        beside = np.mean([study.fold(test).ratings["fused"][_WINDOW_MS].overall for test in repeats])
        print(f"{study.campaign.name}: {len(repeats)} tests have repeats; on these fused rates {beside:.3f}")
    return {
        "tests": len(study.folds),
        "CAE runs": len(study.campaign.cae),
        **{column: f"{study.mean_rating(name, _WINDOW_MS):.3f}" for name, column in _SHOWN.items()},
        "a second test": second,
        "gap closed": f"{_gap(fused, raw):.2f}",
        "worst test": f"{fused.min():.3f}",
        "change": signed((fused - raw).min(), 3),
    }


def _approaches(study: Study, repeats: dict[str, dict[float, float]]) -> list[dict[str, object]]:
    """Means by window, the worst test and the coverage of each approach; what repeats rate."""
    windows, raw, rows = study.config.windows_ms, _overall(study, "cae"), []
    for name in study.config.approaches:
        scores, coverage = _overall(study, name), study.coverage.get(name)
        row: dict[str, object] = {"approach": LABELS[name]}
        row |= {_window(window): f"{study.mean_rating(name, window):.3f}" for window in windows}
        row |= {"worst": f"{scores.min():.3f}", "gap closed": f"{_gap(scores, raw):.2f}"}
        row |= {"change": signed((scores - raw).min(), 3), "CRPS (g)": f"{crps_g(study, name, _WINDOW_MS).mean():.2f}"}
        if coverage is not None:
            shares = {"a to TTZV": "accel", "v to TTZV": "velocity", "a after TTZV": "rebound"}
            row |= {column: f"{coverage.share(share):.2f}" for column, share in shares.items()}
            row |= {f"{what} inside": f"{coverage.count(what)} of {len(coverage.tests)}" for what in ("crush", "peak")}
        rows.append(row)
    if repeats:
        means = {_window(window): f"{np.mean([own[window] for own in repeats.values()]):.3f}" for window in windows}
        lowest = min(own[_WINDOW_MS] for own in repeats.values())
        rows.append({"approach": "A repeat", **means, "worst": f"{lowest:.3f}"})
    return rows


def _tests(study: Study) -> list[dict[str, object]]:
    """The rating of each test by approach and window."""
    rows: list[dict[str, object]] = []
    for fold in study.folds:
        for name in study.config.approaches:
            shown = {_window(window): f"{rating.overall:.3f}" for window, rating in fold.ratings[name].items()}
            rows.append({"test": fold.held_out, "approach": LABELS[name], **shown})
    return rows


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


def _expected(study: Study) -> tuple[list[dict[str, object]], np.ndarray]:
    """The recommendation for each test before it was run, the expected and the actual rating; how far it was off."""
    rows: list[dict[str, object]] = []
    errors = []
    for fold in study.folds:
        condition = study.campaign.test(fold.held_out).condition
        rest = study.config.training_campaign(study.campaign, fold.held_out)
        advice = recommend_for(fold.estimates, rest, condition, _WINDOW_MS)
        rated = fold.ratings[advice.approach][_WINDOW_MS].overall
        if (expected := advice.expected) is None:
            continue
        errors.append(expected.median - rated)
        lower, _, upper = expected.range.partition(" to ")
        row = {"test": fold.held_out, "recommended": LABELS[advice.approach], "expected": f"{expected.median:.3f}"}
        row |= {"likely from": lower, "likely to": upper, "rated": f"{rated:.3f}"}
        rows.append({**row, "came out": expected.surprise(rated)})
    return rows, np.array(errors)


def _account(expected: list[dict[str, object]], errors: np.ndarray) -> dict[str, object]:
    """How far the expected ratings were off, and how many tests came out inside the ranges."""
    words = [str(row["came out"]) for row in expected]
    return {
        "expected off by": signed(float(errors.mean()), 3),
        "in size": f"{np.abs(errors).mean():.3f}",
        "inside 80 %": words.count("as expected"),
        "inside 95 %": sum("far" not in word for word in words),
    }


def _window(window_ms: float) -> str:
    return f"0–{window_ms:g} ms"


def _gap(scores: np.ndarray, raw: np.ndarray) -> float:
    return float((scores.mean() - raw.mean()) / (_YARDSTICK - raw.mean()))


def _overall(study: Study, approach: str) -> np.ndarray:
    return np.array([fold.ratings[approach][_WINDOW_MS].overall for fold in study.folds])


if __name__ == "__main__":
    main()
