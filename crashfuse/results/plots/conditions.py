"""Figures over conditions: where CAE runs and tests lie, metrics over speed, and what next tests would tell."""

from collections.abc import Sequence

import numpy as np

from crashfuse.approaches.registry import LABELS
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.results.display import DEFAULT, Display
from crashfuse.results.drawing import Drawing, Look
from crashfuse.results.plots.canvas import drawing_of_points, marker, marks_of_runs, stack, telling
from crashfuse.results.plots.curves import Curve, draw_curves
from crashfuse.results.plots.palette import COLOURS, CURSOR, MEASURED_COLOUR
from crashfuse.signals.metrics import METRIC_UNITS, Metric
from crashfuse.signals.pulse import FloatArray
from crashfuse.study.planning import BEST, NextTests, SpeedSweep, uncovered_speeds
from crashfuse.units import MPH

_MAX_RUNS = 600  # more points only fill the same cloud, and browsers draw each one separately
_LABEL = np.array([0.07, 0.08])  # size of a test's label, as a fraction of the axis
_SIDES = {
    "top center": np.array([0.0, 0.9]),
    "bottom center": np.array([0.0, -0.9]),
    "middle right": np.array([0.9, 0.0]),
    "middle left": np.array([-0.9, 0.0]),
}
_WEIGHTS = ("front weight", "rear weight")


