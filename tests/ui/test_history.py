"""What was computed before is listed, opened again, and compared two by two."""

from pathlib import Path

import pytest

from crashfuse.campaign_folder.load import load_campaign
from crashfuse.condition import Condition
from crashfuse.study.config import StudyConfig
from crashfuse.study.history import PastResult, annotate, keep, past_results
from crashfuse.units import KPH
from tests.ui.conftest import Visit


def kept(day: int, campaign: str = "a", seed: int = 0, tests: str = "T1 T2", **changes: object) -> PastResult:
    """A study that was done on a day of 2030, each rating 0.1 higher than with the seed before."""
    ratings = {test: {"cae": {60.0: 0.5 + 0.1 * seed}} for test in tests.split()}
    date = f"2030-01-0{day}T00:00:00+00:00"
    given = {"fingerprint": campaign, "config": StudyConfig(seed=seed), "ratings": ratings, **changes}
    result = PastResult(campaign, basis="ISO", approach="cae", date=date, **given)  # type: ignore[arg-type]
    keep(result)
    return result


def predicted(kph: float, data: str = "a", seed: int = 0) -> PastResult:
    """A prediction at a speed."""
    condition = Condition.of_vector([kph * KPH, 900.0, 700.0])
    return kept(1, seed=seed, fingerprint=data, ratings={}, condition=condition, expected="0.78 to 0.93")


def test_the_history_needs_no_campaign_and_says_what_to_do(visit: Visit) -> None:
    """Before anything was computed, and where no two are worth comparing."""
    assert "Nothing was computed on this machine yet" in visit("history").words
    for campaign, test in (("![a](b)", "T1"), ("other", "T2")):
        kept(1, campaign, tests=test)
    session = visit("history")
    assert "Tick two results to compare them" in session.words
    (listed,) = session.app.dataframe
    assert sorted(listed.value["What"]) == ["test T1 alone", "test T2 alone"]
    assert sorted(listed.value["Campaign"]) == ["![a](b)", "other"]


def test_the_two_latest_that_can_differ_are_compared_and_the_address_stays_as_it_was(visit: Visit) -> None:
    """Not with that of another vehicle; a report and a figure show both. What nobody chose is no part of the link."""
    for day, campaign, seed in ((1, "a", 0), (2, "b", 0), (3, "a", 1)):
        kept(day, campaign, seed)
    session = visit("history")
    first, second = (line for line in session.words.splitlines() if "study of 2 tests" in line)
    assert "2030-01-01 00:00 · study of 2 tests, each alone · fast, seed 0 · a" in first
    assert "2030-01-03 00:00 · study of 2 tests, each alone · fast, seed 1 · a" in second
    assert session.app.session_state["past results"]["selection"]["rows"] == [0, 2]
    assert "mean 0.500 in the first, 0.600 in the second (+0.100" in session.words
    assert session.charts == 1
    assert {"comparison.csv", "comparison.html"} <= set(session.downloads)
    assert not {"first", "second"} & {*session.app.query_params}


def test_a_link_compares_what_it_names(visit: Visit) -> None:
    """In its order, of one vehicle alone; a result that is gone is said to be, and no other one taken for it."""
    one, other, elsewhere = kept(1, seed=0), kept(2, seed=1), kept(3, "b", seed=3)
    kept(4, seed=2)
    link = {"first": other.id, "second": one.id}
    session = visit("history", **link)
    assert "mean 0.600 in the first, 0.500 in the second" in session.words
    words = visit("history", **{**link, "first": one.id, "second": elsewhere.id}).words
    assert "a and b are not known to be one vehicle" in words
    session = visit("history", **{**link, "second": "0123456789ab"})
    assert "is not in the list of this machine" in session.words
    assert "Tick two results to compare them" in session.words
    assert "mean" not in session.words


def test_a_result_that_is_ticked_gets_a_note_and_leaves_the_list(visit: Visit) -> None:
    """Both for everybody on this machine; what is only suggested offers neither."""
    one, other = kept(1, seed=0), kept(2, seed=1)
    assert "Take off the list" not in visit("history").buttons
    session = visit("history", first=one.id, second="")
    (field,) = session.app.text_input
    assert "study of 2 tests, each alone · fast, seed 0" in field.label  # read out without backslashes
    field.set_value("baseline *model*").run()
    again = visit("history", first=one.id, second=other.id)
    assert again.app.dataframe[0].value["Note"].tolist() == ["", "baseline *model*"]
    assert next(line.value for line in again.app.markdown if "First:" in line.value).count(r"baseline \*model\*") == 1
    session.press("Take off the list")
    assert [result.id for result in past_results()] == [other.id]


def test_a_note_does_not_replace_one_that_was_written_since(visit: Visit) -> None:
    """It is said, with what is there now."""
    one = kept(1, seed=0)
    session = visit("history", first=one.id, second="")
    annotate(one, "of another")
    session.app.text_input[0].set_value("mine").run()
    assert "found “of another”, which was written since" in session.words
    assert past_results()[0].note == "of another"
    session.app.text_input[0].set_value("of another, and mine").run()
    assert past_results()[0].note == "of another, and mine"


