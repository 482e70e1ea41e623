"""What holds for every foreign format: a good file is recognised and read, anything else is refused in a sentence.

A new format is one function from a path to records, one line of the table, and one file in :data:`GOOD`.
"""

import re
import struct
from pathlib import Path

import numpy as np
import pytest

from crashfuse import cli
from crashfuse.cli.arguments import parser
from crashfuse.errors import DataError
from crashfuse.importing import Reading, format_of, import_source, read_records, settle
from crashfuse.importing.sources import tables_of
from crashfuse.readers.formats import FORMATS, TABLES, Format, all_formats
from crashfuse.readers.members import files_below
from crashfuse.testing import ReaderContract
from crashfuse.testing.readers import refusal, written
from crashfuse.units import MS
from tests.conftest import Capture
from tests.importing.crash_files import german, isomme, workbook
from tests.importing.crashes import GIVEN, PEAK_MPS2, clock, half_sine_g
from tests.readers.lsdyna_files import Run, lsda
from tests.readers.nhtsa_files import nhtsa_files
from tests.readers.radioss_files import RadiossRun
from tests.readers.test_tdms import by_hand, iihs_test, nhtsa_test

Files = dict[str, bytes]

SHORT = Run(end_s=0.12, step_s=5e-4)
TIME_S = clock(-0.01, 0.12, 2000)
GOOD: dict[str, Files] = {
    "nhtsa": {name: content for name, content in nhtsa_files().items() if name[-3:] in ("EV5", "093", "094")},
    "isomme": isomme("M1"),
    "lsdyna": {"binout0000": SHORT.binout()},
    "radioss": {"hc1T01": RadiossRun(step_ms=0.5).binary()},
    "tdms": {"v1.tdms": nhtsa_test()},
    "csv": {"T1.csv": german(TIME_S, half_sine_g(TIME_S))},
}
"""A sound test or run of each format, by the names of its files."""
ROWS = [["Zeit [ms]", "a_x [g]"], *np.column_stack([1e3 * TIME_S, half_sine_g(TIME_S)]).tolist()]
EVERY = [*GOOD.items(), ("lsdyna", {"nodout": SHORT.nodout()}), ("tdms", {"CEN1908.tdms": iihs_test()})]
EVERY += [("radioss", {"hc1T01.csv": RadiossRun(step_ms=0.5).csv()}), ("csv", {"T1.xlsx": workbook({"T1": ROWS})})]


def test_every_format_has_a_good_file_here() -> None:
    assert set(GOOD) == set(FORMATS)


@pytest.mark.parametrize(("fmt", "files"), EVERY, ids=[f"{fmt}, {next(iter(files))}" for fmt, files in EVERY])
def test_the_pulse_is_that_of_the_crash(tmp_path: Path, fmt: str, files: Files) -> None:
    (record,) = read_records(Reading(written(tmp_path / "good", files), fmt))
    assert settle(record, GIVEN).pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=0.01)


@pytest.mark.parametrize(
    ("fmt", "files", "other"),
    # a channel of NHTSA or ISO-MME is a table of numbers
    [
        (fmt, files, other)
        for fmt, files in EVERY
        for other in GOOD
        if other != fmt and (fmt, other) not in ((TABLES, "nhtsa"), (TABLES, "isomme"))
    ],
)
def test_bytes_of_another_format_under_a_name_are_refused(tmp_path: Path, fmt: str, files: Files, other: str) -> None:
    foreign = max(GOOD[other].values(), key=len)
    assert refusal(written(tmp_path / "renamed", dict.fromkeys(files, foreign)), fmt)


@pytest.mark.parametrize("fmt", [fmt for fmt in FORMATS if fmt != TABLES])
def test_a_file_that_is_named_as_another_format_is_not_its_folder(tmp_path: Path, fmt: str) -> None:
    for name, files in GOOD.items():
        written(tmp_path if name == TABLES else tmp_path / f"old {name}", files)
    with pytest.raises(DataError, match=r"T1\.csv: expected .* found a file of another kind"):
        read_records(Reading(tmp_path / "T1.csv", fmt))


