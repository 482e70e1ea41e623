"""Five ways to predict the CAE model where no run was made: ``python benchmarks/emulators.py CAMPAIGN …``.

A tenth of the CAE runs is held out, and every method learns from the rest. A library of fewer than 200 runs is split
into five folds instead, each held out once: every method, the TCN included, is then trained five times, and the fit
time is the mean of the five. Runs below 3 mph are learned from, but not rated: a parked car has no pulse worth rating.
With ``--data`` the mean ratings are written to ``emulators.csv``.
"""

import argparse
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before NumPy: CPU seconds of one core

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.interpolate import RBFInterpolator
from tables import add_data_option, write

from crashfuse.approaches.displacement_domain.dynamics import integrate
from crashfuse.approaches.time_domain.lf_tcn import LfTcn
from crashfuse.cae.model import Emulator
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.condition import Condition
from crashfuse.signals.loading_phase import loading_phase
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, Pulse, kinematics
from crashfuse.signals.rating import rate_windows
from crashfuse.units import MPH

_WINDOW_MS = 60.0
_SLOWEST_RATED_MPS = 3 * MPH
_SMALL_LIBRARY = 200
_FOLDS_SMALL, _FOLDS = 5, 10
_SHARES = np.linspace(0.0, 1.0, 1601)  # of the crush; a pulse still changes within the last millimetre before t0
_STRETCHES = (1.0, 3.0, 6.0, 12.0, 24.0, 48.0, 96.0)  # scale factors of the speed axis
_INNER_FOLDS = 5

Predict = Callable[[Condition], FloatArray]


class CurveInterpolation:
    """Interpolates a(s), not a(t): the loading curves of all runs, their crush and their unloading after t0.

    Curves are taken over s / crush and in units of v0² / crush. Then the area below each is ½ (energy), also below an
    interpolated curve, and the vehicle stops at the interpolated crush. Runs that never stop are left out.
    A step in speed is weighted against one in weight by what best interpolates the curves of left-out runs.
    """

    def fit(self, cae: CaeLibrary) -> Self:
        """Cut all pulses at t0 and fit a thin-plate spline to them over the standardised conditions."""
        vectors, rows = [], []
        for vector, pulse in zip(cae.vectors, cae.accel_mps2.astype(np.float64), strict=True):
            if vector[0] <= 0 or np.isnan((phase := loading_phase(pulse, vector[0])).t0_s):
                continue
            curve = phase.accel_at(_SHARES * phase.crush_m) * phase.crush_m / vector[0] ** 2
            unloading = np.interp(phase.t0_s + GRID_S, GRID_S, pulse) / vector[0]
            vectors.append(vector)
            rows.append(np.concatenate([curve, unloading, [np.log(phase.crush_m / vector[0])]]))
        x, y = np.array(vectors), np.array(rows)
        self.centre_, spread = x.mean(axis=0), x.std(axis=0)
        x = (x - self.centre_) / spread
        stretch = min(_STRETCHES, key=lambda tried: _curve_error(x * [tried, 1, 1], y[:, : _SHARES.size]))
        self.scale_ = np.array([stretch, 1.0, 1.0]) / spread
        self.spline_ = RBFInterpolator(x * [stretch, 1, 1], y)
        return self

    def predict(self, condition: Condition) -> FloatArray:
        """Interpolate a loading curve, integrate the vehicle's motion, and add the unloading from its t0 on."""
        speed = condition.speed_mps
        row = self.spline_(((condition.vector - self.centre_) * self.scale_)[None])[0]
        curve, unloading, crush = row[: _SHARES.size], row[_SHARES.size : -1], speed * np.exp(row[-1])
        over_displacement = curve[None] * speed**2 / crush
        accel = integrate(over_displacement, crush * _SHARES[1], np.zeros((1, 2)), speed).accel_mps2[0]
        t0 = float(kinematics(accel, speed, DT_S).t0_s)
        return np.asarray(np.where(t0 < GRID_S, speed * np.interp(GRID_S - t0, GRID_S, unloading), accel))


def _curve_error(x: FloatArray, curves: FloatArray) -> float:
    """Mean over the runs of the RMS error of a curve interpolated from the other four fifths of the runs."""
    errors = []
    for fold in range(_INNER_FOLDS):
        out = np.arange(len(x)) % _INNER_FOLDS == fold
        errors.append(RBFInterpolator(x[~out], curves[~out])(x[out]) - curves[out])
    return float(np.sqrt((np.concatenate(errors) ** 2).mean(axis=1)).mean())


