"""What holds for every foreign format: a good file is recognised and read, anything else is refused in a sentence.

A new format is one function from a path to records, one line of the table, and one file in :data:`GOOD`.
"""

import random
import struct
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from crashfuse import cli
from crashfuse.cli.arguments import parser
from crashfuse.errors import DataError, Problem
from crashfuse.importing import Reading, format_of, import_source, read_records, settle
from crashfuse.importing.sources import tables_of
from crashfuse.readers.formats import FORMATS, TABLES, Format, all_formats, formats_of
from crashfuse.readers.members import files_below
from crashfuse.units import MS
from tests.importing.crash_files import german, isomme, write, zipped
from tests.importing.crashes import GIVEN, PEAK_MPS2, clock, half_sine_g
from tests.readers.lsdyna_files import Run, lsda
from tests.readers.nhtsa_files import nhtsa_files
from tests.readers.radioss_files import RadiossRun
from tests.readers.test_tdms import by_hand, nhtsa_test
from tests.readers.test_tdms_laboratory import iihs_test

Files = dict[str, bytes]

SHORT = Run(end_s=0.12, step_s=5e-4)
TABLE = german(clock(-0.01, 0.12, 2000), half_sine_g(clock(-0.01, 0.12, 2000)))
GOOD: dict[str, Files] = {
    "nhtsa": {name: content for name, content in nhtsa_files().items() if name[-3:] in ("EV5", "093", "094")},
    "isomme": isomme("M1"),
    "lsdyna": {"binout0000": SHORT.binout()},
    "radioss": {"hc1T01": RadiossRun(step_ms=0.5).binary()},
    "tdms": {"v1.tdms": nhtsa_test()},
    "csv": {"T1.csv": TABLE},
}
"""A sound test or run of each format, by the names of its files."""
EVERY = [*GOOD.items(), ("lsdyna", {"nodout": SHORT.nodout()}), ("tdms", {"CEN1908.tdms": iihs_test()})]
IDS = [f"{fmt}, {next(iter(files))}" for fmt, files in EVERY]
every_format = pytest.mark.parametrize(("fmt", "files"), EVERY, ids=IDS)


def refusal(source: Path, fmt: str) -> str:
    """What is said against a source, a sentence for each problem and in a moment; empty where it can be read."""
    began = time.monotonic()
    problems: tuple[Problem, ...] = ()
    try:
        for record in read_records(Reading(source, fmt)):
            settle(record, GIVEN, role="cae")
    except DataError as error:
        problems = error.problems
    assert time.monotonic() - began < 5
    said = [str(problem) for problem in problems]
    assert all(one.endswith(".") and one.splitlines() == [one] and len(one) < 1500 for one in said)
    return "\n".join(said)


def test_every_format_has_a_good_file_here() -> None:
    """Whoever adds a format is reminded of the tests."""
    assert set(GOOD) == set(FORMATS)


@every_format
@pytest.mark.parametrize("packed", [False, True])
def test_a_good_file_is_recognised_and_read(tmp_path: Path, fmt: str, files: Files, packed: bool) -> None:
    """In a folder or a zip, by its name alone; the pulse is that of the crash."""
    source = write(tmp_path / "good", files)
    if packed:
        source = write(tmp_path, {"good.zip": zipped(files)}) / "good.zip"
    assert format_of(source) == fmt
    (record,) = read_records(Reading(source))
    assert settle(record, GIVEN).pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=0.01)
    assert record.steps


@every_format
def test_capitals_of_names_make_no_difference(fmt: str, files: Files) -> None:
    """Windows writes .EV5, somebody else .ev5."""
    for change in (str.upper, str.lower, str.title):
        assert formats_of([Path(change(name)) for name in files]) == [fmt]


@pytest.mark.slow
@every_format
def test_damage_is_a_sentence_or_a_record(tmp_path: Path, fmt: str, files: Files) -> None:
    """Bytes flipped, lost, doubled, anywhere: read, or refused with a DataError, and nothing else."""
    dice = random.Random(18571)  # noqa: S311  (no secret)
    folder = write(tmp_path / "damaged", files)
    refused = 0
    for _ in range(40):
        name = dice.choice(list(files))
        broken = bytearray(files[name])
        head = min(len(broken), dice.choice((400, 4000, len(broken))))  # most of the form is at the beginning
        for _ in range(dice.choice((1, 5, 40))):
            at = dice.randrange(head)
            broken[at : at + dice.choice((0, 1, 1, 1, 9))] = dice.choice((b"", b"\n", dice.randbytes(1)))
        (folder / name).write_bytes(broken)
        refused += refusal(folder, fmt) != ""
        (folder / name).write_bytes(files[name])
    assert refused > 3


@pytest.mark.slow
@every_format
def test_a_damaged_zip_is_a_sentence_or_a_record(tmp_path: Path, fmt: str, files: Files) -> None:
    """Its directory as its data: read, or refused with a DataError, and nothing else."""
    dice = random.Random(6487)  # noqa: S311  (no secret)
    sound, refused = zipped(files), 0
    for _ in range(30):
        broken = bytearray(sound)
        for _ in range(dice.choice((1, 5, 40))):
            broken[dice.randrange(max(0, len(broken) - 500) if dice.random() < 0.5 else 0, len(broken))] ^= 0x55
        (tmp_path / "t.zip").write_bytes(broken[: dice.choice((len(broken), dice.randrange(len(broken))))])
        refused += refusal(tmp_path / "t.zip", fmt) != ""
    assert refused > 3