def claims(fmt: str) -> Files:
    """A file whose header declares far more than it has."""
    sound = next(iter(GOOD[fmt].values()))
    match fmt:
        case "lsdyna":
            huge = bytearray(lsda(SHORT.folders()))
            entry = huge.rindex(b"x_acceleration") + len("x_acceleration")
            huge[entry + 9 : entry + 17] = struct.pack("<Q", 1 << 60)
            return {"binout": bytes(huge)}
        case "tdms":
            return {"x.tdms": by_hand(0b1110, bytes(48), count=1 << 60)}
        case "isomme":
            return {
                name: content.replace(b"samples           :", b"samples           :99999999999")
                for name, content in GOOD[fmt].items()
            }
        case "radioss":
            group = struct.pack(">5i", 1, 0, 0, 2, 3)
            assert group in sound
            return {"hc1T01": sound.replace(group, struct.pack(">5i", 1, 0, 0, 999_999, 999_999))}
        case "nhtsa":
            return {**GOOD[fmt], "v00005.093": b"0 1\n" * 1_000_001}
    return {"x.csv": sound + b"1;1\n" * 4_000_001}


_SLOW = ("damage_is", "a_damaged_zip_is", "wherever_a_file_ends_it_is")
for _kind in _SLOW:
    pytest.mark.slow(getattr(ReaderContract, f"test_{_kind}_a_sentence_or_a_record"))
pytest.mark.slow(ReaderContract.test_claims_beyond_the_file_cost_nothing)

for _fmt, _files in EVERY:
    _name = f"Test_{_fmt}_{next(iter(_files)).replace('.', '_')}"
    _own: dict[str, object] = {"format": _fmt, "files": _files}
    # other files of a format declare their sizes as those in GOOD do
    _own |= {"claims": claims(_fmt)} if _files is GOOD[_fmt] else {"test_claims_beyond_the_file_cost_nothing": None}
    if "hc1T01.csv" in _files:  # a table by its name
        _own |= {name: None for name in vars(ReaderContract) if re.search("sound|capitals|zip", name)}
    globals()[_name] = type(_name, (ReaderContract,), _own)


def polar_records(path: Path) -> tuple[object, ...]:
    """Stands in for a reader of a new format: float64 pairs of time and acceleration in a file ``.polar``."""
    from crashfuse.readers.record import PartialCondition, Record, RecordedChannel

    files = [path] if path.is_file() else sorted(f for f in files_below(path) if f.suffix == ".polar")
    records = []
    for file in files:
        time_s, accel = np.frombuffer(file.read_bytes()).reshape(-1, 2).T
        channel = RecordedChannel("a", "acceleration", time_s, accel, "g")
        records.append(Record(file.stem, file.name, PartialCondition(), (channel,), ("a",), ("Polar file.",)))
    return tuple(records)


@pytest.fixture
def polar(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A file of a new format, which has its one line in the table."""
    line = Format("Polar", ".polar", r".*\.polar", "tests.readers.test_contract:polar_records")
    monkeypatch.setitem(FORMATS.ours, "polar", line)
    time_s = clock()
    return written(tmp_path, {"P1.polar": np.column_stack([time_s, half_sine_g(time_s)]).tobytes()}) / "P1.polar"


def test_a_new_format_is_one_function_and_one_line(polar: Path, capsys: Capture) -> None:
    assert format_of(polar) == "polar"
    assert "Polar (.polar)" in all_formats()
    with pytest.raises(SystemExit):
        parser().parse_args(["import", "--help"])
    assert "polar" in capsys.readouterr().out
    out = polar.parent / "campaign"
    options = ["--speed-kph", "56", "--front-weight-kg", "950", "--rear-weight-kg", "750"]
    assert cli.main(["import", str(polar), "--format", "polar", "--out", str(out), *options]) == cli.DONE
    assert "  Polar file." in capsys.readouterr().out.splitlines()
    (again,) = import_source(polar, polar.parent / "another", GIVEN, record_id="P2")
    assert again.pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=1e-3)
    assert sorted(path.name for path in polar.parent.glob("*/tests/*")) == ["P1.csv", "P2.csv"]


def test_tables_lie_beside_every_format(polar: Path) -> None:
    table = "id;speed [km/h];front [kg];rear [kg]\nP1;56;950;750\n"
    written(polar.parent, {"conditions.csv": table.encode()})
    assert format_of(polar.parent) == "polar"
    assert [path.name for path in tables_of(polar.parent)] == ["conditions.csv"]
    (record,) = read_records(Reading(polar.parent, conditions=polar.parent / "conditions.csv"))
    assert record.condition.speed_mps == pytest.approx(56 / 3.6)
    assert record.channels[0].time_s[0] == pytest.approx(-50 * MS)
