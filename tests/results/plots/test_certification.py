"""Figures of a certification show every verdict with its word, and where each condition lies."""

from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
import pytest

from crashfuse.campaign import Campaign
from crashfuse.certification.certify import Certification
from crashfuse.certification.criteria import Criteria, Criterion
from crashfuse.certification.domain import Domain
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import LeftOut, TrackRecord, Trial, share_bounds
from crashfuse.certification.verdict import Verdict, Word
from crashfuse.condition import Condition
from crashfuse.results.drawing import figure_table
from crashfuse.results.plots.certification import (
    planned_scales,
    record_figure,
    reliability,
    validated_domain,
    verdict_matrix,
)
from crashfuse.results.plots.palette import IN_THE_DARK, VERDICT_COLOURS
from crashfuse.study.config import StudyConfig
from crashfuse.units import LB, MPH

CRUSH = Criterion("crush", "max_crush", at_most=500.0)
RATING = Criterion("rating", "rating", at_least=0.8, window_ms=60.0)
WORDS: dict[str, tuple[Word, Word]] = {
    "fast": ("not met", "open"),
    "slow": ("met", "met"),
    "far": ("outside", "outside"),
}
SPEEDS_MPH = {"fast": 30.0, "slow": 20.0, "far": 70.0}
SAID: dict[Word, float] = {"met": 0.998, "not met": 0.031, "open": 0.5, "outside": 0.7}


def certification(
    campaign: Campaign, words: dict[str, tuple[Word, Word]], speeds_mph: dict[str, float]
) -> Certification:
    here = campaign.tests[1].condition
    conditions = [replace(here, speed_mps=speeds_mph[name] * MPH) for name in words]
    verdicts = tuple(
        tuple(
            Verdict(condition, criterion, 0.9, 0.85, 0.95, SAID[word], word, f"Because of {criterion.name}.")
            for criterion, word in zip((CRUSH, RATING), row, strict=True)
        )
        for condition, row in zip(conditions, words.values(), strict=True)
    )
    asked = Criteria((CRUSH, RATING)), Matrix(tuple(words), tuple(conditions)), StudyConfig(approaches=("fused",))
    return Certification(campaign, *asked, Domain.of(campaign), verdicts, verdicts, TrackRecord(()), {})


@pytest.fixture
def three(campaign: Campaign) -> Certification:
    return certification(campaign, WORDS, SPEEDS_MPH)


def colour_of(heat: go.Heatmap, z: float) -> str:
    place = (z - heat.zmin) / (heat.zmax - heat.zmin)
    return str(next(colour for (limit, colour) in heat.colorscale if limit >= place))


def test_each_cell_has_the_word_the_probability_and_the_colour_of_its_verdict(three: Certification) -> None:
    heat, marks, *_ = verdict_matrix(three).figure().data
    assert list(heat.y) == ["slow · 20.0 mph", "fast · 30.0 mph", "far · 70.0 mph"]
    heads = "".join(heat.x).replace("\N{NO-BREAK SPACE}", " ")
    assert heads == "<b>crush</b><br>≤ 500 mm<b>rating</b><br>≥ 0.80"
    told = [["met<br>0.998", "met<br>0.998"], ["not met<br>0.031", "open<br>0.500"], ["outside", "outside"]]
    assert [list(row) for row in heat.text] == told
    words = [WORDS[name] for name in ("slow", "fast", "far")]
    assert [[colour_of(heat, z) for z in row] for row in heat.z] == [[VERDICT_COLOURS[w] for w in row] for row in words]
    assert list(marks.customdata) == [f"{i} | {name}" for i in ("slow", "fast", "far") for name in ("crush", "rating")]
    assert marks.hovertext[0].endswith("Because of crush.")
    assert marks.hovertext[-1].endswith("We expect 0.900 (95 % of tests: 0.850 to 0.950); at least 0.80")


