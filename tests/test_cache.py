"""The cache: what comes out is what went in, or nothing."""

from pathlib import Path

import numpy as np
import pytest

from crashfuse.cache import Cache


def test_what_was_kept_comes_back_to_the_bit(tmp_path: Path) -> None:
    """Arrays of any kind survive, text too."""
    cache = Cache(tmp_path)
    entry = {"a": np.random.default_rng(0).normal(size=(3, 4)).astype(np.float32), "text": np.array("äöü")}
    cache.put("kind", {"x": 1}, entry)
    found = cache.get("kind", {"x": 1})
    assert found is not None
    assert found["a"].tobytes() == entry["a"].tobytes()
    assert str(found["text"]) == "äöü"


def test_another_key_finds_nothing(tmp_path: Path) -> None:
    """Kind and every part of the key count."""
    cache = Cache(tmp_path)
    cache.put("kind", {"x": 1}, {"a": 1.0})
    assert cache.get("kind", {"x": 2}) is None
    assert cache.get("other", {"x": 1}) is None


@pytest.mark.parametrize("position", [0, 100, -1])
def test_a_flipped_byte_is_noticed_and_removed(tmp_path: Path, position: int) -> None:
    """A damaged entry is no entry."""
    cache = Cache(tmp_path)
    cache.put("kind", {"x": 1}, {"a": np.arange(50)})
    path = cache.path("kind", {"x": 1})
    content = bytearray(path.read_bytes())
    content[position] ^= 1
    path.write_bytes(content)
    assert cache.get("kind", {"x": 1}) is None
    assert not path.exists()


def test_a_cut_off_entry_is_no_entry(tmp_path: Path) -> None:
    """Half a file is noticed."""
    cache = Cache(tmp_path)
    cache.put("kind", {}, {"a": np.arange(50)})
    path = cache.path("kind", {})
    path.write_bytes(path.read_bytes()[:200])
    assert cache.get("kind", {}) is None


def test_nothing_is_unpickled(tmp_path: Path) -> None:
    """An object array cannot even be put in."""
    with pytest.raises(ValueError, match="allow_pickle"):
        Cache(tmp_path).put("kind", {}, {"a": np.array([object()])})


def test_a_failed_write_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A full disk costs nothing that was computed: the old entry stays, and no temporary file does."""
    cache = Cache(tmp_path)
    cache.put("kind", {}, {"a": 1.0})

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    cache.put("kind", {}, {"a": 2.0})
    monkeypatch.undo()
    found = cache.get("kind", {})
    assert found is not None
    assert float(found["a"]) == 1.0
    assert len(list((tmp_path / "kind").iterdir())) == 1
