"""What a figure shows, for where its page does not say it: the name of its files, and the lines above its picture."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256

import plotly.graph_objects as go
import streamlit as st

from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.reporting.earlier_prediction import LEFT_OUT
from crashfuse.reporting.figures import RUN, Further
from crashfuse.reporting.plots.display import Display
from crashfuse.study.config import StudyConfig
from crashfuse.ui import address, campaigns
from crashfuse.ui.computation import chosen_config
from crashfuse.wording import IN_SI, SYSTEMS

_LONGEST_NAME, _DIGEST = 130, 6
_QUESTION = ("criteria", "matrix", "uploaded", "confidence", "earlier", "speeds", "front_weights", "rear_weights")
_WITH_SETTINGS = ("train", "compare", "study", "predict", "certify")


@dataclass(frozen=True)
class Caption:
    """Name of a figure's files, without its ending, and the lines above its picture."""

    name: str
    title: str
    details: str


def caption(figure: go.Figure, alt: str, drawn: str = "", beside: Sequence[Further] = ()) -> Caption:
    """The caption of a figure on the open page.

    Parameters
    ----------
    alt : str
        Its alternative text; as far as the first semicolon it is the title.
    drawn : str
        What is drawn, in few words for the name; by default the title.
    beside : sequence of str, PredictedPulse or EarlierPrediction
        What was put beside: tests, CAE runs, other predictions.
    """
    page, title = address.here().page, alt.partition(";")[0]
    campaign = _campaign(page)
    if campaign is None:
        return Caption(file_name(drawn or title), title, "")
    state, unused = st.session_state, [test for test, _ in campaign.unused]
    display = Display(float(state["window"]), state["unit"], system=SYSTEMS[state["system"]])
    names, details = [campaign.name, drawn or title], [campaign.name]
    if page == "compare":
        test = campaign.test(state["test"])
        names.insert(1, test.id)
        details.insert(0, f"Test {test.id} at {display.condition(test.condition)}")
    if address.acts("window", page):
        names.append(display.in_names[0])
        details.append(f"Rated time window 0–{display.window_ms:g} ms")
    names += [*_units(figure, display, campaign), *settings(), *(f"without {test}" for test in unused)]
    if beside:
        names.append(f"with {' '.join(map(_briefly, beside))}")
    if page == "certify":
        details += [f"{LABELS[state['approach']]} judged", f"Confidence {state['confidence']:.6g}"]
    if page in _WITH_SETTINGS:
        config = chosen_config()
        details += [f"{config.preset.capitalize()} settings, seed {config.seed}", *map(str.capitalize, _left_out(page))]
    details += [f"{test} left out of use" for test in unused]
    if campaign.notice:
        details.append(campaign.notice.partition(":")[0])
    return Caption(file_name(*names), title, " · ".join(details))


def settings() -> list[str]:
    """In what the results of the open page differ from those with the usual settings, in words for names of files."""
    page, config, usual = address.here().page, chosen_config(), StudyConfig()
    if page not in _WITH_SETTINGS:
        return []
    preset = [f"{config.preset} settings"] if config.preset != usual.preset else []
    question = _question() if page == "certify" else []
    return [*_left_out(page), *question, *preset, *([f"seed {config.seed}"] if config.seed != usual.seed else [])]


def file_name(*parts: str) -> str:
    """Name of files, without an ending: words, joined and safe on any disk; a long one is cut, and still its own."""
    safe = (re.sub(r"[^\w.-]+", "-", part, flags=re.ASCII).strip("-._") for part in parts)
    whole = "_".join(filter(None, safe))
    if len(whole) <= _LONGEST_NAME:
        return whole
    digest = sha256(whole.encode()).hexdigest()[:_DIGEST]
    return f"{whole[: _LONGEST_NAME - _DIGEST - 1]}-{digest}"


def _campaign(page: str) -> Campaign | None:
    """The open campaign; none of History, whose studies may be of any, nor of an import, whose files are of none."""
    state = st.session_state
    elsewhere = page == "history" or (page == "data" and state.get("import"))
    name = state.get("campaign")
    return campaigns.load(name) if name and not elsewhere else None


def _question() -> list[str]:
    """What is asked of a certification otherwise than usual: its approach, and a digest of all else."""
    chosen = address.parameters("certify")
    asked = {key: texts for key, texts in sorted(chosen.items()) if key in _QUESTION or key.startswith("grid_")}
    digest = sha256(repr(asked).encode()).hexdigest()[:_DIGEST]
    return [*(LABELS[approach] for approach in chosen.get("approach", [])), *([digest] if asked else [])]


def _left_out(page: str) -> list[str]:
    """Elsewhere than on Compare the figures themselves say what was left out, or all tests were learned from."""
    left_out = chosen_config().leave_out
    return [LEFT_OUT[left_out]] if page == "compare" and left_out == "speed group" else []


def _units(figure: go.Figure, display: Display, campaign: Campaign) -> list[str]:
    """What its axes are in: accelerations, with their sign, and speeds or weights, unless in the campaign's units."""
    state, usual = st.session_state, address.CHOICES["sign"].default
    titles = " ".join(axis.title.text or "" for axis in (*figure.select_xaxes(), *figure.select_yaxes()))
    shown = {unit for unit in IN_SI if re.search(rf"(^|[ (]){re.escape(unit)}($|[ )/])", titles)}
    said = []
    if display.unit in shown:
        said += [display.in_names[1], *([state["sign"]] if state["sign"] != usual else [])]
    if display.system != campaign.units and shown & {display.system.speed, display.system.weight}:
        said.append(state["system"])
    return said


def _briefly(beside: Further) -> str:
    return beside.removeprefix(RUN) if isinstance(beside, str) else beside.text
