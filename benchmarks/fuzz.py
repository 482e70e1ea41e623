"""Damage files of every kind that crashfuse reads, and count what becomes of them: ``python -m benchmarks.fuzz``.

Sound files are flipped, cut, spliced and renumbered, in zips and workbooks also below the packing, and read in other
processes with bounded memory and time. Counted are files that gave the sound file's numbers, that gave others (damage
among samples cannot be told from samples), that were refused in sentences, and that ended otherwise: in a traceback, a
hang, no memory, a killed process. These are listed with the seed that repeats them
(``--only KIND --seed N --files 1``).
"""

import argparse
import hashlib
import io
import json
import random
import re
import resource
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.pulse_files import read_pulse
from crashfuse.certification.criteria import read_criteria
from crashfuse.errors import CrashfuseError, DataError
from crashfuse.files.archive import zipped
from crashfuse.importing import Reading, read_records, settle

Files = dict[str, bytes]
_START_S, _HANG_S, _MEMORY, _BATCH = 120, 20, 3 << 30, 500
_NUMBERS = b"0 -1 1e999 -1e308 nan inf 99999999999999999999 2147483648 4294967295 1e-320 0x10 1,5 1.5.2 -".split()
_JUNK = (b"\x00", b"\xff" * 8, b'"', b"\n", b"\r", b",", b";", b"=1+1", b"[" * 3000, b"1" * 5000, b"\x1b[2J")
_TEXT = re.compile(rb"[-+]?\d+\.?\d*([eE][-+]?\d+)?")
_BAD = ("traceback", "hang", "memory", "killed")


class _Hang(BaseException):
    """Nothing within the time limit."""


