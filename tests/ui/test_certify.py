"""The page Certify: from criteria and conditions, of files or typed in, to verdicts and what stands behind them."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
import streamlit as st
from hypothesis import given
from hypothesis import strategies as some
from streamlit.testing.v1.element_tree import Selectbox

import crashfuse
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.certification.certify import Certification
from crashfuse.results.certification import certification_json
from crashfuse.results.certification_facts import exceptions, sentences
from crashfuse.results.certification_tables import planned
from crashfuse.results.result import Result
from crashfuse.ui.certify.entry import Field
from crashfuse.ui.certify.results import last_verdicts
from crashfuse.ui.kit.campaigns import View
from crashfuse.units import IN_SI
from tests.ui.conftest import Session, Visit

APPROACH = "displacement_domain"
LINK = {"approach": APPROACH}
CRITERIA = """confidence = 0.9

[[criterion]]
name = "crush"
metric = "max_crush"
at_most = 430.0

[[criterion]]
name = "rating"
metric = "rating"
window_ms = 40
at_least = 0.6
"""
MATRIX = """id,speed_mph,front_weight_lb,rear_weight_lb
M1,20,2050,1500
M2,33,2050,1500
M3,70,2050,1500
"""
FILES = ["certification.csv", "track_record.csv", "credibility.csv", "certification.json", "criteria.toml"]
FILES += ["matrix.csv", "report.html", "report.pptx"]

pytestmark = pytest.mark.usefixtures("one_cache")


@pytest.fixture
def asking(open_campaign: Path) -> Path:
    """The small campaign with criteria and a matrix in its folder."""
    (open_campaign / "criteria.toml").write_text(CRITERIA)
    (open_campaign / "matrix.csv").write_text(MATRIX)
    return open_campaign


def certified(session: Session) -> Session:
    """Press Certify, unless that was done before, and wait for the verdicts."""
    if "Certify" in session.buttons:
        session.press("Certify")
    return session.finish()


def of_library(folder: Path, confidence: float = 0.9) -> Certification:
    """The same verdicts from the library."""
    criteria = [
        {"name": "crush", "metric": "max_crush", "at_most": 430.0},
        {"name": "rating", "metric": "rating", "window_ms": 40, "at_least": 0.6},
    ]
    return crashfuse.certify(
        load_campaign(folder), criteria, folder / "matrix.csv", confidence=confidence, approach=APPROACH, workers=1
    )


def reason(session: Session, cell: str) -> str:
    """What the page says of a cell of the matrix."""
    session.app.session_state["cell"] = cell
    return session.run().words


def answers(session: Session) -> list[str]:
    return [label.split("**")[1] for label in session.buttons if label.startswith("**")]


def of_row(session: Session, row: str) -> str:
    return next(label for label in session.buttons if f"*{row}*" in label)


@pytest.mark.slow
def test_the_page_shows_the_verdicts_of_the_library(asking: Path, visit: Visit) -> None:
    """Counts, the conditions to test, the whole table, the record, and the files."""
    session = certified(visit("certify", **LINK))
    expected = of_library(asking)
    assert answers(session) == [row.word for row in planned(expected)]
    assert "{} of {}".format(*expected.saved) in session.words
    for told in exceptions(expected).values():
        assert told[0] in session.words
    for place in ("answer", "costs"):
        assert all(sentence in session.words for sentence in sentences(expected, place))
    for i, verdict in expected.cells:
        assert verdict.reason in reason(session, f"{i} | {verdict.criterion.name}")
    assert session.charts == 1
    assert session.press("Export").downloads == FILES
    assert session.open_tab("certify", "Validated domain").charts == 1
    assert session.open_tab("certify", "Track record").charts == 1
    (record,) = [own for own in session.tables if "What this record supports" in own]
    assert record["Criterion"].tolist() == ["Near a limit", "crush", "rating", "All", "All, with CAE runs"]
    session.app.button_group(key="record").set_value("Are the probabilities right?")
    assert session.run().charts == 1


@pytest.mark.slow
def test_another_limit_or_confidence_is_answered_at_once(
    asking: Path, visit: Visit, fitting_is_an_error: Callable[[], None]
) -> None:
    """Nothing is fitted, nothing has to be pressed."""
    session = certified(visit("certify", **LINK))
    fitting_is_an_error()
    session.fill({"Confidence": 0.7})
    assert "Certify" not in session.buttons
    looser = of_library(asking, confidence=0.7)
    assert all(own.reason in reason(session, f"{i} | {own.criterion.name}") for i, own in looser.cells)
    (asking / "criteria.toml").write_text(CRITERIA.replace("430.0", "300.0"))
    assert "at most 300 mm" in reason(visit("certify", **LINK), "M1 | crush")


@pytest.mark.slow
def test_a_click_says_what_another_question_would_change(
    asking: Path, visit: Visit, fitting_is_an_error: Callable[[], None]
) -> None:
    """Another confidence and stricter limits take no fits; the numbers are those of the library."""
    session = certified(visit("certify", **LINK))
    fitting_is_an_error()
    session.fill({"What if": ["confidence 0.99", "limits 5 % stricter"]})
    table = session.finish().tables[-1]
    assert table["Need not be run"].tolist()[0] == "{} of {}".format(*of_library(asking, confidence=0.99).saved)
    assert table["What if"].tolist() == ["confidence 0.99", "limits 5 % stricter"]
    turned = [text for text in table["What changes"] if text != "nothing"]
    assert all(re.search(r"→ .* \(.*\)", text) for text in turned)


@pytest.mark.slow
@pytest.mark.usefixtures("asking")
def test_what_one_test_less_would_change_is_in_the_files(visit: Visit, monkeypatch: pytest.MonkeyPatch) -> None:
    """As the page shows it, beside the variants that are in them anyway."""
    session = certified(visit("certify", **LINK, what_if="without T1")).run().finish()
    taken: list[Result] = []
    monkeypatch.setattr("crashfuse.ui.certify.results.offer_result", lambda result, *_: taken.append(result))
    session.press("Export")
    content, matrix = (taken[-1].files[name]() for name in ("credibility.csv", "matrix.csv"))
    assert isinstance(matrix, bytes)
    assert "without T1: " in str(content)
    assert [row.split(",")[0] for row in matrix.decode().split()] == [row.split(",")[0] for row in MATRIX.split()]


@pytest.mark.usefixtures("asking")
def test_other_pages_know_the_last_verdicts_or_what_they_take(visit: Visit, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a visit to Certify, by the campaign's criteria and planned tests; nothing is fitted for it."""
    known: list[tuple[Certification | None, str]] = []

    def noted(view: View) -> tuple[Certification | None, str]:
        known.append(last_verdicts(view))
        return known[-1]

    monkeypatch.setattr("crashfuse.ui.certify.results.last_verdicts", noted)
    visit("train", approach="lf_tcn")
    assert known[-1] == (None, "3 planned tests not judged yet")
    visit("train", **LINK, criteria="peak~~~x~")
    assert "found 'x'" in known[-1][1]


