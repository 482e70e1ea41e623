"""Files that a page offers: names, captions, pulses for an occupant model."""

import io
import re
import zipfile
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import streamlit as st
from streamlit.testing.v1 import AppTest

from crashfuse.campaign import Campaign
from crashfuse.files.csv_text import csv_bytes
from crashfuse.study.estimate import Estimate
from crashfuse.ui.kit import figures, files
from crashfuse.ui.kit.files import Caption, caption, file_name, unusual_settings

ALT = "Acceleration, velocity and displacement over time: test T2"
Captioned = Callable[..., Caption]


@pytest.fixture
def captioned(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> Captioned:
    """Captions of the pulses of a test, on Compare with the usual choices and those that are given."""

    def of(campaign: Campaign = campaign, **chosen: Any) -> Caption:
        usual = {"page": "compare", "campaign": "tiny", "test": "T2", "leave_out": "test", "preset": "fast", "seed": 0}
        shown = {"window": 60.0, "unit": "g", "sign": "Acceleration", "system": "mph-lb"}
        usual["defaults"] = {"system": "mph-lb", **chosen.pop("defaults", {})}
        monkeypatch.setattr(st, "session_state", {**usual, **shown, **chosen})
        monkeypatch.setattr("crashfuse.ui.kit.campaigns.load", lambda _: campaign)
        return caption(ALT, "pulses")

    return of


def test_a_name_has_the_campaign_the_test_what_is_drawn_the_window_and_the_unit(captioned: Captioned) -> None:
    assert captioned().name == "Tiny_T2_pulses_0-60ms_g"
    assert captioned(test="T3", window=20.0, unit="m/s²").name == "Tiny_T3_pulses_0-20ms_mps2"


@pytest.mark.parametrize(
    ("chosen", "end"),
    [
        ({"leave_out": "speed group"}, "speed-group-left-out"),
        ({"preset": "paper"}, "paper-settings"),
        ({"seed": 7}, "seed-7"),
        ({"sign": "Deceleration"}, "Deceleration"),
        ({"system": "kph-kg"}, "kph-kg"),
        ({"compare_also": ["T1", "cae:C07"]}, "with-T1-cae-C07"),
        ({"pins": ["30mph"]}, "pins-30mph"),
    ],
)
def test_a_name_has_whatever_is_not_as_usual(captioned: Captioned, chosen: dict[str, Any], end: str) -> None:
    """Else one figure would be saved over another."""
    assert captioned(**chosen).name == f"Tiny_T2_pulses_0-60ms_g_{end}"


def test_a_name_has_tests_left_out_of_use(captioned: Captioned, campaign: Campaign) -> None:
    shown = captioned(campaign=replace(campaign, unused=(("T9", campaign.test("T1").condition),)))
    assert shown.name == "Tiny_T2_pulses_0-60ms_g_without-T9"
    assert "T9 left out of use" in shown.details


def test_a_picture_says_test_condition_campaign_settings_and_notice(captioned: Captioned, campaign: Campaign) -> None:
    """On one line each: what is drawn, and of what; of the notice the words before its colon."""
    noted = replace(campaign, notice="Synthetic: from a simulation.")
    said = captioned(campaign=noted, leave_out="speed group", seed=3)
    assert said.title == "Acceleration, velocity and displacement over time: test T2"
    condition, *others = said.details.split(" · ")
    assert condition.startswith("Test T2 at 25.0 mph, front ")
    window, settings = "Rated time window 0–60 ms", "Fast settings, seed 3"
    assert others == ["Tiny", window, settings, "All at its speed left out", "Synthetic"]


def test_what_does_not_act_on_a_page_is_not_said_there(captioned: Captioned) -> None:
    """Data shows no results and holds nothing out, and a preview of an import is not of the open campaign."""
    on_data = captioned(page="data", seed=7, leave_out="speed group")
    assert (on_data.name, on_data.details) == ("Tiny_pulses_0-60ms_g", "Tiny · Rated time window 0–60 ms")
    assert unusual_settings() == []
    preview = captioned(page="data", **{"import": "v09876.zip"})
    assert (preview.name, preview.details) == ("pulses", "")
    assert captioned(page="compare", **{"import": "v09876.zip"}).name == "Tiny_T2_pulses_0-60ms_g"


def test_figures_of_different_certifications_have_different_names(captioned: Captioned) -> None:
    """By the approach that is judged, and by whatever else is asked; what would change it is not asked."""
    usual: dict[str, Any] = {"approach": "fused", "criteria": ["max_crush~~~430~"], "confidence": 0.95}
    chosen = {"page": "certify", **usual, "defaults": usual, "matrix": None, "what_if": ["a"]}
    plain = captioned(**chosen)
    assert plain.name == "Tiny_pulses_g"
    assert "Fused judged · Confidence 0.95 · Fast settings" in plain.details
    assert captioned(**{**chosen, "approach": "cae"}).name == "Tiny_pulses_g_cae"
    asked: list[dict[str, Any]] = [
        {"confidence": 0.9}, {"criteria": ["max_crush~~~400~"]}, {"earlier": "abc"}, {"matrix": "grid"},
        {"planned": ["P01~20"]}, {"planned": ["P01~30"]},
    ]  # fmt: skip
    names = [captioned(**{**chosen, **other}).name for other in asked]
    assert all(re.fullmatch(r"Tiny_pulses_g_[0-9a-f]{6}", name) for name in names)
    assert len({*names}) == len(asked)
    assert captioned(**{**chosen, **asked[0]}).name == names[0]


@pytest.mark.parametrize(
    ("parts", "name"),
    [
        (("Sample (synthetic)", "T09", "CAE and Time domain"), "Sample-synthetic_T09_CAE-and-Time-domain"),
        (("../../etc", "a/b\\c:d"), "etc_a-b-c-d"),
        (("Prüfung 7", "", "pulses"), "Pr-fung-7_pulses"),
    ],
)
def test_a_name_of_a_file_is_safe_on_any_disk(parts: tuple[str, ...], name: str) -> None:
    """Whatever a test is called: no folders, no signs that a disk refuses."""
    assert file_name(*parts) == name


def test_long_names_are_cut_and_stay_different() -> None:
    """Two dozen tests beside differ from two dozen others that begin alike."""
    names = [file_name("Tiny", "with " + " ".join(f"T{number}" for number in range(end))) for end in (60, 61)]
    assert names[0] != names[1]
    assert {len(name) for name in names} == {130}


def test_a_downloaded_table_is_the_file_of_the_command_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Byte for byte, in as many digits: two files of one certification that differ are a finding in a review."""
    monkeypatch.setattr("streamlit.session_state", {"page": "predict", "seed": 7})
    table = pd.DataFrame({"id": ["A"], "value": [24.958261014512296], "lower": [None]})
    offered: dict[str, Callable[[], bytes]] = {}

    def take(_: str, write: Callable[[], bytes], file_name: str, **__: object) -> None:
        offered[file_name] = write

    monkeypatch.setattr("crashfuse.ui.kit.files.st.download_button", take)
    for of, name in (("", "certification.csv"), ("my car T09, 56 km/h", "my-car-T09-56-km-h_seed-7_certification.csv")):
        files.offer(of, {"certification.csv": lambda: table})
        assert offered[name]() == csv_bytes(table) == b"id,value,lower\nA,24.9583,\n"


def page() -> None:
    """The section alone, for two approaches of which one has draws."""
    from crashfuse.testing import small_campaign
    from crashfuse.ui.kit.files import offer_pulses
    from tests.ui.test_files import estimates

    offer_pulses(small_campaign(), estimates(small_campaign()), "fused", 0, ["Test T1 was left out."])


def estimates(campaign: Campaign) -> list[Estimate]:
    """The first test's pulse twice."""
    condition, accel = campaign.tests[0].condition, campaign.tests[0].pulse.accel_mps2
    draws = accel * np.linspace(0.9, 1.1, 7)[:, None]
    return [Estimate(condition, accel, approach="cae"), Estimate(condition, accel, draws, approach="fused")]


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, dict[str, str]]]:
    """Name and texts of each file that the page would hand out, anew at each run."""
    files: list[tuple[str, dict[str, str]]] = []

    def take(of: str, offered: dict[str, Callable[[], bytes]]) -> None:
        assert of == "Tiny"
        ((name, write),) = offered.items()
        with zipfile.ZipFile(io.BytesIO(write())) as archive:
            files.append((name, {each: archive.read(each).decode("latin-1") for each in archive.namelist()}))

    monkeypatch.setattr("crashfuse.ui.kit.files.offer", take)
    return files


