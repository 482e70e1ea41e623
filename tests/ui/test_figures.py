"""Figures as they are sent to the browser, and those of the library on the pages."""

import inspect
import json
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest

import crashfuse
from crashfuse import Campaign, Condition, Display, StudyConfig, load_campaign
from crashfuse.files.archive import zipped
from crashfuse.files.csv_text import csv_bytes
from crashfuse.results.drawing import Drawing, drawing_of, drawing_table
from crashfuse.results.figures import Further
from crashfuse.results.plots.canvas import new_drawing
from crashfuse.ui.kit.figures import SentFigure, offer_files
from crashfuse.ui.kit.files import Caption
from crashfuse.ui.predict import _ends
from crashfuse.units import KPH_KG
from tests.readers.nhtsa_files import nhtsa_files
from tests.ui.conftest import Session, Visit
from tests.ui.test_certify import CRITERIA, MATRIX

pytestmark = [pytest.mark.usefixtures("one_cache"), pytest.mark.slow]
APPROACHES = ["cae", "displacement_domain"]
OPTIONS = {"unit": "m/s²", "system": "kph-kg", "sign": "Deceleration", "window": "40", "approaches": APPROACHES}
SHOWN = Display(40.0, "m/s²", deceleration=True, system=KPH_KG)


def sent(drawing: Drawing) -> dict[str, Any]:
    drawn: dict[str, Any] = json.loads(SentFigure(drawing).to_json())
    return drawn


def test_curves_are_those_of_the_figure_to_a_twenty_thousandth_of_their_largest_value(campaign: Campaign) -> None:
    """Plain numbers, the same titles of axes and names."""
    figure = campaign.plot()
    drawn = sent(drawing_of(figure))
    assert "bdata" not in json.dumps(drawn)
    for curve, own in zip(figure.data, drawn["data"], strict=True):
        np.testing.assert_allclose(own["x"], curve.x, atol=1e-2)
        np.testing.assert_allclose(own["y"], curve.y, atol=5e-5 * np.abs(curve.y).max())
        assert own["name"] == curve.name
    assert drawn["layout"]["xaxis"]["title"] == {"text": "Time (ms)", "font": {"size": 14}}


def test_a_gap_in_a_band_stays_a_gap() -> None:
    """What is unknown is no number, and the positions of an outline are kept as they are."""
    drawing, at = new_drawing(400), np.arange(5.0)
    drawing.band(at, np.array([0, 1, np.nan, 1, 0]), at + 3, colour="#000000")
    (band,) = sent(drawing)["data"]
    assert band["x"] == [0, 1, 1, 0, None, 3, 4, 4, 3]
    assert band["y"] == [0, 1, 4, 3, None, 1, 0, 7, 6]


def test_a_revision_stands_for_the_data(campaign: Campaign) -> None:
    """The same data, the same revision; one value changed, another."""
    one, same, other = (drawing_of(campaign.plot()) for _ in range(3))
    other.marks[0].look["y"] = other.marks[0].look["y"] + 0.5
    revisions = [sent(drawing)["layout"]["datarevision"] for drawing in (one, same, other)]
    assert revisions[0] == revisions[1] != revisions[2]


