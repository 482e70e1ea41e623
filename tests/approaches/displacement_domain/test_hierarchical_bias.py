"""The hierarchical bias model, on biases whose parts are known."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from crashfuse.approaches.displacement_domain.bias import BiasPoints, CaeForce, CaeStop
from crashfuse.approaches.displacement_domain.hierarchical_bias import PAST_CRUSH_M, PAST_SPEEDS_MPS, HierarchicalBias
from crashfuse.condition import Condition
from crashfuse.signals.pulse import FloatArray

S = np.linspace(0, 0.5, 26)
SHARE = np.sqrt(1 - S / 0.5)
SHARES = np.linspace(0, 1, 101)
NO_HUMP = CaeStop(SHARES, np.zeros(101), 0.4)


def condition(speed_mps: float) -> Condition:
    return Condition.of_vector([speed_mps, 950.0, 700.0])


def cae(speed_mps: float) -> FloatArray:
    return np.asarray(-10 * speed_mps * (1 - np.exp(-S / 0.1)) + 30 * np.sin(20 * S))


def force(speed_mps: float) -> CaeForce:
    return CaeForce.at(S, lambda s: np.interp(s, S, cae(speed_mps)))


def fit(biases: Mapping[float, FloatArray]) -> HierarchicalBias:
    return HierarchicalBias().fit([BiasPoints(condition(v), S, SHARE, force(v), bias) for v, bias in biases.items()])


def with_factor(values: str, effect: FloatArray) -> HierarchicalBias:
    """Fit to tests at 6 to 15 m/s, one for each letter; those of value B have ``effect`` on top of what all share."""
    tests = []
    for speed, value in zip(np.linspace(6, 15, len(values)).tolist(), values, strict=True):
        at = Condition.of_vector([speed, 950.0, 700.0], factors=(("powertrain", value),))
        tests.append(BiasPoints(at, S, SHARE, force(speed), shared(S) + (value == "B") * effect))
    return HierarchicalBias().fit(tests)


def moving(at: Condition) -> BiasPoints:
    """Where a crash shows the bias before its stop."""
    return BiasPoints(at, S, np.ones_like(S), force(at.speed_mps))


def mean_and_width(model: HierarchicalBias, speed_mps: float) -> tuple[FloatArray, FloatArray]:
    """Mean bias and the standard deviation of the draws at a speed."""
    rng = np.random.default_rng(0)
    draws = model.sample(moving(condition(speed_mps)), NO_HUMP, 400, rng).over_displacement_mps2
    return draws[0], draws[1:].std(axis=0)


def shared(s: FloatArray) -> FloatArray:
    return np.asarray(-60 * np.exp(-(((s - 0.2) / 0.1) ** 2)))


def test_a_bias_that_all_tests_share_is_recovered_at_any_speed() -> None:
    """To 5 % of its height, within and beyond the tested speeds, and the band is narrow there."""
    model = fit({v: shared(S) for v in (6.0, 9.0, 12.0, 15.0)})
    for speed in (4.0, 10.0, 16.0):
        mean, width = mean_and_width(model, speed)
        np.testing.assert_allclose(mean, shared(S), atol=3.0)
        assert width[2:22].max() < 15.0


def test_a_bias_in_proportion_to_the_cae_force_is_carried_to_other_speeds() -> None:
    """A structure 20 % stiffer at every speed has that bias at an untested speed too, in the CAE curve's own shape."""
    mean, _ = mean_and_width(fit({v: 0.2 * cae(v) for v in (5.0, 7.0, 9.0, 11.0)}), 15.0)
    assert np.sqrt(np.mean((mean - 0.2 * cae(15.0)) ** 2)) < 0.25 * np.sqrt(np.mean((0.2 * cae(15.0)) ** 2))


def test_tests_that_contradict_each_other_are_not_believed() -> None:
    """Repeats at one speed with opposite biases: the prediction stays near the CAE model, and the band is wide."""
    mean, width = mean_and_width(fit({10.0: shared(S), 10.01: -shared(S), 9.99: shared(S), 10.02: -shared(S)}), 10.0)
    assert np.abs(mean).max() < 0.25 * np.abs(shared(S)).max()
    assert width.max() > 0.4 * np.abs(shared(S)).max()


def test_how_each_test_stops_does_not_blur_what_they_share() -> None:
    wild = np.where(SHARE < 0.2, 150.0, 0.0)
    signs = {7.0: 1, 9.0: -1, 11.0: 1, 13.0: -1}
    mean, _ = mean_and_width(fit({v: shared(S) + sign * wild for v, sign in signs.items()}), 10.0)
    np.testing.assert_allclose(mean[:20], shared(S)[:20], atol=5.0)


def test_a_bias_of_noise_alone_is_said_to_be_one() -> None:
    rng = np.random.default_rng(0)
    model = fit({v: 30 * rng.normal(size=S.size) for v in (6.0, 9.0, 12.0)})
    assert model.state["dead"] is True
    assert "nothing" in model.notes[0]


