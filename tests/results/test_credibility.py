"""The credibility sheet: every factor with what a certification says of it, or that the data do not say."""

from dataclasses import replace
from pathlib import Path

import pytest

from crashfuse.cae_library import NAMED_LIMITS, RunQuality
from crashfuse.campaign import Campaign
from crashfuse.certification.certify import Certification, Variant, certify_matrix
from crashfuse.certification.criteria import Costs, Criteria, Criterion
from crashfuse.certification.matrix import Matrix
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import Run
from crashfuse.results.certification_facts import CATALOGUE
from crashfuse.results.credibility import credibility_table, factors
from crashfuse.results.display import DEFAULT, Display
from crashfuse.study.config import StudyConfig
from crashfuse.study.facts import CATALOGUE as OF_CAMPAIGN
from crashfuse.units import KPH_KG, MPH

pytestmark = pytest.mark.usefixtures("one_cache")


@pytest.fixture(scope="module")
def certification(campaign: Campaign, shared_cache: Path) -> Certification:
    """Verdicts of the raw CAE model at 20 mph, and at 70 mph, outside."""
    matrix = Matrix(("M1", "M2"), tuple(replace(campaign.tests[1].condition, speed_mps=v * MPH) for v in (20, 70)))
    criteria, config = Criteria((Criterion("crush", "max_crush", at_most=430.0),), 0.8), StudyConfig(("cae",))
    return certify_matrix(campaign, criteria, matrix, config, Run(Cache(shared_cache)))


def lines(certification: Certification, factor: str, display: Display = DEFAULT) -> dict[str, str]:
    """What the data say of a factor, by its basis."""
    table = credibility_table(certification, display.system)
    return dict(table[table["factor"] == factor].set_index("basis")["data_say"])


def says(certification: Certification, factor: str, display: Display = DEFAULT) -> str:
    """All of it."""
    return " ".join(lines(certification, factor, display).values())


def test_every_factor_has_a_number_or_says_that_there_is_none(certification: Certification) -> None:
    """The thirteen factors of V&V 40; every fact that is asked for exists."""
    table = credibility_table(certification)
    counts = table.drop_duplicates("factor")["activity"].str.partition(":")[0].value_counts()
    assert set(table["basis"]) == {"measured", "stated by the user", "not known"}
    assert not table.duplicated(["factor", "basis"]).any()
    activities = ["Code verification", "Calculation verification", "Validation", "Applicability"]
    assert counts[activities].tolist() == [2, 3, 6, 2]
    assert (table[["factor", "question", "data_say"]] != "").all(axis=None)
    known = {*CATALOGUE, *OF_CAMPAIGN}
    assert {code for row in factors() for code in row.get("facts", ())} <= known


def test_its_numbers_are_those_of_the_certification(certification: Certification) -> None:
    """Costs, domain, record, limits that tests came near; in the reader's units."""
    n, _ = certification.record.decided
    for factor, told in (
        ("Decision consequence", "Not declared."),
        (factors()[14]["factor"], "1 of 2 planned tests lie inside the validated domain, 50 % outside."),
        ("Output comparison", f"In all {n} verdicts, none wrong"),
        ("Relevance of the quantities of interest", "1 of 1 criteria have a left-out test near"),
    ):
        assert told in says(certification, factor)
    assert "24.1 to" in says(certification, "Test conditions", Display(system=KPH_KG))


def test_what_the_campaign_states_takes_the_place_of_what_is_not_said(certification: Certification) -> None:
    """How runs ended, where tests come from, what the CAE model was tuned to."""
    solver, tuned, cost = "Software quality assurance", "Test samples", "Decision consequence"
    campaign, ends = certification.campaign, ("normal", *("error",) * (len(certification.campaign.cae) - 1))
    about = tuple((("about_termination", end), ("about_solver", "S")) for end in ends)
    tests = [replace(test, cae_tuned=test.id == "T1", about=(("about_laboratory", "L"),)) for test in campaign.tests]
    library = replace(campaign.cae, about=about, quality=(RunQuality(0.0, 0.0, 0.0),) * len(ends))
    stated = replace(campaign, cae=library, tests=tuple(tests), quality_limits=NAMED_LIMITS["nchrp-179"])
    dear = replace(certification.criteria, costs=Costs(5.0, 100.0))
    for own, is_stated in ((certification, False), (replace(certification, campaign=stated, criteria=dear), True)):
        basis = "stated by the user" if is_stated else "not known"
        assert "runs' solver" in lines(own, solver)[basis]
        assert "CAE model was tuned" in lines(own, tuned)[basis]
        assert ("pay" if is_stated else "Not declared.") in lines(own, cost)[basis]
        assert "quality checks" in lines(own, "Numerical solver error")["measured" if is_stated else "not known"]
        assert (f"1 of {len(ends)} CAE runs are stated to have ended normally." in says(own, "Use error")) is is_stated
        assert ("did not end normally" in says(own, "Use error")) is is_stated
        assert ("laboratory 4" in says(own, "Test conditions")) is is_stated
        assert ("is not stated" in says(own, "Test samples")) is not is_stated


def test_what_was_not_tried_is_said_with_its_option(certification: Certification) -> None:
    """The usual variants are always there; a test that was left out is no longer asked for."""
    without = Variant("without T1", (1, 2), {"M1": ("skip", "run")}, "T1")
    tried = replace(certification, variants=(*certification.variants, without))
    told, usual = (says(own, "Other limits and confidences, a test less") for own in (tried, certification))
    assert all(own.name in told for own in tried.variants)
    assert told.endswith("; without T1: 1 of 2 (M1: skip → run).")
    assert usual.endswith("Leaving tests out was not tried; certify --robustness tries it.")
