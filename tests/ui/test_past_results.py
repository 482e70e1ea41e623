"""What was computed before is listed on Study, opened again, and compared two by two."""

from pathlib import Path

import pytest

from crashfuse.campaign_folder.load import load_campaign
from crashfuse.certification.certify import certify
from crashfuse.certification.file_store import keep_certification
from crashfuse.condition import Condition
from crashfuse.results.certification import certification_json
from crashfuse.study.config import StudyConfig
from crashfuse.study.history import PastResult, annotate, keep, past_results
from crashfuse.units import KPH
from tests.ui.conftest import Session, Visit

CRITERIA = [{"name": "crush", "metric": "max_crush", "at_most": 650.0}]


def kept(day: int, data: str, seed: int = 0, tests: str = "T1 T2", **changes: object) -> PastResult:
    """A study that was done on a day of 2030, each rating 0.1 higher than with the seed before."""
    ratings = {test: {"cae": {60.0: 0.5 + 0.1 * seed}} for test in tests.split()}
    date = f"2030-01-0{day}T00:00:00+00:00"
    given = {"campaign": "campaign", "config": StudyConfig(seed=seed), "ratings": ratings, **changes}
    result = PastResult(fingerprint=data, basis="ISO", approach="cae", date=date, **given)  # type: ignore[arg-type]
    keep(result)
    return result


@pytest.fixture
def data(open_campaign: Path) -> str:
    return load_campaign(open_campaign).fingerprint


def past(visit: Visit, *ticked: PastResult) -> Session:
    return visit("study", study_tab="Past results", ticked=[result.id for result in ticked])


def test_what_predict_and_certify_answer_is_listed(visit: Visit, open_campaign: Path) -> None:
    (open_campaign / "criteria.toml").write_text('[[criterion]]\nmetric = "max_crush"\nat_most = 900.0\n')
    (open_campaign / "matrix.csv").write_text("id,speed_mph,front_weight_lb,rear_weight_lb\nM,25,2050,1500\n")
    visit("certify", approach="cae").press("Certify").finish()
    visit("predict", approaches="cae").finish()
    listed = set(past(visit).app.dataframe[0].value["What"])
    assert "certification of 1 condition" in listed
    assert any(what.startswith("at ") for what in listed)


def open_last(session: Session) -> Session:
    session.app.button[-1].click()
    return session.run()


@pytest.mark.usefixtures("open_campaign")
def test_the_list_says_what_to_do_and_has_what_was_computed_of_the_campaign(visit: Visit, data: str) -> None:
    """Nothing at first; results of other campaigns and of others' uploads are not listed."""
    assert "Nothing yet: studies" in past(visit).words
    kept(1, data, tests="T1")
    kept(2, "changed since", tests="T2")
    kept(3, "elsewhere", campaign="other")
    session = past(visit)
    (listed,) = session.app.dataframe
    assert list(listed.value["What"]) == ["test T2 alone", "test T1 alone"]
    assert "Tick a result to open it" in session.words


def test_two_studies_that_are_ticked_are_compared(visit: Visit, data: str) -> None:
    """In the order of the ticks, by figure, table and files; a result that is gone is said to be."""
    one, other = kept(1, data), kept(2, data, seed=1)
    session = past(visit, other, one)
    assert session.app.session_state["past results"]["selection"]["rows"] == [0, 1]
    assert "clearly lower in the second (−0.100" in session.words
    assert session.charts == 1
    assert session.press("Export").downloads == ["comparison.csv", "comparison.html", "comparison.pptx"]
    session = visit("study", study_tab="Past results", ticked=[one.id, "0123456789ab"])
    assert "is not on this machine" in session.words


def test_a_prediction_has_no_ratings_to_compare(visit: Visit, data: str) -> None:
    condition = Condition.of_vector([50 * KPH, 900.0, 700.0])
    prediction = kept(2, data, ratings={}, condition=condition, expected="0.78 to 0.93")
    session = past(visit, kept(1, data), prediction)
    assert "Only two studies are compared" in session.words
    assert "0.78 to 0.93 (80 %)" in list(session.app.dataframe[0].value["Mean rating"])


def test_a_result_that_is_ticked_gets_a_note(visit: Visit, data: str) -> None:
    """For everybody on this machine; one that somebody else wrote since is not lost."""
    one = kept(1, data)
    session = past(visit, one)
    (field,) = session.app.text_input
    field.set_value("baseline *model*").run()
    assert past(visit).app.dataframe[0].value["Note"].tolist() == ["baseline *model*"]
    late = past(visit, one)
    annotate(past_results()[0], "of another")
    late.app.text_input[0].set_value("mine").run()
    assert "“of another”, which was written since" in late.tables[0].to_string()
    assert past_results()[0].note == "of another"


def test_a_study_opens_with_its_settings_and_a_single_test_on_compare(visit: Visit, data: str) -> None:
    """Of data that were changed since it is said what is in the way."""
    session = open_last(past(visit, kept(1, data, config=StudyConfig(seed=7, leave_out="speed group"))))
    assert session.app.session_state["seed"] == 7
    assert session.app.session_state["study_tab"] == "Ratings"
    session = open_last(past(visit, kept(2, data, seed=3, tests="T2")))
    assert session.app.title[0].value == "Compare"
    assert (session.app.session_state["test"], session.app.session_state["seed"]) == ("T2", 3)
    session = open_last(past(visit, kept(3, "b")))
    assert "data that were changed since" in session.tables[0].to_string()


def test_predictions_that_are_opened_are_pinned(visit: Visit, data: str) -> None:
    """One after the other: so both stand in the figures of Predict."""
    for kph in (50, 56):
        condition = Condition.of_vector([kph * KPH, 900.0, 700.0])
        session = open_last(past(visit, kept(1, data, ratings={}, condition=condition)))
        assert session.app.title[0].value == "Predict"
        assert session.app.session_state["pins"] == [f"{kph}kph 900kg 700kg"]
    assert session.app.session_state["speed_mph"] == pytest.approx(56 * KPH / 0.44704, abs=1e-4)


def test_a_certification_is_listed_and_opens_certify_with_its_criteria(visit: Visit, open_campaign: Path) -> None:
    """And its conditions, with what was said then beside today's verdicts."""
    campaign = load_campaign(open_campaign)
    matrix = campaign.tests_frame[["id", "speed_mph", "front_weight_lb", "rear_weight_lb"]].head(2)
    verdicts = certify(campaign, CRITERIA, matrix, approach="cae", workers=1)
    earlier = keep_certification(certification_json(verdicts), campaign)
    session = visit("study", study_tab="Past results", ticked=earlier.id)
    (row,) = session.app.dataframe[0].value.to_dict("records")
    assert (row["What"], row["Recommended"]) == ("certification of 2 conditions", "CAE")
    state = open_last(session).app.session_state
    assert session.app.title[0].value == "Certify"
    assert [text.split("~")[0] for text in state["criteria"]] == ["max_crush"]
    assert state["approach"] == "cae"
    assert state["earlier"]


@pytest.mark.usefixtures("open_campaign")
def test_where_folders_are_restricted_results_of_other_data_are_not_listed(
    visit: Visit, data: str, open_campaign: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only those of the very data that are open to the visitor."""
    for fingerprint in (data, "of someone else"):
        kept(1, fingerprint)
    assert len(past(visit).app.dataframe[0].value) == 2
    monkeypatch.setattr("crashfuse.ui.kit.campaigns.roots", lambda: [open_campaign])
    assert len(past(visit).app.dataframe[0].value) == 1
