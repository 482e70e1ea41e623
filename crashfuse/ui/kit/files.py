"""Files that a page offers: their names and captions, the form of a report, pulses for an occupant model."""

import re
from collections.abc import Callable, Sequence
from hashlib import sha256
from typing import Literal, NamedTuple

import pandas as pd
import streamlit as st

from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.errors import UsageError
from crashfuse.files.archive import zipped
from crashfuse.files.csv_text import csv_bytes
from crashfuse.reporting.figure_files import figure_files, figures_of, missing_for
from crashfuse.reporting.figures import LEFT_OUT, RUN, Further
from crashfuse.reporting.outgoing_pulses import LOCATION, PULSE_FORMATS, PulseExport, PulseFormat
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.report.page import REPORT_FORMS, ReportForm, ReportOptions
from crashfuse.reporting.solver_curves import LATEST_S, MOST_ID, SOLVERS, UNIT_SYSTEMS, SolverCurve
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.ui.kit import address, campaigns
from crashfuse.ui.kit.address import page_config
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.editing import notes_of
from crashfuse.ui.kit.navigation import component
from crashfuse.ui.kit.text import plain
from crashfuse.units import MS, SYSTEMS

_EXPORTED = "view whose files are shown"  # session key
_LONGEST_NAME, _DIGEST = 130, 6
_QUESTION = ("criteria", "matrix", "planned", "uploaded", "confidence", "cost_test", "cost_wrong", "earlier")
_OF_TEST = ("train", "compare")  # pages whose figures are of the held-out test
_WITH_SETTINGS = ("train", "compare", "study", "predict", "certify")
_HOLDS = {
    "archive.cfa": "What past vehicles teach, for any campaign folder; no pulse.",
    "certification.csv": "Every verdict.",
    "track_record.csv": "Verdicts on left-out tests, and what they measured.",
    "credibility.csv": "The factors of ASME V&V 40, with what the data say.",
    "criteria.toml": "The criteria, for the campaign folder.",
    "matrix.csv": "The planned tests, for the campaign folder.",
    "certification.json": "All of it, to hold a later one against it.",
    "learning_curve.csv": "Mean ratings by number of tests.",
    "metrics.csv": "Pulse metrics with 95 % intervals.",
    "models.zip": "Unpack it for crashfuse predict --models.",
    "next_tests.csv": "Every candidate and its gain.",
    "pulses.csv": "Predicted pulses with both bands.",
    "scores.csv": "Ratings by test, approach and window.",
    "side_by_side.csv": "Metrics of this prediction and others.",
    "speed_groups.csv": "As scores.csv, with speed groups left out.",
}
_PULSE_LABELS = {name: SOLVERS[name].label if name in SOLVERS else "ISO-MME" for name in PULSE_FORMATS}


class Caption(NamedTuple):
    """Name of a figure's files, without its ending, and the lines above its picture."""

    name: str
    title: str
    details: str


def caption(alt: str, drawn: str = "", beside: Sequence[Further] = ()) -> Caption:
    """The caption of a figure, named by what is ``drawn``, else the alternative text."""
    page, title, state = address.here().page, alt.partition(";")[0], st.session_state
    names, details = [drawn or title], list[str]()
    if (page == "data" and state.get("import")) or not state.get("campaign"):  # of any campaign, or of none
        return Caption(file_name(*names), title, "")
    campaign = campaigns.load(state["campaign"])
    display = Display(float(state["window"]), state["unit"], system=SYSTEMS[state["system"]])
    unused, config = [test for test, _ in campaign.unused], page_config()
    if page in _OF_TEST:
        test = campaign.test(state["test"])
        names.insert(0, test.id)
        details.append(f"Test {test.id} at {display.condition(test.condition)}")
    details.append(campaign.name)
    if address.acts("window", page):
        names.append(display.in_names[0])
        details.append(f"Rated time window 0–{display.window_ms:g} ms")
    if address.acts("unit", page):
        names.append(display.in_names[1])
    if address.acts("sign", page) and state["sign"] != address.CHOICES["sign"].default:
        names.append(state["sign"])
    if display.system != campaign.units:
        names.append(state["system"])
    names += [*unusual_settings(), *(f"without {test}" for test in unused)]
    if beside:
        texts = (curve.removeprefix(RUN) if isinstance(curve, str) else curve.text for curve in beside)
        names.append(f"with {' '.join(texts)}")
    if page == "certify":
        details += [f"{LABELS[state['approach']]} judged", f"Confidence {state['confidence']:.6g}"]
    if page in _WITH_SETTINGS:
        details += [f"{config.preset.capitalize()} settings, seed {config.seed}", *map(str.capitalize, _left_out(page))]
    details += [f"{test} left out of use" for test in unused]
    if campaign.notice:
        details.append(campaign.notice_label)
    return Caption(file_name(campaign.name, *names), title, " · ".join(details))