@pytest.mark.slow
def test_with_a_single_test_the_page_says_what_cannot_be_said(asking: Path, visit: Visit) -> None:
    """Everything is outside, and there is no record; nothing else fails."""
    table = pd.read_csv(asking / "tests.csv")
    table.head(1).to_csv(asking / "tests.csv", index=False)
    for test_id in table["id"][1:]:
        (asking / "tests" / f"{test_id}.csv").unlink()
    session = certified(visit("certify", **LINK))
    assert "0 of 3" in session.words
    assert answers(session) == ["cannot say"] * 3
    assert "too few to check verdicts" in session.open_tab("certify", "Validated domain").words
    assert session.charts == 1
    assert "There is no record" in session.open_tab("certify", "Track record").words
    assert session.charts == 0


@pytest.mark.usefixtures("open_campaign")
def test_without_criteria_the_page_says_how_to_declare_them(visit: Visit) -> None:
    """Nothing can be computed until the reader asks for limits of the tests, rounded in their units."""
    session = visit("certify", system="kph-kg")
    assert "No criteria yet" in session.words
    assert "Certify" not in session.buttons
    session.press("Limits of these tests")
    metrics = [text.split("~")[0] for text in session.app.session_state["criteria"]]
    assert metrics == ["max_crush", "peak", "delta_v", "olc", "rating"]
    assert float(session.rows("criteria")[2][3]).is_integer()
    assert "Certify" in session.buttons
    session.press("Good ratings")
    assert [text.split("~")[1] for text in session.app.session_state["criteria"]] == ["20", "40", "60"]


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("criteria.toml", '[[criterion]]\nmetric = "crush"\nat_most = 3', "expected a metric of peak"),
        ("matrix.csv", MATRIX + "M4,20,2050,1500\n", "found that of M1 again"),
    ],
)
def test_a_fault_in_a_file_is_a_sentence(asking: Path, visit: Visit, name: str, content: str, sentence: str) -> None:
    """Of the campaign's own criteria or matrix; nothing can be computed from them."""
    (asking / name).write_text(content)
    session = visit("certify", **LINK)
    assert sentence in session.words
    assert "Certify" not in session.buttons


