"""The pages say everything in the units that were chosen; the condition stays the same when they are switched."""

import re
import shutil
from pathlib import Path

import pandas as pd
import pytest

from crashfuse.units import KPH, LB, MPH
from tests.ui.conftest import Session, Visit

pytestmark = pytest.mark.usefixtures("open_campaign")


def fields(session: Session) -> dict[str, float]:
    return {field.label: float(field.value or 0.0) for field in session.app.number_input}


def read(session: Session) -> str:
    """All text and tables of a page, but for what it says of the units that files may be in."""
    words = "\n".join(line for line in session.words.splitlines() if "`_mph`" not in line)
    return "\n".join([words, *(table.to_csv() for table in session.tables)])


def test_a_page_is_in_the_units_that_were_chosen(visit: Visit) -> None:
    """Numbers, tables and the tests' labels; in mph and lb as long as neither user nor files say anything else."""
    usual, metric = (visit("data", data_tab="Conditions", **units) for units in ({}, {"system": "kph-kg"}))
    assert (usual.numbers["Test speeds"], metric.numbers["Test speeds"]) == ("15–35 mph", "24–56 km/h")
    assert not re.search(r"km/h|\bkg\b", read(usual))
    assert not re.search(r"\bmph\b|\blb\b", read(metric))
    assert "Front weight (lb)" in read(usual)
    assert "Front weight (kg)" in read(metric)
    assert "T1 · 24.1 km/h" in metric.app.sidebar.selectbox(key="test in kph-kg").options


@pytest.mark.slow
def test_planned_tests_are_round_in_the_readers_units_and_stay_when_these_are_switched(visit: Visit) -> None:
    """In whatever units the campaign is declared; what was typed keeps the units that it was typed in."""

    def speeds(session: Session) -> list[float]:
        return [float(row[1]) for row in session.rows("planned")]

    session = visit("certify", matrix="Typed in", system="kph-kg")
    assert speeds(session) == [30.0, 40.0, 50.0]
    session.app.sidebar.button_group(key="system").set_value("mph-lb")
    assert speeds(session.run()) == [15.0, 20.0, 25.0, 30.0, 35.0]
    assert not {"planned", "system"} & {*session.app.query_params}
    typed = visit("certify", matrix="Typed in", planned=["A~30~900~700~kph-kg"], system="mph-lb")
    assert speeds(typed) == pytest.approx([18.6411], abs=1e-4)
    assert typed.app.session_state["planned"] == ["A~30~900~700~kph-kg~"]  # without its factor


@pytest.mark.slow
@pytest.mark.parametrize("by_link", [True, False])
def test_units_that_were_chosen_are_kept_in_any_campaign(
    campaign_on_disk: Path, tmp_path: Path, visit: Visit, by_link: bool
) -> None:
    """Also after one whose own they are; a campaign decides as long as nobody has."""
    metric = tmp_path / "metric"
    shutil.copytree(campaign_on_disk, metric)
    in_metric(metric)
    session = visit("data", **({"system": "kph-kg"} if by_link else {}))
    if not by_link:
        session.open_folder(str(metric))
        assert session.numbers["Test speeds"] == "24–56 km/h"
        session.open_folder(str(campaign_on_disk))
        assert session.numbers["Test speeds"] == "15–35 mph"
        session.fill({"Units of speeds": "kph-kg"})
    for folder in (metric, campaign_on_disk):
        assert session.open_folder(str(folder)).numbers["Test speeds"] == "24–56 km/h"
    assert session.app.query_params["system"] == "kph-kg"


def in_metric(folder: Path) -> None:
    table = pd.read_csv(folder / "tests.csv")
    table["speed_kph"] = table.pop("speed_mph") * MPH / KPH
    for weight in ("front_weight", "rear_weight"):
        table[f"{weight}_kg"] = table.pop(f"{weight}_lb") * LB
    table.to_csv(folder / "tests.csv", index=False)


@pytest.mark.slow
def test_the_campaigns_files_decide_at_first(open_campaign: Path, visit: Visit) -> None:
    """A table of tests in km/h and kg is shown in these, and its link says nothing of units."""
    in_metric(open_campaign)
    session = visit("data")
    assert session.numbers["Test speeds"] == "24–56 km/h"
    assert "system" not in session.app.query_params
    session.app.sidebar.button_group(key="system").set_value("mph-lb")
    assert session.run().numbers["Test speeds"] == "15–35 mph"
    assert session.app.query_params["system"] == "mph-lb"


@pytest.mark.slow
@pytest.mark.parametrize(("system", "foreign"), [("mph-lb", r"km/h|\bkg\b"), ("kph-kg", r"\bmph\b|\blb\b")])
def test_results_are_in_the_units_that_were_chosen(visit: Visit, system: str, foreign: str) -> None:
    """Tests, recommendations, ratings, metrics, notes and the figures of Compare, Study and Predict."""
    for page, button, tabs in (
        ("compare", "Predict test T1", ("Pulses", "Ratings and metrics")),
        ("study", "Leave out each of 4 tests", ("Ratings", "Bands")),
        ("predict", "Predict", ("Pulses", "Metrics")),
    ):
        for tab in tabs:
            session = visit(page, system=system, approaches="cae", **{f"{page}_tab": tab})
            if button in session.buttons:
                session.press(button).finish()
            assert button not in session.buttons
            figures = [chart.proto.spec for chart in session.app.get("plotly_chart")]
            drawn = re.sub(r'"bdata":"[^"]*"', "", "\n".join(figures)).replace(r"\u002f", "/")
            assert not re.findall(f".*(?:{foreign}).*", read(session))
            assert not re.findall(f".{{40}}(?:{foreign})", drawn)