def test_beside_each_row_stands_the_answer_at_its_condition(campaign: Campaign) -> None:
    """By which test it was run, or by how many; what counts as another condition says as which, in part of it, too."""
    names = ("M20", "M20.1", "M25", "M30", "M40", "M70")
    words: dict[str, tuple[Word, Word]] = dict.fromkeys(names, ("met", "met"))
    words |= {"M40": ("not met", "open"), "M70": ("outside", "outside")}
    found = certification(campaign, words, {i: float(i[1:]) for i in names})
    verdicts = list(found.verdicts)
    for row, tests in ((2, ("T1",)), (3, ("T2", "T3"))):
        verdicts[row] = tuple(replace(own, run=dict.fromkeys(tests, 1.0)) for own in verdicts[row])
    found = replace(found, verdicts=tuple(verdicts))
    ran = "was run: T1 met all", "was run: none of 2 tests missed a limit"
    told = ["skip", "skip, as M20", *ran, "would miss", "cannot say"]
    for part in (slice(None), slice(1, 4)):
        figure = verdict_matrix(found, part=part).figure()
        assert list(figure.layout.yaxis2.ticktext) == told[part]
        assert list(figure.layout.yaxis2.tickvals) == list(figure.data[0].y)
        assert figure_table(figure)["A test there"].tolist() == told[part]


@pytest.mark.parametrize(("n", "size"), [(2, 12), (6, 12), (12, 10), (30, 6)])
def test_words_stand_above_their_numbers_and_grow_smaller_with_the_number_of_criteria(
    three: Certification, n: int, size: int
) -> None:
    """So that those of one cell do not run into the next; the numbers of the figure have them in a line."""
    criteria = tuple(replace(CRUSH, name=f"crush {i}") for i in range(n))
    rows = tuple(tuple(replace(row[0], criterion=own) for own in criteria) for row in three.verdicts)
    figure = verdict_matrix(replace(three, criteria=Criteria(criteria), verdicts=rows)).figure()
    assert figure.data[0].textfont.size == size
    assert figure.data[0].text[0][0] == "met<br>0.998"
    assert "met 0.998" in figure_table(figure).iloc[0].tolist()


def test_long_ids_are_cut_in_the_middle_beside_the_cells(campaign: Campaign) -> None:
    name = "a condition with a long name"
    figure = verdict_matrix(certification(campaign, {name: ("met", "open")}, {name: 20.0})).figure()
    assert list(figure.layout.yaxis.ticktext) == ["a condition …a long name · 20.0 mph"]
    assert list(figure.layout.yaxis.tickvals) == [f"{name} · 20.0 mph"] == list(figure.data[0].y)
    same = f"{name}, a little faster"
    met: tuple[Word, Word] = ("met", "met")
    figure = verdict_matrix(certification(campaign, {name: met, same: met}, {name: 20.0, same: 20.1})).figure()
    assert figure.layout.yaxis2.ticktext[1] == "skip, as a condition …a long name"


def test_how_close_a_test_is_stands_beside_the_limit_in_the_order_of_speed(three: Certification) -> None:
    """Interval or measured value on a scale around the limit, to whose end moves what lies far; numbers stay."""
    first, slow, far = three.verdicts
    wide = {"fast": (495.0, 480.0, 510.0), "slow": (450.0, 440.0, 470.0), "far": (900.0, 880.0, 925.0)}
    rows = tuple(
        (replace(row[0], value=v, lower=low, upper=high), row[1])
        for row, (v, low, high) in zip((first, slow, far), wide.values(), strict=True)
    )
    ran = tuple(replace(own, run={"T1": value}) for own, value in zip(rows[1], (455.5, None), strict=True))
    found = replace(three, verdicts=(rows[0], ran, rows[2]))
    figure = planned_scales(found).figure()
    low, high = figure.layout.xaxis.range
    assert low < 440 < 500 < high < 880
    labels = [label.replace("<b>", "").replace("</b>", "") for label in figure.layout.yaxis.ticktext]
    assert labels == ["was run slow · 20.0 mph", "would miss fast · 30.0 mph", "cannot say far · 70.0 mph"]
    crush = [trace for trace in figure.data if trace.xaxis == "x"]
    bars = {trace.name: list(trace.x[:2]) for trace in crush if trace.mode == "lines"}
    assert bars["not met"] == [480.0, 510.0]
    assert bars["outside"][0] == bars["outside"][1] < high
    assert np.isnan(bars["met"]).all()  # there stands what was measured
    (measured,) = (trace for trace in crush if trace.name == "crush: measured")
    assert (list(measured.x), list(measured.y), measured.text[0].strip()) == ([455.5], [0], "455.5")
    assert crush[-1].customdata[1] == "fast | crush"
    (limit,) = (shape for shape in figure.layout.shapes if shape.type == "line" and shape.xref == "x")
    assert limit.x0 == 500.0
    table = figure_table(figure)
    assert table["Maximum dynamic crush, upper (mm)"].tolist()[:3] == [470.0, 510.0, 925.0]
    assert not planned_scales(found, part=slice(1, 2), names=False).figure().layout.yaxis.showticklabels


