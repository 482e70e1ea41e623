"""A folder of results holds what was last written to it, whatever stood there before."""

from collections.abc import Callable
from pathlib import Path

import pytest

from crashfuse.errors import UsageError
from crashfuse.reporting.past_results import read_study
from crashfuse.reporting.results import replaced
from tests.conftest import content_of

OLD = {"scores.csv", "speed_groups.csv", "cae_events.csv", "study.json"}
FOREIGN = {"notes.txt", "lsdyna/notes.txt", "lsdyna/sled.k"}


def write(folder: Path, *names: str) -> None:
    """Files of these names, which say where they stand."""
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(folder.name, encoding="utf-8")


def test_a_smaller_result_leaves_nothing_of_a_larger_one(tmp_path: Path) -> None:
    """Files that it has no more go; those of another kind of result and a stranger's stay."""
    write(tmp_path, *OLD, *FOREIGN, "sweep.csv")
    with replaced("study", tmp_path) as folder:
        write(folder, "scores.csv", "study.json")
        assert (tmp_path / "study.json").read_text(encoding="utf-8") == tmp_path.name  # nothing is touched before
    assert set(content_of(tmp_path)) == {"scores.csv", "study.json", "sweep.csv", *FOREIGN}
    assert (tmp_path / "scores.csv").read_text(encoding="utf-8") == folder.name


def test_pulses_of_approaches_and_speeds_that_are_not_written_again_go(tmp_path: Path) -> None:
    """By format and speed, with the folders that they leave empty; a stranger's file beside them stays."""
    older = {"lsdyna/25mph/fused_25mph_expected.k", "isomme/cae_56kph_expected/Channel/cae_56kph_expected.001"}
    write(tmp_path, *older, *FOREIGN, "sweep.csv")
    with replaced("sweep", tmp_path) as folder:
        write(folder, "lsdyna/26mph/fused_26mph_expected.k", "sweep.csv")
    assert set(content_of(tmp_path)) == {"lsdyna/26mph/fused_26mph_expected.k", "sweep.csv", *FOREIGN}
    assert {path.name for path in tmp_path.rglob("*") if path.is_dir()} == {"lsdyna", "26mph"}


@pytest.mark.parametrize("step", ["unlink", "replace"])
def test_no_record_stands_beside_files_of_another_result(
    step: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the machine stops between two files there is no study, until it is written again."""
    write(tmp_path, *OLD)
    done: list[Path] = []

    def stopping(act: Callable[..., object]) -> Callable[..., object]:
        def stop(self: Path, *args: object, **kwargs: object) -> object:
            if len(done) == 1:
                raise KeyboardInterrupt
            done.append(self)
            return act(self, *args, **kwargs)

        return stop

    with pytest.raises(KeyboardInterrupt), replaced("study", tmp_path) as folder:  # noqa: PT012
        write(folder, "scores.csv", "metrics.csv", "study.json")
        monkeypatch.setattr(Path, step, stopping(getattr(Path, step)))
    monkeypatch.undo()
    with pytest.raises(UsageError, match="no study"):
        read_study(tmp_path)
    with replaced("study", tmp_path) as folder:
        write(folder, "scores.csv", "study.json")
    assert {path.name for path in tmp_path.iterdir()} >= {"scores.csv", "study.json"}
    assert not (tmp_path / "speed_groups.csv").exists()
