"""Is the CAE model fit to be believed: what passes, what fails, and what nobody knows."""

from dataclasses import replace

import pytest

from crashfuse.cae.quality import judge_quality
from crashfuse.cae_library import NAMED_LIMITS, CaeLibrary, QualityLimits, RunQuality
from crashfuse.campaign import Campaign

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


def test_the_verdict_reads_as_sentences(library: CaeLibrary) -> None:
    assert judge_quality(library, EURO_NCAP).sentences == (
        "CAE runs by Euro NCAP virtual testing 2025 (hourglass energy below 10 %, added mass below 5 %): 19 of 24 "
        "pass, 2 fail, 3 cannot be judged, for not everything is recorded.",
        "Energy change: at worst −2 % (run C00); not recorded for 3 of 24 runs.",
        "Hourglass energy: 19 pass, 2 fail; at worst 12.3 % (run C03); not recorded for 3 of 24 runs.",
        "Added mass: 21 pass, 1 fail; at worst 5 % (run C04); not recorded for 2 of 24 runs.",
        "Runs that fail: C03 (hourglass energy 12.3 %), C04 (hourglass energy 10 %, added mass 5 %). They are used all "
        "the same; leave_out_failing = true in campaign.toml leaves them out.",
    )


def test_runs_that_were_left_out_stay_in_the_verdict(library: CaeLibrary) -> None:
    kept = [i for i in range(len(library)) if i not in (3, 4)]
    rest = replace(
        library,
        ids=tuple(library.ids[i] for i in kept),
        quality=tuple(library.quality[i] for i in kept),
        left_out=tuple((library.ids[i], library.quality[i]) for i in (3, 4)),
    )
    verdict = judge_quality(rest, EURO_NCAP)
    assert (verdict.runs, verdict.passed, verdict.failing, verdict.left_out) == (24, 19, ("C03", "C04"), True)
    assert verdict.sentences[-1].endswith("added mass 5 %). They are left out.")


def test_nothing_recorded_is_said_and_not_passed(campaign: Campaign) -> None:
    for limits in (None, NCHRP):
        verdict = judge_quality(campaign.cae, limits)
        assert (verdict.passed, verdict.failing, verdict.unknown) == (0, (), 24)
        assert len(verdict.sentences) == 1


def test_without_limits_nothing_passes_or_fails(library: CaeLibrary) -> None:
    verdict = judge_quality(library, None)
    assert (verdict.passed, verdict.failing, verdict.unknown) == (0, (), 24)
    assert verdict.sentences[0].startswith("No CAE run is judged by its quality: [cae_quality] in campaign.toml")
    assert verdict.sentences[2] == "Hourglass energy: at worst 12.3 % (run C03); not recorded for 3 of 24 runs."


def test_many_failing_runs_are_named_in_part(campaign: Campaign) -> None:
    library = replace(campaign.cae, quality=(RunQuality(0.2),) * len(campaign.cae))
    assert "C04 (energy change 20 %) and 19 more. They" in judge_quality(library, NCHRP).sentences[-1]