def condition_space(
    library: CaeLibrary, tests: Sequence[CrashTest], *, held_out: str | None = None, display: Display = DEFAULT
) -> Drawing:
    """Draw front and rear weight over speed: CAE runs, their range, and the tests, open where that is extrapolation."""
    drawing = drawing_of_points(640)
    stack(drawing, 2, 0.06)
    runs = display.vectors(library.vectors)
    some = runs[:: -(-len(runs) // _MAX_RUNS)]
    low, high = map(display.vectors, library.range)
    points = display.vectors(np.array([test.condition.vector for test in tests]).reshape(-1, 3))
    everything = np.vstack([runs, points])
    bottom, top = everything.min(axis=0), everything.max(axis=0)
    margin = 0.09 * (top - bottom) + 1e-6
    speeds = [max(bottom[0] - margin[0], 0), top[0] + margin[0]]
    listed = set[str]()  # names in the legend
    for row, weight in enumerate(_WEIGHTS, start=1):  # the row is also the weight's index in a condition's vector
        x, y = ("x", "y") if row == 1 else ("x2", "y2")
        drawing.axis(x, *display.axis("Impact speed", "mph"), title="" if row == 1 else None, range=speeds)
        weights = [bottom[row] - margin[row], top[row] + margin[row]]
        drawing.axis(y, *display.axis(weight.capitalize(), "lb"), title_standoff=8, range=weights)
        place = Look(xaxis=x, yaxis=y, showlegend=row == 1)
        drawing.points(
            some[:, 0], some[:, row], name=f"{len(runs):,} CAE runs", legendgroup="runs", hoverinfo="skip",
            marker=marks_of_runs(len(some)), **place,
        )  # fmt: skip
        drawing.points(
            [low[0], high[0], high[0], low[0], low[0]], [low[row], low[row], high[row], high[row], low[row]],
            mode="lines", name="Their range", legendgroup="range", hoverinfo="skip", line_color=CURSOR, line_width=1.5,
            line_dash="dash", **place,
        )  # fmt: skip
        sides = _label_sides(points[:, [0, row]], (top - bottom + 2 * margin)[[0, row]])
        notes = [library.extrapolation(test.condition) for test in tests]
        elsewhere = _WEIGHTS[2 - row]  # an axis of the other plot
        outside = [any(elsewhere not in note for note in own) for own in notes]
        words = [[*map(display.words, (test.condition, *own))] for test, own in zip(tests, notes, strict=True)]
        for name, symbol in (("Tests", "circle"), ("Tests outside it: extrapolation", "circle-open")):
            if chosen := [i for i, is_out in enumerate(outside) if is_out is (symbol == "circle-open")]:
                drawing.points(
                    points[chosen, 0], points[chosen, row], name=name, mode="markers+text", cliponaxis=False,
                    text=[tests[i].id for i in chosen], textposition=[sides[i] for i in chosen],
                    legendgroup=name, **marker(MEASURED_COLOUR, symbol, 10, 2),
                    **telling(["<br>".join([f"<b>Test {tests[i].id}</b>", *words[i]]) for i in chosen]),
                    **{**place, "showlegend": name not in listed},
                )  # fmt: skip
                listed.add(name)
        for i in [i for i, test in enumerate(tests) if test.id == held_out]:
            drawing.points(
                points[[i], 0], points[[i], row], name=f"{held_out}: held out", legendgroup="held out",
                hoverinfo="skip", **marker(MEASURED_COLOUR, "circle-open", 17, 1.5), **place,
            )  # fmt: skip
    drawing.update(margin_l=72)
    return drawing


def _label_sides(points: FloatArray, span: FloatArray) -> list[str]:
    places = points / span / _LABEL
    taken = list(places)
    chosen = []
    for i, place in enumerate(places):
        others = np.array(taken[:i] + taken[i + 1 :]).reshape(-1, 2)
        room = {side: np.abs(others - place - off).max(axis=1).min(initial=9.0) for side, off in _SIDES.items()}
        # where it least obstructs points and earlier labels; beyond this distance the first side wins
        chosen.append(max(room, key=lambda side: min(room[side], 1.2)))
        taken.append(place + _SIDES[chosen[-1]])
    return chosen


def sweep_figure(sweep: SpeedSweep, metric: str, display: Display = DEFAULT) -> Drawing:
    """Draw a metric over impact speed: line and 95 % band of each approach, tests as black points."""
    campaign, speeds = sweep.campaign, sweep.speeds_mps
    drawing = drawing_of_points(460, *display.axis("Impact speed", "mph"))
    readings = {name: list(map(display.metric, sweep.over_speed(name, metric))) for name in sweep.metrics}
    curves = {name: _curve(display.speeds(speeds), metrics) for name, metrics in readings.items()}
    draw_curves(drawing, curves, mode="lines+markers", marker_size=4, connectgaps=False)
    for look in [mark.look for mark in drawing.marks if mark.look["mode"] == "lines+markers"]:
        name = look["legendgroup"]
        read = zip(speeds.tolist(), readings[name], strict=True)
        look |= telling([f"<b>{LABELS[name]}</b><br>{display.speed(v0)}<br>{m.text_with_unit}" for v0, m in read])
    _points(drawing, campaign, metric, display)
    speeds = np.concatenate([speeds, [test.condition.speed_mps for test in campaign.tests]])
    margin = 0.02 * np.ptp(speeds) + 0.1 * MPH
    low, high = float(speeds.min() - margin), float(speeds.max() + margin)
    _mark_speeds(drawing, campaign, low, high, display)
    drawing.axis("x", range=[display.speeds(low), display.speeds(high)])
    unit, label = METRIC_UNITS[metric], campaign.metric_headings[metric]
    drawing.axis("y", *(display.axis(label, unit) if unit else (label,)))
    return drawing


def _curve(speeds: FloatArray, metrics: Sequence[Metric]) -> Curve:
    value, lower, upper = np.array([(m.value, m.lower, m.upper) for m in metrics], dtype=np.float64).T
    return Curve(speeds, value, (speeds, lower, upper) if np.isfinite(lower).any() else None)


def _points(drawing: Drawing, campaign: Campaign, metric: str, display: Display) -> None:
    measured = ((test, own) for test in campaign.tests for own in campaign.metrics_of(test) if own.name == metric)
    tests = [(test, test.condition, display.metric(own)) for test, own in measured]
    speeds, values = [display.speeds(at.speed_mps) for _, at, _ in tests], [own.value for *_, own in tests]
    over = telling([f"<b>Test {t.id}</b><br>{display.condition(at)}<br>{m.text_with_unit}" for t, at, m in tests])
    look = Look(name="Tests (each with its own weights)", marker_color=MEASURED_COLOUR, marker_size=9)
    drawing.points(speeds, values, **look, **over)


def _mark_speeds(drawing: Drawing, campaign: Campaign, low_mps: float, high_mps: float, display: Display) -> None:
    for number, (start, end) in enumerate(uncovered_speeds(campaign.cae, low_mps, high_mps)):
        drawing.shade(
            display.speeds(start), display.speeds(end), fillcolor="#EEF0F3", name="No CAE runs: extrapolation",
            showlegend=number == 0, legendgroup="extrapolation",
        )  # fmt: skip
    for test in campaign.tests:
        v0 = display.speeds(test.condition.speed_mps)
        drawing.shade(v0, v0, type="line", y1=0.03, layer=None, line_color=MEASURED_COLOUR, line_width=1.5)


def next_tests_figure(ranking: NextTests, display: Display = DEFAULT) -> Drawing:
    """Draw by how much each candidate would narrow the band, over its speed; ticks mark the tests already run."""
    drawing = drawing_of_points(420, *display.axis("Impact speed", "mph"))
    vectors = np.array([condition.vector for condition in ranking.conditions])
    places = np.argsort(vectors[:, 0], kind="stable")
    tests, wide = ranking.campaign.tests, 1 / display.units.in_si("g")
    weights = [display.vectors(vector)[1:].tolist() for vector in vectors[places]]
    after, units, colour = ranking.after_mps2[places].tolist(), display.units, COLOURS["displacement_domain"]
    drawing.points(
        [display.speeds(v0) for v0 in vectors[places, 0].tolist()],
        (100 * ranking.gains[places]).tolist(),
        text=[f"{place + 1}" if place < BEST else "" for place in places],
        customdata=[[*w, ranking.before_mps2 * wide, own * wide] for w, own in zip(weights, after, strict=True)],
        name="Candidates, the best numbered", line_color=colour, line_width=2,
        mode="lines+markers+text" if all(own == weights[0] for own in weights) else "markers+text",
        textposition="top center", cliponaxis=False, textfont_size=14,
        **marker(
            colour, ["circle-open" if ranking.extrapolated[place] else "circle" for place in places],
            [11 if place < BEST else 7 for place in places], 1.5,
        ),
        hovertemplate=f"%{{x:.1f}} {units.speed}, front %{{customdata[0]:.0f}} {units.weight}, "
        f"rear %{{customdata[1]:.0f}} {units.weight}<br>band ± %{{customdata[2]:.2f}} {units.acceleration} now, "
        f"± %{{customdata[3]:.2f}} {units.acceleration} with this test (− %{{y:.1f}} %)<extra></extra>",
    )  # fmt: skip
    drawing.points(
        [display.speeds(test.condition.speed_mps) for test in tests], [0.0] * len(tests),
        text=[test.id for test in tests], name="Tests that were run",
        **marker(MEASURED_COLOUR, "line-ns-open", 16, 2),
        hovertemplate=f"%{{text}}, %{{x:.1f}} {units.speed}<extra></extra>",
    )  # fmt: skip
    if any(ranking.extrapolated):
        drawing.entry("Outside the CAE runs", **marker(colour, "circle-open", 9, 1.5))
    drawing.axis("y", "Band shrinks by", "%", rangemode="tozero")
    return drawing