@pytest.mark.slow
@every_format
def test_wherever_a_file_ends_it_is_a_sentence_or_a_record(tmp_path: Path, fmt: str, files: Files) -> None:
    """Cut in its header, in its numbers, a byte before its end; of no bytes at all nothing is read."""
    folder = write(tmp_path / "cut", files)
    for name, content in files.items():
        for share in (0.0, 1e-3, 0.01, 0.1, 0.3, 0.5, 0.9, 0.999):
            (folder / name).write_bytes(content[: int(share * len(content))])
            said = refusal(folder, fmt)
            assert said or share > 0 or len(files) > 1
        (folder / name).write_bytes(content[:-1])
        refusal(folder, fmt)
        (folder / name).write_bytes(content)
    for name in files:
        (folder / name).write_bytes(b"")
    assert refusal(folder, fmt)


@pytest.mark.parametrize("fmt", FORMATS)
def test_nothing_at_all_is_refused(tmp_path: Path, fmt: str) -> None:
    """An empty folder, an empty zip, and no folder."""
    write(tmp_path, {"empty.zip": zipped({})})
    (tmp_path / "empty").mkdir()
    for name in ("empty", "empty.zip", "nowhere"):
        assert refusal(tmp_path / name, fmt)


@every_format
@pytest.mark.parametrize("other", GOOD)
def test_bytes_of_another_format_under_this_name_are_refused(
    tmp_path: Path, fmt: str, files: Files, other: str
) -> None:
    """Renaming makes no test: whatever the bytes are, it is said that they are not of this format."""
    foreign = max(GOOD[other].values(), key=len)
    for content in (foreign, b"\x00" * 5000, b"PK\x03\x04" + bytes(500), "ä\n".encode() * 2000):
        if content is foreign and other == fmt:
            continue
        if fmt == TABLES and content is foreign and other in ("nhtsa", "isomme"):
            continue  # a channel of theirs is a table of numbers
        source = write(tmp_path / "renamed", dict.fromkeys(files, content))
        assert refusal(source, fmt)


@pytest.mark.parametrize("fmt", [fmt for fmt in FORMATS if fmt != TABLES])
def test_a_file_that_is_named_as_another_format_is_not_its_folder(tmp_path: Path, fmt: str) -> None:
    """Whoever names a table as NHTSA gets no other test that lies somewhere below it."""
    for name, files in GOOD.items():
        write(tmp_path, {f"old {name}/{file}": content for file, content in files.items()} if name != TABLES else files)
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


@pytest.mark.parametrize("fmt", FORMATS)
@pytest.mark.slow
def test_claims_beyond_the_file_cost_nothing(tmp_path: Path, fmt: str) -> None:
    """Counts of 2^60, or more lines than any record has: refused before anything of that size is made."""
    source = write(tmp_path / "huge", claims(fmt))
    tracemalloc.start()
    try:
        assert refusal(source, fmt)
        assert tracemalloc.get_traced_memory()[1] < 256 << 20
    finally:
        tracemalloc.stop()


@every_format
def test_a_zip_bomb_is_refused(tmp_path: Path, fmt: str, files: Files) -> None:
    """Names of the format over content that unpacks to a thousand times its size: never unpacked."""
    write(tmp_path, {"bomb.zip": zipped(dict.fromkeys(files, (b"1" * 4095 + b"\n") * (1 << 13)))})
    assert "zip bomb" in refusal(tmp_path / "bomb.zip", fmt)


# --- a new format --------------------------------------------------------------------------------------------------


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
    monkeypatch.setitem(FORMATS, "polar", line)
    time_s = clock()
    return write(tmp_path, {"P1.polar": np.column_stack([time_s, half_sine_g(time_s)]).tobytes()}) / "P1.polar"


def test_a_new_format_is_one_function_and_one_line(polar: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is recognised, told of, offered by the command line and imported; no other file knows it."""
    assert format_of(polar) == "polar"
    assert "Polar (.polar)" in all_formats()
    with pytest.raises(SystemExit):
        parser().parse_args(["import", "--help"])
    assert "polar" in capsys.readouterr().out
    out = polar.parent / "campaign"
    options = ["--speed-kph", "56", "--front-weight-kg", "950", "--rear-weight-kg", "750"]
    assert cli.main(["import", str(polar), "--format", "polar", "--out", str(out), *options]) == cli.DONE
    assert "  Polar file." in capsys.readouterr().out.splitlines()
    (again,) = import_source(polar, out, GIVEN, record_id="P2")
    assert again.pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=1e-3)
    assert sorted(path.name for path in (out / "tests").iterdir()) == ["P1.csv", "P2.csv"]


def test_tables_lie_beside_every_format(polar: Path) -> None:
    """A folder of a format and a table of its conditions is of that format, also of one that was added last."""
    table = "id;speed [km/h];front [kg];rear [kg]\nP1;56;950;750\n"
    write(polar.parent, {"conditions.csv": table.encode()})
    assert format_of(polar.parent) == "polar"
    assert [path.name for path in tables_of(polar.parent)] == ["conditions.csv"]
    (record,) = read_records(Reading(polar.parent, conditions=polar.parent / "conditions.csv"))
    assert record.condition.speed_mps == pytest.approx(56 / 3.6)
    assert record.channels[0].time_s[0] == pytest.approx(-50 * MS)
