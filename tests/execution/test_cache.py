"""The cache: what comes out is what went in, or nothing."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import make_dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import platformdirs
import pytest

from crashfuse.errors import Cancelled, UsageError
from crashfuse.execution.cache import Cache, finite, numbers, resume
from crashfuse.execution.progress import Progress, Watch
from crashfuse.version import versions
from tests.conftest import not_none


def test_what_was_kept_comes_back_to_the_bit(tmp_path: Path) -> None:
    cache = Cache(tmp_path)
    entry = {"a": np.random.default_rng(0).normal(size=(3, 4)).astype(np.float32), "text": np.array("äöü")}
    cache.put("kind", {"x": 1}, entry)
    found = not_none(cache.get("kind", {"x": 1}))
    assert found["a"].tobytes() == entry["a"].tobytes()
    assert str(found["text"]) == "äöü"


Few, Many = (make_dataclass(name, [("n", int, 3)], frozen=True) for name in ("Few", "Many"))
"""Settings of two kinds with the same parts."""


def test_every_part_of_a_key_counts_but_not_their_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = Cache(tmp_path)
    values = (1, 2, "1", 1.5, None, [1, 2], Few(), Few(4), Many(), [Few()], {"n": 3})
    parts: list[dict[str, object]] = [{"x": value} for value in values]
    keys: list[dict[str, object]] = [*parts, {}, {"y": 1}, {"x": 1, "y": 1}]
    for number, key in enumerate(keys):
        cache.put("kind", key, {"number": number})
    for number, key in enumerate(keys):
        found = not_none(Cache(tmp_path).get("kind", dict(reversed(key.items()))))
        assert int(found["number"]) == number
        assert cache.get("other", key) is None
    for name in ("crashfuse", "Python", "numpy", "scipy", "scikit-learn", "torch"):
        monkeypatch.setattr("crashfuse.execution.cache.versions", lambda name=name: {**versions(), name: "0.0"})
        assert cache.get("kind", keys[0]) is None
    with pytest.raises(TypeError, match=f"{type(tmp_path).__name__} cannot be part"):
        cache.get("kind", {"x": tmp_path})


def test_a_cache_knows_what_it_was_used_for(tmp_path: Path) -> None:
    """What was kept or found through it, by kind and file; not what was looked for in vain, or was there before."""
    first, second = Cache(tmp_path), Cache(tmp_path)
    first.put("one", {"x": 1}, {"a": 1.0})
    first.put("two", {"x": 1}, {"a": 1.0})
    assert second.used == set()
    assert second.get("one", {"x": 1}) is not None
    assert second.get("one", {"x": 2}) is None
    assert second.used == {f"one/{path.name}" for path in (tmp_path / "one").iterdir()}
    assert {name.partition("/")[0] for name in first.used} == {"one", "two"}
    first.drop("one", {"x": 1})
    assert Cache(tmp_path).get("one", {"x": 1}) is None
    assert list(first.pack(first.used)) == [f"two/{path.name}" for path in (tmp_path / "two").iterdir()]


def test_the_cache_lies_where_the_platform_keeps_them(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CRASHFUSE_CACHE", str(tmp_path))
    assert Cache().folder == tmp_path
    monkeypatch.delenv("CRASHFUSE_CACHE")
    assert Cache().folder == Path(platformdirs.user_cache_dir()) / "crashfuse"


def test_an_entry_in_the_place_of_another_is_damaged(tmp_path: Path) -> None:
    """Whole entries that were exchanged gave another approach's ratings; none is taken for another."""
    cache = Cache(tmp_path)
    paths = [cache.path(kind, {"x": x}) for kind in ("kind", "other") for x in (1, 2)]
    for number, path in enumerate(paths):
        cache.put(path.parent.name, {"x": number % 2 + 1}, {"number": number})
    contents = [path.read_bytes() for path in paths]
    for path, content in zip(paths, contents[1:] + contents[:1], strict=True):
        path.write_bytes(content)
    assert [cache.get(kind, {"x": x}) for kind in ("kind", "other") for x in (1, 2)] == [None] * 4


def _age(cache: Cache, x: int, hours: float) -> None:
    at = time.time() - 3600 * hours
    os.utime(cache.path("kind", {"x": x}), (at, at))


def _left(cache: Cache) -> list[int]:
    return [x for x in range(6) if cache.is_cached("kind", {"x": x})]


