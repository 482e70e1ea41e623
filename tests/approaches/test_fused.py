"""The mixture: it is what its components say, weighted as left-out tests decide, and tells why."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from crashfuse.approaches.base import Approach
from crashfuse.approaches.calibration import Coverage, LeftOut
from crashfuse.approaches.fused import Fused
from crashfuse.approaches.mixture import PRIOR, SPREAD, STRENGTH, Pool, Scores, spread
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.execution.run import Run
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.units import LB, MPH
from tests.conftest import not_none

pytestmark = pytest.mark.usefixtures("quick_networks")


@pytest.fixture(scope="module")
def fused(campaign: Campaign, quick_networks: None) -> Fused:  # noqa: ARG001
    """Fitted to all tests but T3 (26 mph; T2 is at 25)."""
    return Fused().fit(campaign.without(["T3"]))


def _weights(fused: Fused, condition: Condition) -> FloatArray:
    """The weights at a condition: by the spread of what each component draws there over the first 60 ms."""
    parts = [part.predict(condition).draws_mps2 for part in (*fused.parts, fused.pretrained_)]
    tests = fused._tests
    raw = tests.raw(fused.displacement_domain_.model_.pulse(condition).accel_mps2, condition.speed_mps).draws
    spreads = [spread(draws[:, :750:10]) for draws in (*parts, raw) if draws is not None]
    return fused.pool_.weights(np.array(spreads))


def test_the_band_is_checked_around_the_mixture(fused: Fused) -> None:
    """Left-out tests lie inside the band of their own mixture for 95 % of the time on average, though narrowed."""
    check = fused.calibration_
    assert len(check.tests) == 3
    assert check.holds
    assert check.widening <= 1
    inside = sorted(test.accel for test in check.tests)
    assert np.mean(inside) >= 0.95
    assert inside[0] > 0.85
    assert inside[1] > 0.95
    assert all(test.crush and test.peak for test in check.tests)


def test_the_expected_pulse_is_the_weighted_mean_of_its_components(campaign: Campaign, fused: Fused) -> None:
    condition = campaign.test("T3").condition
    parts = [part.predict(condition).accel_mps2 for part in (*fused.parts, fused.pretrained_)]
    components = np.array([*parts, fused.displacement_domain_.model_.pulse(condition).accel_mps2])
    weights = _weights(fused, condition)
    assert weights.sum() == pytest.approx(1)
    np.testing.assert_allclose(fused.predict(condition).accel_mps2, weights @ components, atol=1e-6)


def test_the_reason_is_a_sentence_with_the_weights(campaign: Campaign, fused: Fused) -> None:
    reason, *_ = fused.predict(campaign.test("T3").condition).notes
    source = r"\(weights learned from 3 tests, each predicted from the others\)"
    found = re.fullmatch(rf"Made of (.+), because the nearest test is 1\.0 mph away {source}\.", reason)
    assert found is not None
    shares = dict(part.split(" % ")[::-1] for part in found[1].split(", "))
    assert sum(map(int, shares.values())) == 100
    assert shares.keys() <= {"time domain", "displacement domain", "pre-trained network", "raw CAE"}
    assert list(shares.values()) == sorted(shares.values(), key=int, reverse=True)


def test_the_band_holds_draws_of_its_components_by_their_weights(campaign: Campaign, fused: Fused) -> None:
    """Each drawn pulse is a component's own but for the band's factor, in proportion; the held-out test lies inside."""
    test = campaign.test("T3")
    prediction = fused.predict(test.condition)
    assert prediction.draws_mps2 is not None
    assert len(prediction.draws_mps2) == 400
    of_time = not_none(fused.time_domain_.predict(test.condition).draws_mps2)
    mean = prediction.accel_mps2
    check = fused.calibration_
    found = mean + (prediction.draws_mps2 - mean) / (check.widening * check.further(float(np.exp(-1 / 3))))
    share = np.mean([np.abs(of_time - draw).max(axis=1).min() < 1e-6 for draw in found])
    assert share == pytest.approx(_weights(fused, test.condition)[0], abs=0.01)
    coverage = Coverage.of(test, prediction.draws_mps2)
    assert coverage.accel > 0.9
    assert coverage.crush


@pytest.mark.slow
def test_a_cae_model_that_is_right_keeps_its_component(campaign: Campaign) -> None:
    """Tests that are just as the CAE says: the raw CAE is what is predicted, whoever says it."""
    runs = [campaign.cae.paired_run(test.condition) for test in campaign.tests]
    pulses = [Pulse(GRID_S, campaign.cae.accel_mps2[not_none(run)].astype(float)) for run in runs]
    right = tuple(replace(test, pulse=pulse) for test, pulse in zip(campaign.tests, pulses, strict=True))
    fused = Fused().fit(replace(campaign, tests=right))
    condition = Condition.of_vector([20 * MPH, 2050 * LB, 1550 * LB])
    cae = fused.displacement_domain_.model_.pulse(condition).accel_mps2
    assert np.abs(fused.predict(condition).accel_mps2 - cae).mean() < 0.05 * np.abs(cae).max()


@pytest.mark.slow
def test_a_single_test_is_enough(campaign: Campaign) -> None:
    fused = Fused().fit(campaign.without(["T1", "T3", "T4"]))
    test, condition = campaign.test("T2"), campaign.test("T4").condition  # at 25 and 35 mph
    prediction = fused.predict(condition)
    assert np.isfinite(prediction.accel_mps2).all()
    assert "weights of other vehicles" in prediction.notes[0]
    np.testing.assert_array_equal(fused.pool_.logits_, PRIOR)
    told = {part: int(share) for share, part in re.findall(r"(\d+) % (time|displacement|pre|raw)", prediction.notes[0])}
    told_in_order = [told[part] for part in ("time", "displacement", "pre", "raw")]
    np.testing.assert_allclose(told_in_order, 100 * _weights(fused, condition), atol=1)
    # the last draws are the CAE's, with the error that it had in T2, scaled with the speed, of either sign
    model = fused.displacement_domain_.model_
    error = (test.pulse.accel_mps2 - model.pulse(test.condition).accel_mps2) * 35 / 25
    cae, drawn = model.pulse(condition).accel_mps2, prediction.draws_mps2
    assert drawn is not None
    assert min(np.abs(drawn[-1] - (cae + sign * error)).max() for sign in (-1, 1)) < 1e-6


def _heard(
    campaign: Campaign, cae: CaeModel, parts: Sequence[LeftOut], i: int, out: Sequence[int]
) -> tuple[Scores, FloatArray]:
    """How the components did on a test unseen, over 60 ms on every tenth sample, and what they expected."""
    tests, test = campaign.tests, campaign.tests[i]
    pulses = [cae.pulse(test.condition).accel_mps2 for test in tests]
    rows = [(part, part.numbers.tolist().index(i)) for part in parts]
    ratios = [(j, test.condition.speed_mps / tests[j].condition.speed_mps) for j in range(len(tests)) if j not in out]
    errors = np.array([ratio * (tests[j].pulse.accel_mps2 - pulses[j]) for j, ratio in ratios])
    raw = (pulses[i] + np.concatenate([errors, -errors]))[:, ::10]
    drawn = [*(part.draws_mps2[row] for part, row in rows), raw]
    score = Scores.of(test.pulse.accel_mps2[:750:10], [draws[:, :75] for draws in drawn])
    return score, np.array([*(part.mean_mps2[row] for part, row in rows), pulses[i][::10]])


def test_the_weights_are_learned_from_the_first_60_ms_of_left_out_tests(campaign: Campaign, fused: Fused) -> None:
    rest, cae = campaign.without(["T3"]), fused.displacement_domain_.model_
    learned = [part.left_out_ for part in (fused.time_domain_, fused.displacement_domain_, fused.pretrained_)]
    heard = [_heard(rest, cae, learned, i, [i]) for i in range(3)]
    again = Pool(PRIOR, spread=SPREAD, strength=STRENGTH).fit([score for score, _ in heard])
    np.testing.assert_allclose(fused.pool_.logits_, again.logits_, atol=1e-3)
    expected = fused.left_out(rest)
    assert tuple(expected) == rest.test_ids
    for test_id, (score, means) in zip(rest.test_ids, heard, strict=True):
        mean = fused.pool_.weights(score.spreads) @ means
        np.testing.assert_allclose(expected[test_id].accel_mps2[::10], mean, atol=1e-6)
    told = fused.state["weights_at_equal_bands"]
    assert isinstance(told, dict)
    assert list(told) == ["time domain", "displacement domain", "pre-trained network", "raw CAE"]
    np.testing.assert_allclose(list(told.values()), fused.pool_.weights(np.ones(4)), atol=1e-4)


def test_tests_of_a_speed_group_are_heard_twice(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    """T2 and T3, at 25 and 26 mph: as predicted without themselves, and without both; the others once."""
    rng, model = np.random.default_rng(0), CaeModel().fit(campaign.cae)

    def said() -> LeftOut:
        mean = np.array([test.pulse.accel_mps2[::10] for test in campaign.tests]) * rng.uniform(0.8, 1.2, (4, 1))
        return LeftOut(np.arange(4), mean, (mean[:, None] * rng.uniform(0.9, 1.1, (4, 20, 1))).astype(np.float32))

    known = {"model_": model, "prior_": None, "alikeness": lambda *_: (0.0, "")}
    parts = [SimpleNamespace(left_out_=said(), left_out_groups_=said(), **known) for _ in range(3)]
    taken = iter(parts)
    monkeypatch.setattr(Approach, "fitted", lambda *_: (next(taken), 0.0))
    monkeypatch.setattr("crashfuse.approaches.fused.bands.widening_far", lambda *_: 2.3)
    fused = Fused().fit(campaign)
    alone, groups = ([getattr(part, name) for part in parts] for name in ("left_out_", "left_out_groups_"))
    heard = [_heard(campaign, model, alone, i, [i])[0] for i in range(4)]
    heard += [_heard(campaign, model, groups, i, [1, 2])[0] for i in (1, 2)]
    again = Pool(PRIOR, spread=SPREAD, strength=STRENGTH).fit(heard)
    assert fused.calibration_.widening * fused.calibration_.far == pytest.approx(2.3)
    np.testing.assert_allclose(fused.pool_.logits_, again.logits_, atol=1e-3)


@pytest.mark.slow
def test_what_components_learned_is_taken_from_the_cache(
    campaign: Campaign, fitting_is_an_error: Callable[[], None]
) -> None:
    from crashfuse.study.estimate import Fit

    rest = campaign.without(["T3"])
    for name in ("time_domain", "displacement_domain"):
        Fit.of(rest, name, run=Run())
    fitting_is_an_error()
    assert Fused().fit(rest, Run()).calibration_.tests
