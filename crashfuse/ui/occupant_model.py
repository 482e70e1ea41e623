"""Choice of the pulse that goes to an occupant model, and its download."""

from collections.abc import Sequence
from typing import Literal

import streamlit as st

from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.errors import UsageError
from crashfuse.files.archive import zipped
from crashfuse.reporting.outgoing_pulses import LOCATION, PULSE_FORMATS, PulseExport, PulseFormat
from crashfuse.reporting.solver_curves import LATEST_S, MOST_ID, SOLVERS, UNIT_SYSTEMS, SolverCurve
from crashfuse.study.estimate import Estimate
from crashfuse.ui.downloads import download_bytes
from crashfuse.ui.text import plain
from crashfuse.units import MS

_HELP = (
    "Whole pulses drawn from the band, all equally likely: run the occupant model with each to see how much of the "
    "band reaches the occupant. The edges of the band are no pulses and do not go out."
)
_LABELS = {name: SOLVERS[name].label if name in SOLVERS else "ISO-MME" for name in PULSE_FORMATS}


def offer_pulses(
    campaign: Campaign, estimates: Sequence[Estimate], recommended: str, seed: int, remarks: Sequence[str] = ()
) -> None:
    """Ask which pulses go out and how, in a collapsed section with a download button; remarks go into the files."""
    with st.expander("Pulse for an occupant model", icon=":material/airline_seat_recline_normal:"):
        st.markdown("The expected pulse, and whole draws from its band: an include file each, or an ISO-MME test each.")
        form: PulseFormat = st.segmented_control(
            "Format", PULSE_FORMATS[1:] + PULSE_FORMATS[:1], default="lsdyna", required=True,
            format_func=_LABELS.__getitem__, key="export format", persist_state="session",
        )  # fmt: skip
        left, right = st.columns(2)
        names = [estimate.approach for estimate in estimates]
        approach = left.selectbox(
            "Approach", names, index=names.index(recommended) if recommended in names else 0,
            format_func=LABELS.__getitem__, key="export approach",
        )  # fmt: skip
        estimate = estimates[names.index(approach)]
        drawn = estimate.prediction.draws_mps2
        draws = 0
        if drawn is not None:
            draws = right.number_input(
                "Draws", 0, len(drawn), 0, key=f"export draws of {len(drawn)}", persist_state="session", help=_HELP
            )
        try:
            if form == "isomme":
                export = PulseExport((form,), draws, seed, location=_location())
            else:
                export = PulseExport((form,), draws, seed, curve=_curve())
        except UsageError as error:
            st.warning(plain(error), icon=":material/warning:")
            return
        files = f"{approach}-{estimate.prediction.condition.speed_name}-{form}.zip"
        download_bytes(files, lambda: zipped(export.files(campaign, [estimate], remarks)[form]), campaign.name)


def _location() -> str:
    return st.text_input(
        "Location code", LOCATION, max_chars=12, key="export location", persist_state="session",
        help="The first 12 characters of the channel codes: test object, position, main location, three fine "
        "locations. AC, VE and DV, the direction X and the filter class follow.",
    ).upper()  # fmt: skip


def _curve() -> SolverCurve:
    """The curve's settings, all of which the file states, too."""
    left, middle, right = st.columns(3)
    system = left.selectbox(
        "Unit system", list(UNIT_SYSTEMS), key="export units", persist_state="session",
        help="Of the occupant model: length, time, mass. The time and acceleration of the curve are in these units.",
    )  # fmt: skip
    sign: Literal["negative", "positive"] = middle.segmented_control(
        "Braking is", ["negative", "positive"], default="negative", required=True, key="export sign",
        persist_state="session",
    )  # fmt: skip
    number = right.number_input(
        "Curve id", 1, MOST_ID, 1, key="export id", persist_state="session",
        help="Of the first curve. Draws count on from it, so that all curves fit into one model.",
    )  # fmt: skip
    left, middle, _ = st.columns(3)
    start_ms = left.number_input(
        "Contact at (ms)", 0.0, LATEST_S / MS, 0.0, step=1.0, format="%.6g",
        key="export start", persist_state="session",
        help="In the time of the occupant model; before it the curve is zero.",
    )  # fmt: skip
    scale = middle.number_input(
        "Scale", 0.001, 1000.0, 1.0, step=0.05, format="%.6g", key="export scale", persist_state="session",
        help="Factor on the accelerations.",
    )  # fmt: skip
    units = UNIT_SYSTEMS[system]
    st.caption(f"Time in {units.time}, acceleration in {units.acceleration}.")
    return SolverCurve(system, sign, start_ms * MS, scale, number)