@pytest.mark.usefixtures("open_campaign")
def test_the_results_of_the_open_campaign_are_listed_or_all(visit: Visit) -> None:
    """There is nothing to choose where all are of it, or none is."""
    kept(1, "elsewhere")
    assert "listed" not in {group.key for group in visit("history").app.button_group}
    kept(1, "campaign", tests="T3")
    session = visit("history")
    here = session.app.dataframe[0].value
    assert list(here["What"]) == ["test T3 alone"]
    assert "Campaign" not in here
    (group,) = [group for group in session.app.button_group if group.key == "listed"]
    group.set_value("all")
    assert list(session.run().app.dataframe[0].value["Campaign"]) == ["campaign", "elsewhere"]


def test_two_predictions_are_shown_on_predict_with_both_pinned(visit: Visit, open_campaign: Path) -> None:
    """If both have the same settings; of one condition the second's settings stand beside the first's."""
    data = load_campaign(open_campaign).fingerprint
    one, other, otherwise = (predicted(kph, data, seed) for kph, seed in ((50, 0), (56, 0), (56, 1)))
    session = visit("history", first=one.id, second=other.id).press("Show both on Predict")
    assert session.app.session_state["pins"] == ["50kph 900kg 700kg", "56kph 900kg 700kg"]
    assert session.app.session_state["speed_mph"] == pytest.approx(31.0686, abs=1e-4)
    session = visit("history", first=otherwise.id, second=other.id).press("Show both on Predict")
    chosen = {key: session.app.session_state[key] for key in ("seed", "predict_also", "pins")}
    assert chosen == {"seed": 1, "predict_also": ["by:fast 0 test"], "pins": []}
    told = visit("history", first=one.id, second=otherwise.id).words
    assert "differ in their condition or in their settings; these do not" in told
    elsewhere = predicted(50, "b")
    assert "these do not" in visit("history", first=one.id, second=elsewhere.id).words


@pytest.mark.parametrize("tests", ["T2", "T2 T3"])
def test_two_studies_with_a_test_in_common_are_shown_on_compare(visit: Visit, open_campaign: Path, tests: str) -> None:
    """The first as it is opened, the second among what is also shown there; of other data, or of more tests, not."""
    data = load_campaign(open_campaign).fingerprint
    one = kept(1, data, tests=tests)
    other = kept(2, data, tests="T1 T2", config=StudyConfig(seed=1, leave_out="speed group"))
    session = visit("history", first=one.id, second=other.id).press("Show both on Compare, T2")
    assert session.app.title[0].value == "Compare"
    chosen = {key: session.app.session_state[key] for key in ("test", "seed", "leave_out", "compare_also")}
    assert chosen == {"test": "T2", "seed": 0, "leave_out": "test", "compare_also": ["by:fast 1 speed group"]}
    more, elsewhere = kept(3, data, seed=2), kept(4, "campaign", seed=3, tests="T2", fingerprint="b")
    for first, second in ((other, more), (one, elsewhere)):
        buttons = visit("history", first=first.id, second=second.id).buttons
        assert not any("on Compare" in label for label in buttons)


def test_predictions_that_are_pinned_stay_beside_two_that_are_shown(visit: Visit, open_campaign: Path) -> None:
    """Beyond six the oldest go."""
    data = load_campaign(open_campaign).fingerprint
    one, other = predicted(50, data), predicted(56, data)
    session = visit("history", first=one.id, second=other.id)
    session.app.session_state["pins"] = [f"{kph}kph 900kg 700kg" for kph in (41, 50, 42, 43, 44, 45)]
    session.press("Show both on Predict")
    assert session.app.session_state["pins"] == [f"{kph}kph 900kg 700kg" for kph in (42, 43, 44, 45, 50, 56)]


def test_a_study_and_a_prediction_are_not_compared(visit: Visit) -> None:
    """A prediction has no ratings; nothing else is blamed."""
    words = visit("history", first=kept(1).id, second=predicted(50).id).words
    assert "A prediction has no ratings: tick two studies, or two predictions." in words
    assert "no rating in common" not in words


@pytest.mark.usefixtures("open_campaign")
def test_what_is_ticked_is_in_the_list_whatever_its_campaign(visit: Visit) -> None:
    """Else two were compared of which one cannot be seen, nor its tick taken away."""
    kept(1, "elsewhere", seed=2)
    here, elsewhere = kept(2, "campaign"), kept(3, "elsewhere")
    session = visit("history", first=here.id, second=elsewhere.id)
    assert list(session.app.dataframe[0].value["Campaign"]) == ["elsewhere", "campaign"]
    assert session.app.session_state["past results"]["selection"]["rows"] == [0, 1]
    assert "Campaign" not in visit("history", first=here.id, second="").app.dataframe[0].value


def test_what_the_visitor_has_not_opened_is_not_said_to_be_closed(visit: Visit) -> None:
    """Another may have it open on this server."""
    one, other = predicted(50), predicted(56)
    session = visit("history", first=one.id, second=other.id).press("Show both on Predict")
    assert "You have not opened the campaign a with the data a: open its folder" in session.words


def test_where_folders_are_restricted_others_results_are_not_listed(
    visit: Visit, open_campaign: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only those of campaigns that are open to the visitor."""
    for fingerprint in (load_campaign(open_campaign).fingerprint, "of someone else"):
        kept(1, fingerprint=fingerprint)
    assert len(visit("history").app.dataframe[0].value) == 2
    monkeypatch.setattr("crashfuse.ui.kit.campaigns.roots", lambda: [open_campaign])
    assert len(visit("history").app.dataframe[0].value) == 1
