"""What goes out of the pages: a pulse for an occupant model, tables for a spreadsheet, figures as pictures."""

import io
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from streamlit.testing.v1 import AppTest

from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign
from crashfuse.study.estimate import Estimate
from crashfuse.ui import figures, occupant_model


def page() -> None:
    """The section alone, for two approaches of which one has draws."""
    from crashfuse.testing import small_campaign
    from crashfuse.ui.occupant_model import offer_pulses
    from tests.ui.test_outgoing import estimates

    offer_pulses(small_campaign(), estimates(small_campaign()), "fused", 0, ["Test T1 was left out."])


def estimates(campaign: Campaign) -> list[Estimate]:
    """The first test's pulse twice."""
    test = campaign.tests[0]
    accel = test.pulse.accel_mps2
    with_draws = Prediction(test.condition, accel, accel * np.linspace(0.9, 1.1, 7)[:, None])
    return [
        Estimate("cae", replace(with_draws, draws_mps2=None), {}, 0.1),
        Estimate("fused", with_draws, {}, 0.1),
    ]


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, dict[str, str]]]:
    """Name and texts of each file that the page would hand out, anew at each run."""
    files: list[tuple[str, dict[str, str]]] = []

    def take(name: str, write: object, of: str) -> None:
        assert of == "Tiny"
        assert callable(write)
        with zipfile.ZipFile(io.BytesIO(write())) as archive:
            files.append((name, {each: archive.read(each).decode("latin-1") for each in archive.namelist()}))

    monkeypatch.setattr(occupant_model, "download_bytes", take)
    return files


def test_a_page_hands_out_curves_as_they_are_chosen(made: list[tuple[str, dict[str, str]]]) -> None:
    """The recommended approach first; units, sign, start, scale, id and draws as in the fields."""
    app = AppTest.from_function(page).run()
    assert not app.exception
    name, files = made[-1]
    assert (name, set(files)) == ("fused-15mph-lsdyna.zip", {"fused_15mph_expected.k"})
    assert "Units mm-ms-kg" in files["fused_15mph_expected.k"]
    assert "Test T1 was left out." in files["fused_15mph_expected.k"]
    app.selectbox(key="export units").set_value("mm-s-t")
    app.button_group(key="export sign").set_value("positive")
    app.number_input(key="export start").set_value(10.0)
    app.number_input(key="export scale").set_value(0.5)
    app.number_input(key="export id").set_value(42)
    app.number_input(key="export draws of 7").set_value(3)
    app.run()
    assert not app.exception
    name, files = made[-1]
    assert len(files) == 4
    for text in files.values():
        for said in ("Units mm-s-t", "Braking is positive.", "Contact is at 0.01 s", "scaled by 0.5"):
            assert said in text
        assert "-0.000000000000E+00" not in text
    assert len({text.partition("lcint\n")[2][:10] for text in files.values()}) == 4
    app.button_group(key="export format").set_value("radioss").run()
    assert {name.partition(".")[2] for name in made[-1][1]} == {"inc"}
    app.selectbox(key="export approach").set_value("cae").run()
    assert not app.exception
    assert made[-1][0] == "cae-15mph-radioss.zip"
    assert set(made[-1][1]) == {"cae_15mph_expected.inc"}


def test_a_page_hands_out_iso_mme_at_a_location(made: list[tuple[str, dict[str, str]]]) -> None:
    """In capitals as they belong; a code that is none is explained, and nothing is handed out."""
    app = AppTest.from_function(page).run()
    app.button_group(key="export format").set_value("isomme").run()
    app.text_input(key="export location").set_value("10bpillere00").run()
    assert not app.exception
    assert any("10BPILLERE00ACXS" in text for text in made[-1][1].values())
    before = len(made)
    app.text_input(key="export location").set_value("VEHC").run()
    assert "12 digits and capitals" in app.warning[0].value
    assert len(made) == before


def test_no_tool_sends_a_figure_away() -> None:
    """The button that uploads a chart is off."""
    assert figures._TOOLS["showSendToCloud"] is False