def test_an_uploaded_file_takes_the_place_of_the_campaigns_own(asking: Path, visit: Visit) -> None:
    """Criteria with their confidence; a wrong one changes nothing, and is said."""
    session = visit("certify", **LINK)
    session.give("mine.toml", b"confidence = 0.8\n[[criterion]]\nmetric = 'peak'\nat_most = 20")
    assert session.field("Confidence").value == 0.8
    assert session.app.session_state["criteria"] == ["peak~~~20~peak~g"]
    session.give("mine.toml", b"[[criterion]]\nmetric = 'force'\nat_most = 20")
    assert "mine.toml, criterion 1: expected a metric of peak" in session.words
    assert session.app.session_state["criteria"] == ["peak~~~20~peak~g"]
    assert (asking / "criteria.toml").read_text() == CRITERIA


def test_what_is_asked_is_saved_into_the_campaign_and_shown_to_whoever_comes_next(
    open_campaign: Path, visit: Visit
) -> None:
    """With one button, and taken back by Undo; of the sample, whose folder stays as it is, as files."""
    session = visit("certify", **LINK).press("Limits of these tests")
    session.edit("planned", {0: {0: "First", 1: "31"}})
    asked = session.app.session_state["criteria"]
    session.press("Save in the campaign")
    assert not session.app.error
    assert not {"criteria", "planned"} & {*session.app.query_params}
    fresh = visit("certify", **LINK)
    assert [row.split("~")[:4] for row in fresh.app.session_state["criteria"]] == [row.split("~")[:4] for row in asked]
    assert fresh.app.session_state["matrix"] == "The campaign’s"
    fresh.app.button_group(key="matrix").set_value("Typed in")
    assert fresh.run().rows("planned")[0][:2] == ["First", "31"]
    assert [button.disabled for button in fresh.app.button if button.label == "Save in the campaign"] == [True]
    fresh.go("data").press("Undo")
    assert not (open_campaign / "criteria.toml").exists()
    assert not (open_campaign / "matrix.csv").exists()
    sample = visit("certify", campaign="sample", confidence="0.9")
    assert "Save in the campaign" not in sample.buttons
    assert sample.downloads == ["criteria.toml"]


def test_what_cannot_be_saved_stays_typed(asking: Path, visit: Visit, monkeypatch: pytest.MonkeyPatch) -> None:
    """The folder may turn out to be full, or somebody's."""
    session = visit("certify", **LINK).edit("criteria", {0: {3: "444"}})

    def full(*_: object) -> str:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("crashfuse.ui.certify.matrix._save", full)
    assert "No space left" in session.press("Save in the campaign").tables[-1].to_string()
    assert session.app.session_state["criteria"][0] == "max_crush~~~444~crush~mm"
    assert (asking / "criteria.toml").read_text() == CRITERIA


