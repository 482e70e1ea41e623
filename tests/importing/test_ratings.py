"""Ratings of files: own tables as they stand, others as the import reads them, pairs of a table, ISO-MME by channel."""

import json
import re
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from crashfuse import cli
from crashfuse.campaign_folder.pulse_files import read_pulse
from crashfuse.errors import DataError, UsageError
from crashfuse.files.archive import zipped
from crashfuse.importing import import_source
from crashfuse.importing.ratings import COLUMNS, RatingChoices, rate_channels, rate_files, rate_pairs
from crashfuse.readers.isomme import Channel, IsommeTest
from crashfuse.results.export.isomme import isomme_files
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.metrics import FURTHER_METRICS
from crashfuse.signals.pulse import FloatArray, Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.testing.readers import written
from crashfuse.units import G
from tests.conftest import SHARED, Capture, needs_shared, not_none
from tests.importing.crash_files import german, isomme
from tests.importing.crashes import clock, half_sine_g, ringing_g, scatter_g

CAMRY = SHARED / "real" / "nhtsa_10146_camry2018"
SEATS = SHARED / "real" / "formats" / "isomme_seat" / "nh_g.zip"


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """A crash in our own form, the same as a German table with ringing, and another as a zip of ISO-MME."""
    own = pd.DataFrame({"time_s": clock(0, 0.12), "acceleration_g": half_sine_g(clock(0, 0.12))})
    own.to_csv(tmp_path / "own.csv", index=False)
    ringing = half_sine_g(clock()) + np.where(clock() >= 0, ringing_g(clock()), 0.0)
    written(tmp_path, {"lab.csv": german(clock(), ringing), "iso.zip": zipped(isomme("V2", scatter=4.0))})
    return tmp_path


def overall(table: pd.DataFrame) -> list[float]:
    return [float(value) for value in table["overall"]]


def test_own_tables_are_rated_as_they_stand(campaign_on_disk: Path) -> None:
    one, other = (campaign_on_disk / "tests" / f"{name}.csv" for name in ("T1", "T2"))
    table = rate_files(one, other, [30, 50])
    expected = rate_windows(read_pulse(one), read_pulse(other), [30, 50])
    assert tuple(table.columns) == COLUMNS
    assert table["window_ms"].tolist() == [30, 50]
    assert overall(table) == [rating.overall for rating in expected.values()]
    assert set(table["basis"]) == {"ISO/TS 18571:2024, 10 kHz, filtered as supplied"}
    assert set(table["note"]) == {""}


def test_own_tables_are_filtered_if_asked_for(tmp_path: Path) -> None:
    time_s = clock(0, 0.15)
    pulses = {"clean.csv": half_sine_g(time_s), "noisy.csv": half_sine_g(time_s) + ringing_g(time_s)}
    for name, pulse in pulses.items():
        pd.DataFrame({"time_s": time_s, "acceleration_g": pulse}).to_csv(tmp_path / name, index=False)
    clean, noisy = (tmp_path / name for name in pulses)
    filtered = rate_files(clean, noisy, [60], choices=RatingChoices(channel_filter_class=60.0))
    one, other = (Pulse(time_s, cfc_filter(pulse * G, cfc=60, dt_s=1e-4)) for pulse in pulses.values())
    assert overall(filtered) == pytest.approx([rate_windows(one, other, [60])[60].overall], abs=1e-4)
    assert filtered["basis"].item().endswith("CFC 60")
    assert overall(filtered)[0] > overall(rate_files(clean, noisy, [60]))[0] + 0.1


def test_a_rating_is_the_same_before_and_after_the_import(files: Path) -> None:
    before = rate_files(files / "lab.csv", files / "iso.zip", [20, 60])
    weights = "id,speed_kph,front_weight_kg,rear_weight_kg\nlab,56,950,750\nV2,56,950,750\n"
    (files / "conditions.csv").write_text(weights)
    for source in ("lab.csv", "iso.zip"):
        import_source(files / source, files / "campaign", conditions=files / "conditions.csv")
    lab, iso = (files / "campaign" / "tests" / f"{name}.csv" for name in ("lab", "V2"))
    assert overall(before) == pytest.approx(overall(rate_files(lab, iso, [20, 60])), abs=1e-4)
    assert set(before["basis"]) == {"ISO/TS 18571:2024, 10 kHz, reference CFC 60, comparison filtered as supplied"}


