"""The README's commands and code work as they stand."""

import re
import shlex
import shutil
from pathlib import Path

import pytest

from crashfuse import cli
from tests.conftest import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    """Code blocks of a language."""
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def test_the_two_commands_install_and_run_what_exists() -> None:
    """Both install from the checkout; the first starts the dashboard on the sample, the second runs the tests."""
    start, check = (block.strip().split(" && ") for block in blocks("console"))
    assert start[0] == "python -m pip install -c constraints.txt ."
    assert check == [
        'python -m pip install -c constraints.txt -e ".[test]"',
        "python -m pytest -n logical --dist loadfile",
    ]
    arguments = cli.parser().parse_args(shlex.split(start[1])[1:])
    assert (ROOT / arguments.campaign / "tests.csv").is_file()
    assert (ROOT / "constraints.txt").is_file()


def _help(capsys: pytest.CaptureFixture[str], *command: str) -> str:
    with pytest.raises(SystemExit):
        cli.main([*command, "--help"])
    return capsys.readouterr().out


def test_every_documented_command_and_option_exists(capsys: pytest.CaptureFixture[str]) -> None:
    """What the README lists is what `--help` knows, and the other way round."""
    (listing,) = (block for block in blocks("text") if "crashfuse app" in block)
    documented = {
        entry.split()[1]: set(re.findall(r"--[a-z-]+", entry)) for entry in re.split(r"\n(?=crashfuse )", listing)
    }
    commands = set(re.findall(r"^ {4}([a-z-]+)(?: |$)", _help(capsys), flags=re.MULTILINE))
    assert set(documented) == commands
    for command, options in documented.items():
        assert set(re.findall(r"--[a-z-]+", _help(capsys, command))) - {"--help"} == options, command


@pytest.mark.usefixtures("quick_networks")
@pytest.mark.slow
def test_the_library_example_runs(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """On the sample campaign, with a smaller network, in a folder beside it."""
    shutil.copytree(ROOT / "sample_data", tmp_path / "sample_data")
    monkeypatch.chdir(tmp_path)
    (code,) = blocks("python")
    exec(code, {})  # noqa: S102 - our own README
    assert "displacement_domain" in capsys.readouterr().out
    assert (tmp_path / "out" / "T09" / "report.html").is_file()


@pytest.mark.parametrize("name", ["docs/compare.png", "LICENSE", "CHANGELOG.md"])
def test_linked_files_exist(name: str) -> None:
    """No dead link."""
    assert f"]({name})" in README
    assert (ROOT / name).is_file()
