"""The contract of an approach, and the small campaign of closed-form pulses that it is tested with."""

import json
import re
import threading
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import ClassVar

import numpy as np
import pytest

from crashfuse.approaches.base import Approach, FittedState, Prediction, Settings
from crashfuse.approaches.registry import CLASSES
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.errors import Cancelled, CrashfuseError, NotFittedError, UsageError
from crashfuse.execution.progress import Watch
from crashfuse.execution.run import UNKEPT
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.units import LB, MPH, MS

N_RUNS = 24
TEST_SPEEDS_MPH = (15.0, 25.0, 26.0, 35.0)
_HELD_OUT = "T3"


def _half_sine(condition: Condition, lasts_s: float) -> FloatArray:
    duration_s = lasts_s * condition.mass_kg / 1700
    peak = 1.1 * condition.speed_mps * np.pi / (2 * duration_s)
    return np.where(duration_s > GRID_S, -peak * np.sin(np.pi * GRID_S / duration_s), 0.0)


def small_campaign() -> Campaign:
    """A campaign of 24 CAE runs, four of them paired, and 4 tests, all with closed-form pulses."""
    vectors = ([v * MPH, (2000 + 40 * i) * LB, (1450 + 50 * i) * LB] for i, v in enumerate(TEST_SPEEDS_MPH))
    tested = [Condition.of_vector(vector, (("drive", "FWD"),)) for vector in vectors]
    pulses = [Pulse(GRID_S, _half_sine(condition, 70 * MS)) for condition in tested]  # stiffer than the CAE model
    pairs = enumerate(zip(tested, pulses, strict=True), start=1)
    tests = tuple(CrashTest(f"T{number}", *pair) for number, pair in pairs)
    rng = np.random.default_rng(1)
    # a mass of its own for each run: at one mass half sines are scaled copies, which are told of
    mass = rng.permutation(np.linspace(3363, 3876, N_RUNS - len(tests)))
    speed, share = rng.uniform([[5.0], [0.0]], [[34.5], [1.0]], (2, mass.size))
    front = (1 - share) * np.maximum(mass - 1700, 1950) + share * np.minimum(mass - 1400, 2180)
    runs = zip(speed, front, mass, strict=True)
    conditions = [Condition.of_vector([v * MPH, f * LB, m * LB - f * LB]) for v, f, m in runs]
    conditions += [Condition.of_vector(test.condition.vector) for test in tests]
    accel = np.array([_half_sine(condition, 80 * MS) for condition in conditions], dtype=np.float32)
    return Campaign("Tiny", CaeLibrary(tuple(f"C{i:02d}" for i in range(N_RUNS)), tuple(conditions), accel), tests)


CAMPAIGN = small_campaign()