HEADERS = ["Time [ms];Acceleration x [g]", "t/ms;a_x (g)", "Zeit [ms];Beschleunigung x in g", "time_ms;acceleration_g"]


@pytest.mark.parametrize("header", HEADERS)
@pytest.mark.parametrize(("late_ms", "sign"), [(0, -1), (5, 1), (12, 1), (8, -1)])
def test_a_table_is_rated_as_it_stands(tmp_path: Path, header: str, late_ms: int, sign: int) -> None:
    """Neither moved nor turned: what is late loses its share of the phase, what is inverted nearly all."""
    time_s = clock(0, 0.15)
    pulses = {"one.csv": half_sine_g(time_s), "other.csv": sign * half_sine_g(time_s - late_ms * 1e-3)}
    written(tmp_path, {name: german(time_s, pulse, header=header) for name, pulse in pulses.items()})
    table = rate_files(tmp_path / "one.csv", tmp_path / "other.csv", [80])
    one, other = (Pulse(time_s, pulse) for pulse in pulses.values())
    assert overall(table) == pytest.approx([rate_windows(one, other, [80])[80].overall], abs=1e-5)
    phase = pytest.approx(1 - late_ms / 16)  # of a fifth of 80 ms
    assert table["phase"].item() == phase if sign > 0 else table["overall"].item() < 0.4
    assert set(table["note"]) == {""}


def test_what_the_import_changes_is_told_and_left_out_on_demand(tmp_path: Path, capsys: Capture) -> None:
    """A format with positive deceleration, and a table whose clock counts on: without it, it has no 0."""
    time_s = clock(0, 0.15)
    late_g = half_sine_g(time_s - 0.012)
    own, counts = tmp_path / "own.csv", tmp_path / "counts.csv"
    own.write_bytes(german(time_s, half_sine_g(time_s), header=HEADERS[0]))
    counts.write_bytes(german(time_s + 7, late_g, header=HEADERS[0]))
    iso = written(tmp_path, isomme("V1", values_g=-late_g, start_s=0.0)) / "V1"
    turned = "comparison: turned, so that deceleration is negative."
    assert rate_files(own, iso, [60])["note"].item().startswith(turned)
    told = rate_files(own, counts, [60])
    moved = re.fullmatch(r"comparison: taken ([\d.]+) ms earlier, from contact on\.", told["note"].item())
    assert float(not_none(moved)[1]) == pytest.approx(7012, abs=1.5)
    assert overall(told)[0] > 0.95
    expected = rate_windows(Pulse(time_s, half_sine_g(time_s)), Pulse(time_s, -late_g), [60])[60]
    given = rate_files(own, iso, [60], choices=RatingChoices(as_given=True))
    assert overall(given) == pytest.approx([expected.overall], abs=1e-5)
    assert given["note"].tolist() == [""]
    with pytest.raises(DataError, match="expected a record over 0–60 ms, found 7000–7150"):
        rate_files(own, counts, [60], choices=RatingChoices(as_given=True))
    files = [str(own), str(iso), "--windows-ms", "60"]
    assert cli.main(["rate", *files]) == cli.DONE
    assert f"Careful: {turned}" in capsys.readouterr().out
    assert cli.main(["rate", *files, "--as-given", "--json"]) == cli.DONE
    (row,) = json.loads(capsys.readouterr().out)
    assert row["overall"] == given["overall"].item()


