"""Which curves a figure of pulses shows: the choice of its own, and what is added."""

import json
from types import SimpleNamespace

import pytest

from crashfuse.ui.kit.files import Caption
from tests.ui.conftest import Session, Visit, as_read

pytestmark = pytest.mark.usefixtures("open_campaign")

CAE_ONLY = {"approaches": "cae"}


def beside_the_figure(session: Session) -> list[str]:
    """What is said in small print where everyone sees it, not in a popover that has to be opened."""
    folded = [caption for popover in session.app.get("popover") for caption in popover.get("caption")]
    return [as_read(each.value) for each in session.app.caption if each not in folded]


def test_a_link_may_ask_for_anything(visit: Visit) -> None:
    """What is known is shown, and labelled in full; beside the figure it is said which tests and runs are not known."""
    asked = ["T9", "T3", "cae:C00", "cae:none", "at:1mph"]
    session = visit("compare", **CAE_ONLY, test="T2", explained="magic", compare_also=asked)
    predicted(session)
    session.app.session_state["pins"] = ["30mph 2000lb 1500lb", "0mph 1lb", "🚗"]
    (also,) = [each for each in session.run().app.multiselect if each.label == "Also show"]
    assert also.value == ["T3", "cae:C00"]
    assert "T3 · 26.0 mph" in also.options
    assert any(option.startswith("CAE run C00 · ") for option in also.options)
    assert [option for option in also.options if " at 30.0 mph" in option] == ["CAE at 30.0 mph, 2000 + 1500 lb"]
    assert not any(option.startswith("T2") for option in also.options)  # it is there already
    assert "Not among the tests in use and the CAE runs: T9, none." in beside_the_figure(session)


def test_the_nearest_tests_follow_the_test_and_go_as_they_came(visit: Visit) -> None:
    """T3 is one mile per hour from T2; on Predict nothing of it is shown."""
    session = predicted(visit("compare", **CAE_ONLY, test="T2"))
    session.app.toggle(key="compare_nearest").set_value(True).run()
    assert all(f"{name} · " in figure(session) for name in ("T1", "T3", "T4"))
    assert "T2 · " not in figure(session)
    session.app.session_state["test"] = "T3"
    predicted(session.run(), "T3")
    assert "T2 · " in figure(session)
    assert "T3 · " not in figure(session)
    assert "T2 · " not in figure(fitted(visit("predict", **CAE_ONLY)))
    session.app.toggle(key="compare_nearest").set_value(False).run()
    assert "T2 · " not in figure(session)


def test_a_test_that_stands_apart_is_always_among_the_nearest(visit: Visit, monkeypatch: pytest.MonkeyPatch) -> None:
    apart = SimpleNamespace(test="T1")
    monkeypatch.setattr("crashfuse.ui.kit.curves.departures_near", lambda *_: (apart,))
    monkeypatch.setattr("crashfuse.ui.kit.curves._NEAREST", 1)
    session = predicted(visit("compare", **CAE_ONLY, test="T2", compare_nearest="true"))
    assert [f"{name} · " in figure(session) for name in ("T1", "T3", "T4")] == [True, True, False]


def test_a_page_begins_with_the_curves_that_matter(visit: Visit, monkeypatch: pytest.MonkeyPatch) -> None:
    """The recommended prediction, the CAE model and the test; files of other curves have other names."""
    captions: list[Caption] = []
    monkeypatch.setattr("crashfuse.ui.kit.figures.offer_files", lambda _, caption, __: captions.append(caption))
    approaches = ["cae", "displacement_domain"]
    session = predicted(visit("compare", approaches=approaches, test="T2"))
    over_time = "Acceleration, velocity and displacement over time: "
    assert captions[-1].title == f"{over_time}test T2 and its prediction by CAE and Displacement domain"
    assert "pulses-Displacement-domain-Test-CAE" in captions[-1].name
    session.app.session_state["compare_curves"] = []
    session.run()
    assert captions[-1].title == f"{over_time}test T2, prediction by Displacement domain"
    assert "Test" not in captions[-1].name
    fitted(visit("predict", approaches=approaches))
    assert captions[-1].title.startswith("Prediction by CAE and Displacement domain at ")
    assert "Representative" not in captions[-1].name


def predicted(session: Session, test: str = "T2") -> Session:
    return session.press(f"Predict test {test}").finish()


def figure(session: Session) -> str:
    return json.dumps(json.loads(session.app.get("plotly_chart")[0].proto.spec), ensure_ascii=False)


def fitted(session: Session) -> Session:
    return session.press("Predict").finish()
