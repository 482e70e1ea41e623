"""The time-domain approach: networks trained on the CAE runs, then fine-tuned on the tests (Sect. 3.1)."""

import copy
from dataclasses import replace
from functools import cached_property
from typing import Self

import numpy as np
from threadpoolctl import threadpool_limits

from crashfuse.approaches.base import MOST_TESTS, FittedState, Prediction
from crashfuse.approaches.calibration import Calibration, Coverage, calibrate
from crashfuse.approaches.fit_cache import settings
from crashfuse.approaches.left_out import LeftOut
from crashfuse.approaches.time_domain.fine_tuning import PENALTIES, Increments, Posterior
from crashfuse.approaches.time_domain.lf_tcn import LfTcn, TcnApproach, thinned
from crashfuse.approaches.time_domain.stopping import SMOOTH_S, Stopping, stopping_notes
from crashfuse.approaches.time_domain.tangent_kernel import TangentKernel
from crashfuse.approaches.time_domain.training import Checkpoint, load_weights, weights_of
from crashfuse.approaches.time_domain.training_data import fine_tune, mean_outputs
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import UsageError
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.signals.pulse import DT_S, FloatArray

_DRIFT_MPS = 12.0  # length scale of increments over speed: a 10 mph test says less about 35 mph than a 30 mph test
_LEAST_FREEDOM = 3  # of the draws; with fewer the variance is infinite
_HELD = Coverage(np.nan, np.nan, np.nan, crush=True, peak=True)