def test_what_was_not_used_for_longest_makes_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond the limit, but nothing of the last hour, nothing that this cache has used, and nothing of others."""
    monkeypatch.setenv("CRASHFUSE_CACHE_GIB", str(3.5e6 / 2**30))
    million = np.zeros(125_000)
    for x in range(5):
        Cache(tmp_path).put("kind", {"x": x}, {"a": million})
        _age(Cache(tmp_path), x, hours=10 - x)
    (tmp_path / "history").mkdir()
    (tmp_path / "history" / "a.json").write_bytes(bytes(5_000_000))
    assert _left(Cache(tmp_path)) == [2, 3, 4]
    assert Cache(tmp_path).get("kind", {"x": 2}) is not None  # used again
    for x, left in ((5, [2, 4, 5]), (0, [0, 2, 5]), (1, [0, 1, 2, 5])):  # the last ones are all of the last hour
        Cache(tmp_path).put("kind", {"x": x}, {"a": million})
        assert _left(Cache(tmp_path)) == left
    user = Cache(tmp_path)
    assert user.get("kind", {"x": 1}) is not None
    for x in (0, 1, 2, 5):
        _age(user, x, hours=2)
    user.put("kind", {"x": 3}, {"a": million})
    assert 1 in _left(user)
    assert (tmp_path / "history" / "a.json").exists()


@pytest.mark.parametrize("wrong", ["0", "-1", "nan", "much"])
def test_a_limit_that_is_none_is_wrong_usage(wrong: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CRASHFUSE_CACHE_GIB", wrong)
    with pytest.raises(UsageError, match="CRASHFUSE_CACHE_GIB"):
        Cache()


@pytest.mark.parametrize("position", [0, 100, -1])
def test_a_flipped_byte_is_noticed_and_removed(tmp_path: Path, position: int) -> None:
    cache = Cache(tmp_path)
    cache.put("kind", {"x": 1}, {"a": np.arange(50)})
    path = cache.path("kind", {"x": 1})
    content = bytearray(path.read_bytes())
    content[position] ^= 1
    for damaged in (content, content[:200], b"", b"\n", b"0" * 64 + b"\n", b"anything"):
        path.write_bytes(damaged)
        assert cache.get("kind", {"x": 1}) is None
        assert not path.exists()


def test_a_failed_write_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = Cache(tmp_path)
    cache.put("kind", {}, {"a": 1.0})

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    cache.put("kind", {}, {"a": 2.0})
    monkeypatch.undo()
    assert float(not_none(cache.get("kind", {}))["a"]) == 1.0
    assert len(list((tmp_path / "kind").iterdir())) == 1
    monkeypatch.setenv("CRASHFUSE_CACHE", str(tmp_path))
    lost = f"What was finished is lost: {tmp_path} cannot be written (No space left on device)"
    assert resume("it continues").startswith(lost)
    monkeypatch.setenv("CRASHFUSE_CACHE", str(tmp_path / "other"))
    assert resume("it continues") == "What was finished is in the cache: it continues"


def test_a_folder_that_cannot_be_written_is_no_obstacle(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").touch()
    cache = Cache(tmp_path / "file" / "cache")
    with cache.alone("kind", {}):
        cache.put("kind", {}, {"a": 1.0})
    assert cache.get("kind", {}) is None
    cache.drop("kind", {})
    Cache(cache.folder).put("kind", {}, {"a": 1.0})
    assert [record.levelname for record in caplog.records if record.levelname != "DEBUG"] == ["WARNING"]


def halves(cache: Cache, computed: list[int]) -> float:
    """A result that is computed as often as the list says."""

    def compute() -> tuple[float, dict[str, float]]:
        computed.append(1)
        time.sleep(0.05)
        return 0.5, {"half": 0.5}

    return cache.get_or_compute("kind", {"x": 1}, compute, lambda entry: float(entry["half"]))


def test_a_result_is_computed_once_and_then_restored(tmp_path: Path) -> None:
    computed: list[int] = []
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(lambda _: halves(Cache(tmp_path), computed), range(4))) == [0.5] * 4
    assert computed == [1]
    assert Cache(tmp_path).is_cached("kind", {"x": 1})
    assert not Cache(tmp_path).is_cached("kind", {"x": 2})


@pytest.mark.parametrize("wrong", [{}, {"other": 0.5}, {"half": np.array("a half")}, {"half": np.ones(3)}])
def test_a_whole_entry_with_wrong_content_is_computed_again(tmp_path: Path, wrong: dict[str, npt.ArrayLike]) -> None:
    """Its checksum is right, but the result cannot be restored from it: it is replaced, with a warning."""
    cache, computed = Cache(tmp_path), list[int]()
    cache.put("kind", {"x": 1}, wrong)
    with pytest.warns(UserWarning, match=r"A result \(kind\) could not be read back"):
        assert halves(cache, computed) == 0.5
    assert halves(cache, computed) == 0.5
    assert computed == [1]


def test_what_cannot_be_computed_leaves_nothing(tmp_path: Path) -> None:
    cache = Cache(tmp_path)

    def fail() -> tuple[float, dict[str, float]]:
        raise Cancelled("Stopped.")

    with pytest.raises(Cancelled):
        cache.get_or_compute("kind", {"x": 1}, fail, lambda _: 1.0)
    assert not list((tmp_path / "kind").iterdir())
    assert halves(cache, []) == 0.5


_HOLD = """
import sys, time
from pathlib import Path
from crashfuse.execution.cache import Cache
with Cache(Path(sys.argv[1])).alone("kind", {}):
    print("alone", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def holder(tmp_path: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Another process that computes the entry of an empty key."""
    command = [sys.executable, "-c", _HOLD, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"alone\n"
        yield process
        process.kill()


@pytest.mark.slow
def test_who_comes_second_waits_until_the_first_has_ended(tmp_path: Path, holder: subprocess.Popen[bytes]) -> None:
    cache, said = Cache(tmp_path), list[tuple[str, int, int]]()

    def end_it(progress: Progress) -> None:
        said.append((progress.step, progress.done, progress.total))
        holder.kill()

    with cache.alone("kind", {"other": 1}, Watch(end_it)):
        assert not said
    with cache.alone("kind", {}, Watch(end_it)):
        waiting = "Waiting for another process that computes the same"
        assert set(said[:-1]) == {(waiting, 0, 1)}
        assert said[-1] == (waiting, 1, 1)
    assert not list((tmp_path / "kind").iterdir())


@pytest.mark.usefixtures("holder")
@pytest.mark.slow
def test_waiting_can_be_cancelled_and_has_an_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cancel = threading.Event()
    cancel.set()
    with pytest.raises(Cancelled), Cache(tmp_path).alone("kind", {}, Watch(cancel=cancel)):
        pass
    monkeypatch.setattr("crashfuse.execution.cache._PATIENCE_S", 0.0)
    with Cache(tmp_path).alone("kind", {}):
        assert list((tmp_path / "kind").iterdir())  # the first one's lock is still there


def test_what_is_packed_can_be_unpacked_elsewhere(tmp_path: Path) -> None:
    """Only what was used; what is there is left alone, and damage on the way is noticed as ever."""
    here, there = Cache(tmp_path / "here"), Cache(tmp_path / "there")
    for number in range(3):
        here.put("kind", {"x": number}, {"a": np.arange(number)})
    later = Cache(here.folder)
    assert later.get("kind", {"x": 2}) is not None
    files = later.pack(later.used)
    assert len(files) == 1
    there.unpack(files)
    assert not_none(there.get("kind", {"x": 2}))["a"].tolist() == [0, 1]
    ((name, content),) = files.items()
    there.unpack({name: content[:-1]})
    assert there.get("kind", {"x": 2}) is not None
    damaged = Cache(tmp_path / "damaged")
    damaged.unpack({name: content[:-1]})
    assert damaged.get("kind", {"x": 2}) is None


@pytest.mark.parametrize("wrong", [np.ones(3), np.ones((2, 3)), np.array("text"), np.ones((3, 2), int), np.float64(1)])
def test_numbers_of_another_form_are_no_entry(wrong: npt.NDArray[np.float64]) -> None:
    with pytest.raises(ValueError, match="rated"):
        numbers({"rated": wrong}, "rated", None, 2)
    assert numbers({"rated": np.full((5, 2), np.nan)}, "rated", None, 2).shape == (5, 2)
    with pytest.raises(ValueError, match="rated: numbers without a value"):
        finite({"rated": np.full((5, 2), np.nan)}, "rated", 5, 2)
