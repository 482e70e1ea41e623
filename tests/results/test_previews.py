"""A preview shows what an import would add, in tables and the page's figure, and adds nothing."""

from pathlib import Path

import numpy as np
import pytest

import crashfuse
from crashfuse.importing import import_source
from crashfuse.results.display import Display
from crashfuse.results.plots.pulses import imported_pulse
from tests.importing.crash_files import german
from tests.importing.crashes import GIVEN, clock, half_sine_g


@pytest.fixture
def table(tmp_path: Path) -> Path:
    path = tmp_path / "V7.csv"
    path.write_bytes(german(clock(), half_sine_g(clock())))
    return path


def test_a_preview_is_what_the_import_then_adds(table: Path, tmp_path: Path) -> None:
    """The same pulse and steps, drawn over the recorded channel in the unit and sign asked for; nothing is written."""
    before = sorted(tmp_path.iterdir())
    (preview,) = crashfuse.preview_source(table, GIVEN)
    assert sorted(tmp_path.iterdir()) == before
    (added,) = import_source(table, tmp_path / "campaign", GIVEN)
    assert preview.settled is not None
    np.testing.assert_array_equal(preview.settled.pulse.accel_mps2, added.pulse.accel_mps2)
    assert preview.settled.steps == added.steps
    (channel,) = preview.record.channels
    expected = imported_pulse([channel], added, Display(unit="m/s²", deceleration=True)).figure()
    assert preview.plot(unit="m/s2", deceleration=True) == expected
    assert repr(preview) == f"<Preview of 'V7': {added.condition}>"
    assert repr(added) == f"<Settled 'V7': {added.condition}>"
    for each in (preview.record, channel):
        assert "array" not in repr(each)
        assert "\n" not in repr(each)
    shown = preview._repr_html_()
    assert all(step.replace("'", "&#x27;") in shown for step in added.steps)


def test_what_is_missing_stands_beside_the_channels(table: Path) -> None:
    """Without speed and weights there is no pulse yet: the figure has the file's own numbers."""
    (preview,) = crashfuse.preview_source(table)
    assert preview.settled is None
    assert preview.plot().layout.yaxis.title.text == "As in the file"
    assert repr(preview) == f"<Preview of 'V7': {len(preview.problems)} problems>"
    assert "expected the impact speed" in preview._repr_html_()