class TimeDomain(TcnApproach):
    """The multi-fidelity (MF) TCN: the LF networks with increments learned from the tests (Eq. 6).

    Parameters as :class:`LfTcn`.

    Attributes
    ----------
    network_ : Tcn
        The LF networks, or the fine-tuned ones if Adam did the fine-tuning.
    scaling_ : Scaling
        Scaling of the LF networks.
    increments_ : Increments
        Posterior over θ_HF; only with fine-tuning in closed form.
    calibration_ : Calibration
        Calibration of the band on tests left out one by one; likewise.
    left_out_ : LeftOut
        Predictions of these tests; likewise.
    losses_ : ndarray, shape (n_members, n_steps)
        Loss on the tests before each step; only after fine-tuning by Adam.
    """

    name = "time_domain"
    label = "Time domain"
    in_words = "the time domain"
    description = (
        "the multi-fidelity (MF) networks: those of the LF TCN with increments of their weights learned from the "
        "tests (Eq. 6); under the fast preset in closed form, their strength chosen by leaving tests out, with the "
        "posterior, widened until it holds on left-out tests, as the band."
    )
    colour, dark_colour = "#0072B2", "#2E93D6"
    preference = 30

    def prepare(self, campaign: Campaign, watch: Watch = SILENT) -> None:
        """Train the LF networks."""
        self._lf().prepare(campaign, watch)

    def fit(self, campaign: Campaign, watch: Watch = SILENT) -> Self:
        """Fine-tune the LF networks on the tests, after training them if they are not in the cache."""
        if not campaign.tests:
            raise UsageError("The time domain learns from tests; this campaign has none.")
        campaign = self._seen(campaign)
        accel = self._begin(campaign, self._lf().fit(campaign, watch))
        if self.config.tuning == "gradient":
            key = {**settings(self), "campaign": campaign.fingerprint}
            checkpoint = Checkpoint(self.cache, {**key, "training": self.name})
            self.network_, self.losses_ = fine_tune(
                self.network_, self.scaling_, self._vectors, accel, self.config, checkpoint, watch
            )
            return self
        self._learn(campaign, watch)
        return self

    def _lf(self) -> LfTcn:
        return LfTcn(self.config, seed=self.seed, device=self._wanted, cache=self.cache)

    def _seen(self, campaign: Campaign) -> Campaign:
        """The campaign with the tests to learn from: all of them for Adam, else thinned."""
        return campaign if self.config.tuning == "gradient" else self._thinned(campaign)

    def _begin(self, campaign: Campaign, lf: LfTcn) -> FloatArray:
        """Start from the LF networks; returns the tests' pulses."""
        self.lf_, self._library, self.scaling_, self.network_ = lf, campaign.cae, lf.scaling_, lf.network_
        self.__dict__.pop("_kernel", None)  # discard that of a previous fit
        self._vectors = np.array([test.condition.vector for test in campaign.tests])
        accel: FloatArray = np.array([test.pulse.accel_mps2 for test in campaign.tests])
        # target outputs for the tests, shape (n_tests, n_times)
        self._targets = self.scaling_.targets(self._vectors, accel, self.config).numpy().T.astype(np.float64)
        self._end_shares = np.array(
            [self._stopping(t.condition).end_share(own) for t, own in zip(campaign.tests, self._targets, strict=True)]
        )
        return accel

    def learned(self) -> FittedState:
        """Fitted state: the LF networks and the increments."""
        self._require("network_")
        lf = self.lf_.learned()
        if self.config.tuning == "gradient":
            return FittedState.of(
                {}, {"losses": self.losses_}, lf=lf, network=FittedState({}, weights_of(self.network_))
            )
        check = self.calibration_
        values = {
            "widening": check.widening,
            "late_widening": check.late_widening,
            "delta_v_misfit": self._delta_v_misfit,
        }
        parts = {"lf": lf, "increments": self.increments_.learned(), "left_out": self.left_out_.learned()}
        return FittedState.of(values, {"inside": check.inside}, **parts)

    def restore(self, campaign: Campaign, learned: FittedState) -> Self:
        """Restore networks and increments."""
        self._begin(self._seen(campaign), self._lf().restore(campaign, learned.part("lf")))
        if self.config.tuning == "gradient":
            self.losses_, self.network_ = learned.arrays["losses"], copy.deepcopy(self.network_)
            load_weights(self.network_, learned.part("network").arrays)
            return self
        self.increments_ = Increments().restore(learned.part("increments"))
        values = learned.values
        self.calibration_ = Calibration.of(values["widening"], learned.arrays["inside"], values["late_widening"])
        self._delta_v_misfit = values["delta_v_misfit"]
        self.left_out_ = LeftOut.restored(learned.part("left_out"))
        return self

    def _learn(self, campaign: Campaign, watch: Watch) -> None:
        lf = mean_outputs(self.network_, self.scaling_.inputs(self._vectors, self.config))
        watch.report("Fine-tuning on tests", 0, 1)
        kernel = self._kernel_between(self._vectors, self._vectors)
        watch.report("Fine-tuning on tests", 1, 1)
        self.increments_ = increments = Increments().fit(kernel, self._targets - lf)
        for number, rho in enumerate(reversed(PENALTIES), start=1):
            errors = {"tests_learned_from": increments.error_[rho], "tests_left_out": increments.left_out_error_[rho]}
            watch.report("Strength of the fine-tuning", number, len(PENALTIES), **errors)

        tests = campaign.tests
        left_out = [
            self._stopped(test.condition, lf[i], increments.left_out_[i], np.delete(self._end_shares, i))
            for i, test in enumerate(tests)
        ]
        pulses: dict[int, FloatArray] = {}

        def check(widening: float, late: float) -> list[Coverage]:
            watch.report("Checking the band on left-out tests", 0, 1)
            for number, (test, posterior) in enumerate(zip(tests, left_out, strict=True)):
                pulses[number] = self._pulses(test.condition, posterior, widening, late)
            return [Coverage.of(tests[number], drawn[1:]) for number, drawn in pulses.items()]

        # Wider draws have higher peaks, so a measured peak below its interval is only reported and does not widen the
        # band. The rebound is less certain and has its own factor.
        first = calibrate(lambda w: [replace(c, rebound=np.nan, peak=True) for c in check(w, w)]).widening
        late = calibrate(lambda w: [replace(_HELD, rebound=c.rebound) for c in check(first, w)]).widening
        self.calibration_ = Calibration(first, tuple(check(first, late)), late)
        self.left_out_ = LeftOut.of(pulses)
        ends = [self._stopping(test.condition).end_share(o.mean) for test, o in zip(tests, left_out, strict=True)]
        self._delta_v_misfit = float(np.abs(np.array(ends) - self._end_shares).mean())

    @cached_property
    def _kernel(self) -> TangentKernel:
        return TangentKernel(self.network_, self.config, self.scaling_.inputs(self._vectors, self.config))

    def _kernel_between(self, ours: FloatArray, theirs: FloatArray) -> FloatArray:
        """Tangent kernel between conditions of shape (n, 3) and (n', 3): shape (n, n_times, n', n_times).

        It decreases with their difference in speed, as increments vary with speed.
        """
        alike = np.exp(-0.5 * ((ours[:, None, 0] - theirs[:, 0]) / _DRIFT_MPS) ** 2)
        inputs = (self.scaling_.inputs(vectors, self.config) for vectors in (ours, theirs))
        return np.asarray(self._kernel.between(*inputs) * alike[:, None, :, None])

    def _stopping(self, condition: Condition) -> Stopping:
        return Stopping.of(condition, self.scaling_, self.config)

    def _stopped(self, condition: Condition, lf: FloatArray, posterior: Posterior, end_shares: FloatArray) -> Posterior:
        """Sum of LF networks and increments, smoothed to real pulses and constrained to a vehicle that stops."""
        both = Posterior(lf + posterior.mean, posterior.covariance).smoothed(SMOOTH_S / (DT_S * self.config.stride))
        return self._stopping(condition).imposed(both, end_shares)

    def _pulses(self, condition: Condition, posterior: Posterior, widening: float, late: float) -> FloatArray:
        """Pulses in m/s², shape (1 + n_draws, 1250): the mean, then draws with widened deviations."""
        n_draws, n_times = self.config.n_draws, posterior.mean.size
        dof = max(len(self._vectors), _LEAST_FREEDOM)
        rng = np.random.default_rng(self.seed)
        normal = posterior.draw(n_draws, rng)
        # Student's t, as the variance itself is learned from a handful of tests
        factors = np.sqrt(max(dof - 2, 1) / rng.chisquare(dof, n_draws))
        wide = widening + (late - widening) * self._stopping(condition).after_t0(posterior.mean)
        deviations = factors[:, None] * normal * wide
        outputs = posterior.mean + np.vstack([np.zeros(n_times), deviations])
        return self.scaling_.pulses(outputs, np.tile(condition.vector, (1 + n_draws, 1)), self.config)

    def predict(self, condition: Condition) -> Prediction:
        """Predict the pulse at a condition, with draws if the increments were learned in closed form."""
        lf = super().predict(condition)
        if not hasattr(self, "increments_"):
            return lf
        vector, check = condition.vector[None], self.calibration_
        *across, own = self._kernel_between(np.vstack([self._vectors, vector]), vector)[:, :, 0]
        expected = mean_outputs(self.network_, self.scaling_.inputs(vector, self.config))[0]
        with threadpool_limits(1):  # small matrices, and the same numbers on any machine
            posterior = self._stopped(
                condition, expected, self.increments_.posterior(np.array(across), own), self._end_shares
            )
            pulses = self._pulses(condition, posterior, check.widening, check.late_widening or check.widening)
        notes = lf.notes + self._thinning + stopping_notes(condition, pulses[0], lf.accel_mps2)
        return replace(lf, accel_mps2=pulses[0], draws_mps2=pulses[1:], notes=notes)

    def left_out(self, campaign: Campaign) -> dict[str, Prediction]:
        """Predictions of the tests from the check of the band; empty after fine-tuning by Adam."""
        self._require("network_")
        return self.left_out_.predictions(campaign.evenly_over_speed(MOST_TESTS)) if hasattr(self, "left_out_") else {}

    @property
    def state(self) -> dict[str, object]:
        """Results of the LF training, choices of the fine-tuning with reasons, and coverage of the band."""
        if not hasattr(self, "network_"):
            return {}
        if self.config.tuning == "gradient":
            curve = thinned(self.losses_.mean(axis=0)[:, None], ("train_loss",))
            return {
                **self.lf_.state,
                "tuning_curve": curve,
                "tuning_steps": self.losses_.shape[1],
                "loss_on_tests_before": float(self.losses_[:, 0].mean()),
                "loss_on_tests_after": float(self.losses_[:, -1].mean()),
                "penalty": self.config.penalty,
            }
        return {
            **self.lf_.state,
            "penalty": self.increments_.penalty_,
            "band_penalty": self.increments_.band_penalty_,
            "rmse": {str(rho): round(error, 4) for rho, error in self.increments_.error_.items()},
            "left_out_rmse": {str(rho): round(error, 4) for rho, error in self.increments_.left_out_error_.items()},
            "left_out_delta_v_misfit": round(self._delta_v_misfit, 4),
            "band_check": self.calibration_.state,
        }