def test_the_legend_counts_the_verdicts_and_is_dim_with_them_on_a_dark_page(three: Certification) -> None:
    _, _, *legend = verdict_matrix(three).figure().data
    assert [trace.name for trace in legend] == ["met (2)", "not met (1)", "open (1)", "outside (2)"]
    assert [trace.marker.color for trace in legend] == list(VERDICT_COLOURS.values())
    heat, _, *legend = verdict_matrix(three).figure(dark=True).data
    assert heat.textfont.color == IN_THE_DARK["#000000"]
    assert {colour for _, colour in heat.colorscale} == {trace.marker.color for trace in legend}
    assert not {colour for _, colour in heat.colorscale} & set(VERDICT_COLOURS.values())


@pytest.mark.parametrize(("n", "words_shown", "row_px"), [(40, True, 34), (400, True, 34), (401, False, None)])
def test_many_conditions_become_colours(campaign: Campaign, n: int, words_shown: bool, row_px: float | None) -> None:
    """Hundreds can be read, with the answer beside each; of more, only colours, with the words under the mouse."""
    names = [f"M{i}" for i in range(n)]
    many = certification(campaign, dict.fromkeys(names, WORDS["fast"]), dict.fromkeys(names, 20.0))
    figure = verdict_matrix(many).figure()
    heat = figure.data[0]
    assert list(heat.y) == [f"{name} · 20.0 mph" for name in names]  # as fast: in the order of the matrix
    assert (heat.text is not None) == words_shown
    assert ("yaxis2" in figure.layout) == words_shown
    assert list(figure.layout.yaxis.range) == [n - 0.5, -0.5]
    if row_px is not None:
        margin = figure.layout.margin
        assert (figure.layout.height - margin.t - margin.b) / n == row_px
    else:
        assert "<b>M0, crush: not met</b>" in heat.hovertext[0][0]
        assert figure.layout.height < 2000


def test_the_domain_shows_each_condition_by_its_worst_verdict(three: Certification) -> None:
    """In mph and lb, a mark and a colour for each word; what is shaded, on a grid, is what is not outside."""
    figure = validated_domain(three).figure()
    shown = {trace.name: trace for trace in figure.data}
    weight = three.matrix.conditions[0].mass_kg / LB
    speeds: dict[Word, float] = {"not met": 30.0, "met": 20.0, "outside": 70.0}
    for word, speed in speeds.items():
        worst = shown[f"Worst verdict: {word} (1)"]
        np.testing.assert_allclose([*worst.x, *worst.y], [speed, weight], rtol=1e-6)
        assert worst.marker.color == VERDICT_COLOURS[word]
    assert len({trace.marker.symbol for name, trace in shown.items() if name.startswith("Worst")}) == 3
    np.testing.assert_allclose(shown["4 tests"].x, [15, 25, 26, 35], rtol=1e-6)
    figure, domain = validated_domain(three).figure(), three.domain
    here, rng = three.matrix.conditions[0], np.random.default_rng(0)
    shaded = [trace for trace in figure.data if trace.legendgroup == "checked"]
    assert len(shaded) == len(domain.speed_ranges_mps) == 1
    for speed, mass in rng.uniform([1.0, 3000.0], [45.0, 4200.0], (400, 2)).tolist():
        scale = mass * LB / here.mass_kg
        condition = Condition.of_vector(here.vector * [1.0, scale, scale] + [speed * MPH - here.speed_mps, 0.0, 0.0])
        inside = any(min(t.x) <= speed <= max(t.x) and min(t.y) <= mass <= max(t.y) for t in shaded)
        said = domain.exceeded_by(condition)
        if not any("weight" in sentence for sentence in said):  # one axle alone is not in this figure
            assert inside == (not said), (speed, mass, said)