def test_the_parts_add_up_to_what_is_expected() -> None:
    model = fit({v: v / 10 * shared(S) + 0.1 * cae(v) for v in (6.0, 8.0, 12.0, 14.0)})
    *parts, total = model.parts(moving(condition(10.0)))
    assert [part.name for part in parts] == ["shared", "by speed", "by weight", "ratio", "humps", "own"]
    draws = model.sample(moving(condition(10.0)), NO_HUMP, 8000, np.random.default_rng(0)).over_displacement_mps2
    np.testing.assert_allclose(sum(part.mean_mps2 for part in parts), draws[0], atol=1e-6)
    np.testing.assert_allclose(total.mean_mps2, draws[0], atol=1e-9)
    lower, upper = np.quantile(draws[1:], [0.025, 0.975], axis=0)
    np.testing.assert_allclose(total.upper_mps2 - total.lower_mps2, upper - lower, rtol=0.1)


def test_nothing_is_known_of_what_a_new_test_has_alone_but_its_size() -> None:
    alike = fit({v: shared(S) for v in (9.9, 10.0, 10.1, 10.2)}).parts(moving(condition(10.0)))[-2]
    wiggle = 15 * np.sin(S / 0.05)
    unlike = fit({9.9: shared(S) + wiggle, 10.0: shared(S) - wiggle, 10.1: shared(S), 10.2: shared(S) + 2 * wiggle})
    own = unlike.parts(moving(condition(10.0)))[-2]
    np.testing.assert_allclose(own.mean_mps2, 0.0, atol=1e-9)
    np.testing.assert_allclose(own.upper_mps2, own.upper_mps2[0], rtol=1e-9)
    assert own.upper_mps2[0] > 3 * alike.upper_mps2[0]


def test_humps_of_the_cae_model_that_no_test_shows_are_taken_out_of_its_stop_too() -> None:
    """It swings by up to 40 m/s² while it stops, now up, now down; tests have its trend alone, so has a new one."""
    s = np.linspace(0, 0.5, 101)
    share = np.sqrt(1 - s / 0.5)
    swing = np.maximum(1 - SHARES / HierarchicalBias.end_share, 0.0)

    def beside(speed_mps: float, size: float) -> BiasPoints:
        trend, humps = -15 * speed_mps * np.ones_like(s), 50 * np.sin(60 * s)
        accel = trend + humps + size * np.interp(share, SHARES, swing)
        return BiasPoints(condition(speed_mps), s, share, CaeForce(accel, trend), trend - accel)

    sizes = {7.0: 40.0, 8.0: -30.0, 9.0: 35.0, 11.0: -40.0, 12.0: 30.0, 13.0: -35.0}
    model = HierarchicalBias().fit([beside(speed, size) for speed, size in sizes.items()])
    for size in (40.0, -40.0):
        new = beside(10.0, 0.0)
        crush = replace(new, speed_share=np.ones_like(s))
        bias = model.sample(crush, CaeStop(SHARES, size * swing, 0.5), 2, np.random.default_rng(0))
        np.testing.assert_allclose(bias.over_speed_mps2[0], -size * swing, atol=8.0)
        np.testing.assert_allclose(bias.over_displacement_mps2[0], new.bias_mps2, atol=5.0)


@pytest.mark.slow
def test_a_factor_that_tells_tests_apart_is_used() -> None:
    """The bias of vehicles with the other powertrain is predicted for a new test with it, and no other."""
    effect = np.asarray(40 * np.sin(12 * S))
    model = with_factor("ABABABAB", effect)
    assert model.factors_ == ("powertrain",)
    assert model.densities_["powertrain"] > model.densities_["none"]
    for value, expected in (("A", shared(S)), ("B", shared(S) + effect)):
        at = Condition.of_vector([10.0, 950.0, 700.0], factors=(("powertrain", value),))
        mean = model.sample(moving(at), NO_HUMP, 4, np.random.default_rng(0)).over_displacement_mps2[0]
        np.testing.assert_allclose(mean, expected, atol=6.0)
    assert model.unknown_factors(at) == ()
    assert model.unknown_factors(condition(10.0)) == ("powertrain",)
    assert "by powertrain" in [part.name for part in model.parts(moving(at))]
    assert any("powertrain" in note for note in model.notes)


@pytest.mark.parametrize("values", ["ABABABAB", "AAAAAA", "AAAAAB", "ABCDEF"])
def test_a_factor_without_effect_or_that_no_two_pairs_of_tests_share_is_not_used(values: str) -> None:
    """Test numbers, dates and single vehicles tell nothing that could be checked, and are not even tried."""
    model = with_factor(values, 0 * S)
    assert (model.factors_, model.state["factors"]) == ((), [])
    assert list(model.densities_) == (["none", "powertrain"] if values == "ABABABAB" else ["none"])


