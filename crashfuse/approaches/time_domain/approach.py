"""The time-domain approach: networks trained on the CAE runs, then fine-tuned on the tests (Sect. 3.1)."""

import copy
from collections.abc import Sequence
from dataclasses import replace
from typing import Self

import numpy as np

from crashfuse.approaches.base import MOST_TESTS, FittedState, Prediction
from crashfuse.approaches.calibration import BandedApproach, LeftOut, check_band_far, speed_groups
from crashfuse.approaches.neighbours import nearness
from crashfuse.approaches.time_domain.band import Band, Stopping, stopping_notes
from crashfuse.approaches.time_domain.config import AboutTimeDomain
from crashfuse.approaches.time_domain.fine_tuning import PENALTIES, Increments, Posterior
from crashfuse.approaches.time_domain.lf_tcn import LfTcn, TcnApproach, thinned
from crashfuse.approaches.time_domain.tangent_kernel import KernelBlocks
from crashfuse.approaches.time_domain.training import Checkpoint, fine_tune, load_weights, mean_outputs, weights_of
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.execution.progress import Watch
from crashfuse.execution.run import UNKEPT, Run, one_thread
from crashfuse.signals.pulse import FloatArray

_DRIFT_MPS = 12.0  # length scale of increments over speed: a 10 mph test says less about 35 mph than a 30 mph test
_KERNEL_STEP = "Derivatives of the LF networks"