def unusual_settings() -> list[str]:
    """How the settings of the open page differ from the usual ones, for names of files."""
    page, config, usual = address.here().page, page_config(), StudyConfig()
    if page not in _WITH_SETTINGS:
        return []
    said = _left_out(page)
    if page == "certify":
        chosen = address.parameters("certify")
        said += [LABELS[approach] for approach in chosen.get("approach", [])]
        asked = {key: texts for key, texts in sorted(chosen.items()) if key in _QUESTION}
        said += [_digest(repr(asked))] if asked else []
    said += [f"{config.preset} settings"] if config.preset != usual.preset else []
    return [*said, *([f"seed {config.seed}"] if config.seed != usual.seed else [])]


def file_name(*parts: str) -> str:
    """Name of files, safe on any disk; a long one is cut, and still unique."""
    safe = (re.sub(r"[^\w.-]+", "-", part, flags=re.ASCII).strip("-._") for part in parts)
    whole = "_".join(filter(None, safe))
    return whole if len(whole) <= _LONGEST_NAME else f"{whole[: _LONGEST_NAME - _DIGEST - 1]}-{_digest(whole)}"


def _digest(text: str) -> str:
    return sha256(text.encode()).hexdigest()[:_DIGEST]


def _left_out(page: str) -> list[str]:
    left_out = page_config().leave_out
    return [LEFT_OUT[left_out]] if page in _OF_TEST and left_out == "speed group" else []


def export_button(show: Callable[[], None]) -> None:
    """Button of a dialog, in which ``show`` draws what can be downloaded; it outlasts a redrawn page."""
    place, state = address.here(), st.session_state

    def show_and_listen() -> None:
        show()
        component("closing")(key="closing")

    st.button("Export", icon=":material/download:", key="export", on_click=lambda: state.update({_EXPORTED: place}))
    if state.get(_EXPORTED) == place:
        st.dialog("Export", width="large", on_dismiss=lambda: state.pop(_EXPORTED, None))(show_and_listen)()
    else:
        state.pop(_EXPORTED, None)


def download_table(name: str, table: Callable[[], pd.DataFrame], of: str = "") -> None:
    """Button that downloads a CSV as the command line writes it; its name begins with what it is ``of``."""
    download_bytes(name, lambda: csv_bytes(table()), of, mime="text/csv")


def download_report(write: Callable[[], str], of: str, name: str = "report.html") -> None:
    """Buttons that download a report and, if that can be, its figures as slides."""
    st.download_button(
        name, lambda: write().encode(), file_name=_named(name, of), mime="text/html", icon=":material/description:",
        on_click="ignore", help="One file, opens without a network.",
    )  # fmt: skip
    if not missing_for(("pptx",)):
        slides = f"{name.removesuffix('.html')}.pptx"
        download_bytes(slides, lambda: figure_files(figures_of(write()), ("pptx",))["figures.pptx"], of)


def download_bytes(name: str, write: Callable[[], bytes], of: str = "", mime: str | None = None) -> None:
    """Button that downloads a file of any kind, and says what a known one holds."""
    slides = "The answer, then one figure a slide." if name.endswith(".pptx") else None
    st.download_button(
        name, write, file_name=_named(name, of), mime=mime, icon=":material/download:", on_click="ignore",
        help=_HOLDS.get(name, slides),
    )  # fmt: skip


def _named(name: str, of: str) -> str:
    return f"{file_name(of, *unusual_settings())}_{name}" if of else name


