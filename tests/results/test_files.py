"""A folder of results holds what was last written to it, whatever stood there before."""

from pathlib import Path

import pytest

from crashfuse.errors import UsageError
from crashfuse.results.comparison import read_study
from crashfuse.results.files import replaced
from tests.conftest import content_of

OLD = ("scores.csv", "speed_groups.csv", "cae_events.csv", "study.json")
PULSES = ("lsdyna/25mph/fused_25mph_expected.k", "isomme/cae_56kph_expected/Channel/cae_56kph_expected.001")
FOREIGN = ("notes.txt", "lsdyna/notes.txt", "lsdyna/sled.k")


def write(folder: Path, *names: str) -> None:
    """Files of these names."""
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"")


@pytest.mark.parametrize(
    ("kind", "old", "new"),
    [
        ("study", OLD, ("scores.csv", "study.json")),
        ("sweep", (*PULSES, "sweep.csv"), ("lsdyna/26mph/fused_26mph_expected.k", "sweep.csv")),
    ],
)
def test_a_smaller_result_leaves_nothing_of_a_larger_one(
    kind: str, old: tuple[str, ...], new: tuple[str, ...], tmp_path: Path
) -> None:
    """Files and folders that it has no more go; those of another kind of result and a stranger's stay."""
    write(tmp_path, *old, *FOREIGN, "next_tests.csv")
    with replaced(kind, tmp_path) as folder:
        write(folder, *new)
        assert {*content_of(tmp_path)} >= {*old}
    assert {*content_of(tmp_path)} == {*new, *FOREIGN, "next_tests.csv"}
    assert not (tmp_path / "isomme").exists()


@pytest.mark.parametrize("step", ["unlink", "replace"])
def test_no_record_stands_beside_files_of_another_result(
    step: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the machine stops between two files there is no study, until it is written again."""
    write(tmp_path, *OLD)
    act, done = getattr(Path, step), list[Path]()

    def stop(self: Path, *args: object, **kwargs: object) -> object:
        if done:
            raise KeyboardInterrupt
        done.append(self)
        return act(self, *args, **kwargs)

    with pytest.raises(KeyboardInterrupt), replaced("study", tmp_path) as folder:  # noqa: PT012
        write(folder, "scores.csv", "metrics.csv", "study.json")
        monkeypatch.setattr(Path, step, stop)
    monkeypatch.undo()
    with pytest.raises(UsageError, match="no study"):
        read_study(tmp_path)
    with replaced("study", tmp_path) as folder:
        write(folder, "scores.csv", "study.json")
    assert not (tmp_path / "speed_groups.csv").exists()
