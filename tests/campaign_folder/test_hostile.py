"""Campaigns spoilt in any way: one clear sentence a fault, and no traceback, no hang, no flood of memory.

The corruptions are drawn by hypothesis, the same ones each time. ``CRASHFUSE_HOSTILE_EXAMPLES=5000`` draws that many
new ones instead.
"""

import io
import os
import shutil
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from crashfuse import cli
from crashfuse.campaign_folder.condition_tables import read_candidates
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.pulse_files import read_pulse
from crashfuse.errors import DataError

pytestmark = pytest.mark.slow

MORE = os.environ.get("CRASHFUSE_HOSTILE_EXAMPLES")
hostile = settings(
    max_examples=int(MORE or 60),
    derandomize=MORE is None,
    deadline=5000,  # ms: a hang
    database=None,
    phases=(Phase.generate, Phase.shrink) if MORE else (Phase.generate,),
    suppress_health_check=list(HealthCheck),
)

FILES = (
    *("tests.csv", "cae.csv", "tests/T1.csv", "tests/T4.csv", "cae_pulses.parquet", "cae_pulses.csv"),
    "campaign.toml",
)
TABLES = tuple(name for name in FILES if name.endswith(".csv"))
CELLS = (
    *("", " ", "nan", "NaN", "inf", "-inf", "1e308", "-1e300", "1e400", "1e-320", "0x1F", "1,5", "1.234,5", "1_000"),
    *("1d5", "١٢", "１２", "½", "−5", "True", "None", "NA", "#REF!", "=1+1", "@SUM(A1)", "-", "+", "1 2", "12 mph"),
    *("1" * 400, "../x", "a/b", "..", "CON", "nul.txt", "x" * 300, "a\\b", "C:", "T1.", " T1", "T1 ", "t1"),
    *("\x1b[31mred", "\x07", "\u202e", "\0", '"', '"a', 'a"b', "'", "a\nb", "a\rb", "\u2028", "\u00a0", "é", "名"),
    *("\ufeff", "🚗", "x" * 200_000, "{x}", "%s"),
)
HEADERS = (
    *("", "id", "speed_mph", "speed_kph", "speed_knots", "time_ms", "time_s", "time", "acceleration_mps2"),
    "front_weight_kg",
)
TOML = (
    *('name = "\\u001b[31m"', "name = [1, 2]", 'name = "' + "x" * 10_000 + '"', "name = " + "[" * 5000),
    *("name = 1" + "0" * 5000, *(f"channel_filter_class = {value}" for value in ("nan", "1e999", "1000", "true"))),
    *("channel_filter_class = 1" + "0" * 400, "channel_filter_class = 60\nfiltered_with = 60", '"\\u0007\\n" = 1'),
    *("imported = 3", "notice = 2001-01-01", "a" + ".a" * 3000 + " = 1", "name = 1\nname = 2"),
)


Rows = list[list[str]]


def _lines(path: Path, changed: Callable[[Rows], Rows]) -> None:
    rows = changed([line.split(",") for line in path.read_bytes().decode("utf-8", "replace").split("\n")])
    path.write_bytes("\n".join(",".join(row) for row in rows).encode("utf-8", "surrogatepass"))


def _cell(path: Path, row: int, column: int, value: str, times: int) -> None:
    def changed(rows: Rows) -> Rows:
        for cells in rows[row : row + (times if len(value) < 1000 else 1)]:
            cells[column % len(cells)] = value
        return rows

    _lines(path, changed)


