"""The CAE runs: pairing, range, extrapolation; and what the solver says of them."""

import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crashfuse.cae.model import CaeModel
from crashfuse.cae_library import NAMED_LIMITS, CaeLibrary, QualityLimits, RunQuality, judge_quality
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.units import KPH, KPH_KG, LB, MPH, MPH_LB, UnitSystem, said
from tests.conftest import not_none
from tests.golden import assert_golden


def test_a_run_at_a_tests_condition_is_its_pair(campaign: Campaign) -> None:
    """The last four runs were made at the tests' conditions; they say nothing of the drive."""
    assert [campaign.cae.paired_run(test.condition) for test in campaign.tests] == [20, 21, 22, 23]


def test_a_condition_without_a_run_has_no_pair(campaign: Campaign) -> None:
    """Half a mile per hour is another condition; a standstill is compared like any other speed."""
    for speed_mph in (15.5, 0.0):
        assert campaign.cae.paired_run(replace(campaign.tests[0].condition, speed_mps=speed_mph * MPH)) is None


def test_a_pair_survives_rounding_and_is_the_nearest_of_several(campaign: Campaign) -> None:
    """A table in whole kg and tenths of km/h gives the same run; 0.4 % apart is another condition."""
    test = campaign.tests[0].condition
    weights = (float(round(weight)) for weight in (test.front_weight_kg, test.rear_weight_kg))
    rounded = Condition.of_vector([round(test.speed_mps / KPH, 1) * KPH, *weights])
    assert rounded != test
    assert campaign.cae.paired_run(rounded) == campaign.cae.paired_run(test)
    assert campaign.cae.paired_run(replace(test, front_weight_kg=1.004 * test.front_weight_kg)) is None
    beside = replace(test, front_weight_kg=1.0018 * test.front_weight_kg, factors=())
    twins = replace(campaign.cae, conditions=(beside, *campaign.cae.conditions[1:]))
    assert twins.paired_run(test) == campaign.cae.paired_run(test)
    assert twins.paired_run(beside) == 0


@pytest.mark.parametrize(
    ("of_test", "of_runs", "pair"),
    [
        ("AWD", ["FWD", "AWD"], 1),  # though the first is as near
        ("AWD", ["FWD", "FWD"], None),
        ("AWD", ["", "FWD"], 0),  # it may be of either
        ("AWD", ["", "AWD"], 1),  # known is better than perhaps
        ("", ["FWD", "AWD"], 0),
        ("AWD", [None, "FWD"], 0),
    ],
)
def test_runs_are_paired_with_tests_of_their_kind(
    campaign: Campaign, of_test: str, of_runs: list[str | None], pair: int | None
) -> None:
    """A run of another drive is none of a test's; where one does not say, it may be. The CAE pulse is that run's."""

    def at(v: Condition, drive: str | None) -> Condition:
        return replace(v, factors=() if drive is None else (("drive", drive),))

    test, elsewhere = at(campaign.tests[0].condition, of_test), campaign.cae.conditions[:11]
    cae = replace(campaign.cae, conditions=(*(at(test, drive) for drive in of_runs), *elsewhere, *elsewhere))
    assert cae.paired_run(test) == pair
    source = "emulator" if pair is None else f"run {cae.ids[pair]}"
    assert CaeModel().fit(cae).pulse(test).source == source


def test_a_weight_beyond_the_library_is_flagged(campaign: Campaign) -> None:
    """The sentence names the input, its value and the range."""
    (note,) = campaign.cae.extrapolation(Condition.of_vector([25 * MPH, 2400 * LB, 1500 * LB]))
    assert note.startswith("Extrapolation: front weight 2400 lb lies outside the CAE runs' 19")


def test_a_paired_run_puts_its_condition_in_range(campaign: Campaign) -> None:
    """However far it lies from the other runs, and to the tolerance of a pair: its pulse is known there."""
    heavy = Condition.of_vector([25 * MPH, 2400 * LB, 1500 * LB])
    assert campaign.cae.extrapolation(heavy)
    cae = replace(campaign.cae, conditions=(*campaign.cae.conditions[:-1], heavy))
    for factor in (1 - 1.99e-3, 1.0, 1 + 1.99e-3):
        condition = replace(heavy, front_weight_kg=factor * heavy.front_weight_kg)
        assert cae.paired_run(condition) is not None
        assert cae.extrapolation(condition) == ()


@pytest.mark.parametrize("units", [MPH_LB, KPH_KG])
@given(beyond=st.floats(0, 2.0), end=st.floats(2.0, 70.0))
def test_an_end_of_the_range_is_told_so_that_it_can_be_typed(
    campaign: Campaign, units: UnitSystem, beyond: float, end: float
) -> None:
    """The fastest run as it is shown is in range; what is outside is shown as beyond it, by the same digits."""
    slow, fast = (replace(campaign.cae.conditions[0], speed_mps=v) for v in (0.5, end * MPH))
    cae, unit = replace(campaign.cae, conditions=(slow, *[fast] * (len(campaign.cae) - 1))), units.in_si("mph")
    assert cae.extrapolation(replace(fast, speed_mps=round(end * MPH / unit, 1) * unit)) == ()
    for note in cae.extrapolation(replace(fast, speed_mps=(end + beyond) * MPH)):
        asked, _, fastest = re.findall(r"\d+\.\d", said(note, units))
        assert float(asked) > float(fastest)


