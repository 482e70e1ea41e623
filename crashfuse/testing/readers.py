"""The contract of a reader: a sound file is recognised and read, anything else is refused in a sentence, and soon."""

import random
import time
import tracemalloc
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from crashfuse.errors import DataError
from crashfuse.files.archive import zipped
from crashfuse.importing import Choices, Reading, format_of, read_records, settle
from crashfuse.readers.formats import FORMATS, formats_of
from crashfuse.readers.record import PartialCondition, Record
from crashfuse.readers.vocabulary import ACCELERATION_UNITS
from crashfuse.units import KPH

_GIVEN = Choices(condition=PartialCondition(56 * KPH, front_weight_kg=950.0, rear_weight_kg=750.0))
_MOST_CPU_S, _LONGEST_SENTENCE, _MOST_MEMORY = 5.0, 1500, 256 << 20
_CUTS = (0.0, 1e-3, 0.01, 0.1, 0.3, 0.5, 0.9, 0.999)
_FOREIGN = (b"\x00" * 5000, b"PK\x03\x04" + bytes(500), "ä\n".encode() * 2000)


class ReaderContract:
    """What every reader promises: subclass it, and let pytest collect it."""

    format: ClassVar[str]  # its name, as its entry point has it
    files: ClassVar[Mapping[str, bytes]]  # a sound test or run, which stops from about 56 km/h, by the names of files
    claims: ClassVar[Mapping[str, bytes]] = {}  # with a header that declares far more; empty if none declares a size

    @pytest.mark.parametrize("packed", [False, True], ids=["folder", "zip"])
    def test_a_sound_file_is_recognised_and_read(self, tmp_path: Path, packed: bool) -> None:
        """In a folder or a zip, by its name alone; the record is whole, says how it was read, and gives a pulse."""
        source = written(tmp_path / "sound", self.files)
        if packed:
            source = written(tmp_path, {"sound.zip": zipped(self.files)}) / "sound.zip"
        assert format_of(source) == self.format
        (record,) = read_records(Reading(source))
        _check_record(record)
        assert np.isfinite(settle(record, _GIVEN, role="cae").pulse.accel_mps2).all()

    def test_capitals_of_names_make_no_difference(self) -> None:
        """Windows writes them one way, somebody else another."""
        for change in (str.upper, str.lower, str.title):
            assert formats_of([Path(change(name)) for name in self.files]) == [self.format]

    def test_nothing_at_all_is_refused(self, tmp_path: Path) -> None:
        """An empty folder, an empty zip, no folder, and files without a byte."""
        written(tmp_path, {"empty.zip": zipped({})})
        (tmp_path / "empty").mkdir()
        written(tmp_path / "hollow", dict.fromkeys(self.files, b""))
        for name in ("empty", "empty.zip", "nowhere", "hollow"):
            assert refusal(tmp_path / name, self.format)

    def test_foreign_bytes_under_its_name_are_refused(self, tmp_path: Path) -> None:
        """Renaming makes no test: whatever the bytes are, it is said that they are not of this format."""
        for content in _FOREIGN:
            assert refusal(written(tmp_path / "renamed", dict.fromkeys(self.files, content)), self.format)

    def test_damage_is_a_sentence_or_a_record(self, tmp_path: Path) -> None:
        """Bytes flipped, lost, doubled, anywhere: read, or refused with a DataError, and nothing else."""
        dice = random.Random(18571)  # noqa: S311 - no secret
        folder, names = written(tmp_path / "damaged", self.files), list(self.files)
        refused = 0
        for _ in range(40):
            name = dice.choice(names)
            broken = bytearray(self.files[name])
            head = min(len(broken), dice.choice((400, 4000, len(broken))))  # most of the form is at the beginning
            for _ in range(dice.choice((1, 5, 40))):
                at = dice.randrange(head)
                broken[at : at + dice.choice((0, 1, 1, 1, 9))] = dice.choice((b"", b"\n", dice.randbytes(1)))
            (folder / name).write_bytes(broken)
            refused += refusal(folder, self.format) != ""
            (folder / name).write_bytes(self.files[name])
        assert refused > 3

    def test_a_damaged_zip_is_a_sentence_or_a_record(self, tmp_path: Path) -> None:
        """Its directory as its data: read, or refused with a DataError, and nothing else."""
        dice = random.Random(6487)  # noqa: S311 - no secret
        sound, refused = zipped(self.files), 0
        for _ in range(30):
            broken = bytearray(sound)
            for _ in range(dice.choice((1, 5, 40))):
                broken[dice.randrange(max(0, len(broken) - 500) if dice.random() < 0.5 else 0, len(broken))] ^= 0x55
            (tmp_path / "t.zip").write_bytes(broken[: dice.choice((len(broken), dice.randrange(len(broken))))])
            refused += refusal(tmp_path / "t.zip", self.format) != ""
        assert refused > 3

    def test_wherever_a_file_ends_it_is_a_sentence_or_a_record(self, tmp_path: Path) -> None:
        """Cut in its header, in its numbers, a byte before its end; of no bytes at all nothing is read."""
        folder = written(tmp_path / "cut", self.files)
        for name, content in self.files.items():
            for share in _CUTS:
                (folder / name).write_bytes(content[: int(share * len(content))])
                assert refusal(folder, self.format) or share > 0 or len(self.files) > 1
            (folder / name).write_bytes(content[:-1])
            refusal(folder, self.format)
            (folder / name).write_bytes(content)

    def test_a_zip_bomb_is_refused(self, tmp_path: Path) -> None:
        """Names of the format over content that unpacks to a thousand times its size: never unpacked."""
        written(tmp_path, {"bomb.zip": zipped(dict.fromkeys(self.files, (b"1" * 4095 + b"\n") * (1 << 13)))})
        assert "zip bomb" in refusal(tmp_path / "bomb.zip", self.format)

    def test_claims_beyond_the_file_cost_nothing(self, tmp_path: Path) -> None:
        """Counts of 2^60, or more lines than any record has: refused before anything of that size is made."""
        if not self.claims:
            pytest.skip("nothing in this format declares a size")
        source = written(tmp_path / "huge", self.claims)
        tracemalloc.start()
        try:
            assert refusal(source, self.format)
            assert tracemalloc.get_traced_memory()[1] < _MOST_MEMORY
        finally:
            tracemalloc.stop()