ROWS: dict[str, Callable[[Rows, int], Rows]] = {
    "twice": lambda rows, at: [*rows[:at], rows[at], *rows[at:]],
    "gone": lambda rows, at: [*rows[:at], *rows[at + 3 :]],
    "reversed": lambda rows, _: [rows[0], *rows[:0:-1]],
    "by time": lambda rows, _: [rows[0], *sorted(rows[1:], key=lambda cells: cells[-2:])],
    "longer": lambda rows, at: [*rows[:at], [*rows[at], "7"], *rows[at + 1 :]],
    "all longer": lambda rows, _: [[*cells, ""] for cells in rows],
    "shorter": lambda rows, at: [*rows[:at], rows[at][:-1], *rows[at + 1 :]],
    "blank": lambda rows, at: [*rows[:at], [""], [" "], ["", "", ""], *rows[at:]],
    "no header": lambda rows, _: rows[1:],
    "header twice": lambda rows, at: [*rows[:at], rows[0], *rows[at:]],
    "columns twice": lambda rows, _: [cells * 2 for cells in rows],
    "a thousand columns": lambda rows, _: [cells[:3] * 400 for cells in rows[:60]],
    "no rows": lambda rows, _: rows[:1],
}


def _rows(path: Path, way: str, row: int) -> None:
    _lines(path, lambda rows: ROWS[way](rows, row % len(rows)))


BYTES: dict[str, Callable[[bytes, int, bytes], bytes]] = {
    "cut": lambda content, at, _: content[:at],
    "flip": lambda content, at, _: (
        content[:at] + bytes(byte ^ 1 << (at % 8) for byte in content[at : at + 1]) + content[at + 1 :]
    ),
    "insert": lambda content, at, junk: content[:at] + junk + content[at:],
    "replace": lambda _content, _at, junk: junk,
    "shift": lambda content, at, _: content[at:],
    "tail": lambda content, at, _: content[: -min(len(content), 1 + at % 300)],
}


def _bytes(path: Path, way: str, where: float, junk: bytes) -> None:
    content = path.read_bytes()
    path.write_bytes(BYTES[way](content, int(where * len(content)), junk))


def _encoded(path: Path, encoding: str, newline: str) -> None:
    text = path.read_bytes().decode("utf-8", "replace").replace("\n", newline)
    path.write_bytes(text.encode(encoding, "replace"))


INSTEAD: dict[str, Callable[[Path], object]] = {
    "folder": Path.mkdir,
    "loop": lambda path: path.symlink_to(path),
    "dangling": lambda path: path.symlink_to("/nowhere/at/all"),
    "device": lambda path: path.symlink_to("/dev/zero"),
    "pipe": os.mkfifo,
    "home": lambda path: path.symlink_to("/"),
    "gone": lambda _: None,
}


def _instead(path: Path, what: str) -> None:
    path.unlink()
    INSTEAD[what](path)


def _extra(path: Path, content: bytes) -> None:
    if not path.exists():
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)