def test_a_page_hands_out_curves_as_they_are_chosen(made: list[tuple[str, dict[str, str]]]) -> None:
    """The recommended approach first; units, sign, start, scale, id and draws as in the fields."""
    app = AppTest.from_function(page).run()
    assert not app.exception
    name, files = made[-1]
    assert name == "fused-15mph-lsdyna.zip"
    assert {*files} == {"fused_15mph_expected.k", "fused_15mph_representative.k"}
    assert "Units mm-ms-kg" in files["fused_15mph_expected.k"]
    assert "Test T1 was left out." in files["fused_15mph_expected.k"]
    app.selectbox(key="export units").set_value("mm-s-t")
    app.button_group(key="export sign").set_value("positive")
    for name, value in {"start": 10.0, "scale": 0.5, "id": 42, "draws of 7": 3}.items():
        app.number_input(key=f"export {name}").set_value(value)
    app.run()
    assert not app.exception
    name, files = made[-1]
    assert len(files) == 5
    for text in files.values():
        for said in ("Units mm-s-t", "Braking is positive.", "Contact is at 0.01 s", "scaled by 0.5"):
            assert said in text
        assert "-0.000000000000E+00" not in text
    assert len({text.partition("lcint\n")[2][:10] for text in files.values()}) == 5
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