def refusal(source: Path, fmt: str) -> str:
    """What is said against a source, a sentence for each problem, by the reader itself and soon; else empty."""
    began, sentences = time.process_time(), list[str]()
    try:
        for record in read_records(Reading(source, fmt)):
            settle(record, _GIVEN, role="cae")
    except DataError as error:
        sentences = [str(problem) for problem in error.problems]
    assert time.process_time() - began < _MOST_CPU_S
    assert all(one.endswith(".") and one.splitlines() == [one] and len(one) < _LONGEST_SENTENCE for one in sentences)
    fault = f"the reader of the package {FORMATS[fmt].package} failed"
    assert not any(fault in one for one in sentences), sentences
    return "\n".join(sentences)


def written(folder: Path, files: Mapping[str, bytes]) -> Path:
    """Files in a folder, by their paths in it; returns the folder."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder


def _check_record(record: Record) -> None:
    names = [channel.name for channel in record.channels]
    assert record.id
    assert "/" not in record.source
    assert len(names) == len(set(names)) > 0
    assert set(record.proposed) <= set(names)
    assert record.proposed
    for channel in record.channels:
        assert channel.time_s.shape == channel.values.shape
        assert channel.time_s.ndim == 1
        steps = np.diff(channel.time_s)
        np.testing.assert_allclose(steps, steps.mean(), rtol=0.01)
        assert steps.mean() > 0
        assert channel.unit is None or channel.unit in ACCELERATION_UNITS
    assert record.steps
    assert all(step.endswith(".") for step in record.steps)
