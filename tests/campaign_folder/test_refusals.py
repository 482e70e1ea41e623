"""What is wrong with a campaign is said in sentences: with file, column, row, what was expected and what was found."""

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from crashfuse.campaign_folder.load import lay_out, load_campaign
from crashfuse.files.archive import zipped
from crashfuse.units import KPH, MPH, G
from tests.conftest import problems_of
from tests.golden import assert_golden


def edit(name: str, change: Callable[[pd.DataFrame], pd.DataFrame | None]) -> Callable[[Path], None]:
    """Change a CSV file of the folder in place."""

    def in_place(folder: Path) -> None:
        table = pd.read_csv(folder / name).astype(object)
        changed = change(table)
        (table if changed is None else changed).to_csv(folder / name, index=False)

    return in_place


def put(name: str, row: int, column: str, value: object) -> Callable[[Path], None]:
    """Put a value into a cell (0 is the first row of data)."""
    return edit(name, lambda table: table.__setitem__(column, [*table[column][:row], value, *table[column][row + 1 :]]))


def text(name: str, content: str | bytes) -> Callable[[Path], object]:
    """Write a file."""
    return lambda f: (f / name).write_bytes(content if isinstance(content, bytes) else content.encode())


def pulse(**columns: Callable[[pd.DataFrame], object]) -> Callable[[Path], None]:
    """Change columns of the first test's pulse."""
    return edit("tests/T1.csv", lambda t: t.assign(**columns))


def share(column: str, cell: str) -> Callable[[Path], None]:
    """Say something of a run's quality."""
    return edit("cae.csv", lambda t: t.assign(**{column: t.id.map({"C03": cell})}))


