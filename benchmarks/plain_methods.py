"""Published methods, plainly applied to the same tests: ``python benchmarks/plain_methods.py CAMPAIGN …``.

They learn from tests and CAE pulses, with impact speed as their only input:

- *nearest test*: the test nearest in speed, plus what the CAE model changes between the two conditions;
- *residual*: Gaussian processes on principal components of test less CAE (Kennedy and O'Hagan, 2001);
- *co-kriging*: AR(1) between the principal components of CAE and test (Kennedy and O'Hagan, 2000);
- *elastic registration* (Srivastava et al., 2011): the CAE pulse warped onto the tests, warps and what is left
  interpolated over speed. It takes the package ``fdasrsf``.

Printed: the mean rating over 0 to 60 ms, each test left
out, then each test with all others at its speed, and what was not run.
"""

import argparse
import warnings
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from sklearn.decomposition import PCA
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.condition import Condition
from crashfuse.execution.run import Run
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import rate_windows

try:
    from fdasrsf.utility_functions import f_to_srsf, optimum_reparam
except ImportError:
    optimum_reparam = None

Predict = Callable[[Condition], FloatArray]
NOT_RUN = "Not run: TabPFN, whose weights are in no package registry"
NOT_RUN += "." if optimum_reparam else "; elastic registration, which takes the package fdasrsf."
_MOST_VARIANCE = 0.99  # of the pulses, that the principal components explain
_COARSE = 5  # samples of the grid to one of a warp
_RHOS = np.linspace(0.0, 2.0, 9)


class _Data:
    """Speeds and pulses of the tests, and the CAE pulse at any condition."""

    def __init__(self, campaign: Campaign) -> None:
        model = CaeModel().fit(campaign.cae, Run.of(campaign))  # kept in the cache
        self.cae: Predict = lambda condition: model.pulse(condition).accel_mps2
        self.speeds_mps = np.array([test.condition.speed_mps for test in campaign.tests])
        self.tests = np.array([test.pulse.accel_mps2 for test in campaign.tests])
        self.cae_of_tests = np.array([self.cae(test.condition) for test in campaign.tests])
        self.runs = campaign.cae.accel_mps2.astype(np.float64)


def _nearest_test(data: _Data) -> Predict:
    def predict(condition: Condition) -> FloatArray:
        away = np.abs(data.speeds_mps - condition.speed_mps)
        nearest = away == away.min()
        return np.asarray((data.tests - data.cae_of_tests)[nearest].mean(axis=0) + data.cae(condition))

    return predict


def _residual(data: _Data) -> Predict:
    residual = data.tests - data.cae_of_tests
    components = PCA(_MOST_VARIANCE, svd_solver="full").fit(residual)
    processes = [_process(data.speeds_mps, scores) for scores in components.transform(residual).T]

    def predict(condition: Condition) -> FloatArray:
        scores = [process(condition.speed_mps) for process, _ in processes]
        return np.asarray(data.cae(condition) + components.inverse_transform([scores])[0])

    return predict


def _co_kriging(data: _Data) -> Predict:
    components = PCA(_MOST_VARIANCE, svd_solver="full").fit(np.concatenate([data.runs, data.tests]))
    of_tests, of_cae = (components.transform(pulses).T for pulses in (data.tests, data.cae_of_tests))
    fitted = []
    for high, low in zip(of_tests, of_cae, strict=True):
        tried = [(rho, *_process(data.speeds_mps, high - rho * low, np.std(high))) for rho in _RHOS]
        fitted.append(max(tried, key=lambda one: one[2]))

    def predict(condition: Condition) -> FloatArray:
        low = components.transform(data.cae(condition)[None])[0]
        scores = [rho * x + process(condition.speed_mps) for x, (rho, process, _) in zip(low, fitted, strict=True)]
        return np.asarray(components.inverse_transform([scores])[0])

    return predict


def _elastic_registration(data: _Data) -> Predict:
    shares = np.linspace(0.0, 1.0, GRID_S.size)
    warps, left = [], []
    for test, cae in zip(data.tests, data.cae_of_tests, strict=True):
        warps.append(_warp(test.tobytes(), cae.tobytes()))
        left.append(test - np.interp(warps[-1], shares, cae))
    speeds = np.unique(data.speeds_mps)
    at_speeds = [[np.mean(np.array(rows)[data.speeds_mps == v], axis=0) for v in speeds] for rows in (warps, left)]

    def predict(condition: Condition) -> FloatArray:
        weights = [np.interp(condition.speed_mps, speeds, row) for row in np.eye(speeds.size)]
        warp, added = (np.average(rows, axis=0, weights=weights) for rows in at_speeds)
        return np.asarray(np.interp(warp, shares, data.cae(condition)) + added)

    return predict


@cache
def _warp(test: bytes, cae: bytes) -> FloatArray:
    """The share of time of the CAE pulse that is like the test at each share of its time; the same in every fold."""
    coarse = GRID_S[::_COARSE]
    slopes = [f_to_srsf(np.frombuffer(pulse)[::_COARSE], coarse) for pulse in (test, cae)]
    warp = optimum_reparam(slopes[0], coarse, slopes[1])
    return np.asarray(np.interp(GRID_S, coarse, (warp - warp[0]) / np.ptp(warp)))


def _process(speeds_mps: FloatArray, scores: FloatArray, scale: float = 0.0) -> tuple[Callable[[float], float], float]:
    """A Gaussian process over the logarithm of speed, and its log marginal likelihood."""
    scale = scale or float(np.std(scores)) or 1.0
    kernel = ConstantKernel(1.0, (1e-2, 1e2)) * Matern(0.5, (0.1, 10.0), nu=2.5) + WhiteKernel(0.1, (1e-4, 1e1))
    process = GaussianProcessRegressor(kernel + ConstantKernel(1.0, "fixed"), random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # at a bound
        process.fit(np.log(speeds_mps)[:, None], scores / scale)
    likelihood = float(process.log_marginal_likelihood_value_)
    return lambda speed_mps: scale * float(process.predict([[np.log(speed_mps)]])[0]), likelihood


METHODS: Mapping[str, Callable[[_Data], Predict]] = {
    "nearest test": _nearest_test,
    "residual": _residual,
    "co-kriging": _co_kriging,
    **({"elastic registration": _elastic_registration} if optimum_reparam else {}),
}


def fit_plain(campaign: Campaign) -> dict[str, Predict]:
    """Each method, fitted to the tests and CAE runs of a campaign."""
    data = _Data(campaign)
    return {name: fit(data) for name, fit in METHODS.items()}


def main() -> None:
    """Leave tests out, and print the mean ratings."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("campaigns", type=Path, nargs="+")
    rows = []
    for folder in parser.parse_args().campaigns:
        campaign = load_campaign(folder)
        for test in campaign.tests:
            for left_out, ids in (("test", [test.id]), ("speed", campaign.speed_group(test.id))):
                if (rest := campaign.without(ids)).tests:
                    fitted = fit_plain(rest)
                    rated = {
                        name: rate_windows(test.pulse, Pulse(GRID_S, predict(test.condition)), [60.0])[60.0].overall
                        for name, predict in fitted.items()
                    }
                    rows.append({"campaign": folder.name, "left out": left_out, **rated})
    by = pd.DataFrame(rows).groupby(["campaign", "left out"], sort=False)
    print(by.mean().join(by.size().rename("n")).to_string(float_format="{:.3f}".format))
    print(NOT_RUN)


if __name__ == "__main__":
    main()