@pytest.mark.usefixtures("asking")
def test_rows_typed_in_are_in_the_link_and_stay_when_the_page_is_left(visit: Visit) -> None:
    """A second session with the link begins with the same rows; the folder's own criteria are no part of a link."""
    session = visit("certify", **LINK)
    assert "criteria" not in session.app.query_params
    session.edit("criteria", {0: {3: "444"}, 1: {4: None}})
    typed = ["max_crush~~~444~crush~mm", "rating~40~0.6~~~"]
    assert session.app.query_params["criteria"] == typed
    assert session.go("data").go("certify").app.session_state["criteria"] == typed
    second = visit("certify", **LINK, criteria=typed, confidence="0.8")
    assert (second.rows("criteria")[0][3], second.field("Confidence").value) == ("444", 0.8)
    second.edit("criteria", {2: {}})
    assert not second.app.error  # a new row is none before anything is typed in it
    second.edit("criteria", {0: {0: "peak"}})
    assert second.app.session_state["criteria"] == ["peak~~~~~", typed[1]]  # a limit of crush is none of peak
    assert second.rows("criteria")[0] == ["peak", "", "", "", ""]
    assert "expected at_least or at_most" in second.words
    second.edit("criteria", {2: {0: "olc", 3: "25,5"}, 3: {0: "sm25", 3: "1,234"}}, 0)  # as pasted
    assert second.app.session_state["criteria"] == [typed[1], "olc~~~25.5~~", "sm25~~~1,234~~"]
    assert "found '1,234'" in second.words
    second.edit("criteria", {row: {0: "peak"} for row in range(2, 1002)})
    assert "at most 1000 rows" in second.words


def test_a_small_limit_whose_unit_the_file_states_is_asked_for_as_it_is(asking: Path, visit: Visit) -> None:
    """Without its unit it would be refused: it could be in metres."""
    row = '[[criterion]]\nmetric = "static_crush"\nat_most = 2.5\n'
    (asking / "criteria.toml").write_text(row)
    assert "else state the unit" in visit("certify", **LINK).words
    (asking / "criteria.toml").write_text(row + 'unit = "mm"\n')
    session = visit("certify", **LINK)
    assert session.rows("criteria")[0][3] == "2.5"
    assert "else state the unit" not in session.words
    assert "Certify" in session.buttons


@pytest.mark.usefixtures("asking")
def test_planned_tests_are_typed_in_the_readers_units(visit: Visit) -> None:
    """At first the campaign's; each is changed, added or removed, and the link has them."""
    session = visit("certify", **LINK, system="kph-kg", matrix="Typed in")
    assert session.rows("planned")[0][:2] == ["M1", "32.1869"]
    session.edit("planned", {0: {1: "56"}, 3: {0: "P01", 1: "40", 2: "930", 3: "680"}}, 1)
    rows = [text.split("~")[:2] for text in session.app.query_params["planned"]]
    assert [name for name, _ in rows] == ["M1", "M3", "P01"]
    assert float(rows[0][1]) == pytest.approx(56 / 1.609344)  # the matrix is in mph
    assert "Certify" in session.buttons
    session.edit("planned", {1: {1: None}})
    assert "Planned tests, column speed_mph, row 2: expected a number" in session.words
    assert "Certify" not in session.buttons


@pytest.mark.usefixtures("asking")
def test_back_takes_the_table_of_criteria_back(visit: Visit) -> None:
    """What the address says is shown, whatever was typed in since; what is no criterion stays, and is told."""
    link = ["peak~~~25~", "~~", "force~~~1~", "olc~~~x~"]
    session = visit("certify", **LINK, criteria=link)
    assert session.app.session_state["criteria"] == link
    for number, found in ((2, "force"), (3, "'x'")):  # of the rows in which anything is
        assert re.search(f"criterion {number}: .*found {found}", session.words)
    session.app.session_state["criteria"] = ["peak~~~30~", "olc~~~20~"]  # as Back does
    assert session.run().app.query_params["criteria"] == ["peak~~~30~", "olc~~~20~"]


