"""The fused approach (beyond the paper): both domains, a pre-trained network and the raw CAE in one prediction."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Self

import numpy as np

from crashfuse.approaches import calibration as bands
from crashfuse.approaches.base import MOST_TESTS, Approach, Device, FittedState, Prediction, Settings
from crashfuse.approaches.calibration import JUDGED, STRIDE, WIDENINGS, Calibration, Coverage
from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.mixture import (
    COMPONENTS,
    PRIOR,
    AboutFused,
    Component,
    HeldOut,
    Pool,
    Scores,
    Tests,
    mixed,
    spread,
)
from crashfuse.approaches.neighbours import nearness
from crashfuse.approaches.pretrained import Pretrained
from crashfuse.approaches.time_domain.approach import TimeDomain
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.execution.run import UNKEPT, Run
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import Sentence, speed
from crashfuse.vehicle_archive import Prior

_N_DRAWS = 400
_PAST_COUNT = 2  # a vehicle of an archive, given by two errors, counts as four left-out tests
_WIDENINGS = (0.6, 0.7, 0.8, 0.9, *WIDENINGS)


class Fused(AboutFused):
    """A mixture of time domain, displacement domain, pre-trained network and raw CAE.

    The expected accelerations are averaged with the weights of :class:`crashfuse.approaches.mixture.Pool`; each whole
    pulse of the band is drawn from one component. The CAE's draws are its pulse plus the error that it had in some
    test, with either sign. It always uses the fast forms, as the paper has no fused approach.
    """

    def __init__(self, *, seed: int = 0, device: Device = "auto") -> None:
        self.seed, self._wanted = seed, device

    @classmethod
    def create(cls, settings: Settings) -> Self:
        """Create it, the same under every preset."""
        return cls(seed=settings.seed, device=settings.device)

    @classmethod
    def taught_by(cls, prior: Prior | None) -> Prior | None:
        """It learns all of it."""
        return prior

    def _unfitted(self) -> tuple[TimeDomain, DisplacementDomain, Pretrained]:
        settings = Settings(seed=self.seed, device=self._wanted)
        return TimeDomain.create(settings), DisplacementDomain.create(settings), Pretrained.create(settings)

    @property
    def _learning(self) -> tuple[TimeDomain, DisplacementDomain, Pretrained]:
        return self.time_domain_, self.displacement_domain_, self.pretrained_

    @property
    def device(self) -> str:
        """Device of the time domain."""
        return self._unfitted()[0].device

    def prepare(self, campaign: Campaign, conditions: Sequence[Condition], run: Run = UNKEPT) -> None:
        """Prepare all parts."""
        for part in self._unfitted():
            part.prepare(campaign, conditions, run)

    def fit(self, campaign: Campaign, run: Run = UNKEPT) -> Self:
        """Fit the approaches, and learn the weights from their predictions of left-out tests."""
        time_domain, displacement_domain, pretrained = self._unfitted()
        self.time_domain_, _ = time_domain.fitted(campaign, run)
        # Taught both, displacement domain and network would err together: the network alone is (docs/decisions.md).
        self.displacement_domain_, _ = displacement_domain.fitted(replace(campaign, prior=None), run)
        self.alike_, self.archive_ = self.displacement_domain_.alikeness(campaign.prior, run.watch)
        self.pretrained_, _ = pretrained.fitted(self._weighted(campaign), run)
        campaign = self._begin(campaign)
        run.watch.report("Weights of the mixture", 0, 1)
        groups = bands.speed_groups(campaign)
        alone = self._alone()
        apart = self._tests.held_out([part.left_out_groups_ for part in self._learning], groups)
        learned_from = alone + [left_out for left_out in apart if len(groups[left_out.number]) > 1]
        measured = self._tests.measured_mps2
        rated = [
            (measured[n, ::STRIDE][JUDGED], [part.draws[:, JUDGED] for part in parts]) for n, parts, _ in learned_from
        ]
        self.pool_.fit([Scores.of(*pulses) for pulses in rated])
        mixtures = [(campaign.tests[left_out.number], self._mixed(left_out.components)) for left_out in alone]

        def check(widening: float) -> list[Coverage]:
            return [Coverage.of(test, mixture.widened(widening), whole=False) for test, mixture in mixtures]

        # A mixture of valid bands is wider than necessary where the components agree: beside tests it may be narrowed.
        near = bands.calibrate(check, _WIDENINGS) if mixtures else Calibration(1.0, ())
        near = near.with_whole((test, mixture.widened(near.widening)) for test, mixture in mixtures)
        of_others = [self._mixed(left_out.components) for left_out in apart]
        numbers = np.array([left_out.number for left_out in apart], dtype=np.int64)
        means = np.array([mixture.mean for mixture in of_others])
        draws = np.array([mixture.draws for mixture in of_others], dtype=np.float32)
        far = bands.widening_far(measured, self._tests.speeds_mps, bands.LeftOut(numbers, means, draws))
        self.calibration_ = replace(near, far=max(far / near.widening, 1.0))
        run.watch.report("Weights of the mixture", 1, 1)
        return self

    def _weighted(self, campaign: Campaign) -> Campaign:
        prior = campaign.prior
        return replace(campaign, prior=replace(prior, share=self.alike_) if prior and self.alike_ else None)

    def _begin(self, campaign: Campaign) -> Campaign:
        campaign = self._thinned(campaign)
        self._tests = Tests.of(campaign, self.displacement_domain_.model_)
        taught = self.pretrained_.prior_
        self.pool_ = Pool(PRIOR if taught is None else (1 - taught.share) * PRIOR + taught.share * taught.logits)
        return campaign

    def _alone(self) -> list[HeldOut]:
        singly = [(number,) for number in range(len(self._tests.speeds_mps))]
        return self._tests.held_out([part.left_out_ for part in self._learning], singly)

    def _mixed(self, components: Sequence[Component]) -> Component:
        return mixed(components, self._weights([part.draws for part in components]), _N_DRAWS, self.seed)

    def _weights(self, thinned_draws: Sequence[FloatArray]) -> FloatArray:
        return self.pool_.weights(np.array([spread(draws[:, JUDGED]) for draws in thinned_draws]))

    def predict(self, condition: Condition) -> Prediction:
        """Average the predictions at a condition, and mix their draws."""
        return self.predict_from(condition, [part.predict(condition) for part in self.parts])

    @property
    def parts(self) -> tuple[Approach, Approach]:
        """The fitted time domain and displacement domain."""
        self._require("calibration_")
        return self.time_domain_, self.displacement_domain_

    def predict_from(self, condition: Condition, parts: Sequence[Prediction]) -> Prediction:
        """Mix the predictions of both parts with those of the pre-trained network and the raw CAE."""
        speed_mps, cae = condition.speed_mps, self.displacement_domain_.model_.pulse(condition).accel_mps2
        predictions = (*parts, self.pretrained_.predict(condition))
        components = [Component(p.accel_mps2, p.draws_mps2) for p in predictions if p.draws_mps2 is not None]
        components.append(self._tests.raw(cae, speed_mps))
        weights = self._weights([part.draws[:, ::STRIDE] for part in components])
        mixture = mixed(components, weights, _N_DRAWS, self.seed)
        others = [note for prediction in predictions for note in prediction.notes]
        notes = dict.fromkeys((self._reason(condition, weights), self.archive_, *self._thinning, *others))
        near = nearness(speed_mps, self._tests.speeds_mps)
        return Prediction(condition, mixture.mean, mixture.widened(self._widening(near)), tuple(filter(None, notes)))

    def left_out(self, campaign: Campaign) -> dict[str, Prediction]:
        """Predictions of the approaches for left-out tests, mixed with the learned weights."""
        self._require("calibration_")
        tests = campaign.evenly_over_speed(MOST_TESTS).tests
        predictions = {}
        for number, components, near in self._alone():
            mixture, test = self._mixed(components), tests[number]
            predictions[test.id] = bands.predicted(test, mixture.mean, mixture.widened(self._widening(near)))
        return predictions

    def _widening(self, near: float) -> float:
        return self.calibration_.widening * self.calibration_.further(near)

    def _reason(self, condition: Condition, weights: FloatArray) -> str:
        away = speed(float(np.abs(self._tests.speeds_mps - condition.speed_mps).min()))
        shown = np.round(100 * weights)
        shown[weights.argmax()] += 100 - shown.sum()  # so that the rounded shares add up to the whole
        order = [i for i in np.argsort(-shown, kind="stable") if shown[i] > 0]
        parts = ", ".join(f"{shown[i]:.0f} % {COMPONENTS[i]}" for i in order)
        n = len(self.calibration_.tests)
        taught = "weights of other vehicles" if self.pretrained_.prior_ is None else "weights of the archive's vehicles"
        source = f"weights learned from {n} tests, each predicted from the others" if n else taught
        return Sentence("Made of {}, because the nearest test is {} away ({}).", parts, away, source)

    @property
    def usual_errors(self) -> Mapping[str, FloatArray]:
        """Those of past vehicles, if they teach this one."""
        taught = self.pretrained_.prior_
        if taught is None:
            return {}
        pair, n = np.array([-1.0, 1.0]), taught.share * _PAST_COUNT / 2  # of the mean and size that all of them have
        return {name: np.tile(e.mean() + e.std() * pair, round(n * e.size)) for name, e in taught.errors.items()}

    def learned(self) -> FittedState:
        """Fitted states of the approaches, and the weights."""
        self._require("calibration_")
        names = ("time", "displacement", "pretrained")
        states = {name: part.learned() for name, part in zip(names, self._learning, strict=True)}
        values, arrays = {"archive": self.archive_, "alike": self.alike_}, {"logits": self.pool_.logits_}
        return FittedState.of(values, arrays, **states, band=self.calibration_.learned())

    def restore(self, campaign: Campaign, learned: FittedState, run: Run = UNKEPT) -> Self:
        """Restore the approaches and the weights."""
        time_domain, displacement_domain, pretrained = self._unfitted()
        self.time_domain_ = time_domain.restore(campaign, learned.part("time"), run)
        self.displacement_domain_ = displacement_domain.restore(campaign, learned.part("displacement"), run)
        self.archive_, self.alike_ = str(learned.values["archive"]), float(learned.values["alike"])
        self.pretrained_ = pretrained.restore(self._weighted(campaign), learned.part("pretrained"), run)
        self._begin(campaign)
        self.pool_.logits_ = learned.arrays["logits"]
        self.calibration_ = Calibration.restored(learned.part("band"))
        return self

    @property
    def state(self) -> dict[str, object]:
        """Weights where all have equally wide bands, and the check of the band."""
        if not hasattr(self, "calibration_"):
            return {}
        weights = self.pool_.weights(np.ones(len(COMPONENTS))).round(4).tolist()
        check = {"band_check": self.calibration_.state} if self.calibration_.tests else {}
        return {**check, "weights_at_equal_bands": dict(zip(COMPONENTS, weights, strict=True))}
