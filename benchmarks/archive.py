"""What an archive of past vehicles is worth to the next: ``python benchmarks/archive.py [--kind sister]``.

Vehicles are drawn at random (``benchmarks/vehicles.py``), each with ten tests, every second with CAE runs paired with
them. An archive is learned from some of them. Others, of the same kind and of any, are predicted by the fused
prediction from 1, 2, 3, 4 and 6 of their tests with the archive and without.

Printed are the mean rating over 0–60 ms, the lowest change of a vehicle, the lowest rating of a single test beside the
raw CAE's, the share of metrics inside their 95 % intervals and how wide these are with the archive as a share of those
without.
"""

import argparse
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from tables import add_data_option, write
from vehicles import KINDS, NAMES

from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.execution.run import Run
from crashfuse.signals.metrics import metric_values
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.study.archive_learning import SIZES, learn_archive
from crashfuse.study.config import StudyConfig
from crashfuse.study.learning_curve import learning_curve
from crashfuse.units import number, signed

_WINDOW_MS = 60.0
_CONFIG = StudyConfig(approaches=("fused",), windows_ms=(_WINDOW_MS,))
_TESTS = 10


def _campaign(kind: str, seed: int) -> Campaign:
    return KINDS[kind](seed).campaign(_TESTS, paired=seed % 2 == 0)


def _raw(campaign: Campaign) -> dict[str, float]:
    model = CaeModel().fit(campaign.cae, Run())
    pulses = {test: Pulse(GRID_S, model.pulse(test.condition).accel_mps2) for test in campaign.tests}
    return {
        test.id: rate_windows(test.pulse, pulse, [_WINDOW_MS])[_WINDOW_MS].overall for test, pulse in pulses.items()
    }


def _rows(campaign: Campaign, what: str) -> pd.DataFrame:
    curve, raw = learning_curve(campaign, _CONFIG, repeats=0), _raw(campaign)
    measured = {
        test.id: metric_values(test.pulse.accel_mps2, test.condition.speed_mps, occupant=campaign.occupant)
        for test in campaign.tests
    }
    rows: list[dict[str, float]] = []
    for (_, row), forecast in zip(curve.table.iterrows(), curve.forecasts, strict=True):
        values = {name: float(value) for name, value in measured[row["held_out"]].items()}
        ends = {name: distribution.interval for name, distribution in forecast.items() if distribution is not None}
        known = {
            name: (low, high)
            for name, (low, high) in ends.items()
            if low is not None and high is not None and np.isfinite(values[name])
        }
        inside = [low <= values[name] <= high for name, (low, high) in known.items()]
        widths = {f"width {name}": high - low for name, (low, high) in known.items()}
        gain = row["overall"] - raw[row["held_out"]]
        rated = {"n_tests": row["n_tests"], "rating": row["overall"], "beside CAE": gain}
        rows.append({**rated, "inside": float(np.mean(inside)), **widths})
    table = pd.DataFrame(rows)
    by_size = table[table["n_tests"].isin(SIZES)].groupby("n_tests")
    return by_size.mean().assign(**{"beside CAE": by_size["beside CAE"].min()}).add_suffix(what)


def main() -> None:
    """Learn, predict, print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kind", choices=list(KINDS), default="sister", help="of the archive's vehicles")
    parser.add_argument("--archive", type=int, nargs="*", default=[9101, 9102, 9103, 9104], help="their seeds")
    parser.add_argument("--judged", type=int, nargs="*", default=[9109, 9110, 9111], help="seeds of the others")
    add_data_option(parser)
    parser.add_argument("--out", type=Path, help="file of the archive")
    given = parser.parse_args()
    archive = learn_archive([_campaign(given.kind, seed) for seed in given.archive])
    print(archive.sentence)
    if given.out is not None:
        archive.save(given.out)
    parts = []
    for kind in (given.kind, "any"):
        for seed in given.judged:
            campaign = _campaign(kind, seed)
            taught = _rows(campaign.with_archive(archive), "")
            part = taught.join(_rows(campaign, " without")).reset_index()
            widths = [column for column in taught if column.startswith("width") and f"{column} without" in part]
            narrower = np.log(part[widths].to_numpy() / part[[f"{name} without" for name in widths]].to_numpy())
            part["width"] = np.exp(np.nanmean(narrower, axis=1))
            parts.append(part.assign(kind=kind, change=part["rating"] - part["rating without"]))
            print(parts[-1][["kind", "n_tests", "rating", "rating without", "width"]].round(3), flush=True)
    columns = ["rating", "rating without", "inside", "inside without", "width"]
    groups = pd.concat(parts).groupby(["kind", "n_tests"])
    lowest = groups[["change", "beside CAE", "beside CAE without"]].min().rename(columns={"change": "lowest change"})
    table = groups[columns].mean().join(lowest).reset_index().round(3)
    print(table.to_string(index=False))
    if given.data is not None:
        names = dict(NAMES)
        if given.kind == "relative":
            names["relative"] += f" of {given.judged[0] // 100}"
            names["any"] += f", taught by {names['relative']}"
        written = table.assign(campaign=table.pop("kind").map(names)).rename(columns={"n_tests": "learned from"})
        written = written[["campaign", "learned from", *columns, *lowest]]
        digits = {
            name: partial(number, form=".3f") for name in ("rating", "rating without", "inside", "inside without")
        }
        shown = {**digits, "width": partial(number, form=".2f"), **dict.fromkeys(lowest, partial(signed, digits=3))}
        write(
            written.assign(**{name: written[name].map(form) for name, form in shown.items()}),
            given.data / "archive.csv",
        )


if __name__ == "__main__":
    main()