def test_the_table_of_a_figure_has_the_curves_that_are_shown(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    figure, got = campaign.plot(), dict[str, Any]()
    monkeypatch.setattr("crashfuse.ui.kit.figures.component", lambda *_, **__: lambda data, **_: got.update(data))
    asked = {"files x": {"csv": {"at": 1, "hidden": ["0"]}}}
    monkeypatch.setattr("crashfuse.ui.kit.figures.st.session_state", asked)
    inspect.unwrap(offer_files)(SentFigure(drawing_of(figure)), Caption("", "", ""), "x")
    assert got["csv"] == csv_bytes(drawing_table(drawing_of(figure), [0])).decode()
    assert got["csv"] != csv_bytes(drawing_table(drawing_of(figure))).decode()


def test_many_names_have_room_above_the_figure() -> None:
    """Two rows where one does not suffice; a figure that needs more keeps what it has."""
    few, many, roomy = (new_drawing(400) for _ in range(3))
    for drawing, count in ((few, 3), (many, 12), (roomy, 3)):
        for number in range(count):
            drawing.line([0, 1], [0, 1], name=f"T{number} · 35.2 mph")
    roomy.update(margin={"t": 96})
    few_px, many_px, roomy_px = (sent(drawing)["layout"]["margin"]["t"] for drawing in (few, many, roomy))
    assert (few_px, many_px, roomy_px) == (44, 65, 96)


def lit(part: Any, light: Any) -> Any:
    """What the buttons' script makes of a figure for its files."""
    if not isinstance(light, dict):
        return light
    places = part.items() if isinstance(part, dict) else enumerate(part)
    merged = {name: lit(own, light[name]) if name in light else own for name, own in places}
    return merged if isinstance(part, dict) else [*merged.values()]


@pytest.mark.parametrize("name", ["tests", "conditions", "cae"])
def test_files_of_a_dark_page_have_the_colours_of_a_light_one(campaign: Campaign, name: str) -> None:
    """All else stays as it is on the page; a light page has nothing to change."""
    drawing = campaign.draw(name)
    dark, light = SentFigure(drawing, dark=True), SentFigure(drawing)
    shown = lit(dark.to_dict(), dark.light)
    assert dark.to_dict() != shown
    shown["layout"]["datarevision"] = light.to_dict()["layout"]["datarevision"]
    assert shown == light.to_dict()
    assert light.light == {}


def drawn(session: Session) -> list[list[dict[str, Any]]]:
    return [json.loads(chart.proto.spec)["data"] for chart in session.app.get("plotly_chart")]


def traces(*figures: go.Figure) -> list[list[dict[str, Any]]]:
    """The same of figures of the library, in the form in which pages send them."""
    return [sent(drawing_of(figure))["data"] for figure in figures]


def opened(visit: "Visit", page: str, press: str, **parameters: object) -> Session:
    session = visit(page, **OPTIONS, **parameters)
    if press in session.buttons:
        session.press(press)
    return session.finish(100)


def test_on_data(open_campaign: Path, visit: "Visit") -> None:
    campaign = load_campaign(open_campaign)
    session = visit("data", test="T2", **OPTIONS)
    on_cae = ("cae and test", "cae events", "cae")
    for tab, figures in (("Tests", ["tests"]), ("Conditions", ["conditions"]), ("CAE model", on_cae)):
        held_out = {figure: None if figure == "cae events" else "T2" for figure in figures}
        expected = [campaign.plot(figure, held_out=held_out[figure], display=SHOWN) for figure in figures]
        assert drawn(session.open_tab("data", tab).finish()) == traces(*expected), tab


def test_on_compare(open_campaign: Path, visit: "Visit") -> None:
    """Over time with corridors and another test beside, over displacement, residuals, and why it is rated so."""
    link = {"test": "T2", "compare_also": ["T3"], "corridors": "true", "explained": "cae"}
    session = opened(visit, "compare", "Predict test T2", **link)
    study = crashfuse.run_study(load_campaign(open_campaign), held_out=["T2"], approaches=APPROACHES, workers=1)

    def library(figure: str, **options: Any) -> list[list[dict[str, Any]]]:
        return traces(study.plot("T2", figure, approaches=["cae"], also=["T3"], display=SHOWN, **options))

    assert drawn(session) == library("motion", corridors=True)
    for choice, figure in (("Over displacement", "displacement"), ("Energy", "energy"), ("Residuals", "residuals")):
        session.app.button_group(key="compared").set_value(choice).run()
        assert drawn(session) == library(figure), figure
    session.app.button_group(key="compare_tab").set_value("Why").run()
    why = study.plot("T2", "scores", display=SHOWN), study.plot("T2", "rating", approaches=["cae"], display=SHOWN)
    assert drawn(session) == traces(*why)


@pytest.mark.usefixtures("quick_networks")
def test_on_train(open_campaign: Path, visit: "Visit") -> None:
    """The networks before and after the tests, and how they learned; the bias and its parts."""
    names = ["cae", "lf_tcn", "time_domain", "displacement_domain"]
    study = crashfuse.run_study(load_campaign(open_campaign), held_out=["T2"], approaches=names, workers=1)
    session = visit("train", test="T2", train_tab="Diagnostics", **{**OPTIONS, "approaches": names}).finish()
    pulses = study.plot("T2", "acceleration", approaches=names[:3], band="time_domain", display=SHOWN)
    learning = [study.plot("T2", figure, approaches=["time_domain"]) for figure in ("training", "fine-tuning")]
    assert drawn(session) == traces(pulses, *learning)
    for choice, figure in (
        ("Bias by speed", study.campaign.plot("bias", held_out="T2", display=SHOWN)),
        ("Parts of the bias", study.plot("T2", "bias parts", display=SHOWN)),
    ):
        session.app.button_group(key="diagnostics").set_value(choice).run()
        assert drawn(session) == traces(figure)


def test_on_certify(open_campaign: Path, visit: "Visit") -> None:
    """Verdicts, what left-out tests showed, whether the probabilities are right, and where predictions are checked."""
    (open_campaign / "criteria.toml").write_text(CRITERIA)
    (open_campaign / "matrix.csv").write_text(MATRIX)
    session = opened(visit, "certify", "Certify", approach="displacement_domain")
    paths = open_campaign / "criteria.toml", open_campaign / "matrix.csv"
    verdicts = crashfuse.certify(load_campaign(open_campaign), *paths, approach="displacement_domain", workers=1)
    for tab, figure in (("Answer", "planned"), ("Validated domain", "domain"), ("Track record", "record")):
        session.app.button_group(key="certify_tab").set_value(tab)
        assert drawn(session.run()) == traces(verdicts.plot(figure, display=SHOWN))
    session.app.button_group(key="record").set_value("Are the probabilities right?")
    assert drawn(session.run()) == traces(verdicts.plot("reliability", display=SHOWN))


def test_on_an_import(open_campaign: Path, visit: "Visit", tmp_path: Path) -> None:
    assert open_campaign.is_dir()
    source = tmp_path / "v5.zip"
    source.write_bytes(zipped(nhtsa_files()))
    session = visit("data", opening="open", **OPTIONS).upload({source.name: source.read_bytes()})
    (preview,) = crashfuse.preview_source(source)
    assert drawn(session) == traces(preview.plot(display=SHOWN))


def test_on_study(open_campaign: Path, visit: "Visit") -> None:
    """Ratings, alone and with the speed group, and the bands."""
    session = opened(visit, "study", "Leave out each of 4 tests")
    config = StudyConfig(approaches=tuple(APPROACHES), leave_out="both")
    study = crashfuse.run_study(load_campaign(open_campaign), config, workers=1)
    assert drawn(session) == traces(study.plot(display=SHOWN))
    session.app.button_group(key="ways").set_value("With all tests at about its speed").run()
    assert study.speed_groups is not None
    assert drawn(session) == traces(study.speed_groups.plot(display=SHOWN))
    session.app.button_group(key="study_tab").set_value("Bands").run()
    for way, label in ((study.speed_groups, "With all tests at about its speed"), (study, "Each test left out alone")):
        session.app.button_group(key="ways").set_value(label).run()
        assert drawn(session) == traces(*(way.plot(figure=name, display=SHOWN) for name in ("draws", "calibration")))


def test_on_predict(open_campaign: Path, visit: "Visit", monkeypatch: pytest.MonkeyPatch) -> None:
    """Over time beside a pinned prediction and a test, over displacement, energy, over speed, the test to run next."""
    monkeypatch.setattr("crashfuse.study.planning.speeds_between", lambda low, high: np.linspace(low, high, 4))
    at = {"speed_mph": 30.0, "front_weight_lb": 2050.0, "rear_weight_lb": 1500.0}
    pin = Condition.of(**{**at, "speed_mph": 20.0})
    link = {name: str(value) for name, value in at.items()}
    session = opened(visit, "predict", "Predict", predict_also=["T3"], pins=[pin.text], **link)
    campaign = load_campaign(open_campaign)
    prediction = crashfuse.predict(campaign, Condition.of(**at), APPROACHES)
    also: list[Further] = ["T3", crashfuse.predict(campaign, Condition.parse(pin.text), "displacement_domain")]
    for choice, figure in (
        ("Over time", "motion"),
        ("Over displacement", "displacement"),
        ("Energy over crush", "energy"),
    ):
        session.app.button_group(key="predicted").set_value(choice).run()
        expected = prediction.plot(figure, approaches=["displacement_domain"], also=also, average=False, display=SHOWN)
        assert drawn(session) == traces(expected)
    session.app.button_group(key="predict_tab").set_value("Over speed").run()
    session.press("Predict over speed").finish()
    session.app.selectbox(key="sweep_metric").set_value("peak").run()
    swept = crashfuse.sweep(campaign, Condition.of(**at), approach=APPROACHES)
    assert drawn(session) == traces(swept.plot("peak", display=SHOWN))
    session.app.button_group(key="predict_tab").set_value("Next test").run()
    chosen = [_ends(session.app.session_state[f"{axis}_range"]) for axis in ("speed", "front", "rear")]
    kind = campaign.tests[0].condition.factors
    low, high = (Condition.of_vector([v0, front, rear], kind) for v0, front, rear in zip(*chosen, strict=True))
    assert drawn(session) == traces(crashfuse.next_test(campaign, low, high).plot(display=SHOWN))
