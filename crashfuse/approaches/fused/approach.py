"""The fused approach: both domains and the raw CAE, with weights learned from left-out tests (beyond the paper)."""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from crashfuse.approaches.base import MOST_TESTS, Approach, FittedState, Prediction
from crashfuse.approaches.calibration import WIDENINGS, Calibration, Coverage, calibrate
from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.fit_cache import fitted
from crashfuse.approaches.fused.weights import Pool, Scores
from crashfuse.approaches.left_out import STRIDE, predicted
from crashfuse.approaches.settings import Device, Settings
from crashfuse.approaches.time_domain.approach import TimeDomain
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.signals.pulse import DT_S, FloatArray
from crashfuse.signals.thinning import in_full
from crashfuse.units import MPH

COMPONENTS = ("time domain", "displacement domain", "raw CAE")
_REACH_MPS = 3 * MPH  # speed difference at which a test is neither near nor far
_JUDGED_S = 0.06  # the rated time: later errors must not affect the weights
_N_DRAWS = 400
_WIDENINGS = (0.6, 0.7, 0.8, 0.9, *WIDENINGS)
# Prior: the displacement domain ahead of the time domain, both far ahead of the CAE, and even more so beside a test.
_PRIOR = np.array([[-0.5, -0.5], [0.0, 0.0], [-3.0, -5.0]])
_SPREAD, _STRENGTH = 1.0, 10.0


class Component(NamedTuple):
    """An expected pulse, and draws of whole pulses, shape (n_draws, n_times)."""

    mean: FloatArray
    draws: FloatArray


