"""Kill a study at random times, again and again, and check its results: ``python benchmarks/faults.py``.

Each study starts with an empty cache and is killed with SIGKILL at a random time within the duration of an undisturbed
one: all of its processes, the parent alone, or one worker (which the study must survive). Then the same command,
sometimes with ``--resume``, continues, and may be killed in turn. Its final output is compared with
that of the undisturbed study, byte by byte except for timings; leftover processes and files are counted.
"""

import argparse
import json
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import psutil

_WAYS = ("all processes", "the parent", "a worker")
_GRACE_S = 10.0  # for workers to notice that the parent is gone


def main() -> None:
    """Kill studies and print a Markdown table."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("campaign", type=Path, nargs="?", default=Path("sample_data"))
    arguments.add_argument("--kills", type=int, default=50)
    arguments.add_argument("--approach", nargs="+", default=["cae", "displacement_domain"])
    arguments.add_argument("--seed", type=int, default=0)
    given = arguments.parse_args()
    chance = random.Random(given.seed)  # noqa: S311
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        options = ["--approach", *given.approach, "--leave-out", "test", "--workers", "2"]
        start = time.monotonic()
        undisturbed = _Study(given.campaign, options, folder / "undisturbed", resume=False)
        if undisturbed.process.wait():
            raise SystemExit("The undisturbed study failed.")
        length = time.monotonic() - start
        expected = _results(folder / "undisturbed" / "out")
        kills, studies = 0, Counter[str]()
        outcomes = {way: Counter[str]() for way in _WAYS}
        while kills < given.kills:
            name, resume = f"study {sum(studies.values())}", False
            while True:
                study = _Study(given.campaign, options, folder / name, resume=resume)
                way = chance.choice(_WAYS)
                if kills < given.kills and study.lives(chance.uniform(0, length)):
                    kills += 1
                    outcomes[way].update([study.kill(way)])
                if study.process.wait() == 0:
                    break
                resume = (folder / name / "out" / "study.json").exists() and chance.random() < 0.5
                if kills == given.kills and study.process.returncode > 0:
                    break
            same = study.process.returncode == 0 and _results(folder / name / "out") == expected
            studies["the same files" if same else "other files"] += 1
            studies["with unfinished files left"] += any((folder / name).rglob(".unfinished-*"))
            studies["with locks left"] += any((folder / name).rglob("*.lock"))
            said = {way: dict(found) for way, found in outcomes.items()}
            print(f"{kills} kills: {said}; in the end: {dict(studies)}", file=sys.stderr)
    print(f"{kills} kills in {studies['the same files'] + studies['other files']} studies of {length:.0f} s\n")
    print("| killed | times | what became of it |\n|---|---:|---|")
    for way, found in outcomes.items():
        print(f"| {way} | {found.total()} | {'; '.join(f'{what}: {n}' for what, n in found.items())} |")
    print(f"\nIn the end: {'; '.join(f'{what}: {n}' for what, n in studies.items())}.")


class _Study:
    """A study as a user starts it, in its own process group and with its own cache."""

    def __init__(self, campaign: Path, options: list[str], folder: Path, *, resume: bool) -> None:
        folder.mkdir(exist_ok=True)
        command = [sys.executable, "-m", "crashfuse", "study", str(campaign), "--out", str(folder / "out"), *options]
        self._log = folder / "log.txt"
        with self._log.open("ab") as log:
            self.process = subprocess.Popen(
                command + ["--resume"] * resume,
                stdout=log,
                stderr=log,
                env={**os.environ, "CRASHFUSE_CACHE": str(folder / "cache")},
                start_new_session=True,
            )

    def lives(self, seconds: float) -> bool:
        """True if it is still running after this time."""
        try:
            self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            return True
        return False

    def kill(self, way: str) -> str:
        """Kill all or part of it; returns the outcome."""
        children = psutil.Process(self.process.pid).children(recursive=True)
        workers = [child for child in children if _is_worker(child)]
        if way == "a worker" and workers:
            random.choice(workers).kill()  # noqa: S311
            return "went on by itself" if self.process.wait() == 0 else f"gave up: {self._last_line()}"
        if way == "all processes":
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.kill()
        self.process.wait()
        _, alive = psutil.wait_procs(children, timeout=_GRACE_S)
        for child in alive:
            child.kill()
        where = f"with {len(workers)} workers" if workers else "before or after the workers"
        return f"killed {where}" + f", {len(alive)} processes stayed" * bool(alive)

    def _last_line(self) -> str:
        return self._log.read_text(errors="replace").strip().splitlines()[-1]


def _is_worker(process: psutil.Process) -> bool:
    try:
        return "popen_loky" in " ".join(process.cmdline())
    except psutil.Error:
        return False


def _results(folder: Path) -> dict[str, object]:
    """The output of a study, except timings and Plotly's random names."""
    found: dict[str, object] = {path.name: path.read_bytes() for path in folder.glob("*.csv")}
    found["study.json"] = _without_seconds(json.loads((folder / "study.json").read_text(encoding="utf-8")))
    report = (folder / "report.html").read_text(encoding="utf-8")
    report = re.sub(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", "", report)
    found["report.html"] = re.sub(r"prepare [\d.]+, held_out_tests [\d.]+", "", report)
    return found


def _without_seconds(value: object) -> object:
    if isinstance(value, dict):
        return {key: _without_seconds(part) for key, part in value.items() if key != "seconds"}
    return [_without_seconds(part) for part in value] if isinstance(value, list) else value


if __name__ == "__main__":
    main()
