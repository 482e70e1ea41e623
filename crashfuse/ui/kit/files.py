"""Files that a page offers: their names and captions, the form of a report, pulses for an occupant model."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from hashlib import sha256
from typing import Any, Literal, NamedTuple

import pandas as pd
import streamlit as st

from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.errors import UsageError
from crashfuse.files.archive import zipped
from crashfuse.files.csv_text import csv_bytes
from crashfuse.results.display import Display
from crashfuse.results.export.outgoing_pulses import LOCATION, PULSE_FORMATS, PulseExport, PulseFormat
from crashfuse.results.export.solver_curves import LATEST_S, MOST_ID, SOLVERS, UNIT_SYSTEMS, SolverCurve
from crashfuse.results.figures import LEFT_OUT
from crashfuse.results.files import REPORT
from crashfuse.results.render.figure_files import figure_files, hyphened, missing_for
from crashfuse.results.render.html import REPORT_FORMS, ReportForm, ReportOptions, report
from crashfuse.results.result import Result
from crashfuse.study.estimate import Estimate
from crashfuse.ui.kit import address, campaigns
from crashfuse.ui.kit.address import kept, page_config
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.editing import notes_of
from crashfuse.ui.kit.navigation import component
from crashfuse.ui.kit.text import chosen_units, plain
from crashfuse.units import MS, SYSTEMS

_EXPORTED = "view whose files are shown"  # session key
_LONGEST_NAME, _DIGEST = 130, 6
_QUESTION = ("criteria", "matrix", "planned", "uploaded", "confidence", "cost_test", "cost_wrong", "earlier")
_SETTINGS = {"leave_out": "{} left out", "preset": "{} settings", "seed": "seed {}", "approach": "{}"}
_LOOK = {"sign": "{}", "system": "{}", "pins": "pins {}"}
_LOOK |= {f"{page}_also": "with {}" for page in ("compare", "predict")}
_LOOK |= {f"{page}_nearest": "with nearest" for page in ("compare", "predict")}
"""What names of files say of choices that are not as usual, and, of figures alone, how they are shown."""
_PULSE_LABELS = {name: SOLVERS[name].label if name in SOLVERS else "ISO-MME" for name in PULSE_FORMATS}


class Caption(NamedTuple):
    """Name of a figure's files, without its ending, and the lines above its picture."""

    name: str
    title: str
    details: str


def caption(title: str, drawn: str = "") -> Caption:
    """The caption of a figure, named by what is ``drawn``, else its title."""
    page, state = address.here().page, st.session_state
    if (page == "data" and state.get("import")) or not state.get("campaign"):  # of any campaign, or of none
        return Caption(file_name(drawn or title), title, "")
    campaign, config, names, details = campaigns.load(state["campaign"]), page_config(), [drawn or title], list[str]()
    display = Display(float(state["window"]), state["unit"], system=SYSTEMS[state["system"]])
    if page in ("train", "compare"):  # whose figures are of the held-out test
        test = campaign.test(state["test"])
        names.insert(0, test.id)
        details.append(f"Test {test.id} at {display.condition(test.condition)}")
    details.append(campaign.name)
    if address.acts("window", page):
        names.append(display.in_names[0])
        details.append(f"Rated time window 0–{display.window_ms:g} ms")
    if address.acts("unit", page):
        names.append(display.in_names[1])
    if page == "certify":
        details += [f"{LABELS[state['approach']]} judged", f"Confidence {state['confidence']:.6g}"]
    if page != "data":
        details.append(f"{config.preset.capitalize()} settings, seed {config.seed}")
    if address.acts("leave_out", page) and config.leave_out == "speed group":
        details.append(LEFT_OUT["speed group"].capitalize())
    details += [f"{test} left out of use" for test, _ in campaign.unused]
    if campaign.notice:
        details.append(campaign.notice_label)
    names += [*unusual_settings(), *_chosen(_LOOK), *(f"without {test}" for test, _ in campaign.unused)]
    return Caption(file_name(campaign.name, *names), title, " · ".join(details))


def unusual_settings() -> list[str]:
    """How the settings of the open page differ from the usual ones, for names of files."""
    if address.here().page == "data":
        return []
    chosen = address.parameters(address.here().page)
    question = {key: texts for key, texts in sorted(chosen.items()) if key in _QUESTION}
    return [*_chosen(_SETTINGS), *([_digest(repr(question))] if question else [])]


def _chosen(words: Mapping[str, str]) -> list[str]:
    chosen = address.parameters(address.here().page)
    return [said.format(" ".join(chosen[key])) for key, said in words.items() if key in chosen]


def file_name(*parts: str) -> str:
    """Name of files, safe on any disk; a long one is cut, and still unique."""
    whole = "_".join(filter(None, (hyphened(part, "_.-").strip("-._") for part in parts)))
    return whole if len(whole) <= _LONGEST_NAME else f"{whole[: _LONGEST_NAME - _DIGEST - 1]}-{_digest(whole)}"


def _digest(text: str) -> str:
    return sha256(text.encode()).hexdigest()[:_DIGEST]


def export_button(show: Callable[[], None]) -> None:
    """Button of a dialog, in which ``show`` draws what can be downloaded."""
    place, state = address.here(), st.session_state

    def show_and_listen() -> None:
        show()
        component("closing")(key="closing")

    st.button("Export", icon=":material/download:", key="export", on_click=lambda: state.update({_EXPORTED: place}))
    if state.get(_EXPORTED) == place:
        st.dialog("Export", width="large", on_dismiss=lambda: state.pop(_EXPORTED, None))(show_and_listen)()
    else:
        state.pop(_EXPORTED, None)


