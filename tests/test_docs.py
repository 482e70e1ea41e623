"""The documentation is true: commands and code run and print what is shown, figures agree, links lead somewhere.

A block of text right below a block of commands is what these print. ``…`` stands for any words, alone on a line for any
lines; numbers have to agree to the digits shown.
"""

import ast
import contextlib
import dataclasses
import inspect
import io
import json
import os
import pkgutil
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import crashfuse
from crashfuse import cli
from crashfuse.campaign import Campaign
from crashfuse.signals.pulse import GRID_S, Pulse
from tests.conftest import ROOT, condition_table, write_campaign

DOCS = ROOT / "docs"
PAGES = sorted(path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md"))
NOTEBOOKS = sorted(DOCS.rglob("*.ipynb"))
WITH_CODE = [page for page in PAGES if re.search(r"```(python|console)", (DOCS / page).read_text(encoding="utf-8"))]

IDS = ("T04", "T05", "T09", "T10")  # the pages speak of the sample campaign; here a small one has its place and its ids
# what needs more than a test machine has, or many minutes
READ_ONLY = ("--scheduler", "--device cuda", "learn-archive", "--archive")
# the words of others: not run here
NOT_OURS = ("python -m pip ", "python -m mkdocs ", "dask ", "osv-scanner ", "pip-audit ", "sed ", "uv ", "uvx ")
BLOCK = re.compile(r"```python\n(?P<code>[^`]*)```|```console\n(?P<commands>[^`]*)```\n\n```text\n(?P<output>[^`]*)```")
NUMBER = re.compile(r"([+−-]?\d+\.\d+)")
TABLE = re.compile(
    r"^<!-- data (?P<file>\S+?)(?: where (?P<where>.+?))?(?: pivot (?P<value>.+?) by (?P<by>.+?))? -->\n\n"
    r"(?P<rows>(?:\|.*\|\n)+)",
    re.MULTILINE,
)
TEXTS = {page: (ROOT / page).read_text(encoding="utf-8") for page in ("README.md", *(f"docs/{page}" for page in PAGES))}
IN_THE_CHECKOUT = re.compile(r"python -m (supply_chain\.\w+)")


@pytest.mark.slow
@pytest.mark.usefixtures("quick_networks", "one_cache")
@pytest.mark.parametrize("page", WITH_CODE)
def test_all_code_on_a_page_runs(
    page: str, campaign: Campaign, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    accel = campaign.tests[-1].pulse.accel_mps2
    shorter = Pulse(GRID_S, 1.05 * np.interp(1.05 * GRID_S, GRID_S, accel))
    apart = (campaign.tests[0], *campaign.tests[2:], dataclasses.replace(campaign.tests[-1], pulse=shorter))
    tests = tuple(dataclasses.replace(test, id=name) for name, test in zip(IDS, apart, strict=True))
    write_campaign(dataclasses.replace(campaign, tests=tests), tmp_path / "campaign")
    condition_table([("N1", tests[1].condition)]).to_csv("candidates.csv", index=False)
    condition_table([("M1", tests[1].condition)]).to_csv("campaign/matrix.csv", index=False)
    Path("campaign/criteria.toml").write_text('[[criterion]]\nmetric = "max_crush"\nat_most = 430\n', encoding="utf-8")
    names: dict[str, object] = {}
    blocks = re.findall(r"```(python|console)\n(.*?)```", TEXTS[f"docs/{page}"], re.DOTALL)
    shown = {line for block in _shown(page) if block["commands"] for line in block["commands"].splitlines()}
    for language, code in blocks:
        if language == "python":
            exec(code, names)  # noqa: S102 - our own documentation
            continue
        for line in code.splitlines():
            out = re.search(r"--out (\S+)", line)
            is_read = out is not None and sum(code.count(out[1]) for _, code in blocks) > 1
            if line not in shown or out is None or is_read:  # the next test runs what is shown
                run(line)


def run(line: str) -> None:
    """Run a documented command; one that needs what is not there, or never ends, is only parsed."""
    if line.startswith(NOT_OURS):
        return
    if (module := IN_THE_CHECKOUT.match(line)) is not None:
        assert (ROOT / module[1].replace(".", "/")).with_suffix(".py").is_file()
        return
    program, *arguments = shlex.split(line)
    assert program == "crashfuse", f"{line}: another program, or not a command"
    parsed = cli.parser().parse_args(arguments)
    if arguments[0] == "app" or any(option in line for option in READ_ONLY):
        return
    if arguments[0] == "sample":
        assert parsed.folder.name == "campaign"  # where the small one already is
        return
    if arguments[0] == "study" and "--workers" not in arguments:
        arguments += ["--workers", "1"]  # others would not know of the small networks
    if arguments[0] == "figures":
        arguments[arguments.index("--format") + 1 :] = ["csv"]  # pictures take a browser
    assert cli.main(arguments) == 0, line


def _shown(page: str) -> list[re.Match[str]]:
    """Blocks of code, and of commands with their output, down to the last output."""
    blocks = list(BLOCK.finditer(TEXTS[f"docs/{page}"]))
    while blocks and blocks[-1]["output"] is None:
        blocks.pop()
    return blocks


@pytest.mark.slow
@pytest.mark.usefixtures("one_cache")
@pytest.mark.parametrize("page", [page for page in PAGES if _shown(page)])
def test_what_a_page_shows_is_what_is_printed(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    if "crashfuse sample" not in TEXTS[f"docs/{page}"]:
        shutil.copytree(ROOT / "sample_data", "campaign")
    names: dict[str, object] = {}
    for block in _shown(page):
        if block["code"] is not None:
            exec(block["code"], names)  # noqa: S102 - our own documentation
            continue
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            for line in block["commands"].splitlines():
                assert cli.main(shlex.split(line)[1:]) == 0, line
        assert _agrees(block["output"], printed.getvalue()), f"{block['commands']}prints\n{printed.getvalue()}"


def _agrees(shown: str, printed: str) -> bool:
    """Whether all that is shown was printed; a last digit may be off by one, for machines round differently."""
    numbers = NUMBER.findall(shown)
    lines = [r"(?:.*\n)*?" if line == "…" else _pattern(line) + r"\n" for line in shown.splitlines()]
    found = re.fullmatch("".join(lines), re.sub(r" +$", "", printed, flags=re.MULTILINE))
    return found is not None and all(
        abs(float(a.replace("−", "-")) - float(b.replace("−", "-"))) < 1.001 * 10.0 ** -len(a.partition(".")[2])
        for a, b in zip(numbers, found.groups(), strict=True)
    )


def _pattern(line: str) -> str:
    """What a shown line matches: a group for each number, with as many digits."""
    words = NUMBER.split(line)
    numbers = (rf"([+−-]?\d+\.\d{{{len(number.partition('.')[2])}}})" for number in words[1::2])
    plain = (re.escape(word).replace("…", ".*") for word in words[::2])
    return next(plain) + "".join(number + word for number, word in zip(numbers, plain, strict=True))


class _Page(HTMLParser):
    """Links and anchors of a page, and everything that a browser would fetch for it."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.anchors, self.links, self.fetched = set[str](), set[str](), set[str]()
        self.text = path.read_text(encoding="utf-8")
        self.feed(self.text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("id", "name") and value:
                self.anchors.add(value)
            if value and (name in ("src", "srcset", "data") or (name == "href" and tag == "link")):
                self.fetched.add(value)
            elif value and name == "href" and tag == "a":
                self.links.add(value)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory, shared_cache: Path) -> Path:
    """The built site, all notebooks run; warnings (a missing page, a reference to nothing) end the build."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    env = {**os.environ, "CRASHFUSE_CACHE": str(shared_cache)}
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True, encoding="utf-8")
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, _Page]:
    """All pages of the site."""
    return {path: _Page(path) for path in site.rglob("*.html")}


@pytest.mark.slow
def test_every_page_is_built_and_every_link_leads_somewhere(site: Path, pages: dict[Path, _Page]) -> None:
    assert {path.relative_to(site).with_suffix(".md").as_posix() for path in pages} >= set(PAGES)
    dead = []
    for path, page in pages.items():
        for link in sorted(page.links):
            place, _, anchor = link.partition("#")
            target = (path.parent / place).resolve() if place else path
            if re.match(r"https?:|/", link) or path.name == "404.html":
                continue
            if not target.is_file() or (anchor and target in pages and anchor not in pages[target].anchors):
                dead.append(f"{path.relative_to(site)}: {link}")
    assert dead == []


@pytest.mark.slow
def test_a_reader_fetches_nothing_from_elsewhere(site: Path, pages: dict[Path, _Page]) -> None:
    """No font, script, style or picture of another server: not by a page, a style or a script."""
    fetched = {value for page in pages.values() for value in page.fetched}
    assert fetched
    assert {value for value in fetched if re.match(r"(https?:)?//", value)} == set()
    for path in site.rglob("*.css"):
        assert not re.search(r"(url\(|@import)\s*[\"']?(https?:)?//", path.read_text(encoding="utf-8")), path


@pytest.mark.slow
def test_equations_and_docstrings_are_set(pages: dict[Path, _Page]) -> None:
    assert sum(page.text.count("<math") for page in pages.values()) > 100
    left = re.compile(
        r":(class|func|meth|mod|data|attr|math):`|class=\"arithmatex\"|\.\. math::|<!-- help|>\\[a-z]{2,}<|&gt;&gt;&gt;"
    )
    assert {path.name: found[0] for path, page in pages.items() if (found := left.search(page.text))} == {}


def test_the_help_of_every_command_is_on_its_page() -> None:
    (commands,) = (action.choices for action in cli.parser()._actions if isinstance(action.choices, dict))
    page = (DOCS / "reference" / "command-line.md").read_text(encoding="utf-8")
    assert re.findall(r"<!-- help (\S+) -->", page) == list(commands)


def test_no_page_holds_the_marks_of_a_merge() -> None:
    """A conflict left in a page is shown as text, and nothing else notices."""
    pages = [*ROOT.glob("*.md"), *DOCS.rglob("*.md")]
    marked = re.compile(r"^(<<<<<<< |>>>>>>> )", re.MULTILINE)
    assert not [page for page in pages if marked.search(page.read_text(encoding="utf-8"))]


def _cells(line: str) -> list[str]:
    return [cell.strip().removesuffix(r"\*") for cell in line.strip("|\n").split("|")]


@pytest.mark.parametrize("page", [page for page, text in TEXTS.items() if TABLE.search(text)])
def test_the_numbers_of_a_table_are_those_of_its_file(page: str) -> None:
    """Each row has the cells of one row of the file in ``docs/data``, which a benchmark wrote; some may be left out."""
    for table in TABLE.finditer(TEXTS[page]):
        data = pd.read_csv(DOCS / "data" / table["file"], dtype=str, keep_default_na=False)
        header, _, *rows = map(_cells, table["rows"].splitlines())
        for column, _, value in (where.partition("=") for where in (table["where"] or "").split(", ") if where):
            data = data[data[column] == value]
        if table["by"]:
            data = data.pivot(index=header[0], columns=table["by"], values=table["value"]).reset_index()
        stored = data[header].to_numpy().tolist()
        assert [row for row in rows if row not in stored] == [], (page, table["file"])
        assert rows


def test_every_table_of_measured_numbers_names_its_file() -> None:
    """Right-aligned columns are numbers; on the pages of accuracy, cost and method they come from ``docs/data``."""
    for page, text in TEXTS.items():
        if re.match(r"README|docs/(accuracy|scaling|tutorial|method/.*)\.md", page):
            assert len(re.findall(r"---: ?\|\n", text)) == len(TABLE.findall(text)), page


def test_means_are_those_of_the_tests() -> None:
    """The files of the accuracy benchmark agree: means, worst tests and counts come from the rows of single tests."""
    tests, approaches, means, expected = (
        pd.read_csv(DOCS / "data" / f"accuracy{name}.csv") for name in ("_tests", "_approaches", "", "_expected")
    )
    windows = [column for column in tests if str(column).endswith(" ms")]
    by = tests.groupby(["campaign", "left out", "approach"])[windows]
    shown = approaches.set_index(["campaign", "left out", "approach"])
    assert by.mean().sub(shown.loc[by.mean().index, windows]).abs().to_numpy().max() < 0.00101
    worst = by.min()["0–60 ms"].sub(shown["worst"]).dropna()
    assert len(worst) >= 25
    assert worst.abs().max() < 1e-9
    alone, expected = (table[table["left out"] == "test"].set_index("campaign") for table in (means, expected))
    assert expected.groupby(level=0).size().to_dict() == alone["tests"].to_dict()
    likely = (expected["came out"] == "as expected").groupby(level=0).sum()
    assert likely.to_dict() == alone["inside 80 %"].to_dict()
    off = (expected["expected"] - expected["rated"]).groupby(level=0).mean()
    assert (off - alone["expected off by"].str.replace("−", "-").astype(float)).abs().max() < 0.00101


def test_every_page_is_in_the_navigation() -> None:
    listed = re.findall(r"^ +- (\S+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), flags=re.MULTILINE)
    pages = [path.relative_to(DOCS).with_suffix(".md").as_posix() for path in NOTEBOOKS]
    assert sorted(listed) == sorted([*PAGES, *pages])


def test_every_public_name_is_documented_once_where_users_look_first() -> None:
    """With its signature, if it is a function, and an example, whose calls that function takes."""
    page = (DOCS / "reference" / "library.md").read_text(encoding="utf-8")
    shown = re.findall(r"^- `(\w+)(\(.*\))?`:\s[^`]*(?:`[\w.]+` [^`]*)?\n  `(.+)`$", page, flags=re.MULTILINE)
    assert sorted(name for name, _, _ in shown) == sorted(set(crashfuse.__all__) - {"__version__"})
    for name, signature, example in shown:
        known = getattr(crashfuse, name)
        assert bool(signature) or isinstance(known, type), name
        assert not signature or signature == _signature(known), name
        for node in ast.walk(ast.parse(example)):
            if isinstance(node, ast.Call) and re.fullmatch(r"crashfuse(\.\w+)+", ast.unparse(node.func)):
                call = pkgutil.resolve_name(ast.unparse(node.func).replace(".", ":", 1))
                inspect.signature(call).bind(*node.args, **{str(word.arg): word for word in node.keywords})


def _signature(call: Callable[..., object]) -> str:
    known, parts = inspect.signature(call), list[inspect.Parameter]()
    for one in known.parameters.values():
        is_short = one.default in ((), None, one.empty) or isinstance(one.default, int | float | str)
        parts.append(one.replace(annotation=one.empty, default=one.default if is_short else ...))
    return str(known.replace(parameters=parts, return_annotation=known.empty)).replace("Ellipsis", "…")


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_kept_without_outputs(path: Path) -> None:
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert [(cell["outputs"], cell["execution_count"]) for cell in code] == [([], None)] * len(code)


COMES_OUT = {
    "first-verdict": (5, ["Maximum dynamic crush (mm)</td>", ">not covered by tests</td>"]),
    "your-own-data": (2, ["DataError: tests: expected one column rear_weight_lb or rear_weight_kg", "<pre>True</pre>"]),
    "reading-the-band": (4, ["inside at a given time: 95%", "<th>max_crush</th>", "with its speed group</th>"]),
    "a-third-approach": (1, ["10 passed in", "Nearest test</td>", "with its speed group</th>"]),
}


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_was_run_and_shows_what_came_out(path: Path, site: Path) -> None:
    """Each figure, drawn by our own plotly.js, linked once; the sentences and tables; itself, to be downloaded."""
    page = (site / "notebooks" / f"{path.stem}.html").read_text(encoding="utf-8")
    figures, texts = COMES_OUT[path.stem]
    assert page.count("Plotly.newPlot(") == figures
    assert [text for text in texts if text not in page] == []
    assert not re.search(r"Traceback|Warning:|<!-- figure|\x1b", page)
    assert page.count('<script src="plotly.min.js">') == 1
    assert (site / "notebooks" / "plotly.min.js").stat().st_size > 1e6
    assert f'href="{path.name}"' in page
    assert (site / "notebooks" / path.name).read_bytes() == path.read_bytes()


BUILD = """
import sys, nbformat
from mkdocs.exceptions import PluginError
from notebook_pages import executed

for code in ("import warnings; warnings.warn('old')", "import sys; sys.stderr.write('odd')"):
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(code)])
    try:
        executed(nbformat.writes(notebook), "odd.ipynb")
    except PluginError as error:
        print(str(error).splitlines()[0], str(error).splitlines()[-1])
"""


@pytest.mark.slow
def test_a_cell_that_warns_or_complains_ends_the_build() -> None:
    done = subprocess.run([sys.executable, "-c", BUILD], cwd=DOCS, capture_output=True, text=True, encoding="utf-8")
    warned, complained = done.stdout.splitlines()
    assert re.fullmatch(r"odd\.ipynb: .*UserWarning: old", warned), done.stderr
    assert re.fullmatch(r"odd\.ipynb writes to its standard error: odd.*", complained)