BAD: dict[str, Callable[[Path], object]] = {
    "no tests table": lambda f: (f / "tests.csv").unlink(),
    "missing column": edit("tests.csv", lambda t: t.drop(columns="rear_weight_lb")),
    "unknown unit": edit("cae.csv", lambda t: t.rename(columns={"speed_mph": "speed_knots"})),
    "two units": edit("cae.csv", lambda t: t.assign(speed_kph=1)),
    "pulse without unit": edit("tests/T1.csv", lambda t: t.rename(columns={"acceleration_g": "acceleration"})),
    "missing pulse": lambda f: (f / "tests" / "T3.csv").unlink(),
    "no pulses": lambda f: (f / "cae_pulses.parquet").unlink(),
    "a pulse twice": lambda f: pd.read_csv(f / "tests" / "T2.csv").to_parquet(f / "tests" / "T2.parquet"),
    "pulses twice": lambda f: (f / "cae").mkdir(),
    "duplicate id": put("tests.csv", 2, "id", "T1"),
    "id in other capitals": put("tests.csv", 1, "id", "t1"),
    "id that leaves the folder": put("tests.csv", 0, "id", "../T1"),
    "id that Windows cannot keep": put("tests.csv", 0, "id", "con"),
    "id that is a formula": put("cae.csv", 3, "id", "=1+1"),
    "id with a wild card": put("cae.csv", 3, "id", "C?3"),
    "factor that a terminal obeys": put("tests.csv", 0, "drive", "\x1b[2J"),
    "column twice": text("tests.csv", "id,speed_mph,id\nT1,20,T1\n"),
    "decimal commas": text("tests/T1.csv", "time_ms,acceleration_g\n0,0\n0,08,-1,5\n"),
    "semicolons": text("tests.csv", "id;speed_mph\nT1;20\n"),
    "UTF-16": text("tests/T1.csv", "time_ms,acceleration_g\n0,0\n".encode("utf-16")),
    "true and false": pulse(acceleration_g=lambda _: True),
    "beyond any vehicle": put("tests/T1.csv", 9, "acceleration_g", "-1e300"),
    "a weight in grams": edit("tests.csv", lambda t: t.assign(front_weight_lb=t.front_weight_lb * 1000)),
    "a nested column": lambda f: pq.write_table(
        pa.table({"id": ["C00"], "time_ms": [[1.0]], "acceleration_g": [0.0]}), f / "cae_pulses.parquet"
    ),
    "half a Parquet file": lambda f: text("cae_pulses.parquet", (f / "cae_pulses.parquet").read_bytes()[:-50])(f),
    "no Parquet": text("cae_pulses.parquet", "id,time_ms\n"),
    "a folder instead of a table": lambda f: (f / "tests.csv").rename(f / "old.csv").with_name("tests.csv").mkdir(),
    "a folder instead of settings": lambda f: (f / "campaign.toml").mkdir(),
    "an endless record": text("tests/T1.csv", "time_ms,acceleration_g\n" + "0,0\n" * 2_000_001),
    "text in a number": put("tests.csv", 1, "speed_mph", "fast"),
    "NaN in a table": put("cae.csv", 5, "front_weight_lb", "nan"),
    "empty cell in a pulse": put("tests/T2.csv", 10, "acceleration_g", None),
    "text in a pulse": put("tests/T2.csv", 10, "acceleration_g", "n/k"),
    "unsorted time": edit("tests/T1.csv", lambda t: pd.concat([t[:5], t[5:7][::-1], t[7:]])),
    "time twice": edit("tests/T1.csv", lambda t: pd.concat([t[:5], t[4:]])),
    "uneven time": edit("tests/T1.csv", lambda t: t.drop(index=100)),
    "short record": edit("tests/T1.csv", lambda t: t[t.time_ms < 50]),
    "milliseconds called seconds": edit("tests/T1.csv", lambda t: t.rename(columns={"time_ms": "time_s"})),
    "seconds called milliseconds": pulse(time_ms=lambda t: t.time_ms / 1000),
    "a pulse under another id": lambda f: (f / "tests" / "T3.csv").rename(f / "tests" / "TT3.csv"),
    "late start": edit("tests/T1.csv", lambda t: t[t.time_ms > 5]),
    "record that ends before the stop": edit(
        "tests/T4.csv",
        lambda t: t.assign(time_ms=1.4 * t.time_ms, acceleration_g=t.acceleration_g / 1.4)[t.time_ms < 45],
    ),
    "slow sampling": edit("tests/T1.csv", lambda t: t[::25]),
    "empty table": edit("tests.csv", lambda t: t[:0]),
    "empty pulse": edit("tests/T1.csv", lambda t: t[:0]),
    "empty file": text("tests/T1.csv", ""),
    "test at standstill": put("tests.csv", 0, "speed_mph", 0),
    "negative run speed": put("cae.csv", 0, "speed_mph", -1),
    "wrong sign": pulse(acceleration_g=lambda t: -t.acceleration_g),
    "m/s² called g": pulse(acceleration_g=lambda t: t.acceleration_g * G),
    "km/h called mph": edit("tests.csv", lambda t: t.assign(speed_mph=t.speed_mph / KPH * MPH)),
    "km/h called mph in the library": edit("cae.csv", lambda t: t.assign(speed_mph=t.speed_mph / KPH * MPH)),
    "few runs": edit("cae.csv", lambda t: t[:9]),
    "a table sorted by time": lambda f: (
        pd.read_parquet(f / "cae_pulses.parquet")
        .sort_values("time_ms", kind="stable")
        .to_parquet(f / "cae_pulses.parquet", index=False)
    ),
    **{
        f"{column} of {cell}": share(column, cell)
        for column, cells in {
            "hourglass_share": ("3.2", "-0.01"),
            "added_mass_share": ("n/a", "nan"),
            "energy_change": ("-1.5", "inf", "2 %"),
        }.items()
        for cell in cells
    },
}

SETTINGS = (
    *("channel_filter_class = sixty", "name = [1]", "channel_filter_class = 5000", 'channel_filter_class = "60 Hz"'),
    "channel_filter_class = 60\nfiltered_with = 60",
    *(f"cae_gap_mm = {value}" for value in ('"200"', "-1", "true", "nan", "20000")),
    *(f"unused = {value}" for value in ('["T9"]', '"T1"', "[1]", "{T1 = 1}", '["T1", "T2", "T3", "T4"]')),
    *(f"[occupant]\n{line}" for line in ("olc_restraint_mm = 0", "vpi_slack_mm = nan", 'olc_free_flight_mm = "65 mm"')),
    *("[occupant]\nolc_free_flight_mm = 0.065", "[occupant]\nrestraint = 200", "occupant = 3"),
    *(f'[cae_quality]\nlimits = "{text}' for text in ('din"', 'nchrp-179"\nenergy_change = 0.1')),
    *(
        f"[cae_quality]\n{line}"
        for line in ("hourglass_share = 10", "hourglass_share = true", "leave_out_failing = true")
    ),
    *(
        '[cae_quality]\nlimits = "nchrp-179"\nleave_out_failing = 1',
        "[cae_quality]\nhourglass = 0.1",
        "cae_quality = 3",
    ),
)

