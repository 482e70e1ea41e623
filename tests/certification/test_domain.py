"""The validated domain: as far as left-out tests check it in speed, mass, factors, and within the CAE runs."""

import re
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crashfuse.campaign import Campaign
from crashfuse.certification.domain import Domain
from crashfuse.condition import Condition
from crashfuse.crash_test import SPEED_STEP_MPS, CrashTest
from crashfuse.testing import small_campaign
from crashfuse.units import KPH_KG, LB, MPH, MPH_LB, UnitSystem, said


def at(speed_mph: float, mass_lb: float = 3600.0, drive: str = "FWD") -> Condition:
    """A condition in mph and lb, its weight divided as in the tests."""
    return Condition.of_vector([speed_mph * MPH, 0.58 * mass_lb * LB, 0.42 * mass_lb * LB], (("drive", drive),))


@pytest.fixture(scope="module")
def wide() -> Campaign:
    """Tests at 15, 25, 26 and 35 mph; CAE runs over a range that leaves the tests to decide."""
    campaign = small_campaign()
    vectors = [(4.0, 1500.0, 1100.0), (60.0, 3000.0, 2200.0)]
    ends = tuple(Condition.of_vector([v * MPH, f * LB, r * LB]) for v, f, r in vectors)
    cae = campaign.cae
    conditions = (*ends, *cae.conditions[2:])
    return replace(campaign, cae=replace(cae, conditions=conditions))


def with_tests(campaign: Campaign, *speeds_mph: float, **drives: str) -> Campaign:
    """The campaign with the first test at these speeds; some, by their ids, with another drive."""
    first = campaign.tests[0]
    conditions = {f"T{i}": replace(first.condition, speed_mps=v * MPH) for i, v in enumerate(speeds_mph)}
    conditions |= {i: replace(conditions[i], factors=(("drive", drive),)) for i, drive in drives.items()}
    tests = tuple(CrashTest(i, condition, first.pulse) for i, condition in conditions.items())
    return replace(campaign, tests=tests)


def test_no_test_shows_a_peak_beyond_the_fastest(wide: Campaign) -> None:
    """A structure may bottom out there; up to 1 km/h are a little off."""
    domain = Domain.of(wide)
    assert [mph for mph in (10.0, 35.0, 35.6, 35.7) if domain.unshown(at(mph))] == [35.7]


@pytest.mark.parametrize(
    ("speed_mph", "said"),
    [
        (10.2, None),
        (9.8, "9.8 mph is 5.2 mph below the slowest test; the tests check up to 5.0 mph below it."),
        (20.0, None),
        (30.5, None),
        (39.9, None),
        (40.2, "40.2 mph is 5.2 mph above the fastest test; the tests check up to 5.0 mph above it."),
    ],
)
def test_speed_is_checked_as_far_as_groups_were_left_out(wide: Campaign, speed_mph: float, said: str | None) -> None:
    """Between tests as far as the widest gap that was predicted, beyond the ends not more than 5 mph."""
    assert Domain.of(wide).exceeded_by(at(speed_mph)) == (() if said is None else (said,))


@pytest.mark.parametrize(
    ("speeds_mph", "reach_mph"),
    [((15.0, 18.0, 23.0, 28.0), 5.0), ((15.0, 18.0, 21.0, 30.0), 3.0), ((15.0, 18.0, 21.0, 45.0), 3.0)],
)
def test_a_group_that_lay_outside_the_others_does_not_widen_what_is_checked(
    wide: Campaign, speeds_mph: tuple[float, ...], reach_mph: float
) -> None:
    """The fastest test at 28 mph was predicted by the others; of those at 30 and 45 mph they gave no verdict."""
    campaign = with_tests(wide, *speeds_mph)
    assert Domain.of(campaign).reach_mps == pytest.approx(reach_mph * MPH)
    assert ("T3" in Domain.of(campaign).inside) is (speeds_mph[-1] == 28.0)
    widest = max(after - before for before, after in pairwise(speeds_mph))
    assert Domain.of(campaign, for_record=True).reach_mps == pytest.approx(widest * MPH)


def test_a_group_that_lay_outside_by_its_factor_does_not_widen_what_is_checked_either(wide: Campaign) -> None:
    """No other test had its drive, so that it got no verdict when it was left out."""
    speeds = (15.0, 18.0, 23.0, 28.0)
    assert Domain.of(with_tests(wide, *speeds, T3="AWD")).reach_mps == pytest.approx(5.0 * MPH)  # from 23 to 18 mph
    assert Domain.of(with_tests(wide, *speeds, T3="AWD", T2="4WD")).reach_mps == pytest.approx(3.0 * MPH)