def test_leaving_a_test_out_forgets_it() -> None:
    """The model without a test predicts as one that was told of the others alone, with the same hyperparameters."""
    biases = {v: shared(S) * v / 10 for v in (6.0, 9.0, 12.0, 15.0)}
    model = fit(biases)
    rest = model.without(1)
    assert set(np.unique(rest.process_.x_[:, -1])) == {0.0, 2.0, 3.0}
    odd = fit({**biases, 9.0: 10 * shared(S)})
    odd.process_.theta_, odd.process_.output_scale_ = model.process_.theta_, model.process_.output_scale_
    odd.process_._y = np.where(odd.process_.x_[:, -1] == 1, 0.0, model.process_._y)  # what is left out may be anything
    odd.process_._condition()
    np.testing.assert_allclose(mean_and_width(odd.without(1), 9.0)[0], mean_and_width(rest, 9.0)[0], atol=1e-9)


def points(speed_mps: float) -> BiasPoints:
    """Where a test at this speed lies; its bias is not looked at."""
    return BiasPoints(condition(speed_mps), S, SHARE, force(speed_mps), np.full(S.size, np.nan))


def test_tests_to_come_narrow_the_band_and_leave_the_mean() -> None:
    """One as foretold by the closed form, most at its own speed; several add up."""
    model = fit({v: shared(S) * v / 10 for v in (6.0, 9.0, 15.0, 15.2)})
    targets, further = [points(12.0), points(6.0)], [points(12.0), points(15.0)]
    now, then = model.half_widths(targets, further)
    assert now.shape == (2 * S.size,)
    assert then[0, : S.size].mean() < then[1, : S.size].mean() < now[: S.size].mean()
    more = model.also(further[:1])
    assert more.freedom_ == 4
    np.testing.assert_allclose(more.half_widths(targets, [])[0], then[0], rtol=1e-6)
    np.testing.assert_allclose(mean_and_width(more, 12.0)[0], mean_and_width(model, 12.0)[0], atol=1e-4)
    twice = model.also(further)
    assert twice.tests_ == 6
    assert (twice.half_widths(targets, [])[0] < more.half_widths(targets, [])[0]).all()
    assert model.process_.x_.shape[0] == 4 * S.size


def over_crush(bias_mps2: FloatArray) -> FloatArray:
    """A bias at :data:`S` as past vehicles teach it: the same at all speeds, no share of humps."""
    return np.vstack([np.tile(np.interp(PAST_CRUSH_M, S, bias_mps2), (5, 1)), 0 * PAST_CRUSH_M])


def test_a_taught_bias_is_the_prior_mean() -> None:
    """Taken off the tests before anything is learned, added to all that is predicted: tests like it are probable."""
    speeds, mean = (6.0, 9.0, 14.0), np.interp(S, PAST_CRUSH_M, np.interp(PAST_CRUSH_M, S, 2 * shared(S)))
    rest = {v: 0.2 * v * np.cos(4 * S) for v in speeds}
    tests = [BiasPoints(condition(v), S, SHARE, force(v), rest[v] + mean) for v in speeds]
    taught, alone = HierarchicalBias(taught=over_crush(mean)).fit(tests), fit(rest)
    assert taught.log_evidence == pytest.approx(alone.log_evidence)
    assert taught.log_evidence > HierarchicalBias().fit(tests).log_evidence
    moments = [model.common([moving(condition(8.0))]) for model in (taught, alone)]
    for ours, theirs in zip(*moments, strict=True):
        np.testing.assert_allclose(ours, theirs + (mean if ours.ndim == 1 else 0), atol=1e-6)
    np.testing.assert_allclose(mean_and_width(taught, 8.0)[0], mean_and_width(alone, 8.0)[0] + mean, atol=1e-6)
    *parts, total = taught.parts(moving(condition(8.0)))
    assert parts[-1].name == "past vehicles"
    np.testing.assert_allclose(sum(part.mean_mps2 for part in parts), total.mean_mps2, atol=1e-6)


def test_what_one_vehicle_teaches_is_what_its_tests_show() -> None:
    """At each speed over crush without its humps; and half of the humps, if its tests show half of them."""
    speeds = PAST_SPEEDS_MPS.tolist()
    humps = {v: force(v).accel_mps2 - force(v).trend_mps2 for v in speeds}
    model = fit({v: shared(S) - 0.5 * humps[v] for v in speeds})
    forces = [CaeForce(*(np.interp(PAST_CRUSH_M, S, curve) for curve in force(v))) for v in speeds]
    at = [BiasPoints(condition(v), PAST_CRUSH_M, np.ones(60), cae) for v, cae in zip(speeds, forces, strict=True)]
    *bias, share = model.to_teach(at)
    tested = slice(1, 23)
    np.testing.assert_allclose(np.array(bias)[:, tested], shared(PAST_CRUSH_M)[None, tested].repeat(5, 0), atol=8)
    np.testing.assert_allclose(share[tested] / 98.0665, -0.5, atol=0.2)
