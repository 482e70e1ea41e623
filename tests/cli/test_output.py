"""The folder of a command's results."""

from pathlib import Path

import pytest

from crashfuse import cli
from crashfuse.files.claim import sole_writer

WEIGHTS = ["--front-weight-lb", "2000", "--rear-weight-lb", "1600"]
COMMANDS = {
    "study": [],
    "predict": ["--speed-mph", "30", *WEIGHTS],
    "sweep": WEIGHTS,
    "certify": [],
    "train": [],
    "learning-curve": [],
    "next-test": [],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_folder_that_another_command_writes_to_is_refused(
    command: str, campaign_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In one sentence, before anything is computed; the other's files are left alone."""
    out = tmp_path / "out"
    asked = [command, str(campaign_folder), "--out", str(out), *COMMANDS[command]]
    with sole_writer(out):
        (out / "begun").touch()
        assert cli.main(asked) == cli.WRONG_DATA
        assert [path.name for path in out.iterdir() if not path.name.startswith(".")] == ["begun"]
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("crashfuse: Another command (process ")
    assert line.endswith(f"is writing to {out}; wait until it has ended, or name another folder.")


def test_a_command_that_fails_leaves_no_empty_folder(campaign_folder: Path, tmp_path: Path) -> None:
    """The claim is given back, and with it the folder that was made for it."""
    (campaign_folder / "cae.csv").unlink()
    out = tmp_path / "deep" / "out"
    for _ in range(2):
        assert cli.main(["study", str(campaign_folder), "--out", str(out)]) == cli.WRONG_DATA
        assert not out.parent.exists()
