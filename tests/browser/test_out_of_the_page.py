"""Out of the page in a real browser: the numbers of a figure, notes and marks, a report that fits on paper."""

import base64
import re
from pathlib import Path

import numpy as np
import pytest

from crashfuse.approaches.registry import APPROACHES
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.notes import Note
from crashfuse.results.plots.palette import IN_THE_DARK, PAPER
from crashfuse.results.render.html import ReportForm, ReportOptions
from crashfuse.results.study import study_report
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.study import Fold, Study
from crashfuse.units import G
from tests.browser.conftest import FIGURE, PAIRED, PILL, Server, User, press_tool, rows
from tests.conftest import ROOT

BANDED = ("time_domain", "displacement_domain", "fused")


@pytest.fixture(scope="module")
def sample_study() -> Study:
    """Eleven tests and five approaches."""
    campaign, config = load_campaign(ROOT / "sample_data"), StudyConfig()
    folds = []
    for test in campaign.tests:
        accel = 0.95 * test.pulse.accel_mps2
        draws, left_out = accel * np.linspace(0.9, 1.1, 50)[:, None], {test.id: accel}
        estimates = [
            Estimate(test.condition, accel, draws if name in BANDED else None, approach=name, left_out_mps2=left_out)
            for name in APPROACHES
        ]
        folds.append(Fold.of(test, estimates, config.windows_ms))
    return Study(campaign, config, tuple(folds))


def test_a_figure_is_saved_as_it_is_shown_and_notes_and_marks_go_onto_it_and_into_the_report(
    engineer: User, small_server: Server, campaign_on_disk: Path, tmp_path: Path, sample_study: Study
) -> None:
    """Always in the light, what it shows in lines above it, which wrap where it is narrow; numbers of visible curves.

    Notes are typed in beside the figure, kept in the campaign folder for the next session, and deleted again. Printed
    by Chromium, a report on the sample is short on three pages of A4, whole on about 25.
    """
    engineer.sits_at(480, 1000)
    engineer.prefers("dark")
    ground = f"return document.querySelector('{FIGURE}').layout.paper_bgcolor"
    engineer.wait(lambda: engineer.browser.execute_script(ground) == IN_THE_DARK[PAPER])
    press_tool(engineer, '[data-format="svg"]')
    saved = engineer.arrived("_T1_pulses-Displacement-domain-Test-CAE_0-60ms_g.svg").read_text(encoding="utf-8")
    dark = ["rgb({}, {}, {})".format(*bytes.fromhex(colour[1:])) for colour in IN_THE_DARK.values() if colour[0] == "#"]
    assert not [colour for colour in dark if colour in saved]
    lines = re.findall('<text x="12" y="([0-9.]+)"[^>]*>([^<]+)<', saved)
    assert " ".join(words for _, words in lines).startswith(
        "Acceleration, velocity and displacement over time: test T1"
    )
    assert "Fast settings, seed 0" in " ".join(words for _, words in lines)
    assert len({y for y, _ in lines}) == len(lines) > 2
    assert engineer.browser.execute_script(ground) == IN_THE_DARK[PAPER]
    engineer.prefers("light")
    engineer.sits_at(1440, 1000)
    engineer.press("Corridors", "label")
    engineer.sees("Corridor of the rating, inner", FIGURE)
    engineer.press_inside("Curves", "CAE", PILL)
    engineer.wait(lambda: "CAE" not in engineer.texts(f"{FIGURE} .legendtext"))
    saved_as = "_T1_pulses-with-corridors-Displacement-domain-Test_0-60ms_g"
    press_tool(engineer, '[data-format="csv"]')
    numbers = rows(engineer.arrived(f"{saved_as}.csv").read_text(encoding="utf-8"))
    shown = set(numbers[0])
    assert "Displacement domain: Velocity, upper (mph)" in shown
    assert any(name.startswith("Corridor of the rating, inner") for name in shown)
    assert not any(name.startswith("CAE:") for name in shown)
    measured = load_campaign(campaign_on_disk).test("T1").pulse.accel_mps2 / G
    drawn = [float(row["Test: Acceleration (g)"]) for row in numbers]
    np.testing.assert_allclose(drawn, measured, rtol=1e-5, atol=1e-5)
    for form, start in (("svg", b"<svg"), ("png", b"\x89PNG")):
        press_tool(engineer, f'[data-format="{form}"]')
        assert engineer.arrived(f"{saved_as}.{form}").read_bytes().startswith(start)
    saved = engineer.arrived(f"{saved_as}.svg").read_text(encoding="utf-8")
    assert "test T1 and its prediction by Displacement domain<" in saved  # not by CAE, which is hidden
    assert "@font-face" in saved  # which no other program has: without it, and without lengths, words would overlap
    assert len(re.findall("<(?:text|tspan)[^>]* textLength=", saved)) > 20
    engineer.press("Notes and marks", "summary")
    engineer.fill("Note", "<b>hump</b> comes early")
    engineer.fill("From (ms)", "25")
    engineer.fill("To (ms)", "20")
    engineer.press("Add")
    engineer.sees("its start before its end")  # what was typed in stays, to be corrected
    engineer.fill("To (ms)", "40")
    engineer.press("Add")
    engineer.sees("25–40 ms")
    engineer.sees("<b>hump</b> comes early", FIGURE)
    assert "<b>hump</b> comes early" in (campaign_on_disk / "notes.csv").read_text(encoding="utf-8")
    engineer.fill("Note", "nothing begins here")
    engineer.fill("To (ms)", "40")
    engineer.press("Add")
    engineer.sees("A mark that has an end needs a start.")
    link = {"campaign": "campaign", "test": "T1", "approaches": "cae"}
    engineer.open(small_server, "compare", **link)
    engineer.press("Export")
    report = engineer.downloads_file("report.html")
    assert "25–40 ms</td><td>&lt;b&gt;hump&lt;/b&gt; comes early</td>" in report
    assert re.findall(r"<td>(C\d\d)</td><td>(yes|no)</td>", report) == [(run, "yes") for run in PAIRED]
    assert "Outside the range of the CAE runs" not in report
    engineer.press("", '[data-testid="stDialog"] [aria-label="Close"]')
    engineer.sees("<b>hump</b> comes early", FIGURE)
    engineer.press("Notes and marks", "summary")
    engineer.presses_until(lambda: not (campaign_on_disk / "notes.csv").exists(), "Delete")
    engineer.presses_until(lambda: (campaign_on_disk / "notes.csv").exists(), "Put back")
    engineer.presses_until(lambda: not (campaign_on_disk / "notes.csv").exists(), "Delete")
    notes = (Note("T01", "Third hump comes early: check the record", 25.0, 40.0), Note("T02", "Barrier face replaced"))
    forms: dict[ReportForm, int] = {"short": 3, "whole": 26}
    for form, most in forms.items():
        path = tmp_path / f"{form}.html"
        path.write_text(study_report(sample_study, options=ReportOptions(form, notes=notes)), encoding="utf-8")
        engineer.browser.get(path.as_uri())
        engineer.wait(lambda: engineer.all(FIGURE))
        settings = {"preferCSSPageSize": True, "printBackground": True}
        printed = base64.b64decode(engineer.browser.execute_cdp_cmd("Page.printToPDF", settings)["data"])
        assert 2 <= len(re.findall(rb"/Type\s*/Page\b", printed)) <= most
