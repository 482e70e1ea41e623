"""Colours can be told apart and read, by the colour-blind too, on the light page and on the dark."""

import re
import tomllib
from collections.abc import Iterator, Sequence

import numpy as np
import plotly.graph_objects as go
import pytest

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.registry import APPROACHES
from crashfuse.campaign import Campaign
from crashfuse.results.drawing import drawing_of
from crashfuse.results.plots import palette
from crashfuse.results.plots.conditions import condition_space
from crashfuse.results.plots.curves import Predictions, by_speed
from crashfuse.results.plots.pulses import library_band, measured_pulses, motion, overlay
from crashfuse.signals.pulse import FloatArray
from tests.conftest import ROOT

THEMES = tomllib.loads((ROOT / ".streamlit" / "config.toml").read_text(encoding="utf-8"))["theme"]
LINE, TEXT = 3.0, 4.5  # WCAG 2.1, 1.4.11 and 1.4.3
LIGHT, DARK = palette.PAPER, palette.IN_THE_DARK[palette.PAPER]


def linear(colour: str) -> FloatArray:
    parts = [int(colour[i : i + 2], 16) for i in (1, 3, 5)] if colour[0] == "#" else colour[4:-1].split(",")
    shares = np.array([int(part) / 255 for part in parts])
    return np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)


def luminance(colour: str) -> float:
    """Relative luminance (WCAG 2.1)."""
    return float(linear(colour) @ [0.2126, 0.7152, 0.0722])


SIGHTS = (  # Machado, Oliveira & Fernandes (2009): usual, without red, without green
    np.eye(3),
    np.array([[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]),
    np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]),
)
_CONES = [
    [0.41222147, 0.53633254, 0.05144599],
    [0.2119035, 0.68069955, 0.10739696],
    [0.08830246, 0.28171884, 0.6299787],
]
_LAB = [
    [0.21045426, 0.79361779, -0.00407205],
    [1.9779985, -2.4285922, 0.4505937],
    [0.02590404, 0.78277177, -0.80867577],
]


def seen(colours: Sequence[str], sight: FloatArray) -> FloatArray:
    light = np.clip(np.array([linear(colour) for colour in colours]) @ sight.T, 0, 1)
    return np.asarray(np.cbrt(light @ np.transpose(_CONES)) @ np.transpose(_LAB))


def contrast(colour: str, ground: str) -> float:
    """Contrast ratio (WCAG 2.1)."""
    dim, bright = sorted([luminance(colour), luminance(ground)])
    return (bright + 0.05) / (dim + 0.05)


def blend(colour: str, ground: str, share: float = 0.6) -> str:
    over, under = (np.array([int(part[i : i + 2], 16) for i in (1, 3, 5)]) for part in (colour, ground))
    return "#{:02X}{:02X}{:02X}".format(*np.round(share * over + (1 - share) * under).astype(int))


@pytest.fixture
def predictions(campaign: Campaign) -> Predictions:
    test = campaign.test("T2")
    accel = test.pulse.accel_mps2
    draws = accel * np.linspace(0.9, 1.1, 21)[:, None]
    return {
        name: Prediction(test.condition, accel, None if name in ("cae", "lf_tcn") else draws) for name in APPROACHES
    }


@pytest.fixture
def figures(campaign: Campaign, predictions: Predictions) -> list[go.Figure]:
    """Figures with all that figures have: curves, bands, points, windows, text."""
    test = campaign.test("T2")
    return [
        overlay(test, predictions).figure(),
        motion(test, predictions).figure(),
        measured_pulses(by_speed(campaign.tests, highlight="T2"), cfc=180).figure(),
        library_band(campaign.cae, by_speed(campaign.tests)).figure(),
        condition_space(campaign.cae, campaign.tests, held_out="T2").figure(),
    ]


def drawn_in(figure: go.Figure) -> Iterator[str]:
    """Colours of all curves and points of a figure."""
    for trace in figure.data:
        if trace.fill is None:
            yield trace.line.color if trace.mode == "lines" else trace.marker.color


def test_every_approach_has_a_colour_of_its_own_that_shows_on_both_pages() -> None:
    """WCAG 2.1 asks for a contrast of 3 for lines."""
    colours = [palette.COLOURS[name] for name in APPROACHES]
    assert len(set(colours)) == len(colours)
    assert min(contrast(colour, LIGHT) for colour in colours) >= LINE
    dark = [palette.IN_THE_DARK.get(colour, colour) for colour in colours]
    assert len(set(dark)) == len(dark)
    assert min(contrast(colour, DARK) for colour in dark) >= LINE


def test_words_read_on_every_grade_and_verdict_and_none_glares_in_the_dark() -> None:
    """WCAG 2.1 asks for a contrast of 4.5 for text; on a dark page a fill stays dimmer than the words on it."""
    fills = {*palette.GRADE_COLOURS.values(), *palette.VERDICT_COLOURS.values()}
    assert min(contrast("#000000", colour) for colour in fills) >= TEXT
    ink, dark = palette.IN_THE_DARK["#000000"], [palette.IN_THE_DARK[colour] for colour in fills]
    assert min(contrast(ink, colour) for colour in dark) >= TEXT
    assert max(contrast(colour, DARK) for colour in dark) < 3.5
    assert len(set(dark)) == len(fills)