def choose_form(short: str, whole: str) -> ReportForm:
    """Ask for the form of the report, and tell what it then has."""
    form: ReportForm = st.segmented_control(
        "Report", REPORT_FORMS, default="whole", required=True, key="report form", persist_state="session",
        format_func=str.capitalize, help=f"Short: two or three pages with {short}. Whole: {whole}, too.",
    )  # fmt: skip
    return form


def choose_report(view: View, tests: Sequence[str]) -> ReportOptions:
    """Ask for the form of the report, and which tests it shows one by one."""
    with st.container(horizontal=True, vertical_alignment="bottom"):
        form = choose_form(
            "the recommendation, all ratings and the worst test", "each test, the data, the method and its settings"
        )
        shown: Sequence[str] = ()
        if len(tests) > 1:
            shown = st.multiselect(
                "Tests shown one by one", tests, key=f"report tests of {view.name}", persist_state="session",
                placeholder="all tests" if form == "whole" else "the worst", help="Means are over all tests.",
            )  # fmt: skip
    return ReportOptions(form, tuple(test for test in tests if test in shown), notes_of(view))


def offer_pulses(
    campaign: Campaign, estimates: Sequence[Estimate], recommended: str, seed: int, remarks: Sequence[str] = ()
) -> None:
    """Ask which pulses go out and how; remarks go into the files."""
    with st.expander("Pulse for an occupant model", icon=":material/airline_seat_recline_normal:"):
        st.markdown("The expected pulse, a representative one, and draws: a file each.")
        form: PulseFormat = st.segmented_control(
            "Format", PULSE_FORMATS[1:] + PULSE_FORMATS[:1], default="lsdyna", required=True,
            format_func=_PULSE_LABELS.__getitem__, key="export format", persist_state="session",
        )  # fmt: skip
        left, right = st.columns(2)
        names = [estimate.approach for estimate in estimates]
        approach = left.selectbox(
            "Approach", names, index=names.index(recommended) if recommended in names else 0,
            format_func=LABELS.__getitem__, key="export approach",
        )  # fmt: skip
        estimate = estimates[names.index(approach)]
        draws = 0
        if (drawn := estimate.prediction.draws_mps2) is not None:
            draws = right.number_input(
                "Draws", 0, len(drawn), 0, key=f"export draws of {len(drawn)}", persist_state="session",
                help="Pulses drawn from the band, all equally likely.",
            )  # fmt: skip
        try:
            location, curve = (_location(), None) if form == "isomme" else (LOCATION, _curve())
            export = PulseExport((form,), draws, seed, location, curve)
        except UsageError as error:
            st.warning(plain(error), icon=":material/warning:")
            return
        files = f"{approach}-{estimate.prediction.condition.speed_name}-{form}.zip"
        download_bytes(files, lambda: zipped(export.files(campaign, [estimate], remarks)[form]), campaign.name)


def _location() -> str:
    return st.text_input(
        "Location code", LOCATION, max_chars=12, key="export location", persist_state="session",
        help="The first 12 characters of the channel codes.",
    ).upper()  # fmt: skip


def _curve() -> SolverCurve:
    left, middle, right = st.columns(3)
    system = left.selectbox(
        "Unit system", list(UNIT_SYSTEMS), key="export units", persist_state="session",
        help="Of the occupant model: length, time, mass.",
    )  # fmt: skip
    sign: Literal["negative", "positive"] = middle.segmented_control(
        "Braking is", ["negative", "positive"], default="negative", required=True, key="export sign",
        persist_state="session",
    )  # fmt: skip
    number = right.number_input(
        "Curve id", 1, MOST_ID, 1, key="export id", persist_state="session",
        help="Of the first curve; the others count on.",
    )  # fmt: skip
    left, middle, _ = st.columns(3)
    start_ms = left.number_input(
        "Contact at (ms)", 0.0, LATEST_S / MS, 0.0, step=1.0, format="%.6g", key="export start",
        persist_state="session", help="In the occupant model's time; zero before.",
    )  # fmt: skip
    scale = middle.number_input(
        "Scale", 0.001, 1000.0, 1.0, step=0.05, format="%.6g", key="export scale", persist_state="session",
        help="Factor on the accelerations.",
    )  # fmt: skip
    units = UNIT_SYSTEMS[system]
    st.caption(f"Time in {units.time}, acceleration in {units.acceleration}.")
    return SolverCurve(system, sign, start_ms * MS, scale, number)