def _setting(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


ARRAYS: dict[str, Callable[[int], Any]] = {
    "struct": lambda n: pa.array([{"a": 1.0}] * n),
    "list": lambda n: pa.array([[1.0]] * n),
    "map": lambda n: pa.array([[("a", 1)]] * n, pa.map_(pa.string(), pa.int64())),
    "bool": lambda n: pa.array([True] * n),
    "time": lambda n: pa.array(np.arange(n), pa.timestamp("ns")),
    "duration": lambda n: pa.array(np.arange(n), pa.duration("ns")),
    "binary": lambda n: pa.array([b"\xff"] * n),
    "null": lambda n: pa.nulls(n),
    "large text": lambda n: pa.array(["x" * 1000] * n, pa.large_string()),
    "decimal": lambda n: pa.array(np.arange(n) % 7).cast(pa.decimal128(38, 2)),
    "int": lambda n: pa.array(np.arange(n) * 10**12),
    "half": lambda n: pa.array(np.full(n, 1e4, np.float16)),
    "category": lambda n: pa.array(["a", None, "b", ""] * (n // 4) + ["a"] * (n % 4)).dictionary_encode(),
    "nan": lambda n: pa.array(np.full(n, np.nan)),
    "huge": lambda n: pa.array(np.full(n, -1e300)),
}
TYPES = (*ARRAYS, "text", "twice", "gone", "index")


def _typed(path: Path, column: str, kind: str) -> None:
    try:
        table = pq.read_table(path)
    except (pa.ArrowException, OSError):
        return
    if table.column_names.count(column) != 1:
        return
    if kind == "twice":
        table = table.append_column(column, table.column(column))
    elif kind == "gone":
        table = table.drop_columns([column])
    elif kind == "index":  # as pandas notes it in the file
        frame = pd.DataFrame({name: np.arange(9) for name in ("id", "time_ms", "acceleration_g")})
        table = pa.Table.from_pandas(frame.set_index(column))
    else:
        values = table.column(column).to_pylist()
        array = pa.array([*map(str, values)]) if kind == "text" else ARRAYS[kind](len(values))
        table = table.set_column(table.schema.get_field_index(column), column, array)
    pq.write_table(table, path)


Corruption = tuple[Callable[..., None], tuple[Any, ...]]  # a file, and how it is spoilt


def one(spoil: Callable[..., None], *arguments: st.SearchStrategy[Any]) -> st.SearchStrategy[Corruption]:
    """A corruption of one kind."""
    return st.tuples(st.just(spoil), st.tuples(*arguments))


NAMES = (
    *("T1.parquet", "T9.csv", "CON.csv", "a;b.csv", "\x1b.csv", "x" * 200 + ".csv", "=1.csv", "T1.CSV", ".hidden"),
    "T5.csv",
)
EXTRA = (*(f"tests/{name}" for name in NAMES), "tests_pulses.csv", "cae/C1.csv")
JUNK = (b"PAR1" * 3, b"\xff" * 50, b"\0" * 9, b'"', b"PK\3\4")
ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-32", "latin-1", "ascii", "cp037")
any_of, column, row = st.sampled_from, st.integers(0, 5), st.integers(0, 1300)
nasty = st.one_of(any_of(CELLS), st.text(max_size=30), st.floats().map(repr))
corruption = st.one_of(
    one(_cell, any_of(TABLES), row, column, nasty, any_of((1, 1, 30, 2000))),
    one(_cell, any_of(("tests.csv", "cae.csv")), st.integers(1, 4), column, nasty, st.just(1)),
    one(_cell, any_of(TABLES), st.just(0), column, st.one_of(any_of(HEADERS), nasty), st.just(1)),
    one(_rows, any_of(TABLES), any_of([*ROWS]), row),
    one(_bytes, any_of(FILES), any_of(["flip", *BYTES]), st.floats(0, 1), st.binary(max_size=40) | any_of(JUNK)),
    one(_encoded, any_of(TABLES), any_of(ENCODINGS), any_of(("\n", "\r\n", "\r", "\n\n", "\u2028"))),
    one(_instead, any_of(FILES), any_of([*INSTEAD])),
    one(_extra, any_of(EXTRA), st.binary(max_size=20)),
    one(_setting, st.just("campaign.toml"), st.one_of(any_of(TOML), st.text(max_size=60))),
    one(_typed, st.just("cae_pulses.parquet"), any_of(("id", "time_ms", "acceleration_g")), any_of(TYPES)),
)


@contextmanager
def spoilt(sound: Path, corruptions: list[Corruption]) -> Iterator[Path]:
    """A copy of a campaign with these corruptions, in a place of its own where nothing else may appear."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "campaign"
        shutil.copytree(sound, folder)
        for spoil, (name, *arguments) in corruptions:
            path = folder / name
            if not path.is_symlink() and (path.is_file() or spoil in (_extra, _setting)):
                spoil(path, *arguments)
        before = sorted(Path(place).rglob("*"))
        yield folder
        assert sorted(Path(place).rglob("*")) == before


def assert_sentences(error: DataError) -> None:
    """Each problem is one line of a few hundred printable characters that says all there is to say; few of a kind."""
    assert 1 <= len(error.problems) < 400
    for problem in error.problems:
        text = str(problem)
        assert text.replace("\u00a0", " ").isprintable(), ascii(text)
        assert len(text) < 1500
        assert text.endswith(".")
        assert all((problem.where, problem.expected, problem.found, problem.advice)), text


@pytest.fixture(scope="module")
def sound(campaign_on_disk: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The small campaign with its CAE pulses as Parquet, and as CSV."""
    text = tmp_path_factory.mktemp("text") / "campaign"
    shutil.copytree(campaign_on_disk, text)
    table = pq.read_table(text / "cae_pulses.parquet").to_pandas()
    table.to_csv(text / "cae_pulses.csv", index=False, float_format="%.5g")
    (text / "cae_pulses.parquet").unlink()
    return campaign_on_disk, text


@hostile
@given(corruptions=st.lists(corruption, min_size=1, max_size=3), as_text=st.booleans())
def test_a_spoilt_campaign_is_loaded_or_refused_in_sentences(
    sound: tuple[Path, Path], corruptions: list[Corruption], as_text: bool
) -> None:
    """Whatever was done to the files: a DataError that says all, or a campaign of finite numbers; never a warning."""
    with spoilt(sound[as_text], corruptions) as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            campaign = load_campaign(folder)
        except DataError as error:
            assert_sentences(error)
            return
    assert np.isfinite(campaign.cae.accel_mps2).all()
    assert all(np.isfinite(test.pulse.accel_mps2).all() for test in campaign.tests)
    for text in (campaign.name, campaign.notice, *campaign.test_ids, *campaign.cae.ids, *campaign.warnings):
        assert text.replace("\u00a0", " ").isprintable(), ascii(text)
    assert campaign.fingerprint


@hostile
@given(corruptions=st.lists(corruption, min_size=1, max_size=3))
def test_a_check_of_a_spoilt_campaign_ends_with_0_or_1(sound: tuple[Path, Path], corruptions: list[Corruption]) -> None:
    out, err = io.StringIO(), io.StringIO()
    with spoilt(sound[0], corruptions) as folder, redirect_stdout(out), redirect_stderr(err):
        code = cli.main(["check", str(folder)])
    assert code in (cli.DONE, cli.WRONG_DATA)
    assert (out if code == cli.DONE else err).getvalue()
    for line in (out.getvalue() + err.getvalue()).split("\n"):
        assert line.replace("\u00a0", " ").isprintable(), ascii(line)
    if code == cli.WRONG_DATA:
        assert err.getvalue().endswith((" problem found.\n", " problems found.\n"))


@hostile
@given(corruptions=st.lists(corruption, min_size=1, max_size=3))
def test_spoilt_pulses_and_candidates_are_read_or_refused_in_sentences(
    sound: tuple[Path, Path], corruptions: list[Corruption]
) -> None:
    """As the campaign: what `rate` and `next-test` take."""
    with spoilt(sound[0], corruptions) as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        names = {"tests/T1.csv": read_pulse, "cae_pulses.parquet": read_pulse, "tests.csv": read_candidates}
        for name, read in names.items():
            try:
                read(folder / name)
            except DataError as error:
                assert_sentences(error)


def test_more_candidates_than_anyone_can_look_at_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "candidates.csv"
    rows = "".join(f"A{i},25,2000,1500\n" for i in range(1001))
    path.write_text(f"id,speed_mph,front_weight_lb,rear_weight_lb\n{rows}")
    with pytest.raises(DataError, match=r"candidates.csv: .*most 1000 candidates, found 1001; leave some out"):
        read_candidates(path)


def test_files_that_would_fill_the_memory_are_refused_early(tmp_path: Path) -> None:
    """Endless lines, cells and records: each is refused within 5 s and 1 GiB."""
    command = [sys.executable, str(Path(__file__).with_name("greedy_files.py")), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