class Fused(Approach):
    """A mixture of the time domain, the displacement domain and the raw CAE.

    The expected accelerations are averaged with the weights of :class:`crashfuse.approaches.fused.weights.Pool`, so
    velocity and displacement, which are integrated from the mean, agree with it. Each whole pulse of the band is drawn
    from one of the three. The CAE's draws are its pulse plus the error that it had in some test, with either sign.

    It always uses the fast forms of both approaches, as the paper has no fused approach.

    Parameters
    ----------
    device : {"auto", "cpu", "cuda"}
        Device for training the time domain's networks.
    cache : Cache, optional
        Storage for the fits of both approaches.

    Attributes
    ----------
    calibration_ : Calibration
        Calibration of the band, on tests that both approaches predicted from the others.
    """

    name = "fused"
    label = "Fused"
    in_words = "the fused prediction"
    description = (
        "time domain, displacement domain and raw CAE averaged with weights that left-out tests decide (by CRPS), the "
        "more alike the nearer a test is; the band is the mixture's."
    )
    colour = "#009E73"
    preference = 10
    trains_networks = True
    made_of = (TimeDomain, DisplacementDomain)

    def __init__(self, *, seed: int = 0, device: Device = "auto", cache: Cache | None = None) -> None:
        self.seed = seed
        self._wanted = device
        self.cache = cache

    @classmethod
    def create(cls, settings: Settings) -> Self:
        """Create an unfitted mixture, the same under every preset."""
        return cls(seed=settings.seed, device=settings.device, cache=settings.cache)

    def _unfitted(self) -> tuple[TimeDomain, DisplacementDomain]:
        settings = Settings(seed=self.seed, device=self._wanted, cache=self.cache)
        return TimeDomain.create(settings), DisplacementDomain.create(settings)

    @property
    def device(self) -> str:
        """Device of the time domain."""
        return self._unfitted()[0].device

    def prepare(self, campaign: Campaign, conditions: Sequence[Condition], watch: Watch = SILENT) -> None:
        """Prepare both approaches."""
        for part in self._unfitted():
            part.prepare(campaign, conditions, watch)

    def fit(self, campaign: Campaign, watch: Watch = SILENT) -> Self:
        """Fit both approaches, and learn the weights from their predictions of tests that they have not seen."""
        campaign = self._thinned(campaign)
        time_domain, displacement_domain = self._unfitted()
        self.time_domain_, _ = fitted(time_domain, campaign, self.cache, watch)
        self.displacement_domain_, _ = fitted(displacement_domain, campaign, self.cache, watch)
        self._begin(campaign)
        watch.report("Weights of the mixture", 0, 1)
        left_out = self._left_out_components()
        rated = slice(round(_JUDGED_S / (STRIDE * DT_S)))
        scores = [
            Scores.of(self._measured[number, ::STRIDE][rated], [component.draws[:, rated] for component in components])
            for number, (components, _) in left_out.items()
        ]
        nearness = np.array([near for _, near in left_out.values()])
        self.pool_ = Pool(_PRIOR, spread=_SPREAD, strength=_STRENGTH).fit(scores, nearness)
        mixed = self._left_out_mixtures()
        full = {number: [in_full(part, STRIDE) for part in mixture] for number, mixture in mixed.items()}

        def check(widening: float) -> list[Coverage]:
            return [
                Coverage.of(campaign.tests[number], mean + widening * (draws - mean))
                for number, (mean, draws) in full.items()
            ]

        # A mixture of valid bands is wider than necessary where the components agree.
        self.calibration_ = calibrate(check, _WIDENINGS) if mixed else Calibration(1.0, ())
        watch.report("Weights of the mixture", 1, 1)
        return self

    def _begin(self, campaign: Campaign) -> None:
        self._speeds = np.array([test.condition.speed_mps for test in campaign.tests])
        model = self.displacement_domain_.model_
        self._measured = np.array([test.pulse.accel_mps2 for test in campaign.tests])
        self._cae = np.array([model.pulse(test.condition).accel_mps2 for test in campaign.tests])

    def _nearness(self, speed_mps: float, without: int = -1) -> float:
        """Nearness in speed to the other tests: 0 far from all of them, 1 beside one."""
        others = np.delete(self._speeds, [without] if without >= 0 else [])
        return float(np.exp(-np.abs(others - speed_mps).min() / _REACH_MPS)) if others.size else 0.0

    def _left_out_components(self) -> dict[int, tuple[list[Component], float]]:
        """Thinned predictions of each component for tests that it has not seen, and the nearness of these tests.

        By test number, for the tests that both approaches predicted from the others.
        """
        both = self.time_domain_.left_out_, self.displacement_domain_.left_out_
        found = {}
        for number in (int(number) for number in both[1].numbers if number in both[0].numbers):
            speed, cae = self._speeds[number], self._cae[number]
            said = [(left, left.numbers == number) for left in both]
            drawn = [Component(by.mean_mps2[own][0], by.draws_mps2[own][0].astype(np.float64)) for by, own in said]
            raw = Component(cae[::STRIDE], self._cae_draws(cae, speed, without=number)[:, ::STRIDE])
            found[number] = [*drawn, raw], self._nearness(speed, without=number)
        return found

    def _left_out_mixtures(self) -> dict[int, Component]:
        """Predictions of the mixture for these tests, by test number."""
        left_out = self._left_out_components().items()
        return {number: self._mix(components, self.pool_.weights(near)) for number, (components, near) in left_out}

    def _mix(self, components: Sequence[Component], weights: FloatArray) -> Component:
        """The weighted mean, and draws from each component in proportion to its weight."""
        rng = np.random.default_rng(self.seed)
        shares = np.diff(np.floor(np.cumsum(weights) * _N_DRAWS + 0.5).astype(int), prepend=0)
        chosen = [
            component.draws[rng.choice(len(component.draws), size=share, replace=bool(share > len(component.draws)))]
            for component, share in zip(components, shares, strict=True)
        ]
        return Component(weights @ np.array([component.mean for component in components]), np.concatenate(chosen))

    def _cae_draws(self, cae_mps2: FloatArray, speed_mps: float, without: int = -1) -> FloatArray:
        """The CAE pulse plus the errors that it had in all other tests, scaled with speed, with either sign."""
        others = np.arange(len(self._speeds)) != without
        if not others.any():
            return cae_mps2[None]
        errors = (self._measured - self._cae)[others] * (speed_mps / self._speeds[others])[:, None]
        draws: FloatArray = cae_mps2 + np.concatenate([errors, -errors])
        return draws

    def predict(self, condition: Condition) -> Prediction:
        """Average the three predictions at a condition, and mix their draws."""
        return self.predict_from(condition, [part.predict(condition) for part in self.parts])

    @property
    def parts(self) -> tuple[Approach, Approach]:
        """The fitted time domain and displacement domain."""
        self._require("pool_")
        return self.time_domain_, self.displacement_domain_

    def predict_from(self, condition: Condition, parts: Sequence[Prediction]) -> Prediction:
        """Mix the predictions of both parts with the raw CAE."""
        cae = self.displacement_domain_.model_.pulse(condition).accel_mps2
        cae_draws = self._cae_draws(cae, condition.speed_mps)
        weights = self.pool_.weights(self._nearness(condition.speed_mps))
        components = [Component(said.accel_mps2, said.draws_mps2) for said in parts if said.draws_mps2 is not None]
        mixture = self._mix([*components, Component(cae, cae_draws)], weights)
        notes = dict.fromkeys(
            (self._reason(condition, weights), *self._thinning, *(n for part in parts for n in part.notes))
        )
        return Prediction(condition, mixture.mean, self._widened(mixture), tuple(notes))

    def left_out(self, campaign: Campaign) -> dict[str, Prediction]:
        """Predictions of both approaches for tests that they have not seen, mixed with the learned weights."""
        self._require("pool_")
        tests = campaign.evenly_over_speed(MOST_TESTS).tests
        mixed = self._left_out_mixtures().items()
        return {tests[n].id: predicted(tests[n], mix.mean, self._widened(mix)) for n, mix in mixed}

    def _widened(self, mixture: Component) -> FloatArray:
        """The draws of a mixture, as far from its mean as left-out tests show that they have to be."""
        return mixture.mean + self.calibration_.widening * (mixture.draws - mixture.mean)

    def _reason(self, condition: Condition, weights: FloatArray) -> str:
        """A sentence on the weights and what determines them."""
        away = np.abs(self._speeds - condition.speed_mps).min() / MPH
        shown = np.round(weights, 2)
        shown[weights.argmax()] += 1 - shown.sum()  # so that the rounded shares add up to the whole
        parts = ", ".join(f"{name} {weight:.2f}" for name, weight in zip(COMPONENTS, shown, strict=True))
        n = len(self.calibration_.tests)
        source = f"weights learned from {n} tests, each predicted from the others" if n else "weights not learned"
        return f"Nearest test {away:.1f} mph away: {parts} ({source})."

    def learned(self) -> FittedState:
        """Fitted states of both approaches, and the weights."""
        self._require("pool_")
        parts = {"time": self.time_domain_.learned(), "displacement": self.displacement_domain_.learned()}
        check = self.calibration_
        return FittedState.of(
            {"widening": check.widening}, {"logits": self.pool_.logits_, "inside": check.inside}, **parts
        )

    def restore(self, campaign: Campaign, learned: FittedState) -> Self:
        """Restore both approaches and the weights."""
        campaign = self._thinned(campaign)
        time_domain, displacement_domain = self._unfitted()
        self.time_domain_ = time_domain.restore(campaign, learned.part("time"))
        self.displacement_domain_ = displacement_domain.restore(campaign, learned.part("displacement"))
        self._begin(campaign)
        self.pool_ = Pool(_PRIOR, spread=_SPREAD, strength=_STRENGTH)
        self.pool_.logits_ = learned.arrays["logits"]
        self.calibration_ = Calibration.of(learned.values["widening"], learned.arrays["inside"])
        return self

    @property
    def state(self) -> dict[str, object]:
        """Weights far from all tests and beside one, and the coverage of left-out tests by the band."""
        if not hasattr(self, "pool_"):
            return {}
        far, beside = (self.pool_.weights(nearness).round(4).tolist() for nearness in (0.0, 1.0))
        check = self.calibration_
        return {
            **({"band_check": check.state} if check.tests else {}),
            "weights_far_from_tests": dict(zip(COMPONENTS, far, strict=True)),
            "weights_beside_a_test": dict(zip(COMPONENTS, beside, strict=True)),
        }