def test_every_run_and_what_lies_between_is_in_range(campaign: Campaign) -> None:
    """The range is that of all runs."""
    inside = (*campaign.cae.conditions, Condition.of_vector([20 * MPH, 2050 * LB, 1550 * LB]))
    assert not any(map(campaign.cae.extrapolation, inside))


def test_networks_are_trained_without_the_runs_of_tests_that_are_left_out(campaign: Campaign) -> None:
    """All runs at their conditions go, none else; the others are the same library however it came about."""
    cae, conditions = campaign.cae, [test.condition for test in campaign.tests[:2]]
    paired = cae.paired_ids(conditions)
    assert paired == {cae.ids[not_none(cae.paired_run(condition))] for condition in conditions}
    others, marked = cae.without(paired), replace(cae, untrained=paired)
    assert [others.paired_run(condition) for condition in conditions] == [None, None]
    assert (len(others), others.accel_mps2.shape[0]) == (len(cae) - 2, len(cae) - 2)
    assert marked.for_networks.fingerprint == others.fingerprint
    assert len({cae.fingerprint, marked.fingerprint, others.fingerprint}) == 3
    assert cae.for_networks is cae
    known = replace(cae, paired_only=paired)
    assert known.learned_from.fingerprint == known.for_networks.fingerprint == others.fingerprint != known.fingerprint


EURO_NCAP, NCHRP = NAMED_LIMITS["euro-ncap-vt-2025"], NAMED_LIMITS["nchrp-179"]


@pytest.fixture
def library(campaign: Campaign) -> CaeLibrary:
    """24 runs: two fail by hourglass energy, one by added mass; of four not all is recorded."""
    quality = [RunQuality(-0.02, 0.01, 0.0)] * len(campaign.cae)
    quality[3] = RunQuality(-0.02, 0.123, 0.0)
    quality[4] = RunQuality(None, 0.10, 0.05)
    quality[5] = RunQuality(0.02, None, 0.01)
    quality[6] = quality[7] = RunQuality()
    return replace(campaign.cae, quality=tuple(quality))


@pytest.mark.parametrize(
    ("limits", "quality", "beyond"),
    [
        (EURO_NCAP, RunQuality(0.9, 0.0999, 0.0499), ()),
        (EURO_NCAP, RunQuality(0.0, 0.1, 0.05), ("hourglass_share", "added_mass_share")),
        (NCHRP, RunQuality(-0.10, 0.0499, 0.0), ()),
        (NCHRP, RunQuality(-0.101, 0.05, 0.0), ("energy_change", "hourglass_share")),
        (NCHRP, RunQuality(), ()),
    ],
)
def test_limits_are_those_of_the_sources(limits: QualityLimits, quality: RunQuality, beyond: tuple[str, ...]) -> None:
    """Shares must lie below their limit, the change of energy may reach it, whatever its sign."""
    assert limits.exceeded(quality) == beyond


def test_runs_are_counted_by_what_is_known_of_them(library: CaeLibrary) -> None:
    verdict = judge_quality(library, EURO_NCAP)
    assert (verdict.runs, verdict.passed, verdict.failing, verdict.unknown) == (24, 19, ("C03", "C04"), 3)
    rows = verdict.table.set_index("quantity")
    assert rows[["passed", "failed", "not_recorded"]].T.to_dict("list") == {
        "energy change": [0, 0, 3],
        "hourglass energy": [19, 2, 3],
        "added mass": [21, 1, 2],
    }
    assert rows.loc["hourglass energy", ["limit", "worst", "worst_run"]].tolist() == [0.1, 0.123, "C03"]
    assert rows.loc["energy change", "worst"] == -0.02
    good = replace(library, quality=(RunQuality(0.0, 0.0, 0.0),) * 24)
    assert verdict.unpassed == ("energy change", "hourglass energy", "added mass")
    assert (judge_quality(good, NCHRP).unpassed, judge_quality(good, EURO_NCAP).unpassed) == ((), verdict.unpassed[:1])


def test_runs_that_were_left_out_stay_in_the_verdict(library: CaeLibrary) -> None:
    left_out = tuple((library.ids[i], library.quality[i]) for i in (3, 4))
    rest = replace(library.without(frozenset(dict(left_out))), left_out=left_out)
    verdict = judge_quality(rest, EURO_NCAP)
    assert (verdict.runs, verdict.passed, verdict.failing, verdict.left_out) == (24, 19, ("C03", "C04"), True)
    many = replace(library, quality=(RunQuality(0.2),) * len(library))
    verdicts = [judge_quality(library, EURO_NCAP), verdict, judge_quality(library, None), judge_quality(many, NCHRP)]
    assert_golden("cae_quality", (sentence for verdict in verdicts for sentence in (*verdict.sentences, "")))


def test_nothing_recorded_is_said_and_not_passed(campaign: Campaign) -> None:
    for limits in (None, NCHRP):
        verdict = judge_quality(campaign.cae, limits)
        assert (verdict.passed, verdict.failing, verdict.unknown) == (0, (), 24)
        assert len(verdict.sentences) == 1


def test_without_limits_nothing_passes_or_fails(library: CaeLibrary) -> None:
    verdict = judge_quality(library, None)
    assert (verdict.passed, verdict.failing, verdict.unknown) == (0, (), 24)