def test_a_test_that_the_cae_model_was_tuned_to_checks_nothing(wide: Campaign) -> None:
    """The domain is that of the others, with a sentence on why; four of them it takes."""
    campaign = with_tests(wide, 15.0, 18.0, 23.0, 28.0, 33.0)
    tuned = replace(campaign, tests=(*campaign.tests[:4], replace(campaign.tests[4], cae_tuned=True)))
    fastest = replace(campaign.tests[0].condition, speed_mps=35.0 * MPH)
    assert Domain.of(campaign).outside(fastest) == ()
    domains = domain, of_others = Domain.of(tuned), Domain.of(campaign.without(("T4",)))
    assert len({(own.speeds_mps, own.inside, own.reach_mps) for own in domains}) == 1
    told = "Not counted, as the CAE model was tuned to them: T4."
    assert domain.outside(fastest) == (*of_others.outside(fastest), told)
    [too_few] = Domain.of(tuned.without(("T0",))).outside(campaign.tests[1].condition)
    assert too_few.startswith("3 tests: too few to check")
    assert Domain.of(campaign.without(("T0",))).too_few_tests == ()


def test_a_gap_wider_than_any_that_was_left_out_is_outside(wide: Campaign) -> None:
    """Tests at 15, 18, 21 and 50, 53 mph: the middle of the gap is farther from a test than any left-out test was."""
    domain = Domain.of(with_tests(wide, 15.0, 18.0, 21.0, 50.0, 53.0))
    assert domain.reach_mps == pytest.approx(3 * MPH)
    [sentence] = domain.exceeded_by(at(35.0, wide.tests[0].condition.mass_kg / LB))
    assert sentence == "35.0 mph is 14.0 mph from the nearest test; the tests check up to 3.0 mph away."


@settings(deadline=None)
@given(
    st.lists(st.integers(60, 500), min_size=4, max_size=9, unique=True), st.sampled_from([MPH_LB, KPH_KG]), st.data()
)
def test_what_is_shown_decides(wide: Campaign, tenths_mph: list[int], units: UnitSystem, data: st.DataObject) -> None:
    """An end that is read off and typed in is inside, a number outside shows as one, no hole is less than a step."""
    shift = data.draw(st.floats(0, 0.1), "beyond what is shown")
    one = wide.tests[0]
    tests = tuple(
        replace(one, id=f"T{i}", condition=replace(one.condition, speed_mps=(0.1 * v + shift * i) * MPH))
        for i, v in enumerate(tenths_mph)
    )
    domain, unit = Domain.of(replace(wide, tests=tests)), units.in_si("mph")
    ranges = domain.speed_ranges_mps
    assert all(start - end >= SPEED_STEP_MPS for (_, end), (start, _) in pairwise(ranges))
    for end in (end for ends in ranges for end in ends):
        typed = round(end / unit, 1) * unit
        assert domain.exceeded_by(replace(one.condition, speed_mps=typed)) == ()
    asked = data.draw(st.floats(4 * MPH, 60 * MPH), "any speed")
    for sentence in domain.exceeded_by(replace(one.condition, speed_mps=asked)):
        _, away, checked = re.findall(r"\d+\.\d", said(sentence, units))
        assert float(away) > float(checked)


def test_mass_is_checked_as_far_beyond_the_tests_as_they_differ(wide: Campaign) -> None:
    """Tests of 3450 to 3720 lb check 3180 to 3990 lb."""
    domain = Domain.of(wide)
    assert domain.exceeded_by(at(25.0, 3185.0)) == domain.exceeded_by(at(25.0, 3985.0)) == ()
    for mass in (3175.0, 3995.0):
        assert domain.exceeded_by(at(25.0, mass)) == (f"{mass:.0f} lb in all; the tests check 3180 to 3990 lb.",)


def test_tests_of_one_mass_check_two_per_cent_around_it(wide: Campaign) -> None:
    """How the mass matters has then not been seen."""
    one = wide.tests[0].condition
    tests = tuple(replace(t, condition=replace(one, speed_mps=t.condition.speed_mps)) for t in wide.tests)
    domain = Domain.of(replace(wide, tests=tests))
    mass = one.mass_kg / LB
    assert domain.exceeded_by(at(25.0, 1.019 * mass)) == ()
    assert len(domain.exceeded_by(at(25.0, 1.021 * mass))) == 1


def test_a_factor_that_no_test_has_is_outside(wide: Campaign) -> None:
    """One that is left empty is not: the band then covers every value."""
    assert Domain.of(wide).exceeded_by(at(25.0, drive="AWD")) == ("No test has drive AWD; tested: FWD.",)
    assert Domain.of(wide).exceeded_by(at(25.0, drive="")) == ()


def test_beyond_the_cae_runs_is_outside(campaign: Campaign) -> None:
    """What the CAE model was never run at, no test of others can check."""
    domain = Domain.of(campaign)
    condition = replace(campaign.tests[3].condition, front_weight_kg=2300 * LB)
    assert any("front weight 2300 lb" in said for said in domain.exceeded_by(condition))
    low, high = (float(end[1:].sum()) for end in campaign.cae.range)
    assert domain.masses_kg[0] < low < high < domain.masses_kg[1]
    assert domain.checked_masses_kg == (low, high)