def main() -> None:
    """Fuzz every kind and print a Markdown table."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--files", type=int, default=2000, help="damaged files of each kind")
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--only", nargs="+")
    arguments.add_argument("--real", type=Path, help="a folder with a folder for each further test or run")
    arguments.add_argument("--sound", type=Path, help=argparse.SUPPRESS)
    given = arguments.parse_args()
    if given.sound:
        _work(given.only[0], _contents(given.sound), given.seed, given.files)
        return
    with tempfile.TemporaryDirectory() as scratch:
        sound = {kind: files for kind, files in _sound(given.real).items() if not given.only or kind in given.only}
        _fuzz({kind: _folder(files, Path(scratch, f"{at}")) for at, (kind, files) in enumerate(sound.items())}, given)


def _fuzz(sound: Mapping[str, Path], given: argparse.Namespace) -> None:
    print("| kind | files | as before | other numbers | refused | traceback | hang | memory | killed | slowest, s |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|", flush=True)
    listed = []
    for kind, folder in sound.items():
        found: Counter[str] = Counter()
        slowest, last = 0.0, given.seed + given.files
        for outcome, seconds, told in _outcomes(kind, folder, range(given.seed, last)):
            found[outcome] += 1
            slowest = max(slowest, seconds)
            if outcome in _BAD:
                listed.append(f"{kind}, {told}: {outcome}")
        counts = " | ".join(str(found[name]) for name in ("same", "other", "refused", *_BAD))
        print(f"| {kind} | {found.total()} | {counts} | {slowest:.1f} |", flush=True)
    print(*listed, sep="\n")


def _outcomes(kind: str, folder: Path, seeds: range) -> Iterator[tuple[str, float, str]]:
    """The outcome of each damaged file, the seconds it took, and what to say of it."""
    at = seeds.start
    while at < seeds.stop:
        count = min(_BATCH, seeds.stop - at)
        command = [sys.executable, "-m", "benchmarks.fuzz", "--only", kind, "--sound", str(folder)]
        command += ["--seed", str(at), "--files", str(count)]
        last = at + count
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
            signal.signal(signal.SIGALRM, lambda *_, process=process: process.kill())
            signal.alarm(_START_S)
            for line in process.stdout or ():
                signal.alarm(2 * _HANG_S)
                outcome, seconds, told = json.loads(line)
                yield outcome, seconds, f"seed {at}: {told}"
                at += 1
            signal.alarm(0)
        if at < last:
            yield "killed", 0.0, f"seed {at}: exit code {process.returncode}"
            at += 1


def _work(kind: str, files: Files, first: int, count: int) -> None:
    """Read damaged files one after the other; a line of JSON for each."""
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    warnings.simplefilter("error")
    warnings.filterwarnings("ignore", category=DeprecationWarning)

    def stop(*_: object) -> None:
        raise _Hang

    signal.signal(signal.SIGALRM, stop)
    read = _READ.get(kind, _imported)
    with tempfile.TemporaryDirectory() as scratch:
        before = _outcome(read, _source(files, Path(scratch, "sound")))
        if not before[0].startswith("read"):
            raise SystemExit(f"{kind}: the sound file cannot be read: {before}")
        for seed in range(first, first + count):
            place = _source(_damaged(files, random.Random(f"{kind} {seed}")), Path(scratch, "damaged"))  # noqa: S311
            start = time.perf_counter()
            outcome, told = _outcome(read, place)
            if outcome.startswith("read"):
                outcome = "same" if outcome == before[0] else "other"
            print(json.dumps([outcome, time.perf_counter() - start, told]), flush=True)


def _outcome(read: Callable[[Path], bytes], place: Path) -> tuple[str, str]:
    signal.alarm(_HANG_S)
    try:
        return f"read {hashlib.sha256(read(place)).hexdigest()}", ""
    except DataError as error:
        odd = [str(p) for p in error.problems if len(str(p)) > 1500 or not str(p).endswith(".") or "\n" in str(p)]
        return ("traceback", f"no sentence: {odd[0][:300]}") if odd else ("refused", "")
    except CrashfuseError:
        return "refused", ""
    except _Hang:
        return "hang", ""
    except MemoryError:
        return "memory", ""
    except Exception as error:
        frames = traceback.extract_tb(error.__traceback__)
        places = " < ".join(f"{Path(frame.filename).name}:{frame.lineno}" for frame in reversed(frames[-5:]))
        return "traceback", f"{type(error).__name__}: {str(error)[:150]} at {places}"
    finally:
        signal.alarm(0)


def _imported(place: Path) -> bytes:
    from tests.importing.crashes import GIVEN

    records = read_records(Reading(place))
    pulses = [settle(record, GIVEN, role="cae").pulse for record in records]
    return b"".join(pulse.time_s.tobytes() + pulse.accel_mps2.tobytes() for pulse in pulses)


def _loaded(place: Path) -> bytes:
    return load_campaign(place).fingerprint.encode()


_READ: dict[str, Callable[[Path], bytes]] = {
    "campaign": _loaded,
    "campaign, CSV": _loaded,
    "pulse, CSV": lambda place: read_pulse(place / "p.csv").accel_mps2.tobytes(),
    "pulse, Parquet": lambda place: read_pulse(place / "p.parquet").accel_mps2.tobytes(),
    "criteria": lambda place: repr(read_criteria(place / "criteria.toml")).encode(),
}


def _sound(real: Path | None) -> dict[str, Files]:
    """Sound files by kind: those of the tests, and others from a folder."""
    import openpyxl
    import pandas as pd

    from tests.readers.test_contract import EVERY, GOOD

    kinds = {f"{fmt}, {next(iter(files))}": files for fmt, files in EVERY}
    kinds |= {f"{fmt}, zip": {"t.zip": zipped(files)} for fmt, files in GOOD.items()}
    text = GOOD["csv"]["T1.csv"].decode("cp1252", "replace")
    rows = [[_cell(cell) for cell in line.split(";")] for line in text.splitlines() if ";" in line]
    book, stream = openpyxl.Workbook(), io.BytesIO()
    sheet = book.create_sheet("Pulse", 0)
    for row in rows[:400]:
        sheet.append(row)
    book.save(stream)
    kinds["workbook"] = {"T1.xlsx": stream.getvalue()}
    campaign = _campaign()
    kinds["campaign"] = campaign
    pulses = pd.read_parquet(io.BytesIO(campaign["cae_pulses.parquet"]))
    as_text = {name: content for name, content in campaign.items() if name != "cae_pulses.parquet"}
    kinds["campaign, CSV"] = {**as_text, "cae_pulses.csv": pulses.to_csv(index=False, float_format="%.4g").encode()}
    pulse = next(content for name, content in campaign.items() if name.startswith("tests/"))
    kinds["pulse, CSV"] = {"p.csv": pulse}
    stream = io.BytesIO()
    pd.read_csv(io.BytesIO(pulse)).to_parquet(stream, index=False)
    kinds["pulse, Parquet"] = {"p.parquet": stream.getvalue()}
    kinds["criteria"] = {"criteria.toml": b'confidence = 0.9\n[[criterion]]\nmetric = "max_crush"\nat_most = 650.0\n'}
    for folder in sorted(path for path in (real.iterdir() if real else ()) if path.is_dir()):
        files = _contents(folder)
        if files and sum(map(len, files.values())) < 8 << 20:
            kinds[f"real, {folder.name}"] = files
    return kinds


def _campaign() -> Files:
    """The sample campaign with a tenth of its CAE runs."""
    import pandas as pd

    from crashfuse.synthetic.sample import write_sample

    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch, "sample")
        write_sample(folder)
        runs = pd.read_csv(folder / "cae.csv", dtype={"id": str}).iloc[::10]
        runs.to_csv(folder / "cae.csv", index=False)
        pulses = pd.read_parquet(folder / "cae_pulses.parquet")
        pulses[pulses["id"].astype(str).isin(runs["id"])].to_parquet(folder / "cae_pulses.parquet", index=False)
        return _contents(folder)


def _cell(text: str) -> object:
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return text


def _folder(files: Files, folder: Path) -> Path:
    """A folder with these files alone."""
    shutil.rmtree(folder, ignore_errors=True)
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return folder


def _contents(folder: Path) -> Files:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def _source(files: Files, folder: Path) -> Path:
    """The files in a folder; the file itself where it is a zip or a workbook."""
    (only, *more) = files
    return _folder(files, folder) / (only if not more and only.endswith((".zip", ".xlsx")) else "")


def _damaged(files: Files, dice: random.Random) -> Files:
    """The files with one of them damaged; in a zip, often one of its members, packed anew."""
    name = dice.choice(list(files))
    content = files[name]
    if content[:4] == b"PK\x03\x04" and dice.random() < 0.7:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = {info.filename: archive.read(info) for info in archive.infolist()}
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
            for member, inner in _damaged(members, dice).items():
                archive.writestr(member, inner)
        return {**files, name: stream.getvalue()}
    for _ in range(dice.choice((1, 1, 2, 8))):
        content = dice.choice(_WAYS)(content, dice) if content else content
    return {**files, name: content}


def _place(content: bytes, dice: random.Random) -> int:
    """A place in a file, often in its head or its tail: most of its form is there."""
    near = dice.randrange(min(len(content), 500))
    return dice.choice((dice.randrange(len(content)), near, len(content) - 1 - near))


def _flip(content: bytes, dice: random.Random) -> bytes:
    at = _place(content, dice)
    return content[:at] + bytes([content[at] ^ 1 << dice.randrange(8)]) + content[at + 1 :]


def _cut(content: bytes, dice: random.Random) -> bytes:
    at = _place(content, dice)
    return dice.choice((content[:at], content[at:], content[:at] + content[at + dice.randrange(1, 2000) :]))


def _splice(content: bytes, dice: random.Random) -> bytes:
    one, two = _place(content, dice), _place(content, dice)
    part = content[two : two + dice.choice((1, 8, 100, 5000))] * dice.choice((1, 1, 2, 50))
    return content[:one] + part + content[one + dice.choice((0, len(part))) :]


def _renumber(content: bytes, dice: random.Random) -> bytes:
    """Another number in text."""
    at = _place(content, dice)
    found = _TEXT.search(content, at, at + 300)
    return content[: found.start()] + dice.choice(_NUMBERS) + content[found.end() :] if found else _flip(content, dice)


def _repack(content: bytes, dice: random.Random) -> bytes:
    """Another binary number."""
    kind = dice.choice(("<i", ">i", "<q", "<d", "<f", ">f", "<H", "B"))
    extremes = {"i": (-1, 0, 2**31 - 1, -(2**31), 65536), "q": (-1, 2**63 - 1, 0), "H": (0, 65535), "B": (0, 255)}
    value = dice.choice(extremes.get(kind[-1], (float("nan"), float("inf"), 1e300 if kind == "<d" else 1e38, -0.0)))
    at = _place(content, dice)
    return content[:at] + struct.pack(kind, value) + content[at + struct.calcsize(kind) :]


def _sprinkle(content: bytes, dice: random.Random) -> bytes:
    at = _place(content, dice)
    return content[:at] + dice.choice(_JUNK) + content[at:]


_WAYS = (_flip, _flip, _cut, _splice, _renumber, _renumber, _repack, _repack, _sprinkle)


if __name__ == "__main__":
    main()