TABLE = b"id,speed_mph,front_weight_lb,rear_weight_lb\n"
TESTS, CAE = TABLE + b"T1,25,2000,1500\nT2,35,2000,1500\n", TABLE + b"C1,25,2000,1500\nB1,35,2000,1500\n"
PULSE = b"time_ms,acceleration_g\n0,0\n1,-1\n"
BOTH = (("tests.csv", TESTS), ("cae.csv", CAE))


def packed(*files: tuple[str, bytes], also: bool = True) -> list[tuple[str, bytes]]:
    """A zip of both tables and these files."""
    return [("c.zip", zipped(dict((*BOTH, *files) if also else files)))]


UPLOADS: dict[str, list[tuple[str, bytes]]] = {
    "nothing": [],
    "a zip beside a file": [*packed(), ("T1.csv", PULSE)],
    "two campaigns": packed(("a/tests.csv", TESTS), ("b/tests.csv", TESTS), also=False),
    "capitals": packed(("tests/T1.csv", PULSE), ("tests/t1.csv", PULSE)),
    "accents": packed(("tests/Ä.csv", PULSE), ("tests/A\u0308.csv", PULSE)),
    "a file twice": [*BOTH, ("tests.csv", TESTS)],
    "a pulse twice": packed(("T1.csv", PULSE), ("tests/T1.csv", PULSE)),
    "a pulse of two": [("tests.csv", TESTS), ("cae.csv", TESTS), ("T1.csv", PULSE)],
    "pulses alone": [("a.csv", PULSE), ("b.parquet", b"")],
    "programs alone": [("a.pdf", b""), ("b.pdf", b"")],
    "a zip in a zip": packed(("inner.zip", packed()[0][1]), also=False),
    "a path out of the folder": [*BOTH, ("../T1.csv", PULSE)],
    "no zip": [("c.zip", b"PK\x03\x04 not really")],
}
_VARIES = ("a damaged", "(at ", "Unclosed")  # what other packages say of a damaged file


def refusal(act: Callable[[], object]) -> list[str]:
    """The first sentences with which something is refused."""
    sentences = [str(problem) for problem in problems_of(lambda: act())]
    assert all(sentence.endswith(".") for sentence in sentences)
    return [told.partition(", found ")[0] if any(word in told for word in _VARIES) else told for told in sentences[:3]]


@pytest.mark.slow
def test_bad_input_gets_clear_sentences(campaign_on_disk: Path, tmp_path: Path) -> None:
    told = []
    for name, spoil in BAD.items():
        folder = shutil.copytree(campaign_on_disk, tmp_path / "campaign")
        spoil(folder)
        told += [f"{name}: {sentence}" for sentence in refusal(partial(load_campaign, folder))]
        shutil.rmtree(folder)
    assert_golden("bad_folders", told)


def test_settings_that_make_no_sense_are_refused(campaign_folder: Path) -> None:
    told = []
    for settings in SETTINGS:
        (campaign_folder / "campaign.toml").write_text(f"{settings}\n")
        told += [
            f"{' | '.join(settings.splitlines())}: {one}" for one in refusal(partial(load_campaign, campaign_folder))
        ]
    assert_golden("bad_settings", told)


def test_what_is_no_campaign_is_refused_and_nothing_stays(tmp_path: Path) -> None:
    told = []
    for name, uploads in UPLOADS.items():
        told += [f"{name}: {sentence}" for sentence in refusal(partial(lay_out, uploads, tmp_path))]
        assert not list(tmp_path.iterdir())
    assert_golden("bad_uploads", told)