class ApproachContract:
    """What every approach promises: subclass it, name the class in ``approach``, and let pytest collect it."""

    approach: ClassVar[type[Approach]]

    def created(self) -> Approach:
        """The approach, unfitted."""
        return self.approach.create(Settings())

    def fitted(self) -> Approach:
        """The approach, fitted once without the held-out test."""
        return _fitted(self.approach)

    def test_it_says_all_that_is_shown_of_it(self) -> None:
        """Label, sentence name, description, colours and preference, none of which another one has."""
        approach, others = self.approach, [other for other in CLASSES.values() if other.name != self.approach.name]
        assert issubclass(approach, CLASSES.get(approach.name, Approach))
        assert approach.label
        assert approach.in_words.startswith("the ")
        assert re.fullmatch(r"[^.]{20}.*\.", approach.description)
        for colour in (approach.colour, approach.dark_colour or approach.colour):
            assert re.fullmatch(r"#[0-9A-F]{6}", colour)
            assert colour not in [shade for other in others for shade in (other.colour, other.dark_colour)]
        assert approach.dash in ("solid", "dash", "dot", "dashdot")
        for said in ("label", "in_words", "description", "preference"):
            assert getattr(approach, said) not in [getattr(other, said) for other in others]

    def test_it_predicts_a_whole_finite_pulse_the_same_each_time(self) -> None:
        """On the study grid, with draws on it too if it has a band; it remembers nothing of having been asked."""
        condition = CAMPAIGN.test(_HELD_OUT).condition
        prediction = self.fitted().predict(condition)
        assert prediction.condition == condition
        assert prediction.accel_mps2.shape == GRID_S.shape
        assert np.isfinite(prediction.accel_mps2).all()
        if prediction.draws_mps2 is not None:
            assert prediction.draws_mps2.shape[1:] == GRID_S.shape
            assert np.isfinite(prediction.draws_mps2).all()
        self.fitted().predict(CAMPAIGN.tests[0].condition)
        assert _same(prediction, self.fitted().predict(condition))

    def test_a_refit_forgets_and_a_held_out_pulse_changes_nothing(self) -> None:
        """Fitted to all tests and then without one whose pulse is another, it predicts that one to the same bits."""
        test = CAMPAIGN.test(_HELD_OUT)
        other = replace(test, pulse=Pulse(GRID_S, 3 * test.pulse.accel_mps2 - 7))
        changed = replace(CAMPAIGN, tests=tuple(other if each is test else each for each in CAMPAIGN.tests))
        approach = self.created()
        approach.fit(changed).predict(test.condition)
        assert approach.fit(changed.without([_HELD_OUT])) is approach
        assert _same(approach.predict(test.condition), self.fitted().predict(test.condition))

    def test_its_fitted_state_predicts_the_same_bits(self) -> None:
        """What it learned goes through JSON and arrays; so does what it says of its fit and of tests left out."""
        rest = CAMPAIGN.without([_HELD_OUT])
        left_out = self._check_restored(rest, self.fitted())
        assert set(left_out) <= set(rest.test_ids)
        assert all(prediction.accel_mps2.shape == GRID_S.shape for prediction in left_out.values())

    def test_of_many_tests_it_learns_from_some_and_so_does_what_is_restored(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """With more tests than are learned from, its fitted state predicts the same bits, left-out tests included."""
        monkeypatch.setattr("crashfuse.approaches.base.MOST_TESTS", 3)
        left_out = self._check_restored(CAMPAIGN, self.created().fit(CAMPAIGN))
        assert len(left_out) <= 3 or not self.approach.learns_from_tests

    def _check_restored(self, campaign: Campaign, fitted: Approach) -> Mapping[str, Prediction]:
        learned, restored = fitted.learned(), self.created()
        kept = FittedState(json.loads(json.dumps(learned.values)), dict(learned.arrays))
        assert restored.restore(campaign, kept) is restored
        condition = CAMPAIGN.test(_HELD_OUT).condition
        assert _same(restored.predict(condition), fitted.predict(condition))
        assert json.dumps(restored.state) == json.dumps(fitted.state)
        one, two = fitted.left_out(campaign), restored.left_out(campaign)
        assert one.keys() == two.keys()
        assert all(_same(one[test], two[test]) for test in one)
        return one

    def test_what_it_mixes_can_be_predicted_by_others(self) -> None:
        """Given its parts' predictions it makes the same of them as alone."""
        approach, condition = self.fitted(), CAMPAIGN.test(_HELD_OUT).condition
        assert all(isinstance(*each) for each in zip(approach.parts, approach.made_of, strict=True))
        assert all(part.preference > approach.preference for part in approach.parts)
        parts = [part.predict(condition) for part in approach.parts]
        assert _same(approach.predict_from(condition, parts), approach.predict(condition))

    def test_before_it_is_fitted_it_says_so(self) -> None:
        """One sentence with what to call; and nothing to say of a fit."""
        approach = self.created()
        with pytest.raises(
            NotFittedError, match=rf"{self.approach.name} has not been fitted; call fit\(campaign\) first"
        ):
            approach.predict(CAMPAIGN.tests[0].condition)
        with pytest.raises(NotFittedError):
            approach.learned()
        assert approach.state == {}

    def test_a_fit_that_is_cancelled_ends_at_its_next_report(self) -> None:
        """The event is set before anything is computed."""
        cancel = threading.Event()
        cancel.set()
        with pytest.raises(Cancelled, match="Stopped on request"):
            self.created().fit(CAMPAIGN, replace(UNKEPT, watch=Watch(cancel=cancel)))

    def test_without_tests_it_fits_or_says_that_it_needs_some(self) -> None:
        """What learns from tests says so; what does not is as good without."""
        bare, condition = CAMPAIGN.without(CAMPAIGN.test_ids), CAMPAIGN.tests[0].condition
        approach = self.created()
        if approach.learns_from_tests:
            with pytest.raises(UsageError, match="learns from tests; this campaign has none"):
                approach.fit(bare)
        else:
            assert _same(approach.fit(bare).predict(condition), self.created().fit(CAMPAIGN).predict(condition))

    def test_of_too_few_cae_runs_it_says_so(self) -> None:
        """None is too few for all; one is enough, or it is said in a sentence."""
        with pytest.raises(CrashfuseError, match=r"CAE runs"):
            self.created().fit(_runs(CAMPAIGN, 0))
        approach, trouble = self.created(), ""
        try:
            approach.fit(_runs(CAMPAIGN, 1))
        except UsageError as error:
            trouble = str(error)
        assert "at least 2" in trouble or np.isfinite(approach.predict(CAMPAIGN.tests[0].condition).accel_mps2).all()


@cache
def _fitted(approach: type[Approach]) -> Approach:
    return approach.create(Settings()).fit(CAMPAIGN.without([_HELD_OUT]))


def _same(one: Prediction, other: Prediction) -> bool:
    draws = [b"" if each.draws_mps2 is None else each.draws_mps2.tobytes() for each in (one, other)]
    return one.accel_mps2.tobytes() == other.accel_mps2.tobytes() and draws[0] == draws[1] and one.notes == other.notes


def _runs(campaign: Campaign, n: int) -> Campaign:
    cae = campaign.cae
    return replace(campaign, cae=CaeLibrary(cae.ids[:n], cae.conditions[:n], cae.accel_mps2[:n]))