UNITS = [("unit", "m/s²"), ("system", "kph-kg"), ("unit", "g"), ("system", "mph-lb")]


@pytest.mark.slow
@pytest.mark.parametrize("complete", [True, False])
def test_other_units_change_what_is_shown_and_nothing_else(asking: Path, visit: Visit, *, complete: bool) -> None:
    """Criteria, planned tests, answers and link stay, rows that are not complete, too; shown is the reader's unit."""
    declared = {"peak": 18.25, "delta_v": 48, "olc": 26}
    rows = [f'[[criterion]]\nmetric = "{metric}"\nat_most = {most}\n' for metric, most in declared.items()]
    (asking / "criteria.toml").write_text("\n".join(rows))
    incomplete = {"criteria": ["peak~~~18.25~", "delta_v~~~48~", "olc~~~~"], "planned": ["A~30~~700~kph-kg~"]}
    session = visit("certify", **LINK, matrix="Typed in", **({} if complete else incomplete))
    kept = "criteria", "planned", "confidence", "cell"

    def said() -> tuple[list[str], *tuple[object, ...]]:
        certified(session)
        link = {k: v for k, v in session.app.query_params.items() if k not in ("unit", "system")}
        return answers(session), link, [session.app.session_state[key] for key in kept], bool(session.app.error)

    first, shown = said(), {"unit": "g", "system": "mph-lb"}
    assert len(first[0]) == 3 * complete
    for key, value in UNITS:
        shown[key] = value
        session.app.sidebar.button_group(key=key).set_value(value)
        for act in (session.run, session.run, lambda: session.go("data").go("certify")):
            act()
            assert said() == first
            limits = [
                18.25 * (9.80665 if shown["unit"] != "g" else 1),
                48 / (1 if shown["system"] != "mph-lb" else 1.609344),
            ]
            assert [float(row[3]) for row in session.rows("criteria")[:2]] == pytest.approx(limits, rel=1e-5)


@given(some.floats(0.001, 1e6), some.sampled_from([1.0, *IN_SI.values()]))
def test_a_limit_that_is_typed_in_is_shown_as_typed(declared: float, factor: float) -> None:
    """In any unit; one that is not typed in stays as it was declared."""
    shown = Field("At most", factor=lambda _: factor)
    assert float(str(shown.shown(shown.text(f"{declared:.5g}", []), []))) == float(f"{declared:.5g}")


@pytest.mark.slow
def test_what_belongs_to_a_campaign_goes_with_it(
    asking: Path, campaign_on_disk: Path, tmp_path: Path, visit: Visit
) -> None:
    """Another campaign without criteria, opened beside verdicts, says so in the open; Back finds what was there."""
    other = tmp_path / "another vehicle"
    shutil.copytree(campaign_on_disk, other)
    session = certified(visit("certify", **LINK))
    choices = session.app.expander[0]
    assert (choices.label, choices.proto.expanded) == ("2 criteria · 3 planned tests · confidence 0.9 · change", False)
    session.press(of_row(session, "M1"))
    assert session.app.query_params["cell"] == "M1"
    session.go("data").open_folder(str(other)).go("certify")
    assert session.app.session_state["campaign"] == other.name
    assert "No criteria yet" in session.words
    assert session.app.expander[0].proto.expanded
    assert session.field("Confidence").value == 0.95
    assert not {"cell", "criteria"} & {*session.app.query_params}
    session.app.sidebar.selectbox(key="campaign").set_value(asking.name)
    assert not session.run().app.expander[0].proto.expanded
    assert of_row(session, "M1")