@pytest.mark.parametrize("header", ["t [ms];Verzögerung [g]", "t [ms];decel x [g]"])
def test_what_is_named_a_deceleration_is_turned_and_told(tmp_path: Path, header: str) -> None:
    time_s = clock(0, 0.15)
    one, own = german(time_s, -half_sine_g(time_s), header=header), german(time_s, half_sine_g(time_s))
    written(tmp_path, {"own.csv": own, "one.csv": one})
    files = tmp_path / "own.csv", tmp_path / "one.csv"
    table = rate_files(*files, [60])
    assert (*overall(table), *table["note"]) == (1.0, "comparison: turned, as it is named a deceleration.")
    assert overall(rate_files(*files, [60], choices=RatingChoices(as_given=True)))[0] < 0.4


@needs_shared
@pytest.mark.parametrize(("name", "expected"), [("late12ms", 0.561), ("inverted", 0.094), ("reference", 1.0)])
def test_shifts_and_turns_of_others(name: str, expected: float) -> None:
    folder = SHARED / "real" / "formats" / "rate_shifts_and_turns"
    for own in ("", "own_"):
        table = rate_files(folder / f"{own}reference.csv", folder / f"{own}{name}.csv", [60])
        assert overall(table) == pytest.approx([expected], abs=5e-4)


def test_files_that_are_no_pulse_say_what_they_lack(files: Path) -> None:
    rate = partial(rate_files, files / "own.csv", windows_ms=[60])
    written(files, {"bare.csv": german(clock(), half_sine_g(clock()), header="Zeit [ms];a_x")})
    for name, told in (("none.csv", "expected a pulse file, found no such file"), ("bare.csv", "--unit")):
        with pytest.raises(DataError, match=told):
            rate(files / name)
    assert overall(rate(files / "lab.csv"))[0] > 0.98
    assert overall(rate(files / "bare.csv", choices=RatingChoices(unit="g")))[0] > 0.98
    with pytest.raises(UsageError, match="There is no channel engine"):
        rate(files / "iso.zip", choices=RatingChoices(comparison_channels=("engine",)))


def test_pairs_of_a_table_are_rated_and_those_that_cannot_be_say_why(files: Path) -> None:
    pairs = "own.csv,lab.csv,\nown.csv,gone.csv,\nown.csv,iso.zip,10VEHC000000ACXP\n"
    (files / "pairs.csv").write_text(f"reference,comparison,comparison_channel\n{pairs}")
    table = rate_pairs(files / "pairs.csv", [40, 60])
    assert table["comparison"].tolist() == ["lab.csv"] * 2 + ["gone.csv"] + ["iso.zip"] * 2
    alone = [*overall(rate_files(files / "own.csv", files / "lab.csv", [40, 60]))]
    alone += overall(rate_files(files / "own.csv", files / "iso.zip", [40, 60]))
    assert overall(table[table["note"] == ""]) == alone
    (note,) = table["note"][table["comparison"] == "gone.csv"]
    assert note.endswith("gone.csv: expected a pulse file, found no such file; check the path.")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("reference,other\na,b\n", "expected the columns reference, comparison, at most"),
        ("reference,comparison\n", "expected 1 to 10000 pairs, found 0"),
        ("reference,comparison\na.csv,\n", "row 2: expected two files, found an empty cell"),
    ],
)
def test_a_table_that_holds_no_pairs_is_refused(tmp_path: Path, text: str, sentence: str) -> None:
    (tmp_path / "pairs.csv").write_text(text)
    with pytest.raises(DataError, match=sentence):
        rate_pairs(tmp_path / "pairs.csv")


def dummy(name: str, head_g: FloatArray, force_unit: str = "N") -> dict[str, bytes]:
    """A test with a head, a femur force, a flat channel, one of its own and the vehicle twice."""
    time_s = clock()
    force = 3000 * np.exp(-(((time_s - 0.07) / 0.01) ** 2))
    signals = [
        ("11HEAD0000H3ACXA", "g", head_g),
        ("11FEMRLE00H3FOZB", force_unit, force),
        ("11CHST0000H3DSXC", "mm", np.zeros(time_s.size)),
        (f"10ENGN00000{len(name)}ACXD", "g", head_g),
        ("10VEHC000000ACXD", "g", half_sine_g(time_s)),
        ("10VEHC000000ACXD", "g", half_sine_g(time_s) + scatter_g(time_s, 2.0)),
    ]
    channels = tuple(Channel(code, code, unit, values, 1e-4, -0.05) for code, unit, values in signals)
    return isomme_files(IsommeTest(name, [("Velocity test object 1", "15.5")], channels))