def _tcn(cae: CaeLibrary) -> Predict:
    network = LfTcn(device="cpu").fit(Campaign("held out", cae, ()))
    return lambda condition: network.predict(condition).accel_mps2


def _nearest(cae: CaeLibrary, axes: slice) -> Predict:
    centre, spread = cae.vectors.mean(axis=0)[axes], cae.vectors.std(axis=0)[axes]
    known = (cae.vectors[:, axes] - centre) / spread

    def predict(condition: Condition) -> FloatArray:
        away = known - (condition.vector[axes] - centre) / spread
        return np.asarray(cae.accel_mps2[np.argmin((away**2).sum(axis=1))], dtype=np.float64)

    return predict


WAYS: dict[str, Callable[[CaeLibrary], Predict]] = {
    "LF TCN": _tcn,
    "Principal modes, Gaussian process": lambda cae: Emulator().fit(cae).predict,
    "a(s) curves, thin-plate spline": lambda cae: CurveInterpolation().fit(cae).predict,
    "Nearest run": lambda cae: _nearest(cae, slice(0, 3)),
    "Nearest run by speed alone": lambda cae: _nearest(cae, slice(0, 1)),
}


@dataclass
class _Record:
    scores: list[float] = field(default_factory=list)
    fits_s: list[float] = field(default_factory=list)
    predictions_s: list[float] = field(default_factory=list)


def main() -> None:
    """Hold runs out, fit, predict and rate them, and print one Markdown table per campaign."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("campaigns", type=Path, nargs="*", default=[Path("sample_data")])
    arguments.add_argument("--seed", type=int, default=0, help="of the choice of held-out runs")
    add_data_option(arguments)
    options = arguments.parse_args()
    for folder in options.campaigns:
        campaign = load_campaign(folder)
        folds = _held_out(len(campaign.cae), options.seed)
        records = {way: _measure(fit, campaign.cae, folds) for way, fit in WAYS.items()}
        rated = len(next(iter(records.values())).scores)
        print(f"\n### {campaign.name}: {rated} of {len(campaign.cae)} CAE runs held out, in {len(folds)} fold(s)\n")
        print(f"| | mean 0–{_WINDOW_MS:g} ms | 5th percentile | worst | fit, CPU-s | a prediction, CPU-s |")
        print("|---|---:|---:|---:|---:|---:|")
        for way, record in records.items():
            scores = np.array(record.scores)
            print(
                f"| {way} | {scores.mean():.3f} | {np.quantile(scores, 0.05):.3f} | {scores.min():.3f} "
                f"| {np.mean(record.fits_s):.2f} | {np.mean(record.predictions_s):.4f} |"
            )
        if options.data is not None:
            means = {way: f"{np.mean(record.scores):.3f}" for way, record in records.items()}
            table = pd.DataFrame([{"campaign": campaign.name.partition(" (")[0], **means}])
            write(table, options.data / "emulators.csv")


def _held_out(n_runs: int, seed: int) -> list[npt.NDArray[np.intp]]:
    order = np.random.default_rng(seed).permutation(n_runs)
    if n_runs < _SMALL_LIBRARY:
        return np.array_split(order, _FOLDS_SMALL)
    return np.array_split(order, _FOLDS)[:1]


def _measure(fit: Callable[[CaeLibrary], Predict], cae: CaeLibrary, folds: list[npt.NDArray[np.intp]]) -> _Record:
    record = _Record()
    for held_out in folds:
        rest = np.setdiff1d(np.arange(len(cae)), held_out)
        ids, conditions = zip(*((cae.ids[i], cae.conditions[i]) for i in rest), strict=True)
        library = CaeLibrary(ids, conditions, cae.accel_mps2[rest])
        start = time.process_time()
        predict = fit(library)
        record.fits_s.append(time.process_time() - start)
        for i in held_out[cae.vectors[held_out, 0] >= _SLOWEST_RATED_MPS]:
            start = time.process_time()
            predicted = predict(cae.conditions[i])
            record.predictions_s.append(time.process_time() - start)
            truth = Pulse(GRID_S, cae.accel_mps2[i])
            record.scores.append(rate_windows(truth, Pulse(GRID_S, predicted), (_WINDOW_MS,))[_WINDOW_MS].overall)
    return record


if __name__ == "__main__":
    main()