def trial(
    held_out: str,
    measured: float,
    probability: float = 0.99,
    *,
    word: Word = "met",
    speed_mps: float = 10.0,
    left_out: LeftOut = "test",
    criterion: Criterion = CRUSH,
    said: tuple[float, float, float] = (450.0, 420.0, 490.0),
) -> Trial:
    verdict = Verdict(Condition.of_vector([speed_mps, 1000.0, 700.0]), criterion, *said, probability, word, "")
    return Trial(held_out, left_out, verdict, measured, None)


def test_shares_that_met_stand_over_the_probability_with_exact_bounds() -> None:
    """One of four at 0.8, all of two at 0.99; open where none of twenty met what was given 0.9."""
    trials = [trial(f"A{i}", 400.0 if i == 0 else 600.0, 0.8) for i in range(4)]
    trials += [trial(f"B{i}", 400.0, 0.99) for i in range(2)]
    promised, agrees = reliability(TrackRecord(tuple(trials))).figure().data
    assert (list(promised.x), list(promised.y)) == ([0, 1], [0, 1])
    bounds = np.array([share_bounds(1, 4), share_bounds(2, 2)])
    np.testing.assert_allclose(agrees.x, [0.8, 0.99])
    np.testing.assert_allclose(agrees.y, [0.25, 1.0])
    np.testing.assert_allclose(agrees.y - agrees.error_y.arrayminus, bounds[:, 0])
    np.testing.assert_allclose(agrees.y + agrees.error_y.array, bounds[:, 1])
    assert list(agrees.text) == ["n = 4", "n = 2"]
    trials = [*(trial(f"A{i}", 600.0, 0.9) for i in range(20)), trial("B", 400.0, 0.3)]
    _, agrees, disagrees = reliability(TrackRecord(tuple(trials))).figure().data
    assert (agrees.name, disagrees.name) == ("Within its bounds", "Outside its bounds")
    assert (list(agrees.x), list(disagrees.x)) == ([0.3], [pytest.approx(0.9)])
    assert (agrees.marker.symbol, disagrees.marker.symbol) == ("circle", "circle-open")


def test_predictions_have_intervals_and_verdicts_measured_values_and_limits() -> None:
    """By test in order of speed, left out alone on the left of its speed group; a wrong verdict has a ring."""
    group = trial("slow", 440.0, word="open", speed_mps=5.0, left_out="speed group", said=(480.0, 400.0, 560.0))
    record = TrackRecord((trial("fast", 510.0, speed_mps=15.0), trial("slow", 440.0, speed_mps=5.0), group))
    figure = record_figure(record, [CRUSH]).figure()
    alone, apart, measured, wrong = figure.data[:4]
    assert list(figure.layout.xaxis.ticktext) == ["slow", "fast"]
    assert alone.x[0] < 0 < apart.x[0] < 0.5 < alone.x[1] < 1
    np.testing.assert_allclose(alone.y, [450.0, 450.0])
    np.testing.assert_allclose(apart.y[0] + [-apart.error_y.arrayminus[0], apart.error_y.array[0]], [400, 560])
    assert list(apart.marker.color) == [VERDICT_COLOURS["open"]]
    np.testing.assert_allclose(sorted(measured.y), [440.0, 440.0, 510.0])
    np.testing.assert_allclose([*wrong.x, *wrong.y], [alone.x[1], 510.0])
    assert [(shape.y0, shape.y1) for shape in figure.layout.shapes] == [(500.0, 500.0)]
    others = record_figure(TrackRecord(record.trials[1:]), [CRUSH]).figure()
    assert ["wrong verdict" in [trace.name for trace in drawn.data] for drawn in (figure, others)] == [True, False]
    assert figure.layout.yaxis.title.text == "Maximum dynamic crush<br>(mm)"


def test_where_there_is_nothing_to_compare_with_the_figure_says_so() -> None:
    figure = reliability(TrackRecord((trial("A", 440.0, word="outside"),))).figure()
    assert len(figure.layout.annotations) == 1
    assert (figure.layout.xaxis.visible, figure.layout.yaxis.visible) == (False, False)
