"""The house keeps its plan: rooms in one order, imports only down it, no circles, tests beside what they test."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from tests.conftest import ROOT

PACKAGE = ROOT / "crashfuse"
ROOMS = (
    "testing",
    "cli",
    "ui",
    "results",
    "certification",
    "study",
    "approaches",
    "cae",
    "importing",
    "readers",
    "campaign_folder",
    "synthetic",
    "execution",
    "campaign",
    "vehicle_archive",
    "crash_test",
    "cae_library",
    "condition",
    "signals",
    "files",
    "extensions",
    "errors",
    "views",
    "units",
    "version",
)
"""Rooms and modules of the package from the top down: each may use what stands below it."""

MODULES = sorted(path for path in PACKAGE.rglob("*.py") if path.name not in ("__init__.py", "__main__.py"))


def _name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


NAMES = {_name(module): module for module in PACKAGE.rglob("*.py")}


@cache
def _imports(path: Path) -> frozenset[str]:
    """Modules of the package that a file imports, at its top or within a function."""
    return frozenset(_found(path))


def _found(path: Path) -> Iterator[str]:
    names = NAMES
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            candidates = [f"{node.module}.{alias.name}" for alias in node.names]
            yield from (c if c in names else node.module for c in candidates if node.module.startswith("crashfuse"))
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in names)


def _room(module: str) -> str:
    return module.split(".")[1]


def test_every_room_has_its_place() -> None:
    """A new room is a decision: it is entered in the order, and on the architecture page."""
    there = {path.stem for path in PACKAGE.iterdir() if path.is_dir() or path.suffix == ".py"}
    assert there - {"__init__", "__main__", "__pycache__", "py"} == set(ROOMS)


def test_the_architecture_page_shows_the_rooms_in_their_order() -> None:
    """The table that a newcomer reads is the order that is checked here."""
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8").partition("\n## Rooms")[2]
    assert tuple(re.findall(r"^\| `(\w+)(?:/|\.py)` \|", page, flags=re.MULTILINE)) == ROOMS


@pytest.mark.parametrize("path", MODULES, ids=lambda path: _name(path).removeprefix("crashfuse."))
def test_imports_run_one_way(path: Path) -> None:
    """A module imports from its own room and from those below it, never from one above."""
    own = ROOMS.index(_room(_name(path)))
    upwards = [name for name in _imports(path) if name.count(".") and ROOMS.index(_room(name)) < own]
    assert upwards == []


def test_no_module_imports_itself_in_a_circle() -> None:
    """Whoever changes a module has to look at those above it, and at no other."""
    graph = {name: _imports(path) - {name} for name, path in NAMES.items()}
    assert len(list(TopologicalSorter(graph).static_order())) >= len(graph)  # raises CycleError where there is one


def test_what_data_show_of_themselves_is_made_where_things_are_shown() -> None:
    """Data know no rooms above them but by their views: figures, cards and files; and tables, to and from frames."""
    homes = re.findall(r"^from \.([\w.]+) import", (PACKAGE / "views.pyi").read_text(encoding="utf-8"), re.MULTILINE)
    assert {home for home in homes if not home.startswith("results.")} == {"campaign_folder.writer"}


def test_one_module_alone_writes_csv() -> None:
    """So that no table goes out with a formula from a laboratory in it."""
    writes = re.compile(r"\.to_csv\(|csv\.(writer|DictWriter)\(|\.to_clipboard\(")
    pages = [ROOT / "app.py", *(ROOT / "pages").glob("*.py")]
    found = {path.name for path in (*MODULES, *pages) if writes.search(path.read_text(encoding="utf-8"))}
    assert found == {"csv_text.py"}


def test_nothing_shown_is_read_back() -> None:
    """Numbers of a figure or a page come from what it was made of, never from its drawing, its HTML or its cells."""
    shows = [path for path in MODULES if _room(_name(path)) in ("results", "ui", "cli")]
    reading = re.compile(r"to_plotly_json|HTMLParser|\bimport re\b")
    reads = {_name(path) for path in shows if reading.search(path.read_text(encoding="utf-8"))}
    # what users wrote: web addresses in a text, a window in a field; and options in the advice of the command line
    assert reads == {"crashfuse.ui.kit.text", "crashfuse.ui.kit.address"}


MOST = {
    "modules": 228,
    "lines": 43_814,
    "words of docstrings": 45_931,
    "words of other texts": 27_376,
    "of tests": 34_487,
}
"""The size of the house: package and pages, then lines of tests. It may be lowered, never raised."""
LONGEST, SHORTEST = 450, 40  # lines of a module; one that is a face (``__init__``) or a table may be shorter
TABLES = {"version.py", "views.py", "__main__.py"}


def test_the_house_keeps_its_size() -> None:
    """Whoever adds folds something else."""
    size = dict.fromkeys(MOST, 0)
    for path in (*PACKAGE.rglob("*.py"), *(ROOT / "pages").glob("*.py"), ROOT / "app.py"):
        text = path.read_text(encoding="utf-8")
        docstrings, others = _words(ast.parse(text))
        for name, n in zip(MOST, (1, text.count("\n"), docstrings, others), strict=False):
            size[name] += n
    size["of tests"] = sum(path.read_text(encoding="utf-8").count("\n") for path in (ROOT / "tests").rglob("*.py"))
    assert {name: n for name, n in size.items() if n > MOST[name]} == {}


def test_a_module_is_neither_long_nor_a_scrap() -> None:
    """One noun each, in a size that one reads in one go."""
    lines = {_name(path): path.read_text(encoding="utf-8").count("\n") for path in MODULES if path.name not in TABLES}
    assert {name: n for name, n in lines.items() if not SHORTEST <= n <= LONGEST} == {}


def _words(tree: ast.Module) -> tuple[int, int]:
    """Words of the docstrings of a module, and of its other literal texts."""
    nodes = [*ast.walk(tree)]
    literals = (node for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str))
    texts: dict[ast.expr, int] = {node: len(str(node.value).split()) for node in literals}
    docstrings = sum(texts.get(node.value, 0) for node in nodes if isinstance(node, ast.Expr))
    return docstrings, sum(texts.values()) - docstrings
