"""Marks stand at their time in every row of a figure, as text."""

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.notes import Note
from crashfuse.reporting.plots.marks import add_marks
from crashfuse.reporting.plots.pulses import motion, overlay

MARKS = (Note("T2", "the <b>third</b> hump", 25.0, 40.0), Note("T2", "on the test"), Note("T2", "airbag", 12.5))


def test_a_mark_stands_at_its_time_in_every_row(campaign: Campaign) -> None:
    """A line for a moment, a stretch from its start to its end; a note without a time is not drawn."""
    test = campaign.test("T2")
    plain = motion(test.pulse, {}, test.condition.speed_mps)
    before, written = len(plain.layout.shapes), len(plain.layout.annotations)
    marked = add_marks(plain, MARKS)
    drawn = marked.layout.shapes[before:]
    assert [(shape.type, shape.x0, shape.x1, shape.yref) for shape in drawn] == [
        *(("line", 12.5, 12.5, f"{row} domain") for row in ("y", "y2", "y3")),
        *(("rect", 25.0, 40.0, f"{row} domain") for row in ("y", "y2", "y3")),
    ]
    words = marked.layout.annotations[written:]
    assert [(note.x, note.text) for note in words] == [(12.5, "airbag"), (25.0, "the &lt;b&gt;third&lt;/b&gt; hump")]
    assert len({note.yshift for note in words}) == 2  # near each other, they stand at different heights


def test_a_long_text_takes_two_lines_and_is_shortened(campaign: Campaign) -> None:
    """All of it is in the list of notes."""
    test = campaign.test("T2")
    marked = add_marks(motion(test.pulse, {}, 11.0), [Note("T2", "word " * 90, 10.0)])
    lines = marked.layout.annotations[-1].text.split("<br>")
    assert len(lines) == 2
    assert max(map(len, lines)) <= 36
    assert lines[-1].endswith("…")


def test_a_text_stands_away_from_the_zero_line(campaign: Campaign) -> None:
    """Displacements have theirs at the bottom, accelerations at the top; further texts stand further inside.

    Late texts on displacements, which would stand on the curves, are below these.
    """
    test = campaign.test("T2")
    moved, braked = motion(test.pulse, {}, 11.0), overlay(test.pulse, {})
    above, below = (add_marks(figure, MARKS).layout.annotations[-2:] for figure in (moved, braked))
    assert {(note.y, note.yanchor, note.yref) for note in above} == {(1, "top", "y3 domain")}
    assert {(note.y, note.yanchor, note.yref) for note in below} == {(0, "bottom", "y domain")}
    assert above[1].yshift < 0 < below[1].yshift
    (late,) = add_marks(motion(test.pulse, {}, 11.0), [Note("T2", "late", 90.0)]).layout.annotations[-1:]
    assert late.y == 0
    assert late.yshift > 20


def test_without_marks_or_curves_nothing_is_drawn(campaign: Campaign) -> None:
    """All curves of a figure can be hidden."""
    empty = motion(None, {}, 11.0)
    assert not add_marks(empty, MARKS).layout.shapes
    plain = motion(campaign.test("T2").pulse, {}, 11.0)
    assert add_marks(plain, []).layout == motion(campaign.test("T2").pulse, {}, 11.0).layout


def test_a_late_mark_has_its_text_before_it(campaign: Campaign) -> None:
    """Behind it, the figure's edge would cut the text."""
    test = campaign.test("T2")
    marked = add_marks(motion(test.pulse, {}, 11.0), [Note("T2", "early", 10.0), Note("T2", "late", 90.0)])
    assert [note.xanchor for note in marked.layout.annotations[-2:]] == ["left", "right"]
