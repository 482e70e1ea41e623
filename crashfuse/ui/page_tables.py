"""Tables of the pages, in the reader's terms and units; the numbers come from the library."""

from collections.abc import Mapping, Sequence

import pandas as pd
import streamlit as st
from pandas.io.formats.style import Styler

from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.reporting import rating_tables
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.plots.palette import GRADE_COLOURS
from crashfuse.reporting.rating_tables import REPEAT, best, rating_table
from crashfuse.signals.metrics import MAIN_METRICS, Metric
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.signals.rating import WEIGHTS, Rating, graded, rate_windows
from crashfuse.study.config import WINDOWS_MS
from crashfuse.study.next_test import NextTest, next_tests_table
from crashfuse.study.repeatability import Repeatability
from crashfuse.study.study import Study
from crashfuse.ui.look import fill
from crashfuse.ui.tables import literal
from crashfuse.wording import UnitSystem

TEST_COLUMN = "Test"
"""Heading of what was measured, beside the approaches."""
WAYS = {"test": "Each test left out alone", "speed group": "With all tests at about its speed"}
"""What is left out with a test, as a reader chooses it."""


def window_label(window_ms: float) -> str:
    """Label of a rated window."""
    return f"0–{window_ms:g} ms"


def conditions(campaign: Campaign, display: Display) -> Styler:
    """Every test with its condition, its paired CAE run, and the rating of the uncorrected run over each window."""
    return _coloured(_conditions(campaign.fingerprint, display.system, campaign))


@st.cache_data(show_spinner=False, max_entries=4)
def _conditions(fingerprint: str, system: UnitSystem, _campaign: Campaign) -> pd.DataFrame:  # noqa: ARG001 - the key
    campaign, display = _campaign, Display(system=system)
    rows = []
    for test in campaign.tests:
        condition, run = test.condition, campaign.cae.paired_run(test.condition)
        (of_speed, speed), *weights = display.columns(condition).items()
        row: dict[str, str] = {"Test": test.id, of_speed: speed}
        # the most important first: the rest may be cut off on a narrow page
        by_window: dict[float, Rating] = {}
        if run is not None:
            pulse = Pulse(GRID_S, campaign.cae.accel_mps2[run])
            by_window = rate_windows(test.pulse, pulse, WINDOWS_MS)
        row |= {window_label(w): graded(by_window[w].overall) if w in by_window else "–" for w in WINDOWS_MS}
        row["In CAE range"] = "no" if campaign.cae.extrapolation(condition) else "yes"
        row |= {
            **dict(weights),
            **{name.capitalize(): value for name, value in condition.factors},
            "Paired run": "none" if run is None else campaign.cae.ids[run],
        }
        rows.append(row)
    return pd.DataFrame(rows).fillna("–")


def ratings(
    by_approach: Mapping[str, Mapping[float, Rating]],
    window_ms: float,
    repeats: Mapping[float, Repeatability],
    draws: Mapping[str, tuple[float, float]],
) -> Styler:
    """Overall rating with its grade by approach and window, and the four parts of the rating over one window.

    In place of an approach there may be the name of another prediction of the test. The last column is the interval of
    the ratings of single draws, for the approaches with a band; the last row is what a repeat of the test would rate,
    if it is known.
    """
    table = pd.DataFrame(
        {
            "Approach": LABELS.get(name, name),
            **{window_label(w): graded(rating.overall) for w, rating in by_window.items()},
            **{part.capitalize(): f"{getattr(by_window[window_ms], part):.3f}" for part in WEIGHTS},
            "Single draws": "–".join(f"{end:.3f}" for end in draws.get(name, ())) or "–",
        }
        for name, by_window in by_approach.items()
    )
    if repeats:
        repeat = {window_label(w): graded(own.value) for w, own in repeats.items()}
        table = pd.concat([table, pd.DataFrame([{"Approach": REPEAT, **repeat}])], ignore_index=True).fillna("–")
    return _coloured(table)


def mean_ratings(study: Study) -> Styler:
    """Overall rating averaged over the held-out tests, by approach and window; below, what repeats would rate."""
    return _coloured(rating_tables.mean_ratings(study))


def paper_table(study: Study, rows: Mapping[str, str]) -> Styler:
    """Ratings by test, approach and window in the form of the paper's tables, best in bold."""
    table = rating_table(study, rows)
    bold = best(table).reset_index(drop=True).map(lambda is_best: "font-weight: 700" if is_best else "")
    shown = table.map("{:.3f}".format, na_action="ignore").fillna("–").reset_index()
    marks = bold.reindex(columns=shown.columns, fill_value="").to_numpy()
    shown["Test"] = shown["Test"].where(~shown["Test"].duplicated(), "")  # each named once, as in the paper
    return literal(shown).apply(lambda _: marks, axis=None)


def metrics(
    columns: Sequence[tuple[str, Sequence[Metric]]], campaign: Campaign, display: Display
) -> tuple[Styler, Styler]:
    """Pulse metrics, the main ones and the others, one column each for the test and every approach, with intervals.

    Those that do not hold what the test measured are coloured.
    """
    headings = campaign.metric_headings
    shown = {heading: {metric.name: display.metric(metric) for metric in own} for heading, own in columns}
    rows = [
        {"Pulse metric": display.heading(label), **{heading: own[name].text for heading, own in shown.items()}}
        for name, label in headings.items()
    ]
    main = [name in MAIN_METRICS for name in headings]
    table, missed = pd.DataFrame(rows), fill(GRADE_COLOURS["Fair"])
    css = pd.DataFrame("", table.index, table.columns)
    for heading, names in missed_by(columns).items():
        css.loc[[name in names for name in headings], heading] = missed
    parts = (main, [not each for each in main])
    first, second = (literal(table[part]).apply(lambda _, part=part: css[part].to_numpy(), axis=None) for part in parts)
    return first, second


def missed_by(columns: Sequence[tuple[str, Sequence[Metric]]]) -> dict[str, set[str]]:
    """Metrics whose interval does not hold what the test measured, by heading; without a column of the test, none."""
    measured = {metric.name: metric.value for metric in dict(columns).get(TEST_COLUMN, ())}
    missed = {heading: {m.name for m in own if m.holds(measured.get(m.name)) is False} for heading, own in columns}
    return {heading: names for heading, names in missed.items() if names}


def next_tests(ranked: Sequence[NextTest], display: Display) -> Styler:
    """Ranked tests, with the ranking criterion first."""
    table = next_tests_table(ranked, display.units)
    speed = display.title("speed", "mph")
    first = ["rank", speed, "gain (%)", "extrapolation"]
    table = table[[*first, *table.columns.drop(first)]].rename(columns=str.capitalize)
    digits = {"Gain": 1, "Speed": 1, "Band": 2}
    texts = table.assign(
        **{
            name: table[name].map(f"{{:.{digits[name.split()[0]]}f}}".format)
            for name in table.columns
            if name.split()[0] in digits
        }
    )
    return literal(texts.astype(str))


def _coloured(table: pd.DataFrame) -> Styler:
    """Colour every cell that ends in a grade word; the word stays, for those who can't see the colour."""

    def style(cell: object) -> str:
        colour = GRADE_COLOURS.get(str(cell).rpartition(" ")[2])
        return fill(colour) if colour else ""

    return literal(table).map(style)
