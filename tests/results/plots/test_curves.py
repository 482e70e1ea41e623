"""Curves that figures share: bands lie under all lines, names and colours are those of the approaches."""

from copy import deepcopy

import numpy as np

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.notes import Note
from crashfuse.results.plots.canvas import new_drawing
from crashfuse.results.plots.curves import POINTWISE, TEST, Curve, add_marks, by_speed, draw_curves
from crashfuse.results.plots.palette import COLOURS, MEASURED_COLOUR
from crashfuse.results.plots.pulses import motion

X = np.array([0.0, 1.0])


def test_bands_are_drawn_before_all_lines_and_the_test_last() -> None:
    """Else the band of one approach would cover the line of another."""
    drawing = new_drawing(300)
    drawing.axis("y2")
    curves = {"cae": Curve(X, X), "fused": Curve(X, X, (X, X - 1, X + 1), remark=", RMS 1.0 g"), TEST: Curve(X, 2 * X)}
    draw_curves(drawing, curves, yaxis="y2", showlegend=False)
    band, cae, fused, test = drawing.figure().data
    assert band.fill == "toself"
    assert not band.showlegend
    assert [trace.name for trace in (cae, fused, test)] == ["CAE", "Fused, RMS 1.0 g", "Test"]
    assert [trace.line.color for trace in (cae, fused, test)] == [COLOURS["cae"], COLOURS["fused"], MEASURED_COLOUR]
    assert {trace.yaxis for trace in (band, cae, fused, test)} == {"y2"}
    assert test.legendrank < cae.legendrank < fused.legendrank


def test_one_band_is_filled_and_of_the_others_the_edges_are_drawn() -> None:
    curves = {name: Curve(X, X, (X, X - 1, X + 1)) for name in ("displacement_domain", "fused", "time_domain")}
    for asked, filled in ((None, "fused"), ("time_domain",) * 2, ("cae", "fused")):
        drawing = new_drawing(300)
        draw_curves(drawing, curves, filled=asked)
        bands = {trace.legendgroup: trace for trace in drawing.figure().data[:3]}
        assert [(name, band.name) for name, band in bands.items() if band.fill] == [(f"band of {filled}", POINTWISE)]
        assert bands[f"band of {filled}"].line.width == 0
        (edges, _) = [band for name, band in bands.items() if not band.fill]
        np.testing.assert_array_equal(edges.y, [-1, 0, np.nan, 2, 1])
        assert edges.line.width == 1
    names = ("displacement_domain", "Displacement domain at 25.0 mph", "Displacement domain at 35.0 mph")
    for some, count in ((names[:2], 2), (names, 1)):
        drawing = new_drawing(300)
        draw_curves(drawing, {name: Curve(X, X, (X, X - 1, X + 1)) for name in some})
        assert [bool(trace.fill) for trace in drawing.figure().data[: len(some)]].count(True) == count


def test_whatever_is_put_beside_has_its_own_name_and_line_and_stands_last_in_the_legend() -> None:
    drawing = new_drawing(300)
    draw_curves(drawing, {"T08 · 35.1 mph": Curve(X, X), "cae": Curve(X, X), "Run C7": Curve(X, X), TEST: Curve(X, X)})
    eighth, cae, run, test = drawing.figure().data
    assert (eighth.name, run.name) == ("T08 · 35.1 mph", "Run C7")
    assert test.legendrank < cae.legendrank < eighth.legendrank < run.legendrank
    assert cae.line.color == COLOURS["cae"]
    assert len({cae.line.color, eighth.line.color, run.line.color}) == 3
    assert eighth.line.width < cae.line.width


def test_tests_come_by_rising_speed_and_one_is_thick(campaign: Campaign) -> None:
    styled = by_speed(campaign.tests[::-1], highlight="T2")
    styles = [(test.id, style["line"]["width"], style["name"]) for test, style in styled]
    assert [test_id for test_id, _, _ in styles] == ["T1", "T2", "T3", "T4"]
    assert [width for _, width, _ in styles] == [1.7, 4, 1.7, 1.7]
    assert styles[1][2] == "T2 · 25.0 mph (held out)"


MARKS = (Note("T2", "the <b>third</b> hump", 25.0, 40.0), Note("T2", "on the test"), Note("T2", "airbag", 12.5))


def test_a_mark_stands_at_its_time_in_every_row(campaign: Campaign) -> None:
    """A line for a moment, a stretch from its start to its end; a note without a time is not drawn."""
    test = campaign.test("T2")
    drawing = motion(test, {})
    before, written = (len(drawing.layout[kind]) for kind in ("shapes", "annotations"))
    add_marks(drawing, MARKS)
    layout = drawing.figure().layout
    drawn = layout.shapes[before:]
    assert [(shape.type, shape.x0, shape.x1, shape.yref) for shape in drawn] == [
        *(("line", 12.5, 12.5, f"{row} domain") for row in ("y", "y2", "y3")),
        *(("rect", 25.0, 40.0, f"{row} domain") for row in ("y", "y2", "y3")),
    ]
    words = layout.annotations[written:]
    assert [(note.x, note.text) for note in words] == [(12.5, "airbag"), (25.0, "the &lt;b&gt;third&lt;/b&gt; hump")]
    assert len({note.yshift for note in words}) == 2  # near each other, they stand at different heights


def test_without_marks_or_curves_nothing_is_drawn(campaign: Campaign) -> None:
    """All curves of a figure can be hidden."""
    for measured, marks in ((None, MARKS), (campaign.test("T2"), [])):
        drawing = motion(measured, {})
        before = deepcopy(drawing.layout)
        add_marks(drawing, marks)
        assert drawing.layout == before


def test_titles_of_axes_are_no_larger_than_text() -> None:
    drawing = new_drawing(300)
    drawing.axis("y", "Velocity", "km/h")
    layout = drawing.figure().layout
    assert layout.xaxis.title.font.size == layout.yaxis.title.font.size == layout.font.size


def test_the_band_of_whole_curves_is_drawn_smooth_and_nowhere_narrower() -> None:
    """Its numbers stay as they are."""
    rough = np.random.default_rng(0).uniform(1, 2, 200)
    drawing = new_drawing(300)
    drawing.band(np.arange(200.0), -rough, rough, colour="#009E73", smooth=15)
    (mark,) = drawing.marks
    drawn = mark.look["y"]
    lower, upper = drawn[:200], drawn[200:][::-1]
    assert (upper >= rough - 1e-6).all()
    assert (lower <= 1e-6 - rough).all()
    assert np.abs(np.diff(upper)).max() < 0.1 * np.abs(np.diff(rough)).max()
    np.testing.assert_array_equal(mark.numbers["upper"], rough)