def test_tests_of_one_speed_share_its_colour_and_differ_in_dashes_and_marks() -> None:
    """But for the first in the shape of their marks, which the legend shows, too; one out of use changes nothing."""
    speeds_mps = {**dict.fromkeys("ABCD", 9.0), "slow": 5.0, "fast": 15.0}
    styles = palette.speed_lines(speeds_mps)
    assert len({styles.pop(name)["line"]["color"] for name in ("slow", "fast")}) == 2
    assert len({style["line"]["color"] for style in styles.values()}) == 1
    fewer = palette.speed_lines({name: v0 for name, v0 in speeds_mps.items() if name != "D"})
    assert all(fewer[name] == styles[name] for name in "ABC")
    assert len({style["line"]["dash"] for style in styles.values()}) == 4
    assert "marker" not in styles["A"]
    assert len({styles[name]["marker"]["symbol"] for name in "BCD"}) == 3
    assert all(style["marker"]["color"] == style["line"]["color"] for style in (styles[name] for name in "BCD"))


def test_every_curve_and_every_word_of_a_figure_reads_on_both_pages(figures: list[go.Figure]) -> None:
    """Curves and points at 3, axis lines and the cursor too; text at 4.5, that over the rated window on its shade."""
    for figure in figures:
        for shown, ground in ((figure, LIGHT), (drawing_of(figure).figure(dark=True), DARK)):
            assert shown.layout.paper_bgcolor == shown.layout.plot_bgcolor == ground
            assert min(contrast(colour, ground) for colour in drawn_in(shown)) >= LINE
            for axis in shown.select_xaxes():
                assert contrast(axis.linecolor, ground) >= LINE
                assert contrast(axis.spikecolor, ground) >= LINE
            assert contrast(shown.layout.font.color, ground) >= TEXT
            for note in shown.layout.annotations:
                assert contrast(note.font.color, ground) >= TEXT
                assert contrast(note.font.color, shown.layout.shapes[0].fillcolor) >= TEXT


def test_in_the_dark_only_colours_change(figures: list[go.Figure]) -> None:
    """The same numbers, names and layout; and the light figure, which the report prints, is left as it was."""

    def without_colours(drawn: go.Figure) -> str:
        return re.sub(r'"(#\w{6}|rgba?\([^)]*\))"', "", drawn.to_json())

    for figure in figures:
        before = figure.to_json()
        dark = drawing_of(figure).figure(dark=True)
        assert figure.to_json() == before != dark.to_json()
        assert without_colours(dark) == without_colours(figure)


def test_thirty_further_curves_read_on_both_pages_and_no_two_look_alike() -> None:
    """Other tests, CAE runs and pinned predictions: the nearest ones differ in colour and dash, the others in one."""
    lines = [palette.further_line(number) for number in range(30)]
    assert len({(line["color"], line["dash"]) for line in lines}) == 30
    assert len({line["color"] for line in lines[:5]}) == len({line["dash"] for line in lines[:5]}) == 5
    assert min(contrast(line["color"], LIGHT) for line in lines) >= LINE
    assert min(contrast(palette.IN_THE_DARK[line["color"]], DARK) for line in lines) >= LINE


def test_what_is_put_beside_looks_like_no_approach_to_the_colour_blind_either() -> None:
    """In OKLab, where a difference of 0.02 is just seen, as all eyes, those without red and those without green see."""
    beside = palette.FURTHER_COLOURS
    approaches = [*palette.COLOURS.values(), palette.MEASURED_COLOUR]
    for shown in (dict.fromkeys((*beside, *approaches)), palette.IN_THE_DARK):
        own, others = ([shown.get(colour) or colour for colour in some] for some in (beside, approaches))
        for sight in SIGHTS:
            apart = np.linalg.norm(seen(own, sight)[:, None] - seen(others, sight)[None], axis=-1)
            assert apart.min() > 0.05
    assert not {palette.further_line(number)["dash"] for number in range(30)} & {*palette.DASHES.values(), "solid"}


def test_tests_of_rising_speed_rise_in_brightness_on_both_pages(campaign: Campaign) -> None:
    styles = palette.speed_lines({test.id: test.condition.speed_mps for test in campaign.tests})
    slow_to_fast = [styles[test.id]["line"]["color"] for test in campaign.tests]
    for colours in (slow_to_fast, [palette.IN_THE_DARK[colour] for colour in slow_to_fast]):
        bright = [luminance(colour) for colour in colours]
        assert bright == sorted(bright)
        assert bright[-1] > 2 * bright[0]


@pytest.mark.parametrize(("name", "ground"), [("light", LIGHT), ("dark", DARK)])
def test_the_pages_own_colours_read(name: str, ground: str) -> None:
    """Text, captions, links and the accent on the page, on fields and in the sidebar; text on the accent itself."""
    theme = THEMES[name]
    assert theme["backgroundColor"] == ground
    grounds = [ground, theme["secondaryBackgroundColor"], theme["sidebar"]["backgroundColor"]]
    for own in grounds:
        for colour in ("textColor", "linkColor", "primaryColor"):
            assert contrast(theme[colour], own) >= TEXT
        assert contrast(blend(theme["textColor"], own), own) >= TEXT
    on_accent = "#FFFFFF" if name == "light" else DARK
    assert contrast(on_accent, theme["primaryColor"]) >= TEXT