def test_isomme_tests_are_rated_channel_by_channel(tmp_path: Path) -> None:
    time_s = clock()
    head = -60 * np.exp(-(((time_s - 0.06) / 0.012) ** 2))
    folder = written(tmp_path, {**dummy("A", head), **dummy("BB", 0.9 * head)})
    table = rate_channels(folder / "A", folder / "BB", [80]).set_index("channel")
    expected = rate_windows(Pulse(time_s, head), Pulse(time_s, 0.9 * head), [80])[80]
    ratings, notes = table["overall"], table["note"]
    assert ratings["11HEAD0000H3ACXA"] == pytest.approx(expected.overall, abs=1e-9)
    assert table.loc["11HEAD0000H3ACXA", "basis"].endswith("CFC 1000")
    assert table.loc["11FEMRLE00H3FOZB", ["overall", "basis"]].tolist() == [1.0, "ISO/TS 18571:2024, 10 kHz, CFC 600"]
    assert ratings[["10VEHC000000ACXD", "10VEHC000000ACXD (2)"]].tolist() == [1.0, 1.0]
    assert "a curve that varies" in notes["11CHST0000H3DSXC"]
    engines = ["only in the reference", "only in the comparison"]
    assert notes[["10ENGN000001ACXD", "10ENGN000002ACXD"]].tolist() == engines
    folder = written(tmp_path / "other", {**dummy("A", head), **dummy("BB", head, "kN")})
    table = rate_channels(folder / "A", folder / "BB", [80]).set_index("channel")
    assert "expected the unit N, found kN" in table.loc["11FEMRLE00H3FOZB", "note"]
    folder = written(tmp_path, {**isomme("V1"), **dummy("A", half_sine_g(clock()))})
    with pytest.raises(DataError, match="codes of one only"):
        rate_channels(folder / "V1", folder / "A")


@needs_shared
def test_one_crash_in_two_formats_rates_1() -> None:
    """NHTSA's ASCII and the ISO-MME that pyisomme wrote of the same sensors."""
    channels = RatingChoices(("93", "94"), ("10SEATLERE00ACXP#1", "10SEATRIRE00ACXP#1"))
    assert overall(rate_files(CAMRY, SEATS, [20, 60], choices=channels)) == pytest.approx([1, 1], abs=1e-6)
    left_right = rate_files(CAMRY, CAMRY, [60], choices=RatingChoices(("93",), ("94",)))
    assert overall(left_right) == pytest.approx([0.923], abs=5e-4)
    assert set(left_right["basis"]) == {"ISO/TS 18571:2024, 10 kHz, CFC 60"}


def test_further_measures_are_columns_where_they_are_asked_for(campaign_on_disk: Path, capsys: Capture) -> None:
    one, other = (str(campaign_on_disk / "tests" / f"{name}.csv") for name in ("T1", "T2"))
    alone, also = (rate_files(one, other, choices=RatingChoices(also=names)) for names in ((), tuple(FURTHER_METRICS)))
    pd.testing.assert_frame_equal(also[list(COLUMNS)], alone)
    more = " ".join(list(also)[len(COLUMNS) :])
    assert more == "sg_magnitude sg_phase sg_comprehensive anova_mean anova_deviation"
    assert cli.main(["rate", one, other, "--also", "sprague-geers", "--windows-ms", "60"]) == cli.DONE
    assert "sg_comprehensive" in capsys.readouterr().out
    assert cli.main(["rate", one, other, "--also", "cora"]) == cli.WRONG_USAGE
    assert "sprague-geers" in capsys.readouterr().err