@pytest.mark.usefixtures("open_campaign")
def test_an_uploaded_matrix_is_in_the_link_also_of_the_next_server(
    visit: Visit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another session sees the same conditions by the link, also after a restart; once they are gone it is told."""
    monkeypatch.setenv("CRASHFUSE_CACHE", str(tmp_path))
    session = visit("certify", matrix="Upload")
    content = b"id,speed_mph,front_weight_lb,rear_weight_lb\nA,21,2050,1500\nB,24.5,2050,1500\n"
    session.give("planned.csv", content)
    summary = "2 planned tests, 21.0 to 24.5 mph"
    assert summary in [own.label for own in session.app.expander]
    link = {"matrix": "Upload", "uploaded": session.app.session_state["uploaded"]}
    assert session.run().app.query_params["uploaded"] == link["uploaded"]
    assert summary in [own.label for own in visit("certify", **link).app.expander]
    assert session.give("planned.csv", b"id,speed\n").app.session_state["uploaded"] is None
    assert session.app.error
    st.cache_resource.clear()  # as a server does that begins
    assert summary in [own.label for own in visit("certify", **link).app.expander]
    (kept,) = (tmp_path / "uploads").iterdir()
    assert kept.read_bytes() == content
    kept.write_bytes(content.replace(b"21", b"22"))  # valid, but not what the link means
    elsewhere = visit("certify", **link)
    assert "not on this server" in elsewhere.words
    assert "Certify" not in elsewhere.buttons


def test_an_earlier_certification_is_held_against_the_verdicts_and_is_in_the_link(asking: Path, visit: Visit) -> None:
    """Uploaded, or chosen from those kept; another session sees what became of it, and none is cleared."""
    session = certified(visit("certify", **LINK)).open_tab("certify", "Track record")
    assert kept(session).options  # as soon as they were known
    assert "noted before a test" in session.press("Keep today’s verdicts").words
    record = json.loads(certification_json(of_library(asking)))
    last, _ = record["tests_sha256"].popitem()
    told = f"Run since: {last}."
    for content, words in ((b"{}", "expected the record of a certification"), (json.dumps(record).encode(), told)):
        assert words in session.give("certification.json", content).words
    assert kept(session).value == session.app.session_state["earlier"]
    link = {**LINK, "earlier": session.app.session_state["earlier"], "certify_tab": "Track record"}
    assert told in certified(visit("certify", **link)).words
    assert session.fill({"Earlier certification": None}).app.session_state["earlier"] is None
    kept(session).select_index(0)
    assert "An earlier certification judged" in session.run().words


def kept(session: Session) -> "Selectbox[str]":
    """The list of earlier certifications."""
    return next(box for box in session.app.selectbox if box.label == "Earlier certification")


@pytest.mark.usefixtures("asking")
@pytest.mark.parametrize("asked", ["0.3", "95"])
def test_a_confidence_that_there_is_not_is_a_sentence(visit: Visit, asked: str) -> None:
    """The stricter the request, the more lenient would the answer be, if the nearest one was taken without a word."""
    session = visit("certify", **LINK, confidence=asked)
    assert f"expected a confidence from 0.5 to 0.999999, found {asked}" in session.words
    assert "Certify" not in session.buttons
    session.field("Confidence").set_value(0.8).run()
    assert "expected a confidence" not in session.words


@pytest.mark.usefixtures("asking")
def test_one_campaigns_confidence_is_not_anothers(visit: Visit) -> None:
    """The sample's criteria come with their own."""
    session = visit("certify", **LINK)
    assert session.field("Confidence").value == 0.9
    assert session.fill({"Campaign": "sample"}).field("Confidence").value == 0.95


def test_costs_in_the_address_ask_for_a_confidence_unless_one_is_declared(asking: Path, visit: Visit) -> None:
    """The field follows them; a cost without the other is a sentence."""
    session = visit("certify", **LINK, cost_test="5")
    assert "expected costs test and wrong_answer, above 0" in session.words
    session.field("Cost of a wrong answer").set_value(500.0).run()
    assert (session.field("Confidence").value, session.app.query_params["cost_wrong"]) == (0.9, "500")
    (asking / "criteria.toml").write_text(CRITERIA.removeprefix("confidence = 0.9\n"))
    session = visit("certify", **LINK, cost_test="5", cost_wrong="500")
    assert session.field("Confidence").value == 0.99