class TimeDomain(AboutTimeDomain, TcnApproach, BandedApproach):
    """The multi-fidelity (MF) TCN: the LF networks with increments learned from the tests (Eq. 6).

    ``increments_``, the posterior over θ_HF, and the band are only there with fine-tuning in closed form, ``losses_``
    on the tests before each step, shape (n_members, n_steps), only after fine-tuning by Adam.
    """

    def prepare(self, campaign: Campaign, conditions: Sequence[Condition], run: Run = UNKEPT) -> None:
        """Train the LF networks, and compute the tangent kernel between these conditions."""
        lf = self._lf().fit(campaign, run)
        if self.config.tuning == "posterior" and 0 < len(conditions) <= MOST_TESTS + 1:  # of more, others are chosen
            run.watch.report(_KERNEL_STEP, 0, 1)
            self._blocks(lf, campaign, run).among(np.array([condition.vector for condition in conditions]))
            run.watch.report(_KERNEL_STEP, 1, 1)

    def fit(self, campaign: Campaign, run: Run = UNKEPT) -> Self:
        """Fine-tune the LF networks on the tests, after training them if they are not in the cache."""
        self._require_tests(campaign)
        campaign = self._seen(campaign)
        accel = self._begin(campaign, self._lf().fit(campaign, run), run)
        if self.config.tuning == "gradient":
            key = {**self.identity, "campaign": campaign.fingerprint, "training": self.name}
            checkpoint = Checkpoint(run, key)
            self.network_, self.losses_ = fine_tune(self.network_, self.scaling_, self._vectors, accel, checkpoint)
        else:
            self._learn(campaign, run.watch)
        return self

    def _lf(self) -> LfTcn:
        return LfTcn(self.config, seed=self.seed, device=self._wanted)

    def _seen(self, campaign: Campaign) -> Campaign:
        return campaign if self.config.tuning == "gradient" else self._thinned(campaign)

    def _begin(self, campaign: Campaign, lf: LfTcn, run: Run) -> FloatArray:
        self.lf_, self._library, self.scaling_, self.network_ = lf, campaign.cae, lf.scaling_, lf.network_
        self._kernel = self._blocks(lf, campaign, run)
        self._vectors = np.array([test.condition.vector for test in campaign.tests])
        accel: FloatArray = np.array([test.pulse.accel_mps2 for test in campaign.tests])
        # target outputs for the tests, shape (n_tests, n_times)
        self._targets = self.scaling_.targets(self._vectors, accel).numpy().T.astype(np.float64)
        self._band = Band.of(campaign.tests, self._targets, self.scaling_, self.seed)
        return accel

    def learned(self) -> FittedState:
        """The LF networks and the increments."""
        self._require("network_")
        lf = self.lf_.learned()
        if self.config.tuning == "gradient":
            network = FittedState({}, weights_of(self.network_))
            return FittedState.of({}, {"losses": self.losses_}, lf=lf, network=network)
        parts = {"lf": lf, "increments": self.increments_.learned(), **self._learned_band()}
        return FittedState.of({"delta_v_misfit": self._delta_v_misfit}, {}, **parts)

    def restore(self, campaign: Campaign, learned: FittedState, run: Run = UNKEPT) -> Self:
        """Restore networks and increments."""
        self._begin(self._seen(campaign), self._lf().restore(campaign, learned.part("lf")), run)
        if self.config.tuning == "gradient":
            self.losses_, self.network_ = learned.arrays["losses"], copy.deepcopy(self.network_)
            load_weights(self.network_, learned.part("network").arrays)
            return self
        self.increments_ = Increments().restore(learned.part("increments"))
        self._restore_band(learned)
        self._delta_v_misfit = learned.values["delta_v_misfit"]
        return self

    def fit_key(self, campaign: Campaign) -> dict[str, object]:
        """Of the runs that it is trained on."""
        return super().fit_key(replace(campaign, cae=campaign.cae.for_networks))

    def _learn(self, campaign: Campaign, watch: Watch) -> None:
        lf = mean_outputs(self.network_, self.scaling_.inputs(self._vectors))
        watch.report("Fine-tuning on tests", 0, 1)
        kernel = self._kernel.among(self._vectors) * self._alike(self._vectors)[:, None, :, None]
        watch.report("Fine-tuning on tests", 1, 1)
        groups = speed_groups(campaign)
        self.increments_ = increments = Increments().fit(kernel, self._targets - lf, groups)
        for number, rho in enumerate(reversed(PENALTIES), start=1):
            errors = {"tests_learned_from": increments.error_[rho], "tests_left_out": increments.left_out_error_[rho]}
            watch.report("Strength of the fine-tuning", number, len(PENALTIES), **errors)

        tests = campaign.tests

        def without(number: int, out: tuple[int, ...]) -> Posterior:
            posterior = increments.left_out_[out][out.index(number)]
            return self._band.stopped(tests[number].condition, lf[number], posterior, out)

        left_out = {number: without(number, (number,)) for number in range(len(tests))}
        calibration, pulses = self._band.check(tests, left_out, watch)
        alone = LeftOut.of(pulses)
        for number, group in enumerate(groups):
            if len(group) > 1:
                pulses[number] = self._band.pulses(tests[number].condition, without(number, group), calibration)
        apart = LeftOut.of(pulses if max(map(len, groups)) < len(tests) else {})
        self.calibration_, self.left_out_, self.left_out_groups_ = check_band_far(campaign, calibration, alone, apart)
        ends = [Stopping.of(tests[n].condition, self.scaling_).end_share(p.mean) for n, p in left_out.items()]
        self._delta_v_misfit = float(np.abs(np.array(ends) - self._band.end_shares).mean())

    def _blocks(self, lf: LfTcn, campaign: Campaign, run: Run) -> KernelBlocks:
        library = campaign.cae.for_networks.fingerprint
        return KernelBlocks(lf.network_, self.config, lf.scaling_.inputs, library, run.cache)

    def _alike(self, vectors: FloatArray) -> FloatArray:
        return np.asarray(np.exp(-0.5 * ((self._vectors[:, None, 0] - vectors[:, 0]) / _DRIFT_MPS) ** 2))

    def predict(self, condition: Condition) -> Prediction:
        """Predict the pulse at a condition, with draws if the increments were learned in closed form."""
        lf = super().predict(condition)
        if not hasattr(self, "increments_"):
            return lf
        vector = condition.vector[None]
        across, here = self._kernel.between(self._vectors, condition.vector)
        across = across * self._alike(vector)[:, :, None]
        expected = mean_outputs(self.network_, self.scaling_.inputs(vector))[0]
        with one_thread():
            posterior = self._band.stopped(condition, expected, self.increments_.posterior(across, here))
            further = self.calibration_.further(nearness(condition.speed_mps, self._vectors[:, 0]))
            pulses = self._band.pulses(condition, posterior, self.calibration_, further)
        notes = lf.notes + self._thinning + stopping_notes(condition, pulses[0], lf.accel_mps2)
        return replace(lf, accel_mps2=pulses[0], draws_mps2=pulses[1:], notes=notes)

    def left_out(self, campaign: Campaign) -> dict[str, Prediction]:
        """Predictions of the tests from the check of the band; empty after fine-tuning by Adam."""
        self._require("network_")
        return super().left_out(campaign) if hasattr(self, "left_out_") else {}

    @property
    def state(self) -> dict[str, object]:
        """Results of the LF training, choices of the fine-tuning, and coverage of the band."""
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
