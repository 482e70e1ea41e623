"""The README's commands work as they stand, and its links lead somewhere."""

import re
import shlex
from pathlib import Path

import pytest

from crashfuse import cli
from crashfuse.version import __version__
from tests.conftest import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_two_commands_install_and_run_what_exists() -> None:
    """Both install from the checkout; the first starts the dashboard on the sample, the second runs the tests."""
    blocks = [block.strip() for block in re.findall(r"```console\n(.*?)```", README, re.DOTALL)]
    start, torch, check, _ = (block.split(" && ") for block in blocks)
    assert start[0] == "python -m pip install -c constraints.txt ."
    assert check == [
        'python -m pip install -c constraints.txt -e ".[test]"',
        "python -m pytest -n logical --dist loadfile",
    ]
    assert torch[0].endswith("--index-url https://download.pytorch.org/whl/cpu")
    arguments = cli.parser().parse_args(shlex.split(start[1])[1:])
    assert (ROOT / arguments.campaign / "tests.csv").is_file()
    assert (ROOT / "constraints.txt").is_file()
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")  # proves them on every platform
    assert f"run: {blocks[2]}\n" in workflow
    assert f"run: {start[0]} && crashfuse --help\n" in workflow  # the dashboard itself never ends


@pytest.mark.parametrize("page", ["README.md", "docs/index.md"])
def test_the_cpu_build_of_torch_is_the_one_that_the_constraints_ask_for(page: str) -> None:
    """Another version would be replaced by PyPI's, with CUDA, in the next line."""
    [version] = re.findall(r"pip install torch==(\S+)", (ROOT / page).read_text(encoding="utf-8"))
    assert f"torch=={version}\n" in (ROOT / "constraints.txt").read_text(encoding="utf-8")


def test_what_certify_prints_is_as_on_its_page() -> None:
    [printed] = re.findall(r"```text\n(.*?)```", README, re.DOTALL)
    assert printed in (ROOT / "docs" / "how-to" / "certify.md").read_text(encoding="utf-8")


def test_the_citation_names_this_version() -> None:
    assert f"\nversion: {__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_linked_files_exist() -> None:
    links = re.findall(r"\]\((?!https?:)([^)]+)\)", README)
    assert len(links) > 10
    for link in links:
        name, _, anchor = link.partition("#")
        path: Path = ROOT / name
        assert path.is_file(), link
        headings = re.findall(r"^#+ (.+)$", path.read_text(encoding="utf-8"), flags=re.MULTILINE) if anchor else []
        assert not anchor or anchor in [heading.lower().replace(" ", "-") for heading in headings], link
