"""Colours of approaches, grades and tests by speed, and their counterparts on a dark page."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from plotly.colors import sample_colorscale

from crashfuse.approaches.registry import CLASSES
from crashfuse.units import MPH

PAPER, INK = "#FFFFFF", "#262A33"
GRID, AXIS, CURSOR = "#E3E6EA", "#868D98", "#5B6270"
WINDOW, WINDOW_INK = "#FFF4CC", "#6B5900"
CORRIDOR = "#7A5AB5"  # of the rating
MEASURED_COLOUR = "#000000"
COLOURS: Mapping[str, str] = CLASSES.mapped(lambda approach: approach.colour)
"""Of each approach, from Okabe & Ito's palette, which colour-blind readers can tell apart."""

DASHES: Mapping[str, str] = CLASSES.mapped(lambda approach: approach.dash)
"""Of each approach's curves: what has not seen a test is not drawn solid."""

FURTHER_COLOURS = ("#5B16B8", "#7D0A24", "#8F80FF", "#0A1A6B", "#B0006E")
"""Of further tests, CAE runs and predictions in a figure: apart from the approaches', for the colour-blind as well."""

_FURTHER_IN_THE_DARK = ("#D9B3FF", "#FFA89A", "#7060FF", "#C4EE3C", "#FFF3A0")
_FURTHER_DASHES = (
    "12px,3px", "7px,2px,2px,2px", "4px,2px", "12px,2px,2px,2px", "8px,3px,4px,3px", "6px,2px,2px,2px,2px,2px",
)  # fmt: skip
"""Unlike those of the approaches, and short enough for the legend."""

GRADE_COLOURS: Mapping[str, str] = {"Poor": "#F4B183", "Fair": "#FBE3D0", "Good": "#CFE3F2", "Excellent": "#7FB6DC"}
"""Colour behind each grade word of ISO/TS 18571; black text reads on all of them."""

VERDICT_COLOURS: Mapping[str, str] = {"met": "#7FB6DC", "not met": "#F4B183", "open": "#FFF0AE", "outside": "#D5D9DF"}
"""Colour behind each verdict; black text reads on all of them, and their words or marks tell them apart as well."""

_FILLS_IN_THE_DARK = {  # dim: a bright cell glares on a dark page; light text reads on all of them
    "#F4B183": "#9A5320", "#FBE3D0": "#533D2C", "#CFE3F2": "#27435A", "#7FB6DC": "#216CA1",
    "#FFF0AE": "#5C5120", "#D5D9DF": "#3A434F",
}  # fmt: skip

_REPEATS = (("solid", ""), ("dash", "circle"), ("dot", "diamond"), ("dashdot", "triangle-up"), ("longdash", "square"))
_MARKS = 12  # on a curve
_SHADES = 64
# once around the hues, ever brighter, so that both tell tests apart; a contrast of 3 on the page for either theme
_SLOW_TO_FAST, _SLOW_TO_FAST_IN_THE_DARK = (
    sample_colorscale(scale, np.linspace(0, 1, _SHADES).tolist())
    for scale in (
        ["#26208D", "#5C1986", "#891063", "#A51C2B", "#9E4C03", "#87710D", "#259835", "#199EAA"],
        ["#6371CC", "#9F6EC8", "#D16FA9", "#EE7D7B", "#F79658", "#DDBF47", "#92E795", "#81F2FF"],
    )
)

IN_THE_DARK: Mapping[str, str] = {
    PAPER: "#14181F",
    INK: "#E6E9EE",
    GRID: "#2C333E",
    AXIS: "#7C8592",
    "#EEF0F3": "#252C36",
    CURSOR: "#AEB6C2",
    WINDOW: "#423B22",
    WINDOW_INK: "#E3CB74",
    MEASURED_COLOUR: "#F5F7FA",
    CORRIDOR: "#B79CF0",
    **_FILLS_IN_THE_DARK,
    **{approach.colour: approach.dark_colour for approach in CLASSES.ours.values() if approach.dark_colour},
    **dict(zip(FURTHER_COLOURS, _FURTHER_IN_THE_DARK, strict=True)),
    **dict(zip(_SLOW_TO_FAST, _SLOW_TO_FAST_IN_THE_DARK, strict=True)),
}
"""Counterparts on a dark page; colours that are not listed can be read on both."""


def in_the_dark() -> dict[str, str]:
    """:data:`IN_THE_DARK`, with those of approaches of other packages that are used."""
    return {**{own.colour: own.dark_colour for own in CLASSES.imported if own.dark_colour}, **IN_THE_DARK}


def further_line(number: int) -> dict[str, Any]:
    """Line of a further curve, counted from 0: thin and dashed; neighbours differ in colour and dash."""
    colour, dash = (looks[number % len(looks)] for looks in (FURTHER_COLOURS, _FURTHER_DASHES))
    return {"color": colour, "width": 1.6, "dash": dash}


def added_test_line(test: str, speeds_mps: Mapping[str, float]) -> dict[str, Any]:
    """Line of a test among predictions: in the colour of its speed, and dashed unlike any approach."""
    line = speed_lines(speeds_mps)[test]["line"]
    number = [dash for dash, _ in _REPEATS].index(line["dash"])
    return {**further_line(number), "color": line["color"]}


def speed_lines(speeds_mps: Mapping[str, float]) -> dict[str, dict[str, Any]]:
    """Style of each test's curve: dark for slow, bright for fast; dashes and marks at equal speed."""
    slow_to_fast = sorted(speeds_mps, key=speeds_mps.__getitem__)
    low, high = (speeds_mps[test] for test in (slow_to_fast[0], slow_to_fast[-1])) if speeds_mps else (0.0, 0.0)
    rounded = [round(speeds_mps[test] / MPH) for test in slow_to_fast]
    styles: dict[str, dict[str, Any]] = {}
    for place, test in enumerate(slow_to_fast):
        colour = _SLOW_TO_FAST[round((_SHADES - 1) * (speeds_mps[test] - low) / (high - low or 1.0))]
        dash, symbol = _REPEATS[rounded[:place].count(rounded[place]) % len(_REPEATS)]
        styles[test] = {"line": {"color": colour, "dash": dash}}
        if symbol:
            marker = {"color": colour, "symbol": symbol, "size": 8, "maxdisplayed": _MARKS}
            styles[test] |= {"mode": "lines+markers", "marker": marker}
    return styles
