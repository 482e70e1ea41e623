"""The README's commands work as they stand, its figures are those of the benchmark, its links lead somewhere."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from crashfuse import cli
from crashfuse.version import __version__
from tests.conftest import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
ACCURACY = (ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8")
APPROACHES = ("CAE", "Time domain", "Displacement domain", "Fused")  # in the order of the columns
CAMPAIGNS = (
    "Sample",
    "Lumped parameters, runs paired with tests",
    "Lumped parameters, none paired",
    "Finite elements, unibody car",
    "Finite elements, pickup",
)


def test_the_two_commands_install_and_run_what_exists() -> None:
    """Both install from the checkout; the first starts the dashboard on the sample, the second runs the tests."""
    start, check = (block.strip().split(" && ") for block in re.findall(r"```console\n(.*?)```", README, re.DOTALL))
    assert start[0] == "python -m pip install -c constraints.txt ."
    assert check == [
        'python -m pip install -c constraints.txt -e ".[test]"',
        "python -m pytest -n logical --dist loadfile",
    ]
    arguments = cli.parser().parse_args(shlex.split(start[1])[1:])
    assert (ROOT / arguments.campaign / "tests.csv").is_file()
    assert (ROOT / "constraints.txt").is_file()


@pytest.mark.parametrize("page", ["README.md", "docs/index.md"])
def test_the_cpu_build_of_torch_is_the_one_that_the_constraints_ask_for(page: str) -> None:
    """Another version would be replaced by PyPI's, with CUDA, in the next line."""
    [version] = re.findall(r"CPU build of version (\S+) first", (ROOT / page).read_text(encoding="utf-8"))
    assert f"torch=={version}\n" in (ROOT / "constraints.txt").read_text(encoding="utf-8")


def test_the_public_workflow_runs_the_same_two_commands() -> None:
    """Whatever the README asks of a newcomer is proven on every platform."""
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    start, check = (block.strip() for block in re.findall(r"```console\n(.*?)```", README, re.DOTALL))
    assert f"run: {check}\n" in workflow
    assert f"run: {start.partition(' && ')[0]} && crashfuse --help\n" in workflow  # the dashboard itself never ends


def test_the_citation_names_this_version() -> None:
    """What is cited is what is installed."""
    assert f"\nversion: {__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def _rows(text: str) -> dict[str, list[str]]:
    """Rows of all tables in a text, by their first cell; of several the first."""
    rows: dict[str, list[str]] = {}
    for line in re.findall(r"^\| (.+) \|$", text, flags=re.MULTILINE):
        name, *cells = re.split(r" \| ", line)
        rows.setdefault(name, cells)
    return rows


def _printed(campaign: str, left_out: str) -> dict[str, list[str]]:
    """What the benchmark printed of a campaign: its table of means by approach."""
    text = ACCURACY.partition(f"### {campaign}, one {left_out} left out\n")[2]
    assert text, f"docs/accuracy.md lacks {campaign}, one {left_out} left out"
    return _rows(text.partition("\n### ")[0])


def _summaries() -> Iterator[tuple[str, str, str]]:
    """Tables that repeat what the benchmark printed: where, what was left out, the text of the table."""
    yield "README.md", "test", README
    yield "docs/accuracy.md", "test", ACCURACY.partition("\n## ")[0]
    yield "docs/accuracy.md", "speed group", ACCURACY.partition("\n## A speed")[2].partition("\n## ")[0]


@pytest.mark.parametrize("campaign", CAMPAIGNS)
def test_accuracy_is_what_the_benchmark_printed(campaign: str) -> None:
    """Means over 0–60 ms of each approach and of a second test; of the mixture the gap closed and the worst test."""
    for place, left_out, text in _summaries():
        printed = _printed(campaign, left_out)
        cells = _rows(text)[campaign]
        means = [printed[approach][2] for approach in APPROACHES]
        if left_out == "test":
            assert cells[2:] == [*means, _second_test(printed), printed["Fused"][4], printed["Fused"][3]], place
        else:
            assert cells == [*means, printed["Fused"][3]], place


def _second_test(printed: dict[str, list[str]]) -> str:
    """What was measured on repeats; else the estimate, which the tables mark by an asterisk."""
    measured = [cells[2] for name, cells in printed.items() if name.startswith("A repeat, measured")]
    return measured[0] if measured else printed["A repeat, estimated"][2] + r"\*"


def test_the_tutorial_shows_the_means_of_the_sample() -> None:
    """Over 0–60 ms, each test left out alone and with all tests at about its speed."""
    rows = _rows((ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8"))
    for approach in (*APPROACHES, "LF TCN"):
        assert rows[approach] == [_printed("Sample", way)[approach][2] for way in ("test", "speed group")], approach


def test_linked_files_exist() -> None:
    """No dead link, to a file or to a heading within it."""
    links = re.findall(r"\]\((?!https?:)([^)]+)\)", README)
    assert len(links) > 10
    for link in links:
        name, _, anchor = link.partition("#")
        path: Path = ROOT / name
        assert path.is_file(), link
        headings = re.findall(r"^#+ (.+)$", path.read_text(encoding="utf-8"), flags=re.MULTILINE) if anchor else []
        assert not anchor or anchor in [heading.lower().replace(" ", "-") for heading in headings], link