def offer(of: str, files: Mapping[str, Callable[[], pd.DataFrame | bytes | str]], form: str = "") -> None:
    """Buttons that download files, named by what they are ``of``, and reports, also as slides, by their form."""
    with st.container(horizontal=True):
        for name, make in files.items():
            is_report = name.endswith(".html")
            _offer(name, partial(_content, make), f"{of} {form}" if is_report else of)
            if is_report and not missing_for(("pptx",)):
                _offer(f"{name.removesuffix('.html')}.pptx", partial(_slides, make), f"{of} {form}")


def offer_result(result: Result, display: Display, of: str = "", form: str = "", *, with_report: bool = True) -> None:
    """Offer the files, report and slides of a result, named by what they are ``of``."""
    files: dict[str, Callable[[], Any]] = dict(result.files_in(display.system))
    if with_report:
        files[REPORT] = lambda: report(result, display)
    campaign = "" if result.campaign is None else result.campaign.name
    offer(of or f"{campaign} {result.kind}", files, form)


def _offer(name: str, content: Callable[[], bytes], of: str) -> None:
    file = f"{file_name(of, *unusual_settings())}_{name}" if of.strip() else name
    st.download_button(name, content, file_name=file, icon=":material/download:", on_click="ignore")


def _content(make: Callable[[], pd.DataFrame | bytes | str]) -> bytes:
    made = make()
    if isinstance(made, pd.DataFrame):
        return csv_bytes(made)
    return made.encode() if isinstance(made, str) else made


def _slides(make: Callable[[], Any]) -> bytes:
    return figure_files(make().contents, ("pptx",))["figures.pptx"]


def choose_form(short: str, whole: str) -> ReportForm:
    """Ask for the form of the report."""
    tip = f"Short: two or three pages with {short}. Whole: {whole}, too."
    look = {"default": "whole", "required": True, "format_func": str.capitalize, "help": tip}
    form: ReportForm = st.segmented_control("Report", REPORT_FORMS, **kept("report form", **look))
    return form


def choose_report(view: View, tests: Sequence[str]) -> ReportOptions:
    """Ask for the form of the report, and which tests it shows one by one."""
    with st.container(horizontal=True, vertical_alignment="bottom"):
        short = "the recommendation, all ratings and the worst test"
        form = choose_form(short, "each test, the data, the method and its settings")
        shown: Sequence[str] = ()
        if len(tests) > 1:
            usual = "all tests" if form == "whole" else "the worst"
            look = kept(f"report tests of {view.name}", placeholder=usual)
            shown = st.multiselect("Tests shown one by one", tests, **look)
    return ReportOptions(form, tuple(test for test in tests if test in shown), notes_of(view))


def offer_pulses(
    campaign: Campaign, estimates: Sequence[Estimate], recommended: str, seed: int, remarks: Sequence[str] = ()
) -> None:
    """Ask which pulses go out and how; remarks go into the files."""
    with st.expander("Pulse for an occupant model", icon=":material/airline_seat_recline_normal:"):
        st.markdown("The expected pulse, a representative one, and draws: a file each.")
        formats, label = PULSE_FORMATS[1:] + PULSE_FORMATS[:1], _PULSE_LABELS.__getitem__
        look = {"default": "lsdyna", "required": True, "format_func": label}
        form: PulseFormat = st.segmented_control("Format", formats, **kept("export format", **look))
        left, right = st.columns(2)
        names = [estimate.approach for estimate in estimates]
        place = names.index(recommended) if recommended in names else 0
        approach = left.selectbox("Approach", names, place, format_func=LABELS.__getitem__, key="export approach")
        estimate = estimates[names.index(approach)]
        draws = 0
        if (drawn := estimate.draws_mps2) is not None:
            draws = right.number_input("Draws", 0, len(drawn), 0, **kept(f"export draws of {len(drawn)}"))
        try:
            location, curve = LOCATION, None if form == "isomme" else _curve()
            if curve is None:
                location = st.text_input("Location code", LOCATION, max_chars=12, **kept("export location")).upper()
            export = PulseExport((form,), draws, seed, location, curve)
        except UsageError as error:
            st.warning(plain(error), icon=":material/warning:")
            return
        files = f"{approach}-{estimate.condition.speed_name}-{form}.zip"
        offer(campaign.name, {files: lambda: zipped(export.files(campaign, [estimate], remarks, chosen_units())[form])})


def _curve() -> SolverCurve:
    left, middle, right = st.columns(3)
    system = left.selectbox("Unit system", list(UNIT_SYSTEMS), **kept("export units"))
    signs: list[Literal["negative", "positive"]] = ["negative", "positive"]
    sign = middle.segmented_control("Braking is", signs, **kept("export sign", default=signs[0], required=True))
    number = right.number_input("Curve id", 1, MOST_ID, 1, **kept("export id"))
    left, middle, _ = st.columns(3)
    exact = {"format": "%.6g"}
    start_ms = left.number_input("Contact at (ms)", 0.0, LATEST_S / MS, 0.0, 1.0, **kept("export start", **exact))
    scale = middle.number_input("Scale", 0.001, 1000.0, 1.0, 0.05, **kept("export scale", **exact))
    units = UNIT_SYSTEMS[system]
    st.caption(f"Time in {units.time}, acceleration in {units.acceleration}.")
    return SolverCurve(system, sign or signs[0], start_ms * MS, scale, number)
